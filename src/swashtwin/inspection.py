"""Is a measurement fit to learn from? What a careful person would look for before using it."""

import hashlib
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from swashtwin.errors import DataError, UnitError
from swashtwin.recording import Recording
from swashtwin.stored import StoredRecording, opened
from swashtwin.units import parse

Severity = Literal["error", "warning", "note"]

_CLIP_RUN = 3
"""Readings in a row at the extreme that count as clipped."""
_FLAT_READINGS, _FLAT_TIME = 20, 2e-3
"""A stretch of one value is flat from this many readings and this long [s] on."""
_OFFSET_RATIO = 5.0
"""Mean over standard deviation from which an offset is called large."""
_HARMONICS = 10
_LINE_RATIO = 6.0
"""Amplitude of a line over the median around it (16 dB)."""
_SPEED_SEARCH, _SPEED_TOLERANCE = 0.09, 0.02
"""How far from the stated speed another is looked for (no further: the neighbors of a nine-piston line lie 1/9 away),
and how far off it may be."""


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
    """What was found, with the numbers."""


@dataclass(frozen=True)
class ChannelReport:
    """Range of one channel, in the recording's unit; its missing readings are left out."""

    name: str
    """Name of the channel."""
    minimum: float
    """Least reading."""
    maximum: float
    """Greatest reading."""
    rms: float
    """Root mean square, offset included."""
    std: float
    """Standard deviation: the same without the offset."""


@dataclass(frozen=True)
class RecordingReport:
    """What one recording looks like."""

    recording_id: str
    """Name of the recording."""
    sample_rate: float
    """Readings per second [Hz]."""
    duration: float
    """Length [s]."""
    unit: str
    """Unit of the ranges."""
    label: str | None
    """Class."""
    channels: tuple[ChannelReport, ...]
    """Range of each channel."""
    findings: tuple[Finding, ...]
    """What is wrong with it."""


@dataclass(frozen=True)
class InspectionReport:
    """What a data set looks like."""

    recordings: tuple[RecordingReport, ...]
    """Each recording by itself."""
    findings: tuple[Finding, ...]
    """What shows only when recordings are compared."""

    @property
    def has_errors(self) -> bool:
        """Whether anything was found that must not be used."""
        own = [finding for report in self.recordings for finding in report.findings]
        return any(finding.severity == "error" for finding in [*own, *self.findings])

    def to_dict(self) -> dict[str, Any]:
        """The report as JSON can hold it; numbers that are not finite become None."""
        return _finite(
            {"recordings": [asdict(one) for one in self.recordings], "findings": [asdict(f) for f in self.findings]}
        )


def inspect_recording(recording: Recording) -> RecordingReport:
    """Range of each channel and everything suspicious about the recording."""
    findings = list(_unfit(recording))
    reports = []
    for name, row in zip(recording.channels, recording.signal, strict=True):
        good = row[np.isfinite(row)]
        values = good if len(good) else np.array([math.nan])
        rms = float(np.sqrt(np.mean(values**2)))
        reports.append(ChannelReport(name, float(values.min()), float(values.max()), rms, float(values.std())))
        if len(good) and np.ptp(good) > 0:
            findings += _channel_findings(name, row, recording)
    findings += _contradicted_speed(recording)
    return RecordingReport(
        recording.recording_id,
        recording.sample_rate,
        recording.duration,
        recording.unit,
        recording.label,
        tuple(reports),
        tuple(findings),
    )


def inspect_recordings(recordings: Sequence[Recording]) -> InspectionReport:
    """What each recording looks like, and what shows only when they are compared."""
    findings = [*_unequal(recordings), *_duplicates(recordings), *_thin_classes(recordings)]
    return InspectionReport(tuple(inspect_recording(recording) for recording in recordings), tuple(findings))


def refuse_unfit(recording: Recording | StoredRecording) -> None:
    """Nothing, or the error that says why nothing can be learned from the recording.

    Raises
    ------
    DataError
        Missing readings, a constant channel, gaps in time, or less than one revolution where the speed is known.
    """
    for finding in _unfit(recording):
        where = recording.recording_id if finding.channel is None else f"{recording.recording_id}, {finding.channel}"
        raise DataError(f"{where}: {finding.message}")


def stated_speed(recording: Recording | StoredRecording) -> float | None:
    """Revolutions per second [Hz] that the recording's condition or its attribute ``speed`` states, or None.

    Along the shaft's angle (`order_domain`) it is the frequency at which the turns are played back.
    """
    if recording.attributes.get("domain") == "angle":
        return recording.sample_rate / float(recording.attributes["readings_per_turn"])
    if recording.condition is not None:
        return recording.condition.shaft_frequency
    try:
        return parse(recording.attributes["speed"], "rad/s") / (2 * math.pi)
    except (KeyError, UnitError):
        return None


def _unfit(recording: Recording | StoredRecording) -> Iterator[Finding]:
    stored = opened(recording)
    ranges = [_Range() for _ in stored.channels]
    for block in stored.blocks():
        for seen, row in zip(ranges, block.signal, strict=True):
            seen.add(row)
    for name, seen in zip(stored.channels, ranges, strict=True):
        if seen.bad:
            message = (
                f"{seen.bad} of {stored.n_readings} readings are missing or infinite, the first at "
                f"{seen.first_bad / stored.sample_rate:.6g} s; cut them out or repair the file."
            )
            yield Finding("nan", "error", name, message)
        elif seen.least == seen.most:
            yield Finding("constant", "error", name, f"every reading is {seen.least:g}: a dead or unplugged sensor?")
    gaps = stored.attributes.get("time_gaps")
    if gaps:
        yield Finding("gaps", "error", None, f"the time column has gaps: {gaps}; split the file where they are.")
    shaft = stated_speed(stored)
    if shaft and stored.duration * shaft < 1:
        message = (
            f"{stored.duration:.4g} s is shorter than one revolution at {shaft * 60:.5g} rev/min "
            f"({1 / shaft:.4g} s); record longer, or correct the sample rate."
        )
        yield Finding("short", "error", None, message)


class _Range:
    """Least and greatest reading of a channel, and how many are no numbers, of what was seen so far."""

    def __init__(self) -> None:
        self.bad, self.first_bad, self.seen = 0, 0, 0
        self.least, self.most = math.inf, -math.inf

    def add(self, row: Float[np.ndarray, " time"]) -> None:
        least, most = float(row.min()), float(row.max())
        if not (math.isfinite(least) and math.isfinite(most)):
            bad = np.flatnonzero(~np.isfinite(row))
            self.first_bad = self.first_bad if self.bad else self.seen + int(bad[0])
            self.bad += len(bad)
        self.least, self.most = min(self.least, least), max(self.most, most)
        self.seen += len(row)


def _channel_findings(name: str, row: Float[np.ndarray, " time"], recording: Recording) -> Iterator[Finding]:
    clipped = clipped_readings(row)
    if clipped:
        message = (
            f"{clipped} readings ({clipped / len(row):.2%}) stand in a row at the extreme: the range was exceeded."
        )
        yield Finding("clipping", "warning", name, message)
    elif _touches_full_scale(row):
        message = (
            f"readings touch the converter's full scale ({row.min():.4g} to {row.max():.4g}): peaks may be cut off."
        )
        yield Finding("clipping", "warning", name, message)
    starts, lengths = _runs(row[1:] == row[:-1])
    interior = [not np.isclose(row[start], (np.nanmin(row), np.nanmax(row))).any() for start in starts]
    least = max(_FLAT_READINGS, _FLAT_TIME * recording.sample_rate)
    flat = (lengths + 1 >= least) & (np.array(interior, dtype=bool) | (clipped == 0))
    if flat.any():
        longest = int(np.argmax(np.where(flat, lengths, 0)))
        message = (
            f"{int(flat.sum())} flat stretches; the longest is {(lengths[longest] + 1) / recording.sample_rate:.4g} s "
            f"at {starts[longest] / recording.sample_rate:.4g} s: dropouts?"
        )
        yield Finding("flat", "warning", name, message)
    mean, std = float(np.nanmean(row[np.isfinite(row)])), float(np.nanstd(row[np.isfinite(row)]))
    if abs(mean) > _OFFSET_RATIO * std:
        message = (
            f"the offset {mean:.4g} {recording.unit} is {abs(mean) / std:.1f} times the vibration's std {std:.4g}."
        )
        yield Finding("offset", "warning", name, message)


def clipped_readings(row: Float[np.ndarray, " time"]) -> int:
    """Readings in runs at an extreme, where the extreme is crowded as only a stop makes it."""
    low, high = float(np.nanmin(row)), float(np.nanmax(row))
    if not (np.isfinite(low) and np.isfinite(high)):
        return 0
    total = 0
    for extreme in (low, high):
        at = np.abs(row - extreme) <= 1e-6 * (high - low)
        _, lengths = _runs(at)
        long = lengths[lengths >= _CLIP_RUN]
        near = np.count_nonzero(np.abs(row - extreme) <= 0.01 * (high - low)) - np.count_nonzero(at)
        if long.sum() > max(near, 2 * _CLIP_RUN - 1):
            total += int(long.sum())
    return total


def _touches_full_scale(row: Float[np.ndarray, " time"]) -> bool:
    """Whether several readings are -2^k or 2^k - 1 converter steps, as far as a converter of k + 1 bits reaches."""
    values = np.unique(row)
    if len(values) < 3 or not np.isfinite(values).all():
        return False
    step = float(np.diff(values).min())
    least, most = row.min() / step, row.max() / step
    if max(-least, most) > 2**24 or np.abs(values / step - np.round(values / step)).max() > 0.01:
        return False  # no converter's raw steps
    ends = [2**bits for bits in range(9, 24)]
    touching = 0
    if round(-least) in ends:
        touching += int(np.count_nonzero(row == values[0]))
    if round(most) + 1 in ends:
        touching += int(np.count_nonzero(row == values[-1]))
    return touching >= 2


def _runs(mask: Bool[np.ndarray, " n"]) -> tuple[Int[np.ndarray, " run"], Int[np.ndarray, " run"]]:
    """First index and length of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0]))))
    return edges[::2], edges[1::2] - edges[::2]


def _contradicted_speed(recording: Recording) -> list[Finding]:
    """A warning where a clear family of shaft lines stands beside the stated speed and none at it."""
    shaft = stated_speed(recording)
    if not shaft or recording.duration * shaft < 50 or recording.sample_rate < 4 * _HARMONICS * shaft:
        return []
    for name, row in zip(recording.channels, recording.signal, strict=True):
        if not np.isfinite(row).all() or np.ptp(row) == 0:
            continue
        found = _line_family(row, recording.sample_rate, shaft)
        if found is not None:
            message = (
                f"lines at multiples of {found:.3f} Hz ({found * 60:.0f} rev/min) and none at the stated "
                f"{shaft * 60:.0f} rev/min ({shaft:.3f} Hz): is the speed or the sample rate wrong?"
            )
            return [Finding("speed", "warning", name, message)]
    return []


def _line_family(row: Float[np.ndarray, " time"], rate: float, shaft: float) -> float | None:
    """Spacing [Hz] of the lines that contradict `shaft`, or None."""
    lines = _lines(row, rate, (1 + _SPEED_SEARCH) * shaft * (_HARMONICS + 1))
    resolution = rate / len(row)
    width = math.ceil(2 * _SPEED_SEARCH * shaft * _HARMONICS / resolution) + 1
    candidates = shaft * np.linspace(1 - _SPEED_SEARCH, 1 + _SPEED_SEARCH, width)
    orders = np.arange(1, _HARMONICS + 1)
    distance = np.abs(candidates[:, None, None] * orders[None, :, None] - lines[None, None, :])
    hit = (distance <= 1.5 * resolution).any(axis=2) if len(lines) else np.zeros((width, _HARMONICS), bool)
    hits = hit.sum(axis=1)
    near = np.abs(candidates / shaft - 1) <= _SPEED_TOLERANCE
    best = int(np.argmax(hits))
    clear = hits[best] >= _HARMONICS // 2 and hit[best, :3].sum() >= 2 and len(lines) <= 4 * _HARMONICS
    if not clear or hits[near].max() > 2:
        return None
    matched = orders[hit[best]]
    nearest = lines[np.argmin(distance[best][hit[best]], axis=1)]
    return float(matched @ nearest / (matched @ matched))


def _lines(row: Float[np.ndarray, " time"], rate: float, top: float) -> Float[np.ndarray, " line"]:
    """Frequencies [Hz] below `top` that stand clear of the spectrum around them."""
    from scipy.ndimage import maximum_filter1d, median_filter
    from scipy.signal import detrend, periodogram

    frequency, power = periodogram(detrend(row), rate, window="hann")
    kept = frequency <= top
    amplitude = np.sqrt(power[kept])
    around = median_filter(amplitude, size=min(101, len(amplitude)))
    peak = (amplitude == maximum_filter1d(amplitude, 7)) & (amplitude > _LINE_RATIO * around)
    peak &= amplitude > 0.02 * amplitude.max()
    return frequency[kept][peak]


def _unequal(recordings: Sequence[Recording]) -> Iterator[Finding]:
    """Rates, units and lengths that differ."""
    rates = _by_value((f"{recording.sample_rate:g} Hz", recording) for recording in recordings)
    if len(rates) > 1:
        said = "; ".join(f"{rate}: {_labels(group)}" for rate, group in rates.items())
        between = any(_labels(a) != _labels(b) for a, b in pairwise(rates.values()))
        advice = 'a network would learn the rate; give resample = "..." in the index.'
        yield Finding("rate", "error" if between else "warning", None, f"sample rates differ ({said}): {advice}")
    units = _by_value((recording.unit, recording) for recording in recordings)
    if len(units) > 1:
        said = "; ".join(f"{unit}: {_labels(group)}" for unit, group in units.items())
        yield Finding("unit", "error", None, f"units differ ({said}).")
    lengths = [recording.duration for recording in recordings]
    if lengths and max(lengths) > 3 * min(lengths):
        message = (
            f"lengths differ from {min(lengths):.4g} s to {max(lengths):.4g} s; long ones will outweigh the others."
        )
        yield Finding("length", "warning", None, message)


def _duplicates(recordings: Sequence[Recording]) -> Iterator[Finding]:
    rows = (
        (hashlib.sha256(np.ascontiguousarray(row).tobytes()).hexdigest(), recording)
        for recording in recordings
        for row in recording.signal
        if np.ptp(row) > 0
    )
    said = set()
    for group in _by_value(rows).values():
        ids = tuple(recording.recording_id for recording in group)
        if len(ids) > 1 and ids not in said:
            said.add(ids)
            message = (
                f"{', '.join(ids)} hold the same readings ({_labels(group)}); keep one, or a test will know its answer."
            )
            yield Finding("duplicate", "error", None, message)


def _thin_classes(recordings: Sequence[Recording]) -> Iterator[Finding]:
    for label, group in _by_value((recording.label or "", recording) for recording in recordings).items():
        if not label:
            yield Finding("unlabeled", "note", None, f"{len(group)} recordings have no class.")
            continue
        specimens = {recording.specimen for recording in group if recording.specimen}
        if len(group) == 1:
            message = f"{label} has one recording only: it cannot stand in training and in a test."
            yield Finding("one_recording", "warning", None, message)
        elif len(specimens) == 1:
            message = (
                f"{label} was measured on one specimen only ({specimens.pop()}): no test can show transfer to another."
            )
            yield Finding("one_specimen", "note", None, message)


def _by_value(pairs: Iterable[tuple[str, Recording]]) -> dict[str, list[Recording]]:
    groups: dict[str, list[Recording]] = {}
    for value, recording in pairs:
        groups.setdefault(value, []).append(recording)
    return groups


def _labels(recordings: Iterable[Recording]) -> str:
    return ", ".join(sorted({recording.label or "no class" for recording in recordings}))


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
