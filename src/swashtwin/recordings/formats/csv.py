"""Text tables: any separator, decimal comma, a block of header lines, time stamps, plain or gzipped."""

import codecs
import gzip
import io
import re
import tempfile
import weakref
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import DataError, InputError, load_extra, require_disk_space, spreadsheet_text
from swashtwin.recordings.formats.clock import require_one_rate, time_name, timed
from swashtwin.recordings.formats.dialects import HEAD, MISSING, NUMBER, THOUSANDS, Kind, dialect_of, split_line
from swashtwin.recordings.formats.raw import Column, Options, RawFile, side_by_side
from swashtwin.recordings.formats.tables import header_pairs, header_rate, header_units, stated_sensitivities
from swashtwin.recordings.formats.time_column import NO_UNIT
from swashtwin.recordings.formats.time_stamps import StampReader, is_stamp
from swashtwin.recordings.recording import Recording

polars: Any = load_extra("polars", "readers", "a text table")

_BYTES = 1 << 24
"""Bytes of text that are in memory together, the longest line, and the most blank lines."""
_EXPANSION = 300
"""Bytes of text per byte of a gzipped file beyond which it holds no measurement."""
_FORTRAN = re.compile(rb"(?<=\d|\.)[dD](?=[+-]?\d)")
"""The mark of an exponent as Fortran writes it."""
_LONGEST_TEXT = 1 << 28
"""Bytes of text that any gzipped file may hold."""


def read(path: Path, options: Options) -> RawFile:
    """Columns, rate and units of a text table. The numbers of a large one are kept in a temporary file.

    Columns of text are left out; the attribute ``text_columns`` names them. A column of time stamps gives the rate
    where no column of numbers is the time.
    """
    table = _Table(path, options)
    spool = tempfile.SpooledTemporaryFile(max_size=_BYTES)  # noqa: SIM115
    folder = Path(tempfile.gettempdir())
    width = len(table.columns)

    def rows(start: int, stop: int) -> np.ndarray:
        flat = np.empty((stop - start) * width)
        spool.seek(8 * width * start)
        spool.readinto(flat.data)
        return np.ascontiguousarray(flat.reshape(-1, width).T)

    weakref.finalize(rows, spool.close)
    count = 0
    try:
        for block in table.blocks():
            require_disk_space(folder, 1, block.nbytes)
            spool.write(block.tobytes())
            count += len(block)
    except InputError as cause:
        raise InputError(
            f"{path}: its numbers do not fit in the folder of temporary files, {folder}; free space there, or let "
            "the environment variable TMPDIR name a folder on another disk."
        ) from cause
    return table.raw_file(side_by_side(rows, (width, count)), options)


class _Table:
    """A text table whose numbers are read in blocks of lines."""

    def __init__(self, path: Path, options: Options) -> None:
        self._path = path
        self._chunks = _chunks(path)
        self._first = next(self._chunks, b"")
        most = HEAD + 40 + (options.header_lines or 0)
        head = self._first.split(b"\n", most)[:most]
        lines = [_decode(line) for line in head]
        self._dialect = dialect_of(path, lines, options)
        self._names, self._units = self._dialect.headings()
        self._separator = self._dialect.separator.encode()
        self._kinds = list(self._dialect.kinds)
        self._has_values = [kind is Kind.number for kind in self._kinds]
        self._stamps = {column: StampReader() for column, kind in enumerate(self._kinds) if kind is Kind.stamp}
        self._line = self._dialect.start
        self._rows = 0
        self._breaks: list[int] = []
        start = self._dialect.start
        self._header = "\n".join(lines[:start])
        self._attributes = {"header": self._header[:2000]} if start > 1 else {}
        self._first = self._first.split(b"\n", start)[-1]

    @property
    def columns(self) -> list[int]:
        """Columns of numbers and time stamps, and those that are blank so far."""
        return [number for number, kind in enumerate(self._dialect.kinds) if kind not in (Kind.text, Kind.date)]

    def blocks(self) -> Iterator[Float[np.ndarray, "time channel"]]:
        """The numbers and seconds of `columns`, in blocks of rows; rows without a value at the end are left out."""
        tail, blank_rows = b"", 0
        for chunk in chain([self._first], self._chunks):
            text = tail + _trimmed(chunk, self._separator)
            end = text.find(b"\n", len(text.rstrip(b"\n" + self._separator)))
            if end < 0 or len(text) - end > _BYTES:
                end = len(text.rstrip(b"\n"))
            body, tail = text[:end], text[end + 1 :]
            if not body:
                tail = text
                if len(tail) > _BYTES:
                    raise DataError(
                        f"{self._path}: {len(tail)} bytes of blank lines after line {self._line}; cut them."
                    )
                continue
            frame = self._frame(body)
            block = self._numbers(frame, body)
            self._line += len(block)
            self._rows += len(block)
            stop = _last_value(frame)
            if stop:
                yield np.full((blank_rows, block.shape[1]), np.nan)
                yield block[:stop]
                blank_rows = 0
            blank_rows += len(block) - stop

    def _frame(self, body: bytes) -> Any:
        """The fields of whole lines as a table of polars; a blank field is null."""
        comma = self._dialect.decimal == ","
        if (b"D" in body or b"d" in body) and _FORTRAN.search(body):
            body = _FORTRAN.sub(b"e", body)
        numbers = polars.String if comma and b"." in body else polars.Float64  # polars takes a point for a comma, too
        kinds = {Kind.number: numbers, Kind.blank: polars.Float64}
        try:
            frame = polars.read_csv(
                io.BytesIO(body),
                has_header=False,
                separator=self._separator.decode(),
                decimal_comma=comma,
                null_values=list(MISSING),
                quote_char='"' if b'"' in body else None,
                encoding="utf8-lossy",
                schema={str(column): kinds.get(kind, polars.String) for column, kind in enumerate(self._kinds)},
            )
        except polars.exceptions.PolarsError as cause:
            if self._words_appear(body):
                return self._frame(body)
            if (rows := self._without_headings(body)) is not None:
                return self._frame(rows)
            raise self._damage(body) from cause
        lines = body.count(b"\n") + 1
        if frame.height != lines or (
            b'"' not in body and body.count(self._separator) != lines * (len(self._kinds) - 1)
        ):
            if (rows := self._without_headings(body)) is not None:
                return self._frame(rows)
            raise self._damage(body)
        return frame

    def _without_headings(self, body: bytes) -> bytes | None:
        """The rows without lines that begin as one of the header does: another recording begins below them."""
        separator = self._dialect.separator
        keys = {split_line(line.strip(), separator)[0] for line in self._header.split("\n") if line.strip()}
        rows: list[bytes] = []
        breaks: list[int] = []
        lines = body.split(b"\n")
        for number, line in enumerate(lines):
            text = _decode(line).strip()
            follows = number + 1 == len(lines) or _decode(lines[number + 1]).strip().split(separator)[0] in keys
            if (text and split_line(text, separator)[0] in keys) or (
                not text and (follows or breaks[-1:] == [len(rows)])
            ):
                breaks += [] if breaks[-1:] == [len(rows)] else [len(rows)]
            else:
                rows.append(line)
        if len(rows) == len(lines) or not rows:
            return None
        self._breaks += [self._rows + number for number in breaks if self._rows + number]
        self._line += len(lines) - len(rows)
        return b"\n".join(rows)

    def _numbers(self, frame: Any, body: bytes) -> Float[np.ndarray, "time channel"]:
        block = np.full((frame.height, len(self.columns)), np.nan)
        for position, column in enumerate(self.columns):
            series, kind = frame[str(column)], self._kinds[column]
            if kind is Kind.text:
                continue
            missing = series.null_count()
            if kind is Kind.stamp:
                values = self._stamps[column].seconds(series)
            elif series.dtype == polars.String:
                pure = series.set(series.str.contains(".", literal=True), None)
                values = pure.str.replace(",", ".", literal=True).cast(polars.Float64, strict=False)
                if values.null_count() != missing:
                    raise self._damage(body)
                values = values.to_numpy()
            else:
                values = series.to_numpy()
            if kind is Kind.stamp and int(np.isnan(values).sum()) != missing:
                raise self._damage(body)
            block[:, position] = values
            self._has_values[column] |= missing < frame.height
        return block

    def _words_appear(self, body: bytes) -> bool:
        """Whether columns that were blank so far turn out to be text; they are then left out."""
        blank = [column for column, kind in enumerate(self._kinds) if kind is Kind.blank]
        rows = [split_line(_decode(line), self._dialect.separator) for line in body.split(b"\n")] if blank else []
        number = NUMBER[self._dialect.decimal]
        wordy = [
            column
            for column in blank
            if not self._has_values[column]
            and any(row[column : column + 1] and row[column] and not number.fullmatch(row[column]) for row in rows)
        ]
        for column in wordy:
            self._kinds[column] = Kind.text
        return bool(wordy)

    def _damage(self, body: bytes) -> DataError:
        decimal, width = self._dialect.decimal, len(self._kinds)
        for number, line in enumerate(body.split(b"\n"), self._line + 1):
            fields = split_line(_decode(line), self._dialect.separator)
            if len(fields) != width:
                reason = "the file may be cut off"
                if number <= HEAD:
                    reason += f", or say header_lines = {number} if the table begins below it"
                return DataError(f"{self._path}: line {number} has {len(fields)} columns, not {width}; {reason}.")
            for column, (field, kind, name) in enumerate(zip(fields, self._kinds, self._names, strict=True)):
                if kind in (Kind.number, Kind.blank) and field not in MISSING and not NUMBER[decimal].fullmatch(field):
                    reason = "is not a number; correct it"
                    if THOUSANDS.fullmatch(field):
                        reason = "has marks for thousands; write the numbers without them"
                    elif number <= HEAD and not any(NUMBER[decimal].fullmatch(other) for other in fields):
                        reason += f", or say header_lines = {number} if the table begins below it"
                    return DataError(f"{self._path}: line {number}: {field[:40]!r} in column {name!r} {reason}.")
                if kind is Kind.stamp and field and not is_stamp(field):
                    return DataError(
                        f"{self._path}: line {number}: {field[:40]!r} in column {name!r} is not a time stamp."
                    )
                if kind is Kind.stamp and field and not self._stamps[column].is_in_order(field):
                    return DataError(
                        f"{self._path}: line {number}: {field[:40]!r} in column {name!r} has another order of day, "
                        "month and year than the lines before."
                    )
        return DataError(f"{self._path}: the rows after line {self._line} cannot be read; the file is damaged.")

    def raw_file(self, samples: Sequence[Column], options: Options) -> RawFile:
        """The columns under their names, the time as the rate, and which columns were left out."""
        names = self._names
        columns = {names[column]: values for column, values in zip(self.columns, samples, strict=True)}
        blank = [names[column] for column in self.columns if not self._has_values[column]]
        stamps = {names[column]: reader for column, reader in self._stamps.items() if names[column] not in blank}
        words = [names[column] for column, kind in enumerate(self._kinds) if kind in (Kind.text, Kind.date)]
        columns = {name: values for name, values in columns.items() if name not in blank}
        time = time_name(self._path, list(columns), options) or next(iter(stamps), None)
        left_out = {
            "text_columns": [*words, *(name for name in stamps if name != time)],
            "blank_columns": [name for name in blank if name not in words and not name.startswith("column_")],
        }
        attributes = self._attributes | {key: ", ".join(texts) for key, texts in left_out.items() if texts}
        if time in stamps and stamps[time].start is not None:
            attributes["date"] = str(stamps[time].start)
        columns = {name: values for name, values in columns.items() if name == time or name not in stamps}
        units = {name: "s" if name in stamps else unit for name, unit in self._units.items() if name in columns}
        if time in stamps:
            units[time] = "s"
        if time in stamps or options.time_column is not None:
            options = replace(options, time_column=time)
        raw = timed(self._path, RawFile(columns, None, units, attributes), options)
        pairs, channels = header_pairs(self._header), list(raw.columns)
        stated = zip(channels, header_units(pairs, len(channels)), strict=True)
        units = {name: unit for name, unit in stated if unit} | dict(raw.units)
        texts = stated_sensitivities(pairs)
        texts = texts * len(channels) if len(texts) == 1 else texts
        sensitivities = dict(zip(channels, texts, strict=True)) if len(texts) == len(channels) else {}
        of_samples = header_rate(
            (name, text) for name, text in pairs if re.match(r"fs|sampl|abtast", name, re.IGNORECASE)
        )
        if raw.sample_rate and of_samples and options.time_column is None:
            clock = next(iter(columns.keys() - raw.columns.keys()))
            require_one_rate(self._path, channels[0], of_samples, raw.sample_rate, clock)
        rate, attributes = raw.sample_rate or header_rate(pairs), dict(raw.attributes)
        if rate and attributes.get("time_gaps", "").startswith(NO_UNIT):
            del attributes["time_gaps"]
        facts: dict[str, Any] = {"units": units, "sample_rate": rate, "sensitivities": sensitivities}
        return replace(raw, attributes=attributes, breaks=tuple(self._breaks) or raw.breaks, **facts)


def _last_value(frame: Any) -> int:
    if any(value is not None for value in frame.row(-1)):
        return int(frame.height)
    has_value = frame.select(polars.any_horizontal(polars.all().is_not_null())).to_series().to_numpy()
    return int(np.flatnonzero(has_value)[-1]) + 1 if has_value.any() else 0


def write(recording: Recording, path: Path) -> None:
    """Write time and channels as comma-separated text, full double precision."""
    table = {"time [s]": recording.time}
    headings = [spreadsheet_text(f"{name} [{recording.unit}]") for name in recording.channels]
    table |= dict(zip(headings, recording.signal, strict=True))
    with path.open("wb") as file:
        polars.DataFrame(table).write_csv(file)


def _chunks(path: Path) -> Iterator[bytes]:
    """Whole lines of the file in UTF-8 or Latin-1, some megabytes at a time, each ended by a line feed."""
    with gzip.open(path) if path.suffix.lower() == ".gz" else path.open("rb") as file:
        rest, total, decoder = b"", 0, None
        limit = _EXPANSION * path.stat().st_size if path.suffix.lower() == ".gz" else 0
        while data := file.read(_BYTES):
            if not total:
                decoder = codecs.getincrementaldecoder("utf-16")() if data[:2] in (b"\xff\xfe", b"\xfe\xff") else None
                data = data.removeprefix(codecs.BOM_UTF8)
                if decoder is None and b"\0" in data[:4096]:
                    raise DataError(f"{path} is a binary file, not a text table.")
            total += len(data)
            if limit and total > max(limit, _LONGEST_TEXT):
                raise DataError(f"{path} unpacks to more than {_EXPANSION} times its size; that is no measurement.")
            data = rest + (data if decoder is None else decoder.decode(data).encode())
            end = 1 + max(data.rfind(b"\n"), -1 if b"\n" in data else data[:-1].rfind(b"\r"))
            if not end and len(data) > _BYTES:
                raise DataError(f"{path} has a line of more than {_BYTES >> 20} MB; that is no table.")
            rest = data[end:]
            if end:
                yield _with_line_feeds(data[:end])
        if rest:
            yield _with_line_feeds(rest)


def _with_line_feeds(data: bytes) -> bytes:
    data = data.replace(b"\r\r\n", b"\n").replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in data else data
    for sign, ascii_sign in (("∞", b"inf"), ("\u2212", b"-")):
        data = data.replace(sign.encode(), ascii_sign) if sign.encode() in data else data
    return data


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
