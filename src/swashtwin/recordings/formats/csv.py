"""Text tables: any separator, decimal comma, header lines, time stamps; plain or gzipped."""

import codecs
import gzip
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import (
    DataError,
    load_extra,
    memory_limit,
    require_memory,
    spreadsheet_text,
)
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
from swashtwin.recordings.formats.text_rows import MISSING_TEXTS, RowError, RowParser, decode
from swashtwin.recordings.formats.time_column import NO_UNIT
from swashtwin.recordings.formats.time_stamps import is_stamp, stamp_seconds
from swashtwin.recordings.recording import Recording

arro3_core: Any = load_extra("arro3.core", "readers", "a text table")
arro3_io: Any = load_extra("arro3.io", "readers", "a text table")

# Longest line, and bytes at the beginning in which the head lies.
_MAX_HEAD_BYTES = 1 << 24

# Lines of the head below those in which the first row is searched.
_FURTHER_HEAD_LINES = 40

# Characters of the header that are kept as an attribute.
_MAX_HEADER_ATTRIBUTE = 2000

# Bytes of text per byte of a gzipped file; more is not a measurement.
_MAX_EXPANSION = 300

# Text that any gzipped file may hold.
_UNLIMITED_TEXT_BYTES = 1 << 28

# Memory per byte of text: the lines, their fields, and the numbers.
_BYTES_IN_MEMORY = 3


def read(path: Path, options: ReadOptions) -> RawFile:
    """Return columns, rate and units of a text table, which is read whole.

    Columns of text are excluded; the attribute ``text_columns`` names them. A column of time stamps
    gives the rate if no column of numbers is the time.
    """
    text = _read_text(path)

    line_count = HEAD_LINES + _FURTHER_HEAD_LINES + (options.header_lines or 0)
    head = text[:_MAX_HEAD_BYTES].split(b"\n", line_count)[:line_count]
    if max(map(len, head)) >= _MAX_HEAD_BYTES:
        raise DataError(
            f"{path} has a line of more than {_MAX_HEAD_BYTES >> 20} MB; it is not a table."
        )

    return _Table(path, text, [decode(line) for line in head], options).raw_file(options)


class _Table:
    """A text table whose dialect is known.

    If the header is repeated, another recording begins: the breaks are found when the rows are
    parsed.
    """

    def __init__(self, path: Path, text: bytes, lines: Sequence[str], options: ReadOptions) -> None:
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

        body = _trim_blanks(text.split(b"\n", self._start)[-1], separator.encode())
        last_value = len(body.rstrip(b"\n" + separator.encode()))
        end = body.find(b"\n", last_value)  # rows without any value may follow
        self._body = body if end < 0 else body[:end]

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
        self, raw: RawFile, columns: dict[str, np.ndarray], options: ReadOptions
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

    def _parse_columns(
        self,
    ) -> tuple[dict[str, np.ndarray], list[str], dict[str, str | None]]:
        """Return numbers and seconds by name, names of blank columns, and starts of time stamps."""
        table = self._parse_rows(self._body)
        columns: dict[str, np.ndarray] = {}
        blank_names: list[str] = []
        starts: dict[str, str | None] = {}
        for column, (name, kind) in enumerate(zip(self._names, self._kinds, strict=True)):
            if kind in (Kind.text, Kind.date):
                continue

            if column not in table:
                blank_names.append(name)
            elif kind is Kind.stamp:
                texts = table[column]
                columns[name], starts[name] = stamp_seconds(self._path, texts)
                if not MISSING_TEXTS.issuperset(texts[np.isnan(columns[name])].tolist()):
                    raise self._damage()
            else:
                columns[name] = table[column]
        return columns, blank_names, starts

    def _parse_rows(self, body: bytes) -> dict[int, np.ndarray]:
        """Return numbers and texts of time stamps by column; those without any value are absent.

        A column that is blank in the head may hold numbers, or else text: its kind is then changed.
        """
        parser = RowParser(self._dialect.separator, self._dialect.decimal, len(self._kinds))
        numbers = self._columns_of(Kind.number)
        stamps = self._columns_of(Kind.stamp)
        blanks = self._columns_of(Kind.blank)
        with suppress(RowError):
            return parser.parse(body, [*numbers, *blanks], stamps)

        try:
            table = parser.parse(body, numbers, stamps)
        except RowError as cause:
            rows = self._without_repeated_headers(body)
            if rows is None:
                raise self._damage() from cause
            return self._parse_rows(rows)

        for column in blanks:
            try:
                table |= parser.parse(body, [column])
            except RowError:
                self._kinds[column] = Kind.text
        return table

    def _columns_of(self, kind: Kind) -> list[int]:
        return [column for column, other_kind in enumerate(self._kinds) if other_kind is kind]

    def _without_repeated_headers(self, body: bytes) -> bytes | None:
        """Return the rows without lines that begin as one of the header does, and note the breaks.

        None if there is no such line. Blank lines around a header belong to it.
        """
        separator = self._dialect.separator
        lines = body.split(b"\n")
        rows: list[bytes] = []
        for number, line in enumerate(lines):
            text = decode(line).strip()
            is_break = self._breaks[-1:] == [len(rows)]
            if text:
                is_header = split_line(text, separator)[0] in self._header_keys
            else:
                next_lines = lines[number + 1 : number + 2]
                is_header = is_break or all(
                    decode(next_line).strip().split(separator)[0] in self._header_keys
                    for next_line in next_lines
                )

            if not is_header:
                rows.append(line)
            elif not is_break:
                self._breaks.append(len(rows))

        if len(rows) == len(lines) or not rows:
            return None
        self._breaks = [row for row in self._breaks if row]
        return b"\n".join(rows)

    def _damage(self) -> DataError:
        """Return the error of the first damaged line."""
        for number, line in enumerate(self._body.split(b"\n"), self._start + 1):
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


def _read_text(path: Path) -> bytes:
    """Return the text in UTF-8 or Latin-1, with a line feed at the end of each line."""
    size = path.stat().st_size
    if path.suffix.lower() == ".gz":
        text = _unpack(path, size)
    else:
        require_memory(path, _BYTES_IN_MEMORY * size)
        text = path.read_bytes()

    if text[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        text = text.decode("utf-16").encode()
    text = text.removeprefix(codecs.BOM_UTF8)
    if b"\0" in text[:4096]:
        raise DataError(f"{path} is a binary file, not a text table.")

    if b"\r" in text:
        text = text.replace(b"\r\r\n", b"\n").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    minus_sign = "\u2212".encode()
    return text.replace("∞".encode(), b"inf").replace(minus_sign, b"-")


def _unpack(path: Path, size: int) -> bytes:
    """Return the text of a gzipped file of `size` bytes, unless it is implausibly long."""
    max_length = max(_MAX_EXPANSION * size, _UNLIMITED_TEXT_BYTES)
    with gzip.open(path) as file:
        text = file.read(min(max_length, memory_limit() // _BYTES_IN_MEMORY) + 1)
    if len(text) > max_length:
        raise DataError(
            f"{path} unpacks to more than {_MAX_EXPANSION} times its size; it is not a measurement."
        )
    require_memory(path, _BYTES_IN_MEMORY * len(text))
    return text


def _trim_blanks(data: bytes, separator: bytes) -> bytes:
    """Return lines without blanks around their fields; between words one blank remains."""
    if separator != b"\t" and b"\t" in data:
        data = data.replace(b"\t", b" ")
    if b" " not in data:
        return data

    while b"  " in data:
        data = data.replace(b"  ", b" ")
    for mark in {separator, b"\n"} - {b" "}:
        data = data.replace(b" " + mark, mark).replace(mark + b" ", mark)
    return data.strip(b" ")
