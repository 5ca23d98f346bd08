"""Columns of a file, which read when they are sliced, and the stamp by which a changed file is noticed.

This module is imported by the process that reads files, so it imports little.
"""

from collections.abc import Callable
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


class Part:
    """Samples of a column from `first` to before `last`."""

    def __init__(self, column: Column, first: int, last: int) -> None:
        self._column, self._first, self._last = column, first, last

    def __len__(self) -> int:
        """Number of samples."""
        return self._last - self._first

    def __getitem__(self, span: slice, /) -> np.ndarray:
        start, stop, step = span.indices(len(self))
        return np.asarray(self._column[self._first + start : self._first + stop])[::step]


class SideBySide:
    """Columns that a file holds beside each other: a slice of all is read at once and kept for the others."""

    def __init__(
        self, read: Callable[[int, int], np.ndarray], shape: tuple[int, int], dtype: np.dtype | None = None
    ) -> None:
        self._read = read
        self._shape = shape
        self.dtype = np.dtype(np.float64) if dtype is None else dtype
        self._last: tuple[int, int, np.ndarray] | None = None

    def columns(self) -> "list[_SideColumn]":
        """Each column by itself."""
        return [_SideColumn(self, number) for number in range(self._shape[0])]

    def __len__(self) -> int:
        """Number of samples of each column."""
        return self._shape[1]

    def together(self, start: int, stop: int) -> np.ndarray:
        """Samples of every column from `start` to before `stop`."""
        if self._last is None or self._last[:2] != (start, stop):
            self._last = None  # its memory is needed for the next
            self._last = (start, stop, self._read(start, stop))
        return self._last[2]


class _SideColumn:
    """One column of several that are read together."""

    def __init__(self, source: SideBySide, number: int) -> None:
        self._source = source
        self._number = number

    @property
    def dtype(self) -> np.dtype:
        return self._source.dtype

    def __len__(self) -> int:
        return len(self._source)

    def __getitem__(self, span: slice, /) -> np.ndarray:
        start, stop, step = span.indices(len(self._source))
        samples: np.ndarray = self._source.together(start, max(start, stop))[self._number]
        return samples[::step]
