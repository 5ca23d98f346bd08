"""The history of watched machines as a whole."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from sqlalchemy import delete, select

from swashtwin.foundation import InputError
from swashtwin.monitoring.config.settings import Retention, WatchConfig
from swashtwin.monitoring.history.database import Database, lock_machine
from swashtwin.monitoring.history.export import export_history
from swashtwin.monitoring.history.outbox import Outbox
from swashtwin.monitoring.history.reading import HistoryReader
from swashtwin.monitoring.history.schema import Rejection
from swashtwin.monitoring.history.transaction import MachineTransaction
from swashtwin.monitoring.history.waveforms import Waveforms

MAX_REJECTIONS = 10_000
"""Rejections that are kept: a misconfigured source may cause any number of them."""


class History:
    """Database of verdicts, indicators and alarms, with files of waveforms.

    It may be used from any thread and process. Every method raises `HistoryError` if the database
    cannot be used.
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
        """Open the history of a database and a folder, and create its tables if they are absent.

        Parameters
        ----------
        url : ``postgresql://user@host/database``; empty for SQLite in `folder`.
        folder : folder of the waveforms.
        retention : which waveforms are kept; by default that of `Retention`.
        is_new : whether the tables may be created.

        Raises
        ------
        HistoryError
            The database cannot be used now.
        InputError, DataError, MissingExtraError
            The URL is invalid, a driver is missing, or the database belongs to another program,
            has another version, or does not exist although `is_new` is false.
        """
        folder = Path(folder)
        database = Database(url, folder, is_new=is_new)
        return cls(database, folder, retention or Retention())

    def close(self) -> None:
        """Close all connections."""
        self._database.close()

    @contextmanager
    def machine(self, name: str) -> Iterator[MachineTransaction]:
        """Yield a transaction that locks a machine.

        It is committed at the end of the block, and undone by any error. SQLite has one writer at a
        time, so slow work is done before the block.
        """
        with self._database.writing() as session:
            transaction = MachineTransaction(session, name, self._retention)
            yield transaction
        # Only after the commit: an undone transaction still needs its files.
        self.waveforms.remove(transaction.dropped)

    def export(
        self, folder: Path, progress: Callable[[str], None] = lambda _: None
    ) -> dict[str, int]:
        """Write the history to CSV files; see `export_history`."""
        return export_history(self._database, self.reader, folder, progress)

    def reject(self, rejection: Rejection) -> None:
        """File a delivery that cannot be judged; if it is repeated, it is counted."""
        is_same = (
            Rejection.content == rejection.content,
            Rejection.machine == rejection.machine,
            Rejection.reason == rejection.reason,
        )
        with self._database.writing() as session:
            # The lock of the machine without a name makes the number of the page grow.
            lock_machine(session, "")
            stored = session.scalars(select(Rejection).where(*is_same)).first()

            if stored is not None:
                rejection.id = stored.id
                rejection.times = stored.times + 1
            session.merge(rejection)
            session.flush()

            newest_surplus = (
                select(Rejection.id).order_by(Rejection.id.desc()).offset(MAX_REJECTIONS).limit(1)
            )
            session.execute(
                delete(Rejection).where(Rejection.id <= newest_surplus.scalar_subquery())
            )


def record_event(
    config: WatchConfig,
    history: History,
    machine: str,
    *,
    who: str,
    note: str,
    finding: str = "",
    maintenance: bool,
) -> int:
    """Record an event of a machine, and return its number.

    After maintenance all baselines of the machine are learned again, and its alarms are closed.

    Parameters
    ----------
    finding : what was wrong with the machine; it is kept with its newest alarm.

    Raises
    ------
    InputError
        The configuration has no such machine, or `finding` is given although there was no alarm.
    """
    if config.machine(machine) is None:
        raise InputError(
            f"{config.path} has no machine {machine!r}. Its machines are {config.machine_names}."
        )

    with history.machine(machine) as transaction:
        if finding:
            transaction.record_finding(finding, who)
            note = "; ".join(filter(None, (f"found: {finding}", note)))
        if not maintenance:
            return transaction.add_event("note", who, note)

        # After a repair the machine vibrates differently, and its alarms are no longer true.
        number = transaction.add_event("maintenance", who, note)
        transaction.forget_operating_points()
        for alarm in transaction.alarms():
            if alarm.state == "open":
                transaction.acknowledge(alarm.id, who, note)
            transaction.clear_alarm(alarm.id, datetime.now(UTC))
    return number
