"""Version of the tables, and how older ones are brought to it."""

from collections.abc import Callable

from sqlalchemy import Connection, Engine, insert, inspect, select, text, update

from swashtwin.foundation import DataError
from swashtwin.monitoring.history.engine import write_transaction
from swashtwin.monitoring.history.schema import METADATA, machines, version

MIGRATIONS: tuple[Callable[[Connection], None], ...] = ()
"""Step n brings tables of version n + 1 to version n + 2; a release that changes `schema` adds one."""

_LOCK = 0x73776173
"""Number under which PostgreSQL lets one process at a time migrate."""


def migrate(engine: Engine, *, is_new: bool) -> None:
    """Create the tables where they may be new, or bring those of an older version to this one, in one transaction.

    Raises
    ------
    DataError
        There are no tables though they may not be new, they are of a newer version, or other programs' tables have
        their names.
    HistoryError
        The database cannot be used.
    """
    newest = 1 + len(MIGRATIONS)
    with write_transaction(engine) as connection:
        if engine.dialect.name == "postgresql":
            connection.execute(text("SELECT pg_advisory_xact_lock(:lock)"), {"lock": _LOCK})
        present = set(inspect(connection).get_table_names())
        if version.name not in present:
            if not is_new:
                raise DataError("the database has no history yet; a watch makes it.")
            if strangers := present & set(METADATA.tables):
                raise DataError(
                    f"the database has tables of another program ({', '.join(sorted(strangers))}); "
                    "give the history a database of its own."
                )
            METADATA.create_all(connection)
            connection.execute(insert(version).values(version=newest))
            connection.execute(insert(machines).values(name="", sequence=0))
            return
        current = connection.execute(select(version.c.version)).scalar_one()
        if current > newest:
            raise DataError(f"the history is of version {current}, this swashtwin reads up to {newest}; update it.")
        for step in MIGRATIONS[current - 1 :]:
            step(connection)
        if current < newest:
            connection.execute(update(version).values(version=newest))
