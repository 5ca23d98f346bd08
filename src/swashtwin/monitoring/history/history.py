"""The history of watched machines as a whole, and its messages that wait."""

import csv
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from sqlalchemy import delete, func, or_, select, update
from sqlalchemy.orm import Session

from swashtwin.foundation import TEXT, InputError, atomic_write, safe_file_name, spreadsheet_text
from swashtwin.monitoring.config.settings import Retention, WatchConfig
from swashtwin.monitoring.history.database import Database, Waveforms, json_text, lock_machine
from swashtwin.monitoring.history.reading import HistoryReader, Names
from swashtwin.monitoring.history.schema import (
    Alarm,
    Event,
    Indicators,
    Judgment,
    Layout,
    Message,
    Rejection,
    Silence,
)
from swashtwin.monitoring.history.transaction import MachineTransaction

_REJECTIONS = 10_000
"""Rejections that are kept."""
_LEASE = timedelta(seconds=60)
"""Time that sending some messages may take; a sender that says nothing within it is taken for
dead.
"""
_LONGEST = timedelta(hours=1)
"""More than any wait of a message: a due time further ahead was set before the clock was set
back.
"""
_SENT = 10_000
"""Numbers of messages for which sent ones are kept."""


class Outbox:
    """Messages of all machines, handed out to any number of senders.

    Every method raises `HistoryError` where the database cannot be used.
    """

    def __init__(self, database: Database) -> None:
        self._database = database

    def claim(self, channels: Sequence[str], limit: int = 20) -> Sequence[Message]:
        """The oldest messages for some channels that are due, none of which another sender has had
        for a minute.
        """
        if not self.waiting(channels):
            return ()  # without the lock that a write takes
        now = datetime.now(UTC)
        is_due = or_(Message.due <= now, Message.due > now + _LONGEST)
        query = select(Message).where(Message.sent.is_(None), Message.channel.in_(channels), is_due)
        with self._database.writing() as session:
            messages = session.scalars(
                query.order_by(Message.id).limit(limit).with_for_update(skip_locked=True)
            ).all()
            for message in messages:
                message.due = now + _LEASE
                message.attempts += 1
        return messages

    def mark_sent(self, message: int) -> None:
        """Note that a message was sent."""
        with self._database.writing() as session:
            session.execute(
                update(Message)
                .where(Message.id == message)
                .values(sent=datetime.now(UTC), error=None)
            )
            session.execute(
                delete(Message).where(Message.sent.is_not(None), Message.id <= message - _SENT)
            )

    def mark_failed(self, message: int, error: str, again_in: float) -> None:
        """Note why a message was not sent, and in how many seconds it is tried again."""
        due = datetime.now(UTC) + timedelta(seconds=again_in)
        with self._database.writing() as session:
            session.execute(
                update(Message).where(Message.id == message).values(due=due, error=error)
            )

    def waiting(self, channels: Sequence[str]) -> int:
        """How many messages for some channels are not sent."""
        query = select(func.count()).where(Message.sent.is_(None), Message.channel.in_(channels))
        with self._database.reading() as session:
            return session.scalars(query).one()


class History:
    """Database of verdicts, indicators and alarms, with waveforms beside it; used from any thread
    and process.

    Every method raises `HistoryError` where the database cannot be used.
    """

    def __init__(self, database: Database, folder: Path, retention: Retention) -> None:
        self._database = database
        self._retention = retention
        self.waveforms = Waveforms(folder / "waveforms", database)
        self.reader = HistoryReader(database, self.waveforms)
        self.outbox = Outbox(database)

    @classmethod
    def open(
        cls, url: str, folder: Path, retention: Retention | None = None, *, is_new: bool = True
    ) -> "History":
        """History of a database and a folder, whose tables are made where they are not there.

        Parameters
        ----------
        url : ``postgresql://user@host/database``; empty for SQLite in `folder`.
        folder : folder of the waveforms.
        is_new : whether the tables may be made.
        retention : which waveforms stay; by default as in a configuration that does not say.

        Raises
        ------
        HistoryError
            The database cannot be used now.
        InputError, DataError, MissingExtraError
            The URL is none, the database is another program's, of another version or not there
            though it must be, or a driver is missing.
        """
        return cls(
            Database(url, Path(folder), is_new=is_new), Path(folder), retention or Retention()
        )

    def close(self) -> None:
        """Close all connections."""
        self._database.close()

    @contextmanager
    def machine(self, name: str) -> Iterator[MachineTransaction]:
        """Transaction that locks a machine; committed at the end of the block, undone by any error.

        SQLite has one writer at a time, so slow work is done before the block.
        """
        with self._database.writing() as session:
            transaction = MachineTransaction(session, name, self._retention)
            yield transaction
        self.waveforms.remove(transaction.dropped)

    def export(
        self, folder: Path, progress: Callable[[str], None] = lambda _: None
    ) -> dict[str, int]:
        """Rows of each file that was written to `folder`: one by table, and ``indicators/MACHINE``
        by machine.

        Times are UTC. A file is whole or not there. No text is a formula for a spreadsheet.

        Parameters
        ----------
        progress : called with the name of each file before it is written.
        """
        counts: dict[str, int] = {}

        def save(name: str, header: Sequence[str], lines: Iterable[Sequence[Any]]) -> None:
            progress(name)
            counts[name] = -1  # the header is no row
            with (
                atomic_write(folder / f"{name}.csv") as temporary,
                temporary.open("w", **TEXT) as file,
            ):
                writer = csv.writer(file, lineterminator="\n")
                for line in chain([header], lines):
                    writer.writerow([_cell(value) for value in line])
                    counts[name] += 1

        with self._database.reading() as session:
            for kind in _TABLES:
                columns = [
                    column for column in kind.__table__.columns if column.name not in _INTERNAL
                ]
                rows = session.execute(
                    select(*columns).order_by(kind.id).execution_options(yield_per=1000)
                )
                save(kind.__tablename__, [column.name for column in columns], rows)
            for machine in self.reader.machines():
                names = self.reader.indicator_names(machine.name)
                header = [
                    "recording",
                    "time",
                    "point",
                    *(f"{channel} {name}" for channel, name in names),
                ]
                save(
                    f"indicators/{safe_file_name(machine.name)}",
                    header,
                    _indicators(session, machine.name, names),
                )
        return counts

    def reject(self, rejection: Rejection) -> None:
        """File a delivery that became no recording; the same one again is counted."""
        key = [
            getattr(Rejection, name) == getattr(rejection, name)
            for name in ("content", "machine", "reason")
        ]
        with self._database.writing() as session:
            lock_machine(session, "")  # so that the page's number grows
            stored = session.scalars(select(Rejection).where(*key)).first()
            if stored is not None:
                rejection.id, rejection.times = stored.id, stored.times + 1
            session.merge(rejection)
            session.flush()
            surplus = (
                select(Rejection.id).order_by(Rejection.id.desc()).offset(_REJECTIONS).limit(1)
            )
            session.execute(delete(Rejection).where(Rejection.id <= surplus.scalar_subquery()))


_TABLES = (Judgment, Alarm, Silence, Event, Rejection, Message)
"""Tables that are exported column by column."""
_INTERNAL = ("retention", "due")
"""Columns that say nothing to others."""


def _indicators(session: Session, machine: str, names: Names) -> Iterator[Sequence[Any]]:
    columns = {name: position for position, name in enumerate(names)}
    layouts = {
        layout.id: [columns[channel, name] for channel, name in layout.names]
        for layout in session.scalars(select(Layout).where(Layout.machine == machine))
    }
    query = (
        select(Judgment.id, Judgment.time, Judgment.point, Indicators.layout, Indicators.values)
        .join(Indicators, Indicators.recording == Judgment.id)
        .where(Judgment.machine == machine)
        .order_by(Judgment.time, Judgment.id)
        .execution_options(yield_per=1000)
    )
    for number, time, point, layout, packed in session.execute(query):
        values: list[float | None] = [None] * len(names)
        for position, value in zip(
            layouts[layout], np.frombuffer(packed, "<f4").tolist(), strict=True
        ):
            values[position] = value
        yield (number, time, point, *values)


def _cell(value: Any) -> Any:
    if isinstance(value, datetime):
        return value.isoformat().replace("+00:00", "Z")
    text = json_text(value) if isinstance(value, (dict, list)) else value
    return spreadsheet_text(text) if isinstance(text, str) else text


def record_event(
    config: WatchConfig,
    history: History,
    machine: str,
    *,
    who: str,
    note: str,
    found: str = "",
    maintenance: bool,
) -> int:
    """Number of the event. After maintenance all baselines of the machine are learned anew, and its
    alarms are closed.

    Parameters
    ----------
    found : what was wrong with the machine; kept beside the suspect of its newest alarm.

    Raises
    ------
    InputError
        The configuration has no such machine, or something was found where there was no alarm.
    """
    if config.machine(machine) is None:
        raise InputError(
            f"{config.path} has no machine {machine!r}; there are {config.machine_names}."
        )
    with history.machine(machine) as transaction:
        if found:
            transaction.record_finding(found, who)
            note = f"found: {found}" + (f"; {note}" if note else "")
        number = transaction.add_event("maintenance" if maintenance else "note", who, note)
        if maintenance:
            transaction.forget_operating_points()
            for alarm in transaction.alarms():
                if alarm.state == "open":
                    transaction.acknowledge(alarm.id, who, note)
                transaction.clear_alarm(alarm.id, datetime.now(UTC))
    return number
