"""Columns that have values in some rows of a table only, at a rate that holds for them alone.

Programs join sensors of several rates into one table in two ways: pairs of a time and a signal
that end in different rows, and one time for all, with blanks in the rows of the other sensors.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Bool

from swashtwin.recordings.columns import Column, slice_column
from swashtwin.recordings.formats.column_names import (
    Quantity,
    meaning_of_name,
    parse_time_name,
    words_of,
)
from swashtwin.recordings.formats.raw_file import RawFile

# Rows at the beginning in which a column of some rows has a blank one.
_HEAD_ROWS = 1000

# Fewer samples may be evenly spaced by chance.
_MIN_SAMPLES = 16

# Places with missing samples from which on they may be the rows of other sensors.
_MIN_BLANK_RUNS = 8


def paired_times(raw: RawFile) -> list[str]:
    """Return the times of a table in which times and signals alternate, or an empty list.

    The times rise evenly and differ in rate or length, and the signals do not rise.
    """
    names = list(raw.columns)
    if len(names) < 4 or len(names) % 2 or _even_step(raw.columns[names[0]]) is None:
        return []

    clocks: set[tuple[int, float]] = set()
    for time, signal in zip(names[::2], names[1::2], strict=True):
        step = _even_step(raw.columns[time])
        length = _length_without_blanks(raw.columns[time])
        is_time = _may_name_time(time)
        is_pair = length == _length_without_blanks(raw.columns[signal])
        if step is None or not (is_time and is_pair) or _even_step(raw.columns[signal]):
            return []
        clocks.add((length, step))
    return names[::2] if len(clocks) > 1 else []


def _may_name_time(name: str) -> bool:
    """Return whether a name is that of a time, such as ``t_mic``, or not of another axis."""
    if any(parse_time_name(word) is not None for word in words_of(name)):
        return True
    meaning = meaning_of_name(name)
    return meaning is None or meaning.quantity is Quantity.vibration


def _even_step(column: Column) -> float | None:
    """Return the step of a column that rises evenly at its beginning, or None."""
    head = np.asarray(column[:_HEAD_ROWS], dtype=np.float64)
    steps = np.diff(head[_is_present(head)])
    if steps.size < _MIN_SAMPLES:
        return None
    step = float(np.median(steps))
    is_even = np.abs(steps - step) < 0.5 * step
    return float(f"{step:.6g}") if step > 0 and is_even.all() else None


def trim_short_pairs(raw: RawFile, times: Sequence[str]) -> RawFile:
    """Return the columns without the blank rows below a time that ends before the others.

    Parameters
    ----------
    times : names of the columns that may be times.
    """
    if len(times) < 2:
        return raw

    lengths = {name: _length_without_blanks(column) for name, column in raw.columns.items()}
    paired_lengths = {lengths[name] for name in times}
    columns: dict[str, Column] = {}
    for name, column in raw.columns.items():
        length = lengths[name]
        is_short = length < len(column) and length in paired_lengths
        columns[name] = slice_column(column, 0, length) if is_short else column
    return replace(raw, columns=columns)


def _length_without_blanks(column: Column) -> int:
    """Return the number of samples up to the last one that is not missing."""
    if _is_present(column[len(column) - 1 :]).all():
        return len(column)
    present = np.flatnonzero(_is_present(column[:]))
    return int(present[-1]) + 1 if present.size else len(column)


def separate_rows(
    raw: RawFile, clock: str, read_clock: Callable[[Column], tuple[float | None, str]]
) -> RawFile:
    """Return the columns that have values in some rows only without the others, and their rates.

    The times of its rows must be evenly spaced: a column with dropouts remains as it is. If no
    column has values in all rows, the clock is dropped, since it holds for none as a whole.

    Parameters
    ----------
    clock : name of the column with the times of all rows.
    read_clock : returns the sample rate of times, and what is wrong with their spacing.
    """
    times = raw.columns[clock]
    columns: dict[str, Column] = {}
    rates = dict(raw.rates)
    n_signals = 0
    for name, column in raw.columns.items():
        columns[name] = column
        if name == clock or len(column) != len(times):
            continue
        n_signals += 1
        if _is_present(column[:_HEAD_ROWS]).all():
            continue

        is_present = _is_present(column[:])
        if not _is_interleaved(is_present):
            continue
        rate, problem = read_clock(np.asarray(times[:])[is_present])
        if rate is not None and not problem:
            columns[name] = np.asarray(column[:])[is_present]
            rates[name] = rate

    n_separate = len(rates) - len(raw.rates)
    if n_separate and n_separate == n_signals:
        del columns[clock]
    return replace(raw, columns=columns, rates=rates) if n_separate else raw


def _is_present(samples: Any) -> Bool[np.ndarray, " time"]:
    values = np.asarray(samples)
    if values.dtype.kind != "f":
        return np.ones(len(values), bool)
    is_present: np.ndarray = ~np.isnan(values)
    return is_present


def _is_interleaved(is_present: Bool[np.ndarray, " time"]) -> bool:
    """Return whether values and blanks alternate often."""
    n_blank_runs = int((is_present[:-1] & ~is_present[1:]).sum())
    return is_present.sum() >= _MIN_SAMPLES and n_blank_runs >= _MIN_BLANK_RUNS
