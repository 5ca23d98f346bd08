"""Text tables: any separator, decimal comma, a block of header lines, time stamps, plain or
gzipped.
"""

import codecs
import gzip
import io
import re
from collections.abc import Sequence
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
    HEAD,
    MISSING,
    NUMBER,
    THOUSANDS,
    Kind,
    dialect_of,
    split_line,
)
from swashtwin.recordings.formats.headings import (
    header_rate,
    header_units,
    parse_header,
    read_sensitivities,
)
from swashtwin.recordings.formats.raw_file import RawFile, ReadOptions
from swashtwin.recordings.formats.time_column import NO_UNIT
from swashtwin.recordings.formats.time_stamps import is_stamp, stamp_seconds
from swashtwin.recordings.recording import Recording

polars: Any = load_extra("polars", "readers", "a text table")

_BYTES = 1 << 24
"""Longest line, and bytes at the beginning that hold the head."""
_EXPANSION = 300
"""Bytes of text per byte of a gzipped file beyond which it holds no measurement."""
_FORTRAN = re.compile(rb"(?<=\d|\.)[dD](?=[+-]?\d)")
"""The mark of an exponent as Fortran writes it."""
_LONGEST_TEXT = 1 << 28
"""Bytes of text that any gzipped file may hold."""
_WHOLE = 3
"""Bytes of memory per byte of text: the lines, their fields, and the numbers."""


def read(path: Path, options: ReadOptions) -> RawFile:
    """Columns, rate and units of a text table, which is read whole.

    Columns of text are left out; the attribute ``text_columns`` names them. A column of time stamps
    gives the rate where no column of numbers is the time.
    """
    text = _text_of(path)
    most = HEAD + 40 + (options.header_lines or 0)
    head = text[:_BYTES].split(b"\n", most)[:most]
    if max(map(len, head)) >= _BYTES:
        raise DataError(f"{path} has a line of more than {_BYTES >> 20} MB; that is no table.")
    return _Table(path, text, [_decode(line) for line in head], options).raw_file(options)


class _Table:
    def __init__(self, path: Path, text: bytes, lines: Sequence[str], options: ReadOptions) -> None:
        self._path = path
        self._dialect = dialect_of(path, lines, options)
        self._names, self._units = self._dialect.headings()
        self._kinds = list(self._dialect.kinds)
        self._start = self._dialect.start
        self._header = "\n".join(lines[: self._start])
        self._attributes = {"header": self._header[:2000]} if self._start > 1 else {}
        separator = self._dialect.separator
        self._keys = {
            split_line(line.strip(), separator)[0] for line in lines[: self._start] if line.strip()
        }
        self._breaks: list[int] = []
        body = _trimmed(text.split(b"\n", self._start)[-1], separator.encode())
        end = body.find(
            b"\n", len(body.rstrip(b"\n" + separator.encode()))
        )  # rows without a value at the end
        self._body = body if end < 0 else body[:end]

    def _frame(self, body: bytes) -> Any:
        """The fields of whole lines as a table of polars; a blank field is null."""
        separator, comma = self._dialect.separator, self._dialect.decimal == ","
        if (b"D" in body or b"d" in body) and _FORTRAN.search(body):
            body = _FORTRAN.sub(b"e", body)
        numbers = (
            polars.String if comma and b"." in body else polars.Float64
        )  # polars takes a point for a comma, too
        try:
            frame = polars.read_csv(
                io.BytesIO(body),
                has_header=False,
                separator=separator,
                decimal_comma=comma,
                null_values=list(MISSING),
                quote_char='"' if b'"' in body else None,
                encoding="utf8-lossy",
                schema={
                    str(column): numbers if kind is Kind.number else polars.String
                    for column, kind in enumerate(self._kinds)
                },
            )
        except polars.exceptions.PolarsError as cause:
            if (rows := self._without_headings(body)) is not None:
                return self._frame(rows)
            raise self._damage() from cause
        lines = body.count(b"\n") + 1
        has_width = b'"' in body or body.count(separator.encode()) == lines * (len(self._kinds) - 1)
        if frame.height != lines or not has_width:
            if (rows := self._without_headings(body)) is not None:
                return self._frame(rows)
            raise self._damage()
        return frame

    def _without_headings(self, body: bytes) -> bytes | None:
        """The rows without lines that begin as one of the header does: another recording begins
        below them.
        """
        separator = self._dialect.separator
        rows: list[bytes] = []
        lines = body.split(b"\n")
        for number, line in enumerate(lines):
            text = _decode(line).strip()
            follows = (
                number + 1 == len(lines)
                or _decode(lines[number + 1]).strip().split(separator)[0] in self._keys
            )
            is_break = self._breaks[-1:] == [len(rows)]
            if (text and split_line(text, separator)[0] in self._keys) or (
                not text and (follows or is_break)
            ):
                self._breaks += [] if is_break else [len(rows)]
            else:
                rows.append(line)
        if len(rows) == len(lines) or not rows:
            return None
        self._breaks = [number for number in self._breaks if number]
        return b"\n".join(rows)

    def _columns(self) -> tuple[dict[str, np.ndarray], list[str], dict[str, str | None]]:
        """Numbers, and seconds of time stamps, by name; names of blank columns; and the start by
        the time stamps.
        """
        frame = self._frame(self._body)
        columns: dict[str, np.ndarray] = {}
        blank: list[str] = []
        starts: dict[str, str | None] = {}
        for column, (name, kind) in enumerate(zip(self._names, self._dialect.kinds, strict=True)):
            series = frame[str(column)]
            missing = series.null_count()
            if kind in (Kind.text, Kind.date):
                continue
            if missing == frame.height:
                blank.append(name)
            elif kind is Kind.stamp:
                columns[name], starts[name] = stamp_seconds(self._path, series)
                if int(np.isnan(columns[name]).sum()) != missing:
                    raise self._damage()
            elif series.dtype == polars.String:
                if self._dialect.decimal == ",":
                    series = series.set(series.str.contains(".", literal=True), None)
                    series = series.str.replace(",", ".", literal=True)
                numbers = series.cast(polars.Float64, strict=False)
                if numbers.null_count() == missing:
                    columns[name] = numbers.to_numpy()
                elif kind is Kind.blank:
                    self._kinds[column] = Kind.text
                else:
                    raise self._damage()
            else:
                columns[name] = series.to_numpy()
        return columns, blank, starts

    def _damage(self) -> DataError:
        decimal, width = self._dialect.decimal, len(self._kinds)
        for number, line in enumerate(self._body.split(b"\n"), self._start + 1):
            fields = split_line(_decode(line), self._dialect.separator)
            if self._breaks and (not line.strip() or fields[0] in self._keys):
                continue
            advice = (
                f", or say header_lines = {number} if the table begins below it"
                if number <= HEAD
                else ""
            )
            if len(fields) != width:
                reason = f"has {len(fields)} columns, not {width}; the file may be cut off{advice}"
                return DataError(f"{self._path}: line {number} {reason}.")
            for field, kind, name in zip(fields, self._kinds, self._names, strict=True):
                if reason := _misread(field, kind, decimal):
                    has_number = any(NUMBER[decimal].fullmatch(other) for other in fields)
                    advice = advice if reason.endswith("it") and not has_number else ""
                    where = f"{self._path}: line {number}: {field[:40]!r} in column {name!r}"
                    return DataError(f"{where} {reason}{advice}.")
        return DataError(
            f"{self._path}: the rows after line {self._start} cannot be read; the file is damaged."
        )

    def raw_file(self, options: ReadOptions) -> RawFile:
        """The columns under their names, the time as the rate, and which columns were left out."""
        columns, blank, stamps = self._columns()
        words = [
            name
            for name, kind in zip(self._names, self._kinds, strict=True)
            if kind in (Kind.text, Kind.date)
        ]
        time = find_time_column(self._path, list(columns), options) or next(iter(stamps), None)
        left_out = {
            "text_columns": [*words, *(name for name in stamps if name != time)],
            "blank_columns": [name for name in blank if not name.startswith("column_")],
        }
        attributes = self._attributes | {
            key: ", ".join(texts) for key, texts in left_out.items() if texts
        }
        if start := stamps.get(time or ""):
            attributes["date"] = start
        columns = {
            name: values for name, values in columns.items() if name == time or name not in stamps
        }
        units = {
            name: "s" if name in stamps else unit
            for name, unit in self._units.items()
            if name in columns
        }
        if time in stamps:
            units[time] = "s"
        if time in stamps or options.time_column is not None:
            options = replace(options, time_column=time)
        raw = extract_time(self._path, RawFile(columns, None, units, attributes), options)
        pairs, channels = parse_header(self._header), list(raw.columns)
        stated = zip(channels, header_units(pairs, len(channels)), strict=True)
        units = {name: unit for name, unit in stated if unit} | dict(raw.units)
        texts = read_sensitivities(pairs)
        texts = texts * len(channels) if len(texts) == 1 else texts
        sensitivities = (
            dict(zip(channels, texts, strict=True)) if len(texts) == len(channels) else {}
        )
        of_samples = header_rate(
            (name, text)
            for name, text in pairs
            if re.match(r"fs|sampl|abtast", name, re.IGNORECASE)
        )
        if raw.sample_rate and of_samples and options.time_column is None:
            clock = next(iter(columns.keys() - raw.columns.keys()))
            require_one_rate(self._path, channels[0], of_samples, raw.sample_rate, clock)
        rate, attributes = raw.sample_rate or header_rate(pairs), dict(raw.attributes)
        if rate and attributes.get("time_gaps", "").startswith(NO_UNIT):
            del attributes["time_gaps"]
        facts: dict[str, Any] = {
            "units": units,
            "sample_rate": rate,
            "sensitivities": sensitivities,
        }
        return replace(
            raw, attributes=attributes, breaks=tuple(self._breaks) or raw.breaks, **facts
        )


def _misread(field: str, kind: Kind, decimal: str) -> str:
    """Why a field is not of the kind of its column; empty where it is."""
    if kind is Kind.number and field not in MISSING and not NUMBER[decimal].fullmatch(field):
        if THOUSANDS.fullmatch(field):
            return "has marks for thousands; write the numbers without them"
        return "is not a number; correct it"
    return "is not a time stamp" if kind is Kind.stamp and field and not is_stamp(field) else ""


def write(recording: Recording, path: Path) -> None:
    """Write time and channels as comma-separated text, full double precision."""
    table = {"time [s]": recording.time}
    headings = [spreadsheet_text(f"{name} [{recording.unit}]") for name in recording.channels]
    table |= dict(zip(headings, recording.signal, strict=True))
    with path.open("wb") as file:
        polars.DataFrame(table).write_csv(file)


def _text_of(path: Path) -> bytes:
    """The text in UTF-8 or Latin-1, each line ended by a line feed."""
    size = path.stat().st_size
    if path.suffix.lower() == ".gz":
        plausible = max(_EXPANSION * size, _LONGEST_TEXT)
        with gzip.open(path) as file:
            text = file.read(min(plausible, memory_limit() // _WHOLE) + 1)
        if len(text) > plausible:
            raise DataError(
                f"{path} unpacks to more than {_EXPANSION} times its size; that is no measurement."
            )
        require_memory(path, _WHOLE * len(text))
    else:
        require_memory(path, _WHOLE * size)
        text = path.read_bytes()
    text = text.decode("utf-16").encode() if text[:2] in (b"\xff\xfe", b"\xfe\xff") else text
    text = text.removeprefix(codecs.BOM_UTF8)
    if b"\0" in text[:4096]:
        raise DataError(f"{path} is a binary file, not a text table.")
    if b"\r" in text:
        text = text.replace(b"\r\r\n", b"\n").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return text.replace("∞".encode(), b"inf").replace("\u2212".encode(), b"-")


def _decode(data: bytes) -> str:
    try:
        return data.decode()
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _trimmed(data: bytes, separator: bytes) -> bytes:
    if separator != b"\t" and b"\t" in data:
        data = data.replace(b"\t", b" ")
    if b" " not in data:
        return data
    while b"  " in data:
        data = data.replace(b"  ", b" ")
    for mark in {separator, b"\n"} - {b" "}:
        data = data.replace(b" " + mark, mark).replace(mark + b" ", mark)
    return data.strip(b" ")
