"""The interface for programs: ``/api`` returns what the pages show as JSON.

Keys are the columns of the history's tables.
"""

import math
from datetime import UTC, datetime
from typing import Annotated, Any

from fastapi import APIRouter, HTTPException, Query

from swashtwin.monitoring.history.reading import TREND_COLUMNS, MachineOverview
from swashtwin.monitoring.history.schema import Judgment
from swashtwin.monitoring.page.site import MAX_ID, Site
from swashtwin.monitoring.page.states import state_of

Limit = Annotated[int, Query(ge=1, le=5000)]
ShortText = Annotated[str, Query(max_length=200)]
Time = Annotated[datetime | None, Query(description="ISO 8601; UTC if no zone is specified")]
Rows = list[dict[str, Any]]


def machine_routes(site: Site) -> APIRouter:
    """Return the addresses of machines."""
    routes = APIRouter(prefix="/api")
    reader = site.history.reader

    @routes.get("/sequence", tags=["watch"])
    def sequence() -> int:
        """Return a number that changes with every change of the history.

        A program that polls reads it first, and the rest only if it changed.
        """
        return reader.sequence()

    @routes.get("/machines", tags=["machines"])
    def machines() -> Rows:
        """Return all machines with their newest recording, their alarms, and their state.

        The state is `alarm`, `sensor`, `acknowledged`, `unusual`, `normal`, `learning` or `empty`.
        """
        return [_machine_row(machine) for machine in site.machines()]

    @routes.get("/machines/{name}", tags=["machines"])
    def machine(name: str) -> dict[str, Any]:
        """Return one machine."""
        return _machine_row(site.machine(name))

    @routes.get("/machines/{name}/indicators", tags=["machines"])
    def indicators(name: str) -> list[dict[str, str]]:
        """Return the indicators of a machine, each with its channel."""
        site.machine(name)
        return [
            {"channel": channel, "name": indicator}
            for channel, indicator in reader.indicator_names(name)
        ]

    @routes.get("/machines/{name}/trend", tags=["machines"])
    def trend(
        name: str,
        indicator: ShortText,
        channel: ShortText = "",
        point: ShortText = "",
        since: Time = None,
        until: Time = None,
        limit: Limit = 1000,
    ) -> dict[str, list[Any]]:
        """Return one indicator over time, oldest first.

        With an empty channel, the indicator is a value of the verdict, such as `capital`,
        `alarm_p` or `probability`.
        """
        site.machine(name)
        if not channel and indicator not in TREND_COLUMNS:
            raise HTTPException(
                422, f"Without a channel, indicator must be one of {', '.join(TREND_COLUMNS)}."
            )

        values = reader.trend(
            name,
            channel,
            indicator,
            point=point or None,
            since=_in_utc(since),
            until=_in_utc(until),
            limit=limit,
        )
        return {
            "recordings": values.ids.tolist(),
            "times": [time.replace(tzinfo=UTC) for time in values.times.tolist()],
            # JSON has no NaN.
            "values": [value if math.isfinite(value) else None for value in values.values.tolist()],
        }

    @routes.get("/machines/{name}/events", tags=["machines"])
    def events(name: str, limit: Limit = 100) -> Rows:
        """Return the events of a machine, newest first."""
        site.machine(name)
        return [_row(event) for event in reader.events(name, limit=limit)]

    return routes


def record_routes(site: Site) -> APIRouter:
    """Return the addresses of recordings and alarms."""
    routes = APIRouter(prefix="/api")
    reader = site.history.reader

    @routes.get("/recordings", tags=["recordings"])
    def recordings(
        machine: Annotated[str | None, Query(max_length=200)] = None,
        state: Annotated[str | None, Query(max_length=20)] = None,
        before: Annotated[
            int | None, Query(description="id; for the next page", ge=1, le=MAX_ID)
        ] = None,
        since: Time = None,
        until: Time = None,
        limit: Limit = 100,
    ) -> Rows:
        """Return recordings, newest first."""
        judgments = reader.recordings(
            machine,
            state=state,
            before=before,
            since=_in_utc(since),
            until=_in_utc(until),
            limit=limit,
        )
        return [_recording_row(judgment) for judgment in judgments]

    @routes.get("/recordings/{identity}", tags=["recordings"])
    def recording(identity: int) -> dict[str, Any]:
        """Return one recording."""
        return _recording_row(site.recording(identity))

    @routes.get("/alarms", tags=["alarms"])
    def alarms(
        machine: Annotated[str | None, Query(max_length=200)] = None,
        state: Annotated[str | None, Query(pattern="^(open|acknowledged|closed)$")] = None,
        limit: Limit = 100,
    ) -> Rows:
        """Return alarms, newest first."""
        return [_row(alarm) for alarm in reader.alarms(machine, state=state, limit=limit)]

    @routes.get("/alarms/{identity}", tags=["alarms"])
    def alarm(identity: int) -> dict[str, Any]:
        """Return one alarm."""
        return _row(site.alarm(identity))

    @routes.get("/rejections", tags=["recordings"])
    def rejections(limit: Limit = 100) -> Rows:
        """Return recordings that were not judged, with the reason, newest first."""
        return [_row(rejection, without="copy") for rejection in reader.rejections(limit=limit)]

    return routes


def _row(row: Any, *, without: str = "") -> dict[str, Any]:
    """Return the columns of a row; `without` names an internal one that is left out."""
    names = [column.name for column in row.__table__.columns]
    return {name: getattr(row, name) for name in names if name != without}


def _recording_row(judgment: Judgment) -> dict[str, Any]:
    return _row(judgment, without="retention")


def _machine_row(machine: MachineOverview) -> dict[str, Any]:
    newest = None
    if machine.last is not None:
        newest = _recording_row(machine.last)
    return {
        "name": machine.name,
        "state": state_of(machine).code,
        "recordings": machine.recordings,
        "silenced_until": machine.silenced,
        "last": newest,
        "alarms": [_row(alarm) for alarm in machine.alarms],
    }


def _in_utc(time: datetime | None) -> datetime | None:
    """Return a time in UTC, or answer 422 if it lies outside the years of `datetime`."""
    if time is None:
        return None
    if time.tzinfo is None:
        return time.replace(tzinfo=UTC)
    try:
        return time.astimezone(UTC)
    except OverflowError:
        raise HTTPException(
            422, "since and until must lie between the years 1 and 9999 in UTC."
        ) from None
