"""Everything suspicious about recordings."""

import math
from collections.abc import Sequence

import numpy as np

from swashtwin.recordings.checks.channels import channel_findings
from swashtwin.recordings.checks.comparison import duplicates, thin_classes, unequal
from swashtwin.recordings.checks.findings import ChannelReport, InspectionReport, RecordingReport
from swashtwin.recordings.checks.speed_and_rate import contradicted_speed, implausible_rate
from swashtwin.recordings.checks.usability import left_out, unfit
from swashtwin.recordings.recording import Recording


def inspect_recording(recording: Recording) -> RecordingReport:
    """Range of each channel and everything suspicious about the recording."""
    findings = list(unfit(recording))
    reports = []
    for name, row in zip(recording.channels, recording.signal, strict=True):
        finite = row[np.isfinite(row)]
        values = finite if len(finite) else np.array([math.nan])
        rms = float(np.sqrt(np.mean(values**2)))
        reports.append(ChannelReport(name, float(values.min()), float(values.max()), rms, float(values.std())))
        if len(finite) and np.ptp(finite) > 0:
            findings += channel_findings(name, row, recording)
    findings += [*contradicted_speed(recording), *implausible_rate(recording), *left_out(recording)]
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
    """Ranges and findings of each recording, and what shows only when recordings are compared."""
    findings = [*unequal(recordings), *duplicates(recordings), *thin_classes(recordings)]
    return InspectionReport(tuple(inspect_recording(recording) for recording in recordings), tuple(findings))
