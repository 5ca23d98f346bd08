"""What is wrong or suspicious about each channel: missing samples, dead sensors, clipping,
dropouts, offsets.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from swashtwin.foundation import DataError
from swashtwin.recordings.grouping import specified_shaft_frequency
from swashtwin.recordings.recording import Recording

Severity = Literal["error", "warning", "note"]


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong, or worth knowing."""

    kind: str
    """Short name, such as ``"clipping"``."""
    severity: Severity
    """``error``: must not be used; ``warning``: look at it; ``note``: worth knowing."""
    channel: str | None
    """Channel it was found in, or None where it concerns all."""
    message: str
    """The finding in words, with the numbers."""


def listed(names: Sequence[str], most: int = 3) -> str:
    """The first `most` names, and how many more."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


PART = 1 << 22
"""Samples of a channel that are looked at together; a stretch across the border of two parts counts
as two.
"""
_LARGEST = float(np.finfo(np.float32).max)
"""Windows are in single precision."""
_NEAR, _AT = 0.01, 1e-6
"""Distance from an extreme, relative to the range, that counts as near it, and as the extreme
itself.
"""
_CLIP_RUN = 3
"""Samples in a row at the extreme that count as clipped."""
_FLAT_SAMPLES, _FLAT_TIME = 20, 2e-3
"""A stretch of one value is flat from this many samples and this long [s] on."""
_OFFSET_RATIO = 5.0
"""Mean over standard deviation from which an offset is called large."""


class ChannelStatistics:
    """Range, mean, variance and flat stretches of a channel.

    Parameters
    ----------
    flat : samples of one value in a row from which a stretch is kept.
    """

    def __init__(self, flat: float) -> None:
        self._flat = flat
        self.bad, self.first_bad, self.count, self._square = 0, 0, 0, 0.0
        self.least, self.most, self.mean = math.inf, -math.inf, 0.0
        self.stretches: list[tuple[int, int, float]] = []
        """Number of samples, number of the first, and value of each flat stretch."""

    def add(self, row: Float[np.ndarray, " time"], position: int) -> None:
        """Take up the samples from number `position` on."""
        starts, lengths = _runs(np.flatnonzero(row[1:] == row[:-1]))
        for at in np.flatnonzero(lengths + 1 >= self._flat):
            self.stretches.append(
                (int(lengths[at]) + 1, position + int(starts[at]), float(row[starts[at]]))
            )
        if not math.isfinite(row.min() + row.max()):
            bad = np.flatnonzero(~np.isfinite(row))
            self.first_bad = (
                self.first_bad if self.bad else position + int(bad[0]) if bad.size else 0
            )
            self.bad += bad.size
            row = np.delete(row, bad)
        if not row.size:
            return
        before, self.count = self.count, self.count + row.size
        self.least, self.most = min(self.least, float(row.min())), max(self.most, float(row.max()))
        with np.errstate(over="ignore", invalid="ignore"):  # a sample of 1e300 has no square
            mean = row.mean()
            centered = row - mean
            step = mean - self.mean
            self._square += float(
                centered @ centered + step * step * before * row.size / self.count
            )
            self.mean += float(step * row.size / self.count)

    @property
    def is_constant(self) -> bool:
        """Whether every finite sample is the same, or there is none."""
        return not self.least < self.most

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


def channel_statistics(recording: Recording) -> list[ChannelStatistics]:
    """Statistics of each channel."""
    flat = max(_FLAT_SAMPLES, _FLAT_TIME * recording.sample_rate)
    statistics = [ChannelStatistics(flat) for _ in recording.channels]
    for start in range(0, recording.n_samples, PART):
        for channel, row in zip(
            statistics, recording.samples.signal_part(start, start + PART), strict=True
        ):
            channel.add(row, start)
    return statistics


def require_usable(recording: Recording) -> None:
    """Refuse a recording from which nothing can be learned.

    Raises
    ------
    DataError
        Missing samples, a sample beyond single precision, a constant channel, gaps in time, or less
        than one revolution where the speed is known.
    """
    for finding in unfit(recording, channel_statistics(recording)):
        where = (
            recording.recording_id
            if finding.channel is None
            else f"{recording.recording_id}, {finding.channel}"
        )
        raise DataError(f"{where}: {finding.message}")


def unfit(recording: Recording, statistics: Sequence[ChannelStatistics]) -> Iterator[Finding]:
    """Why nothing can be learned from a recording."""
    for name, channel in zip(recording.channels, statistics, strict=True):
        if channel.bad:
            message = (
                f"{channel.bad} of {recording.n_samples} samples are missing or infinite, the first at "
                f"{channel.first_bad / recording.sample_rate:.6g} s; cut them out or repair the file."
            )
            yield Finding("nan", "error", name, message)
        elif (peak := max(channel.most, -channel.least)) > _LARGEST:
            message = (
                f"a sample of {peak:.3g} {recording.unit} is larger than a window can hold ({_LARGEST:.2g}); cut it "
                "out, or repair the file."
            )
            yield Finding("too_large", "error", name, message)
        elif channel.is_constant:
            yield Finding(
                "constant",
                "error",
                name,
                f"every sample is {channel.least:g}: a dead or unplugged sensor?",
            )
    if gaps := recording.attributes.get("time_gaps"):
        yield Finding(
            "gaps",
            "error",
            None,
            f"the time column has gaps: {gaps}; split the file where they are.",
        )
    shaft = specified_shaft_frequency(recording)
    if shaft and recording.duration * shaft < 1:
        message = (
            f"{recording.duration:.4g} s is shorter than one revolution at {shaft * 60:.5g} rev/min "
            f"({1 / shaft:.4g} s); record longer, or correct the sample rate."
        )
        yield Finding("short", "error", None, message)


def channel_findings(
    recording: Recording, statistics: Sequence[ChannelStatistics]
) -> Iterator[Finding]:
    """Clipping, dropouts and offsets of each channel that is not constant."""
    totals = np.zeros((len(statistics), 2, 2), int)
    for start in range(0, recording.n_samples, PART):
        signal = recording.samples.signal_part(start, start + PART)
        for number, (row, channel) in enumerate(zip(signal, statistics, strict=True)):
            if not channel.is_constant:
                totals[number] += _at_extremes(row, channel.least, channel.most)
    for name, channel, counts in zip(recording.channels, statistics, totals.tolist(), strict=True):
        if channel.is_constant:
            continue
        crowds = [_crowd(*each) for each in counts]
        if max(crowds) > recording.n_samples / 2:
            message = (
                f"{max(crowds)} samples ({max(crowds) / recording.n_samples:.2%}) are as good as equal beside the "
                f"others, of {channel.least:.4g} to {channel.most:.4g} {recording.unit}: spikes, or the pulses of a "
                "tachometer?"
            )
            yield Finding("spikes", "warning", name, message)
        elif clipped := sum(crowds):
            share = clipped / recording.n_samples
            message = f"{clipped} samples ({share:.2%}) stand in a row at the extreme: the range was exceeded."
            yield Finding("clipping", "warning", name, message)
        values = np.array([value for _, _, value in channel.stretches])
        interior = ~np.isclose(values[:, None], (channel.least, channel.most)).any(axis=1)
        flat = [
            item
            for item, inside in zip(channel.stretches, interior, strict=True)
            if inside or not sum(crowds)
        ]
        if flat:
            length, first, _ = max(flat, key=lambda item: item[0])
            message = (
                f"{len(flat)} flat stretches; the longest is {length / recording.sample_rate:.4g} s at "
                f"{first / recording.sample_rate:.4g} s: dropouts?"
            )
            yield Finding("flat", "warning", name, message)
        if abs(channel.mean) > _OFFSET_RATIO * channel.std > 0:
            message = (
                f"the offset {channel.mean:.4g} {recording.unit} is {abs(channel.mean) / channel.std:.1f} times the "
                f"vibration's std {channel.std:.4g}."
            )
            yield Finding("offset", "warning", name, message)


def count_clipped_samples(row: Float[np.ndarray, " time"]) -> int:
    """Samples in runs at an extreme, where the extreme is crowded as only a stop makes it."""
    low, high = float(np.nanmin(row)), float(np.nanmax(row))
    if not (np.isfinite(low) and np.isfinite(high)):
        return 0
    return sum(_crowd(*counts) for counts in _at_extremes(row, low, high).tolist())


def _runs(
    numbers: Int[np.ndarray, " number"],
) -> tuple[Int[np.ndarray, " run"], Int[np.ndarray, " run"]]:
    if not numbers.size:
        return numbers, numbers
    first = np.concatenate(([0], np.flatnonzero(np.diff(numbers) != 1) + 1))
    return numbers[first], np.diff(np.append(first, numbers.size))


def _at_extremes(
    row: Float[np.ndarray, " time"], least: float, most: float
) -> Int[np.ndarray, "extreme 2"]:
    """Samples in runs at the lower and the upper extreme, and samples near it but not at it."""
    counts, span = np.zeros((2, 2), int), most - least
    for number, (signed, extreme) in enumerate(((-row, -least), (row, most))):
        near = np.flatnonzero(signed >= extreme - _NEAR * span)
        at = near[extreme - signed[near] <= _AT * span]
        _, lengths = _runs(at)
        counts[number] = lengths[lengths >= _CLIP_RUN].sum(), near.size - at.size
    return counts


def _crowd(in_runs: int, near: int) -> int:
    """Samples in runs at the extreme, where it is crowded as only a stop makes it."""
    return in_runs if in_runs > max(near, 2 * _CLIP_RUN - 1) else 0


_HARMONICS = 10
_LINE_RATIO = 6.0
"""Amplitude of a line over the median around it (16 dB)."""
_SPEED_SEARCH, _SPEED_TOLERANCE = 0.09, 0.02
"""How far from the stated speed another is looked for (no further: the neighbors of a nine-piston
line lie 1/9 away), and how far off it may be.
"""
_USUAL_RATES = (200.0, 250e3)
"""Sample rates of accelerometers [Hz]; they lie less than a factor of 1250 apart, so that kHz taken
for Hz shows.
"""
_LEAST_TURNS = 50
"""Revolutions from which lines are looked for."""
_LONGEST = 1 << 20
"""Samples in which they are looked for, where they hold so many revolutions."""
_LEAST_PER_TURN = 4.0
"""Samples in a turn below which not even the shaft's own line can be in a signal with room to
spare.
"""


def contradicted_speed(
    recording: Recording, statistics: Sequence[ChannelStatistics]
) -> list[Finding]:
    """A warning where a clear family of shaft lines stands beside the stated speed and none at it.

    A long recording is judged by its first 2^20 samples, or by more where these hold less than 60
    turns.
    """
    shaft, rate = specified_shaft_frequency(recording), recording.sample_rate
    if not shaft or recording.duration * shaft < _LEAST_TURNS or rate < 4 * _HARMONICS * shaft:
        return []
    count = max(_LONGEST, math.ceil(1.2 * _LEAST_TURNS * rate / shaft))
    signal = recording.signal if count >= recording.n_samples else recording.slice(0, count).signal
    for name, channel, row in zip(recording.channels, statistics, signal, strict=True):
        if channel.bad or np.ptp(row) == 0:
            continue
        spacing = _line_family(row, recording.sample_rate, shaft)
        if spacing is not None:
            message = (
                f"lines at multiples of {spacing:.3f} Hz ({spacing * 60:.0f} rev/min) and none at the stated "
                f'{shaft * 60:.0f} rev/min ({shaft:.3f} Hz); state speed = "{spacing * 60:.0f} rpm", or, if the speed '
                f'is right, sample_rate = "{rate * shaft / spacing:.5g} Hz".'
            )
            return [Finding("speed", "warning", name, message)]
    return []


def implausible_rate(recording: Recording) -> list[Finding]:
    """A warning where the sample rate is one that vibration is not measured with, as where kHz were
    taken for Hz.
    """
    rate, shaft = recording.sample_rate, specified_shaft_frequency(recording)
    least, most = _USUAL_RATES
    if recording.attributes.get("domain") == "angle":
        return []
    if rate > most and recording.unit in ("m/s^2", "1"):
        reason, meant = f"accelerometers are read at up to {most:g} Hz", f"{rate / 1000:g} Hz"
    elif rate < least and recording.unit == "m/s^2":
        reason, meant = f"accelerometers are read at {least:g} Hz and more", f"{rate:g} kHz"
    elif shaft and rate < _LEAST_PER_TURN * shaft:
        reason, meant = (
            f"that is {rate / shaft:.2g} samples in a turn at {shaft * 60:.5g} rev/min",
            f"{rate:g} kHz",
        )
    else:
        return []
    advice = f'if {meant} was meant, state sample_rate = "{meant}"'
    return [
        Finding("rate", "warning", None, f"the sample rate is {rate:g} Hz, and {reason}; {advice}.")
    ]


def _line_family(row: Float[np.ndarray, " time"], rate: float, shaft: float) -> float | None:
    """Spacing [Hz] of the lines that contradict `shaft`, or None."""
    lines = _lines(row, rate, (1 + _SPEED_SEARCH) * shaft * (_HARMONICS + 1))
    resolution = rate / len(row)
    width = math.ceil(2 * _SPEED_SEARCH * shaft * _HARMONICS / resolution) + 1
    candidates = shaft * np.linspace(1 - _SPEED_SEARCH, 1 + _SPEED_SEARCH, width)
    orders = np.arange(1, _HARMONICS + 1)
    distance = np.abs(candidates[:, None, None] * orders[None, :, None] - lines[None, None, :])
    hit = (
        (distance <= 1.5 * resolution).any(axis=2)
        if len(lines)
        else np.zeros((width, _HARMONICS), bool)
    )
    hits = hit.sum(axis=1)
    near = np.abs(candidates / shaft - 1) <= _SPEED_TOLERANCE
    best = int(np.argmax(hits))
    clear = (
        hits[best] >= _HARMONICS // 2 and hit[best, :3].sum() >= 2 and len(lines) <= 4 * _HARMONICS
    )
    if not clear or hits[near].max() > 2:
        return None
    matched = orders[hit[best]]
    nearest = lines[np.argmin(distance[best][hit[best]], axis=1)]
    return float(matched @ nearest / (matched @ matched))


def _lines(row: Float[np.ndarray, " time"], rate: float, top: float) -> Float[np.ndarray, " line"]:
    """Frequencies [Hz] below `top` that stand clear of the spectrum around them."""
    from scipy.ndimage import maximum_filter1d, median_filter

    # `signals` stands on a higher floor than recordings, so that its `power_density` cannot be
    # called here.
    time = np.arange(len(row)) - (len(row) - 1) / 2
    trend = (time @ row) / (time @ time) * time + row.mean()
    frequency = np.arange(len(row) // 2 + 1) * (rate / len(row))
    low = frequency <= top
    amplitude = np.abs(np.fft.rfft((row - trend) * np.hanning(len(row) + 1)[:-1])[low])
    amplitude[1:] *= math.sqrt(2)
    around = median_filter(amplitude, size=min(101, len(amplitude)))
    peak = (amplitude == maximum_filter1d(amplitude, 7)) & (amplitude > _LINE_RATIO * around)
    peak &= amplitude > 0.02 * amplitude.max()
    return frequency[low][peak]
