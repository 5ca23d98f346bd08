"""What recordings state of themselves, in words, for the head of a page."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from swashtwin.foundation import DataError
from swashtwin.recordings.grouping import stated_pressure, stated_speed
from swashtwin.recordings.recording import Recording

_DATES = ("date", "datetime", "timestamp", "measured", "recorded", "time")
"""Attributes that say when a recording was made."""
_MOST = 3
"""Values that are listed one by one."""


@dataclass(frozen=True)
class RecordingFacts:
    """Facts of one recording, or of several together; empty where none is stated."""

    machine: str = ""
    """Which machine."""
    date: str = ""
    """When it was recorded."""
    condition: str = ""
    """Speed and discharge pressure."""
    file: str = ""
    """File as the index or the command names it."""
    origin: str = ""
    """Where recordings come from that are of no machine, such as the virtual rig."""
    shaft: float | None = None
    """Shaft frequency [Hz], where it is one for all."""
    pistons: int | None = None
    """Number of pistons, where it is one for all."""


def facts_of(recordings: Sequence[Recording]) -> RecordingFacts:
    """What recordings state; several values are listed, or counted where there are more than three.

    Examples
    --------
    >>> import numpy as np
    >>> names = ("A", "B")
    >>> facts_of([Recording(np.ones((1, 4)), 1.0, name, specimen=name) for name in names]).machine
    'A, B'
    """
    dates = [
        next((str(item.attributes[name]) for name in _DATES if item.attributes.get(name)), "") for item in recordings
    ]
    origins = dict.fromkeys(str(recording.attributes.get("origin", "")) for recording in recordings)
    shafts = {_shaft(recording) for recording in recordings}
    counts = {str(recording.attributes.get("pistons", "")) for recording in recordings}
    pistons = {int(text) if text.isdecimal() and 0 < int(text) < 100 else None for text in counts}
    return RecordingFacts(
        machine=_listed(sorted(recording.specimen or "" for recording in recordings), "machines"),
        date=_listed(sorted(" ".join(date.replace("T", " ").split())[:40] for date in dates)),
        condition=_condition(recordings),
        file=_listed(sorted(str(recording.attributes.get("file", "")) for recording in recordings), "files"),
        origin="; ".join(origin for origin in origins if origin),
        shaft=shafts.pop() if len(shafts) == 1 else None,
        pistons=pistons.pop() if len(pistons) == 1 else None,
    )


def _listed(values: Iterable[str], noun: str = "", joint: str = ", ") -> str:
    """The distinct values, or, where there are more than three, how many or from which to which."""
    distinct = list(dict.fromkeys(filter(None, values)))
    if len(distinct) <= _MOST:
        return joint.join(distinct)
    return f"{len(distinct)} {noun}" if noun else f"{distinct[0]} to {distinct[-1]}"


def _condition(recordings: Sequence[Recording]) -> str:
    shafts = [60 * shaft for recording in recordings if (shaft := _shaft(recording)) is not None]
    pressures = [stated_pressure(recording) / 1e6 for recording in recordings]
    about = "about " if any(recording.has_speed for recording in recordings) else ""
    pairs = ((about, shafts, "rev/min"), ("", [value for value in pressures if not math.isnan(value)], "MPa"))
    return ", ".join(
        f"{prefix}{_listed((f'{value:.4g}' for value in sorted(values)), joint=' / ')} {unit}"
        for prefix, values, unit in pairs
        if values
    )


def _shaft(recording: Recording) -> float | None:
    try:
        return stated_speed(recording)
    except DataError:  # along an angle, without samples per turn
        return None
