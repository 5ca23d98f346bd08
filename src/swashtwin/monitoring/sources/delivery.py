"""A recording as a source hands it over: a file, what is known of it, and when it arrived."""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import Any

from swashtwin.foundation import DataError, InputError, escape_controls, parse_quantity, plain_text
from swashtwin.recordings import SAMPLE_RATE_RANGE_HZ, require_sample_unit

QUANTITIES: Mapping[str, tuple[str, str]] = {
    "rate": ("sample_rate", "Hz"),
    "speed": ("speed", "rad/s"),
    "pressure": ("discharge_pressure", "Pa"),
    "temperature": ("oil_temperature", "K"),
}
"""Facts that are quantities: the key of an index entry that each is, and its SI unit."""
FACTS = ("time", "unit", "sensitivity", "channels", "count", "type", *QUANTITIES)
"""Facts that a message or an upload may specify of its recording."""
SAMPLE_TYPES: Mapping[str, str] = {
    "float32": "<f4",
    "float64": "<f8",
    "int16": "<i2",
    "int32": "<i4",
}
"""Types of the samples in a message, and their names in numpy."""
GROWN_FACT = "grown"
"""Fact of a file that grew: when its beginnings were delivered. No message can specify it."""
MAX_RECORDING_BYTES = 64 << 20
"""Bytes of a recording; larger ones are refused, so that memory stays bounded."""
MAX_FACT_LENGTH = 2000
"""Characters of a fact."""
MAX_NAME_LENGTH = 100
"""Characters of a file name; with the key of the spool it stays below the 255 bytes of a disk."""
MAX_DELIVERED_NAME_LENGTH = 300
"""Characters of a file's or machine's name as delivered, which the history keeps."""
MAX_SHOWN_LENGTH = 60
"""Characters of a wrong value in a message."""
MIN_TIME = datetime(1990, 1, 1, tzinfo=UTC)
"""Earliest time of a recording: clocks that were never set start in 1970 or 1980."""


REJECTION_REASONS: Mapping[str, str] = MappingProxyType(
    {
        "machine": "unknown machine",
        "double": "duplicate",
        "late": "too late",
        "broken": "not readable as configured",
        "unfit": "not fit for a verdict",
        "points": "too many operating points",
        "tags": "operating point unknown",
        "rest": "pump at rest",
        "grown": "grew after it was judged",
        "error": "error of the watch",
    }
)
"""Reasons why a recording was not judged."""


class RejectionError(DataError):
    """A delivery that cannot be judged, with the code of the reason."""

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(detail)
        self.reason = reason


class EarlyTimeError(InputError):
    """A time before any recording: the clock that stated it was never set."""


@dataclass(frozen=True)
class Delivery:
    """What is known of a file that a source delivered."""

    source: str
    """Name of the source."""
    file: str
    """Name of the file; its suffix decides the format."""
    received: datetime
    """When the file arrived (UTC)."""
    machine: str | None = None
    """Machine that the source specifies."""
    facts: Mapping[str, str] = field(default_factory=dict)
    """Further facts as text, by the names of `FACTS`."""
    problem: str | None = None
    """Why the file cannot be a recording, if that was known when it arrived."""

    def __post_init__(self) -> None:
        # A database takes neither a NUL nor half of a surrogate pair.
        for name in ("file", "machine"):
            text = getattr(self, name)
            if text is not None:
                shortened = escape_controls(text)[:MAX_DELIVERED_NAME_LENGTH]
                object.__setattr__(self, name, shortened)


Accept = Callable[[Delivery, bytes | Path], str]
"""Takes a delivery and its content (bytes, or a file that may be moved), and returns the SHA-256 of
the content when it is safe on the disk. If it raises OSError, the source offers the delivery again.
"""


def check_facts(facts: Mapping[str, Any]) -> dict[str, str]:
    """Return the facts as text, after each was checked.

    Raises
    ------
    InputError
        A fact is unknown, not text, too long, or invalid.

    Examples
    --------
    >>> check_facts({"speed": "1500 rpm"})
    {'speed': '1500 rpm'}
    """
    for name, text in facts.items():
        if name not in FACTS:
            raise InputError(f"Unknown fact {_shorten(name)}: use one of {', '.join(FACTS)}.")
        if not isinstance(text, str) or not text.strip() or len(text) > MAX_FACT_LENGTH:
            raise InputError(
                f"{name} = {_shorten(text)} must be text of 1 to {MAX_FACT_LENGTH} characters."
            )
        if name in QUANTITIES:
            _check_quantity(name, text)
        elif name == "time":
            read_time(text)
        elif name == "unit":
            require_sample_unit(text)
        elif name == "count" and not (text.isdecimal() and int(text) > 0):
            raise InputError(
                f"count = {_shorten(text)} must be the number of samples per channel, such as 8192."
            )
        elif name == "type" and text not in SAMPLE_TYPES:
            raise InputError(f"type = {_shorten(text)} must be one of {', '.join(SAMPLE_TYPES)}.")

    return {name: plain_text(text) for name, text in facts.items()}


def accept_facts(facts: Mapping[str, Any]) -> dict[str, str]:
    """Return the facts of `check_facts`, also with a time before 1990.

    The clock of the logger is wrong then, but its recording is as good as others and counts by its
    time of arrival.

    Raises
    ------
    InputError
        A fact is unknown, not text, too long, or invalid.
    """
    try:
        return check_facts(facts)
    except EarlyTimeError:
        others = {name: text for name, text in facts.items() if name != "time"}
        return {**check_facts(others), "time": plain_text(facts["time"])}


def _check_quantity(name: str, text: str) -> None:
    _, unit = QUANTITIES[name]
    value = parse_quantity(text, unit, name=name)
    if not math.isfinite(value) or value <= 0:
        raise InputError(f"{name} = {_shorten(text)} must be above zero.")

    min_rate, max_rate = SAMPLE_RATE_RANGE_HZ
    if name == "rate" and not min_rate <= value <= max_rate:
        raise InputError(
            f"rate = {_shorten(text)} must lie between {min_rate:g} and {max_rate:g} Hz."
        )


def read_time(text: str) -> datetime:
    """Return the time (UTC) of a text in ISO 8601; a text without a zone is in UTC.

    Raises
    ------
    InputError
        The text is not a time, or the time is before 1990 (`EarlyTimeError`).

    Examples
    --------
    >>> read_time("2026-11-23T14:00:00+01:00").isoformat()
    '2026-11-23T13:00:00+00:00'
    """
    try:
        time = datetime.fromisoformat(text)
        if time.tzinfo is None:
            time = time.replace(tzinfo=UTC)
        time = time.astimezone(UTC)
    except (ValueError, OverflowError):
        raise InputError(
            f'time = {_shorten(text)} must be ISO 8601, such as "2026-11-23T14:00:00Z".'
        ) from None

    if time < MIN_TIME:
        raise EarlyTimeError(
            f"time = {_shorten(text)} lies before 1990. Check the clock of the sensor."
        )
    return time


def entry_facts(facts: Mapping[str, str]) -> dict[str, Any]:
    """Return the facts of a delivery as those of an index entry, without its time.

    Examples
    --------
    >>> entry_facts({"rate": "25.6 kHz", "channels": "x, y", "time": "2026-11-23T14:00:00Z"})
    {'sample_rate': '25.6 kHz', 'names': ['x', 'y']}
    """
    entry: dict[str, Any] = {}
    for name, text in facts.items():
        if name in QUANTITIES:
            key, _ = QUANTITIES[name]
            entry[key] = text
    if "unit" in facts:
        entry["unit"] = facts["unit"]
    if "sensitivity" in facts:
        entry["sensitivity"] = tuple(channel_names(facts["sensitivity"]))
    if "channels" in facts:
        entry["names"] = channel_names(facts["channels"])
    return entry


def channel_names(text: str) -> list[str]:
    """Return the names between commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def safe_name(text: str) -> str:
    """Return the last part of a delivered file name, as a plain name on every system.

    The suffix stays, since it decides the format.

    Examples
    --------
    >>> safe_name("../../etc/pump 1.WAV"), safe_name("C:\\\\data\\\\a.csv"), safe_name("..")
    ('pump_1.WAV', 'a.csv', 'recording')
    """
    file_name = re.split(r"[/\\]", plain_text(text))[-1]
    name = re.sub(r"[^\w.+-]", "_", file_name).lstrip(".")
    return name[-MAX_NAME_LENGTH:].lstrip(".") or "recording"


def _shorten(value: object) -> str:
    text = repr(value)
    if len(text) > MAX_SHOWN_LENGTH:
        text = f"{text[:MAX_SHOWN_LENGTH]}..."
    return text
