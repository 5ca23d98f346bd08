"""The history as CSV tables for other programs."""

import csv
from collections.abc import Callable, Iterable, Iterator, Sequence
from datetime import datetime
from itertools import chain
from pathlib import Path
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from swashtwin.foundation import TEXT, file_name, replacing, spreadsheet_text
from swashtwin.monitoring.history.database import Database, json_text
from swashtwin.monitoring.history.reading import Names, Reads, unpack
from swashtwin.monitoring.history.tables import Alarm, Event, Indicators, Judgment, Layout, Message, Rejection, Silence

_TABLES = (Judgment, Alarm, Silence, Event, Rejection, Message)
"""Tables that are exported column by column."""
_INTERNAL = ("retention", "due")
"""Columns that say nothing to others."""


def export_history(database: Database, read: Reads, folder: Path, progress: Callable[[str], None]) -> dict[str, int]:
    """Rows of each file that was written to `folder`: one by table, and ``indicators/MACHINE`` by machine.

    Times are UTC. A file is whole or not there. No text is a formula for a spreadsheet.

    Parameters
    ----------
    progress : called with the name of each file before it is written.

    Raises
    ------
    HistoryError
        The database cannot be read.
    """
    counts: dict[str, int] = {}

    def save(name: str, header: Sequence[str], lines: Iterable[Sequence[Any]]) -> None:
        progress(name)
        counts[name] = -1  # the header is no row
        with replacing(folder / f"{name}.csv") as temporary, temporary.open("w", **TEXT) as file:
            writer = csv.writer(file, lineterminator="\n")
            for line in chain([header], lines):
                writer.writerow([_cell(value) for value in line])
                counts[name] += 1

    with database.reading() as session:
        for kind in _TABLES:
            columns = [column for column in kind.__table__.columns if column.name not in _INTERNAL]
            rows = session.execute(select(*columns).order_by(kind.id).execution_options(yield_per=1000))
            save(kind.__tablename__, [column.name for column in columns], rows)
        for machine in read.machines():
            names = read.indicator_names(machine.name)
            header = ["recording", "time", "point", *(f"{channel} {name}" for channel, name in names)]
            save(f"indicators/{file_name(machine.name)}", header, _indicators(session, machine.name, names))
    return counts


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
        for position, value in zip(layouts[layout], unpack(packed).tolist(), strict=True):
            values[position] = value
        yield (number, time, point, *values)


def _cell(value: Any) -> Any:
    if isinstance(value, datetime):
        return value.isoformat().replace("+00:00", "Z")
    text = json_text(value) if isinstance(value, (dict, list)) else value
    return spreadsheet_text(text) if isinstance(text, str) else text
