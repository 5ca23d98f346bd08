"""Files that are whole or not there."""

import hashlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from swashtwin.foundation.errors import InputError

_SPARE = 1 << 24
"""Bytes that are left free on the disk."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Temporary path beside `path` that takes its place when the block ends well, and vanishes when it does not.

    A full disk, an interrupt or any other error leaves `path` as it was.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}-", suffix=path.suffix)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o644)
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


@contextmanager
def whole_folder(folder: Path) -> Iterator[None]:
    """Within it, a folder that was missing or empty is filled; it is removed where that does not end well."""
    fresh = not folder.exists() or not any(folder.iterdir())
    try:
        yield
    except BaseException:
        if fresh:
            shutil.rmtree(folder, ignore_errors=True)
        raise


def write_text(path: Path, text: str) -> Path:
    """`path`, after `text` was written to it whole."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return Path(path)


def spreadsheet_text(text: str) -> str:
    """`text` as a cell of a CSV file that no spreadsheet takes for a formula.

    Examples
    --------
    >>> spreadsheet_text("=1+1"), spreadsheet_text("normal")
    ("'=1+1", 'normal')
    """
    return f"'{text}" if text[:1] in ("=", "+", "-", "@", "\t", "\r") else text


def require_disk_space(folder: Path, count: int, bytes_each: int) -> None:
    """Refuse `count` files of `bytes_each` for which the disk of an existing `folder` has too little space.

    Raises
    ------
    InputError
        They do not fit.
    """
    needed, free = count * bytes_each, shutil.disk_usage(folder).free - _SPARE
    if needed > free:
        raise InputError(
            f"{folder} has {max(free, 0) / 1e9:.4g} GB free, and {count} such recordings take {needed / 1e9:.4g} GB; "
            "ask for fewer or shorter ones, or name a folder on another disk."
        )


def sha256_of(path: Path) -> str:
    """SHA-256 of a file's bytes, hexadecimal."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
