"""Messages that wait to be sent."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

from sqlalchemy import delete, func, or_, select, update

from swashtwin.monitoring.history.database import Database
from swashtwin.monitoring.history.schema import Message

LEASE = timedelta(seconds=60)
"""Time for which a sender has a message for itself; after it, the sender is assumed to have ended.
"""
MAX_DUE_AHEAD = timedelta(hours=1)
"""Longer than any delay of a message: a due time beyond it was set before the clock was set back.
"""
N_KEPT_SENT = 10_000
"""Range of the newest message numbers in which sent messages are kept."""


class Outbox:
    """Messages of all machines, handed out to any number of senders.

    Every method raises `HistoryError` if the database cannot be used.
    """

    def __init__(self, database: Database) -> None:
        self._database = database

    def claim(self, channels: Sequence[str], limit: int = 20) -> Sequence[Message]:
        """Return the oldest due messages for the channels, and reserve them for a minute."""
        if not self.waiting(channels):
            return ()  # without the lock that a writing transaction takes

        now = datetime.now(UTC)
        is_due = or_(Message.due <= now, Message.due > now + MAX_DUE_AHEAD)
        query = (
            select(Message)
            .where(Message.sent.is_(None), Message.channel.in_(channels), is_due)
            .order_by(Message.id)
            .limit(limit)
            .with_for_update(skip_locked=True)
        )

        # Rows that another sender claims at the same moment are skipped.
        with self._database.writing() as session:
            messages = session.scalars(query).all()
            for message in messages:
                message.due = now + LEASE
                message.attempts += 1
        return messages

    def mark_sent(self, message: int) -> None:
        """Record that a message was sent, and remove old messages that were sent."""
        now = datetime.now(UTC)
        mark = update(Message).where(Message.id == message).values(sent=now, error=None)
        remove = delete(Message).where(
            Message.sent.is_not(None), Message.id <= message - N_KEPT_SENT
        )

        with self._database.writing() as session:
            session.execute(mark)
            session.execute(remove)

    def mark_failed(self, message: int, error: str, delay: float) -> None:
        """Record why a message was not sent, and after which delay [s] it is tried again."""
        due = datetime.now(UTC) + timedelta(seconds=delay)
        mark = update(Message).where(Message.id == message).values(due=due, error=error)
        with self._database.writing() as session:
            session.execute(mark)

    def waiting(self, channels: Sequence[str]) -> int:
        """Return the number of messages for the channels that are not sent."""
        query = select(func.count()).where(Message.sent.is_(None), Message.channel.in_(channels))
        with self._database.reading() as session:
            return session.scalars(query).one()
