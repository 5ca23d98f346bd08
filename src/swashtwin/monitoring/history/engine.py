"""Connections to the database, their transactions, and one error for all that may befall them."""

import json
import math
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from sqlalchemy import URL, Connection, Engine, create_engine, event
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError, DatabaseError, DataError, IntegrityError, InterfaceError, ProgrammingError
from sqlalchemy.exc import NotSupportedError as UnsupportedError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError

from swashtwin.foundation import InputError, MissingExtraError, MissingFileError, SwashTwinError

FILE = "history.sqlite"
"""Name of the SQLite database in the watch's folder."""

_WAIT = 30
"""Seconds that a transaction waits for another one."""

_MISTAKES = (DataError, IntegrityError, ProgrammingError, UnsupportedError)
"""Errors of a program; every other error of a database may be gone at the next attempt."""


class HistoryError(SwashTwinError):
    """The database of the history cannot be reached, is full, locked or damaged; what was begun was not done."""


def open_engine(url: str, folder: Path, *, is_new: bool = True) -> Engine:
    """Engine of the database at `url`, or of the SQLite file in `folder` where the URL is empty.

    Raises
    ------
    MissingFileError
        The SQLite file may not be new, and is not there.
    InputError
        The URL is none of SQLite or PostgreSQL. The message does not show it: it may hold a password.
    MissingExtraError
        The driver of PostgreSQL is not installed.
    """
    try:
        address = make_url(url) if url else URL.create("sqlite", database=str(folder / FILE))
    except ArgumentError as cause:
        raise InputError("history is no URL; write postgresql://user@host/database.") from cause
    if address.get_backend_name() == "sqlite":
        return _sqlite_engine(address, is_new)
    if address.get_backend_name() not in ("postgresql", "postgres"):
        raise InputError(
            f"history begins with {address.drivername}://; the history is kept in postgresql:// or sqlite://."
        )
    try:
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
    except ImportError as cause:
        raise MissingExtraError(
            'PostgreSQL needs psycopg, which is not installed: pip install "swashtwin[postgresql]".'
        ) from cause


def _sqlite_engine(address: URL, is_new: bool) -> Engine:
    file = Path(address.database or "")
    if not is_new and not file.is_file():
        raise MissingFileError(f"{file} does not exist; a watch makes it.")
    file.parent.mkdir(parents=True, exist_ok=True)
    engine = create_engine(address, json_serializer=json_text, connect_args={"timeout": _WAIT})

    @event.listens_for(engine, "connect")
    def prepare(connection: sqlite3.Connection, _: object) -> None:
        connection.isolation_level = None  # transactions begin where `begin` below says, not where the driver guesses
        for pragma in ("journal_mode = WAL", "synchronous = FULL", "foreign_keys = ON"):
            connection.execute(f"PRAGMA {pragma}")

    @event.listens_for(engine, "begin")
    def begin(connection: Connection) -> None:
        is_write = connection.get_execution_options().get("is_write", False)
        connection.exec_driver_sql("BEGIN IMMEDIATE" if is_write else "BEGIN")

    return engine


@contextmanager
def read_transaction(engine: Engine) -> Iterator[Connection]:
    """Connection within a transaction that only reads.

    Raises
    ------
    HistoryError
        The database cannot be read.
    """
    with _one_error(), engine.connect() as connection:
        yield connection


@contextmanager
def write_transaction(engine: Engine) -> Iterator[Connection]:
    """Connection within a transaction that is committed at the end of the block, or undone by an error.

    Raises
    ------
    HistoryError
        The database cannot be written.
    """
    with _one_error(), engine.connect().execution_options(is_write=True) as connection, connection.begin():
        yield connection


@contextmanager
def _one_error() -> Iterator[None]:
    try:
        yield
    except _MISTAKES:
        raise
    except (DatabaseError, InterfaceError, PoolTimeoutError) as cause:
        reason = " ".join(str(getattr(cause, "orig", None) or cause).split())
        raise HistoryError(f"the history cannot be used: {reason}") from cause


def json_text(value: Any) -> str:
    """`value` as JSON: arrays as lists, numbers that are not finite as null.

    Examples
    --------
    >>> json_text({"a": np.arange(2), "b": math.nan})
    '{"a": [0, 1], "b": null}'
    """
    try:
        return json.dumps(value, allow_nan=False, ensure_ascii=False)
    except (TypeError, ValueError):
        return json.dumps(_plain(value), allow_nan=False, ensure_ascii=False)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        return _plain(value.tolist())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
