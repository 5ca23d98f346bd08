"""What is written to the history of one machine, in one transaction that locks it."""

import hashlib
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
from sqlalchemy import ColumnElement, delete, func, select, update
from sqlalchemy.orm import Session

from swashtwin.foundation import InputError
from swashtwin.monitoring.config.settings import Retention
from swashtwin.monitoring.history.database import json_text, lock_machine
from swashtwin.monitoring.history.schema import (
    Alarm,
    Baseline,
    Event,
    Indicators,
    Judgment,
    Layout,
    Machine,
    Message,
    OperatingPointRow,
    Row,
    Silence,
    Tally,
)

_RUN_UP = 10
"""Recordings before an alarm whose waveforms are kept with it."""
_AS_IT_IS = {"synchronize_session": False}
"""Option of changes of many rows: objects in memory stay as they are, nobody reads them again."""


class MachineTransaction:
    """Reads and writes of one machine, which stays locked until the transaction ends."""

    def __init__(self, session: Session, name: str, retention: Retention) -> None:
        self.name = name
        self.dropped: list[str] = []
        """Waveforms to remove once the transaction is committed."""
        self._session = session
        self._retention = retention
        lock_machine(session, name)

    def recording_of(self, content: str) -> Judgment | None:
        """The recording with that content, or None."""
        query = select(Judgment).where(Judgment.machine == self.name, Judgment.content == content)
        return self._session.scalars(query).first()

    def newest(self) -> datetime | None:
        """Time of the newest recording, or None."""
        return self._session.scalars(
            select(func.max(Judgment.time)).where(Judgment.machine == self.name)
        ).one()

    def operating_points(self) -> Sequence[OperatingPointRow]:
        """Operating points of the machine, without what was learned there, which is large."""
        return self._session.scalars(
            select(OperatingPointRow)
            .where(OperatingPointRow.machine == self.name)
            .order_by(OperatingPointRow.name)
        ).all()

    def operating_point(self, name: str) -> OperatingPointRow | None:
        """Operating point of that name, or None."""
        return self._session.get(OperatingPointRow, (self.name, name))

    def baseline(self, point: str) -> dict[str, Any] | None:
        """What was learned at an operating point, or None."""
        stored = self._session.get(Baseline, (self.name, point))
        return None if stored is None else stored.baseline

    def save_operating_point(
        self,
        name: str,
        *,
        test: Mapping[str, Any],
        baseline: Mapping[str, Any] | None = None,
        speed: float | None = None,
        pressure: float | None = None,
    ) -> None:
        """Keep the state of an operating point.

        Parameters
        ----------
        test : what changes with each recording.
        baseline : what is large and changes rarely; None leaves it as it is.
        speed : angular speed of the shaft [rad/s].
        pressure : discharge pressure [Pa].
        """
        point = OperatingPointRow(
            machine=self.name, name=name, speed=speed, pressure=pressure, test=dict(test)
        )
        self._session.merge(point)
        if baseline is not None:
            self._session.merge(Baseline(machine=self.name, point=name, baseline=dict(baseline)))

    def forget_operating_points(self) -> None:
        """Remove what was learned at all operating points, so that it is learned anew."""
        for kind in (OperatingPointRow, Baseline):
            self._session.execute(delete(kind).where(kind.machine == self.name))

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
        """
        judgment.waveform = waveform
        judgment.retention = self._retention_of(judgment) if waveform else None
        newest = self.newest()
        number = self._add(judgment)
        if values:
            self._add_indicators(number, values)
        tally = self._session.get(Tally, (self.name, judgment.state))
        if tally is None:
            tally = Tally(machine=self.name, state=judgment.state)
            self._session.add(tally)
        tally.recordings += 1
        if newest is None or judgment.time >= newest:
            last = update(Machine).where(Machine.name == self.name).values(last=number)
            self._session.execute(last, execution_options=_AS_IT_IS)
        if waveform:
            self._apply_retention()
        return number

    def _add_indicators(self, recording: int, values: Mapping[tuple[str, str], float]) -> None:
        names = [list(name) for name in values]
        digest = hashlib.sha256(json_text(names).encode()).hexdigest()
        query = select(Layout.id).where(Layout.machine == self.name, Layout.digest == digest)
        layout = self._session.scalars(query).first()
        if layout is None:
            layout = self._add(Layout(digest=digest, names=names))
        packed = np.fromiter(values.values(), "<f4", len(values)).tobytes()
        self._session.add(Indicators(recording=recording, layout=layout, values=packed))

    def _with_waveform(self, *where: ColumnElement[bool]) -> tuple[ColumnElement[bool], ...]:
        return (Judgment.machine == self.name, Judgment.waveform.is_not(None), *where)

    def _retention_of(self, judgment: Judgment) -> str:
        if judgment.state == "alarm":
            return "alarm"
        day = judgment.time.astimezone(UTC).replace(hour=0, minute=0, second=0, microsecond=0)
        of_day = (
            Judgment.retention == "day",
            Judgment.time >= day,
            Judgment.time < day + timedelta(days=1),
        )
        count = self._session.scalars(
            select(func.count()).where(*self._with_waveform(*of_day))
        ).one()
        return "day" if count < self._retention.per_day else "last"

    def _apply_retention(self) -> None:
        for retention, count in (
            ("last", self._retention.latest),
            ("alarm", self._retention.alarms),
        ):
            if count == "all":
                continue
            query = select(Judgment.id, Judgment.waveform).where(
                *self._with_waveform(Judgment.retention == retention)
            )
            newest_first = query.order_by(Judgment.time.desc(), Judgment.id.desc())
            surplus = {
                number: path
                for number, path in self._session.execute(newest_first.offset(count))
                if path
            }
            self.dropped += surplus.values()
            if surplus:
                drop = update(Judgment).where(Judgment.id.in_(surplus)).values(waveform=None)
                self._session.execute(drop, execution_options=_AS_IT_IS)

    def open_alarm(
        self,
        kind: str,
        point: str | None,
        time: datetime,
        evidence: Mapping[str, Any],
        recording: int | None,
    ) -> Alarm:
        """A new alarm; the waveforms of the recordings before it are kept with it.

        Parameters
        ----------
        kind : ``pump`` or ``sensor``.
        evidence : why, as JSON can hold it.
        recording : recording that raised it.
        """
        run_up = (
            select(Judgment.id)
            .where(*self._with_waveform())
            .order_by(Judgment.time.desc())
            .limit(_RUN_UP)
        )
        keep = update(Judgment).where(Judgment.id.in_(run_up)).values(retention="alarm")
        self._session.execute(keep, execution_options=_AS_IT_IS)
        alarm = Alarm(
            kind=kind, point=point, opened=time, evidence=dict(evidence), recording=recording
        )
        self._add(alarm)
        return alarm

    def alarms(self) -> Sequence[Alarm]:
        """Alarms that are not closed, oldest first."""
        query = (
            select(Alarm)
            .where(Alarm.machine == self.name, Alarm.closed.is_(None))
            .order_by(Alarm.id)
        )
        return self._session.scalars(query).all()

    def unreported_alarms(self) -> Sequence[Alarm]:
        """Those of `alarms` about which no message was posted."""
        alarms = self.alarms()
        query = select(Message.alarm).where(Message.alarm.in_([alarm.id for alarm in alarms]))
        told = set(self._session.scalars(query)) if alarms else set()
        return [alarm for alarm in alarms if alarm.id not in told]

    def clear_alarm(self, alarm: int, time: datetime) -> None:
        """Note that the cause of an alarm is gone; an acknowledged one is closed, an open one waits
        for a person.
        """
        stored = self._alarm(alarm)
        stored.cleared = time
        if stored.state == "acknowledged":
            stored.state, stored.closed = "closed", time

    def acknowledge(self, alarm: int, who: str, note: str = "") -> None:
        """Note who acknowledged an alarm; one whose cause is gone is closed.

        Raises
        ------
        InputError
            The machine has no such alarm, or it is acknowledged already.
        """
        stored = self._alarm(alarm)
        if stored.state != "open":
            raise InputError(f"alarm {alarm} of {self.name} is {stored.state} already.")
        time = datetime.now(UTC)
        stored.who, stored.note, stored.acknowledged, stored.state = who, note, time, "acknowledged"
        if stored.cleared is not None:
            stored.state, stored.closed = "closed", time

    def record_finding(self, found: str, who: str) -> None:
        """Keep what was wrong with the machine in the evidence of its newest alarm of the pump.

        Raises
        ------
        InputError
            It never had one.
        """
        query = (
            select(Alarm)
            .where(Alarm.machine == self.name, Alarm.kind == "pump")
            .order_by(Alarm.id.desc())
            .limit(1)
        )
        alarm = self._session.scalars(query).first()
        if alarm is None:
            raise InputError(
                f"{self.name} had no alarm that {found!r} could stand beside; write it as a note."
            )
        alarm.evidence = {
            **alarm.evidence,
            "found": {"text": found, "who": who, "time": datetime.now(UTC).isoformat()},
        }

    def record_severity(self, alarm: int, severity: Mapping[str, Any]) -> Alarm | None:
        """An alarm, in whose evidence the severity of its suspect is kept now; None where one or
        the same reason is.
        """
        stored = self._alarm(alarm)
        before = stored.evidence.get("severity", {})
        same = all(before.get(name) == severity.get(name) for name in ("label", "certainty"))
        if same and ("verdict" in before or before["sentence"] == severity["sentence"]):
            return None
        stored.evidence = {**stored.evidence, "severity": dict(severity)}
        return stored

    def _alarm(self, number: int) -> Alarm:
        stored = self._session.get(Alarm, number)
        if stored is None or stored.machine != self.name:
            raise InputError(f"{self.name} has no alarm {number}.")
        return stored

    def silence(self, until: datetime, who: str, note: str = "") -> int:
        """Number of a new silence: no messages are sent until then; the record goes on."""
        return self._add(Silence(since=datetime.now(UTC), until=until, who=who, note=note))

    def end_silence(self) -> None:
        """End every silence of the machine."""
        time = datetime.now(UTC)
        end = (
            update(Silence)
            .where(Silence.machine == self.name, Silence.until > time)
            .values(until=time)
        )
        self._session.execute(end, execution_options=_AS_IT_IS)

    def silenced(self, time: datetime) -> bool:
        """Whether a silence holds at that time."""
        holds = (Silence.machine == self.name, Silence.since <= time, Silence.until > time)
        return self._session.scalars(select(Silence.id).where(*holds).limit(1)).first() is not None

    def add_event(self, kind: str, who: str, note: str = "") -> int:
        """Number of a new event, such as ``maintenance``."""
        return self._add(Event(kind=kind, who=who, note=note, time=datetime.now(UTC)))

    def post(self, channel: str, message: Mapping[str, Any], alarm: int | None = None) -> int:
        """Number of a message that `Outbox` hands to a sender once this transaction is
        committed.
        """
        now = datetime.now(UTC)
        return self._add(
            Message(channel=channel, body=dict(message), alarm=alarm, created=now, due=now)
        )

    def _add(self, row: Row) -> int:
        row.machine = self.name  # type: ignore[attr-defined]
        self._session.add(row)
        self._session.flush()
        return int(row.id)  # type: ignore[attr-defined]
