"""Paths, names and content of files that a user specifies."""

import hashlib
import re
from os import PathLike
from pathlib import Path
from typing import NamedTuple

from swashtwin.foundation.errors import DataError, InputError, MissingFileError

# Names that Windows reserves for devices, with any suffix.
_WINDOWS_DEVICE = re.compile(r"^(con|prn|aux|nul|(com|lpt)[0-9¹²³])(?=\.|$)", re.IGNORECASE)

# Limit of a name, so that a whole path stays below the 260 characters that Windows allows.
_MAX_NAME_CHARACTERS = 100


class FileStamp(NamedTuple):
    """What shows that a file was changed or replaced, without reading it."""

    size: int
    """Size [byte]."""
    modified_ns: int
    """Time of the last change of its content [ns since 1970], which a copying program may set."""
    changed_ns: int
    """Time of the last change of content or metadata [ns since 1970], which no program can set."""
    inode: int
    """Number of the file in its file system: another one after the file was replaced."""


def as_path(path: object) -> Path:
    """Return the path of a file; raise an `InputError` if `path` is neither text nor a path."""
    if not isinstance(path, (str, PathLike)):
        raise InputError(f"{path!r} is not a path; give the file as text or as a pathlib.Path.")
    return Path(path)


def file_stamp(path: Path) -> FileStamp:
    """Return the stamp of a file, by which whatever was computed from it is cached.

    A recorder may write a file anew with the same size and with the date of the measurement, so
    size and date alone would not show it.

    Raises
    ------
    MissingFileError
        The path is not a file.
    """
    if not path.is_file():
        raise MissingFileError(f"{path} does not exist, or is not a file.")

    status = path.stat()
    return FileStamp(status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino)


def read_text(path: Path) -> str:
    """Return the text of a UTF-8 file, with or without a byte order mark.

    Raises
    ------
    DataError
        It has another encoding.
    """
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as cause:
        byte = cause.object[cause.start]
        raise DataError(
            f"{path} is not UTF-8 text (byte 0x{byte:02x} at {cause.start}); save it with the "
            "encoding UTF-8."
        ) from cause


def safe_file_name(text: str) -> str:
    """Return `text` as a file name, without suffix, that is valid on every system.

    Characters that lead out of a folder, hide a file or have a meaning in a shell become ``_``, and
    a name that Windows reserves for a device gets a ``_``.

    Examples
    --------
    >>> [safe_file_name(name) for name in ("pump A/3", "a:b", "con", "..")]
    ['pump_A_3', 'a_b', 'con_', '_']
    """
    name = re.sub(r"[^\w.+-]", "_", text)[:_MAX_NAME_CHARACTERS].strip(".")
    return _WINDOWS_DEVICE.sub(r"\g<0>_", name) or "_"


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file's bytes, in hexadecimal."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
