"""Samples that no sensor measured: marks of missing values, spikes, wraps, held samples.

`inspect_recordings` and the watch share these functions, so that both find the same.
"""

import re
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

# Distance from the median, over the median distance, that counts as far: a normal distribution
# reaches 7 in a million samples, a bearing with heavy impacts 60, with samples at all distances.
_FAR_RATIO = 30.0

# Ratio of two successive distances that is a gap: an impact rings, and so has samples between.
_MIN_GAP_RATIO = 10.0

# Distance from the median, over the median distance, that no vibration reaches, with a gap or not.
_IMPOSSIBLE_RATIO = 1e4

# Share of the samples up to which single samples are spikes. More are pulses, as of a tachometer.
_MAX_SPIKE_SHARE = 0.01

# Pulses, and the spread of their distances, from which on they are those of a tachometer.
_MIN_PULSES = 5
_MAX_PULSE_SPREAD = 0.1

# Samples of a channel, spread over the whole, by which it is decided whether to look at all.
_SPREAD_SAMPLES = 4096

# Consecutive samples by which wraps are detected, and samples that were made of fewer ones.
_WRAP_BLOCK_SAMPLES = 8192
_MADE_BLOCK_SAMPLES = 2048

# Step, over the range of the samples, that is a wrap rather than a step of the signal.
_WRAP_STEP = 0.75

# Wraps in a block below which they may be spikes.
_MIN_WRAPS = 4

# Path of the unwrapped signal, over that of the recorded one, up to which it is the right one.
_MAX_UNWRAPPED_PATH = 0.7

# Share of the samples at each end of the range that lie in the outer tenth of their half. A signal
# that passes zero has 6 % there (a sine) or more; the noise of a two-level signal less than 1 %.
_MIN_EDGE_SHARE = 0.05

# Change between two steps, over the mean change, that is a bend and not the rounding of a line.
_BEND_SHARE = 1e-2

# Number of different values that a held signal has at least: a square wave has two.
_MIN_HELD_VALUES = 16

# Share of neighbors that are equal from which on samples may be held.
_MIN_EQUAL_SHARE = 0.2

# Share of the samples, or of the marked ones, that must have the same pattern.
_MIN_PATTERN_SHARE = 0.98

# Numbers that stand for a missing value.
_NINES = re.compile(r"999+")


class Outliers(NamedTuple):
    """Samples of one channel that are too far from the others for a vibration."""

    numbers: Int[np.ndarray, " outlier"]
    """Numbers of the samples."""
    ratio: float
    """Largest distance from the median, over the median distance."""
    farthest: float
    """Value of the one farthest from the median."""
    have_one_value: bool
    """Whether several have exactly one value, and not as the pulses of a tachometer."""

    def mark(self, factor: float) -> float | None:
        """Return the value that marks missing values, or None for spikes.

        Several outliers of one value are marks. A single one is, if it is a number of nines in the
        file, such as -9999: loggers write these for a missing value, and no sensor happens to give
        exactly one of them, a thousand times from the others.

        Parameters
        ----------
        factor : by which the numbers of the file were multiplied.
        """
        number = f"{abs(self.farthest / factor):.9g}"
        is_missing = self.numbers.size == 1 and _NINES.fullmatch(number) is not None
        return self.farthest if self.have_one_value or is_missing else None

    @property
    def times(self) -> str:
        """The ratio with two digits, as text."""
        rounded = float(f"{self.ratio:.2g}")
        return f"{rounded:,.0f}" if rounded < 1e6 else f"{rounded:g}"


def find_outliers(row: Float[np.ndarray, " time"]) -> Outliers | None:
    """Return the samples that are spikes or marks of missing values, or None.

    Between them and the others lies a gap of a factor of ten, which vibration does not leave: a
    sampled impact has values at all distances. If several outliers have exactly one value, it
    marks missing values (`Outliers.mark`). Pulses at regular distances are those of a tachometer.
    """
    row = row.astype(np.float64)
    is_finite = np.isfinite(row)
    if not is_finite.any():
        return None
    median = float(np.median(row[is_finite]))
    distance = np.where(is_finite, np.abs(row - median), 0.0)
    median_distance = _median_distance(distance[is_finite])
    if median_distance == 0:
        return None  # all samples are equal

    numbers = _beyond_gap(distance, median_distance)
    if not numbers.size:
        return None

    ratio = float(distance.max()) / median_distance
    values = row[numbers]
    farthest = float(row[distance.argmax()])
    have_one_value = numbers.size > 1 and bool((values == values[0]).all())
    have_one_value = have_one_value and not _is_regular(numbers)
    is_rare = numbers.size <= max(1.0, _MAX_SPIKE_SHARE * row.size)
    if have_one_value or is_rare or ratio >= _IMPOSSIBLE_RATIO:
        return Outliers(numbers, ratio, farthest, have_one_value)
    return None


def may_have_outliers(sparse: Float[np.ndarray, " sample"], minimum: float, maximum: float) -> bool:
    """Return whether `find_outliers` may find something, by some samples and the extremes.

    Parameters
    ----------
    sparse : finite samples, spread over the channel.
    """
    if not sparse.size:
        return False
    median = float(np.median(sparse))
    median_distance = _median_distance(np.abs(sparse - median))
    if median_distance == 0:
        return minimum < maximum
    # Half of the limit, since the median of some samples is not that of all.
    return max(maximum - median, median - minimum) > 0.5 * _FAR_RATIO * median_distance > 0


def _median_distance(distance: Float[np.ndarray, " sample"]) -> float:
    """Return the median distance, if half of the samples are equal that of the others."""
    median_distance = float(np.median(distance))
    if median_distance > 0:
        return median_distance
    nonzero = distance[distance > 0]
    return float(np.median(nonzero)) if nonzero.size else 0.0


def spread_samples(row: Float[np.ndarray, " time"]) -> Float[np.ndarray, " sample"]:
    """Return some samples, spread over all, as a copy: a view would keep all in memory."""
    return row[:: 1 + row.size // _SPREAD_SAMPLES].copy()


def _beyond_gap(
    distance: Float[np.ndarray, " time"], median_distance: float
) -> Int[np.ndarray, " outlier"]:
    """Return the numbers of the samples beyond the first gap, else of those too far anyway."""
    is_far = distance > _FAR_RATIO * median_distance
    far = np.sort(distance[is_far])
    if not far.size:
        return np.empty(0, int)

    nearest = float(distance[~is_far].max())
    previous = np.concatenate(([nearest], far[:-1]))
    gaps = np.flatnonzero(far >= _MIN_GAP_RATIO * previous)
    limit = far[gaps[0]] if gaps.size else _IMPOSSIBLE_RATIO * median_distance
    return np.flatnonzero(distance >= limit)


def _is_regular(numbers: Int[np.ndarray, " outlier"]) -> bool:
    """Return whether runs of samples follow each other at one distance."""
    starts = numbers[np.concatenate(([True], np.diff(numbers) > 1))]
    if starts.size < _MIN_PULSES:
        return False
    distances = np.diff(starts)
    return bool(distances.std() <= _MAX_PULSE_SPREAD * distances.mean())


def find_wraps(row: Float[np.ndarray, " time"]) -> int:
    """Return the number of wraps at the beginning of a channel, or 0.

    Negative numbers that were stored without a sign lie at the upper end of the range: the samples
    jump from one end to the other as they pass zero, and without these jumps the signal is much
    smoother. A signal of two levels jumps, too, but not from the very end to the very end.
    """
    row = row[:_WRAP_BLOCK_SAMPLES]
    minimum = float(row.min()) if row.size else 0.0
    span = float(row.max()) - minimum if row.size else 0.0
    if not (0 < span < np.inf):
        return 0

    steps = np.diff(row)
    is_wrap = np.abs(steps) > _WRAP_STEP * span
    if is_wrap.sum() < _MIN_WRAPS:
        return 0

    position = (row - minimum) / span
    halves = (position[position < 0.5], 1 - position[position >= 0.5])
    if not all(_reaches_edge(half) for half in halves):
        return 0

    unwrapped_path = float(np.abs(steps - span * np.round(steps / span)).sum())
    path = float(np.abs(steps).sum())
    return int(is_wrap.sum()) if unwrapped_path <= _MAX_UNWRAPPED_PATH * path else 0


def _reaches_edge(half: Float[np.ndarray, " sample"]) -> bool:
    """Return whether samples, by their distance from an end of the range, are dense up to it.

    Clipped samples are at the end itself, and few values are a signal of few levels.
    """
    width = float(half.max())
    if not 0 < width < 0.49:  # without an empty middle nothing was wrapped
        return False
    at_edge = float(np.mean(half <= 0.1 * width))
    at_end = float(np.mean(half == 0))
    return at_edge >= _MIN_EDGE_SHARE and at_end <= 0.5 * at_edge


def describe_made_samples(row: Float[np.ndarray, " time"]) -> str:
    """Return how samples were made of fewer ones, or an empty text.

    Each value is held for several samples, or zeros or straight lines lie between the values.
    """
    row = row[:_MADE_BLOCK_SAMPLES]
    if row.size < 4 * _MIN_HELD_VALUES or not np.isfinite(row).all():
        return ""

    description = _describe_pattern(row)
    n_values = np.unique(row).size if description else 0
    return description if n_values >= _MIN_HELD_VALUES else ""


def _describe_pattern(row: Float[np.ndarray, " time"]) -> str:
    """Return the regular pattern of samples without regard to their values, or an empty text."""
    zero_factor = _regular_factor(row != 0)
    if zero_factor:
        return f"of {zero_factor} samples all but one are zero"

    is_step = row[1:] != row[:-1]
    if is_step.mean() <= 1 - _MIN_EQUAL_SHARE:
        return _describe_held(1 + np.flatnonzero(is_step))

    bends = np.abs(np.diff(row, 2))
    line_factor = _regular_factor(bends > _BEND_SHARE * bends.mean())
    if line_factor:
        return f"the samples lie on straight lines of {line_factor} steps"
    return ""


def _describe_held(changes: Int[np.ndarray, " change"]) -> str:
    """Return how often each value stands, if it is always the same number."""
    lengths = np.diff(changes)
    if not lengths.size:
        return ""
    shortest = int(lengths.mean() + 1e-9)
    for longest in (shortest, shortest + 1):
        is_held = (lengths >= shortest) & (lengths <= longest)
        # In samples: the few long runs of a clipped signal hold a large part of them.
        held_share = lengths[is_held].sum() / lengths.sum()
        # A dropout at the beginning is longer than the values that follow it.
        begins_held = changes[0] <= longest
        if longest > 1 and begins_held and held_share >= _MIN_PATTERN_SHARE:
            times = f"{shortest}" if longest == shortest else f"{shortest} or {longest}"
            return f"every value stands {times} times"
    return ""


def _regular_factor(is_marked: Bool[np.ndarray, " time"]) -> int:
    """Return the distance of the marked samples if nearly all have the same one above 1, or 0."""
    marked = np.flatnonzero(is_marked)
    if marked.size < _MIN_HELD_VALUES:
        return 0
    distances = np.diff(marked)
    factor = int(np.median(distances))
    is_regular = float(np.mean(distances == factor)) >= _MIN_PATTERN_SHARE
    return factor if factor > 1 and is_regular else 0
