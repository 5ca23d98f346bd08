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

import filelock
import msgspec

from swashtwin.foundation import InputError, from_table
from swashtwin.monitoring.sources.delivery import Delivery, safe_name
from swashtwin.recordings import suffix_of

MAX_WAITING = 10_000
"""Recordings that may wait; when they are reached, the sources keep what they have."""
MAX_REJECTED_FILES = 1000
"""Rejected files that are kept."""
MAX_REJECTED_BYTES = 1 << 30
"""Bytes of rejected files that are kept."""
_CARD_SUFFIX = ".json"
_log = logging.getLogger("swashtwin.watch")


@dataclass(frozen=True)
class SpoolFile:
    """One recording that waits."""

    key: str
    """Its name in the spool; keys sort by arrival."""
    path: Path
    """The file as it was delivered."""
    delivery: Delivery
    """What is known of the file."""


class Spool:
    """Recordings that wait in a folder.

    Each is a file and, written after it, a card that makes it valid. Any thread may add, one thread
    takes.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self._changed = threading.Condition()

        cards = folder.glob(f"*{_CARD_SUFFIX}")
        keys = sorted(card.stem for card in cards if not card.name.startswith("."))
        self._keys = deque(keys)
        self._held_keys: list[str] = []
        """Recordings that cannot be judged yet; they are on the disk like all others."""
        self._remove_invalid_files(set(keys))

    def _remove_invalid_files(self, valid_keys: set[str]) -> None:
        """Remove files without a card: a kill interrupted their arrival or their removal."""
        for path in self._folder.iterdir():
            key = path.name.split(".")[0]
            if path.is_file() and key not in valid_keys:
                path.unlink()

    def __len__(self) -> int:
        return len(self._keys) + len(self._held_keys)

    @property
    def n_held(self) -> int:
        """Number of recordings that `hold` set aside."""
        return len(self._held_keys)

    def add(self, delivery: Delivery, content: bytes | Path) -> str:
        """Write a recording with its card to the disk, and return its SHA-256 (hexadecimal).

        Parameters
        ----------
        content : bytes, or a file that is moved here.

        Raises
        ------
        OSError
            The disk or the spool is full, or cannot be written.
        """
        if len(self) >= MAX_WAITING:
            raise OSError(
                ENOSPC,
                f"{MAX_WAITING} recordings wait to be judged, which is the maximum; "
                "more are taken when some of them have been judged",
            )

        key = f"{time.time_ns():020d}-{secrets.token_hex(4)}"
        data_path = self._folder / f"{key}{_data_suffix(delivery)}"
        temporary_card = self._folder / f".{key}{_CARD_SUFFIX}"
        try:
            digest = _write(data_path, content)
            _write(temporary_card, msgspec.json.encode(delivery))
            # The rename makes the recording valid; before it, a restart removes all of it.
            temporary_card.replace(self._folder / f"{key}{_CARD_SUFFIX}")
        except BaseException:
            data_path.unlink(missing_ok=True)
            temporary_card.unlink(missing_ok=True)
            raise
        _flush_folder(self._folder)

        with self._changed:
            self._keys.append(key)
            self._changed.notify_all()
        return digest

    def next(self, timeout: float) -> SpoolFile | None:
        """Return the recording that has waited longest; it stays until `remove`.

        One that cannot be read at the moment is tried again by the next call.

        Parameters
        ----------
        timeout : time [s] after which None is returned if no recording waits.
        """
        with self._changed:
            if not self._keys:
                self._changed.wait(timeout)
            if not self._keys:
                return None
            key = self._keys[0]

        card = self._folder / f"{key}{_CARD_SUFFIX}"
        try:
            table = msgspec.json.decode(card.read_bytes())
            delivery = from_table(table, Delivery, complete=True)
        except (msgspec.DecodeError, InputError, FileNotFoundError) as cause:
            return self._damaged_file(key, card, cause)
        except OSError as cause:
            _log.warning("%s cannot be read: %s", card, cause.strerror or cause)
            time.sleep(timeout)
            return None
        return SpoolFile(key, self._folder / f"{key}{_data_suffix(delivery)}", delivery)

    def _damaged_file(self, key: str, card: Path, cause: Exception) -> SpoolFile:
        """Return a recording whose card is damaged, to be rejected."""
        data_paths = [path for path in self._folder.glob(f"{key}.*") if path != card]
        path = next(iter(data_paths), card)
        problem = (
            "the card of the file is damaged, or another version of swashtwin wrote it "
            f"({str(cause)[:200].rstrip('.')}); deliver the file again."
        )
        delivery = Delivery("spool", path.name, datetime.now(UTC), problem=problem)
        return SpoolFile(key, path, delivery)

    def hold(self, file: SpoolFile) -> None:
        """Set a recording aside until `release`, so that those of other machines go on."""
        with self._changed, suppress(ValueError):
            self._keys.remove(file.key)
            self._held_keys.append(file.key)

    def release(self) -> None:
        """Let `next` return the recordings again that were set aside, before those that wait."""
        with self._changed:
            self._keys = deque(sorted([*self._held_keys, *self._keys]))
            self._held_keys.clear()
            self._changed.notify_all()

    def remove(self, file: SpoolFile) -> None:
        """Remove a recording that was judged or rejected; its file may have been moved."""
        # The card first: a file without a card is removed at the next start.
        (self._folder / f"{file.key}{_CARD_SUFFIX}").unlink(missing_ok=True)
        file.path.unlink(missing_ok=True)
        with self._changed, suppress(ValueError):
            self._keys.remove(file.key)


class RejectedFiles:
    """Files that could not be judged, kept to be repaired; the oldest are removed first."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    def keep(self, file: SpoolFile) -> str | None:
        """Copy a file of the spool, and return the copy's name; None if there is no space."""
        path = self._folder / f"{file.key}-{safe_name(file.delivery.file)}"
        try:
            if not path.exists():
                _link_or_copy(file.path, path)
        except OSError:
            return None

        self._remove_surplus()
        if not path.exists():
            return None
        return path.name

    def _remove_surplus(self) -> None:
        total_size = 0
        newest_first = sorted(self._folder.iterdir(), reverse=True)
        for count, path in enumerate(newest_first, 1):
            with suppress(OSError):
                total_size += path.stat().st_size
                if count > MAX_REJECTED_FILES or total_size > MAX_REJECTED_BYTES:
                    path.unlink()


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Hold a folder for one watch; the system releases it however the process ends.

    Raises
    ------
    InputError
        Another watch holds the folder.
    """
    folder.mkdir(parents=True, exist_ok=True)
    # Windows lets nobody write to a locked file, so the process is named in another one.
    process_file = folder / "watch.pid"
    try:
        lock = filelock.FileLock(folder / "watch.lock", timeout=0).acquire()
    except filelock.Timeout:
        raise InputError(
            f"{folder} is in use by another watch (its process number is in {process_file.name} "
            'there). Stop that watch, or set another folder = "..." in the configuration of this '
            "one."
        ) from None
    except OSError as cause:
        raise InputError(
            f"{folder} cannot be locked ({cause.strerror}). Set a folder on a local disk: "
            'folder = "..." in the configuration.'
        ) from cause

    with lock:
        process_file.write_text(f"{os.getpid()}\n", encoding="utf-8")
        yield


def _data_suffix(delivery: Delivery) -> str:
    suffix = suffix_of(Path(safe_name(delivery.file)))
    if suffix == _CARD_SUFFIX:
        # A recording in a JSON file must not be taken for a card.
        suffix += ".data"
    return suffix


def _write(path: Path, content: bytes | Path) -> str:
    """Write content to the disk for good, and return its SHA-256."""
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


def _flush_folder(folder: Path) -> None:
    """Let the names in a folder reach the disk, if the system can do that."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _link_or_copy(original: Path, copy: Path) -> None:
    try:
        os.link(original, copy)
    except OSError:  # a file system without links
        shutil.copyfile(original, copy)
