"""Range, mean, standard deviation, flat stretches and impossible values of each channel.

They are computed in parts.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from swashtwin.recordings.impossible_values import (
    Outliers,
    describe_made_samples,
    find_outliers,
    find_wraps,
    may_have_outliers,
    spread_samples,
)
from swashtwin.recordings.recording import Recording

PART_SAMPLES = 1 << 22
"""Samples of a channel that are processed together.

A flat stretch across the border of two parts counts as two.
"""

# Samples of one value from which a stretch is flat: coarse converters repeat values for less.
_MIN_FLAT_SAMPLES = 20

# Length [s] from which a stretch is flat, whatever the sample rate.
_MIN_FLAT_TIME_S = 2e-3


class FlatStretch(NamedTuple):
    """Consecutive samples of one value."""

    length: int
    """Number of samples."""
    start: int
    """Number of the first sample."""
    value: float
    """Value of the samples."""


class ChannelStatistics:
    """Range, mean, variance, flat stretches and impossible values of a channel.

    Parameters
    ----------
    min_flat : consecutive samples of one value from which a stretch is recorded.
    """

    def __init__(self, min_flat: float) -> None:
        self._min_flat = min_flat
        self.invalid_count = 0
        """Number of missing and infinite samples."""
        self.first_invalid = 0
        """Number of the first of them."""
        self.count = 0
        """Number of finite samples."""
        self.minimum = math.inf
        self.maximum = -math.inf
        self.mean = 0.0
        self._squares = 0.0
        """Sum of the squared deviations from the mean."""
        self.stretches: list[FlatStretch] = []
        self.outliers: tuple[Outliers, ...] = ()
        """Spikes and marks of missing values, of each part that has some."""
        self.wrap_count = 0
        """Jumps at the beginning by which numbers lost their sign."""
        self.made = ""
        """How the samples were made of fewer ones, or empty."""
        self._spread: list[Float[np.ndarray, " sample"]] = []
        """Some samples of each part."""

    def add(self, row: Float[np.ndarray, " time"], position: int) -> None:
        """Add the samples from number `position` on."""
        starts, lengths = find_runs(np.flatnonzero(row[1:] == row[:-1]))
        for start, length in zip(starts.tolist(), (lengths + 1).tolist(), strict=True):
            if length >= self._min_flat:
                stretch = FlatStretch(length, position + start, float(row[start]))
                self.stretches.append(stretch)

        # One test of the extremes is cheaper than a mask of all samples, which few channels need.
        if not math.isfinite(row.min() + row.max()):
            row = self._without_invalid(row, position)
        if row.size:
            if position == 0:
                self.wrap_count = find_wraps(row)
                self.made = describe_made_samples(row)
            self._spread.append(spread_samples(row))
            self._add_finite(row)

    def may_have_outliers(self) -> bool:
        """Return whether `find_outliers` may find something, by some samples; forget these."""
        samples = np.concatenate(self._spread or [np.empty(0)])
        self._spread.clear()
        return may_have_outliers(samples, self.minimum, self.maximum)

    def _without_invalid(
        self, row: Float[np.ndarray, " time"], position: int
    ) -> Float[np.ndarray, " _time"]:
        invalid = np.flatnonzero(~np.isfinite(row))
        if invalid.size and not self.invalid_count:
            self.first_invalid = position + int(invalid[0])
        self.invalid_count += invalid.size
        return np.delete(row, invalid)

    def _add_finite(self, row: Float[np.ndarray, " time"]) -> None:
        """Update the moments by the formula of Chan, Golub and LeVeque for two parts."""
        previous_count = self.count
        self.count += row.size
        self.minimum = min(self.minimum, float(row.min()))
        self.maximum = max(self.maximum, float(row.max()))

        with np.errstate(over="ignore", invalid="ignore"):  # a sample of 1e300 has no square
            row_mean = row.mean()
            deviation = row - row_mean
            step = row_mean - self.mean
            between_parts = step * step * previous_count * row.size / self.count
            self._squares += float(deviation @ deviation + between_parts)
            self.mean += float(step * row.size / self.count)

    @property
    def is_constant(self) -> bool:
        """Whether every finite sample is the same, or there is none."""
        return not self.minimum < self.maximum

    @property
    def extent(self) -> tuple[float, float]:
        """Minimum and maximum; NaN without a finite sample."""
        return (self.minimum, self.maximum) if self.count else (math.nan, math.nan)

    @property
    def std(self) -> float:
        """Standard deviation; NaN without a finite sample."""
        return math.sqrt(self._squares / self.count) if self.count else math.nan

    @property
    def rms(self) -> float:
        """Root mean square, offset included; NaN without a finite sample."""
        return math.hypot(self.mean, self.std)


def compute_channel_statistics(recording: Recording) -> list[ChannelStatistics]:
    """Return the statistics of each channel."""
    min_flat = max(_MIN_FLAT_SAMPLES, _MIN_FLAT_TIME_S * recording.sample_rate)
    statistics = [ChannelStatistics(min_flat) for _ in recording.channels]

    for start in range(0, recording.n_samples, PART_SAMPLES):
        signal = recording.samples.signal_part(start, start + PART_SAMPLES)
        for channel, row in zip(statistics, signal, strict=True):
            channel.add(row, start)

    suspects = [index for index, channel in enumerate(statistics) if channel.may_have_outliers()]
    if suspects:
        _add_outliers(recording, statistics, suspects)
    return statistics


def _add_outliers(
    recording: Recording, statistics: Sequence[ChannelStatistics], suspects: Sequence[int]
) -> None:
    """Search some channels for outliers, part by part."""
    for start in range(0, recording.n_samples, PART_SAMPLES):
        signal = recording.samples.signal_part(start, start + PART_SAMPLES)
        for index in suspects:
            outliers = find_outliers(signal[index])
            if outliers is not None:
                outliers = outliers._replace(numbers=outliers.numbers + start)
                statistics[index].outliers += (outliers,)


def find_runs(
    numbers: Int[np.ndarray, " number"],
) -> tuple[Int[np.ndarray, " run"], Int[np.ndarray, " run"]]:
    """Return first number and length of each run of consecutive numbers."""
    if not numbers.size:
        return numbers, numbers

    firsts = np.concatenate(([0], np.flatnonzero(np.diff(numbers) != 1) + 1))
    return numbers[firsts], np.diff(np.append(firsts, numbers.size))
