"""What the page and other readers need of the history."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int, Shaped
from sqlalchemy import ColumnElement, ScalarSelect, Select, func, select, union_all
from sqlalchemy.orm import Session

from swashtwin.foundation import InputError
from swashtwin.monitoring.history.database import Database
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
from swashtwin.monitoring.history.waveforms import Waveforms
from swashtwin.recordings import Recording

TREND_COLUMNS = (
    "score",
    "alarm_p",
    "capital",
    "probability",
    "confidence",
    "ood_p",
    "speed",
    "pressure",
)
"""Values of recordings that have a trend; their channel is empty."""
N_SEARCHED_RECORDINGS = 200
"""Newest recordings of a state among which healthy ones are searched."""
FLOAT_BYTES = 4
"""Bytes of one packed indicator (float32)."""
Names = tuple[tuple[str, str], ...]
"""Channel and name of each indicator."""

# Nonconformity score of a recording; NULL if it was not compared with a baseline.
_SCORE = Judgment.reasons["score"].as_float()


@dataclass(frozen=True)
class MachineOverview:
    """Summary of one machine."""

    name: str
    """Name of the machine."""
    recordings: int = 0
    """Number of its recordings."""
    last: Judgment | None = None
    """Newest recording by time of measurement."""
    alarms: Sequence[Alarm] = ()
    """Alarms that are not closed."""
    silenced: datetime | None = None
    """End of its silence; None if it is not silenced."""
    maintained: datetime | None = None
    """Time of its newest maintenance, or None."""
    first: datetime | None = None
    """Time of measurement of its oldest recording."""
    closed: datetime | None = None
    """When its newest closed alarm was closed."""


class ScoredRecording(NamedTuple):
    """How far a recording deviates from the healthy baseline."""

    time: datetime
    """Time of measurement."""
    state: str
    """State of the recording, as in `Judgment`."""
    score: float | None
    """Nonconformity score [healthy scatters]; None if the recording was not compared."""


@dataclass(frozen=True)
class Trend:
    """One indicator of a machine over time, oldest value first."""

    ids: Int[np.ndarray, " recording"]
    """Numbers of the recordings."""
    times: Shaped[np.ndarray, " recording"]
    """Times of measurement, as datetime64 in UTC."""
    values: Float[np.ndarray, " recording"]
    """Values of the indicator; NaN if a recording has none."""


@dataclass(frozen=True)
class IndicatorTable:
    """Several indicators of one channel over time, oldest recording first."""

    names: Sequence[str]
    """Names of the indicators."""
    times: Shaped[np.ndarray, " recording"]
    """Times of measurement, as datetime64 in UTC."""
    values: Float[np.ndarray, "recording indicator"]
    """Values of the indicators; NaN if a recording has none."""


class HistoryReader:
    """Reads the history, each time in a separate transaction.

    Every method raises `HistoryError` if the database cannot be read.
    """

    def __init__(self, database: Database, waveforms: Waveforms) -> None:
        self._database = database
        self._waveforms = waveforms

    def _all(self, query: Select[Any]) -> Sequence[Any]:
        with self._database.reading() as session:
            return session.scalars(query).all()

    def sequence(self) -> int:
        """Return a number that grows with each change of the history."""
        return int(self._all(select(func.sum(Machine.sequence)))[0])

    def machines(self) -> Sequence[MachineOverview]:
        """Return a summary of each machine, by name."""
        newest_recordings = (
            select(Machine.name, Judgment, _first_time_of_machine())
            .outerjoin(Judgment, Judgment.id == Machine.last)
            .where(Machine.name != "")
            .order_by(Machine.name)
        )
        with self._database.reading() as session:
            counts = _recording_counts(session)
            silence_ends = _silence_ends(session)
            maintenance_times = _maintenance_times(session)
            closing_times = _closing_times(session)
            alarms = _alarms_not_closed(session)
            rows = session.execute(newest_recordings).all()

        return [
            MachineOverview(
                name=name,
                recordings=counts.get(name, 0),
                last=newest_recording,
                alarms=tuple(alarms[name]),
                silenced=silence_ends.get(name),
                maintained=maintenance_times.get(name),
                first=first,
                closed=closing_times.get(name),
            )
            for name, newest_recording, first in rows
        ]

    def newest_scores(
        self, machines: Sequence[str], limit: int
    ) -> Mapping[str, Sequence[ScoredRecording]]:
        """Return the scores of the newest `limit` recordings of each machine, oldest first.

        It is one query, whose cost does not depend on the length of the history.
        """
        scores: dict[str, list[ScoredRecording]] = {name: [] for name in machines}
        if not machines:
            return scores

        # One part for each machine reads the index from its end. A window function, and a join with
        # the time of the oldest recording, made PostgreSQL read the whole history.
        parts = []
        for name in machines:
            newest = (
                select(Judgment.machine, Judgment.time, Judgment.state, _SCORE.label("score"))
                .where(Judgment.machine == name)
                .order_by(Judgment.time.desc(), Judgment.id.desc())
                .limit(limit)
            )
            parts.append(select(newest.subquery()))
        with self._database.reading() as session:
            for name, *values in session.execute(union_all(*parts)):
                scores[name].append(ScoredRecording(*values))
        # SQL promises no order of a union
        return {name: sorted(rows, key=lambda row: row.time) for name, rows in scores.items()}

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
        """Return recordings, newest first by time of measurement.

        Parameters
        ----------
        since : earliest time of measurement.
        until : end of the times of measurement, which is excluded.
        before : number of a recording; only older ones are returned.
        """
        query = select(Judgment).where(*_filters(machine, point, since, until))
        if state is not None:
            query = query.where(Judgment.state == state)
        if before is not None:
            # Numbers follow the order of arrival, so the time of measurement decides.
            time = select(Judgment.time).where(Judgment.id == before).scalar_subquery()
            has_same_time = (Judgment.time == time) & (Judgment.id < before)
            query = query.where((Judgment.time < time) | has_same_time)
        return self._all(query.order_by(Judgment.time.desc(), Judgment.id.desc()).limit(limit))

    def recording(self, number: int) -> Judgment | None:
        """Return the recording with that number, or None."""
        with self._database.reading() as session:
            return session.get(Judgment, number)

    def healthy_files(self, judgment: Judgment, limit: int) -> dict[int, str]:
        """Return the waveforms of healthy recordings at the operating point of a recording.

        Those of the baseline come first, and the recording itself is excluded.
        """
        files: dict[int, str] = {}
        for state in ("learning", "normal"):
            candidates = self.recordings(
                judgment.machine, point=judgment.point, state=state, limit=N_SEARCHED_RECORDINGS
            )

            for candidate in candidates:
                if candidate.waveform and candidate.id != judgment.id:
                    files[candidate.id] = candidate.waveform
        return dict(list(files.items())[:limit])

    def later_recording(self, number: int) -> int | None:
        """Return the number of the recording that the machine measured next, or None."""
        current = select(Judgment.machine, Judgment.time).where(Judgment.id == number).subquery()
        has_same_time = (Judgment.time == current.c.time) & (Judgment.id > number)
        query = (
            select(Judgment.id)
            .join(current, Judgment.machine == current.c.machine)
            .where((Judgment.time > current.c.time) | has_same_time)
            .order_by(Judgment.time, Judgment.id)
            .limit(1)
        )
        return next(iter(self._all(query)), None)

    def waveform(self, number: int) -> Recording | None:
        """Return the samples of a recording; None if they were not kept."""
        stored = self.recording(number)
        if stored is None or stored.waveform is None:
            return None
        return self._waveforms.read(stored.waveform)

    def indicator_names(self, machine: str) -> Names:
        """Return channel and name of each indicator that recordings of the machine have."""
        query = select(Layout.names).where(Layout.machine == machine).order_by(Layout.id.desc())

        # A dictionary keeps the order of the layouts, the newest first.
        unique_names: dict[tuple[str, str], None] = {}
        for names in self._all(query):
            unique_names.update(dict.fromkeys((channel, name) for channel, name in names))
        return tuple(unique_names)

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
        """Return an indicator over time: its newest `limit` values, oldest first.

        Parameters
        ----------
        channel : channel of the indicator; empty for values of the whole recording, which are
            ``score`` [healthy scatters], ``alarm_p``, ``capital``, ``probability``,
            ``confidence``, ``ood_p``, ``speed`` [rad/s] and ``pressure`` [Pa].
        """
        if channel == "":
            queries = [_column_query(name)]
        else:
            queries = self._indicator_queries(machine, channel, name)

        rows: list[Any] = []
        with self._database.reading() as session:
            for query in queries:
                newest = (
                    query.where(*_filters(machine, point, since, until))
                    .order_by(Judgment.time.desc(), Judgment.id.desc())
                    .limit(limit)
                )
                rows += session.execute(newest)

        # After a change of sensors an indicator is in several layouts, each with `limit` rows.
        rows = sorted(rows, key=lambda row: (row[1], row[0]))[-limit:]
        return Trend(
            ids=np.array([number for number, _, _ in rows], np.int64),
            times=np.array([time.replace(tzinfo=None) for _, time, _ in rows], "datetime64[us]"),
            values=np.array([_unpack(value) for _, _, value in rows], float),
        )

    def indicator_table(
        self,
        machine: str,
        channel: str,
        names: Sequence[str],
        *,
        point: str | None = None,
        limit: int = 5000,
    ) -> IndicatorTable:
        """Return several indicators of a channel over time, of the newest `limit` recordings."""
        columns: dict[int, Int[np.ndarray, " indicator"]] = {}
        for layout in self._all(select(Layout).where(Layout.machine == machine)):
            indices = {tuple(key): index for index, key in enumerate(layout.names)}
            # The index after the last one is that of a missing value.
            columns[layout.id] = np.array(
                [indices.get((channel, name), len(indices)) for name in names], int
            )
        query = (
            select(Judgment.time, Indicators.layout, Indicators.values)
            .join(Indicators, Indicators.recording == Judgment.id)
            .where(*_filters(machine, point, None, None))
            .order_by(Judgment.time.desc(), Judgment.id.desc())
            .limit(limit)
        )
        with self._database.reading() as session:
            rows = session.execute(query).all()[::-1]

        values = np.full((len(rows), len(names)), np.nan)
        for row, (_, layout_id, packed) in enumerate(rows):
            stored = np.append(np.frombuffer(packed, "<f4"), np.float32(np.nan))
            values[row] = stored[columns[layout_id]]
        times = np.array([time.replace(tzinfo=None) for time, _, _ in rows], "datetime64[us]")
        return IndicatorTable(names, times, values)

    def _indicator_queries(self, machine: str, channel: str, name: str) -> list[Select[Any]]:
        """Return a query for each layout of the machine that has the indicator."""
        queries = []
        for layout in self._all(select(Layout).where(Layout.machine == machine)):
            if [channel, name] not in layout.names:
                continue

            # The database cuts the value out of the packed ones, so that few bytes are read.
            start = FLOAT_BYTES * layout.names.index([channel, name]) + 1
            value = func.substr(Indicators.values, start, FLOAT_BYTES)
            queries.append(
                select(Judgment.id, Judgment.time, value)
                .where(Indicators.layout == layout.id)
                .join(Indicators, Indicators.recording == Judgment.id)
            )
        return queries

    def operating_points(self, machine: str) -> Sequence[OperatingPointRow]:
        """Return the operating points of a machine by name, without their large baselines."""
        return self._all(
            select(OperatingPointRow)
            .where(OperatingPointRow.machine == machine)
            .order_by(OperatingPointRow.name)
        )

    def baseline(self, machine: str, point: str) -> dict[str, Any] | None:
        """Return the baseline of an operating point, or None."""
        query = select(Baseline.baseline).where(
            Baseline.machine == machine, Baseline.point == point
        )
        return next(iter(self._all(query)), None)

    def alarms(
        self, machine: str | None = None, *, state: str | None = None, limit: int = 100
    ) -> Sequence[Alarm]:
        """Return alarms of a machine or of all machines, latest first."""
        query = select(Alarm).order_by(Alarm.id.desc()).limit(limit)
        if machine is not None:
            query = query.where(Alarm.machine == machine)
        if state is not None:
            query = query.where(Alarm.state == state)
        return self._all(query)

    def alarm(self, number: int) -> Alarm | None:
        """Return the alarm with that number, or None."""
        with self._database.reading() as session:
            return session.get(Alarm, number)

    def events(self, machine: str | None = None, limit: int = 100) -> Sequence[Event]:
        """Return events of a machine or of all machines, latest first."""
        query = select(Event).order_by(Event.time.desc(), Event.id.desc()).limit(limit)
        if machine is not None:
            query = query.where(Event.machine == machine)
        return self._all(query)

    def rejections(self, limit: int = 100) -> Sequence[Rejection]:
        """Return deliveries that were rejected, latest first."""
        return self._all(
            select(Rejection).order_by(Rejection.received.desc(), Rejection.id.desc()).limit(limit)
        )

    def recordings_by_state(self) -> dict[tuple[str, str], int]:
        """Return the number of recordings by machine and state.

        The query costs the same however long the history is.
        """
        tallies = self._all(select(Tally))
        return {(tally.machine, tally.state): tally.recordings for tally in tallies}

    def rejections_by_reason(self) -> dict[str, int]:
        """Return the number of rejected deliveries by reason, among those that are kept."""
        query = select(Rejection.reason, func.sum(Rejection.times)).group_by(Rejection.reason)
        with self._database.reading() as session:
            return {reason: int(count) for reason, count in session.execute(query)}


def _first_time_of_machine() -> ScalarSelect[datetime]:
    """Return the time of the oldest recording of a machine, for a query of `Machine`.

    The index yields it at once; the minima of all machines together would read all rows.
    """
    return (
        select(func.min(Judgment.time))
        .where(Judgment.machine == Machine.name)
        .correlate(Machine)
        .scalar_subquery()
    )


def _recording_counts(session: Session) -> dict[str, int]:
    query = select(Tally.machine, func.sum(Tally.recordings)).group_by(Tally.machine)
    # The sum of integers is a decimal number in PostgreSQL.
    return {machine: int(count) for machine, count in session.execute(query)}


def _silence_ends(session: Session) -> dict[str, datetime]:
    now = datetime.now(UTC)
    query = (
        select(Silence.machine, func.max(Silence.until))
        .where(Silence.since <= now, Silence.until > now)
        .group_by(Silence.machine)
    )
    return dict(session.execute(query).all())


def _maintenance_times(session: Session) -> dict[str, datetime]:
    query = (
        select(Event.machine, func.max(Event.time))
        .where(Event.kind == "maintenance")
        .group_by(Event.machine)
    )
    return dict(session.execute(query).all())


def _closing_times(session: Session) -> dict[str, datetime]:
    query = (
        select(Alarm.machine, func.max(Alarm.closed))
        .where(Alarm.closed.is_not(None))
        .group_by(Alarm.machine)
    )
    return {machine: closed for machine, closed in session.execute(query) if closed is not None}


def _alarms_not_closed(session: Session) -> dict[str, list[Alarm]]:
    alarms: dict[str, list[Alarm]] = defaultdict(list)
    for alarm in session.scalars(select(Alarm).where(Alarm.closed.is_(None)).order_by(Alarm.id)):
        alarms[alarm.machine].append(alarm)
    return alarms


def _column_query(name: str) -> Select[Any]:
    if name not in TREND_COLUMNS:
        raise InputError(f"{name!r} has no trend; use one of {', '.join(TREND_COLUMNS)}.")
    value = _SCORE if name == "score" else getattr(Judgment, name)
    return select(Judgment.id, Judgment.time, value)


def _unpack(value: Any) -> Any:
    """Return the number of a packed indicator; values of columns are numbers already."""
    if isinstance(value, bytes):
        return np.frombuffer(value, "<f4")[0]
    return value


def _filters(
    machine: str | None, point: str | None, since: datetime | None, until: datetime | None
) -> list[ColumnElement[bool]]:
    filters = []
    if machine is not None:
        filters.append(Judgment.machine == machine)
    if point is not None:
        filters.append(Judgment.point == point)
    if since is not None:
        filters.append(Judgment.time >= since)
    if until is not None:
        filters.append(Judgment.time < until)
    return filters
