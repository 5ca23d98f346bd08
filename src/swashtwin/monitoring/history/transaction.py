"""What is written to the history of one machine, in one transaction that locks it."""

import hashlib
import math
import sys
from collections.abc import Mapping
from dataclasses import asdict
from datetime import UTC, datetime, timedelta
from functools import cache
from typing import Any

import numpy as np
from sqlalchemy import (
    BindParameter,
    Connection,
    Select,
    Table,
    bindparam,
    delete,
    func,
    insert,
    literal_column,
    select,
    update,
)
from sqlalchemy.dialects import postgresql, sqlite

from swashtwin.foundation import InputError
from swashtwin.monitoring.config import Retention
from swashtwin.monitoring.history import rows
from swashtwin.monitoring.history.engine import json_text
from swashtwin.monitoring.history.records import Alarm, Estimate, Event, Judgment, Point, PointKey
from swashtwin.monitoring.history.schema import (
    alarms,
    baselines,
    events,
    indicators,
    layouts,
    machines,
    outbox,
    points,
    recalibrations,
    recordings,
    silences,
    tallies,
)

_RUN_UP = 10
"""Recordings before an alarm whose waveforms are kept with it."""

# Statements of every recording are built once: building one costs as much as executing it.
_MACHINE: BindParameter[Any] = bindparam("machine")
_RECORDING = select(recordings.c.id).where(
    recordings.c.machine_id == _MACHINE, recordings.c.content == bindparam("content")
)
_NEWEST = (
    select(recordings.c.time)
    .where(recordings.c.machine_id == _MACHINE)
    .order_by(recordings.c.time.desc())
    .limit(literal_column("1"))
)
_POINTS = (
    select(points.c.name, points.c.speed, points.c.pressure)
    .where(points.c.machine_id == _MACHINE)
    .order_by(points.c.name)
)
_LAYOUT = select(layouts.c.id).where(layouts.c.machine_id == _MACHINE, layouts.c.digest == bindparam("digest"))
_ADD_INDICATORS = insert(indicators)
_SET_LAST = update(machines).where(machines.c.id == _MACHINE).values(last=bindparam("recording"))
_LOCK = (
    update(machines)
    .where(machines.c.name == _MACHINE)
    .values(sequence=machines.c.sequence + 1)
    .returning(machines.c.id)
)


class MachineTransaction:
    """Reads and writes of one machine, which stays locked until the transaction ends."""

    def __init__(self, connection: Connection, name: str, retention: Retention) -> None:
        self.name = name
        self.dropped: list[str] = []
        """Waveforms to remove once the transaction is committed."""
        self._connection = connection
        self._retention = retention
        self._id = lock_machine(connection, name)
        self._absent: set[str] = set()

    def recording_id(self, content: str) -> int | None:
        """Number of the recording with that content, or None."""
        number = self._scalar(_RECORDING, content=content)
        if number is None:
            self._absent.add(content)
        return number

    def newest(self) -> datetime | None:
        """Time of the newest recording, or None."""
        return self._scalar(_NEWEST)

    def points(self) -> tuple[PointKey, ...]:
        """Operating points of the machine, without what was learned there, which is large."""
        return rows.records(PointKey, self._connection, _POINTS, machine=self._id)

    def point(self, name: str) -> Point | None:
        """Operating point of that name, or None."""
        return rows.point(self._connection, self.name, name)

    def save_point(
        self,
        name: str,
        *,
        speed: float | None = None,
        pressure: float | None = None,
        baseline: Mapping[str, Any] | None = None,
        test: Mapping[str, Any] | None = None,
    ) -> None:
        """Keep the state of an operating point; what is None stays as it is.

        Parameters
        ----------
        speed : angular speed of the shaft [rad/s].
        pressure : discharge pressure [Pa].
        baseline : what is large and changes rarely.
        test : what changes with each recording.
        """
        state = {"speed": _number(speed), "pressure": _number(pressure), "test": test}
        row: dict[str, Any] = {key: value for key, value in state.items() if value is not None}
        row |= {"machine_id": self._id, "name": name, "updated": datetime.now(UTC)}
        upsert(self._connection, points, row, ("machine_id", "name"))
        if baseline is not None:
            row = {"machine_id": self._id, "point": name, "baseline": baseline}
            upsert(self._connection, baselines, row, ("machine_id", "point"))

    def forget_points(self, name: str | None = None) -> None:
        """Remove what was learned at all operating points, or at the one of that name, so that it is learned anew."""
        for table, key in ((points, points.c.name), (baselines, baselines.c.point)):
            where = [table.c.machine_id == self._id] + ([] if name is None else [key == name])
            self._connection.execute(delete(table).where(*where))

    def add_recording(
        self,
        judgment: Judgment,
        values: Mapping[tuple[str, str], float] | None = None,
        waveform: str | None = None,
    ) -> int:
        """Number of a new recording.

        Parameters
        ----------
        values : indicators by channel and name; kept with the seven digits of a float32.
        waveform : path that `Waveforms.write` gave; retention decides how long the file stays.

        Raises
        ------
        InputError
            The machine has a recording of this content already.
        """
        if judgment.content not in self._absent and self.recording_id(judgment.content) is not None:
            raise InputError(f"{self.name} has a recording of content {judgment.content} already.")
        facts = {key: _number(value) if isinstance(value, float) else value for key, value in vars(judgment).items()}
        retention = self._retention_of(judgment) if waveform else None
        facts |= {"machine_id": self._id, "waveform": waveform, "retention": retention}
        newest = self.newest()
        recording = self._insert(recordings, facts)
        self._absent.discard(judgment.content)
        if values:
            self._add_indicators(recording, values)
        tally = {"machine_id": self._id, "state": judgment.state, "recordings": 1}
        upsert(self._connection, tallies, tally, ("machine_id", "state"), counter="recordings")
        if newest is None or judgment.time >= newest:
            self._connection.execute(_SET_LAST, {"machine": self._id, "recording": recording})
        if waveform:
            self._apply_retention()
        return recording

    def _add_indicators(self, recording: int, values: Mapping[tuple[str, str], float]) -> None:
        names = [list(name) for name in values]
        digest = hashlib.sha256(json_text(names).encode()).hexdigest()
        layout = self._scalar(_LAYOUT, digest=digest)
        if layout is None:
            layout = self._insert(layouts, {"machine_id": self._id, "digest": digest, "names": names})
        packed = np.fromiter(values.values(), "<f4", len(values)).tobytes()
        row = {"recording_id": recording, "layout_id": layout, "values": packed}
        self._connection.execute(_ADD_INDICATORS, row)

    def _retention_of(self, judgment: Judgment) -> str:
        if judgment.state == "alarm":
            return "alarm"
        day = judgment.time.astimezone(UTC).replace(hour=0, minute=0, second=0, microsecond=0)
        query = select(func.count()).where(
            recordings.c.machine_id == self._id,
            recordings.c.retention == "day",
            recordings.c.waveform.is_not(None),
            recordings.c.time >= day,
            recordings.c.time < day + timedelta(days=1),
        )
        return "day" if self._connection.execute(query).scalar_one() < self._retention.per_day else "last"

    def _apply_retention(self) -> None:
        for retention, count in (("last", self._retention.last), ("alarm", self._retention.alarms)):
            if count is None:
                continue
            query = (
                select(recordings.c.id, recordings.c.waveform)
                .where(
                    recordings.c.machine_id == self._id,
                    recordings.c.retention == retention,
                    recordings.c.waveform.is_not(None),
                )
                .order_by(recordings.c.time.desc(), recordings.c.id.desc())
                .offset(count)
            )
            surplus = self._connection.execute(query).all()
            self.dropped += [row.waveform for row in surplus]
            if surplus:
                ids = [row.id for row in surplus]
                self._connection.execute(update(recordings).where(recordings.c.id.in_(ids)).values(waveform=None))

    def open_alarm(
        self, kind: str, point: str | None, time: datetime, evidence: Mapping[str, Any], recording: int | None
    ) -> int:
        """Number of a new alarm; the waveforms of the recordings before it are kept with it.

        Parameters
        ----------
        kind : ``pump`` or ``sensor``.
        evidence : why, as JSON can hold it.
        recording : recording that raised it.
        """
        run_up = (
            select(recordings.c.id)
            .where(recordings.c.machine_id == self._id, recordings.c.waveform.is_not(None))
            .order_by(recordings.c.time.desc())
            .limit(_RUN_UP)
        )
        self._connection.execute(update(recordings).where(recordings.c.id.in_(run_up)).values(retention="alarm"))
        values = {"kind": kind, "point": point, "opened": time, "evidence": evidence, "recording": recording}
        return self._insert(alarms, {"machine_id": self._id, "state": "open", **values})

    def alarms(self) -> tuple[Alarm, ...]:
        """Alarms that are not closed, oldest first."""
        return rows.open_alarms(self._connection, self.name)

    def untold_alarms(self) -> tuple[Alarm, ...]:
        """Those of `alarms` about which no message was posted."""
        alarms = self.alarms()
        if not alarms:
            return ()
        query = select(outbox.c.alarm).where(outbox.c.alarm.in_([alarm.id for alarm in alarms])).distinct()
        numbers = set(self._connection.execute(query).scalars())
        return tuple(alarm for alarm in alarms if alarm.id not in numbers)

    def clear_alarm(self, alarm: int, time: datetime) -> None:
        """Note that the cause of an alarm is gone; an acknowledged one is closed, an open one waits for a person."""
        changes: dict[str, Any] = {"cleared": time}
        if self._state(alarm) == "acknowledged":
            changes |= {"state": "closed", "closed": time}
        self._change(alarm, **changes)

    def raise_alarm(self, alarm: int) -> None:
        """Note that the cause of an alarm is back before somebody acknowledged it."""
        self._change(alarm, cleared=None)

    def acknowledge(self, alarm: int, who: str, note: str = "", time: datetime | None = None) -> None:
        """Note who acknowledged an alarm; one whose cause is gone is closed.

        Raises
        ------
        InputError
            The machine has no such alarm, or it is acknowledged already.
        """
        if (state := self._state(alarm)) != "open":
            raise InputError(f"alarm {alarm} of {self.name} is {state} already.")
        time = time or datetime.now(UTC)
        cleared = self._connection.execute(select(alarms.c.cleared).where(alarms.c.id == alarm)).scalar()
        changes: dict[str, Any] = {"who": who, "note": note, "acknowledged": time, "state": "acknowledged"}
        if cleared is not None:
            changes |= {"state": "closed", "closed": time}
        self._change(alarm, **changes)

    def _state(self, alarm: int) -> str:
        where = (alarms.c.id == alarm, alarms.c.machine_id == self._id)
        state = self._connection.execute(select(alarms.c.state).where(*where)).scalar()
        if state is None:
            raise InputError(f"{self.name} has no alarm {alarm}.")
        return str(state)

    def _change(self, alarm: int, **changes: Any) -> None:
        where = (alarms.c.id == alarm, alarms.c.machine_id == self._id)
        self._connection.execute(update(alarms).where(*where).values(**changes))

    def silence(self, until: datetime, who: str, note: str = "") -> int:
        """Number of a new silence: no messages are sent until then; the record goes on."""
        values = {"since": datetime.now(UTC), "until": until, "who": who, "note": note}
        return self._insert(silences, {"machine_id": self._id, **values})

    def end_silence(self, time: datetime | None = None) -> None:
        """End every silence of the machine."""
        time = time or datetime.now(UTC)
        where = (silences.c.machine_id == self._id, silences.c.until > time)
        self._connection.execute(update(silences).where(*where).values(until=time))

    def silenced(self, time: datetime) -> bool:
        """Whether a silence holds at that time."""
        where = (silences.c.machine_id == self._id, silences.c.since <= time, silences.c.until > time)
        return self._connection.execute(select(silences.c.id).where(*where).limit(1)).first() is not None

    def add_event(self, kind: str, who: str, note: str = "", time: datetime | None = None) -> int:
        """Number of a new event, such as ``maintenance``."""
        values = {"kind": kind, "who": who, "note": note, "time": time or datetime.now(UTC)}
        return self._insert(events, {"machine_id": self._id, **values})

    def last_event(self, kind: str) -> Event | None:
        """The latest event of a kind, or None."""
        return rows.last_event(self._connection, self.name, kind)

    def post(self, channel: str, message: Mapping[str, Any], alarm: int | None = None) -> int:
        """Number of a message that `Outbox` hands to a sender once this transaction is committed."""
        now = datetime.now(UTC)
        values = {"channel": channel, "body": message, "alarm": alarm, "created": now, "due": now}
        return self._insert(outbox, {"machine_id": self._id, **values})

    def add_recalibration(self, time: datetime, estimates: tuple[Estimate, ...], note: str = "") -> int:
        """Number of new values of the machine's twin."""
        values = {"time": time, "estimates": [asdict(estimate) for estimate in estimates], "note": note}
        return self._insert(recalibrations, {"machine_id": self._id, **values})

    def _scalar(self, query: Select[Any], **values: Any) -> Any:
        return self._connection.execute(query, {"machine": self._id, **values}).scalar()

    def _insert(self, table: Table, values: Mapping[str, Any]) -> int:
        return int(self._connection.execute(_insertion(table), values).scalar_one())


def lock_machine(connection: Connection, name: str) -> int:
    """Number of a machine, which is locked until the transaction ends, and filed if it is new."""
    number = connection.execute(_LOCK, {"machine": name}).scalar()
    if number is None:
        upsert(connection, machines, {"name": name, "sequence": 0}, ("name",))
        number = connection.execute(_LOCK, {"machine": name}).scalar_one()
    return int(number)


def upsert(
    connection: Connection, table: Table, values: Mapping[str, Any], key: tuple[str, ...], counter: str = ""
) -> None:
    """Insert a row, or change the one that has the key.

    Parameters
    ----------
    key : columns that say which row it is.
    counter : column to which the value is added where the row is there.
    """
    connection.execute(_upsertion(connection.dialect.name, table, tuple(values), key, counter), values)


@cache
def _insertion(table: Table) -> Any:
    return insert(table).returning(table.c.id)


@cache
def _upsertion(dialect: str, table: Table, columns: tuple[str, ...], key: tuple[str, ...], counter: str) -> Any:
    new = (postgresql if dialect == "postgresql" else sqlite).insert(table)
    changes = {
        name: table.c[name] + new.excluded[name] if name == counter else new.excluded[name]
        for name in columns
        if name not in key
    }
    return new.on_conflict_do_update(index_elements=list(key), set_=changes)


def _number(value: float | None) -> float | None:
    """A number that both databases hold: NaN is nothing, infinity the largest."""
    if value is None or math.isnan(value):
        return None
    return max(-sys.float_info.max, min(float(value), sys.float_info.max))
