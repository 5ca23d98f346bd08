"""What the page and other readers ask of the history."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
from jaxtyping import Float, Int, Shaped
from sqlalchemy import ColumnElement, Select, func, select

from swashtwin.foundation import InputError
from swashtwin.monitoring.history.database import Database, Waveforms
from swashtwin.monitoring.history.schema import (
    Alarm,
    Baseline,
    Event,
    Indicators,
    Judgment,
    Layout,
    Machine,
    OperatingPointRow,
    Rejection,
    Silence,
    Tally,
)
from swashtwin.recordings import Recording

TREND_COLUMNS = ("alarm_p", "capital", "probability", "confidence", "ood_p", "speed", "pressure")
"""Columns of recordings that have a trend; their channel is empty."""

_SEARCH = 200
"""Newest recordings of a state among which healthy ones are looked for."""
Names = tuple[tuple[str, str], ...]
"""Channel and name of each indicator."""


@dataclass(frozen=True)
class MachineOverview:
    """One machine at a glance."""

    name: str
    """Name."""
    recordings: int = 0
    """How many recordings it has."""
    last: Judgment | None = None
    """The newest by time of measurement."""
    alarms: Sequence[Alarm] = ()
    """Alarms that are not closed."""
    silenced: datetime | None = None
    """Until when it is silent, or None."""
    maintained: datetime | None = None
    """When its newest maintenance was noted, or None."""


@dataclass(frozen=True)
class Trend:
    """One indicator of a machine over time, oldest first."""

    ids: Int[np.ndarray, " recording"]
    """Recordings."""
    times: Shaped[np.ndarray, " recording"]
    """When they were measured, as datetime64 in UTC."""
    values: Float[np.ndarray, " recording"]
    """The indicator; NaN where a recording has none."""


class HistoryReader:
    """Reads of the history, each in a transaction of its own.

    Every method raises `HistoryError` where the database cannot be read.
    """

    def __init__(self, database: Database, waveforms: Waveforms) -> None:
        self._database = database
        self._waveforms = waveforms

    def _all(self, query: Select[Any]) -> Sequence[Any]:
        with self._database.reading() as session:
            return session.scalars(query).all()

    def sequence(self) -> int:
        """A number that grows with each change of the history."""
        return int(self._all(select(func.sum(Machine.sequence)))[0])

    def machines(self) -> Sequence[MachineOverview]:
        """Each machine at a glance, by name."""
        latest = select(Machine.name, Judgment).outerjoin(Judgment, Judgment.id == Machine.last)
        tallies = select(Tally.machine, func.sum(Tally.recordings)).group_by(Tally.machine)
        open_alarms = select(Alarm).where(Alarm.closed.is_(None)).order_by(Alarm.id)
        now = datetime.now(UTC)
        silences = select(Silence.machine, func.max(Silence.until)).where(
            Silence.since <= now, Silence.until > now
        )
        events = select(Event.machine, func.max(Event.time)).where(Event.kind == "maintenance")
        with self._database.reading() as session:
            counts = dict(session.execute(tallies).all())
            silenced = dict(session.execute(silences.group_by(Silence.machine)).all())
            maintained = dict(session.execute(events.group_by(Event.machine)).all())
            alarms: dict[str, list[Alarm]] = defaultdict(list)
            for alarm in session.scalars(open_alarms):
                alarms[alarm.machine].append(alarm)
            rows = session.execute(latest.where(Machine.name != "").order_by(Machine.name)).all()
        return [
            MachineOverview(
                name,
                int(counts.get(name, 0)),
                last,
                tuple(alarms[name]),
                silenced.get(name),
                maintained.get(name),
            )
            for name, last in rows
        ]

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
    ) -> Sequence[Judgment]:
        """Recordings, newest first by time of measurement.

        Parameters
        ----------
        since : earliest time of measurement.
        until : time of measurement from which on recordings are left out.
        before : number of a recording: the next older ones follow.
        """
        query = select(Judgment).where(*_within(machine, point, since, until))
        if state is not None:
            query = query.where(Judgment.state == state)
        if before is not None:
            time = select(Judgment.time).where(Judgment.id == before).scalar_subquery()
            query = query.where(
                (Judgment.time < time) | ((Judgment.time == time) & (Judgment.id < before))
            )
        return self._all(query.order_by(Judgment.time.desc(), Judgment.id.desc()).limit(limit))

    def recording(self, number: int) -> Judgment | None:
        """Recording of that number, or None."""
        with self._database.reading() as session:
            return session.get(Judgment, number)

    def healthy_files(self, judgment: Judgment, limit: int) -> dict[int, str]:
        """Healthy recordings at the operating point of another, those of the baseline first, with
        their waveforms.
        """
        files: dict[int, str] = {}
        for state in ("learning", "normal"):
            others = self.recordings(
                judgment.machine, point=judgment.point, state=state, limit=_SEARCH
            )
            files |= {
                other.id: other.waveform
                for other in others
                if other.waveform and other.id != judgment.id
            }
        return dict(list(files.items())[:limit])

    def later_recording(self, number: int) -> int | None:
        """Number of the recording of the same machine that was measured next, or None."""
        this = select(Judgment.machine, Judgment.time).where(Judgment.id == number).subquery()
        query = (
            select(Judgment.id)
            .join(this, Judgment.machine == this.c.machine)
            .where(
                (Judgment.time > this.c.time)
                | ((Judgment.time == this.c.time) & (Judgment.id > number))
            )
            .order_by(Judgment.time, Judgment.id)
            .limit(1)
        )
        return next(iter(self._all(query)), None)

    def waveform(self, number: int) -> Recording | None:
        """Samples of a recording, or None where they are not kept."""
        stored = self.recording(number)
        return (
            None
            if stored is None or stored.waveform is None
            else self._waveforms.read(stored.waveform)
        )

    def indicator_names(self, machine: str) -> Names:
        """Channel and name of each indicator that recordings of the machine have."""
        layouts = self._all(
            select(Layout.names).where(Layout.machine == machine).order_by(Layout.id.desc())
        )
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
        channel : empty for facts of the whole recording: ``alarm_p``, ``capital``, ``probability``,
            ``confidence``, ``ood_p``, ``speed`` [rad/s], ``pressure`` [Pa].
        """
        queries: list[Select[Any]] = []
        if channel == "":
            if name not in TREND_COLUMNS:
                raise InputError(f"{name!r} has no trend; {', '.join(TREND_COLUMNS)} have one.")
            queries = [select(Judgment.id, Judgment.time, getattr(Judgment, name))]
        else:
            for layout in self._all(select(Layout).where(Layout.machine == machine)):
                if [channel, name] in layout.names:
                    value = func.substr(
                        Indicators.values, 4 * layout.names.index([channel, name]) + 1, 4
                    )
                    query = select(Judgment.id, Judgment.time, value).where(
                        Indicators.layout == layout.id
                    )
                    queries.append(query.join(Indicators, Indicators.recording == Judgment.id))
        results: list[Any] = []
        with self._database.reading() as session:
            for query in queries:
                newest = query.where(*_within(machine, point, since, until))
                newest = newest.order_by(Judgment.time.desc(), Judgment.id.desc()).limit(limit)
                results += session.execute(newest)
        results = sorted(results, key=lambda row: (row[1], row[0]))[-limit:]
        return Trend(
            np.array([number for number, _, _ in results], np.int64),
            np.array([time.replace(tzinfo=None) for _, time, _ in results], "datetime64[us]"),
            np.array(
                [
                    np.frombuffer(value, "<f4")[0] if isinstance(value, bytes) else value
                    for *_, value in results
                ],
                float,
            ),
        )

    def operating_points(self, machine: str) -> Sequence[OperatingPointRow]:
        """Operating points of a machine by name, without what was learned there, which is large."""
        return self._all(
            select(OperatingPointRow)
            .where(OperatingPointRow.machine == machine)
            .order_by(OperatingPointRow.name)
        )

    def baseline(self, machine: str, point: str) -> dict[str, Any] | None:
        """What the alarm learned at an operating point, or None."""
        query = select(Baseline.baseline).where(
            Baseline.machine == machine, Baseline.point == point
        )
        return next(iter(self._all(query)), None)

    def alarms(
        self, machine: str | None = None, *, state: str | None = None, limit: int = 100
    ) -> Sequence[Alarm]:
        """Alarms of a machine or of all, latest first."""
        query = select(Alarm).order_by(Alarm.id.desc()).limit(limit)
        query = query if machine is None else query.where(Alarm.machine == machine)
        return self._all(query if state is None else query.where(Alarm.state == state))

    def alarm(self, number: int) -> Alarm | None:
        """Alarm of that number, or None."""
        with self._database.reading() as session:
            return session.get(Alarm, number)

    def events(self, machine: str | None = None, limit: int = 100) -> Sequence[Event]:
        """Events of a machine or of all, latest first."""
        query = select(Event).order_by(Event.time.desc(), Event.id.desc()).limit(limit)
        return self._all(query if machine is None else query.where(Event.machine == machine))

    def rejections(self, limit: int = 100) -> Sequence[Rejection]:
        """Deliveries that became no recording, latest first."""
        return self._all(
            select(Rejection).order_by(Rejection.received.desc(), Rejection.id.desc()).limit(limit)
        )

    def recordings_by_state(self) -> dict[tuple[str, str], int]:
        """How many recordings there are by machine and state; it costs the same however long the
        history is.
        """
        return {
            (tally.machine, tally.state): tally.recordings for tally in self._all(select(Tally))
        }

    def rejections_by_reason(self) -> dict[str, int]:
        """Deliveries among the newest rejections by reason."""
        query = select(Rejection.reason, func.sum(Rejection.times)).group_by(Rejection.reason)
        with self._database.reading() as session:
            return {reason: int(count) for reason, count in session.execute(query)}


def _within(
    machine: str | None, point: str | None, since: datetime | None, until: datetime | None
) -> list[ColumnElement[bool]]:
    return [
        *([] if machine is None else [Judgment.machine == machine]),
        *([] if point is None else [Judgment.point == point]),
        *([] if since is None else [Judgment.time >= since]),
        *([] if until is None else [Judgment.time < until]),
    ]
