"""What recordings must have in common to be cut into windows of one length: rate, channels, unit, length."""

import math
import statistics
from collections.abc import Iterable, Iterator, Sequence

from swashtwin.foundation import DataError
from swashtwin.recordings.checks.findings import Finding
from swashtwin.recordings.grouping import stated_speed
from swashtwin.recordings.recording import Recording

_SHOWN = 3
_LONGEST, _LEAST, _DURATION = 8192, 256, 0.33  # samples, samples, seconds of a window where nobody says


def layout_findings(recordings: Sequence[Recording]) -> Iterator[Finding]:
    """An error for each of rate, channels and unit that is not the same in all recordings."""
    for kind, noun, words, advice in (
        ("rate", "sample rates", lambda recording: f"{recording.sample_rate:g} Hz",
         'a network would learn the rate; give resample = "..." in the index'),
        ("channels", "channels", lambda recording: ", ".join(recording.channels),
         'pick the same in each with channels = ["..."], and give them the same names = ["..."] in the index'),
        ("unit", "units", lambda recording: recording.unit,
         'state what one sample is in each with calibration_factor = "..." in the index'),
    ):  # fmt: skip
        groups = by_value((words(recording), recording) for recording in recordings)
        if len(groups) > 1:
            listed = "; ".join(f"{value}: {_members(group)}" for value, group in groups.items())
            yield Finding(kind, "error", None, f"{noun} differ ({listed}): {advice}.")


def window_findings(
    recordings: Sequence[Recording], length: int, *, allow_partial_revolution: bool = False
) -> Iterator[Finding]:
    """A warning where recordings are too short for one window, or a window is shorter than one turn of the shaft."""
    short = sorted((item for item in recordings if item.n_samples < length), key=lambda item: item.n_samples)
    if short:
        message = (
            f"{short[0].recording_id} has {short[0].n_samples} samples ({short[0].duration:.3g} s), too few for one "
            f"window of {length}{_more(short)}; shorten the window or leave the recording out."
        )
        yield Finding("short_window", "warning", None, message)
    turns = [(_turn(recording), recording) for recording in recordings if recording.condition is not None]
    partial = [recording for samples, recording in turns if samples > length]
    if partial and not allow_partial_revolution:
        slowest = max(partial, key=_turn)
        message = (
            f"a window of {length} samples is shorter than one revolution of {slowest.recording_id}{_more(partial)} "
            f"({60 * (stated_speed(slowest) or 0):.0f} rev/min at {slowest.sample_rate:g} Hz); take length "
            f"{_turn(slowest)} or more, or allow_partial_revolution=True."
        )
        yield Finding("partial_turn", "warning", None, message)


def usual_window(recordings: Sequence[Recording]) -> int:
    """Samples of the windows that recordings are cut into where nobody says: a power of two.

    0.32 s or more, 8,192 samples at least, so that a spectrum tells the shaft's orders apart; but no more than a
    quarter of most recordings, nor than the shortest recording holds.

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
    usual = min(longest, _power_of_two(statistics.median(counts) / 4))
    return max(_LEAST, min(usual, _power_of_two(min(counts))))


def _power_of_two(samples: float) -> int:
    """The greatest power of two that is not above it; 1 at least."""
    return 1 << max(0, math.floor(math.log2(max(samples, 1.0))))


def _more(recordings: Sequence[Recording]) -> str:
    count = len(recordings) - 1
    return f" ({count} other recording{'s' * (count > 1)} too)" if count else ""


def _turn(recording: Recording) -> int:
    """Samples of one revolution, 0 where the speed is not stated."""
    shaft = stated_speed(recording)
    return math.ceil(recording.sample_rate / shaft * (1 - 1e-9)) if shaft else 0


def by_value(pairs: Iterable[tuple[str, Recording]]) -> dict[str, list[Recording]]:
    """Recordings of each value."""
    groups: dict[str, list[Recording]] = {}
    for value, recording in pairs:
        groups.setdefault(value, []).append(recording)
    return groups


def _members(recordings: Sequence[Recording]) -> str:
    """Names of a few recordings, how many more there are, and their classes."""
    labels = ", ".join(sorted({recording.label or "no class" for recording in recordings}))
    names = ", ".join(recording.recording_id for recording in recordings[:_SHOWN])
    return f"{names}{f' and {len(recordings) - _SHOWN} more' if len(recordings) > _SHOWN else ''} ({labels})"
