"""Whether anything can be learned from a recording at all: missing readings, dead channels, gaps, too short."""

import math
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import DataError, UnitError, parse
from swashtwin.recordings.checks.findings import Finding
from swashtwin.recordings.recording import Recording
from swashtwin.recordings.stored import StoredRecording, opened


def refuse_unfit(recording: Recording | StoredRecording) -> None:
    """Nothing, or the error that says why nothing can be learned from the recording.

    Raises
    ------
    DataError
        Missing readings, a constant channel, gaps in time, or less than one revolution where the speed is known.
    """
    for finding in unfit(recording):
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


def unfit(recording: Recording | StoredRecording) -> Iterator[Finding]:
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
