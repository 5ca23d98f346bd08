"""Columns of numbers that are read block by block, and kept in a file if they are large."""

import bisect
import tempfile
import weakref
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import IO

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import InputError, require_disk_space
from swashtwin.recordings.columns import Column

# Numbers that are kept in memory; more are kept in a temporary file.
_MAX_BYTES_IN_MEMORY = 1 << 28

_NUMBER_BYTES = 8


class ColumnStore:
    """Columns of one length, to which blocks of rows are appended.

    Parameters
    ----------
    path : file that is read, for messages.
    columns : indices of the columns.
    """

    def __init__(self, path: Path, columns: Collection[int]) -> None:
        self._path = path
        self._positions = {column: position for position, column in enumerate(columns)}
        self._blocks: list[dict[int, Float[np.ndarray, " time"]]] = []
        self._first_rows = [0]
        """Row at which each block begins, and the number of rows."""
        self._file: IO[bytes] | None = None

    @property
    def n_rows(self) -> int:
        return self._first_rows[-1]

    def append(self, block: Mapping[int, Float[np.ndarray, " time"]], n_rows: int) -> None:
        """Append `n_rows` rows with a value, or NaN, in each column."""
        self._first_rows.append(self.n_rows + n_rows)
        if self._file is not None:
            self._write(block)
            return

        # A view would keep all columns of the parser in memory.
        self._blocks.append({column: values.copy() for column, values in block.items()})
        if self.n_rows * len(self._positions) * _NUMBER_BYTES > _MAX_BYTES_IN_MEMORY:
            self._file = tempfile.TemporaryFile(prefix="swashtwin-")  # noqa: SIM115
            weakref.finalize(self, self._file.close)
            for kept_block in self._blocks:
                self._write(kept_block)
            self._blocks = []

    def column(self, column: int) -> Column:
        """Return a column, after the last block; it can be asked for once."""
        if self._file is not None:
            return StoredColumn(self, column)
        return np.concatenate([block.pop(column) for block in self._blocks])

    def read(self, column: int, start: int, stop: int) -> Float[np.ndarray, " time"]:
        """Return the rows from `start` to before `stop` of a column that is kept in the file."""
        assert self._file is not None
        values = np.empty(stop - start)
        position = self._positions[column]
        row = start
        while row < stop:
            number = bisect.bisect_right(self._first_rows, row) - 1
            first_row, next_row = self._first_rows[number : number + 2]
            end = min(stop, next_row)

            numbers_before = first_row * len(self._positions) + position * (next_row - first_row)
            self._file.seek(_NUMBER_BYTES * (numbers_before + row - first_row))
            self._file.readinto(values[row - start : end - start].data)  # type: ignore[attr-defined]
            row = end
        return values

    def _write(self, block: Mapping[int, Float[np.ndarray, " time"]]) -> None:
        """Write the columns of a block to the file, one after the other."""
        assert self._file is not None
        folder = Path(tempfile.gettempdir())
        try:
            require_disk_space(folder, 1, sum(values.nbytes for values in block.values()))
            for column in self._positions:
                self._file.write(np.ascontiguousarray(block[column], np.float64).data)
        except (InputError, OSError) as cause:
            raise InputError(
                f"{self._path}: its numbers do not fit into the folder of temporary files, "
                f"{folder}. Free space there, or let the environment variable TMPDIR name a folder "
                "on another disk."
            ) from cause


class StoredColumn:
    """Column whose numbers are in the file of a store."""

    dtype = np.dtype(np.float64)

    def __init__(self, store: ColumnStore, column: int) -> None:
        self._store = store
        self._column = column

    def __len__(self) -> int:
        return self._store.n_rows

    def __getitem__(self, span: slice, /) -> Float[np.ndarray, " time"]:
        start, stop, step = span.indices(len(self))
        return self._store.read(self._column, start, max(start, stop))[::step]

    @property
    def nbytes(self) -> int:
        """Size of the numbers [byte]."""
        return len(self) * self.dtype.itemsize
