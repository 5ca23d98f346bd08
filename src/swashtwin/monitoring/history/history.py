"""The history of watched machines as a whole."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from sqlalchemy import delete, select

from swashtwin.monitoring.config.settings import Retention
from swashtwin.monitoring.history.database import Database, lock_machine
from swashtwin.monitoring.history.export import export_history
from swashtwin.monitoring.history.outbox import Outbox
from swashtwin.monitoring.history.reading import Reads
from swashtwin.monitoring.history.tables import Rejection
from swashtwin.monitoring.history.transaction import MachineTransaction
from swashtwin.monitoring.history.waveforms import Waveforms

_REJECTIONS = 10_000
"""Rejections that are kept."""


class History:
    """Database of verdicts, indicators and alarms, with waveforms beside it; used from any thread and process."""

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

    def __repr__(self) -> str:
        return f"History({self._database.kind}, {self.waveforms.folder.parent})"

    def close(self) -> None:
        """Close all connections."""
        self._database.close()

    @contextmanager
    def machine(self, name: str) -> Iterator[MachineTransaction]:
        """Transaction that locks a machine; committed at the end of the block, undone by any error.

        SQLite has one writer at a time, so slow work is done before the block.

        Raises
        ------
        HistoryError
            The database cannot be written, or the machine stays locked by another process.
        """
        with self._database.writing() as session:
            transaction = MachineTransaction(session, name, self._retention)
            yield transaction
        self.waveforms.remove(transaction.dropped)

    def export(self, folder: Path, progress: Callable[[str], None] = lambda _: None) -> dict[str, int]:
        """Rows of each file that was written to `folder` (`export_history`)."""
        return export_history(self._database, self.read, folder, progress)

    def reject(self, rejection: Rejection) -> None:
        """File a delivery that became no recording; the same one again is counted.

        Raises
        ------
        HistoryError
            The database cannot be written.
        """
        key = (
            Rejection.content == rejection.content,
            Rejection.machine == rejection.machine,
            Rejection.reason == rejection.reason,
        )
        with self._database.writing() as session:
            lock_machine(session, "")  # so that the page's number grows
            stored = session.scalars(select(Rejection).where(*key)).first()
            if stored is not None:
                rejection.id, rejection.times = stored.id, stored.times + 1
            session.merge(rejection)
            session.flush()
            surplus = select(Rejection.id).order_by(Rejection.id.desc()).offset(_REJECTIONS).limit(1)
            session.execute(delete(Rejection).where(Rejection.id <= surplus.scalar_subquery()))
