"""Rows of a text table whose dialect is known: columns of numbers and of time stamps."""

import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import load_extra
from swashtwin.recordings.columns import Column
from swashtwin.recordings.formats.arrow_arrays import doubles_of, texts_of
from swashtwin.recordings.formats.column_store import ColumnStore
from swashtwin.recordings.formats.dialects import MISSING
from swashtwin.recordings.formats.time_stamps import StampReader

arro3_io: Any = load_extra("arro3.io", "readers", "a text table")
nanoarrow: Any = load_extra("nanoarrow", "readers", "a text table")

MISSING_TEXTS = frozenset(text.encode() for text in MISSING)
"""`MISSING` as it stands in a file."""

# Bytes of a text that are kept; a time stamp is shorter.
_MAX_TEXT_BYTES = 64

# The parser knows the decimal point only. A point where a comma is expected stays an error.
_SWAP_MARKS = bytes.maketrans(b",.", b".,")

_FORTRAN_EXPONENT = re.compile(rb"(?<=\d|\.)[dD](?=[+-]?\d)")


class RowError(Exception):
    """A row has more or fewer columns than the table, or a field is not a number."""


@dataclass(frozen=True)
class ParsedRows:
    """Columns of a table by their index."""

    numbers: dict[int, Column]
    stamps: dict[int, StampReader]


@dataclass(frozen=True)
class RowParser:
    """Parser of rows with `n_columns` fields.

    Parameters
    ----------
    path : file of the rows, for messages.
    decimal : decimal mark, a point or a comma; a comma needs another separator.
    """

    path: Path
    separator: str
    decimal: str
    n_columns: int

    def parse(
        self, blocks: Iterable[bytes], numbers: Collection[int], stamps: Collection[int] = ()
    ) -> ParsedRows:
        """Return columns of whole lines by their index; those without any value are left out.

        Parameters
        ----------
        blocks : lines without the end of the last; each has a row at least.
        numbers : indices of columns of numbers; a missing number is NaN.
        stamps : indices of columns of time stamps. Fields of all other columns may hold anything.

        Raises
        ------
        RowError
            A row is empty, or has more or fewer fields, or a field of `numbers` is not a number.
        """
        store = ColumnStore(self.path, numbers)
        blanks = set(numbers)
        stamp_columns = {column: StampReader() for column in stamps}
        for block in blocks:
            batch = self._parse_block(block, numbers, stamps)
            fields = {column: batch.child(column) for column in numbers}
            blanks -= {
                column for column, field in fields.items() if field.null_count < batch.length
            }
            store.append(
                {column: doubles_of(field) for column, field in fields.items()}, batch.length
            )
            for column, reader in stamp_columns.items():
                reader.append(self._short_texts(batch.child(column)), MISSING_TEXTS)

        return ParsedRows(
            {column: store.column(column) for column in numbers if column not in blanks},
            {
                column: reader
                for column, reader in stamp_columns.items()
                if reader.n_missing < reader.n_stamps
            },
        )

    def _parse_block(self, block: bytes, numbers: Collection[int], texts: Collection[int]) -> Any:
        """Return the columns of some lines as a structure of Arrow."""
        if not block.isascii():
            block = decode(block).encode()  # the parser refuses Latin-1
        if (b"D" in block or b"d" in block) and _FORTRAN_EXPONENT.search(block):
            block = _FORTRAN_EXPONENT.sub(b"e", block)

        try:
            return self._parse_present(block, numbers, texts)
        except RowError:
            # Few tables write a missing number as a text, and looking for these takes long.
            block, count = self._missing_pattern().subn(rb"\1", b"\n" + block + b"\n")
            if not count:
                raise
            return self._parse_present(block[1:-1], numbers, texts)

    def _parse_present(self, block: bytes, numbers: Collection[int], texts: Collection[int]) -> Any:
        """Return the columns of lines in which a missing number is an empty field."""
        types = [nanoarrow.Type.NULL] * self.n_columns  # is not parsed
        for column in numbers:
            types[column] = nanoarrow.Type.DOUBLE
        for column in texts:
            types[column] = nanoarrow.Type.STRING
        fields = [nanoarrow.Schema(kind, name=str(column)) for column, kind in enumerate(types)]

        n_rows = block.count(b"\n") + 1
        if self.n_columns == 1:
            block = _quote_empty_lines(block)
        if self.decimal == ",":
            block = block.translate(_SWAP_MARKS)
        try:
            batches = list(
                arro3_io.read_csv(
                    block,
                    nanoarrow.c_schema(nanoarrow.struct(fields)),
                    has_header=False,
                    delimiter=self.separator,
                    batch_size=n_rows,
                )
            )
        except Exception as cause:  # the library has no type of error for a damaged row
            raise RowError(str(cause)) from cause

        # The parser drops empty lines in silence.
        if len(batches) != 1 or batches[0].num_rows != n_rows:
            raise RowError("a line is empty")
        return nanoarrow.c_array(batches[0])

    def _missing_pattern(self) -> re.Pattern[bytes]:
        """Return the pattern of a text for a missing number, between two separators."""
        bounds = rb"[" + re.escape(self.separator.encode()) + rb"\n]"
        texts = b"|".join(re.escape(text) for text in sorted(MISSING_TEXTS - {b""}))
        quoted = rb'"(?:' + texts + rb')"'
        return re.compile(
            rb"(" + bounds + rb")(?:" + texts + rb"|" + quoted + rb")(?=" + bounds + rb")"
        )

    def _short_texts(self, field: Any) -> np.ndarray:
        """Return the texts of a column of Arrow as an array of fixed width."""
        characters, offsets = texts_of(field)
        if self.decimal == ",":
            content = characters.tobytes().translate(_SWAP_MARKS)
            characters = np.frombuffer(content, dtype=np.uint8)

        n_texts = len(offsets) - 1
        lengths = np.diff(offsets)
        width = min(int(lengths.max()), _MAX_TEXT_BYTES)
        if not width:
            return np.zeros(n_texts, dtype="S1")

        if np.all(lengths == width):
            matrix = characters[offsets[0] : offsets[-1]].reshape(n_texts, width)
        else:
            positions = np.arange(width)
            indices = np.minimum(offsets[:-1, None] + positions, len(characters) - 1)
            matrix = np.where(positions < lengths[:, None], characters[indices], np.uint8(0))
        return np.ascontiguousarray(matrix).view(f"S{width}")[:, 0]


def _quote_empty_lines(block: bytes) -> bytes:
    """Return lines of one field, the empty ones quoted: the parser would drop them."""
    lines = b"\n" + block + b"\n"
    while b"\n\n" in lines:
        lines = lines.replace(b"\n\n", b'\n""\n')
    return lines[1:-1]


def decode(data: bytes) -> str:
    """Return text in UTF-8, or else in Latin-1."""
    try:
        return data.decode()
    except UnicodeDecodeError:
        return data.decode("latin-1")
