"""Files with the samples of recordings."""

import errno
import os
import time
from collections.abc import Iterable
from contextlib import suppress
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path

from sqlalchemy import select

from swashtwin.foundation import InputError, safe_file_name
from swashtwin.monitoring.history.database import Database
from swashtwin.monitoring.history.schema import Judgment
from swashtwin.recordings import Recording, load_recordings, write_store

MIN_ORPHAN_AGE_S = 3600
"""Age from which on a file without a row is removed: no transaction lasts so long."""
SWEEP_BATCH = 500
"""Files that are looked up at a time, so that no query gets too long for the database."""
CONTENT_NAME_LENGTH = 16
"""Hexadecimal digits of the content in a file's name."""


class Waveforms:
    """Files with the samples of recordings, by machine and month."""

    def __init__(self, folder: Path, database: Database) -> None:
        self.folder = folder
        self._database = database

    def write(self, machine: str, moment: datetime, content: str, recording: Recording) -> str:
        """Write samples to the disk for good, and return the path below the folder.

        A file with the same content is replaced. The file means nothing before
        `MachineTransaction.add_recording` takes its path; if that never happens, `sweep` removes
        it.

        Raises
        ------
        OSError
            The disk is full.
        """
        moment = moment.astimezone(UTC)
        content_name = safe_file_name(content)[:CONTENT_NAME_LENGTH]
        relative_path = (
            f"{safe_file_name(machine)}/{moment:%Y-%m}/{moment:%Y%m%dT%H%M%S}_{content_name}.h5"
        )
        path = self.folder / relative_path

        while True:
            try:
                write_store([recording], path)
            except InputError as cause:
                # There was too little space, which may differ at a later attempt.
                raise OSError(errno.ENOSPC, str(cause)) from cause
            # If the file is missing, another watch had filed the same recording, and has just
            # removed its file.
            with suppress(FileNotFoundError):
                _flush(path)
                break

        # Without this, a power cut may lose the name of a file whose content is safe.
        _flush(path.parent)
        return relative_path

    def read(self, relative_path: str | Path) -> Recording | None:
        """Return the recording at a path that `write` returned; None if the file is gone."""
        path = self.folder / relative_path
        if not path.is_file():
            return None
        return load_recordings(path)[0]

    def remove(self, relative_paths: Iterable[str]) -> None:
        """Remove files; one that cannot be removed now is left to `sweep`."""
        for relative_path in relative_paths:
            with suppress(OSError):
                (self.folder / relative_path).unlink(missing_ok=True)

    def sweep(self) -> int:
        """Remove old files that no recording has, and return their number."""
        max_time = time.time() - MIN_ORPHAN_AGE_S
        files = (path for path in self.folder.rglob("*.h5") if path.stat().st_mtime < max_time)
        count = 0

        while batch := list(islice(files, SWEEP_BATCH)):
            orphans = self._find_orphans(
                {path.relative_to(self.folder).as_posix() for path in batch}
            )
            self.remove(orphans)
            count += len(orphans)
        return count

    def _find_orphans(self, relative_paths: set[str]) -> set[str]:
        query = select(Judgment.waveform).where(Judgment.waveform.in_(sorted(relative_paths)))
        with self._database.reading() as session:
            return relative_paths - set(session.scalars(query))


def _flush(path: Path) -> None:
    """Let a file, or the names in a folder, reach the disk."""
    if os.name == "nt" and path.is_dir():
        return  # Windows opens no folder
    mode = os.O_RDWR
    if path.is_dir():
        mode = os.O_RDONLY  # the only mode in which a folder can be opened
    descriptor = os.open(path, mode)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
