"""Units at the end of a name, without brackets: ``x_mg``, ``acc_m_s2``, ``vel mm/s``."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace

from swashtwin.recordings.formats.column_names import (
    may_name_signal,
    name_in_group,
    names_place,
    names_signal,
)
from swashtwin.recordings.formats.raw_file import RawFile

_PER_SECOND_SQUARED = r"(?:/|_per_|_| |p)?s(?:/s|_per_s|[_^]?-?2|\*\*2|⁻?²)"
_PER_SECOND = r"(?:/|_per_|_)s"
_UNIT_AT_END = re.compile(
    rf"(?P<name>.*?\w)[\s_]+"
    rf"(?:(?P<acceleration>mm?){_PER_SECOND_SQUARED}|(?P<velocity>[muµμ]?m){_PER_SECOND}"
    r"|(?P<plain>mg|mV)|(?P<letter>[gG]))"
)
_COUNT_AT_END = re.compile(
    r".*\w(?:\s*[\[(]\s*|[\s_]+|\s*/\s*)(?P<unit>counts?|cts|lsb|digits?)\s*[\])]?", re.IGNORECASE
)


def count_unit(name: str) -> str | None:
    """Return the word of a converter's counts at the end of a name, or None.

    Examples
    --------
    >>> count_unit("Acc (counts)"), count_unit("ax_LSB"), count_unit("counts")
    ('counts', 'LSB', None)
    """
    match = _COUNT_AT_END.fullmatch(name_in_group(name))
    return None if match is None else match["unit"]


def with_trailing_units(raw: RawFile) -> RawFile:
    """Return a file in which units at the end of names are those of the columns without one."""
    if "recording_id" in raw.facts:
        return raw  # a recording that was written here states its unit

    units = _trailing_units(raw.columns, raw.units)
    units = {name: unit for name, unit in units.items() if name not in raw.foreign_units}
    return replace(raw, units={**raw.units, **units}) if units else raw


def _trailing_units(names: Iterable[str], known_units: Mapping[str, str]) -> dict[str, str]:
    """Return the units at the end of names, for columns that have no stated unit."""
    names = list(names)
    units: dict[str, str] = {}
    for name in names:
        unit = None if name in known_units else _trailing_unit(name, names)
        if unit is not None:
            units[name] = unit
    return units


def _trailing_unit(name: str, names: Iterable[str]) -> str | None:
    """Return the unit at the end of a name, or None; `names` are those of all columns."""
    match = _UNIT_AT_END.fullmatch(name.strip())
    if match is None or not may_name_signal(match["name"]):
        return None
    if match["acceleration"]:
        return f"{match['acceleration']}/s^2"
    if match["velocity"]:
        return f"{re.sub('[µμ]', 'u', match['velocity'])}/s"
    if match["plain"]:
        return match["plain"]

    # A letter may number a sensor as well: "sensor_f" beside "sensor_g".
    is_signal = names_signal(match["name"], "") or names_place(match["name"])
    start = name[:-1]
    is_letter = any(
        other != name and re.fullmatch(rf"{re.escape(start)}[A-Za-z]", other) for other in names
    )
    return "g" if is_signal and not is_letter else None
