"""Files that are complete or absent, and the removal of what killed processes left.

A file is written under a hidden name in the folder of its target and then renamed to the target.
While it is written, a lock file of the same hidden name is held. The system releases the lock when
the process ends, however it ends. A hidden file whose lock is free therefore belongs to a killed
process, and the next process that writes into the folder removes it.
"""

import errno
import re
import secrets
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, Final

TEXT: Final[dict[str, Any]] = {"encoding": "utf-8", "errors": "backslashreplace", "newline": "\n"}
"""Arguments of `open` for writing text, the same on every system. File names that are not valid
Unicode are written with backslashes."""

NO_LOCKS_ERRNOS = frozenset(
    number
    for name in ("ENOLCK", "EOPNOTSUPP", "ENOTSUP", "ENOSYS", "EIO")
    if (number := getattr(errno, name, None)) is not None
)
"""Errors of a file system without locks, such as some network drives; a file is then written
without one, as it was asked to be."""

HIDDEN_PREFIX = ".swashtwin-"
"""Prefix of the name of a file that is being written."""
HIDDEN_NAME = re.compile(re.escape(HIDDEN_PREFIX) + r"[0-9a-f]{12}(?=\.)")
"""Stem of a file that is being written, and of its lock file."""

_IS_WINDOWS = sys.platform == "win32"

# Delays between attempts to replace a file, since a virus scanner or an indexer of Windows may hold
# the target for a moment.
_REPLACE_DELAYS_S = (0.05, 0.2, 0.5, 1.0)


@contextmanager
def hold_lock(lock_path: Path, *, poll_interval_s: float = 0.05) -> Iterator[None]:
    """Wait for a lock file and hold it; a file system without locks is used without."""
    from filelock import FileLock

    lock = FileLock(lock_path)
    try:
        lock.acquire(poll_interval=poll_interval_s)
    except OSError as cause:
        if cause.errno not in NO_LOCKS_ERRNOS:
            raise
    try:
        yield
    finally:
        lock.release()


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Yield a temporary path that replaces `path` if the block succeeds.

    If the block fails, or the process is killed, `path` is left as it was. The new file has the
    permissions that the user's umask gives.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    _remove_leftovers(path.parent.resolve())

    with _locked_name(path.parent) as name:
        temporary = path.parent / f"{name}.part{path.suffix}"
        try:
            yield temporary
            # Some libraries create files that only their owner can read.
            shutil.copymode(_lock_path(path.parent, name), temporary)
            _replace(temporary, path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise


def _lock_path(folder: Path, name: str) -> Path:
    return folder / f"{name}.lock"


@contextmanager
def _locked_name(folder: Path) -> Iterator[str]:
    """Yield an unused hidden name whose lock file this process holds."""
    from filelock import FileLock, Timeout  # 50 ms, which commands that write nothing save

    while True:
        name = f"{HIDDEN_PREFIX}{secrets.token_hex(6)}"
        lock_path = _lock_path(folder, name)
        lock = FileLock(lock_path, timeout=0)
        try:
            lock.acquire()
        except Timeout:
            continue
        except OSError as cause:
            if cause.errno not in NO_LOCKS_ERRNOS:
                raise
            # Leftovers of killed processes stay on such a file system: none looks free.
            lock_path.touch()

        try:
            # Another process may have removed the file as a leftover before it was locked.
            if lock_path.exists():
                yield name
                return
        finally:
            # Windows cannot remove an open file, so the lock is released first.
            lock.release()
            with suppress(PermissionError):
                lock_path.unlink(missing_ok=True)


@cache
def _remove_leftovers(folder: Path) -> None:
    """Remove what killed processes left in a folder; each process does so once for each folder."""
    files = list(folder.glob(f"{HIDDEN_PREFIX}*"))
    names = {match[0] for file in files if (match := HIDDEN_NAME.match(file.name))}
    if not names:
        return

    from filelock import FileLock

    for name in names:
        lock_path = _lock_path(folder, name)

        # A living process holds the lock (Timeout is an OSError), or the folder is read-only.
        with suppress(OSError), FileLock(lock_path, timeout=0):
            for leftover in folder.glob(f"{name}.*"):
                if leftover != lock_path:
                    leftover.unlink(missing_ok=True)
            if not _IS_WINDOWS:
                lock_path.unlink(missing_ok=True)

        if _IS_WINDOWS:  # which removes no open file, and no file that a living process holds
            with suppress(OSError):
                lock_path.unlink(missing_ok=True)


def _replace(temporary: Path, path: Path) -> None:
    for delay in _REPLACE_DELAYS_S:
        try:
            temporary.replace(path)
        except PermissionError:
            if not _IS_WINDOWS or path.is_dir():
                raise
            time.sleep(delay)
        else:
            return
    temporary.replace(path)


def write_text(path: Path, text: str) -> Path:
    """Write `text` to `path` as a complete file and return the path."""
    with atomic_write(path) as temporary:
        temporary.write_text(text, **TEXT)
    return Path(path)
