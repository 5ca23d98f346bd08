"""The history as tables for other programs: CSV, or Parquet."""

import csv
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from sqlalchemy import Connection, Engine, Select, Table, select

from swashtwin.foundation import TEXT, MissingExtraError, file_name, replacing, spreadsheet_text
from swashtwin.monitoring.history import rows, schema
from swashtwin.monitoring.history.engine import json_text, read_transaction
from swashtwin.monitoring.history.reading import Reads, unpack

FORMATS = ("csv", "parquet")
"""Formats of an export."""

_TABLES = ("recordings", "alarms", "silences", "events", "rejections", "outbox")
"""Tables that are exported column by column."""

_INTERNAL = ("machine_id", "retention", "due")
"""Columns that say nothing to others."""

_BATCH = 20_000
"""Rows that are in memory at a time."""

Rows = Iterator[Sequence[Any]]
AddRow = Callable[[Sequence[Any]], None]
Header = Mapping[str, type]
"""Name and type of each column; what JSON holds becomes text."""

_ESTIMATES = {
    "id": int,
    "machine": str,
    "time": datetime,
    "note": str,
    "name": str,
    "value": float,
    "low": float,
    "high": float,
    "unit": str,
}


def export_history(
    engine: Engine, read: Reads, folder: Path, table_format: str, progress: Callable[[str], None]
) -> dict[str, int]:
    """Rows of each file that was written to `folder`: one by table, and ``indicators/MACHINE`` by machine.

    Times are UTC. A file is whole or not there.

    Parameters
    ----------
    table_format : ``csv``, in which no text is a formula for a spreadsheet, or ``parquet``.
    progress : called with the name of each file before it is written.

    Raises
    ------
    HistoryError
        The database cannot be read.
    MissingExtraError
        Parquet is wanted and polars is not installed.
    """
    write = {"csv": _csv_file, "parquet": _parquet_file}[table_format]
    counts: dict[str, int] = {}

    def save(name: str, header: Header, lines: Rows) -> None:
        progress(name)
        counts[name] = 0
        with write(folder / f"{name}.{table_format}", header) as add:
            for line in lines:
                add([_cell(value) for value in line])
                counts[name] += 1

    with read_transaction(engine) as connection:
        connection = connection.execution_options(yield_per=1000)
        for name in _TABLES:
            query = _query(schema.METADATA.tables[name])
            header = {str(column.key): column.type.python_type for column in query.selected_columns}
            save(name, header, iter(connection.execute(query)))
        save("recalibrations", _ESTIMATES, _estimates(read))
        for machine in read.machines():
            names = read.indicator_names(machine.name)
            values = {f"{channel} {name}": float for channel, name in names}
            header = {"recording": int, "time": datetime, "point": str, **values}
            save(f"indicators/{file_name(machine.name)}", header, _indicators(connection, machine.name, names))
    return counts


def _query(table: Table) -> Select[Any]:
    machines = schema.machines
    columns = [column for column in table.c if column.name not in _INTERNAL]
    if "machine_id" not in table.c:
        return select(*columns).order_by(table.c.id)
    query = select(columns[0], machines.c.name.label("machine"), *columns[1:])
    return query.join(machines, machines.c.id == table.c.machine_id).order_by(table.c.id)


def _estimates(read: Reads) -> Rows:
    for machine in read.machines():
        for item in read.recalibrations(machine.name):
            for estimate in item.estimates:
                yield (item.id, item.machine, item.time, item.note, *asdict(estimate).values())


def _indicators(connection: Connection, machine: str, names: Sequence[tuple[str, str]]) -> Rows:
    table, recordings = schema.indicators, schema.recordings
    columns = {name: position for position, name in enumerate(names)}
    layouts = {
        row["id"]: [columns[channel, name] for channel, name in row["names"]]
        for row in connection.execute(rows.of_machine(schema.layouts, machine)).mappings()
    }
    query = (
        select(recordings.c.id, recordings.c.time, recordings.c.point, table.c.layout_id, table.c["values"])
        .join(table, table.c.recording_id == recordings.c.id)
        .join(schema.machines, schema.machines.c.id == recordings.c.machine_id)
        .where(schema.machines.c.name == machine)
        .order_by(recordings.c.time, recordings.c.id)
    )
    for number, time, point, layout, packed in connection.execute(query):
        values: list[float | None] = [None] * len(names)
        for position, value in zip(layouts[layout], unpack(packed).tolist(), strict=True):
            values[position] = value
        yield (number, time, point, *values)


def _cell(value: Any) -> Any:
    return json_text(value) if isinstance(value, (dict, list)) else value


@contextmanager
def _csv_file(path: Path, header: Header) -> Iterator[AddRow]:
    with replacing(path) as temporary, temporary.open("w", **TEXT) as file:
        writer = csv.writer(file, lineterminator="\n")

        def add(line: Sequence[Any]) -> None:
            writer.writerow([_csv_cell(value) for value in line])

        add(list(header))
        yield add


def _csv_cell(value: Any) -> Any:
    if isinstance(value, datetime):
        return value.isoformat().replace("+00:00", "Z")
    return spreadsheet_text(value) if isinstance(value, str) else value


@contextmanager
def _parquet_file(path: Path, header: Header) -> Iterator[AddRow]:
    try:
        import polars
    except ImportError as cause:
        raise MissingExtraError(
            'Parquet needs polars, which is not installed: pip install "swashtwin[readers]".'
        ) from cause
    with replacing(path) as temporary, TemporaryDirectory(dir=path.parent) as folder:
        kinds: dict[type, Any] = {int: polars.Int64, float: polars.Float64, datetime: polars.Datetime("us", "UTC")}
        lines: list[Sequence[Any]] = []
        parts: list[Path] = []

        def flush() -> None:
            parts.append(Path(folder) / f"{len(parts):06d}.parquet")
            columns = zip(*lines, strict=True) if lines else [()] * len(header)
            series = [
                polars.Series(name, column, kinds.get(kind, polars.String))
                for (name, kind), column in zip(header.items(), columns, strict=True)
            ]
            polars.DataFrame(series).write_parquet(parts[-1])
            lines.clear()

        def add(line: Sequence[Any]) -> None:
            lines.append(line)
            if len(lines) == _BATCH:
                flush()

        yield add
        if lines or not parts:
            flush()
        polars.scan_parquet(parts).sink_parquet(temporary)
