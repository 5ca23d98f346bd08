"""How far a twin is from the measurement, and how that changes with what is searched."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
import torch
from jaxtyping import Complex, Float
from torch import Tensor

from swashtwin.calibration.measurement import Measurement, turn_lines
from swashtwin.calibration.unknowns import VALUES, Nuisances, Unknowns, build_search_space
from swashtwin.physics import SteadySolver, Twin

Points: TypeAlias = Float[Tensor, "*batch unknown"]

MODEL_ERROR = 0.05
"""Relative error of every simulated line that even the right values leave; our estimate, as in
docs/explanation/physics.md."""
FLOOR = 0.02
"""Least standard deviation of a line [m/s^2], from both sides together; as in
docs/explanation/physics.md.
"""


@dataclass(frozen=True, eq=False)
class Comparison:
    """One twin beside one measurement at its condition, line by line.

    The *observables* are compared: the lines' amplitudes, as in the paper, or, of a measurement
    with phases, the real and then the imaginary parts of its lines, after the twin was turned to
    the shaft position at which it fits best.
    """

    twin: Twin
    """The twin, computed up to the end of the measurement's band."""
    measurement: Measurement
    """The measurement."""
    floor: Float[np.ndarray, "channel order"] | float = FLOOR
    """Least standard deviation of a line [m/s^2]."""
    searched: tuple[str, ...] = ()
    """Channels that the search's gains, cross-talk and residues belong to, in their order, where
    other recordings of it have more than this measurement; empty is the measurement's own.
    """

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels of the search, in its order."""
        return self.searched or self.measurement.channels

    @cached_property
    def _rows(self) -> Tensor:
        return torch.tensor([self.twin.pump.channels.index(name) for name in self.channels])

    @cached_property
    def _measured_rows(self) -> Tensor | None:
        """Indices of the measured channels among those of the search; None where all are
        measured.
        """
        if self.channels == self.measurement.channels:
            return None
        return torch.tensor([self.channels.index(name) for name in self.measurement.channels])

    @cached_property
    def _columns(self) -> Tensor:
        return torch.as_tensor(np.flatnonzero(np.isin(self.twin.orders, self.measurement.orders)))

    @cached_property
    def _orders(self) -> Tensor:
        return torch.as_tensor(self.measurement.orders)

    @cached_property
    def _indices(self) -> Tensor | None:
        """Indices of the twin's lines among those measured; None where it has all of them."""
        indices = np.flatnonzero(np.isin(self.measurement.orders, self.twin.orders))
        return None if len(indices) == len(self.measurement.orders) else torch.as_tensor(indices)

    @cached_property
    def _frequency(self) -> Tensor:
        return self._orders * self.twin.condition.shaft_frequency

    @property
    def has_phases(self) -> bool:
        """Whether phases are compared too."""
        return self.measurement.phasor is not None

    @cached_property
    def measured(self) -> Float[Tensor, "channel observable"]:
        """Measured observables [m/s^2]."""
        if self.measurement.phasor is None:
            return torch.as_tensor(self.measurement.amplitude)
        return _parts(torch.as_tensor(self.measurement.phasor))

    @cached_property
    def sigma(self) -> Float[Tensor, "channel observable"]:
        """Standard deviation of measured minus simulated observable [m/s^2].

        From the measurement's scatter, 5 % of the amplitude for what rigid bodies cannot model, and
        `floor`, by default 0.02 m/s^2. A line of little amplitude then counts little, which it
        would not on a decibel scale.
        """
        measurement = self.measurement
        amplitude, deviation, parts = measurement.amplitude, measurement.deviation, 1
        if measurement.phasor is not None and measurement.phasor_deviation is not None:
            amplitude, deviation, parts = (
                np.abs(measurement.phasor),
                measurement.phasor_deviation,
                2,
            )
        variance = deviation**2 + (MODEL_ERROR * amplitude) ** 2 + self.floor**2
        return torch.as_tensor(np.sqrt(variance)).repeat(1, parts)

    @property
    def deviation(self) -> Float[np.ndarray, " observable"]:
        """Standard deviation of each observable from the measurement alone [m/s^2]."""
        measurement = self.measurement
        if measurement.phasor_deviation is None:
            return measurement.deviation.reshape(-1)
        return np.tile(measurement.phasor_deviation, 2).reshape(-1)

    def lines(
        self, unknowns: Unknowns, point: Points, solver: SteadySolver | None = None
    ) -> Complex[Tensor, "*batch channel order"]:
        """Simulated lines [m/s^2] at `point`, differentiable, at the twin's own shaft position."""
        lines = self.twin.acceleration(
            point[..., VALUES].exp(), scales=unknowns.scales_of(point), solver=solver
        )
        lines = lines.index_select(-2, self._rows).index_select(-1, self._columns)
        if self._indices is not None:
            silent = lines.new_zeros(*lines.shape[:-1], len(self.measurement.orders))
            lines = silent.index_copy(-1, self._indices, lines)
        mixing = unknowns.mixing_of(point)
        if mixing is not None:
            lines = mixing.to(lines.dtype) @ lines
        path = unknowns.response_of(point, self._frequency)
        if path is not None:
            lines = lines * path
        return lines if self._measured_rows is None else lines.index_select(-2, self._measured_rows)

    def observables(
        self, unknowns: Unknowns, point: Points, solver: SteadySolver | None = None
    ) -> Float[Tensor, "*batch channel observable"]:
        """Simulated observables [m/s^2] at `point`, differentiable."""
        lines = self.lines(unknowns, point, solver)
        if self.measurement.phasor is None:
            return lines.abs()
        weight = self.sigma[:, : len(self._orders)] ** -2
        return _parts(
            turn_lines(lines, torch.as_tensor(self.measurement.phasor), weight, self._orders)
        )

    def amplitude_of(self, twin: Twin) -> Float[np.ndarray, "channel order"]:
        """Amplitudes [m/s^2] of `twin` with its own values where this comparison has lines; 0 where
        it is silent.
        """
        limited = replace(twin, bandwidth=self.twin.bandwidth)
        with torch.no_grad():
            lines = limited.acceleration().index_select(-2, self._rows)
            lines = (
                lines
                if self._measured_rows is None
                else lines.index_select(-2, self._measured_rows)
            )
        orders = self.measurement.orders
        amplitude = np.zeros((len(lines), len(orders)))
        amplitude[:, np.isin(orders, limited.orders)] = (
            lines[:, np.isin(limited.orders, orders)].abs().numpy()
        )
        return amplitude


@dataclass(frozen=True, eq=False)
class Objective:
    """Distance between a twin and what was measured of it at one or several conditions.

    All comparisons share what is searched, one *point* of `unknowns`: so a pump measured at three
    pressures is calibrated once. Amplitudes of all comparisons, channels and orders stand in one
    row of *observables*.
    """

    comparisons: tuple[Comparison, ...]
    """One for each condition."""
    unknowns: Unknowns
    """What is searched."""

    @property
    def twin(self) -> Twin:
        """The first condition's twin; the others differ from it in condition only."""
        return self.comparisons[0].twin

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels of all comparisons, in the order of the unknowns."""
        return self.comparisons[0].channels

    @property
    def has_phases(self) -> bool:
        """Whether phases are compared too."""
        return self.comparisons[0].has_phases

    @property
    def frequency(self) -> Float[np.ndarray, " observable"]:
        """Frequency of each observable [Hz]."""
        lines = [
            (item.measurement.orders * item.twin.condition.shaft_frequency, item)
            for item in self.comparisons
        ]
        return np.concatenate(
            [np.tile(row, item.measured.numel() // len(row)) for row, item in lines]
        )

    @cached_property
    def measured(self) -> Float[Tensor, " observable"]:
        """Measured observables [m/s^2]; see `Comparison`."""
        return torch.cat([comparison.measured.reshape(-1) for comparison in self.comparisons])

    @cached_property
    def sigma(self) -> Float[Tensor, " observable"]:
        """Standard deviation of measured minus simulated observable [m/s^2]; see
        `Comparison.sigma`.
        """
        return torch.cat([comparison.sigma.reshape(-1) for comparison in self.comparisons])

    @cached_property
    def start(self) -> Float[Tensor, " unknown"]:
        """The point of the nominal twin."""
        return torch.as_tensor(self.unknowns.start)

    def observables(
        self, point: Points, solver: SteadySolver | None = None
    ) -> Float[Tensor, "*batch observable"]:
        """Simulated observables [m/s^2], differentiable."""
        parts = [
            comparison.observables(self.unknowns, point, solver) for comparison in self.comparisons
        ]
        return torch.cat([part.flatten(-2) for part in parts], dim=-1)

    def spectrum_loss(
        self, point: Points, solver: SteadySolver | None = None
    ) -> Float[Tensor, "*batch"]:
        """RMSE between simulated and measured observables over the RMS of the measured ones (the
        paper's L_freq).

        With several conditions, the root of the mean of their squares, so that none counts more for
        being louder.
        """
        squares = []
        for comparison in self.comparisons:
            difference = comparison.observables(self.unknowns, point, solver) - comparison.measured
            squares.append(
                difference.square().mean(dim=(-2, -1)) / comparison.measured.square().mean()
            )
        return _root(torch.stack(squares).mean(dim=0))

    def weighted_loss(
        self, point: Points, solver: SteadySolver | None = None
    ) -> Float[Tensor, "*batch"]:
        """RMS of the differences over `sigma`: 1 where they are as large as expected."""
        difference = (self.observables(point, solver) - self.measured) / self.sigma
        return _root(difference.square().mean(dim=-1))

    def sensitivity(
        self, point: Float[Tensor, " unknown"], solver: SteadySolver | None = None
    ) -> tuple[Float[Tensor, " observable"], Float[Tensor, "observable unknown"]]:
        """Observables [m/s^2] at `point`, and their exact derivatives with respect to its
        coordinates.
        """
        directions = torch.eye(len(point), dtype=point.dtype)
        points = point.detach().repeat(len(point), 1).requires_grad_()
        observables = self.observables(points, solver)
        # Backward is linear in the weights it is given: its derivative along a direction, with
        # respect to them, is the forward derivative along that direction. One batch holds all
        # directions.
        weights = torch.zeros_like(observables, requires_grad=True)
        (backward,) = torch.autograd.grad(observables, points, weights, create_graph=True)
        (slope,) = torch.autograd.grad((backward * directions).sum(), weights)
        return observables[0].detach(), slope.T


def _parts(lines: Complex[Tensor, "*batch order"]) -> Float[Tensor, "*batch observable"]:
    """Real parts, then imaginary parts."""
    return torch.cat([lines.real, lines.imag], dim=-1)


def _root(square: Tensor) -> Tensor:
    """Square root whose derivative stays finite at 0, where a twin meets its own recording."""
    return (square + 1e-24).sqrt()


NONE = Nuisances()
"""Only the six values are searched."""


def build_objective(
    twins: Twin | Sequence[Twin],
    measurements: Measurement | Sequence[Measurement],
    bounds: Mapping[str, tuple[float, float]] | float | None = None,
    nuisances: Nuisances = NONE,
) -> Objective:
    """Objective of calibrating one pump on what was measured of it.

    Parameters
    ----------
    twins : the pump's twin, or several that differ in condition only.
    measurements : one for each twin; only lines that the twin has are compared. Their channels may
        differ.
    bounds : see `build_search_space`.
    nuisances : what is searched beside the six values.
    """
    twins = [twins] if isinstance(twins, Twin) else list(twins)
    measurements = [measurements] if isinstance(measurements, Measurement) else list(measurements)
    channels = tuple(
        dict.fromkeys(name for measurement in measurements for name in measurement.channels)
    )
    pairs = zip(twins, measurements, strict=True)
    comparisons = tuple(build_comparison(*pair, channels) for pair in pairs)
    scales = np.log(twins[0].scales.values())
    return Objective(
        comparisons, Unknowns(build_search_space(twins[0], bounds), nuisances, channels, scales)
    )


def build_comparison(
    twin: Twin, measurement: Measurement, channels: tuple[str, ...] = ()
) -> Comparison:
    """Comparison within the band that was measured, of the lines that the twin has, or of all of a
    ``"spectrum"``.
    """
    shaft = twin.condition.shaft_frequency
    limited = replace(twin, bandwidth=(float(measurement.orders[-1]) + 0.5) * shaft, path=None)
    common = np.isin(measurement.orders, limited.orders) | (measurement.lines == "spectrum")
    names = ("amplitude", "deviation", "phasor", "phasor_deviation")
    rows = {
        name: row[:, common] for name in names if (row := getattr(measurement, name)) is not None
    }
    compared = replace(measurement, orders=measurement.orders[common], **rows)
    return Comparison(twin=limited, measurement=compared, searched=channels)
