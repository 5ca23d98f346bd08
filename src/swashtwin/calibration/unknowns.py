"""What a calibration searches: the six interface values, and uncertain constants.

All are one row of *coordinates*: logarithms of what is positive, residues of housing modes as they
are. Each has a
prior: for the six values the width of their bounds, for the others what is known of such machines.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Complex, Float
from torch import Tensor

from swashtwin.foundation import InputError
from swashtwin.physics import Scales, SensorPath, Twin, path_response
from swashtwin.pump import PARAMETER_SYMBOLS, PARAMETERS

DEFAULT_FACTOR = 10.0
"""The search reaches from a tenth of each nominal value to ten times it."""
BOUND_MARGIN = 0.01
"""A coordinate within this share of the bounds' width from a bound lies on it: methods that stay
strictly inside end a little before.
"""


@dataclass(frozen=True, eq=False)
class SearchSpace:
    """Bounds of the six interface values.

    All bounds are positive, and positive values make K and C positive definite: every point within
    is a stable pump.
    """

    nominal: Float[np.ndarray, " 6"]
    """Where the search starts, in the order of `pump.PARAMETERS`."""
    lower: Float[np.ndarray, " 6"]
    """Least values."""
    upper: Float[np.ndarray, " 6"]
    """Greatest values."""

    @property
    def prior_std(self) -> Float[np.ndarray, " 6"]:
        """Standard deviation of ln value where only the bounds are known: that of a uniform density
        of ln value.
        """
        return np.log(self.upper / self.lower) / math.sqrt(12)

    @property
    def log_center(self) -> Float[np.ndarray, " 6"]:
        """Natural logarithm of the geometric middle of the bounds."""
        return np.log(self.upper * self.lower) / 2

    def boundary_loss(self, values: Float[Tensor, "*batch 6"]) -> Float[Tensor, "*batch"]:
        """Mean over the parameters of how far each lies beyond its bounds, relative to the
        bound.
        """
        lower, upper = torch.as_tensor(self.lower), torch.as_tensor(self.upper)
        return (torch.relu(values / upper - 1) + torch.relu(1 - values / lower)).mean(dim=-1)


def build_search_space(
    twin: Twin, bounds: Mapping[str, tuple[float, float]] | float | None = None
) -> SearchSpace:
    """Bounds around the twin's interface values.

    Parameters
    ----------
    bounds : a factor for all, or (least, greatest) by parameter name or letter for some, a factor
        of 10 for the others. An `InputError` where one is unknown, or its bounds do not hold the
        nominal value.
    """
    nominal = twin.values.numpy()
    factor = float(bounds) if isinstance(bounds, int | float) else DEFAULT_FACTOR
    if not (math.isfinite(factor) and factor > 1):
        raise InputError(f"bounds ({factor:g}) must be a factor above 1, such as 10.")
    lower, upper = nominal / factor, nominal * factor
    names = {
        **{name: i for i, name in enumerate(PARAMETERS)},
        **{PARAMETER_SYMBOLS[n]: i for i, n in enumerate(PARAMETERS)},
    }
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


VALUES = slice(len(PARAMETERS))
"""Where the six interface values stand in a vector of unknowns."""
CONSTANTS = slice(len(PARAMETERS), None)
"""Where all that is searched beside them stands."""
SCALES = tuple(item.name for item in fields(Scales))
PATH_BAND = (900.0, 2200.0)
"""Frequencies [Hz] over which the modes of a housing are spread before anything is measured; rigid
below.
"""
PATH_DAMPING = 0.03
"""Damping ratio of a housing's mode before anything is measured."""
REACH = 4.0
"""A constant is searched within so many prior standard deviations."""


@dataclass(frozen=True)
class Nuisances:
    """Constants searched beside the six values, by the standard deviation of their priors; zero
    holds one.

    Those of ``usual`` are of docs/explanation/physics.md, section 6; the others are estimates of
    ours.
    """

    mount: float = 0.0
    """Of the logarithm of the mounting's stiffness."""
    bearing: float = 0.0
    """Of the logarithm of the bearings' stiffness."""
    excitation: float = 0.0
    """Of the logarithm of the factor on a fault's forces."""
    sensor: float = 0.0
    """Of the logarithm of the gain that all channels share."""
    mount_axes: float = 0.0
    """Of the logarithm of the mounting's stiffness along each axis and in tilt, beside `mount`."""
    each_bearing: float = 0.0
    """Of the logarithm of each bearing's stiffness, beside `bearing`."""
    gains: float = 0.0
    """Of the logarithm of each channel's own gain."""
    cross_talk: float = 0.0
    """Of the share that each channel reads of each other one."""
    modes: int = 0
    """Number of modes of the housing between the shell and the sensors (`twin.SensorPath`)."""
    residue: float = 0.1
    """Of each mode's share in each channel."""

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not (math.isfinite(value) and value >= 0):
                raise InputError(
                    f"Nuisances.{item.name} ({value:g}) must be zero or a positive number."
                )
        if self.modes > 6:
            raise InputError(
                f"Nuisances.modes ({self.modes}) must not exceed 6: the lines do not determine more modes."
            )

    @classmethod
    def typical(cls, **changes: Any) -> "Nuisances":
        """Mounting, bearings, excitation and sensors, with the priors of
        docs/explanation/physics.md.
        """
        return cls(**{"mount": 0.3, "bearing": 0.3, "excitation": 0.5, "sensor": 0.05, **changes})

    def of_scale(self, name: str) -> float:
        """Standard deviation of the logarithm of a factor of `Scales`."""
        if name.startswith("mount_"):
            return self.mount_axes
        return self.each_bearing if name.startswith("bearing_") else float(getattr(self, name))

    @classmethod
    def housing(cls, **changes: Any) -> "Nuisances":
        """The usual ones, each channel's gain, and two modes of the housing."""
        return cls.typical(**{"gains": 0.1, "modes": 2, **changes})

    @classmethod
    def by_axis(cls, **changes: Any) -> "Nuisances":
        """Those of `housing`, each direction of the mounting, each bearing, and cross-talk between
        the channels.
        """
        return cls.housing(
            **{"mount_axes": 0.15, "each_bearing": 0.15, "cross_talk": 0.1, **changes}
        )


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Coordinates of a search, the six logarithms of the values first; the others follow from the
    nuisances.
    """

    space: SearchSpace
    """Bounds of the six values."""
    nuisances: Nuisances
    """Widths of the priors of the constants."""
    channels: tuple[str, ...]
    """Channels of the measurement."""
    twin_scales: Float[np.ndarray, " 11"]
    """Logarithms of the twin's scales, used where a scale is not searched."""
    begun: Float[np.ndarray, " unknown"] | None = None
    """Where the search starts instead of at the twin as it is."""

    @cached_property
    def _constants(self) -> list[tuple[str, float, float]]:
        """Name, mean and standard deviation of the prior of each constant."""
        nuisances, channels, (first, last) = self.nuisances, self.channels, np.log(PATH_BAND)
        spread = first + (last - first) * (np.arange(nuisances.modes) + 0.5) / max(
            1, nuisances.modes
        )
        numbers, scales = (
            range(1, nuisances.modes + 1),
            dict(zip(SCALES, self.twin_scales.tolist(), strict=True)),
        )
        rows = [(name, scales[name], nuisances.of_scale(name)) for name in self.scales]
        rows += [(f"gain {name}", 0.0, nuisances.gains) for name in channels if nuisances.gains > 0]
        rows += [
            (f"{channels[b]} in {channels[a]}", 0.0, nuisances.cross_talk)
            for a, b in self.cross_talk
        ]
        rows += [(f"mode {m} frequency", float(spread[m - 1]), 0.25) for m in numbers]
        rows += [(f"mode {m} damping", math.log(PATH_DAMPING), 0.5) for m in numbers]
        return rows + [
            (f"mode {m} in {name}", 0.0, nuisances.residue) for name in channels for m in numbers
        ]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Letter of each value; ``mount``, ``gain cover_z``, ``mode 1 frequency``, ... of the
        others.
        """
        return (*PARAMETER_SYMBOLS.values(), *(name for name, _, _ in self._constants))

    @cached_property
    def start(self) -> Float[np.ndarray, " unknown"]:
        """Where the search starts."""
        if self.begun is not None:
            return self.begun
        return np.concatenate([np.log(self.space.nominal), self.center[CONSTANTS]])

    @cached_property
    def center(self) -> Float[np.ndarray, " unknown"]:
        """Mean of each prior."""
        return np.concatenate([self.space.log_center, [mean for _, mean, _ in self._constants]])

    @cached_property
    def deviation(self) -> Float[np.ndarray, " unknown"]:
        """Standard deviation of each prior."""
        return np.concatenate(
            [self.space.prior_std, [deviation for _, _, deviation in self._constants]]
        )

    @cached_property
    def lower(self) -> Float[np.ndarray, " unknown"]:
        """Least coordinates."""
        return np.concatenate(
            [np.log(self.space.lower), (self.center - REACH * self.deviation)[CONSTANTS]]
        )

    @cached_property
    def upper(self) -> Float[np.ndarray, " unknown"]:
        """Greatest coordinates."""
        return np.concatenate(
            [np.log(self.space.upper), (self.center + REACH * self.deviation)[CONSTANTS]]
        )

    def __len__(self) -> int:
        return len(self.names)

    def index_of_scale(self, name: str) -> int:
        """Where a searched factor of `Scales` stands."""
        return len(PARAMETERS) + self.scales.index(name)

    @cached_property
    def scales(self) -> tuple[str, ...]:
        """Scales that are searched; their coordinates follow the values."""
        return tuple(name for name in SCALES if self.nuisances.of_scale(name) > 0)

    @cached_property
    def cross_talk(self) -> list[tuple[int, int]]:
        """Pairs (channel that reads, channel that it reads of) whose shares are searched; they
        follow the gains.

        Those of fewer channels come first.
        """
        count = len(self.channels) if self.nuisances.cross_talk > 0 else 0
        return [
            pair
            for last in range(count)
            for other in range(last)
            for pair in ((last, other), (other, last))
        ]

    @cached_property
    def first_of_path(self) -> int:
        """Where the gains, if they are searched, and the rest of the sensors' path begin."""
        return len(PARAMETERS) + len(self.scales)

    @cached_property
    def first_of_modes(self) -> int:
        """Where the modes of the housing begin: frequencies, damping ratios, residues."""
        return (
            self.first_of_path
            + len(self.channels) * (self.nuisances.gains > 0)
            + len(self.cross_talk)
        )

    def changed(self, channels: tuple[str, ...] | None = None, **nuisances: Any) -> "Unknowns":
        """The same values with other channels, or other constants searched beside them."""
        return replace(
            self,
            channels=channels or self.channels,
            nuisances=replace(self.nuisances, **nuisances),
            begun=None,
        )

    def scales_of(self, point: Float[Tensor, "*batch unknown"]) -> Float[Tensor, "*batch 11"]:
        """Factors in the order of `Scales` at `point`."""
        columns = []
        for name, twin_value in zip(SCALES, self.twin_scales, strict=True):
            fixed = torch.full(
                point.shape[:-1], float(twin_value), dtype=point.dtype, device=point.device
            )
            columns.append(point[..., self.index_of_scale(name)] if name in self.scales else fixed)
        return torch.stack(columns, dim=-1).exp()

    def response_of(
        self, point: Float[Tensor, "*batch unknown"], frequency: Float[Tensor, " line"]
    ) -> Complex[Tensor, "*batch channel line"] | None:
        """Response between the shell and each channel at `frequency` [Hz]; None where it is not
        searched.
        """
        if not self.nuisances.gains and not self.nuisances.modes:
            return None
        return path_response(frequency, *self._path_of(point))

    def mixing_of(
        self, point: Float[Tensor, "*batch unknown"]
    ) -> Float[Tensor, "*batch channel channel"] | None:
        """What each channel (row) reads of what an ideal one would (column); None where cross-talk
        is not searched.
        """
        if not (pairs := self.cross_talk):
            return None
        count, last = len(self.channels), self.first_of_modes
        rows, columns = zip(*pairs, strict=True)
        shares = point.new_zeros(*point.shape[:-1], count, count)
        shares[..., rows, columns] = point[..., last - len(pairs) : last]
        return shares + torch.eye(count, dtype=point.dtype, device=point.device)

    def _path_of(self, point: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        count, n_modes = len(self.channels), self.nuisances.modes
        ends = np.cumsum([self.first_of_modes, n_modes, n_modes])
        modes, damping = (point[..., a:b].exp() for a, b in pairwise(ends.tolist()))
        gain = point[..., self.first_of_path : self.first_of_path + count].exp()
        if not self.nuisances.gains:
            gain = torch.ones(*point.shape[:-1], count, dtype=point.dtype, device=point.device)
        residue = point[..., int(ends[-1]) :].unflatten(-1, (count, n_modes))
        return gain, modes, damping, residue

    def scales_at(self, point: Float[np.ndarray, " unknown"]) -> Scales:
        """The same as a twin takes them."""
        return Scales(*self.scales_of(torch.as_tensor(point)).tolist())

    def path_at(
        self, point: Float[np.ndarray, " unknown"], sensors: Sequence[str]
    ) -> SensorPath | None:
        """The path as a twin takes it; None where nothing of it is searched.

        Parameters
        ----------
        sensors : those of the pump; one that was not measured is taken as rigid.
        """
        at, row_of = torch.as_tensor(point), {name: row for row, name in enumerate(self.channels)}
        mixing = self.mixing_of(at)
        if not self.nuisances.gains and not self.nuisances.modes and mixing is None:
            return None
        gain, modes, damping, residue = (part.tolist() for part in self._path_of(at))
        shares = [] if mixing is None else (mixing - torch.eye(len(self.channels))).tolist()
        rows = [row_of.get(name) for name in sensors]
        return SensorPath(
            gain=tuple(1.0 if row is None else gain[row] for row in rows),
            frequency=tuple(modes),
            damping_ratio=tuple(damping),
            residue=tuple(
                (0.0,) * len(modes) if row is None else tuple(residue[row]) for row in rows
            ),
            cross_talk=tuple(
                tuple(
                    0.0 if row is None or column is None else shares[row][column] for column in rows
                )
                for row in rows
            )
            if shares
            else (),
        )


def touched(
    point: Float[np.ndarray, " unknown"], unknowns: Unknowns
) -> Bool[np.ndarray, " unknown"]:
    """Whether each coordinate of `point` lies on one of its bounds."""
    near: np.ndarray = np.minimum(point - unknowns.lower, unknowns.upper - point)
    is_near: np.ndarray = near < BOUND_MARGIN * (unknowns.upper - unknowns.lower)
    return is_near


def unstated(bounds: Mapping[str, tuple[float, float]] | float | None) -> tuple[str, ...]:
    """Letters of the values whose bounds nobody stated; see `build_search_space`."""
    if isinstance(bounds, int | float):
        return ()
    return tuple(
        letter
        for name, letter in PARAMETER_SYMBOLS.items()
        if not {name, letter} & set(bounds or ())
    )
