"""What the columns of a file run along: a clock of one or several columns, or a spectrum.

`settle_axes` is asked by each format that has columns, before the clock is searched among them.
"""

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import DataError
from swashtwin.recordings.columns import Column, LazyColumn
from swashtwin.recordings.formats.column_names import (
    Quantity,
    clock_part,
    meaning_of_name,
    meaning_of_unit,
    names_sensor,
    parse_time_name,
)
from swashtwin.recordings.formats.raw_file import RawFile, ReadOptions

# Nanoseconds of the units that one clock may have in several columns.
_NANOSECONDS = {
    "d": 86_400_000_000_000,
    "h": 3_600_000_000_000,
    "min": 60_000_000_000,
    "s": 1_000_000_000,
    "ms": 1_000_000,
    "us": 1000,
    "ns": 1,
}

# Samples at the beginning by which the kind of an axis is decided.
_HEAD_SAMPLES = 4096

# Fewer samples may rise by chance.
_MIN_AXIS_SAMPLES = 8

# More different numbers in a column are not those of sensors.
_MAX_SENSORS = 64

# Longest period of numbers that rise by one which count sensors, and no samples.
_MAX_PERIOD = 15

# Rows after which a column with the number of a sensor changes at the latest.
_ROWS_PER_CHANGE = 20

# Share of the rows that must follow a turn of the sensors.
_MIN_REGULAR = 0.9


def settle_axes(path: Path, raw: RawFile, options: ReadOptions) -> RawFile:
    """Return the columns with a clock of several columns joined, and without spectra.

    Raises
    ------
    DataError
        The file holds a spectrum only, or rows of several sensors by turns.
    """
    if options.time_column is None:
        raw = _join_clocks(raw)
    if options.channels is None:
        raw = _without_spectra(path, raw)
        _refuse_interleaved(path, raw)
    return raw


def require_samples(path: Path, raw: RawFile, signals: Mapping[str, Column]) -> None:
    """Refuse a file of which only the times could be read as numbers."""
    if not signals or not all(_is_time(raw, name) for name in signals):
        return

    others = []
    for key, description in (("blank_columns", "blank"), ("text_columns", "text")):
        if key in raw.attributes:
            others.append(f"{raw.attributes[key]}: {description}")
    doubt = f"; the other columns hold no numbers ({'; '.join(others)})" if others else ""
    raise DataError(
        f"{path} holds times only ({', '.join(signals)}), and no samples{doubt}. Export the file "
        "again with its samples as numbers."
    )


def _is_time(raw: RawFile, name: str) -> bool:
    unit = raw.units.get(name)
    if parse_time_name(name) is None or (unit is not None and unit not in _NANOSECONDS):
        return False
    head = _head(raw.columns[name])
    return head.size > 2 and bool((np.diff(head) > 0).all())


def _head(column: Column) -> Float[np.ndarray, " time"]:
    return np.asarray(column[0:_HEAD_SAMPLES], dtype=np.float64)


def _group_of(name: str) -> str:
    return re.split(r"[^./]*$", name)[0]


# ---- a clock in several columns


def _join_clocks(raw: RawFile) -> RawFile:
    """Return the columns with seconds and their fractions, or hours, minutes, ..., as one clock."""
    parts: dict[tuple[str, int], dict[str, str]] = {}
    for name, column in raw.columns.items():
        part = clock_part(name, raw.units.get(name))
        if part is not None:
            prefix, unit = part
            key = (_group_of(name) + prefix, len(column))
            parts.setdefault(key, {}).setdefault(unit, name)

    for names_by_unit in parts.values():
        units = [unit for unit in _NANOSECONDS if unit in names_by_unit]
        names = [names_by_unit[unit] for unit in units]
        if len(units) > 1 and _are_parts(raw, names, units):
            raw = _with_joined(raw, names, units)
    return raw


def _are_parts(raw: RawFile, names: list[str], units: list[str]) -> bool:
    """Return whether whole numbers of a larger unit go on in the smaller ones, which wrap."""
    heads = [_head(raw.columns[name]) for name in names]
    for (larger, unit), (smaller, smaller_unit) in pairwise(zip(heads, units, strict=True)):
        ratio = _NANOSECONDS[unit] / _NANOSECONDS[smaller_unit]
        if not np.isfinite(smaller).all() or not (larger == np.round(larger)).all():
            return False
        if smaller.min() < 0 or smaller.max() >= ratio:
            return False

    total = np.asarray(_joined(raw, names, units)[0:_HEAD_SAMPLES])
    steps = np.diff(total)
    return steps.size > 1 and bool((steps >= 0).all() and (steps > 0).any())


def _joined(raw: RawFile, names: list[str], units: list[str]) -> LazyColumn:
    """Return the sum of a clock's columns [ns]."""
    columns = [raw.columns[name] for name in names]

    def read(start: int, stop: int) -> np.ndarray:
        total = np.zeros(stop - start, dtype=np.int64)
        for column, unit in zip(columns, units, strict=True):
            values = np.asarray(column[start:stop], dtype=np.float64)
            whole = np.floor(values)
            # Apart, for a double does not resolve nanoseconds since 1970.
            total += whole.astype(np.int64) * _NANOSECONDS[unit]
            total += np.rint((values - whole) * _NANOSECONDS[unit]).astype(np.int64)
        return total

    return LazyColumn(read, len(columns[0]), np.dtype(np.int64))


def _with_joined(raw: RawFile, names: list[str], units: list[str]) -> RawFile:
    columns: dict[str, Column] = {}
    key = f"{_group_of(names[0])}time ({' + '.join(name.rpartition('.')[2] for name in names)})"
    for name, column in raw.columns.items():
        if name == names[0]:
            columns[key] = _joined(raw, names, units)
        elif name not in names:
            columns[name] = column
    return replace(raw, columns=columns, units={**raw.units, key: "ns"})


# ---- spectra


def _without_spectra(path: Path, raw: RawFile) -> RawFile:
    """Return the columns without spectra and their axes.

    A spectrum has as many values as a column of frequencies or orders that rises, and no clock of
    that length; or its name or unit says so.
    """
    quantities = {name: _quantity(raw, name) for name in raw.columns}
    clock_lengths = {
        len(raw.columns[name])
        for name, quantity in quantities.items()
        if quantity is Quantity.time and _rises(raw.columns[name])
    }
    named_lengths = {
        len(raw.columns[name])
        for name, quantity in quantities.items()
        if quantity is Quantity.spectrum
    } - clock_lengths
    axis_of_length: dict[int, str] = {}
    for name, quantity in quantities.items():
        length = len(raw.columns[name])
        if quantity is Quantity.frequency and length not in clock_lengths:
            is_axis = _is_frequency_axis(raw, name, quantities)
        else:
            is_axis = quantity is None and length in named_lengths and _rises(raw.columns[name])
        if is_axis:
            axis_of_length.setdefault(length, name)

    spectra = []
    for name, quantity in quantities.items():
        length = len(raw.columns[name])
        is_named = quantity is Quantity.spectrum and length not in clock_lengths
        if length in axis_of_length or is_named:
            spectra.append(name)
    if not spectra:
        return raw

    signals = {
        name: column
        for name, column in raw.columns.items()
        if name not in spectra and quantities[name] is not Quantity.time
    }
    if not signals:
        values = [name for name in spectra if name not in axis_of_length.values()]
        axis = next(iter(axis_of_length.values()), "a frequency")
        raise DataError(
            f"{path} holds a spectrum ({', '.join(values[:3]) or 'no values'} over {axis}), not a "
            "signal over time; export the time waveform, from which spectra are computed here."
        )
    columns = {name: column for name, column in raw.columns.items() if name not in spectra}
    attributes = {**raw.attributes, "spectrum_columns": ", ".join(spectra)}
    return replace(raw, columns=columns, attributes=attributes)


def _quantity(raw: RawFile, name: str) -> Quantity | None:
    """Return the quantity that the name or the unit of a column says, or None."""
    unit = raw.units.get(name)
    meanings = (meaning_of_name(name), None if unit is None else meaning_of_unit(unit))
    quantities = [meaning.quantity for meaning in meanings if meaning is not None]
    for quantity in (Quantity.spectrum, Quantity.frequency):
        if quantity in quantities:
            return quantity
    return quantities[0] if quantities else None


def _rises(column: Column) -> bool:
    head = _head(column)
    return head.size >= _MIN_AXIS_SAMPLES and bool((np.diff(head) > 0).all())


def _is_frequency_axis(raw: RawFile, name: str, quantities: Mapping[str, Quantity | None]) -> bool:
    """Return whether a column of frequencies or orders rises, beside another column.

    Whole orders that rise by one may count the samples: they are an axis beside a spectrum only.
    """
    column = raw.columns[name]
    if not _rises(column) or float(_head(column)[0]) < 0 or name in raw.rates:
        return False

    companions = [
        other for other in raw.columns if other != name and len(raw.columns[other]) == len(column)
    ]
    is_counted = bool((np.diff(_head(column)) == 1).all()) and raw.units.get(name) is None
    may_count = is_counted and re.match(r"ord", name, re.IGNORECASE)
    if may_count:
        return any(quantities[other] is Quantity.spectrum for other in companions)
    return bool(companions)


# ---- sensors by turns


def _refuse_interleaved(path: Path, raw: RawFile) -> None:
    """Refuse rows of several sensors by turns, which hold the number of theirs.

    A column of few whole numbers tells the sensors if its name says so, or if they come in the same
    turn again and again.
    """
    for name, column in raw.columns.items():
        others = [
            other
            for other, other_column in raw.columns.items()
            if other != name and len(other_column) == len(column) and not _is_clocklike(raw, other)
        ]
        if not others or len(column) < _MIN_AXIS_SAMPLES:
            continue

        numbers = _sensor_numbers(_head(column), is_named=names_sensor(name))
        if numbers:
            listed = ", ".join(f"{number:g}" for number in numbers[:8])
            raise DataError(
                f"{path}: its rows are of {len(numbers)} sensors by turns ({name}: {listed}); save "
                "the rows of each sensor in a separate file."
            )


def _is_clocklike(raw: RawFile, name: str) -> bool:
    return parse_time_name(name) is not None or raw.units.get(name) in _NANOSECONDS


def _sensor_numbers(head: Float[np.ndarray, " time"], *, is_named: bool) -> list[float]:
    """Return the numbers of the sensors that a column tells by turns, or an empty list."""
    if not np.isfinite(head).all() or not (head == np.round(head)).all() or head.min() < 0:
        return []
    counts = Counter(head.tolist())
    if not 1 < len(counts) <= _MAX_SENSORS:
        return []

    numbers = sorted(counts)
    changes = int((np.diff(head) != 0).sum())
    if is_named and changes >= max(3, len(counts), head.size // _ROWS_PER_CHANGE):
        return numbers

    # Counters of few bits, and flags that alternate, turn as well.
    period = len(counts)
    is_counter = bool((np.diff(numbers) == 1).all()) and numbers[0] in (0.0, 1.0)
    if not 2 < period <= _MAX_PERIOD or not is_counter or head.size < 4 * period:
        return []
    is_regular = (head[period:] == head[:-period]).mean() >= _MIN_REGULAR
    is_in_turn = len(set(head[:period].tolist())) == period
    return numbers if is_regular and is_in_turn else []
