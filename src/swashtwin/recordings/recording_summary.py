"""Facts of one recording, or of several together, as results show them."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from swashtwin.foundation import DataError
from swashtwin.recordings.recording import Recording
from swashtwin.recordings.specified_facts import specified_pressure, specified_shaft_frequency

# Attributes that state when a recording was made; the first that it has counts.
_DATE_ATTRIBUTES = ("date", "datetime", "timestamp", "measured", "recorded", "time")

# Characters of a date: an attribute of another program may hold anything.
_MAX_DATE_LENGTH = 40

# Distinct values up to which all are listed.
_MAX_LISTED = 3

# Number of pistons above which an attribute is not one.
_MAX_PISTONS = 99


@dataclass(frozen=True)
class RecordingSummary:
    """Facts of one recording, or of several together; empty if none specifies them."""

    machine: str = ""
    """Machine that was measured."""
    date: str = ""
    """Date of the measurement."""
    condition: str = ""
    """Speed and discharge pressure."""
    file: str = ""
    """File as the index or the command names it."""
    origin: str = ""
    """Source of recordings that are not of a machine, such as the virtual rig."""
    shaft: float | None = None
    """Shaft frequency [Hz], if it is the same for all."""
    pistons: int | None = None
    """Number of pistons, if it is the same for all."""


def summarize_recordings(recordings: Sequence[Recording]) -> RecordingSummary:
    """Return the facts of recordings; several values are listed, or counted if they are many.

    Examples
    --------
    >>> import numpy as np
    >>> names = ("A", "B")
    >>> recordings = [Recording(np.ones((1, 4)), 1.0, name, specimen=name) for name in names]
    >>> summarize_recordings(recordings).machine
    'A, B'
    """
    origins = _attribute_values(recordings, "origin")
    files = _attribute_values(recordings, "file")
    machines = [recording.specimen or "" for recording in recordings]
    shafts = {_shaft_frequency(recording) for recording in recordings}
    pistons = {_parse_pistons(text) for text in _attribute_values(recordings, "pistons")}

    return RecordingSummary(
        machine=_list_or_count(sorted(machines), "machines"),
        date=_list_or_span(sorted(_date(recording) for recording in recordings)),
        condition=_describe_condition(recordings),
        file=_list_or_count(sorted(files), "files"),
        origin="; ".join(filter(None, dict.fromkeys(origins))),
        shaft=shafts.pop() if len(shafts) == 1 else None,
        pistons=pistons.pop() if len(pistons) == 1 else None,
    )


def _attribute_values(recordings: Iterable[Recording], name: str) -> list[str]:
    return [str(recording.attributes.get(name, "")) for recording in recordings]


def _parse_pistons(text: str) -> int | None:
    return int(text) if text.isdecimal() and 0 < int(text) <= _MAX_PISTONS else None


def _date(recording: Recording) -> str:
    """Return the date of a recording with single spaces, cut at a length."""
    for name in _DATE_ATTRIBUTES:
        if date := recording.attributes.get(name):
            return " ".join(str(date).replace("T", " ").split())[:_MAX_DATE_LENGTH]
    return ""


def _distinct(values: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(filter(None, values)))


def _list_or_count(values: Iterable[str], noun: str) -> str:
    distinct = _distinct(values)
    return ", ".join(distinct) if len(distinct) <= _MAX_LISTED else f"{len(distinct)} {noun}"


def _list_or_span(values: Iterable[str], separator: str = ", ") -> str:
    """Return all values, or first and last of many in order."""
    distinct = _distinct(values)
    if len(distinct) <= _MAX_LISTED:
        return separator.join(distinct)
    return f"{distinct[0]} to {distinct[-1]}"


def _describe_condition(recordings: Sequence[Recording]) -> str:
    speeds = []
    for recording in recordings:
        shaft_frequency = _shaft_frequency(recording)
        if shaft_frequency is not None:
            speeds.append(60 * shaft_frequency)
    pressures = [specified_pressure(recording) / 1e6 for recording in recordings]
    known_pressures = [pressure for pressure in pressures if not math.isnan(pressure)]

    parts = []
    if speeds:
        texts = _list_or_span([f"{speed:.4g}" for speed in sorted(speeds)], " / ")
        is_varying = any(recording.has_speed for recording in recordings)
        parts.append(f"{'about ' if is_varying else ''}{texts} rev/min")
    if known_pressures:
        texts = _list_or_span([f"{pressure:.4g}" for pressure in sorted(known_pressures)], " / ")
        parts.append(f"{texts} MPa")
    return ", ".join(parts)


def _shaft_frequency(recording: Recording) -> float | None:
    try:
        return specified_shaft_frequency(recording)
    except DataError:  # along the shaft's angle, without samples per turn
        return None
