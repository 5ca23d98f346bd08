"""Text tables: any separator, decimal comma, header lines, time stamps; plain or gzipped."""

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError, load_extra, spreadsheet_text
from swashtwin.recordings.columns import Column
from swashtwin.recordings.formats.clock import extract_time, find_time_column, require_one_rate
from swashtwin.recordings.formats.dialects import (
    HEAD_LINES,
    MISSING,
    NUMBER,
    THOUSANDS,
    Kind,
    detect_dialect,
    split_line,
)
from swashtwin.recordings.formats.headings import (
    header_rate,
    header_units,
    parse_header,
    read_sensitivities,
)
from swashtwin.recordings.formats.raw_file import RawFile, ReadOptions
from swashtwin.recordings.formats.text_blocks import (
    MAX_LINE_BYTES,
    drop_empty_rows_at_end,
    read_text_blocks,
    skip_lines,
    trim_blanks,
)
from swashtwin.recordings.formats.text_rows import ParsedRows, RowError, RowParser, decode
from swashtwin.recordings.formats.time_column import NO_UNIT
from swashtwin.recordings.formats.time_stamps import is_stamp
from swashtwin.recordings.recording import Recording

arro3_core: Any = load_extra("arro3.core", "readers", "a text table")
arro3_io: Any = load_extra("arro3.io", "readers", "a text table")

# Lines of the head below those in which the first row is searched.
_FURTHER_HEAD_LINES = 40

# Characters of the header that are kept as an attribute.
_MAX_HEADER_ATTRIBUTE = 2000


def read(path: Path, options: ReadOptions) -> RawFile:
    """Return columns, rate and units of a text table.

    The text is read in blocks, and the numbers of a large one are kept in a temporary file.

    Columns of text are excluded; the attribute ``text_columns`` names them. A column of time stamps
    gives the rate if no column of numbers is the time.
    """
    return _Table(path, _read_head(path, options), options).raw_file(options)


def _read_head(path: Path, options: ReadOptions) -> list[str]:
    """Return the lines among which the first row of the table is."""
    line_count = HEAD_LINES + _FURTHER_HEAD_LINES + (options.header_lines or 0)
    lines: list[bytes] = []
    n_bytes = 0
    for block in read_text_blocks(path):
        lines += block.split(b"\n", line_count)[:line_count]
        n_bytes += len(block)
        if len(lines) >= line_count or n_bytes >= MAX_LINE_BYTES:
            break
    return [decode(line) for line in lines[:line_count]]


class _Table:
    """A text table whose dialect is known.

    If the header is repeated, another recording begins: the breaks are found when the rows are
    parsed.
    """

    def __init__(self, path: Path, lines: Sequence[str], options: ReadOptions) -> None:
        self._path = path
        self._dialect = detect_dialect(path, lines, options)
        self._names, self._units = self._dialect.headings()
        self._kinds = list(self._dialect.kinds)
        self._start = self._dialect.start
        self._breaks: list[int] = []

        header_lines = lines[: self._start]
        self._header = "\n".join(header_lines)
        separator = self._dialect.separator
        self._header_keys = {
            split_line(line.strip(), separator)[0] for line in header_lines if line.strip()
        }
        """First field of each header line."""
        self._header_rows: dict[int, list[int]] = {}
        """Lines of repeated headers in each block of the rows, by the number of the block."""

    def _blocks(self) -> Iterator[bytes]:
        """Yield the lines below the header, without blanks around fields and rows without value."""
        separator = self._dialect.separator.encode()
        blocks = skip_lines(read_text_blocks(self._path), self._start)
        return drop_empty_rows_at_end(
            (trim_blanks(block, separator) for block in blocks), separator
        )

    def raw_file(self, options: ReadOptions) -> RawFile:
        """Return the columns by name, the time as the rate, and the excluded columns' names."""
        columns, blank_names, stamp_starts = self._parse_columns()

        time = find_time_column(self._path, list(columns), options)
        time = time or next(iter(stamp_starts), None)
        is_stamp_time = time in stamp_starts
        attributes = self._table_attributes(blank_names, stamp_starts, time)

        columns = {
            name: values
            for name, values in columns.items()
            if name == time or name not in stamp_starts
        }
        units = {name: unit for name, unit in self._units.items() if name in columns}
        if time is not None and is_stamp_time:
            units[time] = "s"
        if is_stamp_time or options.time_column is not None:
            options = replace(options, time_column=time)

        raw = RawFile(columns, None, units, attributes)
        raw = extract_time(self._path, raw, options, header_rate=self._sampling_rate())
        raw = self._with_header_facts(raw, columns, options)
        return replace(raw, breaks=tuple(self._breaks) or raw.breaks)

    def _table_attributes(
        self, blank_names: list[str], stamp_starts: dict[str, str | None], time: str | None
    ) -> dict[str, str]:
        """Return the header, the excluded columns, and the start by the time stamps."""
        attributes: dict[str, str] = {}
        if self._start > 1:
            attributes["header"] = self._header[:_MAX_HEADER_ATTRIBUTE]

        text_names = [
            name
            for name, kind in zip(self._names, self._kinds, strict=True)
            if kind in (Kind.text, Kind.date)
        ]
        text_names += [name for name in stamp_starts if name != time]
        if text_names:
            attributes["text_columns"] = ", ".join(text_names)

        named_blanks = [name for name in blank_names if not name.startswith("column_")]
        if named_blanks:
            attributes["blank_columns"] = ", ".join(named_blanks)

        start = stamp_starts.get(time or "")
        if start:
            attributes["date"] = start
        return attributes

    def _with_header_facts(
        self, raw: RawFile, columns: dict[str, Column], options: ReadOptions
    ) -> RawFile:
        """Return the content with units, sensitivities and rate that the header lines state."""
        pairs = parse_header(self._header)
        channels = list(raw.columns)

        listed_units = zip(channels, header_units(pairs, len(channels)), strict=True)
        units = {name: unit for name, unit in listed_units if unit}
        units |= raw.units

        sensitivities: dict[str, str] = {}
        texts = read_sensitivities(pairs)
        if len(texts) == 1:
            texts *= len(channels)
        if len(texts) == len(channels):
            sensitivities = dict(zip(channels, texts, strict=True))

        sampling_rate = self._sampling_rate()
        if raw.sample_rate and sampling_rate and options.time_column is None:
            clock = next(iter(columns.keys() - raw.columns.keys()))
            require_one_rate(self._path, channels[0], sampling_rate, raw.sample_rate, clock)

        rate = raw.sample_rate or header_rate(pairs)
        attributes = dict(raw.attributes)
        if rate and attributes.get("time_gaps", "").startswith(NO_UNIT):
            del attributes["time_gaps"]
        return replace(
            raw,
            sample_rate=rate,
            units=units,
            sensitivities=sensitivities,
            attributes=attributes,
        )

    def _sampling_rate(self) -> float | None:
        """Return the rate [Hz] that a header line states by a name of sampling."""
        sampling_pairs = [
            (name, text)
            for name, text in parse_header(self._header)
            if re.match(r"fs|sampl|abtast", name, re.IGNORECASE)
        ]
        return header_rate(sampling_pairs)

    def _parse_columns(self) -> tuple[dict[str, Column], list[str], dict[str, str | None]]:
        """Return numbers and seconds by name, names of blank columns, and starts of time stamps."""
        rows = self._parse_rows()
        columns: dict[str, Column] = {}
        blank_names: list[str] = []
        starts: dict[str, str | None] = {}
        for column, (name, kind) in enumerate(zip(self._names, self._kinds, strict=True)):
            if kind in (Kind.text, Kind.date):
                continue

            if column in rows.stamps:
                stamps = rows.stamps[column]
                seconds, starts[name] = stamps.seconds(self._path)
                if np.isnan(seconds).sum() != stamps.n_missing:
                    raise self._damage()
                columns[name] = seconds
            elif column in rows.numbers:
                columns[name] = rows.numbers[column]
            else:
                blank_names.append(name)
        return columns, blank_names, starts

    def _parse_rows(self) -> ParsedRows:
        """Return numbers and time stamps by column; those without any value are absent.

        A column that is blank in the head may hold numbers, or else text: its kind is then changed.
        """
        dialect = self._dialect
        parser = RowParser(self._path, dialect.separator, dialect.decimal, len(self._kinds))
        numbers = self._columns_of(Kind.number)
        stamps = self._columns_of(Kind.stamp)
        blanks = self._columns_of(Kind.blank)
        with suppress(RowError):
            return parser.parse(self._rows(), [*numbers, *blanks], stamps)

        try:
            rows = parser.parse(self._rows(), numbers, stamps)
        except RowError as cause:
            if self._header_rows or not self._find_repeated_headers():
                raise self._damage() from cause
            return self._parse_rows()

        for column in blanks:
            try:
                rows.numbers.update(parser.parse(self._rows(), [column]).numbers)
            except RowError:
                self._kinds[column] = Kind.text
        return rows

    def _columns_of(self, kind: Kind) -> list[int]:
        return [column for column, other_kind in enumerate(self._kinds) if other_kind is kind]

    def _rows(self) -> Iterator[bytes]:
        """Yield the rows in blocks of lines, without the repeated headers that were found."""
        for number, block in enumerate(self._blocks()):
            header_rows = self._header_rows.get(number)
            if header_rows is None:
                yield block
                continue

            lines = block.split(b"\n")
            for index in reversed(header_rows):
                del lines[index]
            if lines:
                yield b"\n".join(lines)

    def _find_repeated_headers(self) -> bool:
        """Find lines that begin as one of the header does, and note the breaks.

        Return whether there is such a line, and a row. Blank lines around a header belong to it.
        """
        separator = self._dialect.separator
        n_rows = 0
        for number, index, line, next_line in self._lines_with_next():
            text = decode(line).strip()
            is_break = self._breaks[-1:] == [n_rows]
            if text:
                is_header = split_line(text, separator)[0] in self._header_keys
            else:
                is_header = (
                    is_break
                    or next_line is None
                    or decode(next_line).strip().split(separator)[0] in self._header_keys
                )

            if not is_header:
                n_rows += 1
                continue
            self._header_rows.setdefault(number, []).append(index)
            if not is_break:
                self._breaks.append(n_rows)

        if not self._header_rows or not n_rows:
            return False
        self._breaks = [row for row in self._breaks if row]
        return True

    def _lines_with_next(self) -> Iterator[tuple[int, int, bytes, bytes | None]]:
        """Yield the number of a block, the index of a line in it, the line, and the next line."""
        previous: tuple[int, int, bytes] | None = None
        for number, block in enumerate(self._blocks()):
            for index, line in enumerate(block.split(b"\n")):
                if previous is not None:
                    yield *previous, line
                previous = number, index, line
        if previous is not None:
            yield *previous, None

    def _damage(self) -> DataError:
        """Return the error of the first damaged line."""
        lines = (line for block in self._blocks() for line in block.split(b"\n"))
        for number, line in enumerate(lines, self._start + 1):
            fields = split_line(decode(line), self._dialect.separator)
            if self._breaks and (not line.strip() or fields[0] in self._header_keys):
                continue

            # A line above which the table does not begin yet looks like a damaged one.
            remedy = ""
            if number <= HEAD_LINES:
                remedy = f"Set {{header_lines={number}}} if the table begins below it."
            if len(fields) != len(self._kinds):
                return DataError(
                    f"{self._path}: line {number} has {len(fields)} columns, "
                    f"not {len(self._kinds)}; the file may be cut off.",
                    field="header_lines" if remedy else "",
                    remedy=remedy,
                )

            error = self._field_damage(number, fields, remedy)
            if error is not None:
                return error
        return DataError(
            f"{self._path}: the rows after line {self._start} cannot be read; the file is damaged."
        )

    def _field_damage(self, number: int, fields: list[str], remedy: str) -> DataError | None:
        """Return the error of the first field that is not of its column's kind, or None."""
        is_number = NUMBER[self._dialect.decimal].fullmatch
        for field, kind, name in zip(fields, self._kinds, self._names, strict=True):
            location = f"{self._path}: line {number}: {field[:40]!r} in column {name!r}"
            if kind is Kind.number and field not in MISSING and not is_number(field):
                if THOUSANDS.fullmatch(field):
                    return DataError(
                        f"{location} has marks for thousands; write the numbers without them."
                    )
                if any(is_number(text) for text in fields):
                    remedy = ""  # a row of the table, in which this field is damaged
                return DataError(
                    f"{location} is not a number; correct it.",
                    field="header_lines" if remedy else "",
                    remedy=remedy,
                )
            if kind is Kind.stamp and field and not is_stamp(field):
                return DataError(f"{location} is not a time stamp.")
        return None


def write(recording: Recording, path: Path) -> None:
    """Write time and channels as comma-separated text in full double precision."""
    table = {"time [s]": recording.time}
    for name, samples in zip(recording.channels, recording.signal, strict=True):
        table[spreadsheet_text(f"{name} [{recording.unit}]")] = samples
    with path.open("wb") as file:
        arrays = {heading: arro3_core.Array(values) for heading, values in table.items()}
        arro3_io.write_csv(arro3_core.Table.from_pydict(arrays), file)
