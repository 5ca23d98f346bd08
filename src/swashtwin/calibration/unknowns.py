"""What a calibration searches: the six interface values, and uncertain constants.

All of them form one vector of *coordinates*: logarithms of positive quantities, and the residues of
housing modes themselves. Each coordinate has a prior: for the six values the width of their bounds,
for the constants what is known of such machines.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import chain, pairwise, product
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Complex, Float
from torch import Tensor

from swashtwin.foundation import InputError
from swashtwin.physics import (
    PORT_ANGLES,
    PORT_TOLERANCE,
    PortTiming,
    Scales,
    SensorPath,
    Twin,
    path_response,
)
from swashtwin.pump import PARAMETER_SYMBOLS, PARAMETERS

DEFAULT_BOUND_FACTOR = 10.0
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
    """Values at which the search starts, in the order of `pump.PARAMETERS`."""
    lower: Float[np.ndarray, " 6"]
    """Lower bounds."""
    upper: Float[np.ndarray, " 6"]
    """Upper bounds."""

    @property
    def prior_std(self) -> Float[np.ndarray, " 6"]:
        """Standard deviation of ln value if only the bounds are known: that of a uniform density
        of ln value.
        """
        return np.log(self.upper / self.lower) / math.sqrt(12)

    @property
    def log_center(self) -> Float[np.ndarray, " 6"]:
        """Natural logarithm of the geometric middle of the bounds."""
        return np.log(self.upper * self.lower) / 2

    def boundary_loss(self, values: Float[Tensor, "*batch 6"]) -> Float[Tensor, "*batch"]:
        """Return the mean distance of the values beyond their bounds, relative to the bound."""
        lower = torch.as_tensor(self.lower)
        upper = torch.as_tensor(self.upper)
        return (torch.relu(values / upper - 1) + torch.relu(1 - values / lower)).mean(dim=-1)


def build_search_space(
    twin: Twin, bounds: Mapping[str, tuple[float, float]] | float | None = None
) -> SearchSpace:
    """Return the bounds around the twin's interface values.

    Parameters
    ----------
    bounds : a factor for all values, or (lower, upper) by parameter name or symbol for some of
        them; the others get a factor of 10.

    Raises
    ------
    InputError
        A parameter is unknown, or its bounds do not hold the nominal value.
    """
    factor = DEFAULT_BOUND_FACTOR
    if isinstance(bounds, int | float):
        factor = float(bounds)
    if not (math.isfinite(factor) and factor > 1):
        raise InputError(f"bounds ({factor:g}) must be a factor above 1, such as 10.")

    nominal = twin.values.numpy()
    lower = nominal / factor
    upper = nominal * factor

    if isinstance(bounds, Mapping):
        indices = {name: index for index, name in enumerate(PARAMETERS)}
        indices |= {PARAMETER_SYMBOLS[name]: index for index, name in enumerate(PARAMETERS)}
        for name, (low, high) in bounds.items():
            if name not in indices:
                raise InputError(
                    f"{name!r} in bounds is not an interface value: use {', '.join(indices)}."
                )
            index = indices[name]
            if not 0 < low <= nominal[index] <= high or low == high:
                raise InputError(
                    f"bounds of {name} ({low:g}, {high:g}) must be positive and contain the "
                    f"nominal value {nominal[index]:g}."
                )
            lower[index] = low
            upper[index] = high

    return SearchSpace(nominal=nominal, lower=lower, upper=upper)


VALUE_SLICE = slice(len(PARAMETERS))
"""Coordinates that are the logarithms of the six interface values."""
CONSTANT_SLICE = slice(len(PARAMETERS), None)
"""Coordinates of all constants that are searched with them."""
SCALE_NAMES = tuple(scale.name for scale in fields(Scales))
HOUSING_MODE_BAND = (900.0, 2200.0)
"""Frequencies [Hz] over which the modes of a housing are spread before anything is measured; below
it the housing counts as rigid.
"""
HOUSING_MODE_DAMPING = 0.03
"""Damping ratio of a housing's mode before anything is measured."""
CONSTANT_BOUND_STDS = 4.0
"""Bounds of a constant, in standard deviations of its prior."""
MAX_HOUSING_MODES = 6
VALUE_START_STD = 0.7
"""Standard deviation of ln value of further starts of a search about the nominal values: the size
of their errors in the field.
"""


@dataclass(frozen=True)
class Nuisances:
    """Standard deviations of the priors of the constants that are searched with the six values.

    Zero holds a constant at its value. The priors of `typical` are those of
    docs/explanation/physics.md, section 6; the others are estimates of ours.
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
    """Of the logarithm of the mounting's stiffness along each axis and in tilt, on top of
    `mount`.
    """
    each_bearing: float = 0.0
    """Of the logarithm of each bearing's stiffness, on top of `bearing`."""
    gains: float = 0.0
    """Of the logarithm of the gain of each channel."""
    cross_talk: float = 0.0
    """Of the share that each channel reads of each other channel."""
    modes: int = 0
    """Number of modes of the housing between the shell and the sensors (`twin.SensorPath`)."""
    residue: float = 0.1
    """Of each mode's share in each channel."""
    port_timing: float = 0.0
    """Of the angle at which each port opens [rad], relative to the pump file."""

    def __post_init__(self) -> None:
        for nuisance in fields(self):
            value = getattr(self, nuisance.name)
            if not (math.isfinite(value) and value >= 0):
                raise InputError(
                    f"Nuisances.{nuisance.name} ({value:g}) must be zero or a positive number."
                )
        if self.modes > MAX_HOUSING_MODES:
            raise InputError(
                f"Nuisances.modes ({self.modes}) must not exceed {MAX_HOUSING_MODES}: the lines do "
                "not determine more modes."
            )

    @classmethod
    def typical(cls, **changes: Any) -> "Nuisances":
        """Return the priors of docs/explanation/physics.md: mounting, bearings, excitation,
        sensors.
        """
        return cls(**{"mount": 0.3, "bearing": 0.3, "excitation": 0.5, "sensor": 0.05, **changes})

    @classmethod
    def housing(cls, **changes: Any) -> "Nuisances":
        """Return the typical nuisances, with a gain of each channel and two modes of the
        housing.
        """
        return cls.typical(**{"gains": 0.1, "modes": 2, **changes})

    @classmethod
    def by_axis(cls, **changes: Any) -> "Nuisances":
        """Return those of `housing` with each direction of the mounting, each bearing, cross-talk
        between the channels, and the angles at which the ports open.

        The stiffness along a direction, and that of a bearing, is then known to a factor e^0.5
        (0.4 for all and 0.3 for each): drawings are wrong by that in the field. Recordings that
        determine a support narrow it; otherwise its prior widens the intervals of the values.
        """
        return cls.housing(
            **{
                "mount": 0.4,
                "bearing": 0.4,
                "mount_axes": 0.3,
                "each_bearing": 0.3,
                "cross_talk": 0.1,
                "port_timing": PORT_TOLERANCE,
                **changes,
            }
        )

    def scale_deviation(self, name: str) -> float:
        """Return the standard deviation of the logarithm of a factor of `Scales`."""
        if name.startswith("mount_"):
            return self.mount_axes
        if name.startswith("bearing_"):
            return self.each_bearing
        return float(getattr(self, name))


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Coordinates of a search: the six logarithms of the values, then the constants that the
    nuisances free.
    """

    space: SearchSpace
    """Bounds of the six values."""
    nuisances: Nuisances
    """Widths of the priors of the constants."""
    channels: tuple[str, ...]
    """Channels of the measurement."""
    twin_scales: Float[np.ndarray, " 11"]
    """Logarithms of the twin's scales, used for each scale that is not searched."""
    initial_point: Float[np.ndarray, " unknown"] | None = None
    """Point at which the search starts; `None` starts it at the nominal twin."""

    @cached_property
    def _constants(self) -> list[tuple[str, float, float]]:
        """Name, mean and standard deviation of the prior of each constant."""
        nuisances = self.nuisances
        channels = self.channels
        modes = range(1, nuisances.modes + 1)

        # the modes' prior means divide the band evenly on a logarithmic scale
        log_low, log_high = np.log(HOUSING_MODE_BAND)
        positions = (np.arange(nuisances.modes) + 0.5) / max(1, nuisances.modes)
        log_frequencies = log_low + (log_high - log_low) * positions

        twin_scales = dict(zip(SCALE_NAMES, self.twin_scales.tolist(), strict=True))
        rows = [(name, twin_scales[name], nuisances.scale_deviation(name)) for name in self.scales]
        rows += [(name, 0.0, nuisances.port_timing) for name in self.port_angles]
        if nuisances.gains > 0:
            rows += [(f"gain {name}", 0.0, nuisances.gains) for name in channels]
        rows += [
            (f"{channels[source]} in {channels[reader]}", 0.0, nuisances.cross_talk)
            for reader, source in self.cross_talk
        ]
        rows += [(f"mode {m} frequency", float(log_frequencies[m - 1]), 0.25) for m in modes]
        rows += [(f"mode {m} damping", math.log(HOUSING_MODE_DAMPING), 0.5) for m in modes]
        for channel in channels:
            rows += [(f"mode {m} in {channel}", 0.0, nuisances.residue) for m in modes]
        return rows

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Symbol of each value; ``mount``, ``gain cover_z``, ``mode 1 frequency``, ... of the
        constants.
        """
        return (*PARAMETER_SYMBOLS.values(), *(name for name, _, _ in self._constants))

    @cached_property
    def start(self) -> Float[np.ndarray, " unknown"]:
        """Point at which the search starts."""
        if self.initial_point is not None:
            return self.initial_point
        return np.concatenate([np.log(self.space.nominal), self.center[CONSTANT_SLICE]])

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
        """Lower bounds of the coordinates."""
        limits = self.center - CONSTANT_BOUND_STDS * self.deviation
        return np.concatenate([np.log(self.space.lower), limits[CONSTANT_SLICE]])

    @cached_property
    def upper(self) -> Float[np.ndarray, " unknown"]:
        """Upper bounds of the coordinates."""
        limits = self.center + CONSTANT_BOUND_STDS * self.deviation
        return np.concatenate([np.log(self.space.upper), limits[CONSTANT_SLICE]])

    def draw_starts(
        self, count: int, generator: np.random.Generator
    ) -> Float[np.ndarray, "draw unknown"]:
        """Return points at which a search may start, drawn from what is known before.

        Values are drawn around the nominal ones (`VALUE_START_STD`), factors on constants of the
        pump file from their priors. The sensors' path stays at its start, since a descent finds it
        from there.
        """
        deviation = self.deviation.copy()
        deviation[VALUE_SLICE] = VALUE_START_STD
        deviation[self.path_start :] = 0.0
        middle = np.concatenate([np.log(self.space.nominal), self.center[CONSTANT_SLICE]])
        points: np.ndarray = middle + deviation * generator.standard_normal((count, len(middle)))
        return np.clip(points, self.lower, self.upper)

    def __len__(self) -> int:
        return len(self.names)

    def scale_index(self, name: str) -> int:
        """Return the index of a searched factor of `Scales` among the coordinates."""
        return len(PARAMETERS) + self.scales.index(name)

    @cached_property
    def scales(self) -> tuple[str, ...]:
        """Scales that are searched; their coordinates follow the values."""
        return tuple(name for name in SCALE_NAMES if self.nuisances.scale_deviation(name) > 0)

    @cached_property
    def port_angles(self) -> tuple[str, ...]:
        """Angles of ports that are searched; their coordinates follow the scales."""
        if self.nuisances.port_timing == 0:
            return ()
        return PORT_ANGLES

    @cached_property
    def cross_talk(self) -> list[tuple[int, int]]:
        """Pairs (channel that reads, channel that it reads of) whose shares are searched; they
        follow the gains.

        The pairs of the first channels come first, so that a further channel appends its pairs.
        """
        if self.nuisances.cross_talk == 0:
            return []

        pairs = []
        for channel in range(len(self.channels)):
            for earlier_channel in range(channel):
                pairs.append((channel, earlier_channel))
                pairs.append((earlier_channel, channel))
        return pairs

    @cached_property
    def path_start(self) -> int:
        """Index of the first coordinate of the sensors' path: the gains if they are searched."""
        return len(PARAMETERS) + len(self.scales) + len(self.port_angles)

    @cached_property
    def modes_start(self) -> int:
        """Index of the first coordinate of the housing's modes: frequencies, damping ratios,
        residues.
        """
        n_gains = len(self.channels) * (self.nuisances.gains > 0)
        return self.path_start + n_gains + len(self.cross_talk)

    def with_changes(self, channels: tuple[str, ...] | None = None, **nuisances: Any) -> "Unknowns":
        """Return the unknowns with other channels, or with other constants searched."""
        return replace(
            self,
            channels=channels or self.channels,
            nuisances=replace(self.nuisances, **nuisances),
            initial_point=None,
        )

    def scale_factors(self, point: Float[Tensor, "*batch unknown"]) -> Float[Tensor, "*batch 11"]:
        """Return the factors at `point` in the order of `Scales`."""
        columns = []
        for name, twin_scale in zip(SCALE_NAMES, self.twin_scales, strict=True):
            if name in self.scales:
                columns.append(point[..., self.scale_index(name)])
            else:
                shape = point.shape[:-1]
                columns.append(
                    torch.full(shape, float(twin_scale), dtype=point.dtype, device=point.device)
                )
        return torch.stack(columns, dim=-1).exp()

    def port_timing(
        self, point: Float[Tensor, "*batch unknown"]
    ) -> Float[Tensor, "*batch 2"] | None:
        """Return the angles of the ports at `point` [rad] in the order of `PortTiming`; `None` if
        they are not searched.
        """
        if not self.port_angles:
            return None
        return point[..., self.path_start - len(self.port_angles) : self.path_start]

    def port_timing_at(self, point: Float[np.ndarray, " unknown"]) -> PortTiming | None:
        """Return the angles of the ports as a twin takes them; `None` if they are not searched."""
        angles = self.port_timing(torch.as_tensor(point))
        if angles is None:
            return None
        return PortTiming(*angles.tolist())

    def sensor_response(
        self, point: Float[Tensor, "*batch unknown"], frequency: Float[Tensor, " line"]
    ) -> Complex[Tensor, "*batch channel line"] | None:
        """Return the response between the shell and each channel at `frequency` [Hz]; `None` if
        it is not searched.
        """
        if not self.nuisances.gains and not self.nuisances.modes:
            return None
        return path_response(frequency, *self._path_coordinates(point))

    def channel_mixing(
        self, point: Float[Tensor, "*batch unknown"]
    ) -> Float[Tensor, "*batch channel channel"] | None:
        """Return what each channel (row) reads of what an ideal one would (column); `None` if
        cross-talk is not searched.
        """
        pairs = self.cross_talk
        if not pairs:
            return None

        n_channels = len(self.channels)
        end = self.modes_start
        readers, sources = zip(*pairs, strict=True)
        shares = point.new_zeros(*point.shape[:-1], n_channels, n_channels)
        shares[..., readers, sources] = point[..., end - len(pairs) : end]
        return shares + torch.eye(n_channels, dtype=point.dtype, device=point.device)

    def _path_coordinates(self, point: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Return gains, frequencies, damping ratios and residues of the sensors' path."""
        n_channels = len(self.channels)
        n_modes = self.nuisances.modes
        ends = np.cumsum([self.modes_start, n_modes, n_modes])
        frequency, damping = (point[..., start:end].exp() for start, end in pairwise(ends.tolist()))

        # without searched gains every channel reads as it should
        if self.nuisances.gains:
            gain = point[..., self.path_start : self.path_start + n_channels].exp()
        else:
            shape = (*point.shape[:-1], n_channels)
            gain = torch.ones(shape, dtype=point.dtype, device=point.device)

        residue = point[..., int(ends[-1]) :].unflatten(-1, (n_channels, n_modes))
        return gain, frequency, damping, residue

    def scales_at(self, point: Float[np.ndarray, " unknown"]) -> Scales:
        """Return the scales at `point` as a twin takes them."""
        return Scales(*self.scale_factors(torch.as_tensor(point)).tolist())

    def sensor_path_at(
        self, point: Float[np.ndarray, " unknown"], sensors: Sequence[str]
    ) -> SensorPath | None:
        """Return the sensors' path as a twin takes it; `None` if nothing of it is searched.

        Parameters
        ----------
        sensors : sensors of the pump; one that was not measured counts as rigid.
        """
        coordinates = torch.as_tensor(point)
        mixing = self.channel_mixing(coordinates)
        if not self.nuisances.gains and not self.nuisances.modes and mixing is None:
            return None

        gain, frequency, damping, residue = (
            part.tolist() for part in self._path_coordinates(coordinates)
        )
        gains = dict(zip(self.channels, gain, strict=True))
        residues = dict(zip(self.channels, map(tuple, residue), strict=True))
        rigid = (0.0,) * len(frequency)
        cross_talk: tuple[tuple[float, ...], ...] = ()
        if mixing is not None:
            cross_talk = self._cross_talk_shares(mixing, sensors)
        return SensorPath(
            gain=tuple(gains.get(name, 1.0) for name in sensors),
            frequency=tuple(frequency),
            damping_ratio=tuple(damping),
            residue=tuple(residues.get(name, rigid) for name in sensors),
            cross_talk=cross_talk,
        )

    def _cross_talk_shares(
        self, mixing: Tensor, sensors: Sequence[str]
    ) -> tuple[tuple[float, ...], ...]:
        """Return the shares that the sensors read of each other; 0 for those not measured."""
        rows = (mixing - torch.eye(len(self.channels))).tolist()
        shares = dict(zip(product(self.channels, repeat=2), chain.from_iterable(rows), strict=True))
        return tuple(
            tuple(shares.get((reader, source), 0.0) for source in sensors) for reader in sensors
        )


def is_at_bound(
    point: Float[np.ndarray, " unknown"], unknowns: Unknowns
) -> Bool[np.ndarray, " unknown"]:
    """Return whether each coordinate of `point` lies on one of its bounds."""
    distance: np.ndarray = np.minimum(point - unknowns.lower, unknowns.upper - point)
    is_close: np.ndarray = distance < BOUND_MARGIN * (unknowns.upper - unknowns.lower)
    return is_close


def find_default_bounds(
    bounds: Mapping[str, tuple[float, float]] | float | None,
) -> tuple[str, ...]:
    """Return the symbols of the values whose bounds the user did not specify; see
    `build_search_space`.
    """
    if isinstance(bounds, int | float):
        return ()
    specified = set(bounds or ())
    return tuple(
        symbol for name, symbol in PARAMETER_SYMBOLS.items() if not {name, symbol} & specified
    )
