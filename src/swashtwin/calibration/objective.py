"""What a calibration searches, and how far a twin is from the measurement."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from swashtwin.calibration.measurement import Measurement
from swashtwin.errors import InputError
from swashtwin.integrators import SteadySolver
from swashtwin.pump import LETTERS, PARAMETERS
from swashtwin.twin import Twin

DEFAULT_FACTOR = 10.0
"""The search reaches from a tenth of each nominal value to ten times it."""

MODEL_ERROR = 0.05
"""Relative error of every simulated line that even the right values leave; our estimate, as in docs/physics.md."""
FLOOR = 0.02
"""Least standard deviation of a line [m/s^2], from both sides together; as in docs/physics.md."""


@dataclass(frozen=True, eq=False)
class SearchSpace:
    """Bounds of the six interface values.

    All bounds are positive, and positive values make K and C positive definite: every point within is a stable pump.
    """

    nominal: Float[np.ndarray, " 6"]
    """Where the search starts, in the order of `pump.PARAMETERS`."""
    lower: Float[np.ndarray, " 6"]
    """Least values."""
    upper: Float[np.ndarray, " 6"]
    """Greatest values."""

    @property
    def prior_std(self) -> Float[np.ndarray, " 6"]:
        """Standard deviation of ln value where only the bounds are known: that of a uniform density of ln value."""
        return np.log(self.upper / self.lower) / math.sqrt(12)

    @property
    def log_center(self) -> Float[np.ndarray, " 6"]:
        """Natural logarithm of the geometric middle of the bounds."""
        return np.log(self.upper * self.lower) / 2

    def boundary_loss(self, values: Float[Tensor, "*batch 6"]) -> Float[Tensor, "*batch"]:
        """Mean over the parameters of how far each lies beyond its bounds, relative to the bound."""
        lower, upper = torch.as_tensor(self.lower), torch.as_tensor(self.upper)
        return (torch.relu(values / upper - 1) + torch.relu(1 - values / lower)).mean(dim=-1)


def search_space(twin: Twin, bounds: Mapping[str, tuple[float, float]] | float | None = None) -> SearchSpace:
    """Bounds around the twin's interface values.

    Parameters
    ----------
    bounds : a factor for all, or (least, greatest) by parameter name or letter for some, a factor of 10 for the others.

    Raises
    ------
    InputError
        An unknown parameter, or bounds that do not hold the nominal value.

    Examples
    --------
    ``search_space(twin, {"C_sw": (5e5, 5e6)})``
    """
    nominal = twin.values.numpy()
    factor = float(bounds) if isinstance(bounds, int | float) else DEFAULT_FACTOR
    if not (math.isfinite(factor) and factor > 1):
        raise InputError(f"bounds ({factor:g}) must be a factor above 1, such as 10.")
    lower, upper = nominal / factor, nominal * factor
    names = {**{name: i for i, name in enumerate(PARAMETERS)}, **{LETTERS[n]: i for i, n in enumerate(PARAMETERS)}}
    for name, (least, greatest) in bounds.items() if isinstance(bounds, Mapping) else ():
        if name not in names:
            raise InputError(f"bounds name {name!r}, which is none of {', '.join(names)}.")
        index = names[name]
        if not 0 < least <= nominal[index] <= greatest or least == greatest:
            raise InputError(
                f"bounds of {name} ({least:g}, {greatest:g}) must be positive and hold the nominal value "
                f"{nominal[index]:g}."
            )
        lower[index], upper[index] = least, greatest
    return SearchSpace(nominal=nominal, lower=lower, upper=upper)


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
        self,
        values: Float[Tensor, "*batch 6"],
        *,
        scales: Float[Tensor, "*batch 4"] | None = None,
        solver: SteadySolver | None = None,
    ) -> Float[Tensor, "*batch channel order"]:
        """Simulated amplitudes [m/s^2], differentiable with respect to `values` and `scales`."""
        lines = self.twin.acceleration(values, scales=scales, solver=solver)
        return lines.index_select(-2, self._rows).index_select(-1, self._columns).abs()


@dataclass(frozen=True, eq=False)
class Objective:
    """Distance between a twin and what was measured of it at one or several conditions.

    All comparisons share the six values and the scales: so a pump measured at three pressures is calibrated once.
    Amplitudes of all comparisons, channels and orders stand in one row of *readings*.
    """

    comparisons: tuple[Comparison, ...]
    """One for each condition."""
    space: SearchSpace
    """Within which values."""

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

    def amplitude(
        self,
        values: Float[Tensor, "*batch 6"],
        *,
        scales: Float[Tensor, "*batch 4"] | None = None,
        solver: SteadySolver | None = None,
    ) -> Float[Tensor, "*batch reading"]:
        """Simulated amplitudes [m/s^2], differentiable with respect to `values` and `scales`."""
        parts = [one.amplitude(values, scales=scales, solver=solver) for one in self.comparisons]
        return torch.cat([part.flatten(-2) for part in parts], dim=-1)

    def spectrum_loss(
        self, values: Float[Tensor, "*batch 6"], *, solver: SteadySolver | None = None
    ) -> Float[Tensor, "*batch"]:
        """RMSE between simulated and measured amplitudes over the RMS of the measured ones (the paper's L_freq).

        With several conditions, the root of the mean of their squares, so that none counts more for being louder.
        """
        squares = [
            (one.amplitude(values, solver=solver) - one.measured).square().mean(dim=(-2, -1))
            / one.measured.square().mean()
            for one in self.comparisons
        ]
        return _root(torch.stack(squares).mean(dim=0))

    def weighted_loss(
        self, values: Float[Tensor, "*batch 6"], *, solver: SteadySolver | None = None
    ) -> Float[Tensor, "*batch"]:
        """RMS of the differences over `sigma`: 1 where they are as large as expected."""
        difference = (self.amplitude(values, solver=solver) - self.measured) / self.sigma
        return _root(difference.square().mean(dim=-1))

    def sensitivity(
        self,
        log_values: Float[Tensor, " 6"],
        log_scales: Float[Tensor, " 4"],
        free: tuple[int, ...],
        *,
        solver: SteadySolver | None = None,
    ) -> tuple[Float[Tensor, " reading"], Float[Tensor, "reading free"]]:
        """Amplitudes [m/s^2], and their exact derivatives with respect to logarithms.

        Parameters
        ----------
        free : which logarithms: 0...5 are the values, 6...9 the scales.
        """
        point = torch.cat([log_values, log_scales]).detach()
        directions = torch.eye(10, dtype=point.dtype)[list(free)]
        logs = point.repeat(len(free), 1).requires_grad_()
        amplitude = self.amplitude(logs[:, :6].exp(), scales=logs[:, 6:].exp(), solver=solver)
        # Backward is linear in the weights it is given: its derivative along a direction, with respect to them, is the
        # forward derivative along that direction. One batch holds all directions.
        weights = torch.zeros_like(amplitude, requires_grad=True)
        (backward,) = torch.autograd.grad(amplitude, logs, weights, create_graph=True)
        (slope,) = torch.autograd.grad((backward * directions).sum(), weights)
        return amplitude[0].detach(), slope.movedim(0, -1)


def _root(square: Tensor) -> Tensor:
    """Square root whose derivative stays finite at 0, where a twin meets its own recording."""
    return (square + 1e-24).sqrt()


def objective_of(
    twins: Twin | Sequence[Twin],
    measurements: Measurement | Sequence[Measurement],
    bounds: Mapping[str, tuple[float, float]] | float | None = None,
) -> Objective:
    """Objective of calibrating one pump on what was measured of it.

    Parameters
    ----------
    twins : the pump's twin, or several that differ in condition only.
    measurements : one for each twin; only lines that the twin has are compared.
    bounds : see `search_space`.
    """
    twins = [twins] if isinstance(twins, Twin) else list(twins)
    measurements = [measurements] if isinstance(measurements, Measurement) else list(measurements)
    pairs = zip(twins, measurements, strict=True)
    return Objective(tuple(_comparison(*pair) for pair in pairs), search_space(twins[0], bounds))


def _comparison(twin: Twin, measurement: Measurement) -> Comparison:
    shaft = twin.condition.shaft_frequency
    limited = replace(twin, bandwidth=(float(measurement.orders[-1]) + 0.5) * shaft)
    common = np.isin(measurement.orders, limited.orders)
    kept = replace(
        measurement,
        orders=measurement.orders[common],
        amplitude=measurement.amplitude[:, common],
        deviation=measurement.deviation[:, common],
    )
    return Comparison(twin=limited, measurement=kept)
