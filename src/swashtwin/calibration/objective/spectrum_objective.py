"""How far a twin is from the measurement, and how that changes with what is searched."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

from swashtwin.calibration.objective.measurement import Measurement
from swashtwin.calibration.objective.phases import turned
from swashtwin.calibration.objective.unknowns import Nuisances, SearchSpace, Unknowns, search_space, unknowns_of
from swashtwin.foundation import InputError
from swashtwin.physics import SteadySolver, Twin

MODEL_ERROR = 0.05
"""Relative error of every simulated line that even the right values leave; our estimate, as in docs/physics.md."""
FLOOR = 0.02
"""Least standard deviation of a line [m/s^2], from both sides together; as in docs/physics.md."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """One twin beside one measurement at its condition, line by line.

    What is compared are *readings*: the lines' amplitudes, phases being dropped as in the paper, or, of a measurement
    with phases, the real and then the imaginary parts of its lines, the twin being turned to the shaft position at
    which it comes nearest.
    """

    twin: Twin
    """The twin, computed up to the end of the measurement's band."""
    measurement: Measurement
    """What it shall come near to."""
    background: Float[np.ndarray, "channel order"] | None = None
    """What stands in each line [m/s^2] beside the twin's, at a phase of its own; nothing where None."""
    floor: Float[np.ndarray, "channel order"] | float = FLOOR
    """Least standard deviation of a line [m/s^2]."""

    @cached_property
    def _rows(self) -> Tensor:
        return torch.tensor([self.twin.pump.channels.index(name) for name in self.measurement.channels])

    @cached_property
    def _columns(self) -> Tensor:
        return torch.as_tensor(np.flatnonzero(np.isin(self.twin.orders, self.measurement.orders)))

    @cached_property
    def _orders(self) -> Tensor:
        return torch.as_tensor(self.measurement.orders)

    @cached_property
    def _places(self) -> Tensor | None:
        """Where the twin's lines stand among those measured; None where it has all of them."""
        places = np.flatnonzero(np.isin(self.measurement.orders, self.twin.orders))
        return None if len(places) == len(self.measurement.orders) else torch.as_tensor(places)

    @cached_property
    def _frequency(self) -> Tensor:
        return self._orders * self.twin.condition.shaft_frequency

    @property
    def has_phases(self) -> bool:
        """Whether phases are compared too."""
        return self.measurement.phasor is not None

    @cached_property
    def measured(self) -> Float[Tensor, "channel reading"]:
        """Measured readings [m/s^2]."""
        if self.measurement.phasor is None:
            return torch.as_tensor(self.measurement.amplitude)
        return _parts(torch.as_tensor(self.measurement.phasor))

    @cached_property
    def sigma(self) -> Float[Tensor, "channel reading"]:
        """Standard deviation of measured minus simulated reading [m/s^2].

        From the measurement's scatter, 5 % of the amplitude for what rigid bodies cannot model, and `floor`, by default
        0.02 m/s^2. A line of little amplitude then counts little, which it would not on a decibel scale.
        """
        measurement = self.measurement
        if measurement.phasor is None or measurement.phasor_deviation is None:
            return _sigma(measurement.amplitude, measurement.deviation, self.floor)
        return _sigma(np.abs(measurement.phasor), measurement.phasor_deviation, self.floor).repeat(1, 2)

    def _lines(
        self, unknowns: Unknowns, point: Float[Tensor, "*batch unknown"], solver: SteadySolver | None
    ) -> Complex[Tensor, "*batch channel order"]:
        lines = self.twin.acceleration(unknowns.values_of(point), scales=unknowns.scales_of(point), solver=solver)
        lines = lines.index_select(-2, self._rows).index_select(-1, self._columns)
        if self._places is not None:
            silent = lines.new_zeros(*lines.shape[:-1], len(self.measurement.orders))
            lines = silent.index_copy(-1, self._places, lines)
        path = unknowns.response_of(point, self._frequency)
        return lines if path is None else lines * path

    def amplitude(
        self, unknowns: Unknowns, point: Float[Tensor, "*batch unknown"], *, solver: SteadySolver | None = None
    ) -> Float[Tensor, "*batch channel order"]:
        """Simulated amplitudes [m/s^2] at `point`, differentiable; the `background` alone where the twin is silent."""
        lines = self._lines(unknowns, point, solver).abs()
        if self.background is None:
            return lines
        return (lines.square() + torch.as_tensor(self.background).square() + 1e-24).sqrt()

    def readings(
        self, unknowns: Unknowns, point: Float[Tensor, "*batch unknown"], *, solver: SteadySolver | None = None
    ) -> Float[Tensor, "*batch channel reading"]:
        """Simulated readings [m/s^2] at `point`, differentiable."""
        if self.measurement.phasor is None:
            return self.amplitude(unknowns, point, solver=solver)
        lines = self._lines(unknowns, point, solver)
        weight = self.sigma[:, : len(self._orders)] ** -2
        return _parts(turned(lines, torch.as_tensor(self.measurement.phasor), weight, self._orders))

    def with_readings(self, readings: Float[np.ndarray, " reading"]) -> "Comparison":
        """The same, had `readings` (channels one after the other) been measured."""
        rows = readings.reshape(self.measured.shape)
        if self.measurement.phasor is None:
            return replace(self, measurement=replace(self.measurement, amplitude=rows))
        count = len(self.measurement.orders)
        phasor = rows[:, :count] + 1j * rows[:, count:]
        return replace(self, measurement=replace(self.measurement, phasor=phasor, amplitude=np.abs(phasor)))

    def amplitude_of(self, twin: Twin) -> Float[np.ndarray, "channel order"]:
        """Amplitudes [m/s^2] that `twin`, with its own values, has where this comparison has lines."""
        limited = replace(twin, bandwidth=self.twin.bandwidth)
        with torch.no_grad():
            lines = limited.acceleration().index_select(-2, self._rows)
        columns = np.flatnonzero(np.isin(limited.orders, self.measurement.orders))
        return lines[:, columns].abs().numpy()


@dataclass(frozen=True, eq=False)
class Objective:
    """Distance between a twin and what was measured of it at one or several conditions.

    All comparisons share what is searched, one *point* of `unknowns`: so a pump measured at three pressures is
    calibrated once. Amplitudes of all comparisons, channels and orders stand in one row of *readings*.
    """

    comparisons: tuple[Comparison, ...]
    """One for each condition."""
    space: SearchSpace
    """Bounds of the six values."""
    unknowns: Unknowns
    """What is searched."""

    @property
    def twin(self) -> Twin:
        """The first condition's twin; the others differ from it in condition only."""
        return self.comparisons[0].twin

    @property
    def has_phases(self) -> bool:
        """Whether phases are compared too."""
        return self.comparisons[0].has_phases

    @cached_property
    def measured(self) -> Float[Tensor, " reading"]:
        """Measured readings [m/s^2]; see `Comparison`."""
        return torch.cat([one.measured.reshape(-1) for one in self.comparisons])

    @cached_property
    def sigma(self) -> Float[Tensor, " reading"]:
        """Standard deviation of measured minus simulated reading [m/s^2]; see `Comparison.sigma`."""
        return torch.cat([one.sigma.reshape(-1) for one in self.comparisons])

    def fingerprint(self) -> str:
        """SHA-256 of all that a search is told: twins, recordings, lines, bounds and priors; hexadecimal."""
        digest = hashlib.sha256(repr((self.unknowns.names, [one.twin for one in self.comparisons])).encode())
        for one in self.comparisons:
            digest.update(repr([recording.fingerprint() for recording in one.measurement.recordings]).encode())
            digest.update(np.ascontiguousarray(one.measurement.orders).tobytes())
            if one.background is not None:
                digest.update(np.ascontiguousarray(one.background).tobytes())
        arrays = (self.measured.numpy(), self.sigma.numpy(), *vars(self.space).values())
        for array in (*arrays, self.unknowns.center, self.unknowns.deviation, self.unknowns.start):
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()

    @cached_property
    def start(self) -> Float[Tensor, " unknown"]:
        """The point of the nominal twin."""
        return torch.as_tensor(self.unknowns.start)

    def readings(
        self, point: Float[Tensor, "*batch unknown"], *, solver: SteadySolver | None = None
    ) -> Float[Tensor, "*batch reading"]:
        """Simulated readings [m/s^2], differentiable."""
        parts = [one.readings(self.unknowns, point, solver=solver) for one in self.comparisons]
        return torch.cat([part.flatten(-2) for part in parts], dim=-1)

    def amplitude(
        self, point: Float[Tensor, "*batch unknown"], *, solver: SteadySolver | None = None
    ) -> Float[Tensor, "*batch line"]:
        """Simulated amplitudes [m/s^2], differentiable; they are the readings where phases are dropped."""
        parts = [one.amplitude(self.unknowns, point, solver=solver) for one in self.comparisons]
        return torch.cat([part.flatten(-2) for part in parts], dim=-1)

    def with_readings(self, readings: Float[np.ndarray, " reading"]) -> "Objective":
        """The same, had `readings` been measured."""
        ends = np.cumsum([one.measured.numel() for one in self.comparisons])[:-1]
        pairs = zip(self.comparisons, np.split(readings, ends), strict=True)
        return replace(self, comparisons=tuple(one.with_readings(part) for one, part in pairs))

    def require_amplitudes(self, who: str) -> None:
        """Refuse an objective with phases.

        Raises
        ------
        InputError
            Phases are compared, of which `who` knows nothing.
        """
        if self.has_phases:
            raise InputError(f"{who} compares amplitudes only; measure and calibrate with phases=False.")

    def spectrum_loss(
        self, point: Float[Tensor, "*batch unknown"], *, solver: SteadySolver | None = None
    ) -> Float[Tensor, "*batch"]:
        """RMSE between simulated and measured readings over the RMS of the measured ones (the paper's L_freq).

        With several conditions, the root of the mean of their squares, so that none counts more for being louder.
        """
        squares = [
            (one.readings(self.unknowns, point, solver=solver) - one.measured).square().mean(dim=(-2, -1))
            / one.measured.square().mean()
            for one in self.comparisons
        ]
        return _root(torch.stack(squares).mean(dim=0))

    def weighted_loss(
        self, point: Float[Tensor, "*batch unknown"], *, solver: SteadySolver | None = None
    ) -> Float[Tensor, "*batch"]:
        """RMS of the differences over `sigma`: 1 where they are as large as expected."""
        difference = (self.readings(point, solver=solver) - self.measured) / self.sigma
        return _root(difference.square().mean(dim=-1))

    def prior_loss(self, point: Float[Tensor, "*batch unknown"]) -> Float[Tensor, "*batch"]:
        """Sum of squares of how far each coordinate is from the mean of its prior, in standard deviations."""
        center, deviation = torch.as_tensor(self.unknowns.center), torch.as_tensor(self.unknowns.deviation)
        return ((point - center) / deviation).square().sum(dim=-1)

    def sensitivity(
        self, point: Float[Tensor, " unknown"], *, solver: SteadySolver | None = None
    ) -> tuple[Float[Tensor, " reading"], Float[Tensor, "reading unknown"]]:
        """Readings [m/s^2] at `point`, and their exact derivatives with respect to its coordinates."""
        directions = torch.eye(len(point), dtype=point.dtype)
        points = point.detach().repeat(len(point), 1).requires_grad_()
        readings = self.readings(points, solver=solver)
        # Backward is linear in the weights it is given: its derivative along a direction, with respect to them, is the
        # forward derivative along that direction. One batch holds all directions.
        weights = torch.zeros_like(readings, requires_grad=True)
        (backward,) = torch.autograd.grad(readings, points, weights, create_graph=True)
        (slope,) = torch.autograd.grad((backward * directions).sum(), weights)
        return readings[0].detach(), slope.T


def _parts(lines: Complex[Tensor, "*batch order"]) -> Float[Tensor, "*batch reading"]:
    """Real parts, then imaginary parts."""
    return torch.cat([lines.real, lines.imag], dim=-1)


def _sigma(amplitude: np.ndarray, deviation: np.ndarray, floor: np.ndarray | float) -> Tensor:
    return torch.as_tensor(np.sqrt(deviation**2 + (MODEL_ERROR * amplitude) ** 2 + floor**2))


def _root(square: Tensor) -> Tensor:
    """Square root whose derivative stays finite at 0, where a twin meets its own recording."""
    return (square + 1e-24).sqrt()


NONE = Nuisances()
"""Only the six values are searched."""


def objective_of(
    twins: Twin | Sequence[Twin],
    measurements: Measurement | Sequence[Measurement],
    bounds: Mapping[str, tuple[float, float]] | float | None = None,
    nuisances: Nuisances = NONE,
) -> Objective:
    """Objective of calibrating one pump on what was measured of it.

    Parameters
    ----------
    twins : the pump's twin, or several that differ in condition only.
    measurements : one for each twin; only lines that the twin has are compared.
    bounds : see `search_space`.
    nuisances : what is searched beside the six values.
    """
    twins = [twins] if isinstance(twins, Twin) else list(twins)
    measurements = [measurements] if isinstance(measurements, Measurement) else list(measurements)
    pairs = zip(twins, measurements, strict=True)
    comparisons = tuple(_comparison(*pair) for pair in pairs)
    space = search_space(twins[0], bounds)
    return Objective(comparisons, space, unknowns_of(twins[0], measurements[0].channels, space, nuisances))


def _comparison(twin: Twin, measurement: Measurement) -> Comparison:
    shaft = twin.condition.shaft_frequency
    limited = replace(twin, bandwidth=(float(measurement.orders[-1]) + 0.5) * shaft, path=None)
    common = np.isin(measurement.orders, limited.orders)
    kept = replace(
        measurement,
        orders=measurement.orders[common],
        amplitude=measurement.amplitude[:, common],
        deviation=measurement.deviation[:, common],
        phasor=None if measurement.phasor is None else measurement.phasor[:, common],
        phasor_deviation=None if measurement.phasor_deviation is None else measurement.phasor_deviation[:, common],
    )
    return Comparison(twin=limited, measurement=kept)
