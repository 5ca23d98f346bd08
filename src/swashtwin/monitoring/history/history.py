"""The history of watched machines as a whole, and its messages that wait."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

from sqlalchemy import delete, func, or_, select, update

from swashtwin.monitoring.config.settings import Retention
from swashtwin.monitoring.history.database import Database, lock_machine
from swashtwin.monitoring.history.export import export_history
from swashtwin.monitoring.history.reading import Reads
from swashtwin.monitoring.history.tables import Message, Rejection
from swashtwin.monitoring.history.transaction import MachineTransaction
from swashtwin.monitoring.history.waveforms import Waveforms

_REJECTIONS = 10_000
"""Rejections that are kept."""
_LEASE = timedelta(seconds=60)
"""Time that sending some messages may take; a sender that says nothing within it is taken for dead."""
_LONGEST = timedelta(hours=1)
"""More than any wait of a message: a due time further ahead was set before the clock was set back."""
_SENT = 10_000
"""Numbers of messages for which sent ones are kept."""


class Outbox:
    """Messages of all machines, handed out to any number of senders.

    Every method raises `HistoryError` where the database cannot be used.
    """

    def __init__(self, database: Database) -> None:
        self._database = database

    def claim(self, channels: Sequence[str], limit: int = 20) -> Sequence[Message]:
        """The oldest messages for some channels that are due, none of which another sender has had for a minute."""
        if not self.waiting(channels):
            return ()  # without the lock that a write takes
        now = datetime.now(UTC)
        is_due = or_(Message.due <= now, Message.due > now + _LONGEST)
        query = select(Message).where(Message.sent.is_(None), Message.channel.in_(channels), is_due)
        with self._database.writing() as session:
            messages = session.scalars(query.order_by(Message.id).limit(limit).with_for_update(skip_locked=True)).all()
            for message in messages:
                message.due = now + _LEASE
                message.attempts += 1
        return messages

    def sent(self, message: int) -> None:
        """Note that a message was sent."""
        with self._database.writing() as session:
            session.execute(update(Message).where(Message.id == message).values(sent=datetime.now(UTC), error=None))
            session.execute(delete(Message).where(Message.sent.is_not(None), Message.id <= message - _SENT))

    def failed(self, message: int, error: str, again_in: float) -> None:
        """Note why a message was not sent, and in how many seconds it is tried again."""
        due = datetime.now(UTC) + timedelta(seconds=again_in)
        with self._database.writing() as session:
            session.execute(update(Message).where(Message.id == message).values(due=due, error=error))

    def waiting(self, channels: Sequence[str]) -> int:
        """How many messages for some channels are not sent."""
        query = select(func.count()).where(Message.sent.is_(None), Message.channel.in_(channels))
        with self._database.reading() as session:
            return session.scalars(query).one()


class History:
    """Database of verdicts, indicators and alarms, with waveforms beside it; used from any thread and process.

    Every method raises `HistoryError` where the database cannot be used.
    """

    def __init__(self, database: Database, folder: Path, retention: Retention) -> None:
        self._database = database
        self._retention = retention
        self.waveforms = Waveforms(folder / "waveforms", database)
        self.read = Reads(database, self.waveforms)
        self.outbox = Outbox(database)

    @classmethod
    def open(cls, url: str, folder: Path, retention: Retention | None = None, *, is_new: bool = True) -> "History":
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
            The URL is none, the database is another program's, of another version or not there though it must be, or
            a driver is missing.
        """
        return cls(Database(url, Path(folder), is_new=is_new), Path(folder), retention or Retention())

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

    def export(self, folder: Path, progress: Callable[[str], None] = lambda _: None) -> dict[str, int]:
        """Rows of each file that was written to `folder` (`export_history`)."""
        return export_history(self._database, self.read, folder, progress)

    def reject(self, rejection: Rejection) -> None:
        """File a delivery that became no recording; the same one again is counted."""
        key = [getattr(Rejection, name) == getattr(rejection, name) for name in ("content", "machine", "reason")]
        with self._database.writing() as session:
            lock_machine(session, "")  # so that the page's number grows
            stored = session.scalars(select(Rejection).where(*key)).first()
            if stored is not None:
                rejection.id, rejection.times = stored.id, stored.times + 1
            session.merge(rejection)
            session.flush()
            surplus = select(Rejection.id).order_by(Rejection.id.desc()).offset(_REJECTIONS).limit(1)
            session.execute(delete(Rejection).where(Rejection.id <= surplus.scalar_subquery()))
