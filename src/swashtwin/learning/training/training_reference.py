"""The training recordings by features and signal statistics, to compare new ones with."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Float32, Float64, Int

from swashtwin.foundation import InputError
from swashtwin.learning.features import window_powers
from swashtwin.learning.training.class_space import ClassSpace, fit_class_space
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.signals import log_band_powers

STATISTICS = ("level", "noise_floor", "line_share", "offset", "similarity")
"""Statistics of a signal [dB]: its variance; the power density below which a tenth of the spectrum
lies; the share of the power in the strongest fiftieth of the lines; the square of the mean over the
variance; and the share that another channel explains, as -log(1 - r^2).
"""
N_BANDS = 16
"""Logarithmic bands [dB] that follow the `STATISTICS`; swapped channels are recognized by them."""
N_STATISTICS = len(STATISTICS) + N_BANDS
"""Columns of `signal_statistics`."""
ERROR_RATE = 0.05
"""Share of the recordings like the training's of which a statistic may be reported as outside."""

_QUIETEST_SHARE = 0.1
_STRONGEST_SHARE = 0.02
_MIN_SPREAD_DB = 1.0

# Minimum spreads that a difference is divided by: few recordings may agree by chance.
_MIN_BAND_SPREAD_DB = 3.0

# Difference below which a statistic is not reported: it would be rounded to 0 dB.
_MIN_EXCESS_DB = 0.5

_MIN_POWER = 1e-30

# Offset over variance below which it counts as this much.
_MIN_OFFSET = 1e-2

# Limits of the share of a channel that no other one explains: up to a correlation of 0.95 channels
# count as independent.
_UNEXPLAINED_SHARE = (1e-4, 0.1)

# Training recordings from which the rate of recordings outside their range is known.
_MIN_RECORDINGS = 5

# Distance from the range of fewer recordings that is reported.
_FALLBACK_EXCESS_DB = 10.0

# Two channels are swapped if exchanging them at least halves their distances.
_MIN_SWAP_RATIO = 0.5


@dataclass(frozen=True)
class DeviatingStatistic:
    """A statistic of one channel outside the range of the training."""

    channel: int
    statistic: str
    value: float
    """Value of the recording [dB]."""
    low: float
    """Minimum of the training [dB]."""
    high: float
    """Maximum of the training [dB]."""
    deviation: float
    """Distance from the range, in standard deviations between the training recordings."""

    @property
    def excess(self) -> float:
        """Distance above the range [dB], negative below it."""
        if self.value > self.high:
            return self.value - self.high
        return self.value - self.low


def signal_statistics(
    windows: WindowSet, powers: Sequence[Float64[np.ndarray, "window line"]] | None = None
) -> Float64[np.ndarray, "window channel statistic"]:
    """Return the `STATISTICS` of each channel and window, then the powers of `N_BANDS` bands.

    All are in dB re the unit squared, the noise floor as a density (per Hz). Both spectra are with
    a Hann taper and the mean removed.

    Parameters
    ----------
    powers : `window_powers` of the windows, if known.
    """
    samples = windows.signal.astype(np.float64)
    mean = samples.mean(axis=2)
    samples -= mean[:, :, None]
    products = samples @ samples.swapaxes(1, 2) / windows.length
    variance = np.maximum(np.diagonal(products, axis1=1, axis2=2), _MIN_POWER)

    squared_correlation = products**2 / (variance[:, :, None] * variance[:, None])
    squared_correlation *= 1 - np.eye(windows.n_channels)
    unexplained = np.clip(1 - squared_correlation.max(axis=2), *_UNEXPLAINED_SHARE)

    resolution = windows.length / windows.sample_rate
    channels = []
    for channel, power in enumerate(window_powers(windows) if powers is None else powers):
        # Partial sorts: only two positions of the sorted spectrum are needed.
        n_lines = power.shape[1]
        quietest = int(_QUIETEST_SHARE * n_lines)
        floor = np.partition(power, quietest, axis=1)[:, quietest] * resolution
        first_strong = n_lines - max(1, round(_STRONGEST_SHARE * n_lines))
        strongest = np.partition(power, first_strong, axis=1)[:, first_strong:].sum(axis=1)

        ratios = (
            variance[:, channel],
            floor,
            strongest / np.maximum(power.sum(axis=1), _MIN_POWER),
            np.maximum(mean[:, channel] ** 2 / variance[:, channel], _MIN_OFFSET),
            1 / unexplained[:, channel],
        )
        decibels = 10 * np.log10(np.maximum(np.stack(ratios, axis=1), _MIN_POWER))
        channels.append(np.concatenate([decibels, 10 * log_band_powers(power, N_BANDS)], axis=1))
    return np.stack(channels, axis=1)


def deviating_statistics(
    training: Float64[np.ndarray, "recording channel statistic"],
    machines: Sequence[str],
    statistics: Float64[np.ndarray, "channel statistic"],
) -> tuple[DeviatingStatistic, ...]:
    """Return the statistics outside the training's range, the largest deviation first.

    A recording's deviation is the largest distance of its statistics from the range of other
    recordings, in standard deviations between the training recordings (at least 1 dB). A statistic
    is reported if its deviation exceeds the deviations of a share 1 - `ERROR_RATE` of the training
    recordings, each compared with the others, or with those of other `machines` ("" if not
    specified) if there are several. So at most about this share of recordings like the training's
    get any report; with n < 19 training recordings, about one in n + 1. The same conformal rule
    decides which recordings are called unknown. Fewer than five recordings give no such rate: then
    a distance of 10 dB is reported.
    """
    values = training[:, :, : len(STATISTICS)]
    recorded = statistics[:, : len(STATISTICS)]
    spread = np.maximum(values.std(axis=0), _MIN_SPREAD_DB)
    if len(training) >= _MIN_RECORDINGS:
        max_deviation = max(_typical_deviation(values, machines, spread), 0.0)
        min_excess = _MIN_EXCESS_DB
    else:
        max_deviation = 0.0
        min_excess = _FALLBACK_EXCESS_DB

    low = values.min(axis=0)
    high = values.max(axis=0)
    excess = np.maximum(recorded - high, low - recorded)
    deviation = excess / spread
    outside = [
        DeviatingStatistic(
            channel=int(channel),
            statistic=STATISTICS[statistic],
            value=float(recorded[channel, statistic]),
            low=float(low[channel, statistic]),
            high=float(high[channel, statistic]),
            deviation=float(deviation[channel, statistic]),
        )
        for channel, statistic in np.argwhere((deviation > max_deviation) & (excess >= min_excess))
    ]
    return tuple(sorted(outside, key=lambda statistic: -statistic.deviation))


def _typical_deviation(values: np.ndarray, machines: Sequence[str], spread: np.ndarray) -> float:
    """Return the deviation that a share 1 - `ERROR_RATE` of the training recordings stay below."""
    group = np.unique(machines, return_inverse=True)[1]
    if group.max() == 0:  # a single machine: compare each recording with the others
        group = np.arange(len(values))

    below = _minimum_of_other_groups(values, group) - values
    above = values + _minimum_of_other_groups(-values, group)
    deviation = np.sort((np.maximum(above, below) / spread).max(axis=(1, 2)))
    n_allowed = max(1, int(ERROR_RATE * (len(deviation) + 1)))
    return float(deviation[len(deviation) - n_allowed])


def _minimum_of_other_groups(values: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Return, for each recording, the minimum of each statistic among the other groups."""
    n_groups = group.max() + 1
    minimum = np.stack([values[group == number].min(axis=0) for number in range(n_groups)])
    lowest, second_lowest = np.sort(minimum, axis=0)[:2]
    return np.where(minimum[group] == lowest, second_lowest, lowest)


def swapped_channels(
    training: Float64[np.ndarray, "recording channel statistic"],
    statistics: Float64[np.ndarray, "channel statistic"],
) -> tuple[int, int] | None:
    """Return two channels of a recording that seem to be swapped; None if there are none.

    Channels are compared by their band powers, in standard deviations between the training
    recordings (at least 3 dB). Two are called swapped if exchanging them halves the root mean
    square of the differences of both, and neither of them was as far from its own mean in any
    training recording.
    """
    profiles = training[:, :, len(STATISTICS) :]
    profile = statistics[:, len(STATISTICS) :]
    if len(training) < 2 or len(profile) < 2:
        return None

    mean = profiles.mean(axis=0)
    spread = np.maximum(profiles.std(axis=0), _MIN_BAND_SPREAD_DB)

    def distances(rows: np.ndarray) -> np.ndarray:
        return np.asarray(np.sqrt(np.mean(((rows - mean) / spread) ** 2, axis=-1)))

    max_trained_distance = distances(profiles).max(axis=0)
    distance = distances(profile[:, None])  # row: channel of the recording; column: of the training
    straight = np.diag(distance)
    crossed = distance + distance.T
    ratio = crossed / np.maximum(straight[:, None] + straight, 1e-12)

    is_typical = straight <= max_trained_distance
    ratio[np.diag_indices(len(ratio))] = np.inf
    ratio[is_typical] = np.inf
    ratio[:, is_typical] = np.inf
    first, second = np.unravel_index(ratio.argmin(), ratio.shape)
    if ratio[first, second] >= _MIN_SWAP_RATIO:
        return None
    return int(first), int(second)


MAX_RECORDINGS = 500
"""Maximum number of recordings in a reference; of more, this many are taken, evenly spaced in the
order of their ids.
"""

# Share of the held-out training recordings whose distance is above 1.
_TAIL_SHARE = 0.1

_N_FOLDS = 10

# Windows of a recording from which its statistics are computed, evenly spaced.
_MAX_WINDOWS = 20


@dataclass(frozen=True, eq=False)
class TrainingReference:
    """Mean features and signal statistics of each measured recording of the training.

    It holds no samples.
    """

    recording_id: tuple[str, ...]
    """The recordings, in the order of their ids."""
    label: tuple[str, ...]
    specimen: tuple[str, ...]
    """Machine of each; empty if not specified."""
    condition: Float64[np.ndarray, "reference quantity"]
    """Speed [rad/s] and discharge pressure [Pa] of each; NaN if not specified."""
    features: Float32[np.ndarray, "reference feature"]
    """Mean of each feature (`FittedClassifier.answer`) over the windows of the recording."""
    statistics: Float64[np.ndarray, "reference channel statistic"]
    """Mean of `signal_statistics` over some windows."""
    distance_scales: tuple[float, float] = (1.0, 1.0)
    """Distances from the others that nine in ten of the training recordings do not exceed when held
    out: alone, and together with all of their machine.
    """

    def __post_init__(self) -> None:
        count = len(self.recording_id)
        lengths = {
            len(part)
            for part in (self.label, self.specimen, self.features, self.statistics, self.condition)
        }
        if not count or lengths != {count}:
            raise InputError(
                "A training reference needs at least one recording, and a label, a machine and a "
                "row for each."
            )
        are_scales_valid = all(0 < scale < math.inf for scale in self.distance_scales)
        if self.condition.shape != (count, 2) or not are_scales_valid:
            raise InputError(
                "A training reference needs a speed and a pressure for each recording, and two "
                "positive scales."
            )

    def distances(
        self, features: Float[np.ndarray, " feature"]
    ) -> Float64[np.ndarray, " reference"]:
        """Return the distance of each training recording from one with these mean features.

        It is the root mean square over the features, each in units of its standard deviation
        between the training recordings; a feature that does not differ between them counts in its
        own unit.
        """
        deviation = self.features.std(axis=0)
        scale = np.where(deviation > 0, deviation, 1.0)
        offset = (self.features - features.astype(np.float32)) / scale
        return np.asarray(np.sqrt(np.mean(offset**2, axis=1)), dtype=np.float64)

    def ood_score(
        self,
        features: Float[np.ndarray, " feature"],
        *,
        specimen: str = "",
        condition: Float[np.ndarray, " quantity"] | None = None,
    ) -> float:
        """Return the out-of-distribution score of these mean features.

        One in ten of the recordings like the training's is above 1. It is a likelihood ratio
        between the nearest trained class and a new one (`ClassSpace`; in the manner of Ren and
        others 2021, arXiv:2106.09022), over the ratio that nine in ten of the training recordings
        do not exceed when held out: alone if the machine is one of the training's, else together
        with all of their machine. It may be negative.

        Parameters
        ----------
        condition : speed [rad/s] and discharge pressure [Pa]; NaN if not specified.
        """
        if condition is None:
            condition = np.full(2, np.nan)
        is_trained = bool(specimen) and specimen in self.specimen
        scale_alone, scale_together = self.distance_scales
        scale = scale_alone if is_trained else scale_together
        return self._space.score(features, condition) / scale

    def cross_fitted_scores(self) -> Float64[np.ndarray, " reference"]:
        """Return the `ood_score` of each training recording by references without it.

        NaN if these have no recording of its class.
        """
        return self.held_out_distances(_folds(len(self.label))) / self.distance_scales[0]

    @cached_property
    def _space(self) -> ClassSpace:
        return self._fit_space(np.ones(len(self.label), dtype=bool))

    def _fit_space(self, is_used: np.ndarray) -> ClassSpace:
        return fit_class_space(
            self.features[is_used],
            np.array(self.label)[is_used],
            np.array(self.specimen)[is_used],
            self.condition[is_used],
        )

    def held_out_distances(self, group: np.ndarray) -> Float64[np.ndarray, " reference"]:
        """Return the distance of each recording by a space without its group.

        NaN if that space does not have its class.
        """
        label = np.array(self.label)
        distance = np.full(len(label), np.nan)
        for number in np.unique(group):
            is_used = group != number
            is_comparable = ~is_used & np.isin(label, label[is_used])
            if not is_comparable.any():
                continue
            space = self._fit_space(is_used)
            for row in np.flatnonzero(is_comparable):
                distance[row] = space.score(self.features[row], self.condition[row])
        return distance


def build_reference(
    windows: WindowSet, features: Float[np.ndarray, "window feature"]
) -> TrainingReference | None:
    """Return a reference of the measured recordings among training windows.

    None if all are synthetic or not finite.

    Parameters
    ----------
    features : features of each window, all of one kind, such as logarithms of powers.
    """
    names = np.unique(windows.recording_id[~windows.synthetic])
    if not names.size:
        return None

    recording_ids = []
    parts = []
    means = []
    statistics = []
    for name in _spaced(names, MAX_RECORDINGS).tolist():
        rows = np.flatnonzero((windows.recording_id == name) & ~windows.synthetic)
        part = windows.subset(_spaced(rows, _MAX_WINDOWS))
        mean_features = features[rows].mean(axis=0).astype(np.float32)
        mean_facts = signal_statistics(part).mean(axis=0)
        if np.isfinite(mean_features).all() and np.isfinite(mean_facts).all():
            recording_ids.append(name)
            parts.append(part)
            means.append(mean_features)
            statistics.append(mean_facts)
    if not parts:
        return None

    reference = TrainingReference(
        recording_id=tuple(recording_ids),
        label=tuple(str(part.label[0]) for part in parts),
        specimen=tuple(str(part.specimen[0]) for part in parts),
        condition=np.stack([part.condition(0) for part in parts]),
        features=np.stack(means),
        statistics=np.stack(statistics),
    )
    return scaled_reference(reference)


def _spaced(values: np.ndarray, max_count: int) -> np.ndarray:
    """Return at most `max_count` of the values, evenly spaced."""
    count = min(max_count, values.size)
    index = np.linspace(0, values.size - 1, count).round().astype(np.int64)
    return values[np.unique(index)]


def scaled_reference(reference: TrainingReference) -> TrainingReference:
    """Return the same reference with its `distance_scales`.

    Each held-out machine has its own scale, and their median is taken: otherwise one machine that
    differs from the few others of the training would set the scale for all later ones. If one scale
    is unknown, the other one is taken, or 1.
    """
    by_fold = [reference.held_out_distances(_folds(len(reference.label)))]
    by_machine = by_fold
    machines, group = np.unique(reference.specimen, return_inverse=True)
    if len(machines) > 1:
        distance = reference.held_out_distances(group)
        by_machine = [distance[group == number] for number in range(len(machines))]

    scale_alone = _median_tail_distance(by_fold)
    scale_together = _median_tail_distance(by_machine)
    scales = (
        scale_alone or scale_together or 1.0,
        scale_together or scale_alone or 1.0,
    )
    return replace(reference, distance_scales=scales)


def _median_tail_distance(distances: list[np.ndarray]) -> float:
    """Return the median over the parts of the distance that nine in ten do not exceed.

    0 if no recording has a distance, or the median is not positive.
    """
    quantiles = []
    for part in distances:
        defined = part[~np.isnan(part)]
        if defined.size:
            quantiles.append(float(np.quantile(defined, 1 - _TAIL_SHARE)))
    if not quantiles:
        return 0.0
    return max(float(np.median(quantiles)), 0.0)


def _folds(count: int) -> Int[np.ndarray, " reference"]:
    """Return the fold of each recording, in turn."""
    return np.arange(count) % _N_FOLDS
