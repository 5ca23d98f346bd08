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
    DeliveryRow,
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

N_RUN_UP = 10
"""Recordings before an alarm whose waveforms are kept with it: they show how it developed."""

# Option of a change of many rows: objects in memory are not updated, since nobody reads them again.
_WITHOUT_OBJECTS = {"synchronize_session": False}


class MachineTransaction:
    """Reads and writes of one machine, which stays locked until the transaction ends."""

    def __init__(self, session: Session, name: str, retention: Retention) -> None:
        self.name = name
        self.dropped: list[str] = []
        """Waveforms to remove when the transaction is committed."""
        self._session = session
        self._retention = retention
        lock_machine(session, name)

    # Recordings

    def recording_of(self, content: str) -> Judgment | None:
        """Return the recording with that content, or None."""
        query = select(Judgment).where(Judgment.machine == self.name, Judgment.content == content)
        return self._session.scalars(query).first()

    def newest(self) -> datetime | None:
        """Return the time of the newest recording, or None."""
        query = select(func.max(Judgment.time)).where(Judgment.machine == self.name)
        return self._session.scalars(query).one()

    def is_newest(self, recording: int) -> bool:
        """Return whether a recording is the newest of the machine."""
        query = select(Machine.last).where(Machine.name == self.name)
        return self._session.scalars(query).first() == recording

    def was_judged(self, source: str, received: Sequence[datetime]) -> bool:
        """Return whether a delivery of one of these times was judged."""
        query = select(Judgment.id).where(
            Judgment.machine == self.name,
            Judgment.source == source,
            Judgment.received.in_(received),
        )
        return self._session.scalars(query).first() is not None

    def add_recording(
        self,
        judgment: Judgment,
        values: Mapping[tuple[str, str], float] | None = None,
        waveform: str | None = None,
        *,
        is_newest: bool | None = None,
    ) -> int:
        """Add a recording, and return its number.

        Parameters
        ----------
        values : indicators by channel and name; kept with the seven digits of a float32.
        waveform : path that `Waveforms.write` returned; retention decides how long the file is
            kept.
        is_newest : whether the machine's newest recording becomes this one; by default if no other
            one has a later time.
        """
        judgment.waveform = waveform
        judgment.retention = None
        if waveform:
            judgment.retention = self._retention_of(judgment)
        if is_newest is None:
            newest = self.newest()
            # One that arrived late does not become the newest.
            is_newest = newest is None or judgment.time >= newest

        number = self._add(judgment)

        if values:
            self._add_indicators(number, values)
        self._count(judgment.state)
        if is_newest:
            self._execute(update(Machine).where(Machine.name == self.name).values(last=number))
        if waveform:
            self._apply_retention()
        return number

    def _add_indicators(self, recording: int, values: Mapping[tuple[str, str], float]) -> None:
        names = [list(name) for name in values]
        digest = hashlib.sha256(json_text(names).encode()).hexdigest()
        query = select(Layout.id).where(Layout.machine == self.name, Layout.digest == digest)
        layout = self._session.scalars(query).first()

        # Recordings have the same names day by day, so they are stored once and not with each.
        if layout is None:
            layout = self._add(Layout(digest=digest, names=names))

        packed_values = np.fromiter(values.values(), "<f4", len(values)).tobytes()
        self._session.add(Indicators(recording=recording, layout=layout, values=packed_values))

    def _count(self, state: str) -> None:
        tally = self._session.get(Tally, (self.name, state))
        if tally is None:
            tally = Tally(machine=self.name, state=state)
            self._session.add(tally)
        tally.recordings += 1

    # Retention of waveforms

    def _with_waveform(self, *filters: ColumnElement[bool]) -> tuple[ColumnElement[bool], ...]:
        return (Judgment.machine == self.name, Judgment.waveform.is_not(None), *filters)

    def _retention_of(self, judgment: Judgment) -> str:
        """Return why the waveform of a recording is kept."""
        if judgment.state == "alarm":
            return "alarm"

        day = judgment.time.astimezone(UTC).replace(hour=0, minute=0, second=0, microsecond=0)
        # The day is that of UTC, so that daylight saving time makes none of 23 or 25 hours.
        is_of_day = self._with_waveform(
            Judgment.retention == "day",
            Judgment.time >= day,
            Judgment.time < day + timedelta(days=1),
        )
        count = self._session.scalars(select(func.count()).where(*is_of_day)).one()
        if count < self._retention.per_day:
            return "day"
        return "last"

    def _apply_retention(self) -> None:
        """Drop the waveforms that exceed the limits of retention, oldest first."""
        self._keep_newest("last", self._retention.latest)
        if self._retention.alarms != "all":
            self._keep_newest("alarm", self._retention.alarms)

    def _keep_newest(self, retention: str, count: int) -> None:
        surplus_query = (
            select(Judgment.id, Judgment.waveform)
            .where(*self._with_waveform(Judgment.retention == retention))
            .order_by(Judgment.time.desc(), Judgment.id.desc())
            .offset(count)
        )
        surplus = {number: path for number, path in self._session.execute(surplus_query) if path}
        if not surplus:
            return

        self.dropped += surplus.values()
        self._execute(update(Judgment).where(Judgment.id.in_(surplus)).values(waveform=None))

    # Operating points

    def operating_points(self) -> Sequence[OperatingPointRow]:
        """Return the operating points of the machine, without their large baselines."""
        return self._session.scalars(
            select(OperatingPointRow)
            .where(OperatingPointRow.machine == self.name)
            .order_by(OperatingPointRow.name)
        ).all()

    def operating_point(self, name: str) -> OperatingPointRow | None:
        """Return the operating point with that name, or None."""
        return self._session.get(OperatingPointRow, (self.name, name))

    def baseline(self, point: str) -> dict[str, Any] | None:
        """Return the baseline of an operating point, or None."""
        stored = self._session.get(Baseline, (self.name, point))
        if stored is None:
            return None
        return stored.baseline

    def save_operating_point(
        self,
        name: str,
        *,
        test: Mapping[str, Any],
        baseline: Mapping[str, Any] | None = None,
        speed: float | None = None,
        pressure: float | None = None,
    ) -> None:
        """Save the state of an operating point.

        Parameters
        ----------
        test : what changes with each recording.
        baseline : what is large and changes rarely; None leaves the stored one unchanged.
        speed : angular speed of the shaft [rad/s].
        pressure : discharge pressure [Pa].
        """
        row = OperatingPointRow(
            machine=self.name, name=name, speed=speed, pressure=pressure, test=dict(test)
        )
        self._session.merge(row)
        if baseline is not None:
            self._session.merge(Baseline(machine=self.name, point=name, baseline=dict(baseline)))

    def forget_operating_points(self) -> None:
        """Remove all operating points with their baselines, so that they are learned again."""
        for table in (OperatingPointRow, Baseline):
            self._session.execute(delete(table).where(table.machine == self.name))

    # Deliveries

    def delivery_state(self) -> dict[str, Any] | None:
        """Return what is remembered of the machine's deliveries, or None."""
        stored = self._session.get(DeliveryRow, self.name)
        if stored is None:
            return None
        return stored.state

    def save_delivery_state(self, state: Mapping[str, Any]) -> None:
        """Remember the state of the machine's deliveries."""
        self._session.merge(DeliveryRow(machine=self.name, state=dict(state)))

    # Alarms

    def open_alarm(
        self,
        kind: str,
        point: str | None,
        time: datetime,
        evidence: Mapping[str, Any],
        recording: int | None,
    ) -> Alarm:
        """Open an alarm, and keep the waveforms of the recordings before it.

        Parameters
        ----------
        kind : ``pump``, ``sensor`` or ``delivery``.
        evidence : why, as JSON can hold it.
        recording : recording that raised it.
        """
        run_up = (
            select(Judgment.id)
            .where(*self._with_waveform())
            .order_by(Judgment.time.desc())
            .limit(N_RUN_UP)
        )
        self._execute(update(Judgment).where(Judgment.id.in_(run_up)).values(retention="alarm"))

        alarm = Alarm(
            kind=kind, point=point, opened=time, evidence=dict(evidence), recording=recording
        )
        self._add(alarm)
        return alarm

    def alarms(self) -> Sequence[Alarm]:
        """Return the alarms that are not closed, oldest first."""
        query = (
            select(Alarm)
            .where(Alarm.machine == self.name, Alarm.closed.is_(None))
            .order_by(Alarm.id)
        )
        return self._session.scalars(query).all()

    def unreported_alarms(self) -> Sequence[Alarm]:
        """Return the alarms of `alarms` about which no message was posted."""
        alarms = self.alarms()
        if not alarms:
            return ()
        query = select(Message.alarm).where(Message.alarm.in_([alarm.id for alarm in alarms]))
        reported_numbers = set(self._session.scalars(query))
        return [alarm for alarm in alarms if alarm.id not in reported_numbers]

    def clear_alarm(self, alarm: int, time: datetime) -> None:
        """Record that the cause of an alarm is gone.

        An acknowledged alarm is closed; an open one waits for a person.
        """
        stored = self._alarm(alarm)
        stored.cleared = time
        if stored.state == "acknowledged":
            stored.state = "closed"
            stored.closed = time

    def acknowledge(self, alarm: int, who: str, note: str = "") -> None:
        """Record who acknowledged an alarm; if its cause is gone, it is closed.

        Raises
        ------
        InputError
            The machine has no such alarm, or it is acknowledged already.
        """
        stored = self._alarm(alarm)
        if stored.state != "open":
            raise InputError(f"alarm {alarm} of {self.name} is {stored.state} already.")

        time = datetime.now(UTC)
        stored.who = who
        stored.note = note
        stored.acknowledged = time
        stored.state = "acknowledged"
        if stored.cleared is not None:
            stored.state = "closed"
            stored.closed = time

    def record_finding(self, finding: str, who: str) -> None:
        """Keep what was wrong with the machine in the evidence of its newest alarm of the pump.

        Raises
        ------
        InputError
            The machine never had such an alarm.
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
                f"{self.name} had no alarm of the pump with which {finding!r} could be kept; "
                "write it as a note."
            )

        entry = {"text": finding, "who": who, "time": datetime.now(UTC).isoformat()}
        alarm.evidence = {**alarm.evidence, "found": entry}

    def record_severity(self, alarm: int, severity: Mapping[str, Any]) -> Alarm | None:
        """Keep the severity of an alarm's suspect in its evidence, and return the alarm.

        None is returned if nothing new is known: the alarm has a severity of this recording and
        suspect, or the same reason why there is none. If a measured severity could not be measured
        anew, it stays, and the reason is kept with it as ``not_measured``.
        """
        stored = self._alarm(alarm)
        previous = stored.evidence.get("severity", {})
        is_same_suspect = all(
            previous.get(name) == severity.get(name) for name in ("label", "certainty")
        )
        is_same_recording = previous.get("recording") == severity["recording"]
        was_measured = "verdict" in previous
        has_failed = "verdict" not in severity
        if is_same_suspect and was_measured and is_same_recording:
            return None
        if is_same_suspect and previous.get("sentence") == severity["sentence"] and has_failed:
            return None

        # A new dictionary: SQLAlchemy does not see a change inside of the old one.
        if was_measured and has_failed and previous["label"] == severity["label"]:
            reason = {name: severity[name] for name in ("sentence", "recording", "time")}
            kept_severity = {**previous, "not_measured": reason}
            stored.evidence = {**stored.evidence, "severity": kept_severity}
            return None
        kept_severity = dict(severity)
        if "course" in previous:
            # what failed, or is of another suspect, does not end the course
            kept_severity.setdefault("course", previous["course"])
        stored.evidence = {**stored.evidence, "severity": kept_severity}
        return stored

    def _alarm(self, number: int) -> Alarm:
        stored = self._session.get(Alarm, number)
        if stored is None or stored.machine != self.name:
            raise InputError(f"{self.name} has no alarm {number}.")
        return stored

    # Silences, events and messages

    def silence(self, until: datetime, who: str, note: str = "") -> int:
        """Add a silence, in which no messages are sent, and return its number."""
        return self._add(Silence(since=datetime.now(UTC), until=until, who=who, note=note))

    def end_silence(self) -> None:
        """End every silence of the machine."""
        time = datetime.now(UTC)
        self._execute(
            update(Silence)
            .where(Silence.machine == self.name, Silence.until > time)
            .values(until=time)
        )

    def silenced(self, time: datetime) -> bool:
        """Return whether the machine is silenced at that time."""
        query = (
            select(Silence.id)
            .where(Silence.machine == self.name, Silence.since <= time, Silence.until > time)
            .limit(1)
        )
        return self._session.scalars(query).first() is not None

    def add_event(self, kind: str, who: str, note: str = "") -> int:
        """Add an event, such as ``maintenance``, and return its number."""
        return self._add(Event(kind=kind, who=who, note=note, time=datetime.now(UTC)))

    def post(self, channel: str, message: Mapping[str, Any], alarm: int | None = None) -> int:
        """Add a message, and return its number.

        `Outbox` hands it to a sender when this transaction is committed.
        """
        now = datetime.now(UTC)
        return self._add(
            Message(channel=channel, body=dict(message), alarm=alarm, created=now, due=now)
        )

    def _execute(self, change: Any) -> None:
        self._session.execute(change, execution_options=_WITHOUT_OBJECTS)

    def _add(self, row: Row) -> int:
        """Add a row of this machine, and return its number."""
        row.machine = self.name  # type: ignore[attr-defined]
        self._session.add(row)
        self._session.flush()  # the database numbers the row
        return int(row.id)  # type: ignore[attr-defined]
