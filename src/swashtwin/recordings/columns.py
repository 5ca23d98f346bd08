"""Columns of samples, which are read from their file when they are sliced."""

from collections.abc import Callable
from functools import partial
from typing import Protocol, runtime_checkable

import numpy as np

BLOCK_SAMPLES = 1 << 18
"""Samples of each channel that are in memory together: 2 MB in double precision."""


@runtime_checkable
class Column(Protocol):
    """Samples of one channel in the number type of the file.

    An array is a column, and so is any object that reads its samples when it is sliced.
    """

    def __len__(self) -> int:
        """Number of samples."""

    def __getitem__(self, span: slice, /) -> np.ndarray:
        """The samples of a slice."""


def number_type(column: Column) -> np.dtype:
    """Return the number type of a column; the first sample is read if the column has no `dtype`."""
    dtype = getattr(column, "dtype", None)
    if isinstance(dtype, np.dtype):
        return dtype

    return np.asarray(column[0 : min(1, len(column))]).dtype


class LazyColumn:
    """Column whose samples from `start` to before `stop` are ``read(start, stop)``."""

    def __init__(
        self, read: Callable[[int, int], np.ndarray], length: int, dtype: np.dtype | None = None
    ) -> None:
        self._read = read
        self._length = length
        self.dtype = dtype

    def __len__(self) -> int:
        return self._length

    def __getitem__(self, span: slice, /) -> np.ndarray:
        start, stop, step = span.indices(self._length)
        return np.asarray(self._read(start, max(start, stop)))[::step]


def slice_column(column: Column, first: int, end: int) -> LazyColumn:
    """Return the samples of a column from `first` to before `end`, without reading them."""
    return LazyColumn(lambda start, stop: column[first + start : first + stop], end - first)


def matrix_columns(
    read: Callable[[int, int], np.ndarray], shape: tuple[int, int], dtype: np.dtype | None = None
) -> list[LazyColumn]:
    """Return the rows of a matrix as columns that share each block that is read.

    Parameters
    ----------
    read : returns the samples from a start to before a stop, of all columns (column by time).
    shape : number of columns, and samples of each.
    dtype : number type of the samples; None is float64.
    """
    # Channels are sliced one after the other over the same span: without the last block at hand,
    # each channel would read (and unpack) all channels again.
    block_cache: dict[tuple[int, int], np.ndarray] = {}

    def read_row(row: int, start: int, stop: int) -> np.ndarray:
        if (start, stop) not in block_cache:
            block_cache.clear()  # before reading, so that only one block is ever in memory
            block_cache[start, stop] = read(start, stop)
        samples: np.ndarray = block_cache[start, stop][row]
        return samples

    kind = np.dtype(np.float64) if dtype is None else dtype
    return [LazyColumn(partial(read_row, row), shape[1], kind) for row in range(shape[0])]
