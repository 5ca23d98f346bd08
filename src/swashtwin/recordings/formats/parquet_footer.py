"""Number of rows that the footer of a Parquet file states.

The reader of the samples returns rows one after the other, and does not know how many there are.

References
----------
Apache Parquet: file format, https://parquet.apache.org/docs/file-format/metadata/.
Apache Thrift: compact protocol, https://github.com/apache/thrift/blob/master/doc/specs/.
"""

from io import BytesIO
from pathlib import Path

from swashtwin.foundation import DataError, require_memory

_MAGIC = b"PAR1"

# Types of the compact protocol.
_TRUTH_VALUES = (1, 2)
_BYTE = 3
_INTEGERS = (4, 5, 6)
_DOUBLE = 7
_BINARY = 8
_LIST = 9
_STRUCT = 12
_SIZES = {1: 0, 2: 0, _BYTE: 1, _DOUBLE: 8}

# Short lists hold their length beside the type of their items.
_LONG_LIST = 15

# Number of the field `num_rows` of the structure `FileMetaData`.
_ROWS_FIELD = 3

# Structures within structures; the footer has six at most.
_MAX_DEPTH = 32


def count_rows(path: Path) -> int:
    """Return the number of rows that a Parquet file states.

    Raises
    ------
    DataError
        The footer is damaged.
    """
    with path.open("rb") as file:
        size = path.stat().st_size
        file.seek(max(0, size - 8))
        tail = file.read(8)
        length = int.from_bytes(tail[:4], "little")
        if tail[4:] != _MAGIC or length > size - 8:
            raise _damage(path)
        require_memory(path, length)
        file.seek(size - 8 - length)
        footer = _Footer(file.read(length))

    try:
        count = footer.integer_field(_ROWS_FIELD)
    except (ValueError, IndexError) as cause:
        raise _damage(path) from cause
    if count < 0:
        raise _damage(path)
    return count


class _Footer:
    """A structure in Thrift's compact protocol."""

    def __init__(self, content: bytes) -> None:
        self._file = BytesIO(content)
        self._size = len(content)

    def integer_field(self, number: int) -> int:
        """Return an integer of the outermost structure by the number of its field."""
        field = 0
        while True:
            field, kind = self._field_header(field)
            if field == number and kind in _INTEGERS:
                return self._signed()
            if not kind:
                raise ValueError(f"field {number} is missing")
            self._skip(kind, _MAX_DEPTH)

    def _byte(self) -> int:
        return self._file.read(1)[0]

    def _advance(self, n_bytes: int) -> None:
        if n_bytes > self._size - self._file.tell():
            raise ValueError("a value ends behind the footer")
        self._file.seek(n_bytes, 1)

    def _unsigned(self) -> int:
        value = 0
        for shift in range(0, 70, 7):
            byte = self._byte()
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                return value
        raise ValueError("an integer has more than 64 bits")

    def _signed(self) -> int:
        value = self._unsigned()
        return (value >> 1) ^ -(value & 1)  # zigzag

    def _field_header(self, last_field: int) -> tuple[int, int]:
        """Return the number and type of the next field; type 0 ends the structure."""
        header = self._byte()
        step, kind = header >> 4, header & 0x0F
        if not kind:
            return last_field, kind
        return last_field + step if step else self._signed(), kind

    def _skip(self, kind: int, depth: int) -> None:
        """Skip a value of a structure."""
        if not depth:
            raise ValueError("structures are nested too deeply")
        if kind in _SIZES:
            self._advance(_SIZES[kind])
        elif kind in _INTEGERS:
            self._unsigned()
        elif kind == _BINARY:
            self._advance(self._unsigned())
        elif kind == _LIST:
            self._skip_list(depth - 1)
        elif kind == _STRUCT:
            field, kind = self._field_header(0)
            while kind:
                self._skip(kind, depth - 1)
                field, kind = self._field_header(field)
        else:
            raise ValueError(f"unknown type {kind}")

    def _skip_list(self, depth: int) -> None:
        header = self._byte()
        kind = header & 0x0F
        if kind in _TRUTH_VALUES:
            kind = _BYTE  # the type of a field holds its truth value, that of a list does not
        count = header >> 4
        if count == _LONG_LIST:
            count = self._unsigned()
        for _ in range(count):
            self._skip(kind, depth)


def _damage(path: Path) -> DataError:
    return DataError(f"{path}: its footer is damaged; the file may be cut off.")
