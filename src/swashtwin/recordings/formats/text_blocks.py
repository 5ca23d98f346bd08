"""Text of a table in blocks of whole lines, so that a file of any size takes little memory."""

import codecs
import gzip
import io
from collections.abc import Iterable, Iterator
from pathlib import Path

from swashtwin.foundation import DataError

# Bytes that are read together: what is computed from them fits into the processor's cache.
_BLOCK_BYTES = 1 << 21

# Bytes of the first block: the head of most tables, which is read twice.
_FIRST_BLOCK_BYTES = 1 << 16

# Longest line of a table.
MAX_LINE_BYTES = 1 << 24

# Bytes of text per byte of a gzipped file; more is not a measurement.
_MAX_EXPANSION = 300

# Text that any gzipped file may hold.
_UNLIMITED_TEXT_BYTES = 1 << 28

_INFINITY = "∞".encode()
_MINUS_SIGN = "\u2212".encode()


def read_text_blocks(path: Path) -> Iterator[bytes]:
    """Yield a text in UTF-8 or Latin-1, in blocks of whole lines without the last line's end.

    A line ends with a line feed in place of a carriage return, or of both. Line feeds between the
    blocks make the text whole.

    Raises
    ------
    DataError
        The file is binary, a line is longer than `MAX_LINE_BYTES`, or a gzipped file unpacks to
        implausibly much.
    """
    rest = b""
    for number, chunk in enumerate(_decoded_chunks(path)):
        if number == 0:
            chunk = chunk.removeprefix(codecs.BOM_UTF8)
            if b"\0" in chunk[:4096]:
                raise DataError(f"{path} is a binary file, not a text table.")

        text = rest + chunk
        end = _end_of_last_line(text)
        rest = text[end:]
        if end:
            # Without the end of the last line, which may be a carriage return, a feed, or both.
            yield _normalize(text[:end]).removesuffix(b"\n")
        elif len(rest) >= MAX_LINE_BYTES:
            raise DataError(
                f"{path} has a line of more than {MAX_LINE_BYTES >> 20} MB; it is not a table."
            )
    yield _normalize(rest)


def _decoded_chunks(path: Path) -> Iterator[bytes]:
    """Yield the bytes of a file; those of UTF-16 as UTF-8."""
    with _open(path) as file:
        limit_bytes = _text_limit(path)
        first = file.read(_FIRST_BLOCK_BYTES)
        utf16: codecs.IncrementalDecoder | None = None
        if first[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
            utf16 = codecs.getincrementaldecoder("utf-16")()

        n_bytes = 0
        chunk = first
        while chunk:
            n_bytes += len(chunk)
            if limit_bytes is not None and n_bytes > limit_bytes:
                raise DataError(
                    f"{path} unpacks to more than {_MAX_EXPANSION} times its size; "
                    "it is not a measurement."
                )
            yield chunk if utf16 is None else utf16.decode(chunk).encode()
            chunk = file.read(_BLOCK_BYTES)

        if utf16 is not None:
            # raises an error if the file ends within a character
            yield utf16.decode(b"", final=True).encode()


def _open(path: Path) -> io.BufferedIOBase:
    if path.suffix.lower() == ".gz":
        return gzip.open(path)
    return path.open("rb")


def _text_limit(path: Path) -> int | None:
    """Return the number of bytes that a gzipped file may unpack to, or None."""
    if path.suffix.lower() != ".gz":
        return None
    return max(_MAX_EXPANSION * path.stat().st_size, _UNLIMITED_TEXT_BYTES)


def _end_of_last_line(text: bytes) -> int:
    """Return the number of bytes up to the end of the last whole line."""
    end = text.rfind(b"\n")
    if end >= 0:
        return end + 1
    # A carriage return alone; a line feed may follow the last one in the next chunk.
    return text.rstrip(b"\r").rfind(b"\r") + 1


def _normalize(text: bytes) -> bytes:
    """Return lines with line feeds, and with the marks of numbers that a parser knows."""
    if b"\r" in text:
        text = text.replace(b"\r\r\n", b"\n").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return text.replace(_INFINITY, b"inf").replace(_MINUS_SIGN, b"-")


def skip_lines(blocks: Iterable[bytes], count: int) -> Iterator[bytes]:
    """Yield blocks without the first `count` lines."""
    for block in blocks:
        n_lines = block.count(b"\n") + 1 if count else 0
        if count and count >= n_lines:
            count -= n_lines
            continue
        yield block.split(b"\n", count)[-1] if count else block
        count = 0


def drop_empty_rows_at_end(blocks: Iterable[bytes], separator: bytes) -> Iterator[bytes]:
    """Yield blocks up to the last row that has a value; of a table without any, the first row."""
    empty_blocks: list[bytes] = []
    has_values = False
    for block in blocks:
        last_value = len(block.rstrip(b"\n" + separator))
        if not last_value:
            empty_blocks.append(block)
            continue

        yield from empty_blocks
        has_values = True
        empty_blocks = []
        end = block.find(b"\n", last_value)
        if end < 0:
            yield block
        else:
            yield block[:end]
            empty_blocks.append(block[end + 1 :])

    if not has_values:
        yield b"".join(empty_blocks[:1]).split(b"\n")[0]


def trim_blanks(data: bytes, separator: bytes) -> bytes:
    """Return lines without blanks around their fields; between words one blank remains."""
    if separator != b"\t" and b"\t" in data:
        data = data.replace(b"\t", b" ")
    if b" " not in data:
        return data

    while b"  " in data:
        data = data.replace(b"  ", b" ")
    for mark in {separator, b"\n"} - {b" "}:
        data = data.replace(b" " + mark, mark).replace(mark + b" ", mark)
    return data.strip(b" ")
