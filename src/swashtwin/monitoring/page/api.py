"""What other programs ask: ``/api`` has what the pages show as JSON, with the columns of the
history's tables; ``/metrics`` is for Prometheus, ``/health`` for whatever restarts or watches the
watch.
"""

import math
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated, Any

from fastapi import APIRouter, HTTPException, Query

from swashtwin.monitoring.history.reading import TREND_COLUMNS, MachineOverview
from swashtwin.monitoring.history.schema import Judgment
from swashtwin.monitoring.page.site import Site, state_of

if TYPE_CHECKING:
    pass


Limit = Annotated[int, Query(ge=1, le=5000)]
Short = Annotated[str, Query(max_length=200)]
Since = Annotated[datetime | None, Query(description="ISO 8601; UTC where no zone is stated")]


Rows = list[dict[str, Any]]


def _row(row: Any, *, without: str = "") -> dict[str, Any]:
    names = (column.name for column in row.__table__.columns)
    return {name: getattr(row, name) for name in names if name != without}


def _recording(row: Judgment) -> dict[str, Any]:
    return _row(row, without="retention")


def _machine(machine: MachineOverview) -> dict[str, Any]:
    return {
        "name": machine.name,
        "state": state_of(machine).code,
        "recordings": machine.recordings,
        "silenced_until": machine.silenced,
        "last": None if machine.last is None else _recording(machine.last),
        "alarms": [_row(alarm) for alarm in machine.alarms],
    }


def machine_answers(site: Site) -> APIRouter:
    """Addresses of machines."""
    routes = APIRouter(prefix="/api")
    read = site.history.reader

    @routes.get("/sequence", tags=["watch"])
    def sequence() -> int:
        """A number that changes with everything new in the history: ask it before asking all."""
        return read.sequence()

    @routes.get("/machines", tags=["machines"])
    def machines() -> Rows:
        """All machines with their newest recording, their alarms, and their state: `alarm`,
        `sensor`, `acknowledged`, `unusual`, `normal`, `learning` or `empty`.
        """
        return [_machine(machine) for machine in site.machines()]

    @routes.get("/machines/{name}", tags=["machines"])
    def machine(name: str) -> dict[str, Any]:
        """One machine."""
        return _machine(site.machine(name))

    @routes.get("/machines/{name}/levels", tags=["machines"])
    def levels(name: str) -> list[dict[str, str]]:
        """Channels and names of the indicators that a machine has."""
        site.machine(name)
        return [
            {"channel": channel, "name": level} for channel, level in read.indicator_names(name)
        ]

    @routes.get("/machines/{name}/trend", tags=["machines"])
    def trend(
        name: str,
        level: Short,
        channel: Short = "",
        point: Short = "",
        since: Since = None,
        until: Since = None,
        limit: Limit = 1000,
    ) -> dict[str, list[Any]]:
        """One indicator over time, oldest first; with an empty channel one of `capital`, `alarm_p`,
        `probability`.
        """
        site.machine(name)
        if not channel and level not in TREND_COLUMNS:
            raise HTTPException(
                422, f"Without a channel the level is one of {', '.join(TREND_COLUMNS)}."
            )
        values = read.trend(
            name,
            channel,
            level,
            point=point or None,
            since=_utc(since),
            until=_utc(until),
            limit=limit,
        )
        return {
            "recordings": values.ids.tolist(),
            "times": [time.replace(tzinfo=UTC) for time in values.times.tolist()],
            "values": [value if math.isfinite(value) else None for value in values.values.tolist()],
        }

    @routes.get("/machines/{name}/events", tags=["machines"])
    def events(name: str, limit: Limit = 100) -> Rows:
        """What happened to a machine, newest first."""
        site.machine(name)
        return [_row(event) for event in read.events(name, limit=limit)]

    return routes


def record_answers(site: Site) -> APIRouter:
    """Addresses of recordings and alarms."""
    routes = APIRouter(prefix="/api")
    read = site.history.reader

    @routes.get("/recordings", tags=["recordings"])
    def recordings(
        machine: Annotated[str | None, Query(max_length=200)] = None,
        state: Annotated[str | None, Query(max_length=20)] = None,
        before: Annotated[
            int | None, Query(description="id; for the next page", ge=1, lt=2**31)
        ] = None,
        since: Since = None,
        until: Since = None,
        limit: Limit = 100,
    ) -> Rows:
        """Recordings, newest first."""
        found = read.recordings(
            machine, state=state, before=before, since=_utc(since), until=_utc(until), limit=limit
        )
        return [_recording(row) for row in found]

    @routes.get("/recordings/{identity}", tags=["recordings"])
    def recording(identity: int) -> dict[str, Any]:
        """One recording."""
        return _recording(site.recording(identity))

    @routes.get("/alarms", tags=["alarms"])
    def alarms(
        machine: Annotated[str | None, Query(max_length=200)] = None,
        state: Annotated[str | None, Query(pattern="^(open|acknowledged|closed)$")] = None,
        limit: Limit = 100,
    ) -> Rows:
        """Alarms, newest first."""
        return [_row(alarm) for alarm in read.alarms(machine, state=state, limit=limit)]

    @routes.get("/alarms/{identity}", tags=["alarms"])
    def alarm(identity: int) -> dict[str, Any]:
        """One alarm."""
        return _row(site.alarm(identity))

    @routes.get("/rejections", tags=["recordings"])
    def rejections(limit: Limit = 100) -> Rows:
        """Recordings that were not judged, and why, newest first."""
        return [_row(rejection, without="copy") for rejection in read.rejections(limit=limit)]

    return routes


def _utc(time: datetime | None) -> datetime | None:
    """A time in UTC; 422 at the ends of time, where another zone's year is none."""
    try:
        return (
            None
            if time is None
            else time.replace(tzinfo=UTC)
            if time.tzinfo is None
            else time.astimezone(UTC)
        )
    except OverflowError:
        raise HTTPException(
            422, "since and until must lie between the years 1 and 9999 in UTC."
        ) from None
