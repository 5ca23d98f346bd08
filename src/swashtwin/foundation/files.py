"""Files that are whole or not there, and folders that are filled piece by piece.

A file is written beside its target under a hidden name and then takes the target's place. While
that lasts a lock file of the same name is held, which the system releases when the process ends,
however it ends. So what a killed process left is told from the work of a living one, and the next
process that writes into the folder removes it.
"""

import hashlib
import json
import re
import secrets
import shutil
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from os import PathLike
from pathlib import Path
from typing import IO, Any, Final

from swashtwin.foundation.errors import ArtifactError, DataError, InputError
from swashtwin.foundation.packages import VERSION

try:
    import fcntl
except ImportError:  # Windows, where nobody can remove a file that another process holds open
    fcntl = None  # type: ignore[assignment]


TEXT: Final[dict[str, Any]] = {"encoding": "utf-8", "errors": "backslashreplace", "newline": "\n"}
"""How text files are written on every system; errors are names of files that are no Unicode."""

_SPARE = 1 << 24
"""Bytes that are left free on the disk."""

_HIDDEN = ".swashtwin-"
_DEVICE = re.compile(r"^(con|prn|aux|nul|(com|lpt)[0-9¹²³])(?=\.|$)", re.IGNORECASE)
"""Names that no file of Windows may have, whatever its suffix."""

_LONGEST_NAME = 100
"""Characters, so that a path stays below the 260 that Windows takes."""

_NAME = re.compile(re.escape(_HIDDEN) + r"[0-9a-f]{12}(?=\.)")

_WAITS = (0.05, 0.2, 0.5, 1.0)
"""Seconds between attempts to replace a file that a virus scanner or an indexer of Windows holds
for a moment.
"""


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Temporary path beside `path` that takes its place when the block ends well, and vanishes when
    it does not.

    A full disk, an interrupt, a kill or any other end leaves `path` as it was. The new file has the
    permissions that the user's umask gives.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    _remove_leftovers(path.parent.resolve())
    with _held_name(path.parent) as name:
        temporary = path.parent / f"{name}.part{path.suffix}"
        try:
            yield temporary
            shutil.copymode(
                path.parent / f"{name}.lock", temporary
            )  # some libraries let nobody else read their files
            _replace(temporary, path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise


@contextmanager
def _held_name(folder: Path) -> Iterator[str]:
    while True:
        name = f"{_HIDDEN}{secrets.token_hex(6)}"
        lock = folder / f"{name}.lock"
        file = lock.open("xb")
        try:
            if (
                _is_locked(file) and lock.exists()
            ):  # else another process took it for a leftover before
                yield name
                return
        finally:
            file.close()  # Windows removes no open file
            lock.unlink(missing_ok=True)


def _is_locked(file: IO[bytes]) -> bool:
    if fcntl is None:
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return True  # a file system without locks, where nobody removes leftovers either
    return True


@cache
def _remove_leftovers(folder: Path) -> None:
    """Remove what killed processes left in a folder; once for each folder."""
    for name in {
        match[0] for file in folder.glob(f"{_HIDDEN}*") if (match := _NAME.match(file.name))
    }:
        lock = folder / f"{name}.lock"
        with suppress(
            OSError
        ):  # a living process holds the lock, or Windows removes no file that it has open
            with lock.open("ab") as file:
                if fcntl is not None:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    lock.unlink()
            for leftover in (*([lock] if fcntl is None else []), *folder.glob(f"{name}.*")):
                leftover.unlink(missing_ok=True)


def _replace(temporary: Path, path: Path) -> None:
    for seconds in _WAITS:
        try:
            temporary.replace(path)
        except PermissionError:
            if fcntl is not None or path.is_dir():
                raise
            time.sleep(seconds)
        else:
            return
    temporary.replace(path)


def write_text(path: Path, text: str) -> Path:
    """`path`, after `text` was written to it whole."""
    with atomic_write(path) as temporary:
        temporary.write_text(text, **TEXT)
    return Path(path)


def as_path(path: object) -> Path:
    """The path of a file, refused with an `InputError` where the thing is none."""
    if not isinstance(path, (str, PathLike)):
        raise InputError(f"{path!r} is no path of a file; give it as text or as a pathlib.Path.")
    return Path(path)


def read_text(path: Path) -> str:
    """Text of a file in UTF-8, with or without a byte order mark.

    Raises
    ------
    DataError
        It is in another encoding.
    """
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as cause:
        byte = cause.object[cause.start]
        raise DataError(
            f"{path} is no UTF-8 text (byte 0x{byte:02x} at {cause.start}); save it with the encoding UTF-8."
        ) from cause


def safe_file_name(text: str) -> str:
    """`text` as a name, without its suffix, that every system takes for a file.

    Characters that lead out of a folder, hide a file or have a meaning in a shell become ``_``. A
    name that Windows keeps for a device gets one too.

    Examples
    --------
    >>> safe_file_name("pump A/3"), safe_file_name("a:b"), safe_file_name("con"), safe_file_name("..")
    ('pump_A_3', 'a_b', 'con_', '_')
    """
    name = re.sub(r"[^\w.+-]", "_", text)[:_LONGEST_NAME].strip(".")
    return _DEVICE.sub(r"\g<0>_", name) or "_"


def resume_folder(folder: Path, manifest: str, settings: Mapping[str, Any]) -> None:
    """Take up a folder that was filled piece by piece under equal settings, or start one.

    Parameters
    ----------
    folder : new or empty folder, or one with such a manifest.
    manifest : name of the file in it that holds `settings` and the version of swashtwin.
    settings : whatever the pieces depend on, as JSON can hold it.

    Raises
    ------
    InputError
        The folder holds something else, or pieces of other settings or of another version.
    ArtifactError
        The manifest is damaged.
    """
    settings = json.loads(json.dumps({"version": VERSION, **settings}))
    path = folder / manifest
    if not path.is_file():
        if folder.exists() and not (
            folder.is_dir() and all(_NAME.match(file.name) for file in folder.iterdir())
        ):
            raise InputError(
                f"{folder} is no folder of such recordings, and not empty; choose a new folder."
            )
        write_text(path, json.dumps(settings, indent=1))
        return
    try:
        saved = json.loads(read_text(path))
    except ValueError as cause:
        raise ArtifactError(f"{path} is damaged ({cause}); choose a new folder.") from cause
    if difference := first_difference(saved, settings):
        raise InputError(
            f"{folder} was made with other settings: {difference}. Choose a new folder, or remove it."
        )


def first_difference(before: Any, now: Any, name: str = "") -> str:
    """First entry in which two tables differ, with both values, in words; empty where there is
    none.
    """
    if isinstance(before, Mapping) and isinstance(now, Mapping):
        differences = (
            first_difference(before.get(key), now.get(key), f"{name}.{key}" if name else key)
            for key in sorted({*before, *now})
        )
        return next(filter(None, differences), "")
    return (
        "" if before == now else f"{name} was {json.dumps(before)[:60]}, now {json.dumps(now)[:60]}"
    )


def require_disk_space(folder: Path, count: int, bytes_each: int) -> None:
    """Refuse `count` files of `bytes_each` for which the disk of an existing `folder` has too
    little space.

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
