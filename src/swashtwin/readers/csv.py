"""Text tables: any separator, decimal comma, a block of header lines, plain or gzipped."""

import csv
import gzip
import io
import re
from pathlib import Path

import numpy as np
from jaxtyping import Float

from swashtwin.errors import DataError
from swashtwin.readers.raw import Options, RawFile, known_unit, load_extra, snapped_rate
from swashtwin.recording import Recording

_SEPARATORS = ("\t", ";", ",", "|", " ")
_NUMBER = {
    ".": re.compile(r"\s*([+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf))?\s*", re.IGNORECASE),
    ",": re.compile(r"\s*([+-]?(\d+,?\d*|,\d+)([eE][+-]?\d+)?|[+-]?(nan|inf))?\s*", re.IGNORECASE),
}
_BRACKET = re.compile(r"^(.*\S)\s*[\[(]\s*([^\])]+?)\s*[\])]$")
_TRADE_UNITS = ("s", "ms", "us", "g", "mg", "m/s^2", "m/s2", "m/s²", "mm/s^2", "mm/s", "V", "mV", "Pa", "bar")
_TIME_NAMES = ("time", "t", "zeit")
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
_SAMPLE = 40
"""Lines that are looked at to find the dialect."""


def read(path: Path, options: Options) -> RawFile:
    """Columns, rate and units of a text table."""
    text = _text(path)
    lines = text.splitlines()
    separator, decimal, start = _dialect(path, lines, options)
    n_columns = len(_fields(lines[start], separator))
    names, units = _header(lines, start, separator, n_columns)
    table = _numbers(path, lines[start:], separator, decimal, n_columns, start)
    if np.isnan(table[:, -1]).all() and lines[start].endswith(separator):
        table, names = table[:, :-1], names[:-1]
    attributes = {"header": "\n".join(lines[:start])[:2000]} if start > 1 else {}
    columns = {name: np.ascontiguousarray(table[:, i]) for i, name in enumerate(names)}
    time_name = _time_name(path, names, options)
    if time_name is None:
        return RawFile(columns, units=units, attributes=attributes)
    seconds = columns.pop(time_name) * _SECONDS.get(units.pop(time_name, "s"), 1.0)
    rate, gaps = read_time_column(path, seconds)
    return RawFile(columns, rate, units, attributes | ({"time_gaps": gaps} if gaps else {}))


def write(recording: Recording, path: Path) -> None:
    """Write time and channels as comma-separated text, full double precision."""
    polars = load_extra("polars")
    table = {"time [s]": recording.time}
    table |= {f"{name} [{recording.unit}]": row for name, row in zip(recording.channels, recording.signal, strict=True)}
    with path.open("wb") as file:
        polars.DataFrame(table).write_csv(file)


def read_time_column(path: Path, seconds: Float[np.ndarray, " time"]) -> tuple[float, str]:
    """Sample rate [Hz] of a time column, and what is wrong with its spacing (empty where nothing is)."""
    if len(seconds) < 3 or not np.isfinite(seconds).all() or not seconds[-1] > seconds[0]:
        raise DataError(f"{path}: the time column does not rise from its first to its last reading.")
    span = seconds[-1] - seconds[0]
    step = span / (len(seconds) - 1)
    head = seconds[:1000]
    digits = next((d for d in range(12) if np.abs(head - np.round(head, d)).max() < 1e-12), 12)
    quantum = 10.0**-digits
    drift = np.abs(seconds - seconds[0] - step * np.arange(len(seconds))).max()
    if drift <= max(0.5 * step, 1.01 * quantum):
        return snapped_rate(step, max(1e-6, quantum / span)), ""
    steps = np.diff(seconds)
    usual = float(np.median(steps))
    if usual <= 0:
        raise DataError(f"{path}: most steps of the time column are zero or negative; name another time_column.")
    odd = np.flatnonzero(np.abs(steps - usual) > 0.5 * usual + quantum)
    rate = snapped_rate(usual, max(1e-6, min(0.01, quantum / usual)))
    if len(odd) == 0:
        return rate, f"steps drift between {steps.min():.6g} s and {steps.max():.6g} s"
    worst = odd[np.argmax(np.abs(steps[odd] - usual))]
    return rate, (
        f"{len(odd)} of {len(steps)} steps differ from the usual {usual:.6g} s; "
        f"the worst is {steps[worst]:.6g} s at {seconds[worst]:.6g} s"
    )


def _text(path: Path) -> str:
    data = path.read_bytes()
    if path.suffix.lower() == ".gz":
        data = gzip.decompress(data)
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return data.decode("utf-16")
    if b"\0" in data[:4096]:
        raise DataError(f"{path} is a binary file, not a text table.")
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
    """Separator, decimal mark, and the number of the first line of readings."""
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
        following = [line for line in lines[start + 1 : start + _SAMPLE] if line.strip()]
        last_is_cut = len(lines) <= start + _SAMPLE  # a torn last line must not hide the dialect
        checked = following[:-1] if last_is_cut else following
        if width and all(_is_row(line, separator, decimal) == width for line in checked):
            return start, width
    return first, 0


def _refuse_ambiguous(path: Path, lines: list[str], best: tuple[int, str, str, int], options: Options) -> None:
    """Refuse ``3,14``: two columns, or one number with a decimal comma."""
    width, separator, _, start = best
    told = options.separator or options.decimal
    if told or separator != "," or width != 2:
        return
    named = start > 0 and len(lines[start - 1].split(",")) == 2
    if not named and not any("." in line for line in lines[start : start + _SAMPLE]):
        raise DataError(
            f"{path}: line {start + 1} ({lines[start].strip()!r}) may be two columns or one decimal comma; "
            'say separator = "," or decimal = ",".'
        )


def _header(lines: list[str], start: int, separator: str, n_columns: int) -> tuple[list[str], dict[str, str]]:
    """Names and units of the columns, from the line above the first reading."""
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


def split_unit(text: str) -> tuple[str, str | None]:
    """Name and unit of a column heading such as ``acceleration [g]``."""
    match = _BRACKET.match(text)
    if match and (match[2] in _TRADE_UNITS or (text.endswith("]") and known_unit(match[2]))):
        return match[1], match[2]
    return text, None


def _numbers(
    path: Path, lines: list[str], separator: str, decimal: str, n_columns: int, start: int
) -> Float[np.ndarray, "time channel"]:
    """The table of readings; a blank field is NaN, a short or unreadable row an error that names its line."""
    while lines and not lines[-1].strip():
        lines.pop()
    if separator == " ":
        lines = ["\t".join(line.split()) for line in lines]
        separator = "\t"
    width = n_columns - 1
    for number, line in enumerate(lines, start + 1):
        if line.count(separator) != width:
            found = line.count(separator) + 1
            raise DataError(f"{path}: line {number} has {found} columns, not {n_columns}; the file may be cut off.")
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
        raise DataError(f"{path}: a reading after line {start} is not a number ({reason}).") from cause
    if frame.height != len(lines):
        raise DataError(f"{path}: {frame.height} rows could be read of {len(lines)}; the file is damaged.")
    return frame.to_numpy().astype(np.float64)


def _time_name(path: Path, names: list[str], options: Options) -> str | None:
    wanted = options.time_column
    if wanted is None:
        return names[0] if len(names) > 1 and names[0].lower() in _TIME_NAMES else None
    if isinstance(wanted, int) and 0 <= wanted < len(names):
        return names[wanted]
    if isinstance(wanted, str) and split_unit(wanted)[0] in names:
        return split_unit(wanted)[0]
    raise DataError(f"{path} has no column {wanted!r} for time_column; it has {', '.join(names)}.")
