"""Whether anything can be learned from a recording at all: missing samples, dead channels, gaps, too short."""

from collections.abc import Iterator, Sequence

import numpy as np

from swashtwin.foundation import DataError
from swashtwin.recordings.checks.channel_statistics import ChannelRange, channel_ranges
from swashtwin.recordings.checks.findings import Finding
from swashtwin.recordings.grouping import stated_speed
from swashtwin.recordings.recording import Recording

_LARGEST = float(np.finfo(np.float32).max)
"""Windows are in single precision."""


def refuse_unfit(recording: Recording) -> None:
    """Refuse a recording from which nothing can be learned.

    Raises
    ------
    DataError
        Missing samples, a sample beyond single precision, a constant channel, gaps in time, or less than one revolution
        where the speed is known.
    """
    for finding in unfit(recording, channel_ranges(recording)):
        where = recording.recording_id if finding.channel is None else f"{recording.recording_id}, {finding.channel}"
        raise DataError(f"{where}: {finding.message}")


def unfit(recording: Recording, ranges: Sequence[ChannelRange]) -> Iterator[Finding]:
    """Why nothing can be learned from a recording.

    Parameters
    ----------
    ranges : of each channel.
    """
    for name, extent in zip(recording.channels, ranges, strict=True):
        if extent.bad:
            message = (
                f"{extent.bad} of {recording.n_samples} samples are missing or infinite, the first at "
                f"{extent.first_bad / recording.sample_rate:.6g} s; cut them out or repair the file."
            )
            yield Finding("nan", "error", name, message)
        elif (peak := max(extent.most, -extent.least)) > _LARGEST:
            message = (
                f"a sample of {peak:.3g} {recording.unit} is larger than a window can hold ({_LARGEST:.2g}); cut it "
                "out, or repair the file."
            )
            yield Finding("too_large", "error", name, message)
        elif extent.is_constant:
            yield Finding("constant", "error", name, f"every sample is {extent.least:g}: a dead or unplugged sensor?")
    gaps = recording.attributes.get("time_gaps")
    if gaps:
        yield Finding("gaps", "error", None, f"the time column has gaps: {gaps}; split the file where they are.")
    shaft = stated_speed(recording)
    if shaft and recording.duration * shaft < 1:
        message = (
            f"{recording.duration:.4g} s is shorter than one revolution at {shaft * 60:.5g} rev/min "
            f"({1 / shaft:.4g} s); record longer, or correct the sample rate."
        )
        yield Finding("short", "error", None, message)


def left_out(recording: Recording) -> Iterator[Finding]:
    """A note on the columns of a text table that hold no samples."""
    for key, reason in (("text_columns", "hold text or dates"), ("blank_columns", "are blank")):
        if names := recording.attributes.get(key):
            yield Finding("left_out", "note", None, f"columns that {reason} were left out: {names}.")
