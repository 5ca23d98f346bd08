"""Messages that wait in the database until a sender has sent them: each at least once."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

from sqlalchemy import Engine, delete, func, or_, select, update

from swashtwin.monitoring.history import rows
from swashtwin.monitoring.history.engine import read_transaction, write_transaction
from swashtwin.monitoring.history.records import Message
from swashtwin.monitoring.history.schema import outbox

_LONGEST = 3600.0
"""Seconds after which a message is tried again at the latest."""

_SENT = 10_000
"""Numbers of messages for which sent ones are kept."""


class Outbox:
    """Messages of all machines, handed out to any number of senders."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine

    def claim(self, channels: Sequence[str], limit: int = 20, lease: float = 60.0) -> tuple[Message, ...]:
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
        is_due = or_(outbox.c.due <= now, outbox.c.due > now + timedelta(seconds=2 * _LONGEST))
        due = select(outbox.c.id).where(outbox.c.sent.is_(None), outbox.c.channel.in_(channels), is_due)
        due = due.order_by(outbox.c.id).limit(limit)
        with write_transaction(self._engine) as connection:
            numbers = list(connection.execute(due.with_for_update(skip_locked=True)).scalars())
            if not numbers:
                return ()
            until = now + timedelta(seconds=min(lease, _LONGEST))
            claim = update(outbox).where(outbox.c.id.in_(numbers))
            connection.execute(claim.values(due=until, attempts=outbox.c.attempts + 1))
            query = rows.of_machine(outbox).where(outbox.c.id.in_(numbers)).order_by(outbox.c.id)
            return rows.records(Message, connection, query)

    def sent(self, message: int) -> None:
        """Note that a message was sent."""
        with write_transaction(self._engine) as connection:
            change = update(outbox).where(outbox.c.id == message)
            connection.execute(change.values(sent=datetime.now(UTC), error=None))
            connection.execute(delete(outbox).where(outbox.c.sent.is_not(None), outbox.c.id <= message - _SENT))

    def failed(self, message: int, error: str, again_in: float) -> None:
        """Note why a message was not sent, and when it is tried again [s], at the latest in an hour."""
        due = datetime.now(UTC) + timedelta(seconds=min(again_in, _LONGEST))
        with write_transaction(self._engine) as connection:
            connection.execute(update(outbox).where(outbox.c.id == message).values(due=due, error=error))

    def waiting(self, channels: Sequence[str]) -> int:
        """How many messages for some channels are not sent."""
        with read_transaction(self._engine) as connection:
            is_waiting = (outbox.c.sent.is_(None), outbox.c.channel.in_(channels))
            query = select(func.count()).select_from(outbox).where(*is_waiting)
            return int(connection.execute(query).scalar_one())
