"""Rows of the database as records."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeVar

from sqlalchemy import BindParameter, Connection, Select, Table, and_, bindparam, select

from swashtwin.monitoring.history import schema
from swashtwin.monitoring.history.records import Alarm, Event, Point

Record = TypeVar("Record")


def of_machine(table: Table, machine: Any = None) -> Select[Any]:
    """Query of the rows of a table with the names of their machines, or of those of one machine."""
    machines = schema.machines
    query = select(table, machines.c.name.label("machine")).join(machines, machines.c.id == table.c.machine_id)
    return query if machine is None else query.where(machines.c.name == machine)


def record(kind: type[Record], row: Mapping[Any, Any]) -> Record:
    """A `kind` from the columns that have the names of its fields."""
    return kind(**{item.name: row[item.name] for item in fields(kind)})  # type: ignore[arg-type]


def records(kind: type[Record], connection: Connection, query: Select[Any], **values: Any) -> tuple[Record, ...]:
    """A `kind` for each row of a query, with values of its parameters."""
    return tuple(record(kind, row) for row in connection.execute(query, values).mappings())


def point(connection: Connection, machine: str, name: str) -> Point | None:
    """Operating point of that name, or None."""
    return next(iter(records(Point, connection, _POINT, of=machine, point_name=name)), None)


def open_alarms(connection: Connection, machine: str | None = None) -> tuple[Alarm, ...]:
    """Alarms that are not closed, oldest first."""
    if machine is None:
        return records(Alarm, connection, _OPEN_ALARMS)
    return records(Alarm, connection, _OPEN_ALARMS_OF, of=machine)


def last_event(connection: Connection, machine: str, kind: str) -> Event | None:
    """The latest event of a kind, or None."""
    return next(iter(records(Event, connection, _LAST_EVENT, of=machine, event_kind=kind)), None)


# What is asked at every recording is built once: building a query costs as much as executing it.
_OF: BindParameter[Any] = bindparam("of")
_POINT = (
    of_machine(schema.points, _OF)
    .outerjoin(
        schema.baselines,
        and_(
            schema.baselines.c.machine_id == schema.points.c.machine_id,
            schema.baselines.c.point == schema.points.c.name,
        ),
    )
    .add_columns(schema.baselines.c.baseline)
    .where(schema.points.c.name == bindparam("point_name"))
)
_OPEN_ALARMS = of_machine(schema.alarms).where(schema.alarms.c.closed.is_(None)).order_by(schema.alarms.c.id)
_OPEN_ALARMS_OF = _OPEN_ALARMS.where(schema.machines.c.name == _OF)
_LAST_EVENT = (
    of_machine(schema.events, _OF)
    .where(schema.events.c.kind == bindparam("event_kind"))
    .order_by(schema.events.c.time.desc(), schema.events.c.id.desc())
    .limit(1)
)
