"""Whether a file is complete for its format: a program that pauses has not written its end yet.

Only what the format itself records decides. A file without such a record counts as complete.
"""

import io
import struct
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

TEXT_SUFFIXES = (".csv", ".tsv", ".txt", ".dat", ".asc", ".lvm", ".uff", ".unv")
"""Suffixes of text, of which each line ends with a line break."""
WAV_HEADER_BYTES = 12
UNKNOWN_SIZE = 0xFFFFFFFF
"""Size that a WAV file states until it is closed."""
HDF5_USER_BLOCK_BYTES = 512
"""Bytes before the HDF5 part of a MATLAB file."""
MAT_HEADER_BYTES = 128
MAT_COMPRESSED = 15
"""Type of a compressed element, which is not padded."""
TDMS_LEAD_IN_BYTES = 28
TDMS_UNKNOWN_SIZE = 0xFFFFFFFFFFFFFFFF
"""Size that a segment of a TDMS file states until it is closed."""
MAX_ZIP_COMMENT_BYTES = 65_557
"""Bytes at the end of a ZIP archive in which its directory ends."""


def is_complete(name: str, content: bytes) -> bool:
    """Return whether a file has the end that its format requires.

    Examples
    --------
    >>> is_complete("a.csv", b"time,x\\n0,1\\n0.1,2"), is_complete("a.csv", b"time,x\\n0,1\\n")
    (False, True)
    """
    if not content:
        return False
    for signature, check in _CHECKS.items():
        if len(content) < len(signature) and signature.startswith(content):
            return False
        if content.startswith(signature):
            try:
                return check(content)
            except (struct.error, ValueError, IndexError, EOFError):
                return False  # it ends within its header
    if content[HDF5_USER_BLOCK_BYTES:].startswith(_HDF5):
        return _is_matlab_hdf5_complete(content)
    is_text = Path(name).suffix.lower() in TEXT_SUFFIXES and b"\0" not in content
    return not is_text or content.endswith((b"\n", b"\r"))


def _is_wav_complete(content: bytes) -> bool:
    large_size = None
    position = WAV_HEADER_BYTES
    while position < len(content):
        kind, size = struct.unpack_from("<4sI", content, position)
        start = position + 8
        if kind == b"ds64":
            (large_size,) = struct.unpack_from("<Q", content, start + 8)
        if kind == b"data":
            if large_size is not None and size == UNKNOWN_SIZE:
                size = large_size
            return bool(size) and start + size <= len(content)
        position = start + size + size % 2
    return False


def _is_hdf5_complete(content: bytes, start: int = 0) -> bool:
    """Return whether the part of a file that begins at `start` has the end that it states."""
    version = content[start + 8]
    if version >= 2:
        flags = content[start + 11]
        (end,) = struct.unpack_from("<Q", content, start + 28)
        # A program that has the file open for writing marks version 3.
        return end <= len(content) and not (version >= 3 and flags & 1)
    (end,) = struct.unpack_from("<Q", content, start + 40 + 4 * version)
    return bool(end <= len(content))


def _is_matlab_hdf5_complete(content: bytes) -> bool:
    return _is_hdf5_complete(content, HDF5_USER_BLOCK_BYTES)


def _is_zip_complete(content: bytes) -> bool:
    start = content.rfind(b"PK\x05\x06", max(0, len(content) - MAX_ZIP_COMMENT_BYTES))
    if start < 0:
        return False
    (comment_length,) = struct.unpack_from("<H", content, start + 20)
    return start + 22 + comment_length <= len(content)


def _is_npy_complete(content: bytes) -> bool:
    file = io.BytesIO(content)
    version = np.lib.format.read_magic(file)
    read_header = np.lib.format.read_array_header_1_0
    if version > (1, 0):
        read_header = np.lib.format.read_array_header_2_0
    shape, _, kind = read_header(file)
    return file.tell() + int(np.prod(shape)) * kind.itemsize <= len(content)


def _is_mat_complete(content: bytes) -> bool:
    order = "<" if content[126:128] == b"IM" else ">"
    position = MAT_HEADER_BYTES
    while position < len(content):
        kind, size = struct.unpack_from(f"{order}II", content, position)
        position += 8 + size
        if kind != MAT_COMPRESSED:
            position += -size % 8
    return position == len(content) and position > MAT_HEADER_BYTES


def _is_parquet_complete(content: bytes) -> bool:
    return len(content) > 8 and content.endswith(b"PAR1")


def _is_tdms_complete(content: bytes) -> bool:
    position = 0
    while position < len(content):
        (size,) = struct.unpack_from("<Q", content, position + 12)
        if size == TDMS_UNKNOWN_SIZE:
            return False
        position += TDMS_LEAD_IN_BYTES + size
    return position == len(content)


def _is_uff_complete(content: bytes) -> bool:
    marks = sum(line.strip() == b"-1" for line in content.splitlines())
    return marks % 2 == 0 and content.endswith(b"\n")


def _is_never_complete(content: bytes) -> bool:
    return False


_HDF5 = b"\x89HDF\r\n\x1a\n"
_CHECKS: Mapping[bytes, Callable[[bytes], bool]] = {
    b"RIFF": _is_wav_complete,
    b"RF64": _is_wav_complete,
    _HDF5: _is_hdf5_complete,
    b"PK\x03\x04": _is_zip_complete,
    b"\x93NUMPY": _is_npy_complete,
    b"MATLAB 5.0": _is_mat_complete,
    b"MATLAB 7.3": _is_matlab_hdf5_complete,
    b"PAR1": _is_parquet_complete,
    b"TDSm": _is_tdms_complete,
    b"    -1": _is_uff_complete,
    b"UnFinMF": _is_never_complete,  # MDF marks what is not finished
}
