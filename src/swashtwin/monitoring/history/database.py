"""Where the history is kept: its database, with one error for all that may befall it, and the
waveforms beside it.
"""

import errno
import os
import sqlite3
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Any

import msgspec
from sqlalchemy import URL, Connection, Engine, create_engine, event, exc, inspect, select, text
from sqlalchemy.engine import make_url
from sqlalchemy.orm import Session

from swashtwin.foundation import (
    DataError,
    InputError,
    MissingFileError,
    SwashTwinError,
    require_modules,
    safe_file_name,
)
from swashtwin.monitoring.history.schema import Judgment, Machine, Row, Version
from swashtwin.recordings import Recording, load_recordings, write_store

FILE = "history.sqlite"
"""Name of the SQLite database in the watch's folder."""
VERSION = 1
"""Version of the tables."""
_WAIT = 30
"""Seconds that a transaction waits for another one."""
_LOCK = 0x73776173
"""Number under which PostgreSQL lets one process at a time make the tables."""
_MISTAKES = (exc.DataError, exc.IntegrityError, exc.ProgrammingError, exc.NotSupportedError)
"""Errors of a program; every other error of a database may be gone at the next attempt."""


class HistoryError(SwashTwinError):
    """The database of the history cannot be reached, is full, locked or damaged; what was begun was
    not done.
    """


class Database:
    """The tables in SQLite or PostgreSQL, used from any thread; what befalls them is a
    `HistoryError`.
    """

    def __init__(self, url: str, folder: Path, *, is_new: bool = True) -> None:
        """Open the database at `url`, or the SQLite file in `folder` where it is empty, and raise
        as `History.open`.
        """
        self._engine = _open_engine(url, folder, is_new=is_new)
        self._writer = self._engine.execution_options(is_write=True)
        try:
            self._prepare(is_new)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close all connections."""
        self._engine.dispose()

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """Session whose transaction only reads."""
        with _one_error(), Session(self._engine, autoflush=False) as session:
            yield session

    @contextmanager
    def writing(self) -> Iterator[Session]:
        """Session whose transaction is committed at the end of the block, or undone by an error."""
        with (
            _one_error(),
            Session(self._writer, expire_on_commit=False) as session,
            session.begin(),
        ):
            yield session

    def _prepare(self, is_new: bool) -> None:
        with self.writing() as session:
            connection = session.connection()
            if self._engine.dialect.name == "postgresql":
                session.execute(text("SELECT pg_advisory_xact_lock(:lock)"), {"lock": _LOCK})
            present = set(inspect(connection).get_table_names())
            if Version.__tablename__ in present:
                version = session.scalars(select(Version.version)).one()
                if version != VERSION:
                    raise DataError(
                        f"the history is of version {version}, this swashtwin reads version {VERSION}; use the "
                        "swashtwin that made it, or give the watch a new folder."
                    )
                return
            if not is_new:
                raise DataError("the database has no history yet; a watch makes it.")
            if others := present & set(Row.metadata.tables):
                raise DataError(
                    f"the database has tables of another program ({', '.join(sorted(others))}); "
                    "give the history a database of its own."
                )
            Row.metadata.create_all(connection)
            session.add_all([Version(version=VERSION), Machine(name="", sequence=0)])


def lock_machine(session: Session, name: str) -> None:
    """Lock a machine until the transaction ends, and file it if it is new."""
    lock = text("UPDATE machines SET sequence = sequence + 1 WHERE name = :name RETURNING name")
    if session.execute(lock, {"name": name}).first() is None:
        new = text("INSERT INTO machines (name, sequence) VALUES (:name, 0) ON CONFLICT DO NOTHING")
        session.execute(new, {"name": name})
        session.execute(lock, {"name": name})


def _open_engine(url: str, folder: Path, *, is_new: bool) -> Engine:
    try:
        address = make_url(url) if url else URL.create("sqlite", database=str(folder / FILE))
    except exc.ArgumentError as cause:
        raise InputError("history is no URL; write postgresql://user@host/database.") from cause
    if address.get_backend_name() == "sqlite":
        return _sqlite_engine(address, is_new)
    if address.get_backend_name() not in ("postgresql", "postgres"):
        raise InputError(
            f"history begins with {address.drivername}://; the history is kept in postgresql:// or sqlite://."
        )
    require_modules("psycopg", extra="postgresql", need="PostgreSQL")
    return create_engine(
        address.set(drivername="postgresql+psycopg"),
        json_serializer=json_text,
        pool_size=8,
        pool_timeout=_WAIT,
        pool_pre_ping=True,
        connect_args={
            "connect_timeout": 5,
            "keepalives_idle": _WAIT,
            "tcp_user_timeout": 1000 * _WAIT,
            "application_name": "swashtwin",
            "options": f"-c timezone=UTC -c lock_timeout={_WAIT}s -c idle_in_transaction_session_timeout=300s",
        },
    )


def _sqlite_engine(address: URL, is_new: bool) -> Engine:
    file = Path(address.database or "")
    if not is_new and not file.is_file():
        raise MissingFileError(f"{file} does not exist; a watch makes it.")
    file.parent.mkdir(parents=True, exist_ok=True)
    engine = create_engine(address, json_serializer=json_text, connect_args={"timeout": _WAIT})

    @event.listens_for(engine, "connect")
    def prepare(connection: sqlite3.Connection, _: object) -> None:
        connection.isolation_level = (
            None  # transactions begin where `begin` below says, not where the driver guesses
        )
        for pragma in ("journal_mode = WAL", "synchronous = FULL", "foreign_keys = ON"):
            connection.execute(f"PRAGMA {pragma}")

    @event.listens_for(engine, "begin")
    def begin(connection: Connection) -> None:
        is_write = connection.get_execution_options().get("is_write", False)
        connection.exec_driver_sql("BEGIN IMMEDIATE" if is_write else "BEGIN")

    return engine


@contextmanager
def _one_error() -> Iterator[None]:
    try:
        yield
    except _MISTAKES:
        raise
    except (exc.DatabaseError, exc.InterfaceError, exc.TimeoutError) as cause:
        reason = " ".join(str(getattr(cause, "orig", None) or cause).split())
        raise HistoryError(f"the history cannot be used: {reason}") from cause


def json_text(value: Any) -> str:
    """`value` as JSON: arrays as lists, numbers that are not finite as null.

    Examples
    --------
    >>> json_text({"a": (0, 1), "b": float("nan")})
    '{"a":[0,1],"b":null}'
    """
    return msgspec.json.encode(value, enc_hook=lambda array: array.tolist()).decode()


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
        """Path below the folder, after the samples are on the disk for good; a file of the same
        content is replaced.

        The file has no meaning before `MachineTransaction.add_recording` takes its path; `sweep`
        removes it if that never happens.

        Raises
        ------
        OSError
            The disk is full.
        """
        moment = moment.astimezone(UTC)
        name = f"{moment:%Y%m%dT%H%M%S}_{safe_file_name(content)[:16]}.h5"
        relative = f"{safe_file_name(machine)}/{moment:%Y-%m}/{name}"
        path = self.folder / relative
        while True:
            try:
                write_store([recording], path)
            except InputError as cause:  # too little space, which a later attempt may have
                raise OSError(errno.ENOSPC, str(cause)) from cause
            with suppress(
                FileNotFoundError
            ):  # another watch had filed the same recording, and has just removed it
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
        """How many files were removed because no recording has them; those of the last hour
        stay.
        """
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
