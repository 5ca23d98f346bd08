"""``/api`` for other programs: what the pages show, as JSON. Answers have the columns of the history's tables."""

import math
from datetime import UTC, datetime
from typing import Annotated, Any

from fastapi import APIRouter, HTTPException, Query
from pydantic import BaseModel, ConfigDict, Field, create_model

from swashtwin.monitoring.history.reading import FACTS, MachineOverview
from swashtwin.monitoring.history.tables import Alarm, Event, Judgment, Rejection
from swashtwin.monitoring.page.site import Site
from swashtwin.monitoring.page.wording import state_of

Limit = Annotated[int, Query(ge=1, le=5000)]
Short = Annotated[str, Query(max_length=200)]
Since = Annotated[datetime | None, Query(description="ISO 8601; UTC where no zone is stated")]


def _answer(table: Any, *, without: tuple[str, ...] = ()) -> Any:
    """Form of an answer with the columns of a table."""
    columns: dict[str, Any] = {
        column.name: (_type(column) | None if column.nullable else _type(column), ...)
        for column in table.__table__.columns
        if column.name not in without
    }
    name = f"{table.__name__}Answer"
    return create_model(name, __config__=ConfigDict(from_attributes=True), __doc__=table.__doc__, **columns)


def _type(column: Any) -> Any:
    kind = column.type.python_type
    return (list[str] if column.name == "channels" else dict[str, Any]) if kind is dict else kind


def _many(form: Any) -> Any:
    return list[form]


_RECORDING = _answer(Judgment, without=("retention",))
_ALARM = _answer(Alarm)
_EVENT = _answer(Event)
_REJECTION = _answer(Rejection, without=("copy",))


class MachineAnswer(BaseModel):
    """A machine."""

    model_config = ConfigDict(from_attributes=True)
    name: str
    state: str = Field(description="`alarm`, `sensor`, `acknowledged`, `unusual`, `normal`, `learning` or `empty`")
    recordings: int
    silenced_until: datetime | None
    last: _RECORDING | None  # type: ignore[valid-type]
    alarms: list[_ALARM]  # type: ignore[valid-type]


class TrendAnswer(BaseModel):
    """One indicator over time."""

    recordings: list[int]
    times: list[datetime]
    values: list[float | None]


class LevelAnswer(BaseModel):
    """An indicator that a machine has."""

    channel: str
    name: str


def machine_answers(site: Site) -> APIRouter:
    """Addresses of machines."""
    routes = APIRouter(prefix="/api")
    read = site.history.read

    @routes.get("/sequence", tags=["watch"])
    def sequence() -> int:
        """A number that changes with everything new in the history: ask it before asking all."""
        return read.sequence()

    @routes.get("/machines", tags=["machines"], response_model=list[MachineAnswer])
    def machines() -> Any:
        """All machines with their state, their newest recording and their alarms."""
        return [_machine(machine) for machine in site.machines()]

    @routes.get("/machines/{name}", tags=["machines"], response_model=MachineAnswer)
    def machine(name: str) -> Any:
        """One machine."""
        return _machine(site.machine(name))

    @routes.get("/machines/{name}/levels", tags=["machines"])
    def levels(name: str) -> list[LevelAnswer]:
        """Channels and names of the indicators that a machine has."""
        site.machine(name)
        return [LevelAnswer(channel=channel, name=level) for channel, level in read.indicator_names(name)]

    @routes.get("/machines/{name}/trend", tags=["machines"])
    def trend(
        name: str,
        level: Short,
        channel: Short = "",
        point: Short = "",
        since: Since = None,
        until: Since = None,
        limit: Limit = 1000,
    ) -> TrendAnswer:
        """One indicator over time, oldest first; with an empty channel one of `capital`, `alarm_p`, `probability`."""
        site.machine(name)
        if not channel and level not in FACTS:
            raise HTTPException(422, f"Without a channel the level is one of {', '.join(FACTS)}.")
        values = read.trend(
            name, channel, level, point=point or None, since=_utc(since), until=_utc(until), limit=limit
        )
        return TrendAnswer(
            recordings=values.ids.tolist(),
            times=[time.replace(tzinfo=UTC) for time in values.times.tolist()],
            values=[value if math.isfinite(value) else None for value in values.values.tolist()],
        )

    @routes.get("/machines/{name}/events", tags=["machines"], response_model=_many(_EVENT))
    def events(name: str, limit: Limit = 100) -> Any:
        """What happened to a machine, newest first."""
        site.machine(name)
        return read.events(name, limit=limit)

    return routes


def record_answers(site: Site) -> APIRouter:
    """Addresses of recordings and alarms."""
    routes = APIRouter(prefix="/api")
    read = site.history.read

    @routes.get("/recordings", tags=["recordings"], response_model=_many(_RECORDING))
    def recordings(
        machine: Annotated[str | None, Query(max_length=200)] = None,
        state: Annotated[str | None, Query(max_length=20)] = None,
        before: Annotated[int | None, Query(description="id; for the next page", ge=1, lt=2**31)] = None,
        since: Since = None,
        until: Since = None,
        limit: Limit = 100,
    ) -> Any:
        """Recordings, newest first."""
        return read.recordings(machine, state=state, before=before, since=_utc(since), until=_utc(until), limit=limit)

    @routes.get("/recordings/{identity}", tags=["recordings"], response_model=_RECORDING)
    def recording(identity: int) -> Any:
        """One recording."""
        return site.recording(identity)

    @routes.get("/alarms", tags=["alarms"], response_model=_many(_ALARM))
    def alarms(
        machine: Annotated[str | None, Query(max_length=200)] = None,
        state: Annotated[str | None, Query(pattern="^(open|acknowledged|closed)$")] = None,
        limit: Limit = 100,
    ) -> Any:
        """Alarms, newest first."""
        return read.alarms(machine, state=state, limit=limit)

    @routes.get("/alarms/{identity}", tags=["alarms"], response_model=_ALARM)
    def alarm(identity: int) -> Any:
        """One alarm."""
        return site.alarm(identity)

    @routes.get("/rejections", tags=["recordings"], response_model=_many(_REJECTION))
    def rejections(limit: Limit = 100) -> Any:
        """Recordings that were not judged, and why, newest first."""
        return read.rejections(limit=limit)

    return routes


def _machine(machine: MachineOverview) -> dict[str, Any]:
    return {**vars(machine), "state": state_of(machine).code, "silenced_until": machine.silenced}


def _utc(time: datetime | None) -> datetime | None:
    """A time in UTC; 422 at the ends of time, where another zone's year is none."""
    try:
        return None if time is None else time.replace(tzinfo=UTC) if time.tzinfo is None else time.astimezone(UTC)
    except OverflowError:
        raise HTTPException(422, "since and until must lie between the years 1 and 9999 in UTC.") from None
