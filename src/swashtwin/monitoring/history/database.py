"""The history of watched machines as a whole."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from sqlalchemy import Engine, delete, select

from swashtwin.monitoring.config import Retention
from swashtwin.monitoring.history.engine import open_engine, write_transaction
from swashtwin.monitoring.history.export import export_history
from swashtwin.monitoring.history.migrations import migrate
from swashtwin.monitoring.history.outbox import Outbox
from swashtwin.monitoring.history.reading import Reads
from swashtwin.monitoring.history.records import Rejection
from swashtwin.monitoring.history.schema import rejections
from swashtwin.monitoring.history.transaction import MachineTransaction, lock_machine, upsert
from swashtwin.monitoring.history.waveforms import Waveforms

_REJECTIONS = 10_000
"""Rejections that are kept."""


class History:
    """Database of verdicts, indicators and alarms, with waveforms beside it; used from any thread and process."""

    def __init__(self, engine: Engine, folder: Path, retention: Retention) -> None:
        self._engine = engine
        self._retention = retention
        self.waveforms = Waveforms(folder / "waveforms", engine)
        self.read = Reads(engine, self.waveforms)
        self.outbox = Outbox(engine)

    @classmethod
    def open(cls, url: str, folder: Path, retention: Retention | None = None, *, is_new: bool = True) -> "History":
        """History of a database and a folder; its tables are made, or brought to this version.

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
            The URL is none, the database is another program's, of a newer version or not there though it must be, or
            a driver is missing.
        """
        engine = open_engine(url, Path(folder), is_new=is_new)
        try:
            migrate(engine, is_new=is_new)
        except BaseException:
            engine.dispose()
            raise
        return cls(engine, Path(folder), retention or Retention())

    def __repr__(self) -> str:
        return f"History({self._engine.dialect.name}, {self.waveforms.folder.parent})"

    def close(self) -> None:
        """Close all connections."""
        self._engine.dispose()

    @contextmanager
    def machine(self, name: str) -> Iterator[MachineTransaction]:
        """Transaction that locks a machine; committed at the end of the block, undone by any error.

        SQLite has one writer at a time, so slow work is done before the block.

        Raises
        ------
        HistoryError
            The database cannot be written, or the machine stays locked by another process.
        """
        with write_transaction(self._engine) as connection:
            transaction = MachineTransaction(connection, name, self._retention)
            yield transaction
        self.waveforms.remove(transaction.dropped)

    def export(
        self, folder: Path, table_format: str = "csv", progress: Callable[[str], None] = lambda _: None
    ) -> dict[str, int]:
        """Rows of each file that was written to `folder` (`export_history`)."""
        return export_history(self._engine, self.read, folder, table_format, progress)

    def reject(self, rejection: Rejection) -> None:
        """File a delivery that became no recording; the same one again is counted.

        Raises
        ------
        HistoryError
            The database cannot be written.
        """
        content = rejection.content or f"{rejection.source}/{rejection.file}"
        values = {**vars(rejection), "content": content, "machine": rejection.machine or ""}
        with write_transaction(self._engine) as connection:
            lock_machine(connection, "")  # so that the page's number grows
            upsert(connection, rejections, values, ("content", "machine", "reason"), counter="times")
            surplus = select(rejections.c.id).order_by(rejections.c.id.desc()).offset(_REJECTIONS).limit(1)
            connection.execute(delete(rejections).where(rejections.c.id <= surplus.scalar_subquery()))
