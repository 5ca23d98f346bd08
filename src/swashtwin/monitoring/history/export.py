"""Exports the history as CSV files."""

import csv
from collections.abc import Callable, Iterable, Iterator, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from sqlalchemy import select
from sqlalchemy.orm import Session

from swashtwin.foundation import TEXT, atomic_write, safe_file_name, spreadsheet_text
from swashtwin.monitoring.history.database import Database, json_text
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

EXPORTED_TABLES = (Judgment, Alarm, Silence, Event, Rejection, Message)
"""Tables that are exported column by column."""
INTERNAL_COLUMNS = ("retention", "due")
"""Columns that mean nothing outside of the watch."""
FETCHED_ROWS = 1000
"""Rows in memory at a time: a history has millions."""


def export_history(
    database: Database, reader: HistoryReader, folder: Path, progress: Callable[[str], None]
) -> dict[str, int]:
    """Write the history to CSV files, and return the number of rows of each file.

    There is one file for each table, and ``indicators/MACHINE`` for each machine. Times are UTC. A
    file is complete or absent. No text is a formula for a spreadsheet.

    Parameters
    ----------
    progress : called with the name of each file before it is written.
    """
    counts = {}
    with database.reading() as session:
        for table in EXPORTED_TABLES:
            columns = [
                column for column in table.__table__.columns if column.name not in INTERNAL_COLUMNS
            ]
            rows = session.execute(
                select(*columns).order_by(table.id).execution_options(yield_per=FETCHED_ROWS)
            )

            progress(table.__tablename__)
            counts[table.__tablename__] = _write_table(
                folder / f"{table.__tablename__}.csv", [column.name for column in columns], rows
            )

        for machine in reader.machines():
            names = reader.indicator_names(machine.name)
            header = ["recording", "time", "point"]
            header += [f"{channel} {name}" for channel, name in names]

            file_name = f"indicators/{safe_file_name(machine.name)}"
            progress(file_name)
            counts[file_name] = _write_table(
                folder / f"{file_name}.csv", header, _indicator_rows(session, machine.name, names)
            )
    return counts


def _write_table(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> int:
    """Write a CSV file, and return its number of rows without the header."""
    count = 0
    with atomic_write(path) as temporary, temporary.open("w", **TEXT) as file:
        writer = csv.writer(file, lineterminator="\n")
        # A channel's name may look like a formula too.
        writer.writerow([_cell(name) for name in header])
        for row in rows:
            writer.writerow([_cell(value) for value in row])
            count += 1
    return count


def _indicator_rows(session: Session, machine: str, names: Names) -> Iterator[Sequence[Any]]:
    # Layouts may have different indicators in different order; the file has all of them.
    column_numbers = {name: number for number, name in enumerate(names)}
    layout_columns = {}
    for layout in session.scalars(select(Layout).where(Layout.machine == machine)):
        layout_columns[layout.id] = [
            column_numbers[channel, name] for channel, name in layout.names
        ]

    query = (
        select(Judgment.id, Judgment.time, Judgment.point, Indicators.layout, Indicators.values)
        .join(Indicators, Indicators.recording == Judgment.id)
        .where(Judgment.machine == machine)
        .order_by(Judgment.time, Judgment.id)
        .execution_options(yield_per=FETCHED_ROWS)
    )
    for number, time, point, layout_id, packed_values in session.execute(query):
        row: list[float | None] = [None] * len(names)
        values = np.frombuffer(packed_values, "<f4").tolist()
        for column, value in zip(layout_columns[layout_id], values, strict=True):
            row[column] = value
        yield (number, time, point, *row)


def _cell(value: Any) -> Any:
    if isinstance(value, datetime):
        return value.isoformat().replace("+00:00", "Z")
    if isinstance(value, (dict, list)):
        value = json_text(value)
    if isinstance(value, str):
        return spreadsheet_text(value)
    return value
