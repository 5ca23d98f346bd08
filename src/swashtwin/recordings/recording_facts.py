"""Speed and pressure that recordings specify, and a summary of their facts for results."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from swashtwin.foundation import DataError, UnitError, parse_quantity
from swashtwin.recordings.recording import Recording

# Attributes that state when a recording was made; the first that it has counts.
_DATE_ATTRIBUTES = ("date", "datetime", "timestamp", "measured", "recorded", "time")

# Characters of a date: an attribute of another program may hold anything.
_MAX_DATE_LENGTH = 40

# Distinct values up to which all are listed.
_MAX_LISTED = 3

# Number of pistons above which an attribute is not one.
_MAX_PISTONS = 99


def specified_shaft_frequency(recording: Recording) -> float | None:
    """Return the shaft frequency [Hz] of a recording, or None if it specifies none.

    It is that of the operating point or of the attribute ``speed``. For a recording along the
    shaft's angle it is the frequency at which the turns are played back.

    Raises
    ------
    DataError
        A recording along the shaft's angle does not specify its samples per turn.
    """
    if recording.attributes.get("domain") == "angle":
        return recording.sample_rate / _samples_per_turn(recording)
    if recording.condition is not None:
        return recording.condition.shaft_frequency

    try:
        return parse_quantity(recording.attributes["speed"], "rad/s") / (2 * math.pi)
    except (KeyError, UnitError):
        return None


def _samples_per_turn(recording: Recording) -> float:
    text = recording.attributes.get("samples_per_turn")
    try:
        samples_per_turn = float(text or 0)
    except ValueError:
        samples_per_turn = 0.0

    if not 0 < samples_per_turn < math.inf:
        raise DataError(
            f"{recording.recording_id} runs along the shaft's angle, but its samples_per_turn "
            f"({text!r}) is not a positive number; specify it in the index, such as "
            'attributes = { samples_per_turn = "512" }.'
        )
    return samples_per_turn


def specified_speed(recording: Recording) -> float:
    """Return the angular speed of the shaft [rad/s], NaN if a recording specifies none."""
    return (specified_shaft_frequency(recording) or math.nan) * 2 * math.pi


def specified_pressure(recording: Recording) -> float:
    """Return the discharge pressure [Pa], NaN if a recording specifies none.

    It is that of the operating point or of the attribute ``discharge_pressure``.
    """
    if recording.condition is not None:
        return recording.condition.discharge_pressure

    try:
        return parse_quantity(str(recording.attributes["discharge_pressure"]), "Pa")
    except (KeyError, UnitError):
        return math.nan


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
