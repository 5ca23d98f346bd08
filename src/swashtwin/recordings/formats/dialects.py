"""The dialect of a text table: its separator, decimal mark, header, and what each column holds."""

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from swashtwin.foundation import DataError
from swashtwin.recordings.formats.column_names import (
    family_of,
    is_sensor_unit,
    may_name_signal,
    meaning_of_unit,
    names_row_sensor,
    names_signal,
    parse_time_name,
)
from swashtwin.recordings.formats.headings import TRADE_UNITS, split_unit
from swashtwin.recordings.formats.raw_file import ReadOptions
from swashtwin.recordings.formats.sample_units import normalize_unit, recognize_unit
from swashtwin.recordings.formats.time_stamps import is_date, is_stamp

# Separators, the least likely to stand within a text first.
_SEPARATORS = ("\t", ";", "|", ",", " ")

NUMBER = {
    ".": re.compile(
        r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?|[+-]?(nan|inf|infinity|∞)", re.IGNORECASE
    ),
    ",": re.compile(
        r"[+-]?(\d+,?\d*|,\d+)([eEdD][+-]?\d+)?|[+-]?(nan|inf|infinity|∞)", re.IGNORECASE
    ),
}
"""A number with each decimal mark."""
MISSING = (
    "",
    "N/A",
    "n/a",
    "#N/A",
    "NA",
    "null",
    "NULL",
    "None",
    "-",
    "--",
    "---",
    "?",
    "-nan(ind)",
    "nan(ind)",
    "-1.#IND",
    "1.#QNAN",
    "#NUM!",
    "#DIV/0!",
    "#VALUE!",
)
"""What programs write for a missing sample."""
_GROUPED = {mark: re.compile(rf"[+-]?[1-9]\d{{0,2}}{re.escape(mark)}\d{{3}}") for mark in ".,"}
THOUSANDS = re.compile(r"[+-]?\d{1,3}([. ']\d{3})+(,\d+)?|[+-]?\d{1,3}([, ']\d{3})+(\.\d+)?")
"""A number with marks for thousands."""
HEAD_LINES = 1000
"""Lines among which the first row is searched."""

# Lines at the end of the head that decide what the columns hold.
_TAIL_LINES = 40

# More different texts in a column are not names of sensors.
_MAX_SENSORS = 8

# A number that is written as "1.234 g", "[1.234]", "(1.234)", "x=1.234" or "'1.234'".
_PLAIN_NUMBER = r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?"
_DECORATED = re.compile(
    rf"(?=.*[^\d.,eE+-])(?:[A-Za-z]\w*\s*[=:]\s*)?[\[({{<']*\s*{_PLAIN_NUMBER}"
    r"\s*[\])}>']*\s*[\[(]?(?P<unit>[^\W\d_][^\s\[\](){}]*)?[\])]?"
)

# Fewer different texts in a column are those of a label.
_MIN_DECORATED = 3

_LABVIEW_HEADER_END = "***End_of_Header***"

# Last headings for which rows may lack a column: LabVIEW writes one for comments.
_OPTIONAL_HEADINGS = ("", "Comment")

# Types of numbers that a line below the headings may name; they are not headings.
_TYPE_NAMES = (
    "float",
    "float32",
    "float64",
    "double",
    "single",
    "real",
    "int",
    "integer",
    "int16",
    "int32",
    "string",
)

# Minimum rows of a table with a column of words, two by default.
#
# A few lines of prose can have equally many words.
_MIN_ROWS = {" ": 8}


class Kind(Enum):
    """What a column holds."""

    number = "numbers"
    stamp = "time stamps"
    date = "dates"
    text = "text"
    blank = "nothing"


def split_line(line: str, separator: str) -> list[str]:
    """Return the fields of a line without the blanks and quotation marks around them."""
    if separator == " ":
        joined_units = re.sub(r"\s+([\[(][^\s()\[\]]*[)\]])", r"\1", line)  # "x [g]" is one heading
        return joined_units.split()

    fields = line.split(separator)
    if '"' in line:
        fields = next(csv.reader([line], delimiter=separator), [""])
    return [field.strip() for field in fields]


@dataclass(frozen=True)
class Dialect:
    """One way to read the lines of a text table."""

    separator: str
    decimal: str
    start: int
    """Lines before the first row."""
    kinds: tuple[Kind, ...]
    header: tuple[list[str], ...]
    """Fields of the line with the headings, and of the line above it if these can be headings."""
    rows: list[list[str]]
    """Fields of the rows that decided the kinds."""

    def rank(self) -> tuple[bool, int, int, bool, int]:
        """Return the sort key of the likeliest dialect.

        Dialects without text come first, then most columns of numbers, most rows that fit, a
        separator other than a blank, and the earliest start.
        """
        counts = Counter(self.kinds)
        # A blank may separate a date from its time of day: that is still one time.
        has_time = counts[Kind.stamp] + counts[Kind.date] > 0
        fitting_rows = sum(_fits(row, self.kinds, self.decimal) for row in self.rows)
        return (
            not counts[Kind.text],
            counts[Kind.number] + has_time,
            fitting_rows,
            self.separator != " ",
            -self.start,
        )

    def refuse_thousands(self, path: Path, *, is_decimal_specified: bool) -> None:
        """Refuse ``1.234,5``, and ``1,234``, which may be above one or above a thousand.

        A specified decimal mark settles what ``1,234`` is.
        """
        for column, kind in enumerate(self.kinds):
            fields = [row[column] for row in self.rows if row[column]]
            if kind is Kind.text:
                marked = [field for field in fields if THOUSANDS.fullmatch(field)]
                if 2 * len(marked) > len(fields):
                    raise DataError(
                        f"{path}: {marked[0]!r} has marks for thousands; "
                        "write the numbers without them."
                    )
            elif kind is Kind.number and not is_decimal_specified:
                self._refuse_grouped(path, fields)

    def _refuse_grouped(self, path: Path, fields: list[str]) -> None:
        """Refuse a column in which every number may be grouped, such as ``999`` and ``1,234``."""
        grouped = [field for field in fields if _GROUPED[self.decimal].fullmatch(field)]
        short = [field for field in fields if re.fullmatch(r"[+-]?\d{1,3}", field)]
        if not grouped or len(grouped) + len(short) < len(fields):
            return

        # 1.234 alone is a number with three decimals, as every instrument writes it.
        if short or self.decimal == ",":
            number = grouped[0]
            as_thousand = number.replace(self.decimal, "")
            as_decimal = number.replace(self.decimal, ".")
            raise DataError(
                f"{path}: {number!r} may be {as_thousand}, or {as_decimal}.",
                field="decimal",
                remedy=f"Set {{decimal='{self.decimal}'}}, "
                "or write the numbers without marks for thousands.",
            )

    def refuse_ambiguous(self, path: Path, lines: Sequence[str]) -> None:
        """Refuse ``3,14``: two columns, or one number with a decimal comma."""
        if self.separator != "," or len(self.kinds) != 2 or self.header:
            return

        has_point = any("." in field for row in self.rows for field in row)
        if not has_point:
            raise DataError(
                f"{path}: line {self.start + 1} ({lines[self.start].strip()!r}) may be two columns "
                "or one decimal comma.",
                field="separator",
                remedy="Set {separator=','} or {decimal=','}.",
            )

    def refuse_times_alone(self, path: Path, lines: Sequence[str]) -> None:
        """Refuse rows that hold the time, or little more, of the columns that a header names.

        The header is then split by another separator than the rows, which may need none.
        """
        filled_lines = [line for line in lines[: self.start] if line.strip()]
        if not filled_lines or parse_time_name(filled_lines[-1]):
            return

        width = len(self.kinds)
        for separator in set(_SEPARATORS) - {" ", self.separator}:
            headings = split_line(_without_comment_mark(filled_lines[-1]), separator)
            if len(headings) > width and parse_time_name(headings[0]):
                rest = ", only the times" if width == 1 else ""
                raise DataError(
                    f"{path}: the rows hold {width} of {len(headings)} columns{rest} "
                    f"({headings[0]}; no {', '.join(headings[width : width + 3])}). Export the "
                    "file again with its samples."
                )

    def refuse_other_headings(self, path: Path, lines: Sequence[str]) -> None:
        """Refuse a header with fewer or more headings than columns: whose they are is unknown."""
        filled_lines = (number for number in range(self.start) if lines[number].strip())
        last_line = max(filled_lines, default=None)
        if last_line is None:
            return

        fields = split_line(_without_comment_mark(lines[last_line]), self.separator)
        while fields and fields[-1] in _OPTIONAL_HEADINGS:
            fields.pop()
        if not fields or self._is_heading_line(fields):
            return
        if self.separator == " " and not parse_time_name(fields[0]):
            return  # a sentence

        width = max(column for column, kind in enumerate(self.kinds, 1) if kind is not Kind.blank)
        are_words = all(
            not NUMBER[self.decimal].fullmatch(field) and any(map(str.isalpha, field))
            for field in fields
        )
        if 1 < len(fields) != width and are_words:
            raise DataError(
                f"{path}: line {last_line + 1} has {len(fields)} headings for {width} columns.",
                field="header_lines",
                remedy=f"Name each column, or set {{header_lines={self.start}}}.",
            )

    def _is_heading_line(self, fields: list[str]) -> bool:
        count = len(fields)
        return any(fields == header[:count] and not any(header[count:]) for header in self.header)

    def refuse_tagged(self, path: Path, lines: Sequence[str]) -> None:
        """Refuse rows of several sensors by turns, which hold the name or number of theirs."""
        rows = [split_line(line, self.separator) for line in lines[self.start :] if line.strip()]
        headings = self.header[0] if self.header else [""] * len(self.kinds)
        for column, kind in enumerate(self.kinds):
            is_named = names_row_sensor(headings[column])
            may_be_number = column == 0 and not self.header
            if kind is not Kind.text and not is_named and not may_be_number:
                continue

            tags = [row[column] for row in rows if column < len(row)]
            if kind is Kind.number and not all(map(str.isdecimal, tags)):
                continue

            sensors = sorted(set(tags))
            changes = sum(tag != next_tag for tag, next_tag in pairwise(tags))
            rows_per_change = _max_rows_per_change(column, kind, is_named, may_be_number)
            min_changes = max(3, len(sensors), len(tags) // rows_per_change)
            if 1 < len(sensors) <= _MAX_SENSORS and changes >= min_changes:
                raise DataError(
                    f"{path}: its rows are of {len(sensors)} sensors by turns "
                    f"({', '.join(sensors)}); save the rows of each sensor in a separate file."
                )

    def refuse_decorated(self, path: Path, lines: Sequence[str]) -> None:
        """Refuse signals whose numbers are written with a unit, a name or brackets in each row.

        Beside columns of numbers, other texts with numbers are left out: the voltage of a battery,
        identifiers, or numbers of frames.
        """
        cells = _decorated_cells(lines, self.separator)
        if not cells:
            return

        names, units = self.headings()
        signals = [
            column
            for column, name in enumerate(names)
            if self._is_signal(column, name, units.get(name, ""))
        ]
        signal_families = {family_of(names[column]) for column in signals}

        for column, cell in cells.items():
            name = names[column] if column < len(names) else ""
            is_alike = family_of(name) in signal_families
            if not signals or is_alike or names_signal(name, cell.unit):
                raise cell.error(path)

    def _is_signal(self, column: int, name: str, unit: str) -> bool:
        """Return whether a column has numbers that are neither times, counts nor quantities."""
        if self.kinds[column] is not Kind.number or not may_name_signal(name):
            return False
        if names_signal(name, unit):
            return True
        if meaning_of_unit(unit) is not None and not is_sensor_unit(unit):
            return False

        # Times and counts only rise.
        numbers: list[float] = []
        for row in self.rows:
            if NUMBER[self.decimal].fullmatch(row[column]):
                text = row[column].replace(self.decimal, ".").replace("∞", "inf")
                numbers.append(float(re.sub(r"[dD](?=[+-]?\d)", "e", text)))
        return len(numbers) < 2 or any(number >= later for number, later in pairwise(numbers))

    def headings(self) -> tuple[tuple[str, ...], dict[str, str]]:
        """Return the names of the columns, and the units that headings or a line below state."""
        headings = self.header[0] if self.header else [""] * len(self.kinds)
        unit_line: list[str] = []
        if len(self.header) > 1 and _is_unit_line(headings):
            headings, unit_line = self.header[1], headings

        names: list[str] = []
        units: dict[str, str] = {}
        for number, heading in enumerate(headings):
            name, unit = split_unit(heading)
            bare_unit = unit_line[number].strip("[]() ") if unit_line else ""
            if bare_unit:
                unit = bare_unit if unit_line[number][0] in "[(" else unit_line[number]
            if name[:2] in ("'=", "'+", "'-", "'@"):
                name = name[1:]  # the apostrophe keeps a spreadsheet from running a formula
            if name in names:
                name = f"{name}_{number}"
            name = name or f"column_{number}"
            names.append(name)
            if unit and (recognize_unit(unit) or normalize_unit(unit) in TRADE_UNITS):
                units[name] = normalize_unit(unit)
        return tuple(names), units


def _max_rows_per_change(column: int, kind: Kind, is_named: bool, may_be_number: bool) -> int:
    """Return after how many rows at most a column of sensors' names changes.

    The better the evidence that the column names sensors, the fewer changes suffice.
    """
    if is_named:
        return 20
    if may_be_number and kind is Kind.number:
        return 2
    return 4 if column else 20


def _is_unit_line(fields: Sequence[str]) -> bool:
    """Return whether a line below the headings holds units: all known, and one clearly a unit."""
    texts = [text for text in fields if text.strip("-")]
    is_clear = [text[0] in "[(" or normalize_unit(text) in TRADE_UNITS for text in texts]
    return any(is_clear) and all(
        clear or recognize_unit(text) for text, clear in zip(texts, is_clear, strict=True)
    )


def detect_dialect(path: Path, lines: Sequence[str], options: ReadOptions) -> Dialect:
    """Return the dialect of the table that begins with these lines.

    Raises
    ------
    DataError
        The lines hold no table, or one that can be read in two ways.
    """
    if lines and lines[0].startswith(("DIAEXTENDED", "DIADEM")):
        raise DataError(
            f"{path} is the header of a DIAdem data set, whose samples are in another file; "
            "export it as text."
        )

    candidates = _possible_dialects(lines, options)
    if not candidates:
        raise _no_table_error(path, lines, options)

    best = max(candidates, key=Dialect.rank)
    best.refuse_thousands(path, is_decimal_specified=options.decimal is not None)
    if options.decimal is None and options.separator is None:
        best.refuse_ambiguous(path, lines)
    best.refuse_times_alone(path, lines)
    if options.channels is None and Kind.text in best.kinds:
        best.refuse_decorated(path, lines)
    if options.header_lines is None:
        best.refuse_other_headings(path, lines)
    best.refuse_tagged(path, lines)
    return best


def _possible_dialects(lines: Sequence[str], options: ReadOptions) -> list[Dialect]:
    """Return the dialects in which the lines are a table."""
    candidates: list[Dialect] = []
    for separator in (options.separator,) if options.separator else _SEPARATORS:
        for decimal in (options.decimal,) if options.decimal else (".", ","):
            if separator == decimal:
                continue
            dialect = _try_dialect(lines, separator, decimal, options.header_lines)
            if dialect is not None:
                candidates.append(dialect)
    return candidates


def _no_table_error(path: Path, lines: Sequence[str], options: ReadOptions) -> DataError:
    """Return the error of lines without a table; times or numbers with units raise theirs."""
    _refuse_stamps_alone(path, lines)
    for separator in (options.separator,) if options.separator else _SEPARATORS[:-1]:
        for cell in _decorated_cells(lines, separator).values():
            raise cell.error(path)
    return DataError(
        f"{path} holds no table of numbers that could be found.",
        field="separator",
        remedy="Specify how it is written, for example {separator=';'}, {decimal=','}, "
        "{header_lines=8}.",
    )


class _Cell(NamedTuple):
    """First field of a column whose numbers have a unit, a name or brackets around them."""

    line: int
    text: str
    unit: str
    """Empty if there is none."""

    def error(self, path: Path) -> DataError:
        """Return the error of a column that may be a signal."""
        advice = f", and {self.unit!r} in the heading, in square brackets" if self.unit else ""
        return DataError(
            f"{path}: line {self.line}: {self.text[:40]!r} is a number with a unit, a name "
            "or brackets around it.",
            field="channels",
            remedy=f"Export the numbers alone{advice}, or select other columns with {{channels}}.",
        )


def _decorated_cells(lines: Sequence[str], separator: str) -> dict[int, _Cell]:
    """Return the columns with a unit, a name or brackets in most rows, and a cell of each."""
    rows = {
        number: split_line(line, separator) for number, line in enumerate(lines, 1) if line.strip()
    }
    tail = list(rows.values())[-_TAIL_LINES:]
    cells: dict[int, _Cell] = {}
    for column in range(len(tail[-1]) if tail else 0):
        texts = [row[column] for row in tail if column < len(row)]
        n_decorated = sum(_match_decorated(text) is not None for text in texts)
        # A text such as "12 V" in all rows is a remark.
        if 2 * n_decorated <= len(tail) or len(set(texts)) < _MIN_DECORATED:
            continue

        for number, row in rows.items():
            match = _match_decorated(row[column]) if column < len(row) else None
            if match is not None:
                cells[column] = _Cell(number, row[column], match["unit"] or "")
                break
    return cells


def _match_decorated(text: str) -> re.Match[str] | None:
    """Return the match of a number with decoration, unless its unit is of another quantity."""
    match = _DECORATED.fullmatch(text)
    if match is None or (match["unit"] and not is_sensor_unit(match["unit"])):
        return None
    return match


def _refuse_stamps_alone(path: Path, lines: Sequence[str]) -> None:
    """Refuse rows that hold nothing but time stamps."""
    rows = [line.strip(' "') for line in lines if line.strip()][-_TAIL_LINES:]
    if rows and all(map(is_stamp, rows[1:] or rows)):
        raise DataError(
            f"{path} holds times only (such as {rows[-1]}), and no samples. Export the file again "
            "with its samples."
        )


def _without_comment_mark(line: str) -> str:
    """Return a line of a header without the marks of a comment.

    A lone ``#`` is kept: it is the heading of a counter.
    """
    return line if re.match(r"#\s*[\t;,|]", line) else line.lstrip("%# ")


def _try_dialect(
    lines: Sequence[str], separator: str, decimal: str, header_lines: int | None
) -> Dialect | None:
    """Return the dialect with one separator and decimal mark; None if the lines are not a table."""
    first_line = header_lines
    if not first_line:
        # LabVIEW writes a header of the file, and one of its samples.
        header_ends = [
            number for number, line in enumerate(lines, 1) if line.startswith(_LABVIEW_HEADER_END)
        ]
        first_line = max(header_ends[:2], default=0)
    fields = {
        number: split_line(_without_comment_mark(line), separator)
        for number, line in enumerate(lines)
        if number >= first_line and line.strip()
    }

    rows = _typical_rows(fields, decimal)
    if not rows:
        return None
    kinds = tuple(_kind([row[column] for row in rows], decimal) for column in range(len(rows[0])))
    if Kind.number not in kinds:
        return None
    if Kind.text in kinds and not _is_plausible(rows, kinds, separator):
        return None

    start = first_line
    if header_lines is None:
        fitting_lines = [
            number
            for number in fields
            if number < HEAD_LINES and _fits(fields[number], kinds, decimal)
        ]
        if not fitting_lines:
            return None
        # A preamble may hold one line that looks like a row, but not two in a row.
        next_line = dict(pairwise(fields))
        runs = (number for number in fitting_lines if next_line.get(number) in fitting_lines)
        start = next(runs, fitting_lines[-1])

    heading_line, header = _find_header(fields, start, kinds, decimal)
    if header_lines is None:
        if heading_line == start:
            start = heading_line + 1
        else:
            start = _first_row(fields, heading_line, start, kinds, decimal)
    return Dialect(separator, decimal, start, kinds, header, rows)


def _typical_rows(fields: dict[int, list[str]], decimal: str) -> list[list[str]]:
    """Return the last rows of the head that have the most frequent number of columns.

    Rows begin below the last line without a number, time stamp or date.
    """
    tail = list(fields)[-_TAIL_LINES:]
    lines_of_words = [
        number
        for number in tail
        if not any(_has_kind(field, kind, decimal) for field in fields[number] for kind in _TESTED)
    ]
    row_lines = tail
    if lines_of_words:
        row_lines = [number for number in tail if number > lines_of_words[-1]] or tail
    if not row_lines:
        return []

    # Of two widths that are equally frequent, the last one counts.
    widths = Counter(len(fields[number]) for number in reversed(row_lines))
    width = widths.most_common(1)[0][0]
    return [fields[number] for number in row_lines if len(fields[number]) == width]


def _find_header(
    fields: dict[int, list[str]], start: int, kinds: Sequence[Kind], decimal: str
) -> tuple[int, tuple[list[str], ...]]:
    """Return the line with the headings, -1 if there is none, and the fields of the header.

    Those of the line above come second, if they can be headings.
    """
    width = len(kinds)
    if width > 2 and _is_counted(fields.get(start, []), width):
        return start, (fields[start],)

    blank_count = 0
    while blank_count < width and kinds[width - 1 - blank_count] is Kind.blank:
        blank_count += 1

    for number in sorted((number for number in fields if number < start), reverse=True):
        headings = _as_headings(fields[number], width, decimal, blank_count)
        if headings is None:
            continue
        above = _as_headings(fields.get(number - 1, []), width, decimal, blank_count)
        return number, (headings,) if above is None else (headings, above)
    return -1, ()


def _as_headings(fields: list[str], width: int, decimal: str, blank_count: int) -> list[str] | None:
    """Return the fields, filled to `width`, if they can be headings; else None.

    Headings are words, or words before numbered columns.

    Parameters
    ----------
    blank_count : last columns that hold nothing, and need no heading.
    """
    if width - blank_count <= len(fields) < width:
        fields = [*fields, *[""] * (width - len(fields))]
    if len(fields) == width + 1 and fields[-1] in _OPTIONAL_HEADINGS:
        fields = fields[:-1]
    if len(fields) != width or fields[0].endswith(":"):
        return None

    has_letters = any(character.isalpha() for field in fields for character in field)
    are_types = all(field.lower().removeprefix("dt_") in _TYPE_NAMES for field in fields if field)
    numbers = [field for field in fields if NUMBER[decimal].fullmatch(field)]
    if not has_letters or are_types or (numbers and not _is_counted(numbers, len(numbers))):
        return None
    return fields


def _is_counted(fields: Sequence[str], count: int) -> bool:
    """Return whether the fields are 0, 1, 2, ... or 1, 2, 3, ...: numbered columns, not samples."""
    if count < 2:
        return False
    return any(list(fields) == [str(first + number) for number in range(count)] for first in (0, 1))


def _first_row(
    fields: dict[int, list[str]],
    heading_line: int,
    start: int,
    kinds: Sequence[Kind],
    decimal: str,
) -> int:
    """Return the first line of numbers below the headings.

    A damaged row above `start` counts: it must be reported, not skipped.
    """
    number_columns = [column for column, kind in enumerate(kinds) if kind is Kind.number]
    is_number = NUMBER[decimal].fullmatch
    for line, texts in fields.items():
        if not heading_line < line < start or _is_fact(texts, kinds):
            continue
        if heading_line >= 0:
            if any(is_number(text) for text in texts):
                return line
        elif len(texts) == len(kinds):
            count = sum(1 for column in number_columns if is_number(texts[column]))
            if count * 2 > len(number_columns):
                return line
    return start


def _is_fact(texts: list[str], kinds: Sequence[Kind]) -> bool:
    """Return whether a line states a fact in words and a number, such as "Rate", "10000"."""
    return (
        len(texts) != len(kinds)
        and bool(texts)
        and texts[0][:1].isalpha()
        and kinds[0] is not Kind.text
    )


def _fits(fields: list[str], kinds: Sequence[Kind], decimal: str) -> bool:
    """Return whether the fields are a row of these kinds, with a number among them."""
    if len(fields) != len(kinds):
        return False

    has_number = False
    for field, kind in zip(fields, kinds, strict=True):
        if not field:
            continue
        if kind in _TESTED and not _has_kind(field, kind, decimal):
            return False
        has_number = has_number or kind is Kind.number
    return has_number


# Kinds whose fields have a form of their own, in the order in which they are tried.
_TESTED = (Kind.number, Kind.stamp, Kind.date)


def _has_kind(field: str, kind: Kind, decimal: str) -> bool:
    if kind is Kind.number:
        return NUMBER[decimal].fullmatch(field) is not None
    return is_stamp(field) if kind is Kind.stamp else is_date(field)


def _kind(fields: Sequence[str], decimal: str) -> Kind:
    """Return the kind of at least half of a column's fields."""
    texts = [field for field in fields if field]
    if not texts:
        return Kind.blank
    for kind in _TESTED:
        if 2 * sum(_has_kind(text, kind, decimal) for text in texts) >= len(texts):
            return kind
    return Kind.text


def _is_plausible(rows: list[list[str]], kinds: Sequence[Kind], separator: str) -> bool:
    """Return whether a table with words has enough rows, and no likelier separator in the words."""
    if len(rows) < _MIN_ROWS.get(separator, 2):
        return False

    likelier: tuple[str, ...] = ()
    if separator in _SEPARATORS:
        likelier = _SEPARATORS[: _SEPARATORS.index(separator)]
    text_columns = [column for column, kind in enumerate(kinds) if kind is Kind.text]
    texts = [row[column] for row in rows for column in text_columns]
    return not any(mark in text for text in texts for mark in likelier)
