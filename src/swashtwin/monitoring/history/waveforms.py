"""Waveforms beside the database: one HDF5 file for each recording that is kept."""

import errno
import os
import time
from collections.abc import Iterable
from contextlib import suppress
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path

from sqlalchemy import select

from swashtwin.foundation import InputError, file_name
from swashtwin.monitoring.history.database import Database
from swashtwin.monitoring.history.tables import Judgment
from swashtwin.recordings import Recording, load_recordings, write_store

_AGE = 3600
"""Seconds after which a file without a row belongs to no transaction that is still going on."""

_BATCH = 500
"""Files that are looked up at a time."""


class Waveforms:
    """Files of the samples of recordings, by machine and month."""

    def __init__(self, folder: Path, database: Database) -> None:
        self.folder = folder
        self._database = database

    def write(self, machine: str, moment: datetime, content: str, recording: Recording) -> str:
        """Path below the folder, after the samples are on the disk for good; a file of the same content is replaced.

        The file has no meaning before `MachineTransaction.add_recording` takes its path; `sweep` removes it if that
        never happens.

        Raises
        ------
        OSError
            The disk is full.
        """
        moment = moment.astimezone(UTC)
        name = f"{moment:%Y%m%dT%H%M%S}_{file_name(content)[:16]}.h5"
        relative = f"{file_name(machine)}/{moment:%Y-%m}/{name}"
        path = self.folder / relative
        while True:
            try:
                write_store([recording], path)
            except InputError as cause:  # too little space, which a later attempt may have
                raise OSError(errno.ENOSPC, str(cause)) from cause
            with suppress(FileNotFoundError):  # another watch had filed the same recording, and has just removed it
                _flush(path)
                break
        _flush(path.parent)
        return relative

    def read(self, relative: str | Path) -> Recording | None:
        """The recording of a path that `write` gave, or None where the file is gone."""
        path = self.folder / relative
        return load_recordings(path)[0] if path.is_file() else None

    def remove(self, paths: Iterable[str]) -> None:
        """Remove files; one that is gone, or that cannot be removed now, is left to `sweep`."""
        for relative in paths:
            with suppress(OSError):
                (self.folder / relative).unlink(missing_ok=True)

    def sweep(self) -> int:
        """How many files were removed because no recording has them; those of the last hour stay."""
        limit = time.time() - _AGE
        files = (path for path in self.folder.rglob("*.h5") if path.stat().st_mtime < limit)
        count = 0
        while batch := [path.relative_to(self.folder).as_posix() for path in islice(files, _BATCH)]:
            with self._database.reading() as session:
                orphans = set(batch) - set(
                    session.scalars(select(Judgment.waveform).where(Judgment.waveform.in_(batch)))
                )
            self.remove(orphans)
            count += len(orphans)
        return count


def _flush(path: Path) -> None:
    if os.name == "nt" and path.is_dir():
        return  # Windows opens no folder
    file = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(file)
    finally:
        os.close(file)
