"""The text of a tags file: lines with a time and an operating point, as other systems write them.

Nothing is guessed: what has two readings is a problem that names the file and the line.
"""

import csv
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta, tzinfo
from functools import lru_cache
from pathlib import Path

from swashtwin.foundation import DataError, UnitError, parse_quantity
from swashtwin.monitoring.sources.delivery import MIN_TIME, QUANTITIES

DEFAULT_UNITS: Mapping[str, str] = {"speed": "rpm", "pressure": "MPa", "temperature": "degC"}
"""Columns of quantities, and the unit of a number without one."""
COLUMN_NAMES: Mapping[str, tuple[str, ...]] = {
    "time": ("time", "timestamp", "datetime", "date", "zeit", "zeitstempel", "datum", "uhrzeit"),
    "speed": ("speed", "drehzahl"),
    "pressure": ("pressure", "druck"),
    "temperature": ("temperature", "temperatur"),
}
"""Words of a heading that name each column, in lower case."""
LIMITS: Mapping[str, tuple[float, float, str]] = {
    "speed": (-1.05, 838.0, "-10 to 8000 rpm"),
    "pressure": (-1e5, 1e8, "-0.1 to 100 MPa"),
    "temperature": (233.0, 423.2, "-40 to 150 degC"),
}
"""Least and greatest value [SI] of an axial piston pump; beyond them the sensor or the unit is
wrong. A sensor at rest is not exactly at zero.
"""
SEPARATORS = (",", ";", "\t")
MAX_SHOWN_LENGTH = 60
"""Characters of a wrong cell in a message."""
DATE_NAMES = ("date", "datum")
"""Words of a heading whose column may hold the date alone, with the time of day in another one."""
EPOCH_SCALES = (1.0, 1e-3, 1e-6, 1e-9)
"""Seconds that a number of an epoch counts: seconds, milliseconds, microseconds, nanoseconds. The
times since 1990 of each are far from those of the others.
"""
_MAX_EPOCH_S = datetime(2100, 1, 1, tzinfo=UTC).timestamp()

_GERMAN_DATE = re.compile(r"(\d{1,2})\.(\d{1,2})\.(\d{4}),?[ T]+")
_YEAR_FIRST = re.compile(r"(\d{4})/(\d{1,2})/(\d{1,2})[ T]+")
_SHORT_HOUR = re.compile(r"T(\d:)")
_DAY = re.compile(r"\d{4}-?\d{2}-?\d{2}")
_NUMBER = re.compile(r"[+-]?(?:\d[\d.,]*|[.,]\d+)(?:[eE][+-]?\d+)?")


@dataclass(frozen=True)
class TagLine:
    """One line of a tags file."""

    time: datetime
    """Time from which it holds (UTC). A line without a readable time holds from the previous one's.
    """
    facts: Mapping[str, str] = field(default_factory=dict)
    """Quantities as text with a unit, by the names of `DEFAULT_UNITS`."""
    problem: str | None = None
    """Why the line cannot be used, with the file and the number of the line."""


class TagsFileError(DataError):
    """A tags file of which no line can be used."""


class _LineError(Exception):
    """Why a line cannot be used."""


@dataclass(frozen=True)
class _Column:
    """A column of the file that is read."""

    index: int
    heading: str
    unit: str = ""
    """Unit of its numbers, empty for the default; of a time its zone."""
    day: int | None = None
    """Column of the date, if it is apart from the time of day."""


def read_tag_lines(path: Path, zone: tzinfo | None) -> list[TagLine]:
    """Return the lines of a tags file, in order of time.

    Parameters
    ----------
    zone : zone of times that specify none; without it they are a problem of the whole file.

    Raises
    ------
    TagsFileError
        No line of the file can be used.
    """
    try:
        text = _decode(path.read_bytes())
    except OSError as cause:
        raise TagsFileError(f"{path} (tags) cannot be read: {cause.strerror or cause}.") from cause

    # The last line may be half written, and half a number is a wrong number: `149` of `1498`.
    text = text[: text.rfind("\n") + 1]
    rows, columns, n_columns = _split(path, text)

    cells = [
        row[column.index].strip()
        for _, row in rows
        for name, column in columns.items()
        if name != "time" and column.index < len(row)
    ]
    try:
        to_number = _number_reader(cells)
    except _LineError as cause:
        raise TagsFileError(f"{path} (tags): {cause}") from None
    return _read_rows(path, rows, _RowReader(columns, n_columns, to_number, zone))


def _decode(content: bytes) -> str:
    """Return the text of a file; spreadsheets also write UTF-16 and Windows' code page."""
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16", errors="replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace")


def _split(path: Path, text: str) -> tuple[list[tuple[int, list[str]]], dict[str, _Column], int]:
    """Return the rows with the numbers of their lines, the columns, and how many the header has."""
    lines = text.splitlines()
    start = 0
    if lines and lines[0].lower().startswith("sep="):
        start = 1  # a note for spreadsheets

    header = next(iter(lines[start : start + 1]), "")
    candidates = []
    for separator in SEPARATORS:
        headings = next(csv.reader([header], delimiter=separator), [])
        columns = _find_columns(path, headings)
        if "time" in columns and len(columns) > 1:
            candidates.append((len(columns), separator, columns, len(headings)))
    if not candidates:
        raise TagsFileError(
            f"{path} (tags) must begin with a line such as time,speed,pressure; it begins with "
            f"{_shorten(header)}."
        )
    _, separator, columns, n_columns = max(candidates, key=lambda candidate: candidate[0])

    reader = csv.reader(lines[start + 1 :], delimiter=separator)
    rows = []
    for row in reader:
        number = start + 1 + reader.line_num
        # A separator at the end of each line makes an empty cell.
        while len(row) > n_columns and not row[-1].strip():
            row.pop()
        if any(cell.strip() for cell in row):
            rows.append((number, row))
    return rows, columns, n_columns


def _find_columns(path: Path, headings: Sequence[str]) -> dict[str, _Column]:
    """Return the columns that are read, by name: each heading may end with a unit."""
    columns: dict[str, _Column] = {}
    for index, heading in enumerate(headings):
        heading_parts = [word for word in re.split(r"[\s_\[\](){}]+", heading.strip()) if word]
        if not heading_parts:
            continue
        matches = [
            name for name, known in COLUMN_NAMES.items() if heading_parts[0].lower() in known
        ]
        if not matches:
            continue
        (name,) = matches
        unit = _unit_of(path, name, heading, heading_parts[1:])
        column: _Column | None = _Column(index, heading.strip(), unit)
        if name in columns and column is not None:
            column = _join_day(columns[name], column)
        if column is None:
            raise TagsFileError(
                f"{path} (tags) has two columns of {name}: {columns[name].heading!r} and "
                f"{heading.strip()!r}. Remove or rename one."
            )
        columns[name] = column
    return columns


def _join_day(first: _Column, second: _Column) -> _Column | None:
    """Return the column of the time of day with that of the date; None if they are others."""
    for day, time in ((first, second), (second, first)):
        is_day = day.heading.lower().startswith(DATE_NAMES)
        if is_day and not time.heading.lower().startswith(DATE_NAMES) and day.day is None:
            return replace(time, day=day.index, unit=time.unit or day.unit)
    return None


def _unit_of(path: Path, name: str, heading: str, heading_parts: Sequence[str]) -> str:
    """Return the unit at the end of a heading; empty if there is none."""
    if not heading_parts:
        return ""
    unit = " ".join(heading_parts)
    if name == "time":
        # Numbers show their unit by their magnitude; only the zone matters.
        return "UTC" if "UTC" in (word.upper() for word in heading_parts) else ""
    try:
        parse_quantity(f"1 {unit}", QUANTITIES[name][1], name=name)
    except UnitError:
        raise TagsFileError(
            f"{path} (tags): {heading.strip()!r} has no unit of {name}. Write the column as "
            f"{name} (in {DEFAULT_UNITS[name]}), or with its unit in brackets."
        ) from None
    return unit


def _read_rows(
    path: Path,
    rows: Sequence[tuple[int, list[str]]],
    reader: "_RowReader",
) -> list[TagLine]:
    lines: list[TagLine] = []
    problems = []
    for number, row in rows:
        previous = lines[-1].time if lines else None
        time = previous
        try:
            time = reader.time(row, previous)
            line = TagLine(time, reader.facts(row))
        except _LineError as cause:
            problem = f"{path} (tags), line {number}: {cause}"
            problems.append(problem)
            if time is None:
                continue  # nothing is known before the first readable time
            line = TagLine(time, problem=problem)
        lines.append(line)

    if problems and all(line.problem is not None for line in lines):
        raise TagsFileError(problems[0])
    return sorted(lines, key=lambda line: line.time)


class _RowReader:
    """Reads the cells of a row."""

    def __init__(
        self,
        columns: Mapping[str, _Column],
        n_columns: int,
        to_number: Callable[[str], float],
        zone: tzinfo | None,
    ) -> None:
        self._columns = columns
        self._n_columns = n_columns
        self._to_number = to_number
        self._zone = zone
        if columns["time"].unit:
            self._zone = UTC

    def time(self, row: Sequence[str], previous: datetime | None) -> datetime:
        """Return the time of a row (UTC)."""
        if len(row) != self._n_columns:
            hint = ""
            if len(row) > self._n_columns:
                hint = " Separate cells with ; if numbers have decimal commas."
            raise _LineError(f"it has {len(row)} cells, the header {self._n_columns}.{hint}")

        column = self._columns["time"]
        text = row[column.index].strip()
        if column.day is not None:
            text = f"{row[column.day].strip()} {text}"
        time = self._epoch_time(text) or _calendar_time(text)
        if time is None:
            raise _LineError(
                f"time {_shorten(text)} cannot be read; write ISO 8601, such as "
                '"2026-11-23T14:00:00Z".'
            )
        time = self._in_utc(time, text, previous)
        if time < MIN_TIME:
            raise _LineError(f"time {_shorten(text)} lies before 1990.")
        return time

    def _epoch_time(self, text: str) -> datetime | None:
        """Return the time of a number of seconds or parts of seconds since 1970."""
        text = text.replace(",", ".")
        if not re.fullmatch(r"\d+(\.\d*)?", text):
            return None
        for scale in EPOCH_SCALES:
            seconds = float(text) * scale
            if MIN_TIME.timestamp() <= seconds <= _MAX_EPOCH_S:
                return datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=seconds)
        raise _LineError(
            f"time {_shorten(text)} is no number of seconds or milliseconds since 1970."
        )

    def _in_utc(self, time: datetime, text: str, previous: datetime | None) -> datetime:
        if time.tzinfo is not None:
            return time.astimezone(UTC)
        if self._zone is None:
            raise _LineError(
                f'time {_shorten(text)} has no time zone; set tags_zone = "Europe/Berlin" or '
                '"UTC" under the [[machine]], or end each time with Z or +01:00.'
            )
        try:
            first = time.replace(tzinfo=self._zone).astimezone(UTC)
            # When clocks are set back, an hour comes twice: its second pass follows the first.
            second = time.replace(tzinfo=self._zone, fold=1).astimezone(UTC)
        except OverflowError:
            raise _LineError(f"time {_shorten(text)} cannot be a time of a tag.") from None
        if previous is not None and first < previous <= second:
            return second
        return first

    def facts(self, row: Sequence[str]) -> dict[str, str]:
        """Return the quantities of a row."""
        facts = {}
        for name, column in self._columns.items():
            if name == "time":
                continue
            text = row[column.index].strip()
            if name == "temperature" and not text:
                continue  # no operating point needs it
            facts[name] = self._quantity(name, column, text)
        return facts

    def _quantity(self, name: str, column: _Column, text: str) -> str:
        number = _NUMBER.match(text)
        if not text:
            raise _LineError(f"it has no {name}.")
        if number is None:
            raise _LineError(f"{name} = {_shorten(text)} is not a number.")
        value = self._to_number(number[0])
        written_unit = text[number.end() :].strip()
        unit = written_unit or column.unit or DEFAULT_UNITS[name]
        try:
            offset, scale = _unit_scale(unit, QUANTITIES[name][1])
        except UnitError:
            raise _LineError(f"{name} = {_shorten(text)} has an unknown unit.") from None

        least, greatest, limits = LIMITS[name]
        if not least <= offset + scale * value <= greatest:
            raise _LineError(
                f"{name} = {_shorten(text)} ({value:g} {unit}) is impossible; a pump has {limits}. "
                "Check the sensor and the unit of the column."
            )
        if written_unit and "," not in text:
            return text
        return f"{value!r} {unit}"


def _calendar_time(text: str) -> datetime | None:
    """Return the time of a date and a time of day; None if the text is something else.

    The date is that of ISO 8601, with slashes if the year comes first, or a German one. Other dates
    with slashes have two readings.

    Examples
    --------
    >>> _calendar_time("24.11.2025 7:05:00"), _calendar_time("11/12/2025 07:05")
    (datetime.datetime(2025, 11, 24, 7, 5), None)
    """
    day_first = _GERMAN_DATE.match(text)
    year_first = _YEAR_FIRST.match(text)
    if day_first is not None:
        day, month, year = day_first.groups()
        text = f"{year}-{month:0>2}-{day:0>2}T{text[day_first.end() :]}"
    elif year_first is not None:
        year, month, day = year_first.groups()
        text = f"{year}-{month:0>2}-{day:0>2}T{text[year_first.end() :]}"

    text = _SHORT_HOUR.sub(r"T0\1", text)
    text = re.sub(r"\s*(?:UTC|GMT)$", "Z", text)
    text = re.sub(r"\s+([+-]\d{2}:?\d{2})$", r"\1", text)
    if _DAY.fullmatch(text):
        return None  # no tag holds for a whole day
    try:
        return datetime.fromisoformat(text)
    except (ValueError, OverflowError):
        return None


def _number_reader(cells: Sequence[str]) -> Callable[[str], float]:
    """Return the function that reads the numbers of a file: with decimal points or commas.

    Raises
    ------
    _LineError
        The cells contradict each other, or have two readings.
    """
    texts = [match[0] for match in map(_NUMBER.match, cells) if match]
    comma = next((text for text in texts if _has_decimal(text, ",")), None)
    point = next((text for text in texts if _has_decimal(text, ".")), None)
    thousands = next((text for text in texts if "," in text), None)

    if comma is not None and point is not None:
        raise _LineError(
            f"{comma} has a decimal comma and {point} a decimal point; write all numbers alike."
        )
    if comma is not None:
        return lambda text: _to_float(text, group=".", decimal=",")
    if thousands is not None and point is None:
        raise _LineError(
            f"{thousands} has two readings, with a decimal comma or with a comma between "
            "thousands; write numbers with a decimal point."
        )
    return lambda text: _to_float(text, group=",", decimal=".")


def _has_decimal(text: str, mark: str) -> bool:
    """Return whether a mark in a number can only be the decimal one."""
    mantissa = re.split("[eE]", text)[0].lstrip("+-")
    other = "," if mark == "." else "."
    if mark not in mantissa or mantissa.count(mark) > 1:
        return False
    if other in mantissa:
        return mantissa.index(other) < mantissa.index(mark)
    whole, _, fraction = mantissa.partition(mark)
    return len(fraction) != 3 or not 1 <= len(whole) <= 3 or whole.startswith("0")


def _to_float(text: str, *, group: str, decimal: str) -> float:
    whole, mark, fraction = text.partition(decimal)
    digits = whole.lstrip("+-")
    if group in digits and not re.fullmatch(rf"\d{{1,3}}(?:{re.escape(group)}\d{{3}})+", digits):
        raise _LineError(f"{text} is not a number.")
    try:
        return float(whole.replace(group, "") + ("." if mark else "") + fraction)
    except ValueError:
        raise _LineError(f"{text} is not a number.") from None


@lru_cache(maxsize=64)
def _unit_scale(unit: str, si_unit: str) -> tuple[float, float]:
    """Return offset and scale that bring numbers of a unit to SI."""
    offset = parse_quantity(f"0 {unit}", si_unit, name="it")
    return offset, parse_quantity(f"1 {unit}", si_unit, name="it") - offset


def _shorten(text: str) -> str:
    if len(text) > MAX_SHOWN_LENGTH:
        text = f"{text[:MAX_SHOWN_LENGTH]}..."
    return repr(text)
