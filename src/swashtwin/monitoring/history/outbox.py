"""Messages that wait in the database until a sender has sent them: each at least once."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

from sqlalchemy import delete, func, or_, select, update

from swashtwin.monitoring.history.database import Database
from swashtwin.monitoring.history.tables import Message

_LONGEST = 3600.0
"""Seconds after which a message is tried again at the latest."""
_SENT = 10_000
"""Numbers of messages for which sent ones are kept."""


class Outbox:
    """Messages of all machines, handed out to any number of senders."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def claim(self, channels: Sequence[str], limit: int = 20, lease: float = 60.0) -> Sequence[Message]:
        """The oldest messages for some channels that are due, none of which another sender has.

        A sender that says neither `sent` nor `failed` within the lease is taken for dead, and its messages are due
        again.

        Parameters
        ----------
        channels : names of the channels that the sender knows.
        limit : most messages.
        lease : time that sending may take [s].

        Raises
        ------
        HistoryError
            The database cannot be written.
        """
        if not self.waiting(channels):
            return ()  # without the lock that a write takes
        now = datetime.now(UTC)
        # A due time that lies further ahead than any wait was set before the clock was set back.
        is_due = or_(Message.due <= now, Message.due > now + timedelta(seconds=2 * _LONGEST))
        query = select(Message).where(Message.sent.is_(None), Message.channel.in_(channels), is_due)
        with self._database.writing() as session:
            messages = session.scalars(query.order_by(Message.id).limit(limit).with_for_update(skip_locked=True)).all()
            for message in messages:
                message.due = now + timedelta(seconds=min(lease, _LONGEST))
                message.attempts += 1
        return messages

    def sent(self, message: int) -> None:
        """Note that a message was sent."""
        with self._database.writing() as session:
            session.execute(update(Message).where(Message.id == message).values(sent=datetime.now(UTC), error=None))
            session.execute(delete(Message).where(Message.sent.is_not(None), Message.id <= message - _SENT))

    def failed(self, message: int, error: str, again_in: float) -> None:
        """Note why a message was not sent, and when it is tried again [s], at the latest in an hour."""
        due = datetime.now(UTC) + timedelta(seconds=min(again_in, _LONGEST))
        with self._database.writing() as session:
            session.execute(update(Message).where(Message.id == message).values(due=due, error=error))

    def waiting(self, channels: Sequence[str]) -> int:
        """How many messages for some channels are not sent."""
        query = select(func.count()).where(Message.sent.is_(None), Message.channel.in_(channels))
        with self._database.reading() as session:
            return session.scalars(query).one()
