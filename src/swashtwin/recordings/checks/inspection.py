"""Everything suspicious about recordings."""

from collections.abc import Callable, Sequence

from swashtwin.recordings.checks.channel_statistics import ChannelStatistics, channel_statistics
from swashtwin.recordings.checks.channels import channel_findings, least_flat
from swashtwin.recordings.checks.comparison import Comparison
from swashtwin.recordings.checks.findings import ChannelReport, Finding, InspectionReport, RecordingReport
from swashtwin.recordings.checks.speed_and_rate import contradicted_speed, implausible_rate
from swashtwin.recordings.checks.usability import left_out, unfit
from swashtwin.recordings.recording import Recording

_WHOLE = 1 << 24
"""Samples of all channels up to which a recording is read once and held in memory while it is looked at."""


def inspect_recording(recording: Recording) -> RecordingReport:
    """Range of each channel and everything suspicious about the recording."""
    return _report(recording, _statistics(recording))


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
    reports, comparison = [], Comparison(window)
    for number, stored in enumerate(recordings):
        if progress:
            progress(number, len(recordings))
        recording = stored.unloaded()
        statistics = _statistics(recording)
        reports.append(_report(recording, statistics))
        comparison.add(stored, statistics)
    if progress:
        progress(len(recordings), len(recordings))
    return InspectionReport(tuple(reports), (*unreadable, *comparison.findings()))


def _statistics(recording: Recording) -> list[ChannelStatistics]:
    if recording.n_samples * recording.n_channels <= _WHOLE:
        recording.samples.signal  # noqa: B018 - read once, for all that follows
    return channel_statistics(recording, least_flat(recording.sample_rate) - 1)


def _report(recording: Recording, statistics: list[ChannelStatistics]) -> RecordingReport:
    findings: list[Finding] = [*unfit(recording, statistics), *channel_findings(recording, statistics)]
    findings += [*contradicted_speed(recording, statistics), *implausible_rate(recording), *left_out(recording)]
    reports = [
        ChannelReport(name, *channel.extent, channel.rms, channel.std)
        for name, channel in zip(recording.channels, statistics, strict=True)
    ]
    return RecordingReport(
        recording.recording_id,
        recording.sample_rate,
        recording.duration,
        recording.unit,
        recording.label,
        tuple(reports),
        tuple(findings),
    )
