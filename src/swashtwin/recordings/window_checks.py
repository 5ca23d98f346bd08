"""Length of the windows that recordings are cut into, and whether it fits them."""

import math
import statistics
from collections.abc import Iterator, Sequence

from swashtwin.foundation import DataError, plural
from swashtwin.recordings.findings import Finding
from swashtwin.recordings.recording import Recording
from swashtwin.recordings.recording_facts import specified_shaft_frequency

# Time [s] that a default window spans, so that a spectrum resolves the shaft's orders.
#
# It is rounded down to a power of two: at 25.6 kHz to 8192 samples.
_MIN_WINDOW_TIME_S = 0.33

# Samples of a default window in long recordings.
_MIN_LONG_WINDOW = 8192

# Samples of a default window in short recordings.
_MIN_WINDOW = 256

# Windows that the median recording holds, so that there is something to learn from.
_MIN_WINDOWS = 4


def window_findings(
    recordings: Sequence[Recording], length: int, *, allow_partial_revolution: bool = False
) -> Iterator[Finding]:
    """Yield a warning for recordings too short for a window, or for windows below one turn.

    Parameters
    ----------
    length : samples of a window.
    """
    short = [recording for recording in recordings if recording.n_samples < length]
    if short:
        shortest = min(short, key=lambda recording: recording.n_samples)
        message = (
            f"{shortest.recording_id} has {shortest.n_samples} samples "
            f"({shortest.duration:.3g} s), too few for one window of "
            f"{length}{_count_others(short)}; shorten the window or remove the recording."
        )
        yield Finding("short_window", "warning", None, message)

    partial = []
    for recording in recordings:
        if recording.condition and _samples_per_turn(recording) > length:
            partial.append(recording)
    if partial and not allow_partial_revolution:
        slowest = max(partial, key=_samples_per_turn)
        samples_per_turn = _samples_per_turn(slowest)
        if slowest.n_samples < samples_per_turn:
            advice = f"it has only {slowest.n_samples} samples: record longer, or remove it"
        else:
            advice = f"use a window of {samples_per_turn} or more"
        speed = 60 * (specified_shaft_frequency(slowest) or 0)
        message = (
            f"a window of {length} samples is shorter than one revolution of "
            f"{slowest.recording_id}{_count_others(partial)} ({speed:.0f} rev/min at "
            f"{slowest.sample_rate:g} Hz); {advice}."
        )
        yield Finding("partial_turn", "warning", None, message)


def default_window(recordings: Sequence[Recording]) -> int:
    """Return the default number of samples of a window, a power of two.

    It spans 0.32 s or more, and 8,192 samples at least, so that a spectrum resolves the shaft's
    orders; but no more than a quarter of most recordings, nor than the shortest recording.

    Raises
    ------
    DataError
        There is no recording.
    """
    if not recordings:
        raise DataError("No recording to cut windows from; check the folder or the selection.")

    counts = [recording.n_samples for recording in recordings]
    max_rate = max(recording.sample_rate for recording in recordings)
    long_window = max(_MIN_LONG_WINDOW, _round_to_power_of_two(_MIN_WINDOW_TIME_S * max_rate))
    fitting = _round_to_power_of_two(statistics.median(counts) / _MIN_WINDOWS)
    possible = _round_to_power_of_two(min(counts))
    return max(_MIN_WINDOW, min(long_window, fitting, possible))


def _round_to_power_of_two(samples: float) -> int:
    """Return the largest power of two up to a number of samples."""
    return 1 << max(0, math.floor(math.log2(max(samples, 1.0))))


def _count_others(recordings: Sequence[Recording]) -> str:
    count = len(recordings) - 1
    return f" ({plural(count, 'other recording')} too)" if count else ""


def _samples_per_turn(recording: Recording) -> int:
    """Return the samples of one revolution, 0 if the speed is not specified."""
    shaft = specified_shaft_frequency(recording)
    # A whole number of samples must not become one more by the rounding of the division.
    return math.ceil(recording.sample_rate / shaft * (1 - 1e-9)) if shaft else 0
