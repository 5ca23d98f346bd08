"""Findings about recordings, and the ranges of their channels."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

from swashtwin.foundation import plural

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
                key: tuple[str, ...] = (finding.severity, finding.kind, *(() if by_kind else (finding.message,)))
                groups.setdefault(key, []).append((report.recording_id, finding))
        sentences: list[tuple[Severity, str]] = []
        for members in groups.values():
            name, finding = members[0]
            names = list(dict.fromkeys(other for other, _ in members))
            equal = all(other.message == finding.message for _, other in members)
            named = dict.fromkeys(other.channel for _, other in members if other.channel)
            channels = ", ".join(named) if equal else finding.channel
            more = "" if equal or len(names) < 2 else f" ({finding.kind} in {len(names) - 1} more recordings: --json)"
            where = f"in {len(names)} recordings ({listed(names)})" if len(names) > 1 and equal else name
            where += f", {channels}" if channels else ""
            sentences.append((finding.severity, f"{where}: {finding.message}{more}"))
        sentences += [(finding.severity, finding.message) for finding in self.findings]
        return tuple(sentences)

    def to_dict(self) -> dict[str, Any]:
        """The report as nested dicts and tuples; the range of a channel without a finite sample is NaN."""
        return asdict(self)
