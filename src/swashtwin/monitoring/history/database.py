"""The database of the history, with one error for all failures that may be temporary."""

import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager
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
)
from swashtwin.monitoring.history.schema import Machine, Row, Version

SQLITE_FILE = "history.sqlite"
"""Name of the SQLite database in the watch's folder."""
SCHEMA_VERSION = 3
"""Version of the tables."""
EXTENDED_VERSION = 2
"""Version that lacks nothing but tables which can be added."""
LOCK_TIMEOUT_S = 30
"""Time that a transaction waits for another one, and for a connection."""
CONNECT_TIMEOUT_S = 5
"""Time for a connection to PostgreSQL."""
IDLE_TIMEOUT_S = 300
"""Time after which PostgreSQL ends a transaction in which nothing happens: the watch that began it
was cut off, and its lock would keep out all others.
"""
N_CONNECTIONS = 8
"""Connections to PostgreSQL: threads of the watch, and requests to the page."""

# Interval at which a lock that SQLite does not wait for is tried again.
_LOCK_POLL_S = 0.05

# Number of the lock under which one process at a time creates the tables in PostgreSQL.
_SCHEMA_LOCK = 0x73776173

# Errors of a program; every other error of a database may be gone at the next attempt.
_PROGRAM_ERRORS = (
    exc.DataError,
    exc.IntegrityError,
    exc.ProgrammingError,
    exc.NotSupportedError,
)


class HistoryError(SwashTwinError):
    """The database of the history cannot be reached, or is full, locked or damaged.

    The transaction was undone.
    """


class Database:
    """The tables in SQLite or PostgreSQL, used from any thread.

    Its failures are raised as `HistoryError`.
    """

    def __init__(self, url: str, folder: Path, *, is_new: bool = True) -> None:
        """Open the database at `url`, or the SQLite file in `folder` if `url` is empty.

        The errors are those of `History.open`.
        """
        self._engine = _open_engine(url, folder, is_new=is_new)
        self._writer = self._engine.execution_options(is_write=True)
        try:
            self._prepare(is_new)
        except DataError as cause:
            self.close()
            raise cause.with_context(f"{_name_database(self._engine.url)}: ") from cause
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close all connections."""
        self._engine.dispose()

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """Yield a session whose transaction only reads."""
        with _history_errors(), Session(self._engine, autoflush=False) as session:
            yield session

    @contextmanager
    def writing(self) -> Iterator[Session]:
        """Yield a session whose transaction is committed at the end, or undone by an error."""
        with (
            _history_errors(),
            # Rows are read after the commit, when they could not be loaded again.
            Session(self._writer, expire_on_commit=False) as session,
            session.begin(),
        ):
            yield session

    def _prepare(self, is_new: bool) -> None:
        """Create the tables, or check those that exist."""
        with self.writing() as session:
            connection = session.connection()
            # SQLite has locked the whole database already.
            if self._engine.dialect.name == "postgresql":
                lock = text("SELECT pg_advisory_xact_lock(:lock)")
                session.execute(lock, {"lock": _SCHEMA_LOCK})

            present_tables = set(inspect(connection).get_table_names())
            if Version.__tablename__ in present_tables:
                _require_columns(connection, (Version.__tablename__,))
                version = session.scalars(select(Version)).one()
                if version.version == EXTENDED_VERSION:
                    Row.metadata.create_all(connection)
                    version.version = SCHEMA_VERSION
                    session.flush()
                _require_version(version.version)
                _require_columns(connection, tuple(Row.metadata.tables))
                return

            if not is_new:
                raise DataError("the database has no history yet; the watch creates it.")
            foreign_tables = present_tables & set(Row.metadata.tables)
            if foreign_tables:
                raise DataError(
                    "the database has tables of another program "
                    f"({', '.join(sorted(foreign_tables))}); use a separate database for the "
                    "history."
                )

            Row.metadata.create_all(connection)
            # The machine without a name counts rejections of unknown machines.
            session.add_all([Version(version=SCHEMA_VERSION), Machine(name="", sequence=0)])


def _require_version(version: int) -> None:
    if version != SCHEMA_VERSION:
        raise DataError(
            f"the history has version {version}, but this swashtwin reads version "
            f"{SCHEMA_VERSION}. Use the swashtwin that created it, or a new folder for the watch."
        )


def _require_columns(connection: Connection, tables: tuple[str, ...]) -> None:
    """Require the tables of this swashtwin: a version number alone does not prove them."""
    inspector = inspect(connection)
    present_tables = set(inspector.get_table_names())
    for name in tables:
        columns = set()
        if name in present_tables:
            columns = {column["name"] for column in inspector.get_columns(name)}
        missing = [
            column.name
            for column in Row.metadata.tables[name].columns
            if column.name not in columns
        ]
        if missing:
            raise DataError(
                f"the table {name} of the history has no column {missing[0]}; another version "
                "created it. Use the swashtwin that created it, or a new folder for the watch."
            )


def lock_machine(session: Session, name: str) -> None:
    """Lock a machine until the transaction ends, and add it if it is new."""
    lock = text("UPDATE machines SET sequence = sequence + 1 WHERE name = :name RETURNING name")
    if session.execute(lock, {"name": name}).first() is not None:
        return

    # Another process may add the machine at the same moment.
    insert = text("INSERT INTO machines (name, sequence) VALUES (:name, 0) ON CONFLICT DO NOTHING")
    session.execute(insert, {"name": name})
    session.execute(lock, {"name": name})


def _name_database(address: URL) -> str:
    """Return the file of SQLite, or the URL of another database without its password."""
    if address.get_backend_name() == "sqlite":
        return str(address.database)
    return address.render_as_string(hide_password=True)


def _open_engine(url: str, folder: Path, *, is_new: bool) -> Engine:
    try:
        address = URL.create("sqlite", database=str(folder / SQLITE_FILE))
        if url:
            address = make_url(url)
    except exc.ArgumentError as cause:
        raise InputError(
            "history is not a valid URL; write postgresql://user@host/database."
        ) from cause

    backend = address.get_backend_name()
    if backend == "sqlite":
        return _sqlite_engine(address, is_new)
    if backend not in ("postgresql", "postgres"):
        raise InputError(
            f"history begins with {address.drivername}://; it must begin with postgresql:// or "
            "sqlite://."
        )
    return _postgresql_engine(address)


def _postgresql_engine(address: URL) -> Engine:
    require_modules("psycopg", extra="postgresql", need="PostgreSQL")

    server_options = {
        "timezone": "UTC",
        "lock_timeout": f"{LOCK_TIMEOUT_S}s",
        "idle_in_transaction_session_timeout": f"{IDLE_TIMEOUT_S}s",
    }
    return create_engine(
        address.set(drivername="postgresql+psycopg"),
        json_serializer=json_text,
        pool_size=N_CONNECTIONS,
        pool_timeout=LOCK_TIMEOUT_S,
        # A restart of the database ends connections without notice.
        pool_pre_ping=True,
        connect_args={
            "connect_timeout": CONNECT_TIMEOUT_S,
            "keepalives_idle": LOCK_TIMEOUT_S,
            # Without it, a connection to an unplugged server hangs for a quarter of an hour.
            "tcp_user_timeout": 1000 * LOCK_TIMEOUT_S,
            "application_name": "swashtwin",
            "options": " ".join(f"-c {name}={value}" for name, value in server_options.items()),
        },
    )


def _sqlite_engine(address: URL, is_new: bool) -> Engine:
    file = Path(address.database or "")
    if not is_new and not file.is_file():
        raise MissingFileError(f"{file} does not exist; the watch creates it.")
    file.parent.mkdir(parents=True, exist_ok=True)

    engine = create_engine(
        address, json_serializer=json_text, connect_args={"timeout": LOCK_TIMEOUT_S}
    )

    @event.listens_for(engine, "connect")
    def prepare(connection: sqlite3.Connection, _: object) -> None:
        # Transactions begin in `begin` below, not when the driver guesses.
        connection.isolation_level = None
        _use_write_ahead_log(connection)
        # FULL: a commit survives a power cut.
        for pragma in ("synchronous = FULL", "foreign_keys = ON"):
            connection.execute(f"PRAGMA {pragma}")

    @event.listens_for(engine, "begin")
    def begin(connection: Connection) -> None:
        # A writer locks at once: a lock that is taken later may fail when another has written.
        command = "BEGIN"
        if connection.get_execution_options().get("is_write", False):
            command = "BEGIN IMMEDIATE"
        connection.exec_driver_sql(command)

    return engine


def _use_write_ahead_log(connection: sqlite3.Connection) -> None:
    """Let the page read while the watch writes; the file remembers that.

    If another process has just begun to write to a new file, SQLite refuses the change at once,
    whatever the connection's timeout is.
    """
    deadline = time.monotonic() + LOCK_TIMEOUT_S
    while True:
        try:
            connection.execute("PRAGMA journal_mode = WAL")
            return
        except sqlite3.OperationalError as cause:
            is_locked = cause.sqlite_errorcode == sqlite3.SQLITE_BUSY
            if not is_locked or time.monotonic() > deadline:
                raise
        time.sleep(_LOCK_POLL_S)


@contextmanager
def _history_errors() -> Iterator[None]:
    """Raise failures of the database as `HistoryError`."""
    try:
        yield
    except _PROGRAM_ERRORS:
        raise
    except (exc.DatabaseError, exc.InterfaceError, exc.TimeoutError) as cause:
        reason = " ".join(str(getattr(cause, "orig", None) or cause).split())
        raise HistoryError(f"the history cannot be used: {reason}") from cause


def json_text(value: Any) -> str:
    """Return `value` as JSON: arrays as lists, numbers that are not finite as null.

    Examples
    --------
    >>> json_text({"a": (0, 1), "b": float("nan")})
    '{"a":[0,1],"b":null}'
    """
    return msgspec.json.encode(value, enc_hook=lambda array: array.tolist()).decode()
