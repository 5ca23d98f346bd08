"""A recording as a source hands it over: a file, what was said of it, and when it came."""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
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
"""What a message or an upload may state of its recording."""
TYPES: Mapping[str, str] = {"float32": "<f4", "float64": "<f8", "int16": "<i2", "int32": "<i4"}
"""Types of samples behind a message's line, and how numpy calls them."""
LARGEST = 64 << 20
"""Bytes of a recording; larger ones are not taken, so that memory stays bounded."""
_LONGEST = 2000
"""Characters of a fact."""
_LONGEST_NAME = 100
_LONGEST_STATED = 300
_EARLIEST = datetime(1990, 1, 1, tzinfo=UTC)


class RejectionError(DataError):
    """A delivery that cannot be judged, with the code of the reason."""

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(detail)
        self.reason = reason


@dataclass(frozen=True)
class Delivery:
    """What is known of a file that a source delivered."""

    source: str
    """Name of the source."""
    file: str
    """Name of the file, which tells its format by its suffix."""
    received: datetime
    """When it came (UTC)."""
    machine: str | None = None
    """Machine that the source states."""
    facts: Mapping[str, str] = field(default_factory=dict)
    """Further facts as text, by the names of `FACTS`."""
    problem: str | None = None
    """Why it can be no recording, where that showed when it came."""

    def __post_init__(self) -> None:
        for name in ("file", "machine"):
            if (
                text := getattr(self, name)
            ) is not None:  # a database takes neither a NUL nor half a character
                object.__setattr__(self, name, escape_controls(text)[:_LONGEST_STATED])


Accept = Callable[[Delivery, bytes | Path], str]
"""Takes a delivery and its content, bytes or a file that may be moved; returns the content's
SHA-256 once it is safe on the disk. Raises OSError where it is not, and the source offers it again
later.
"""


def check_facts(facts: Mapping[str, Any]) -> dict[str, str]:
    """The facts as text, refused where a name is unknown or a text cannot be read.

    Raises
    ------
    InputError
        A fact that is unknown, no text, too long, or of another unit.

    Examples
    --------
    >>> check_facts({"speed": "1500 rpm"})
    {'speed': '1500 rpm'}
    """
    for name, text in facts.items():
        if name not in FACTS:
            raise InputError(
                f"{_short(name)} is no fact of a recording; there are {', '.join(FACTS)}."
            )
        if not isinstance(text, str) or not text.strip() or len(text) > _LONGEST:
            raise InputError(
                f"{name} = {_short(text)} must be text of at most {_LONGEST} characters."
            )
        if name in QUANTITIES:
            value = parse_quantity(text, QUANTITIES[name][1], name=name)
            if not math.isfinite(value) or value <= 0:
                raise InputError(f"{name} = {_short(text)} must be above zero.")
            if name == "rate" and not SAMPLE_RATE_RANGE_HZ[0] <= value <= SAMPLE_RATE_RANGE_HZ[1]:
                raise InputError(
                    f"rate = {_short(text)} must lie between {SAMPLE_RATE_RANGE_HZ[0]:g} and {SAMPLE_RATE_RANGE_HZ[1]:g} Hz."
                )
        if read := {"time": read_time, "unit": require_sample_unit}.get(name):
            read(text)
        elif name == "count" and not (text.isdecimal() and int(text) > 0):
            raise InputError(
                f"count = {_short(text)} must be the number of samples of each channel, such as 8192."
            )
        elif name == "type" and text not in TYPES:
            raise InputError(f"type = {_short(text)} is none of {', '.join(TYPES)}.")
    return {name: plain_text(text) for name, text in facts.items()}


def read_time(text: str) -> datetime:
    """The time (UTC) of a text in ISO 8601; one without a zone is UTC.

    Raises
    ------
    InputError
        It is no such time, or before 1990.

    Examples
    --------
    >>> read_time("2026-11-23T14:00:00+01:00").isoformat()
    '2026-11-23T13:00:00+00:00'
    """
    try:
        time = datetime.fromisoformat(text)
        time = time.replace(tzinfo=UTC) if time.tzinfo is None else time.astimezone(UTC)
    except (ValueError, OverflowError):
        raise InputError(
            f'time = {_short(text)} must be ISO 8601, such as "2026-11-23T14:00:00Z".'
        ) from None
    if time < _EARLIEST:
        raise InputError(f"time = {_short(text)} lies before 1990; is the sensor's clock set?")
    return time


def entry_facts(facts: Mapping[str, str]) -> dict[str, Any]:
    """Facts of a delivery as those of an index entry, but for its time.

    Examples
    --------
    >>> entry_facts({"rate": "25.6 kHz", "channels": "x, y", "time": "2026-11-23T14:00:00Z"})
    {'sample_rate': '25.6 kHz', 'names': ['x', 'y']}
    """
    entry: dict[str, Any] = {
        QUANTITIES[name][0]: text for name, text in facts.items() if name in QUANTITIES
    }
    if "unit" in facts:
        entry["unit"] = facts["unit"]
    if "sensitivity" in facts:
        entry["sensitivity"] = tuple(channel_names(facts["sensitivity"]))
    if "channels" in facts:
        entry["names"] = channel_names(facts["channels"])
    return entry


def channel_names(text: str) -> list[str]:
    """Names between commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def safe_name(text: str) -> str:
    """The last part of a stated file name, its suffix in place, that no system takes for more than
    a file.

    Examples
    --------
    >>> safe_name("../../etc/pump 1.WAV"), safe_name("C:\\\\data\\\\a.csv"), safe_name("..")
    ('pump_1.WAV', 'a.csv', 'recording')
    """
    last = re.split(r"[/\\]", plain_text(text))[-1]
    name = re.sub(r"[^\w.+-]", "_", last).lstrip(".")
    return name[-_LONGEST_NAME:].lstrip(".") or "recording"


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:60]}..."
