"""Text tables: any separator, decimal comma, a block of header lines, plain or gzipped."""

import csv
import gzip
import io
import re
import tempfile
import weakref
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import DataError
from swashtwin.recordings.formats.raw import Options, RawFile, load_extra
from swashtwin.recordings.formats.tables import split_unit, timed_columns
from swashtwin.recordings.recording import Recording
from swashtwin.recordings.samples import Column, SideBySide

_SEPARATORS = ("\t", ";", ",", "|", " ")
_NUMBER = {
    ".": re.compile(r"\s*([+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf))?\s*", re.IGNORECASE),
    ",": re.compile(r"\s*([+-]?(\d+,?\d*|,\d+)([eE][+-]?\d+)?|[+-]?(nan|inf))?\s*", re.IGNORECASE),
}
_BYTES = 1 << 24
"""Bytes of text that are in memory together."""
_DIALECT_LINES = 40
"""Lines from which the dialect is detected."""


def read(path: Path, options: Options) -> RawFile:
    """Columns, rate and units of a text table. The numbers of a large one are kept in a temporary file."""
    table = _Table(path, options)
    spool = tempfile.SpooledTemporaryFile(max_size=_BYTES)  # noqa: SIM115
    try:
        count = 0
        for block in table.blocks():
            spool.write(block.tobytes())
            count += len(block)
    except BaseException:
        spool.close()
        raise
    width = len(table.names)

    def rows(start: int, stop: int) -> np.ndarray:
        flat = np.empty((stop - start) * width)
        spool.seek(8 * width * start)
        spool.readinto(flat.data)
        return np.ascontiguousarray(flat.reshape(-1, width).T)

    side_by_side = SideBySide(rows, (width, count))
    weakref.finalize(side_by_side, spool.close)
    return table.columns(side_by_side.columns(), options)


class _Table:
    """A text table whose numbers are read in blocks of lines."""

    def __init__(self, path: Path, options: Options) -> None:
        self._path = path
        self._text = _lines(path)
        first = next(self._text, [])
        self._separator, self._decimal, start = _dialect(path, first, options)
        self._width = len(_fields(first[start], self._separator))
        self._first, self._start = first[start:], start
        self.names, self._units = _header(first, start, self._separator, self._width)
        self._attributes = {"header": "\n".join(first[:start])[:2000]} if start > 1 else {}

    def blocks(self) -> Iterator[Float[np.ndarray, "time channel"]]:
        """The numbers, in blocks of rows."""
        line, empty_end = self._start, False
        for lines, more in _with_more(chain([self._first], self._text)):
            while not more and lines and not lines[-1].strip():
                lines.pop()
            if not lines:
                continue
            block = _numbers(self._path, lines, self._separator, self._decimal, self._width, line)
            if line == self._start and np.isnan(block[:, -1]).all() and lines[0].endswith(self._separator):
                empty_end = True
                self.names = self.names[:-1]
            if empty_end and not np.isnan(block[:, -1]).all():
                raise DataError(f"{self._path}: the last column is empty up to line {line} and holds numbers after it.")
            yield block[:, :-1] if empty_end else block
            line += len(lines)

    def columns(self, columns: Sequence[Column] | np.ndarray, options: Options) -> RawFile:
        """The columns under their names, the time as the rate."""
        named = dict(zip(self.names, columns, strict=True))
        return timed_columns(self._path, named, self._units, self._attributes, options)


def _with_more(parts: Iterable[list[str]]) -> Iterator[tuple[list[str], bool]]:
    """Each part, and whether a line with something in it comes after it."""
    waiting: list[list[str]] = []
    for part in parts:
        if any(line.strip() for line in part):
            yield from ((earlier, True) for earlier in waiting)
            waiting = []
        waiting.append(part)
    yield from ((last, False) for last in waiting)


def write(recording: Recording, path: Path) -> None:
    """Write time and channels as comma-separated text, full double precision."""
    polars = load_extra("polars")
    table = {"time [s]": recording.time}
    table |= {f"{name} [{recording.unit}]": row for name, row in zip(recording.channels, recording.signal, strict=True)}
    with path.open("wb") as file:
        polars.DataFrame(table).write_csv(file)


def _lines(path: Path) -> Iterator[list[str]]:
    """Lines of the file, in lists of some megabytes."""
    with gzip.open(path) if path.suffix.lower() == ".gz" else path.open("rb") as file:
        data = file.read(_BYTES)
        if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
            yield (data + file.read()).decode("utf-16").splitlines()
            return
        if b"\0" in data[:4096]:
            raise DataError(f"{path} is a binary file, not a text table.")
        while data:
            data += file.readline()
            yield _decode(data).splitlines()
            data = file.read(_BYTES)


def _decode(data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _fields(line: str, separator: str) -> list[str]:
    return line.split() if separator == " " else line.split(separator)


def _is_row(line: str, separator: str, decimal: str) -> int:
    """Number of columns of a line of numbers, 0 where it is none."""
    fields = _fields(line, separator)
    numeric = all(_NUMBER[decimal].fullmatch(text) for text in fields) and any(text.strip() for text in fields)
    return len(fields) if numeric else 0


def _dialect(path: Path, lines: list[str], options: Options) -> tuple[str, str, int]:
    """Separator, decimal mark, and the number of the first line of samples."""
    separators = (options.separator,) if options.separator else _SEPARATORS
    decimals = (options.decimal,) if options.decimal else (".", ",")
    best: tuple[int, str, str, int] | None = None
    for separator in separators:
        for decimal in decimals:
            if decimal == separator:
                continue
            start, n_columns = _first_row(lines, separator, decimal, options.header_lines)
            if n_columns and (best is None or (n_columns, -start) > (best[0], -best[3])):
                best = (n_columns, separator, decimal, start)
    if best is None:
        raise DataError(
            f"{path} holds no table of numbers that could be found; say how it is written, "
            'for example separator = ";", decimal = ",", header_lines = 8.'
        )
    _refuse_ambiguous(path, lines, best, options)
    return best[1], best[2], best[3]


def _first_row(lines: list[str], separator: str, decimal: str, header_lines: int | None) -> tuple[int, int]:
    """First line from which the lines are rows of one width, and that width (0 where there is none)."""
    first = 0 if header_lines is None else header_lines
    stop = len(lines) if header_lines is None else min(len(lines), first + 1)
    for start in range(first, min(stop, 1000)):
        width = _is_row(lines[start], separator, decimal)
        following = [line for line in lines[start + 1 : start + _DIALECT_LINES] if line.strip()]
        last_is_cut = len(lines) <= start + _DIALECT_LINES  # a torn last line must not hide the dialect
        checked = following[:-1] if last_is_cut else following
        if width and all(_is_row(line, separator, decimal) == width for line in checked):
            return start, width
    return first, 0


def _refuse_ambiguous(path: Path, lines: list[str], best: tuple[int, str, str, int], options: Options) -> None:
    """Refuse ``3,14``: two columns, or one number with a decimal comma."""
    width, separator, _, start = best
    stated = options.separator or options.decimal
    if stated or separator != "," or width != 2:
        return
    named = start > 0 and len(lines[start - 1].split(",")) == 2
    if not named and not any("." in line for line in lines[start : start + _DIALECT_LINES]):
        raise DataError(
            f"{path}: line {start + 1} ({lines[start].strip()!r}) may be two columns or one decimal comma; "
            'say separator = "," or decimal = ",".'
        )


def _header(lines: list[str], start: int, separator: str, n_columns: int) -> tuple[list[str], dict[str, str]]:
    """Names and units of the columns, from the line above the first sample."""
    names: list[str] = []
    units: dict[str, str] = {}
    above = lines[start - 1].strip(" %#\r\n") if start else ""
    texts = above.split() if separator == " " else next(csv.reader([above], delimiter=separator), [])
    texts = [text.strip() for text in texts]
    if len(texts) == n_columns + 1 and not texts[-1]:
        texts.pop()
    for number in range(n_columns):
        text = texts[number] if len(texts) == n_columns else ""
        name, unit = split_unit(text)
        name = name if name and name not in names else f"column_{number}"
        names.append(name)
        if unit:
            units[name] = unit
    return names, units


def _numbers(
    path: Path, lines: list[str], separator: str, decimal: str, n_columns: int, start: int
) -> Float[np.ndarray, "time channel"]:
    """The table of samples; a blank field is NaN, a short or unreadable row an error that names its line."""
    if separator == " ":
        lines = ["\t".join(line.split()) for line in lines]
        separator = "\t"
    width = n_columns - 1
    for number, line in enumerate(lines, start + 1):
        if line.count(separator) != width:
            count = line.count(separator) + 1
            raise DataError(f"{path}: line {number} has {count} columns, not {n_columns}; the file may be cut off.")
    polars = load_extra("polars")
    body = "\n".join(lines)
    if separator != "\t":
        body = body.replace(" ", "").replace("\t", "")
    try:
        frame = polars.read_csv(
            io.BytesIO(body.encode()),
            has_header=False,
            separator=separator,
            decimal_comma=decimal == ",",
            quote_char=None,
            schema={str(number): polars.Float64 for number in range(n_columns)},
        )
    except polars.exceptions.PolarsError as cause:
        reason = str(cause).splitlines()[0]
        raise DataError(f"{path}: a sample after line {start} is not a number ({reason}).") from cause
    if frame.height != len(lines):
        raise DataError(f"{path}: {frame.height} rows could be read of {len(lines)}; the file is damaged.")
    return frame.to_numpy().astype(np.float64)
