"""Rows of a text table whose dialect is known: columns of numbers and of short texts."""

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from swashtwin.foundation import load_extra
from swashtwin.recordings.formats.arrow_arrays import doubles_of, texts_of
from swashtwin.recordings.formats.dialects import MISSING

arro3_io: Any = load_extra("arro3.io", "readers", "a text table")
nanoarrow: Any = load_extra("nanoarrow", "readers", "a text table")

MISSING_TEXTS = frozenset(text.encode() for text in MISSING)
"""`MISSING` as it stands in a file."""

# Text that is parsed together: an intermediate result of it takes little memory.
_BLOCK_BYTES = 1 << 21

# Bytes of a text that are kept; a time stamp is shorter.
_MAX_TEXT_BYTES = 64

# The parser knows the decimal point only. A point where a comma is expected stays an error.
_SWAP_MARKS = bytes.maketrans(b",.", b".,")

_FORTRAN_EXPONENT = re.compile(rb"(?<=\d|\.)[dD](?=[+-]?\d)")


class RowError(Exception):
    """A row has more or fewer columns than the table, or a field is not a number."""


@dataclass(frozen=True)
class RowParser:
    """Parser of rows with `n_columns` fields.

    Parameters
    ----------
    decimal : decimal mark, a point or a comma; a comma needs another separator.
    """

    separator: str
    decimal: str
    n_columns: int

    def parse(
        self, body: bytes, numbers: Collection[int], texts: Collection[int] = ()
    ) -> dict[int, np.ndarray]:
        """Return columns of whole lines by their index; those without any value are left out.

        Parameters
        ----------
        numbers : indices of columns of numbers; a missing number is NaN.
        texts : indices of columns whose texts are returned, in bytes; a missing text is empty or in
            `MISSING_TEXTS`. Fields of all other columns may hold anything.

        Raises
        ------
        RowError
            A row is empty, or has more or fewer fields, or a field of `numbers` is not a number.
        """
        n_rows = body.count(b"\n") + 1
        columns = {column: np.empty(n_rows) for column in numbers}
        blanks = set(numbers)
        text_blocks: dict[int, list[np.ndarray]] = {column: [] for column in texts}

        row = 0
        for block in _blocks(body):
            batch = self._parse_block(block, numbers, texts)
            stop = row + batch.length
            for column, values in columns.items():
                field = batch.child(column)
                if field.null_count < batch.length:
                    blanks.discard(column)
                values[row:stop] = doubles_of(field)
            for column, blocks in text_blocks.items():
                blocks.append(self._short_texts(batch.child(column)))
            row = stop

        for column in blanks:
            del columns[column]
        for column, blocks in text_blocks.items():
            joined = np.concatenate(blocks)
            if any(text not in MISSING_TEXTS for text in joined):
                columns[column] = joined
        return columns

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


def _blocks(body: bytes) -> Iterator[bytes]:
    """Yield whole lines, without the line feed of the last."""
    start = 0
    while start <= len(body):
        end = body.find(b"\n", start + _BLOCK_BYTES)
        if end < 0:
            end = len(body)
        yield body[start:end]
        start = end + 1
