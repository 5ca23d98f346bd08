"""Everything suspicious about recordings: each by itself, and what shows only when they are
compared.
"""

import math
import statistics as figures
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from swashtwin.foundation import DataError, plural
from swashtwin.pump import is_healthy
from swashtwin.recordings.channel_checks import (
    ChannelStatistics,
    Finding,
    Severity,
    channel_findings,
    channel_statistics,
    contradicted_speed,
    implausible_rate,
    listed,
    unfit,
)
from swashtwin.recordings.grouping import specified_shaft_frequency
from swashtwin.recordings.recording import Recording


@dataclass(frozen=True)
class ChannelReport:
    """Range of one channel, in the recording's unit; its missing samples are left out."""

    name: str
    """Name of the channel."""
    minimum: float
    """Least sample."""
    maximum: float
    """Greatest sample."""
    rms: float
    """Root mean square, offset included."""
    std: float
    """Standard deviation: the same without the offset."""


@dataclass(frozen=True)
class RecordingReport:
    """Ranges and findings of one recording."""

    recording_id: str
    """Name of the recording."""
    sample_rate: float
    """Samples per second [Hz]."""
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
    """Ranges and findings of a data set."""

    recordings: tuple[RecordingReport, ...]
    """Each recording by itself."""
    findings: tuple[Finding, ...]
    """What shows only when recordings are compared."""

    def __repr__(self) -> str:
        sentences = [f"{severity}: {sentence}" for severity, sentence in self.merged(by_kind=True)]
        return f"<InspectionReport of {plural(len(self.recordings), 'recording')}; {'; '.join(sentences) or 'sound'}>"

    @property
    def has_errors(self) -> bool:
        """Whether anything was found that must not be used."""
        findings = [finding for report in self.recordings for finding in report.findings]
        return any(finding.severity == "error" for finding in [*findings, *self.findings])

    def merged(self, *, by_kind: bool) -> tuple[tuple[Severity, str], ...]:
        """(severity, sentence) of each finding, equal ones of several recordings as one sentence.

        Parameters
        ----------
        by_kind : whether findings of one kind are one sentence too, that of the first.
        """
        groups: dict[tuple[str, ...], list[tuple[str, Finding]]] = {}
        for report in self.recordings:
            for finding in report.findings:
                key: tuple[str, ...] = (
                    finding.severity,
                    finding.kind,
                    *(() if by_kind else (finding.message,)),
                )
                groups.setdefault(key, []).append((report.recording_id, finding))
        sentences: list[tuple[Severity, str]] = []
        for members in groups.values():
            name, finding = members[0]
            names = list(dict.fromkeys(other for other, _ in members))
            equal = all(other.message == finding.message for _, other in members)
            named = dict.fromkeys(other.channel for _, other in members if other.channel)
            channels = ", ".join(named) if equal else finding.channel
            more = (
                ""
                if equal or len(names) < 2
                else f" ({finding.kind} in {len(names) - 1} more recordings: --json)"
            )
            where = (
                f"in {len(names)} recordings ({listed(names)})"
                if len(names) > 1 and equal
                else name
            )
            where += f", {channels}" if channels else ""
            sentences.append((finding.severity, f"{where}: {finding.message}{more}"))
        sentences += [(finding.severity, finding.message) for finding in self.findings]
        return tuple(sentences)

    def to_dict(self) -> dict[str, Any]:
        """The report as nested dicts and tuples; the range of a channel without a finite sample is
        NaN.
        """
        return asdict(self)


_WHOLE = 1 << 24
"""Samples of all channels up to which a recording is read once and held in memory while it is
looked at.
"""
_LEVEL_RATIO = 30.0
"""Level over the median of its class from which gain or unit must differ: faults change it less."""
_LONGEST, _LEAST, _DURATION = (
    8192,
    256,
    0.33,
)  # samples, samples, seconds of a window where nobody says


def inspect_recordings(
    recordings: Sequence[Recording],
    *,
    window: int = 2048,
    unreadable: Sequence[Finding] = (),
    progress: Callable[[int, int], None] | None = None,
) -> InspectionReport:
    """Ranges and findings of each recording, and what shows only when recordings are compared.

    One recording at a time is in memory, and a long one in parts.

    Parameters
    ----------
    window : samples of the windows that are to be cut; 2048 is what training takes by default.
    unreadable : what `load_recordings` reported of files that are not among the recordings.
    progress : called with the number of recordings that are done, and of all.
    """
    recordings = list(recordings)
    reports, statistics, hashes = [], [], []
    for number, stored in enumerate(recordings, 1):
        recording = stored.unloaded()
        report, channels = _report(recording)
        reports.append(report)
        statistics.append(channels)
        hashes.append(recording.content_hashes())
        if progress:
            progress(number, len(recordings))
    lengths = sorted(recording.duration for recording in recordings) or [0.0]
    message = f"lengths differ from {lengths[0]:.4g} s to {lengths[-1]:.4g} s; long ones will outweigh the others."
    findings = [
        *layout_findings(recordings),
        *window_findings(recordings, window),
        *([Finding("length", "warning", None, message)] if lengths[-1] > 3 * lengths[0] else []),
        *_duplicates(recordings, hashes),
        *_odd_levels(recordings, statistics),
        *healthy_class_findings(recording.label for recording in recordings),
        *_thin_classes(recordings),
    ]
    return InspectionReport(tuple(reports), (*unreadable, *findings))


def _report(recording: Recording) -> tuple[RecordingReport, list[ChannelStatistics]]:
    if recording.n_samples * recording.n_channels <= _WHOLE:
        recording.samples.signal  # noqa: B018 - read once, for all that follows
    statistics = channel_statistics(recording)
    findings: list[Finding] = [
        *unfit(recording, statistics),
        *channel_findings(recording, statistics),
    ]
    findings += [*contradicted_speed(recording, statistics), *implausible_rate(recording)]
    for key, kind, words in (
        ("text_columns", "left_out", "columns that hold text or dates were left out: "),
        ("blank_columns", "left_out", "columns that are blank were left out: "),
        ("counter_columns", "left_out", "columns that count the samples were left out: "),
        (
            "clock_columns",
            "left_out",
            "columns without a unit that rise evenly were taken for the time: ",
        ),
        ("other_columns", "left_out", "columns that are no vibration were left out: "),
        ("contradicted", "contradicted", ""),
    ):
        if text := recording.attributes.get(key):
            findings.append(Finding(kind, "note", None, f"{words}{text}."))
    reports = [
        ChannelReport(name, *channel.extent, channel.rms, channel.std)
        for name, channel in zip(recording.channels, statistics, strict=True)
    ]
    facts = (
        recording.recording_id,
        recording.sample_rate,
        recording.duration,
        recording.unit,
        recording.label,
    )
    return RecordingReport(*facts, tuple(reports), tuple(findings)), statistics


def layout_findings(recordings: Sequence[Recording]) -> Iterator[Finding]:
    """An error for each of rate, channels and unit that is not the same in all recordings."""
    for kind, noun, words, advice in (
        ("rate", "sample rates", lambda recording: f"{recording.sample_rate:g} Hz",
         'a network would learn the rate; give resample = "..." in the index'),
        ("channels", "channels", lambda recording: ", ".join(recording.channels),
         'pick the same in each with channels = ["..."], and give them the same names = ["..."] in the index'),
        ("unit", "units", lambda recording: recording.unit,
         'state what one sample is in each with sensitivity = "..." in the index'),
    ):  # fmt: skip
        groups = _by_value((words(recording), recording) for recording in recordings)
        if len(groups) > 1:
            parts = "; ".join(
                f"{value}: {listed([recording.recording_id for recording in group])} ({_labels(group)})"
                for value, group in groups.items()
            )
            yield Finding(kind, "error", None, f"{noun} differ ({parts}): {advice}.")


def window_findings(
    recordings: Sequence[Recording], length: int, *, allow_partial_revolution: bool = False
) -> Iterator[Finding]:
    """A warning where recordings are too short for one window, or a window is shorter than one turn
    of the shaft.
    """
    short = sorted(
        (item for item in recordings if item.n_samples < length), key=lambda item: item.n_samples
    )
    if short:
        message = (
            f"{short[0].recording_id} has {short[0].n_samples} samples ({short[0].duration:.3g} s), too few for one "
            f"window of {length}{_more(short)}; shorten the window or leave the recording out."
        )
        yield Finding("short_window", "warning", None, message)
    partial = [
        recording for recording in recordings if recording.condition and _turn(recording) > length
    ]
    if partial and not allow_partial_revolution:
        slowest = max(partial, key=_turn)
        advice = f"take a window of {_turn(slowest)} or more"
        if slowest.n_samples < _turn(slowest):
            advice = f"it has {slowest.n_samples} samples only: record longer, or leave it out"
        message = (
            f"a window of {length} samples is shorter than one revolution of {slowest.recording_id}{_more(partial)} "
            f"({60 * (specified_shaft_frequency(slowest) or 0):.0f} rev/min at {slowest.sample_rate:g} Hz); {advice}."
        )
        yield Finding("partial_turn", "warning", None, message)


def default_window(recordings: Sequence[Recording]) -> int:
    """Samples of the windows that recordings are cut into where nobody says: a power of two.

    0.32 s or more, 8,192 samples at least, so that a spectrum tells the shaft's orders apart; but
    no more than a quarter of most recordings, nor than the shortest recording holds.

    Raises
    ------
    DataError
        There is no recording.
    """
    if not recordings:
        raise DataError("no recording to cut windows from; check the folder or the selection.")
    counts = [recording.n_samples for recording in recordings]
    rate = max(recording.sample_rate for recording in recordings)
    longest = max(_LONGEST, _power_of_two(_DURATION * rate))
    usual = min(longest, _power_of_two(figures.median(counts) / 4))
    return max(_LEAST, min(usual, _power_of_two(min(counts))))


def _power_of_two(samples: float) -> int:
    return 1 << max(0, math.floor(math.log2(max(samples, 1.0))))


def _more(recordings: Sequence[Recording]) -> str:
    count = len(recordings) - 1
    return f" ({count} other recording{'s' * (count > 1)} too)" if count else ""


def _turn(recording: Recording) -> int:
    """Samples of one revolution, 0 where the speed is not stated."""
    shaft = specified_shaft_frequency(recording)
    return math.ceil(recording.sample_rate / shaft * (1 - 1e-9)) if shaft else 0


def _by_value(pairs: Iterable[tuple[str, Recording]]) -> dict[str, list[Recording]]:
    groups: dict[str, list[Recording]] = {}
    for value, recording in pairs:
        groups.setdefault(value, []).append(recording)
    return groups


def _duplicates(
    recordings: Sequence[Recording], hashes: Sequence[Sequence[str]]
) -> Iterator[Finding]:
    pairs = zip(recordings, hashes, strict=True)
    groups = _by_value((digest, recording) for recording, digests in pairs for digest in digests)
    members = {
        tuple(recording.recording_id for recording in group): group for group in groups.values()
    }
    for ids, group in members.items():
        if len(ids) > 1:
            message = f"{', '.join(ids)} hold the same samples ({_labels(group)}); keep one, or a test will know its answer."
            yield Finding("duplicate", "error", None, message)


def _odd_levels(
    recordings: Sequence[Recording], statistics: Sequence[list[ChannelStatistics]]
) -> Iterator[Finding]:
    levels: dict[tuple[str | None, str, str], list[tuple[float, Recording]]] = {}
    for recording, channels in zip(recordings, statistics, strict=True):
        for name, channel in zip(recording.channels, channels, strict=True):
            if channel.std > 0 and math.isfinite(channel.std):
                key = recording.label, recording.unit, name
                levels.setdefault(key, []).append((channel.std, recording))
    found: dict[tuple[str, str], list[str]] = {}
    for (label, unit, name), members in levels.items():
        usual = figures.median_low([level for level, _ in members])
        odd = [
            member
            for member in members
            if abs(math.log(member[0] / usual)) > math.log(_LEVEL_RATIO)
        ]
        if odd:
            level, names = odd[0][0], listed([recording.recording_id for _, recording in odd])
            words = (
                f"{level:.3g} {unit} in {name} ({level / usual:.3g} times the usual {usual:.3g})"
            )
            found.setdefault((names, label or "no class"), []).append(words)
    for (names, label), parts in found.items():
        message = f"the level of {names} is not that of {label}: {', '.join(parts)}; another unit or sensitivity?"
        yield Finding("level", "warning", None, message)


def healthy_class_findings(labels: Iterable[str | None]) -> Iterator[Finding]:
    """A note where classes of several names are all healthy."""
    names = sorted({label for label in labels if label and is_healthy(label)})
    if len(names) > 1:
        others = "one" if len(names) == 2 else "all but one"
        message = f"{len(names)} classes are healthy by name: {', '.join(names)}; relabel {others}."
        yield Finding("several_healthy", "note", None, message)


def _thin_classes(recordings: Sequence[Recording]) -> Iterator[Finding]:
    """Classes of one recording or one specimen, and recordings without a class."""
    for label, group in _by_value(
        (recording.label or "", recording) for recording in recordings
    ).items():
        if not label:
            yield Finding(
                "unlabeled", "note", None, f"{plural(len(group), 'recording')} without a class."
            )
            continue
        specimens = {recording.specimen for recording in group if recording.specimen}
        if len(group) == 1:
            message = f"{label} has one recording only: it cannot stand in training and in a test."
            yield Finding("one_recording", "warning", None, message)
        elif len(specimens) == 1:
            message = f"{label} was measured on one specimen only ({specimens.pop()}): no test can show transfer to another."
            yield Finding("one_specimen", "note", None, message)


def _labels(recordings: Iterable[Recording]) -> str:
    return ", ".join(sorted({recording.label or "no class" for recording in recordings}))
