"""Recordings that arrived and are not judged yet, on the disk: a kill or a power cut loses none."""

import hashlib
import logging
import os
import secrets
import shutil
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from errno import ENOSPC
from pathlib import Path

import msgspec

from swashtwin.foundation import InputError
from swashtwin.monitoring.sources.delivery import Delivery, safe_name
from swashtwin.recordings import suffix_of

LIMIT = 10_000
"""Recordings that may wait; sources then hold back what they have."""
_MOST_REJECTED, _MOST_REJECTED_BYTES = 1000, 1 << 30
"""Rejected files that are kept, and bytes of them."""
_CARD = ".json"
_log = logging.getLogger("swashtwin.watch")


@dataclass(frozen=True)
class SpoolFile:
    """One recording that waits."""

    key: str
    """Its name in the spool; keys sort by arrival."""
    path: Path
    """The file."""
    delivery: Delivery
    """What is known of it."""


class Spool:
    """Recordings that wait in a folder. Each is a file and, written after it, a card that makes it
    valid.

    Any thread may add; one thread takes.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self._changed = threading.Condition()
        cards = sorted(
            path.stem for path in folder.glob(f"*{_CARD}") if not path.name.startswith(".")
        )
        self._keys = deque(cards)
        valid = set(cards)
        for path in folder.iterdir():
            if (
                path.is_file() and path.name.split(".")[0] not in valid
            ):  # a kill interrupted its arrival or its removal
                path.unlink()

    def __len__(self) -> int:
        return len(self._keys)

    def add(self, delivery: Delivery, content: bytes | Path) -> str:
        """SHA-256 of the content, hexadecimal, after it was written to the disk with its card.

        Parameters
        ----------
        content : bytes, or a file that is moved here.

        Raises
        ------
        OSError
            The disk or the spool is full, or cannot be written.
        """
        if len(self._keys) >= LIMIT:
            raise OSError(
                ENOSPC, f"{LIMIT} recordings wait to be judged; more are taken when there are fewer"
            )
        key = f"{time.time_ns():020d}-{secrets.token_hex(4)}"
        data = self._folder / f"{key}{_suffix(delivery)}"
        try:
            digest = _write(data, content)
            card = self._folder / f".{key}{_CARD}"
            _write(card, msgspec.json.encode(delivery))
            card.replace(self._folder / f"{key}{_CARD}")
        except BaseException:
            for path in (data, self._folder / f".{key}{_CARD}"):
                path.unlink(missing_ok=True)
            raise
        _sync(self._folder)
        with self._changed:
            self._keys.append(key)
            self._changed.notify_all()
        return digest

    def next(self, timeout: float) -> SpoolFile | None:
        """The recording that waits longest, or None where none came in `timeout` seconds; it stays
        until `remove`.

        One that cannot be read at the moment is tried again by the next call.
        """
        with self._changed:
            if not self._keys:
                self._changed.wait(timeout)
            if not self._keys:
                return None
            key = self._keys[0]
        card = self._folder / f"{key}{_CARD}"
        try:
            delivery = msgspec.json.decode(card.read_bytes(), type=Delivery)
        except (msgspec.DecodeError, FileNotFoundError):
            path = next((path for path in self._folder.glob(f"{key}.*") if path != card), card)
            return SpoolFile(
                key,
                path,
                Delivery("spool", path.name, datetime.now(UTC), problem="its card is damaged."),
            )
        except OSError as cause:
            _log.warning("%s cannot be read: %s", card, cause.strerror or cause)
            time.sleep(timeout)
            return None
        return SpoolFile(key, self._folder / f"{key}{_suffix(delivery)}", delivery)

    def remove(self, file: SpoolFile) -> None:
        """Forget a recording that was judged or filed; its file may have been moved."""
        (self._folder / f"{file.key}{_CARD}").unlink(missing_ok=True)
        file.path.unlink(missing_ok=True)
        with self._changed, suppress(ValueError):
            self._keys.remove(file.key)


class RejectedFiles:
    """Files that could not be judged, to be looked at and repaired; the oldest go when there are
    too many.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    def keep(self, file: SpoolFile) -> str | None:
        """Name of a copy of a file in the spool; None where there is no space for it."""
        path = self._folder / f"{file.key}-{safe_name(file.delivery.file)}"
        try:
            if not path.exists():
                try:
                    os.link(file.path, path)
                except OSError:  # a file system without links
                    shutil.copyfile(file.path, path)
        except OSError:
            return None
        size = 0
        for number, old in enumerate(
            sorted(self._folder.iterdir(), reverse=True), 1
        ):  # the newest first
            with suppress(OSError):
                size += old.stat().st_size
                if number > _MOST_REJECTED or size > _MOST_REJECTED_BYTES:
                    old.unlink()
        return path.name if path.exists() else None


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Hold a folder for one watch; the system releases it when the process ends, however it ends.

    Raises
    ------
    InputError
        Another watch holds it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "watch.lock"
    with path.open("a+", encoding="utf-8") as file:
        if not _is_locked(file.fileno()):
            raise InputError(
                f"{folder} is in use by another watch (see {path.name} there for its process); stop it, or give this "
                'one its own folder = "...".'
            )
        file.truncate(0)
        file.write(f"{os.getpid()}\n")
        file.flush()
        yield


@contextmanager
def lock_file(path: Path) -> Iterator[None]:
    """Hold a file so that others who lock it wait; it is made if it is not there."""
    with path.open("a+", encoding="utf-8") as file:
        while not _is_locked(file.fileno()):
            time.sleep(0.02)
        yield


def _is_locked(descriptor: int) -> bool:
    try:
        if os.name == "nt":
            import msvcrt

            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
        else:
            import fcntl

            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _suffix(delivery: Delivery) -> str:
    suffix = suffix_of(Path(safe_name(delivery.file)))
    return suffix if suffix != _CARD else f"{_CARD}.data"


def _write(path: Path, content: bytes | Path) -> str:
    """SHA-256 of the content, which is now at `path` and on the disk."""
    if isinstance(content, Path):
        with content.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
            os.fsync(file.fileno())
        shutil.move(content, path)
        return digest
    with path.open("xb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    return hashlib.sha256(content).hexdigest()


def _sync(folder: Path) -> None:
    """Let the names in a folder reach the disk, where the system can."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
