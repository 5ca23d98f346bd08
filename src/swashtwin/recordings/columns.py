"""Columns of a file, which read when they are sliced, and the stamp by which a changed file is noticed.

This module is imported by the process that reads files, so it imports little.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from swashtwin.foundation import DataError, MissingFileError

BLOCK = 1 << 18
"""Samples of each channel that are in memory together: 2 MB in double precision."""


def file_stamp(path: Path) -> tuple[int, int, int]:
    """Size [byte], time of the last change [ns] and inode of a file: another file, or a changed one, has others.

    Raises
    ------
    MissingFileError
        No such file.
    """
    if not path.is_file():
        raise MissingFileError(f"{path} does not exist, or is no file.")
    stat = path.stat()
    return stat.st_size, stat.st_mtime_ns, stat.st_ino


def require_unchanged(path: Path, stamp: tuple[int, int, int]) -> None:
    """Refuse a file whose `file_stamp` differs from the one that it had when it was loaded."""
    if file_stamp(path) != stamp:
        raise DataError(f"{path}: the file has changed since it was loaded; load it again.")


@runtime_checkable
class Column(Protocol):
    """Samples of one channel in the number type of the file; an array is one, and so is what reads when sliced."""

    def __len__(self) -> int:
        """Number of samples."""

    def __getitem__(self, span: slice, /) -> np.ndarray:
        """The samples of a slice."""


def number_type(column: Column) -> np.dtype:
    """Number type of a column's samples; the first is read where the column does not say it."""
    stated = getattr(column, "dtype", None)
    return stated if isinstance(stated, np.dtype) else np.asarray(column[0 : min(1, len(column))]).dtype


class LazyColumn:
    """Samples of a column that `read` gives, from a first one to before another, when they are sliced."""

    def __init__(self, read: Callable[[int, int], np.ndarray], length: int, dtype: np.dtype | None = None) -> None:
        self._read = read
        self._length = length
        self.dtype = dtype

    def __len__(self) -> int:
        return self._length

    def __getitem__(self, span: slice, /) -> np.ndarray:
        start, stop, step = span.indices(self._length)
        return np.asarray(self._read(start, max(start, stop)))[::step]


def part_of(column: Column, first: int, last: int) -> LazyColumn:
    """Samples of a column from `first` to before `last`."""
    return LazyColumn(lambda start, stop: column[first + start : first + stop], last - first)


def side_by_side(
    read: Callable[[int, int], np.ndarray], shape: tuple[int, int], dtype: np.dtype | None = None
) -> list[LazyColumn]:
    """Columns (number, samples of each) that a file holds beside each other, of which `read` gives a slice of all.

    The slice is kept for the other columns.
    """
    kept: dict[tuple[int, int], np.ndarray] = {}

    def row(number: int, start: int, stop: int) -> np.ndarray:
        if (start, stop) not in kept:
            kept.clear()  # its memory is needed for the next
            kept[start, stop] = read(start, stop)
        samples: np.ndarray = kept[start, stop][number]
        return samples

    kind = np.dtype(np.float64) if dtype is None else dtype
    return [LazyColumn(partial(row, number), shape[1], kind) for number in range(shape[0])]
