"""How far a twin is from the measurement, and how that changes with what is searched."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from swashtwin.calibration.measurement import Measurement
from swashtwin.calibration.space import SearchSpace, search_space
from swashtwin.calibration.unknowns import Nuisances, Unknowns, unknowns_of
from swashtwin.integrators import SteadySolver
from swashtwin.twin import Twin

MODEL_ERROR = 0.05
"""Relative error of every simulated line that even the right values leave; our estimate, as in docs/physics.md."""
FLOOR = 0.02
"""Least standard deviation of a line [m/s^2], from both sides together; as in docs/physics.md."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """One twin beside one measurement at its condition, line by line: phases are dropped, as in the paper."""

    twin: Twin
    """The twin, computed up to the end of the measurement's band."""
    measurement: Measurement
    """What it shall come near to."""

    @cached_property
    def _rows(self) -> Tensor:
        return torch.tensor([self.twin.pump.channels.index(name) for name in self.measurement.channels])

    @cached_property
    def _columns(self) -> Tensor:
        return torch.as_tensor(np.flatnonzero(np.isin(self.twin.orders, self.measurement.orders)))

    @cached_property
    def _frequency(self) -> Tensor:
        return torch.as_tensor(self.measurement.orders * self.twin.condition.shaft_frequency)

    @cached_property
    def measured(self) -> Float[Tensor, "channel order"]:
        """Measured amplitudes [m/s^2]."""
        return torch.as_tensor(self.measurement.amplitude)

    @cached_property
    def sigma(self) -> Float[Tensor, "channel order"]:
        """Standard deviation of measured minus simulated amplitude [m/s^2].

        From the measurement's scatter, 5 % of the amplitude for what rigid bodies cannot model, and a floor of
        0.02 m/s^2. A line of little amplitude then counts little, which it would not on a decibel scale.
        """
        variance = self.measurement.deviation**2 + (MODEL_ERROR * self.measurement.amplitude) ** 2 + FLOOR**2
        return torch.as_tensor(np.sqrt(variance))

    def amplitude(
        self, unknowns: Unknowns, point: Float[Tensor, "*batch unknown"], *, solver: SteadySolver | None = None
    ) -> Float[Tensor, "*batch channel order"]:
        """Simulated amplitudes [m/s^2] at `point`, differentiable."""
        lines = self.twin.acceleration(unknowns.values_of(point), scales=unknowns.scales_of(point), solver=solver)
        lines = lines.index_select(-2, self._rows).index_select(-1, self._columns)
        path = unknowns.response_of(point, self._frequency)
        return (lines if path is None else lines * path).abs()

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

    @cached_property
    def measured(self) -> Float[Tensor, " reading"]:
        """Measured amplitudes [m/s^2]."""
        return torch.cat([one.measured.reshape(-1) for one in self.comparisons])

    @cached_property
    def sigma(self) -> Float[Tensor, " reading"]:
        """Standard deviation of measured minus simulated amplitude [m/s^2]; see `Comparison.sigma`."""
        return torch.cat([one.sigma.reshape(-1) for one in self.comparisons])

    def fingerprint(self) -> str:
        """SHA-256 of all that a search is told: twins, recordings, lines, bounds and priors; hexadecimal."""
        digest = hashlib.sha256(repr((self.unknowns.names, [one.twin for one in self.comparisons])).encode())
        for one in self.comparisons:
            digest.update(repr([recording.fingerprint() for recording in one.measurement.recordings]).encode())
            digest.update(np.ascontiguousarray(one.measurement.orders).tobytes())
        arrays = (self.measured.numpy(), self.sigma.numpy(), *vars(self.space).values())
        for array in (*arrays, self.unknowns.center, self.unknowns.deviation, self.unknowns.start):
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()

    @cached_property
    def start(self) -> Float[Tensor, " unknown"]:
        """The point of the nominal twin."""
        return torch.as_tensor(self.unknowns.start)

    def point_of(self, values: Float[Tensor, "*batch 6"]) -> Float[Tensor, "*batch unknown"]:
        """Point of the six `values`, all else being as the twin has it."""
        rest = self.start[6:].expand(*values.shape[:-1], -1)
        return torch.cat([values.log(), rest], dim=-1)

    def amplitude(
        self, point: Float[Tensor, "*batch unknown"], *, solver: SteadySolver | None = None
    ) -> Float[Tensor, "*batch reading"]:
        """Simulated amplitudes [m/s^2], differentiable."""
        parts = [one.amplitude(self.unknowns, point, solver=solver) for one in self.comparisons]
        return torch.cat([part.flatten(-2) for part in parts], dim=-1)

    def spectrum_loss(
        self, point: Float[Tensor, "*batch unknown"], *, solver: SteadySolver | None = None
    ) -> Float[Tensor, "*batch"]:
        """RMSE between simulated and measured amplitudes over the RMS of the measured ones (the paper's L_freq).

        With several conditions, the root of the mean of their squares, so that none counts more for being louder.
        """
        squares = [
            (one.amplitude(self.unknowns, point, solver=solver) - one.measured).square().mean(dim=(-2, -1))
            / one.measured.square().mean()
            for one in self.comparisons
        ]
        return _root(torch.stack(squares).mean(dim=0))

    def weighted_loss(
        self, point: Float[Tensor, "*batch unknown"], *, solver: SteadySolver | None = None
    ) -> Float[Tensor, "*batch"]:
        """RMS of the differences over `sigma`: 1 where they are as large as expected."""
        difference = (self.amplitude(point, solver=solver) - self.measured) / self.sigma
        return _root(difference.square().mean(dim=-1))

    def prior_loss(self, point: Float[Tensor, "*batch unknown"]) -> Float[Tensor, "*batch"]:
        """Sum of squares of how far each coordinate is from the mean of its prior, in standard deviations."""
        center, deviation = torch.as_tensor(self.unknowns.center), torch.as_tensor(self.unknowns.deviation)
        return ((point - center) / deviation).square().sum(dim=-1)

    def sensitivity(
        self, point: Float[Tensor, " unknown"], *, solver: SteadySolver | None = None
    ) -> tuple[Float[Tensor, " reading"], Float[Tensor, "reading unknown"]]:
        """Amplitudes [m/s^2] at `point`, and their exact derivatives with respect to its coordinates."""
        directions = torch.eye(len(point), dtype=point.dtype)
        points = point.detach().repeat(len(point), 1).requires_grad_()
        amplitude = self.amplitude(points, solver=solver)
        # Backward is linear in the weights it is given: its derivative along a direction, with respect to them, is the
        # forward derivative along that direction. One batch holds all directions.
        weights = torch.zeros_like(amplitude, requires_grad=True)
        (backward,) = torch.autograd.grad(amplitude, points, weights, create_graph=True)
        (slope,) = torch.autograd.grad((backward * directions).sum(), weights)
        return amplitude[0].detach(), slope.T


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
    )
    return Comparison(twin=limited, measurement=kept)
