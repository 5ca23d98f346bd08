"""The dialect of a text table: its separator, decimal mark, header, and what each column holds."""

import csv
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from pathlib import Path

from swashtwin.foundation import DataError
from swashtwin.recordings.formats.clock import match_time_name
from swashtwin.recordings.formats.headings import TRADE_UNITS, split_unit
from swashtwin.recordings.formats.raw_file import ReadOptions
from swashtwin.recordings.formats.sample_units import normalize_unit, recognize_unit
from swashtwin.recordings.formats.time_stamps import is_date, is_stamp

_SEPARATORS = ("\t", ";", "|", ",", " ")
"""Separators, the least likely to stand within a text first."""
NUMBER = {
    ".": re.compile(
        r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?|[+-]?(nan|inf|infinity|∞)", re.IGNORECASE
    ),
    ",": re.compile(
        r"[+-]?(\d+,?\d*|,\d+)([eEdD][+-]?\d+)?|[+-]?(nan|inf|infinity|∞)", re.IGNORECASE
    ),
}
"""A number with each decimal mark."""
MISSING = ("", "N/A", "n/a", "#N/A", "NA", "null", "NULL", "None", "-", "--", "---", "?",
           "-nan(ind)", "nan(ind)", "-1.#IND", "1.#QNAN", "#NUM!", "#DIV/0!", "#VALUE!")  # fmt: skip
"""What programs write for a sample that is missing."""
_GROUPED = {mark: re.compile(rf"[+-]?[1-9]\d{{0,2}}{re.escape(mark)}\d{{3}}") for mark in ".,"}
THOUSANDS = re.compile(r"[+-]?\d{1,3}([. ']\d{3})+(,\d+)?|[+-]?\d{1,3}([, ']\d{3})+(\.\d+)?")
"""A number with marks for thousands."""
_TAIL = 40
"""Lines at the end of the head that decide what the columns hold."""
HEAD = 1000
"""Lines among which the first row is searched."""
_SENSOR_NAME = re.compile(
    r"(?:sensor|channel|node|device|module|ch|addr\w*)?[ _]?(?:id|no|nr)|sensor|node", re.IGNORECASE
)
"""Headings of columns that tell which sensor a row is of."""
_LABVIEW = "***End_of_Header***"
_NEEDLESS = ("", "Comment")
"""Last headings for which rows may lack a column: LabVIEW writes one for comments that are none."""
_TYPES = (
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
"""What a line below the headings may say of numbers, and no heading."""
_FEW_ROWS = {" ": 8}
"""Rows that a table with a column of words has at least, two by default: a few lines of prose can
be alike.
"""


class Kind(Enum):
    """What a column holds."""

    number = "numbers"
    stamp = "time stamps"
    date = "dates"
    text = "text"
    blank = "nothing"


def split_line(line: str, separator: str) -> list[str]:
    """Fields of a line without the blanks and quotation marks around them."""
    if separator == " ":
        return re.sub(r"\s+([\[(][^\s()\[\]]*[)\]])", r"\1", line).split()  # "x [g]" is one heading
    fields = (
        next(csv.reader([line], delimiter=separator), [""])
        if '"' in line
        else line.split(separator)
    )
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
    """Fields of the line with the headings, and of the line above it where these can be headings,
    too.
    """
    rows: list[list[str]]
    """Fields of the rows that decided the kinds."""

    def merit(self) -> tuple[bool, int, int, bool, int]:
        """Layouts without text first, then most columns of numbers, most rows that fit, the
        earliest start.
        """
        counts = Counter(self.kinds)
        has_time = (
            counts[Kind.stamp] + counts[Kind.date] > 0
        )  # a blank may part a date from its time
        fitting = sum(_fits(row, self.kinds, self.decimal) for row in self.rows)
        return (
            not counts[Kind.text],
            counts[Kind.number] + has_time,
            fitting,
            self.separator != " ",
            -self.start,
        )

    def refuse_thousands(self, path: Path) -> None:
        """Refuse ``1.234,5``, and ``1,234``, which may be a number above one or above a
        thousand.
        """
        for column, kind in enumerate(self.kinds):
            fields = [row[column] for row in self.rows if row[column]]
            marked = [field for field in fields if THOUSANDS.fullmatch(field)]
            if kind is Kind.text and 2 * len(marked) > len(fields):
                raise DataError(
                    f"{path}: {marked[0]!r} has marks for thousands; write the numbers without them."
                )
            if kind is not Kind.number:
                continue
            grouped = [field for field in fields if _GROUPED[self.decimal].fullmatch(field)]
            short = [field for field in fields if re.fullmatch(r"[+-]?\d{1,3}", field)]
            if (
                grouped
                and len(grouped) + len(short) == len(fields)
                and (short or self.decimal == ",")
            ):
                whole = grouped[0].replace(self.decimal, "")
                raise DataError(
                    f"{path}: {grouped[0]!r} may be {whole}, or {grouped[0].replace(self.decimal, '.')}; say decimal = "
                    f'"{self.decimal}", or write the numbers without marks for thousands.'
                )

    def refuse_ambiguous(self, path: Path, lines: Sequence[str]) -> None:
        """Refuse ``3,14``: two columns, or one number with a decimal comma."""
        if self.separator != "," or len(self.kinds) != 2 or self.header:
            return
        if not any("." in field for row in self.rows for field in row):
            raise DataError(
                f"{path}: line {self.start + 1} ({lines[self.start].strip()!r}) may be two columns or one decimal "
                'comma; say separator = "," or decimal = ",".'
            )

    def refuse_other_headings(self, path: Path, lines: Sequence[str]) -> None:
        """Refuse fewer or more headings, or units, than columns: whose they are cannot be told."""
        number = next(
            (number for number in range(self.start - 1, -1, -1) if lines[number].strip()), None
        )
        fields = [] if number is None else split_line(_uncommented(lines[number]), self.separator)
        while fields and fields[-1] in _NEEDLESS:
            fields.pop()
        width = max(column for column, kind in enumerate(self.kinds, 1) if kind is not Kind.blank)
        is_heading = any(
            fields == header[: len(fields)] and not any(header[len(fields) :])
            for header in self.header
        )
        if not fields or is_heading or (self.separator == " " and not match_time_name(fields[0])):
            return
        words = (
            not NUMBER[self.decimal].fullmatch(field) and any(map(str.isalpha, field))
            for field in fields
        )
        if 1 < len(fields) != width and all(words):
            raise DataError(
                f"{path}: line {(number or 0) + 1} has {len(fields)} headings for {width} columns; name each, "
                f"or say header_lines = {self.start}."
            )

    def refuse_tagged(self, path: Path, lines: Sequence[str]) -> None:
        """Refuse rows of several sensors by turns, which hold the name or the number of theirs."""
        rows = [split_line(line, self.separator) for line in lines[self.start :] if line.strip()]
        headings = self.header[0] if self.header else [""] * len(self.kinds)
        for column, kind in enumerate(self.kinds):
            is_named = _SENSOR_NAME.fullmatch(headings[column]) is not None
            may_number = column == 0 and not self.header
            if kind is not Kind.text and not is_named and not may_number:
                continue
            tags = [row[column] for row in rows if column < len(row)]
            turns = sum(tag != other for tag, other in pairwise(tags))
            rare = 4 if column else 20
            rare = 20 if is_named else 2 if may_number and kind is Kind.number else rare
            are_tags = kind is not Kind.number or all(map(str.isdecimal, tags))
            if (
                are_tags
                and 1 < len(set(tags)) <= 8
                and turns >= max(3, len(set(tags)), len(tags) // rare)
            ):
                raise DataError(
                    f"{path}: its rows are of {len(set(tags))} sensors by turns ({', '.join(sorted(set(tags)))}); save "
                    "the rows of each in a file of its own."
                )

    def headings(self) -> tuple[tuple[str, ...], dict[str, str]]:
        """Names of the columns, and the unit of each for which its heading, or the line below that,
        states one.
        """
        header = self.header[0] if self.header else [""] * len(self.kinds)
        below: list[str] = []
        texts = [text for text in header if text.strip("-")] if len(self.header) > 1 else []
        clear = [text[0] in "[(" or normalize_unit(text) in TRADE_UNITS for text in texts]
        if any(clear) and all(
            is_unit or recognize_unit(text) for text, is_unit in zip(texts, clear, strict=True)
        ):
            header, below = self.header[1], header  # a line of units below the names
        names: list[str] = []
        units: dict[str, str] = {}
        for number, heading in enumerate(header):
            name, unit = split_unit(heading)
            if below and below[number].strip("[]() "):
                unit = below[number].strip("[]() ") if below[number][0] in "[(" else below[number]
            if name[:2] in ("'=", "'+", "'-", "'@"):
                name = name[
                    1:
                ]  # an apostrophe that keeps a spreadsheet from taking the name for a formula
            name = f"{name}_{number}" if name in names else name or f"column_{number}"
            names.append(name)
            if unit and (recognize_unit(unit) or normalize_unit(unit) in TRADE_UNITS):
                units[name] = normalize_unit(unit)
        return tuple(names), units


def dialect_of(path: Path, lines: Sequence[str], options: ReadOptions) -> Dialect:
    """Dialect of the table that begins with these lines."""
    if lines and lines[0].startswith(("DIAEXTENDED", "DIADEM")):
        raise DataError(
            f"{path} is the header of a DIAdem data set, whose samples are in another file; export it as text."
        )
    separators = (options.separator,) if options.separator else _SEPARATORS
    decimals = (options.decimal,) if options.decimal else (".", ",")
    candidates = [
        layout
        for separator in separators
        for decimal in decimals
        if separator != decimal
        and (layout := _layout(lines, separator, decimal, options.header_lines)) is not None
    ]
    if not candidates:
        raise DataError(
            f"{path} holds no table of numbers that could be found; say how it is written, "
            'for example separator = ";", decimal = ",", header_lines = 8.'
        )
    best = max(candidates, key=Dialect.merit)
    if options.decimal is None:
        best.refuse_thousands(path)
        if options.separator is None:
            best.refuse_ambiguous(path, lines)
    if options.header_lines is None:
        best.refuse_other_headings(path, lines)
    best.refuse_tagged(path, lines)
    return best


def _uncommented(line: str) -> str:
    """A line of a header without the marks of a comment; a lone ``#`` is the heading of a
    counter.
    """
    return line if re.match(r"#\s*[\t;,|]", line) else line.lstrip("%# ")


def _layout(
    lines: Sequence[str], separator: str, decimal: str, header_lines: int | None
) -> Dialect | None:
    """How the lines read with one separator and one decimal mark; None where they are no table."""
    ends = [number for number, line in enumerate(lines, 1) if line.startswith(_LABVIEW)]
    first = header_lines or max(
        ends[:2], default=0
    )  # LabVIEW writes a header of the file, and one of its samples
    fields = {
        number: split_line(_uncommented(line), separator)
        for number, line in enumerate(lines)
        if number >= first and line.strip()
    }
    tail = list(fields)[-_TAIL:]
    tests = _tests(decimal).values()
    wordy = [
        number
        for number in tail
        if not any(test(field) for field in fields[number] for test in tests)
    ]
    voters = [number for number in tail if not wordy or number > wordy[-1]] or tail
    if not voters:
        return None
    width = Counter(len(fields[number]) for number in reversed(voters)).most_common(1)[0][0]
    rows = [fields[number] for number in voters if len(fields[number]) == width]
    kinds = tuple(_kind([row[column] for row in rows], decimal) for column in range(width))
    if Kind.number not in kinds or (
        Kind.text in kinds and not _is_plausible(rows, kinds, separator)
    ):
        return None
    start = first
    if header_lines is None:
        fitting = [
            number for number in fields if number < HEAD and _fits(fields[number], kinds, decimal)
        ]
        if not fitting:
            return None
        follows = dict(
            pairwise(fields)
        )  # a preamble may hold one line that is like a row, and not two
        start = next((number for number in fitting if follows.get(number) in fitting), fitting[-1])
    header = _header(fields, start, kinds, decimal)
    if header_lines is None:
        start = (
            header[0] + 1
            if header[0] == start
            else _first_row(fields, header[0], start, kinds, decimal)
        )
    return Dialect(separator, decimal, start, kinds, header[1], rows)


def _header(
    fields: dict[int, list[str]], start: int, kinds: Sequence[Kind], decimal: str
) -> tuple[int, tuple[list[str], ...]]:
    """Line with the headings, -1 where there is none, and its fields with those of the line above
    it.
    """
    width = len(kinds)
    blank = next(
        (number for number, kind in enumerate(reversed(kinds)) if kind is not Kind.blank), 0
    )
    if width > 2 and _is_counted(fields.get(start, []), width):
        return start, (fields[start],)
    for number in sorted((number for number in fields if number < start), reverse=True):
        if (texts := _headings(fields[number], width, decimal, blank=blank)) is not None:
            above = _headings(fields.get(number - 1, []), width, decimal, blank=blank)
            return number, (texts,) if above is None else (texts, above)
    return -1, ()


def _headings(fields: list[str], width: int, decimal: str, *, blank: int = 0) -> list[str] | None:
    """The fields where they can be headings of so many columns: words, or words before numbered
    columns.

    The last columns that are `blank` need no heading.
    """
    fields = (
        [*fields, *[""] * (width - len(fields))] if width - blank <= len(fields) < width else fields
    )
    fields = fields[:-1] if len(fields) == width + 1 and fields[-1] in _NEEDLESS else fields
    numbers = [field for field in fields if NUMBER[decimal].fullmatch(field)]
    wordy = any(character.isalpha() for field in fields for character in field)
    if (
        len(fields) != width
        or not wordy
        or fields[0].endswith(":")
        or all(field.lower().removeprefix("dt_") in _TYPES for field in fields if field)
        or (numbers and not _is_counted(numbers, len(numbers)))
    ):
        return None
    return fields


def _is_counted(fields: Sequence[str], count: int) -> bool:
    """Whether the fields are 0, 1, 2, ... or 1, 2, 3, ...: numbered columns, not samples."""
    return count > 1 and any(
        list(fields) == [str(first + number) for number in range(count)] for first in (0, 1)
    )


def _first_row(
    fields: dict[int, list[str]], header: int, start: int, kinds: Sequence[Kind], decimal: str
) -> int:
    """First line of numbers below the headings, damaged or not: none is skipped."""
    numbers = [column for column, kind in enumerate(kinds) if kind is Kind.number]
    for number, texts in fields.items():
        is_fact = (
            len(texts) != len(kinds)
            and texts
            and texts[0][:1].isalpha()
            and kinds[0] is not Kind.text
        )  # "Rate", "10000"
        if header < number < start and not is_fact:
            if header >= 0 and any(NUMBER[decimal].fullmatch(text) for text in texts):
                return number
            values = [
                bool(NUMBER[decimal].fullmatch(texts[column]))
                for column in numbers
                if len(texts) == len(kinds)
            ]
            if header < 0 and sum(values) * 2 > len(numbers):
                return number
    return start


def _fits(fields: list[str], kinds: Sequence[Kind], decimal: str) -> bool:
    """Whether the fields are a row of these kinds, with one number at least."""
    if len(fields) != len(kinds):
        return False
    pairs = [(field, kind) for field, kind in zip(fields, kinds, strict=True) if field]
    tests = _tests(decimal)
    return any(kind is Kind.number for _, kind in pairs) and all(
        kind not in tests or tests[kind](field) for field, kind in pairs
    )


def _tests(decimal: str) -> dict[Kind, Callable[[str], bool]]:
    return {
        Kind.number: lambda field: NUMBER[decimal].fullmatch(field) is not None,
        Kind.stamp: is_stamp,
        Kind.date: is_date,
    }


def _kind(fields: Sequence[str], decimal: str) -> Kind:
    texts = [field for field in fields if field]
    likely = (
        kind for kind, test in _tests(decimal).items() if 2 * sum(map(test, texts)) >= len(texts)
    )
    return next(likely, Kind.text) if texts else Kind.blank


def _is_plausible(rows: list[list[str]], kinds: Sequence[Kind], separator: str) -> bool:
    better = _SEPARATORS[: _SEPARATORS.index(separator)] if separator in _SEPARATORS else ()
    texts = [row[column] for row in rows for column, kind in enumerate(kinds) if kind is Kind.text]
    return len(rows) >= _FEW_ROWS.get(separator, 2) and not any(
        mark in text for text in texts for mark in better
    )
