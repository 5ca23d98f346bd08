"""Report of everything suspicious about recordings, alone and compared with each other."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from swashtwin.foundation import Spelling, plural, spell_for_index
from swashtwin.recordings.channel_checks import check_channels, find_unusable
from swashtwin.recordings.channel_statistics import ChannelStatistics, compute_channel_statistics
from swashtwin.recordings.column_roles import EXCLUDED_COLUMNS
from swashtwin.recordings.dataset_checks import (
    class_name_findings,
    class_size_findings,
    duplicate_findings,
    layout_findings,
    length_findings,
    level_findings,
)
from swashtwin.recordings.findings import Finding, Severity, describe_others, join_names
from swashtwin.recordings.formats.raw_file import UNCLOSED
from swashtwin.recordings.manifest import Manifest, describe_content, join_manifests
from swashtwin.recordings.recording import Recording
from swashtwin.recordings.speed_checks import check_sample_rate, check_specified_speed
from swashtwin.recordings.window_checks import window_findings

# Samples of all channels up to which a recording is read once for all checks: 134 MB.
_MAX_LOADED_VALUES = 1 << 24

# Findings of one kind about the whole set, such as unreadable files, that are listed one by one.
_MAX_GENERAL_FINDINGS = 3

# Attribute that a reader leaves, kind of the note about it, and the beginning of its message.
#
# What was never closed is a warning.
_ATTRIBUTE_NOTES = (
    (UNCLOSED, "unclosed", "the recorder never closed this file, which is read to its end: "),
    ("left_out", "left_out", "vectors were skipped: "),
    ("text_columns", "left_out", "columns of text or dates were skipped: "),
    ("blank_columns", "left_out", "columns that are blank were skipped: "),
    ("counter_columns", "left_out", "columns that count the samples were skipped: "),
    ("spectrum_columns", "left_out", "spectra were skipped: "),
    ("clock_columns", "left_out", "columns without a unit that rise evenly were read as time: "),
    (
        "batch_columns",
        "clock",
        "the specified sample rate counts: these times were written in batches, and nothing is "
        "lost: ",
    ),
    *((key, "left_out", f"{text} were skipped: ") for key, text in EXCLUDED_COLUMNS.items()),
    ("contradicted", "contradicted", ""),
)


@dataclass(frozen=True)
class ChannelReport:
    """Range of the finite samples of one channel, in the recording's unit."""

    name: str
    """Name of the channel."""
    minimum: float
    """Smallest sample."""
    maximum: float
    """Largest sample."""
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
    """Problems of the recording."""

    def to_dict(self) -> dict[str, Any]:
        """Return the report as a dict."""
        return {**asdict(self), "findings": [finding.to_dict() for finding in self.findings]}


@dataclass(frozen=True)
class InspectionReport:
    """Ranges and findings of a data set."""

    recordings: tuple[RecordingReport, ...]
    """Report of each recording."""
    findings: tuple[Finding, ...]
    """Problems that only a comparison of recordings shows."""
    manifest: Manifest = field(default_factory=dict)
    """Content of each recording (`build_manifest`)."""

    def __repr__(self) -> str:
        sentences = [f"{severity}: {sentence}" for severity, sentence in self.merged(by_kind=True)]
        count = plural(len(self.recordings), "recording")
        summary = plural(len(sentences), "finding") if sentences else "sound"
        return "\n".join([f"<InspectionReport of {count}: {summary}>", *sentences])

    @property
    def has_errors(self) -> bool:
        """Whether a recording must not be used."""
        findings = list(self.findings)
        for report in self.recordings:
            findings.extend(report.findings)
        return any(finding.severity == "error" for finding in findings)

    def merged(
        self, *, by_kind: bool, spelling: Spelling = spell_for_index
    ) -> tuple[tuple[Severity, str], ...]:
        """Return (severity, sentence) of each finding, equal ones of several recordings as one.

        Parameters
        ----------
        by_kind : whether findings of one kind become one sentence too, that of the first.
        spelling : how settings are written for the reader.
        """
        groups: dict[tuple[str, str, str], list[tuple[str, Finding]]] = {}
        for report in self.recordings:
            for finding in report.findings:
                key = (finding.severity, finding.kind, "" if by_kind else finding.describe())
                groups.setdefault(key, []).append((report.recording_id, finding))

        sentences = [
            (group[0][1].severity, _merge_group(group, spelling)) for group in groups.values()
        ]
        return (*sentences, *_merge_general(self.findings, spelling))

    def to_dict(self) -> dict[str, Any]:
        """Return the report as nested dicts and tuples.

        The range of a channel without a finite sample is NaN.
        """
        return {
            "recordings": [report.to_dict() for report in self.recordings],
            "findings": [finding.to_dict() for finding in self.findings],
        }


def _merge_general(findings: Sequence[Finding], spelling: Spelling) -> list[tuple[Severity, str]]:
    """Return the first findings of each kind, of which the last counts the others."""
    groups: dict[tuple[str, str], list[Finding]] = {}
    for finding in findings:
        groups.setdefault((finding.severity, finding.kind), []).append(finding)

    sentences = []
    for group in groups.values():
        texts = [finding.describe(spelling) for finding in group[:_MAX_GENERAL_FINDINGS]]
        n_others = len(group) - len(texts)
        if n_others:
            texts[-1] += f" {describe_others(n_others)}"
        sentences += [(group[0].severity, text) for text in texts]
    return sentences


def _merge_group(group: Sequence[tuple[str, Finding]], spelling: Spelling) -> str:
    """Return one sentence for findings of one kind, each with the id of its recording."""
    first_id, first = group[0]
    ids = list(dict.fromkeys(recording_id for recording_id, _ in group))

    if all(finding.describe() == first.describe() for _, finding in group):
        channels = ", ".join(dict.fromkeys(f.channel for _, f in group if f.channel))
        source_name = f"in {len(ids)} recordings ({join_names(ids)})" if len(ids) > 1 else first_id
        suffix = ""
    else:
        channels = first.channel or ""
        source_name = first_id
        suffix = f" {describe_others(len(ids) - 1, ids[1:])}" if len(ids) > 1 else ""

    if channels:
        source_name = f"{source_name}, {channels}"
    return f"{source_name}: {first.describe(spelling)}{suffix}"


def inspect_recordings(
    recordings: Sequence[Recording],
    *,
    window: int = 2048,
    unreadable: Sequence[Finding] = (),
    progress: Callable[[int, int], None] | None = None,
) -> InspectionReport:
    """Return ranges and findings of each recording, and findings of their comparison.

    One recording at a time is in memory, and a long one in parts.

    Parameters
    ----------
    window : samples of the windows that are to be cut; 2048 is the default of training.
    unreadable : findings of `load_recordings` about files that could not be loaded.
    progress : called with the number of recordings that are done, and of all.
    """
    recordings = list(recordings)
    reports = []
    statistics = []
    contents = []
    for number, recording in enumerate(recordings, 1):
        with recording.loaded(_MAX_LOADED_VALUES):
            channels = compute_channel_statistics(recording)
            statistics.append(channels)
            reports.append(_report_recording(recording, channels))
            contents.append(describe_content(recording))
        if progress:
            progress(number, len(recordings))

    findings = [
        *unreadable,
        *layout_findings(recordings),
        *window_findings(recordings, window),
        *length_findings(recordings),
        *duplicate_findings(recordings, contents),
        *level_findings(recordings, statistics),
        *class_name_findings(recording.label for recording in recordings),
        *class_size_findings(recordings),
    ]
    manifest = join_manifests(
        {recording.recording_id: content}
        for recording, content in zip(recordings, contents, strict=True)
    )
    return InspectionReport(tuple(reports), tuple(findings), manifest)


def _report_recording(
    recording: Recording, statistics: Sequence[ChannelStatistics]
) -> RecordingReport:
    findings = [
        *find_unusable(recording, statistics),
        *check_channels(recording, statistics),
        *check_specified_speed(recording, statistics),
        *check_sample_rate(recording),
    ]
    for attribute, kind, prefix in _ATTRIBUTE_NOTES:
        if text := recording.attributes.get(attribute):
            severity: Severity = "warning" if attribute == UNCLOSED else "note"
            findings.append(Finding(kind, severity, None, f"{prefix}{text}."))

    channels = []
    for name, channel in zip(recording.channels, statistics, strict=True):
        minimum, maximum = channel.extent
        channels.append(ChannelReport(name, minimum, maximum, channel.rms, channel.std))

    return RecordingReport(
        recording_id=recording.recording_id,
        sample_rate=recording.sample_rate,
        duration=recording.duration,
        unit=recording.unit,
        label=recording.label,
        channels=tuple(channels),
        findings=tuple(findings),
    )
