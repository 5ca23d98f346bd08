"""Parquet tables."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError, load_extra
from swashtwin.recordings.columns import BLOCK_SAMPLES, Column, LazyColumn
from swashtwin.recordings.formats.arrow_arrays import doubles_of, numbers_of
from swashtwin.recordings.formats.clock import extract_time
from swashtwin.recordings.formats.headings import split_unit
from swashtwin.recordings.formats.parquet_footer import count_rows
from swashtwin.recordings.formats.raw_file import RawFile, ReadOptions, require_plausible_size
from swashtwin.recordings.recording import Recording

arro3_core: Any = load_extra("arro3.core", "readers", "a Parquet table")
arro3_io: Any = load_extra("arro3.io", "readers", "a Parquet table")

# A table of at most this size is in memory as a whole: it is unpacked only once.
_MAX_CACHED_BYTES = 1 << 27

# Rows that are unpacked together.
_BATCH_ROWS = 1 << 16

_UNIT_NS = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1000, "ns": 1}


def read(path: Path, options: ReadOptions) -> RawFile:
    """Return the columns of numbers; headings such as ``x [g]`` name the unit.

    A missing number is NaN. A column of time stamps counts as the time [s] since its first.
    """
    kind_of = arro3_core.DataType
    row_count = count_rows(path)
    types = {field.name: field.type for field in _open(path).schema}
    require_plausible_size(path, 8 * row_count * len(types), f"{row_count} rows")

    lists = [
        heading
        for heading, kind in types.items()
        if kind_of.is_nested(kind) or kind_of.is_fixed_size_list(kind)
    ]
    if lists and options.channels is None:
        raise DataError(
            f"{path}: each cell of {', '.join(lists)} holds several numbers, such as a window, and "
            "a recording has one in each cell.",
            field="channels",
            remedy="Save the samples of each recording as one column, or select columns with "
            "{channels}.",
        )

    numeric_types = {
        heading: kind
        for heading, kind in types.items()
        if kind_of.is_numeric(kind) or kind_of.is_boolean(kind) or _is_time(kind)
    }
    rows = _Rows(path, row_count, numeric_types)

    columns: dict[str, Column] = {}
    units: dict[str, str] = {}
    for index, (heading, kind) in enumerate(numeric_types.items()):
        name, unit = split_unit(heading)
        if name in columns:
            name = heading
        read_column = partial(rows.read, index)
        columns[name] = LazyColumn(read_column, row_count, np.dtype(np.float64))
        if _is_time(kind):
            units[name] = "s"
        elif unit:
            units[name] = unit
    return extract_time(path, RawFile(columns, None, units), options)


def write(recording: Recording, path: Path) -> None:
    """Write time and channels as columns of doubles, the unit in their headings."""
    table = {"time [s]": recording.time}
    for name, samples in zip(recording.channels, recording.signal, strict=True):
        table[f"{name} [{recording.unit}]"] = samples
    arrays = {heading: arro3_core.Array(values) for heading, values in table.items()}
    with path.open("wb") as file:
        arro3_io.write_parquet(arro3_core.Table.from_pydict(arrays), file, compression="zstd(3)")


def _open(path: Path) -> Any:
    """Return the reader of a table, which yields batches of rows."""
    try:
        return arro3_io.read_parquet(path, batch_size=_BATCH_ROWS)
    except BaseException as cause:
        # The library panics if a footer is damaged. A panic is no `Exception`, and would end the
        # process that reads.
        if type(cause).__name__ != "PanicException":
            raise
        reason = str(cause).partition("value: ")[2] or str(cause)
        raise ValueError(reason) from cause


def _is_time(kind: Any) -> bool:
    return bool(arro3_core.DataType.is_timestamp(kind) or arro3_core.DataType.is_duration(kind))


class _Rows:
    """Numbers of a Parquet table, whose rows can only be unpacked in order.

    Parameters
    ----------
    types : type of each column by its heading.
    """

    def __init__(self, path: Path, row_count: int, types: dict[str, Any]) -> None:
        self._path = path
        self._row_count = row_count
        self._types = types
        self._block = np.empty((len(types), 0))
        self._block_start = 0
        self._batches = self._unpack()
        self._batch = [np.empty(0)] * len(types)
        self._batch_start = 0

    def read(self, column: int, start: int, stop: int) -> np.ndarray:
        """Return some samples of a column, times in seconds since its first."""
        # Channels are sliced one after the other over the same span, so all are read together.
        block_stop = self._block_start + self._block.shape[1]
        if not self._block_start <= start <= stop <= block_stop:
            self._read_block(start, stop)
        samples: np.ndarray = self._block[column, start - self._block_start :][: stop - start]
        return samples

    def _read_block(self, start: int, stop: int) -> None:
        """Read the rows from `start` to `stop`, or more, of all columns."""
        self._block = np.empty((len(self._types), 0))  # only one block is ever in memory
        if 8 * self._row_count * len(self._types) <= _MAX_CACHED_BYTES:
            start, stop = 0, self._row_count
        stop = min(max(stop, start + BLOCK_SAMPLES), self._row_count)

        if start < self._batch_start:
            self._batches = self._unpack()
            self._batch = [np.empty(0)] * len(self._types)
            self._batch_start = 0

        block = np.empty((len(self._types), stop - start))
        row = start
        while row < stop:
            batch_stop = self._batch_start + len(self._batch[0])
            if row >= batch_stop:
                self._batch = self._next_batch()
                self._batch_start = batch_stop
                continue

            part = slice(row - self._batch_start, stop - self._batch_start)
            part_stop = min(stop, batch_stop)
            for samples, values in zip(block, self._batch, strict=True):
                samples[row - start : part_stop - start] = values[part]
            row = part_stop
        self._block = block
        self._block_start = start

    def _next_batch(self) -> list[np.ndarray]:
        batch = next(self._batches, None)
        if batch is None:
            raise DataError(f"{self._path} has fewer than the {self._row_count} rows it states.")
        return batch

    def _unpack(self) -> Iterator[list[np.ndarray]]:
        """Yield the numbers of some rows after the other, by column."""
        first_ticks: dict[str, int | None] = {}
        for batch in _open(self._path):
            columns = []
            for heading, kind in self._types.items():
                column = batch.column(heading)
                if not _is_time(kind):
                    columns.append(doubles_of(column.cast(arro3_core.DataType.float64())))
                    continue

                ticks, is_present = numbers_of(column.cast(arro3_core.DataType.int64()))
                first_tick = first_ticks.setdefault(
                    heading, int(ticks[0]) if is_present[0] else None
                )
                columns.append(_seconds(ticks, is_present, first_tick, kind.time_unit))
            yield columns


def _seconds(
    ticks: np.ndarray, is_present: np.ndarray, first_tick: int | None, unit: str
) -> np.ndarray:
    """Return the seconds since the first tick, NaN without it."""
    if first_tick is None:
        return np.full(len(ticks), np.nan)

    # Subtracted as integers: a double does not resolve nanoseconds since 1970.
    nanoseconds = (ticks - first_tick) * _UNIT_NS[unit]
    return np.where(is_present, nanoseconds * 1e-9, np.nan)
