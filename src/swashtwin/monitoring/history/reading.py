"""What the page and other readers ask of the history."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import fields
from datetime import UTC, datetime
from typing import Any

import numpy as np
from sqlalchemy import Engine, Select, func, null, select

from swashtwin.foundation import InputError
from swashtwin.monitoring.history import rows, schema
from swashtwin.monitoring.history.engine import read_transaction
from swashtwin.monitoring.history.records import (
    Alarm,
    Counts,
    Estimate,
    Event,
    Judgment,
    MachineOverview,
    Names,
    Point,
    PointKey,
    Recalibration,
    Rejection,
    Silence,
    StoredRecording,
    Trend,
)
from swashtwin.monitoring.history.waveforms import Waveforms
from swashtwin.recordings import Recording

_FACTS = ("alarm_p", "capital", "probability", "confidence", "ood_p", "speed", "pressure")
"""Columns of recordings that have a trend; their channel is empty."""


class Reads:
    """Reads of the history, each in a transaction of its own.

    Every method raises `HistoryError` where the database cannot be read.
    """

    def __init__(self, engine: Engine, waveforms: Waveforms) -> None:
        self._engine = engine
        self._waveforms = waveforms

    def sequence(self) -> int:
        """A number that grows with each change of the history."""
        with read_transaction(self._engine) as connection:
            return int(connection.execute(select(func.sum(schema.machines.c.sequence))).scalar_one())

    def machines(self) -> tuple[MachineOverview, ...]:
        """Each machine at a glance, by name."""
        table, recordings = schema.machines, schema.recordings
        latest = (
            select(*recordings.c, table.c.name.label("machine"))
            .select_from(table.outerjoin(recordings, recordings.c.id == table.c.last))
            .where(table.c.name != "")
            .order_by(table.c.name)
        )
        tallies = rows.of_machine(schema.tallies)
        now = datetime.now(UTC)
        current = rows.of_machine(schema.silences).where(schema.silences.c.since <= now, schema.silences.c.until > now)
        events = rows.of_machine(schema.events).where(schema.events.c.kind == "maintenance")
        with read_transaction(self._engine) as connection:
            maintained = {
                event.machine: event.time for event in rows.records(Event, connection, events.order_by("time"))
            }
            alarms: dict[str, list[Alarm]] = defaultdict(list)
            for alarm in rows.open_alarms(connection):
                alarms[alarm.machine].append(alarm)
            counts: dict[str, int] = defaultdict(int)
            for row in connection.execute(tallies):
                counts[row.machine] += row.recordings
            silences: dict[str, datetime] = {}
            for silence in rows.records(Silence, connection, current):
                silences[silence.machine] = max(silence.until, silences.get(silence.machine, silence.until))
            return tuple(
                MachineOverview(
                    name=row["machine"],
                    recordings=counts[row["machine"]],
                    last=None if row["id"] is None else self._stored(row),
                    alarms=tuple(alarms[row["machine"]]),
                    silenced=silences.get(row["machine"]),
                    maintained=maintained.get(row["machine"]),
                )
                for row in connection.execute(latest).mappings()
            )

    def recordings(
        self,
        machine: str | None = None,
        *,
        point: str | None = None,
        state: str | None = None,
        since: datetime | None = None,
        until: datetime | None = None,
        before: int | None = None,
        limit: int = 100,
    ) -> tuple[StoredRecording, ...]:
        """Recordings, newest first by time of measurement.

        Parameters
        ----------
        since : earliest time of measurement.
        until : time of measurement from which on recordings are left out.
        before : number of a recording: the next older ones follow.
        """
        table = schema.recordings
        query = _within(rows.of_machine(table, machine), point, since, until)
        query = query if state is None else query.where(table.c.state == state)
        if before is not None:
            time = select(table.c.time).where(table.c.id == before).scalar_subquery()
            query = query.where((table.c.time < time) | ((table.c.time == time) & (table.c.id < before)))
        query = query.order_by(table.c.time.desc(), table.c.id.desc()).limit(limit)
        with read_transaction(self._engine) as connection:
            return tuple(self._stored(row) for row in connection.execute(query).mappings())

    def recording(self, number: int) -> StoredRecording | None:
        """Recording of that number, or None."""
        query = rows.of_machine(schema.recordings).where(schema.recordings.c.id == number)
        with read_transaction(self._engine) as connection:
            row = connection.execute(query).mappings().first()
        return None if row is None else self._stored(row)

    def later_recording(self, number: int) -> int | None:
        """Number of the recording of the same machine that was measured next, or None."""
        table = schema.recordings
        this = select(table.c.machine_id, table.c.time).where(table.c.id == number).subquery()
        query = (
            select(table.c.id)
            .join(this, table.c.machine_id == this.c.machine_id)
            .where((table.c.time > this.c.time) | ((table.c.time == this.c.time) & (table.c.id > number)))
            .order_by(table.c.time, table.c.id)
            .limit(1)
        )
        with read_transaction(self._engine) as connection:
            return connection.execute(query).scalar_one_or_none()

    def _stored(self, row: Mapping[Any, Any]) -> StoredRecording:
        values = {item.name: row[item.name] for item in fields(Judgment)}
        judgment = Judgment(**{**values, "channels": tuple(values["channels"])})
        waveform = None if row["waveform"] is None else self._waveforms.folder / row["waveform"]
        return StoredRecording(row["id"], row["machine"], judgment, waveform)

    def waveform(self, number: int) -> Recording | None:
        """Samples of a recording, or None where they are not kept."""
        recording = self.recording(number)
        return None if recording is None or recording.waveform is None else self._waveforms.read(recording.waveform)

    def indicator_names(self, machine: str) -> Names:
        """Channel and name of each indicator that recordings of the machine have."""
        query = rows.of_machine(schema.layouts, machine).order_by(schema.layouts.c.id.desc())
        with read_transaction(self._engine) as connection:
            layouts = [row["names"] for row in connection.execute(query).mappings()]
        return tuple({(channel, name): None for names in layouts for channel, name in names})

    def trend(
        self,
        machine: str,
        channel: str,
        name: str,
        *,
        point: str | None = None,
        since: datetime | None = None,
        until: datetime | None = None,
        limit: int = 5000,
    ) -> Trend:
        """An indicator over time: its newest `limit` values, oldest first.

        Parameters
        ----------
        channel : empty for facts of the whole recording: ``alarm_p``, ``capital``, ``probability``, ``confidence``,
            ``ood_p``, ``speed`` [rad/s], ``pressure`` [Pa].
        """
        table = schema.recordings
        with read_transaction(self._engine) as connection:
            if channel == "":
                if name not in _FACTS:
                    raise InputError(f"{name!r} has no trend; {', '.join(_FACTS)} have one.")
                queries = [_trend_query(machine, table.c[name], null())]
            else:
                layouts = connection.execute(rows.of_machine(schema.layouts, machine)).mappings().all()
                queries = [
                    _trend_query(machine, null(), func.substr(schema.indicators.c["values"], 4 * position + 1, 4))
                    .join(schema.indicators, schema.indicators.c.recording_id == table.c.id)
                    .where(schema.indicators.c.layout_id == layout["id"])
                    for layout in layouts
                    for position, names in enumerate(layout["names"])
                    if names == [channel, name]
                ]
            results: list[Any] = []
            for query in queries:
                newest = _within(query, point, since, until).order_by(table.c.time.desc(), table.c.id.desc())
                results += connection.execute(newest.limit(limit)).all()
        results.sort(key=lambda row: (row.time, row.id))
        results = results[-limit:]
        return Trend(
            np.array([row.id for row in results], np.int64),
            np.array([row.time.replace(tzinfo=None) for row in results], "datetime64[us]"),
            np.array([_value(row.number, row.packed) for row in results], np.float64),
        )

    def points(self, machine: str) -> tuple[PointKey, ...]:
        """Operating points of a machine by name, without what was learned there, which is large."""
        query = rows.of_machine(schema.points, machine).order_by(schema.points.c.name)
        with read_transaction(self._engine) as connection:
            return rows.records(PointKey, connection, query)

    def point(self, machine: str, name: str) -> Point | None:
        """Operating point of a machine with what the alarm learned there, or None."""
        with read_transaction(self._engine) as connection:
            return rows.point(connection, machine, name)

    def alarms(self, machine: str | None = None, *, state: str | None = None, limit: int = 100) -> tuple[Alarm, ...]:
        """Alarms of a machine or of all, latest first."""
        table = schema.alarms
        query = rows.of_machine(table, machine)
        query = query if state is None else query.where(table.c.state == state)
        with read_transaction(self._engine) as connection:
            return rows.records(Alarm, connection, query.order_by(table.c.id.desc()).limit(limit))

    def alarm(self, number: int) -> Alarm | None:
        """Alarm of that number, or None."""
        with read_transaction(self._engine) as connection:
            query = rows.of_machine(schema.alarms).where(schema.alarms.c.id == number)
            return next(iter(rows.records(Alarm, connection, query)), None)

    def events(self, machine: str | None = None, limit: int = 100) -> tuple[Event, ...]:
        """Events of a machine or of all, latest first."""
        table = schema.events
        query = rows.of_machine(table, machine).order_by(table.c.time.desc(), table.c.id.desc()).limit(limit)
        with read_transaction(self._engine) as connection:
            return rows.records(Event, connection, query)

    def rejections(self, limit: int = 100) -> tuple[Rejection, ...]:
        """Deliveries that became no recording, latest first."""
        table = schema.rejections
        query = select(table).order_by(table.c.received.desc(), table.c.id.desc()).limit(limit)
        with read_transaction(self._engine) as connection:
            results = connection.execute(query).mappings().all()
        return tuple(
            rows.record(Rejection, {**row, "machine": row["machine"] or None, "content": row["content"] or None})
            for row in results
        )

    def recalibrations(self, machine: str) -> tuple[Recalibration, ...]:
        """Values of the machine's twin, oldest first."""
        query = rows.of_machine(schema.recalibrations, machine).order_by(schema.recalibrations.c.time)
        with read_transaction(self._engine) as connection:
            results = connection.execute(query).mappings().all()
        return tuple(
            rows.record(Recalibration, {**row, "estimates": tuple(Estimate(**item) for item in row["estimates"])})
            for row in results
        )

    def counts(self) -> Counts:
        """Totals, for measuring programs; they cost the same however long the history is."""
        alarms, rejections, outbox = schema.alarms, schema.rejections, schema.outbox
        by_kind = rows.of_machine(alarms).where(alarms.c.state != "closed")
        by_reason = select(rejections.c.reason, func.sum(rejections.c.times)).group_by(rejections.c.reason)
        waiting = select(func.count()).select_from(outbox).where(outbox.c.sent.is_(None))
        with read_transaction(self._engine) as connection:
            open_alarms: dict[tuple[str, str], int] = defaultdict(int)
            for row in connection.execute(by_kind):
                open_alarms[row.machine, row.kind] += 1
            return Counts(
                recordings={
                    (row.machine, row.state): row.recordings
                    for row in connection.execute(rows.of_machine(schema.tallies))
                },
                alarms=dict(open_alarms),
                rejections={reason: int(count) for reason, count in connection.execute(by_reason)},
                waiting=connection.execute(waiting).scalar_one(),
            )


def unpack(packed: bytes) -> np.ndarray:
    """Values of indicators, in the order of their layout."""
    return np.frombuffer(packed, "<f4")


def _trend_query(machine: str, number: Any, packed: Any) -> Select[Any]:
    table, machines = schema.recordings, schema.machines
    return (
        select(table.c.id, table.c.time, number.label("number"), packed.label("packed"))
        .join(machines, machines.c.id == table.c.machine_id)
        .where(machines.c.name == machine)
    )


def _within(query: Select[Any], point: str | None, since: datetime | None, until: datetime | None) -> Select[Any]:
    table = schema.recordings
    if point is not None:
        query = query.where(table.c.point == point)
    if since is not None:
        query = query.where(table.c.time >= since)
    return query if until is None else query.where(table.c.time < until)


def _value(number: float | None, packed: bytes | None) -> float:
    if packed is not None:
        return float(unpack(packed)[0])
    return np.nan if number is None else number
