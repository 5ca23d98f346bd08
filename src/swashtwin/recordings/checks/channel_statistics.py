"""Range, level, equal samples and extremes of each channel, block by block: a recording need not fit into memory."""

import math
from collections.abc import Iterable

import numpy as np
from jaxtyping import Float, Int

from swashtwin.recordings.columns import BLOCK
from swashtwin.recordings.recording import Recording

_NEAR = 0.01
"""Distance from an extreme, relative to the range, that counts as near it."""
_AT = 1e-6
"""The same that counts as the extreme itself."""
_MOST_VALUES = 1 << 22
"""Distinct values of a channel that are looked at as steps of a converter."""
_MOST_STEPS = 2**24


class ChannelRange:
    """Least and greatest sample of a channel, and how many samples are no finite numbers."""

    def __init__(self) -> None:
        self.bad, self.first_bad, self.count, self.position = 0, 0, 0, 0
        self.least, self.most = math.inf, -math.inf

    def add(self, row: Float[np.ndarray, " time"]) -> Float[np.ndarray, " _finite"]:
        """Take up the next samples; those of them that are finite."""
        least, most = float(row.min()), float(row.max())
        if not (math.isfinite(least) and math.isfinite(most)):
            bad = np.flatnonzero(~np.isfinite(row))
            self.first_bad = self.first_bad if self.bad else self.position + int(bad[0])
            self.bad += len(bad)
            self.position += len(bad)
            row = np.delete(row, bad)
            least, most = float(row.min(initial=math.inf)), float(row.max(initial=-math.inf))
        self.count += len(row)
        self.position += len(row)
        self.least, self.most = min(self.least, least), max(self.most, most)
        return row

    @property
    def is_constant(self) -> bool:
        """Whether every finite sample is the same, or there is none."""
        return not self.least < self.most


def channel_ranges(recording: Recording) -> list[ChannelRange]:
    """Range of each channel."""
    ranges = [ChannelRange() for _ in recording.channels]
    for block in recording.blocks():
        for extent, row in zip(ranges, block.signal, strict=True):
            extent.add(row)
    return ranges


class Runs:
    """Stretches of consecutive samples; those of fewer than `least` are forgotten."""

    def __init__(self, least: float) -> None:
        self._least = least
        self._open: tuple[int, int, float] | None = None
        self._closed: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []

    def add(self, number: Int[np.ndarray, " sample"], value: Float[np.ndarray, " sample"]) -> None:
        """Take up samples by their number, ascending, and their values; the first value stands for a run."""
        if not number.size:
            return
        first = np.concatenate(([0], np.flatnonzero(np.diff(number) != 1) + 1))
        start, length, values = number[first], np.diff(np.append(first, number.size)), value[first]
        if self._open is not None and self._open[0] + self._open[1] == start[0]:
            start[0], values[0] = self._open[0], self._open[2]
            length[0] += self._open[1]
        elif self._open is not None:
            self._close(*(np.array([item]) for item in self._open))
        self._close(start[:-1], length[:-1], values[:-1])
        self._open = int(start[-1]), int(length[-1]), float(values[-1])

    def result(self) -> tuple[Int[np.ndarray, " run"], Int[np.ndarray, " run"], Float[np.ndarray, " run"]]:
        """Number of the first sample, number of samples, and value of each run."""
        if self._open is not None:
            self._close(*(np.array([item]) for item in self._open))
            self._open = None
        empty = np.array([], int), np.array([], int), np.array([], float)
        start, length, value = (np.concatenate(parts) for parts in zip(empty, *self._closed, strict=True))
        return start, length, value

    def _close(self, start: np.ndarray, length: np.ndarray, value: np.ndarray) -> None:
        long = length >= self._least
        if long.any():
            self._closed.append((start[long], length[long], value[long]))


class ChannelStatistics(ChannelRange):
    """Range of a channel, its mean and variance, and its runs of equal samples.

    Parameters
    ----------
    least_run : pairs of equal neighbors from which a run is kept.
    """

    def __init__(self, least_run: float) -> None:
        super().__init__()
        self.mean, self._square = 0.0, 0.0
        self.equal_pairs = Runs(least_run)
        self.block_ranges: list[tuple[float, float]] = []
        self._last = math.nan

    def add(self, row: Float[np.ndarray, " time"]) -> Float[np.ndarray, " _finite"]:
        """Take up the next samples; those of them that are finite."""
        equal = np.flatnonzero(row[1:] == row[:-1])
        if row[0] == self._last:
            equal = np.concatenate(([-1], equal))
        self.equal_pairs.add(equal + self.position, row[equal + 1])
        self._last = float(row[-1])
        before = self.count
        finite = super().add(row)
        if finite.size:
            with np.errstate(over="ignore", invalid="ignore"):  # a sample of 1e300 has no square
                mean = finite.mean()
                centered = finite - mean
                step = mean - self.mean
                self._square += float(centered @ centered + step * step * before * finite.size / self.count)
                self.mean += float(step * finite.size / self.count)
        self.block_ranges.append((float(finite.min(initial=math.inf)), float(finite.max(initial=-math.inf))))
        return finite

    @property
    def extent(self) -> tuple[float, float]:
        """Least and greatest sample; NaN without a finite one."""
        return (self.least, self.most) if self.count else (math.nan, math.nan)

    @property
    def std(self) -> float:
        """Standard deviation; NaN without a finite sample."""
        return math.sqrt(self._square / self.count) if self.count else math.nan

    @property
    def rms(self) -> float:
        """Root mean square, offset included; NaN without a finite sample."""
        return math.hypot(self.mean, self.std)

    @property
    def key(self) -> tuple[float, ...]:
        """Figures that are the same, bit for bit, for equal samples."""
        return self.count, self.least, self.most, self.mean, self._square


def channel_statistics(recording: Recording, least_run: float) -> list[ChannelStatistics]:
    """Statistics of each channel."""
    statistics = [ChannelStatistics(least_run) for _ in recording.channels]
    for block in recording.blocks():
        for channel, row in zip(statistics, block.signal, strict=True):
            channel.add(row)
    return statistics


class Extreme:
    """Samples at an extreme of a channel and near it.

    Parameters
    ----------
    value : the extreme, with its sign.
    span : greatest less least sample.
    """

    def __init__(self, value: float, span: float, sign: int) -> None:
        self._value, self._span, self._sign = sign * value, span, sign
        self._runs = Runs(1)
        self._near = 0
        self.touching = 0

    def add(self, row: Float[np.ndarray, " time"], position: int) -> None:
        """Take up the samples of a block that begins at sample `position`."""
        signed = row if self._sign > 0 else -row
        number = np.flatnonzero(signed >= self._value - _NEAR * self._span)
        value = signed[number]
        at = self._value - value <= _AT * self._span
        self._near += int(np.count_nonzero(~at))
        self.touching += int(np.count_nonzero(value == self._value))
        self._runs.add(number[at] + position, value[at])

    def crowded(self, least_run: int) -> int:
        """Samples in runs at the extreme, where it is crowded as only a stop makes it."""
        _, lengths, _ = self._runs.result()
        count = int(lengths[lengths >= least_run].sum())
        return count if count > max(self._near, 2 * least_run - 1) else 0


def channel_extremes(recording: Recording, statistics: list[ChannelStatistics]) -> list[tuple[Extreme, Extreme]]:
    """Lower and upper extreme of each channel; blocks that come near neither are not read again."""
    spans = [channel.most - channel.least for channel in statistics]
    extremes = [
        (Extreme(channel.least, span, -1), Extreme(channel.most, span, 1))
        for channel, span in zip(statistics, spans, strict=True)
    ]
    for number, start in enumerate(range(0, recording.n_samples, BLOCK)):
        near = [
            (channel.block_ranges[number][0] <= channel.least + _NEAR * span,
             channel.block_ranges[number][1] >= channel.most - _NEAR * span)
            for channel, span in zip(statistics, spans, strict=True)
        ]  # fmt: skip
        if not np.any(near):
            continue
        signal = recording.slice(start, start + BLOCK).signal
        for row, is_near, pair in zip(signal, near, extremes, strict=True):
            for extreme, wanted in zip(pair, is_near, strict=True):
                if wanted:
                    extreme.add(row, start)
    return extremes


def converter_steps(recording: Recording, channels: Iterable[int]) -> dict[int, float]:
    """Step of the converter of each of these channels whose samples are all multiples of one."""
    values = {channel: np.array([]) for channel in channels}
    for block in recording.blocks():
        for channel in list(values):
            merged = values[channel] = np.union1d(values[channel], block.signal[channel])
            if (
                not 3 <= len(merged) <= _MOST_VALUES
                or not np.isfinite(merged).all()
                or max(-merged[0], merged[-1]) > _MOST_STEPS * np.diff(merged).min()
            ):
                del values[channel]
        if not values:
            break
    steps = {channel: float(np.diff(merged).min()) for channel, merged in values.items()}
    return {
        channel: step
        for channel, step in steps.items()
        if np.abs(values[channel] / step - np.round(values[channel] / step)).max() <= 0.01
    }
