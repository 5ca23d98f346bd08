"""Findings about recordings, and the ranges of their channels."""

import math
from dataclasses import asdict, dataclass
from typing import Any, Literal

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

    @property
    def has_errors(self) -> bool:
        """Whether anything was found that must not be used."""
        findings = [finding for report in self.recordings for finding in report.findings]
        return any(finding.severity == "error" for finding in [*findings, *self.findings])

    def to_dict(self) -> dict[str, Any]:
        """The report as JSON can hold it; numbers that are not finite become None."""
        return _finite(
            {
                "recordings": [asdict(report) for report in self.recordings],
                "findings": [asdict(finding) for finding in self.findings],
            }
        )


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
