"""``/api`` for other programs: the same as the pages show, as JSON."""

import math
from datetime import UTC, datetime
from typing import Annotated

from fastapi import APIRouter, Depends, HTTPException, Query, Request

from swashtwin.monitoring.page.routes.answers import (
    AlarmAnswer,
    EventAnswer,
    EventRequest,
    LevelAnswer,
    MachineAnswer,
    Note,
    RecordingAnswer,
    RejectionAnswer,
    SilenceRequest,
    TrendAnswer,
    alarm_answer,
    event_answer,
    machine_answer,
    recording_answer,
    rejection_answer,
)
from swashtwin.monitoring.page.routes.records import (
    acknowledge,
    add_event,
    all_machines,
    end_silence,
    find_alarm,
    find_machine,
    find_recording,
    silence,
)
from swashtwin.monitoring.page.security.access import Visitor
from swashtwin.monitoring.page.site import Site, visitor_name

Limit = Annotated[int, Query(ge=1, le=5000)]
Short = Annotated[str, Query(max_length=200)]
Since = Annotated[datetime | None, Query(description="ISO 8601; UTC where no zone is stated")]


def machine_answers(site: Site) -> APIRouter:
    """Addresses of machines."""
    routes = APIRouter(prefix="/api")
    read = site.history.read

    @routes.get("/sequence", tags=["watch"])
    def sequence() -> int:
        """A number that changes with everything new in the history: ask it before asking all."""
        return read.sequence()

    @routes.get("/machines", tags=["machines"])
    def machines() -> list[MachineAnswer]:
        """All machines with their state, their newest recording and their alarms."""
        return [machine_answer(machine) for machine in all_machines(site)]

    @routes.get("/machines/{name}", tags=["machines"])
    def machine(name: str) -> MachineAnswer:
        """One machine."""
        return machine_answer(find_machine(site, name))

    @routes.get("/machines/{name}/levels", tags=["machines"])
    def levels(name: str) -> list[LevelAnswer]:
        """Channels and names of the indicators that a machine has."""
        find_machine(site, name)
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
        find_machine(site, name)
        values = read.trend(
            name, channel, level, point=point or None, since=_utc(since), until=_utc(until), limit=limit
        )
        return TrendAnswer(
            recordings=values.ids.tolist(),
            times=[time.replace(tzinfo=UTC) for time in values.times.tolist()],
            values=[value if math.isfinite(value) else None for value in values.values.tolist()],
        )

    @routes.get("/machines/{name}/events", tags=["machines"])
    def events(name: str, limit: Limit = 100) -> list[EventAnswer]:
        """What happened to a machine, newest first."""
        find_machine(site, name)
        return [event_answer(event) for event in read.events(name, limit=limit)]

    return routes


def record_answers(site: Site) -> APIRouter:
    """Addresses of recordings and alarms."""
    routes = APIRouter(prefix="/api")
    read = site.history.read

    @routes.get("/recordings", tags=["recordings"])
    def recordings(
        machine: Annotated[str | None, Query(max_length=200)] = None,
        state: Annotated[str | None, Query(max_length=20)] = None,
        before: Annotated[int | None, Query(description="id; for the next page", ge=1, lt=2**31)] = None,
        since: Since = None,
        until: Since = None,
        limit: Limit = 100,
    ) -> list[RecordingAnswer]:
        """Recordings, newest first."""
        rows = read.recordings(machine, state=state, before=before, since=_utc(since), until=_utc(until), limit=limit)
        return [recording_answer(row) for row in rows]

    @routes.get("/recordings/{identity}", tags=["recordings"])
    def recording(identity: int) -> RecordingAnswer:
        """One recording."""
        return recording_answer(find_recording(site, identity))

    @routes.get("/alarms", tags=["alarms"])
    def alarms(
        machine: Annotated[str | None, Query(max_length=200)] = None,
        state: Annotated[str | None, Query(pattern="^(open|acknowledged|closed)$")] = None,
        limit: Limit = 100,
    ) -> list[AlarmAnswer]:
        """Alarms, newest first."""
        return [alarm_answer(alarm) for alarm in read.alarms(machine, state=state, limit=limit)]

    @routes.get("/alarms/{identity}", tags=["alarms"])
    def alarm(identity: int) -> AlarmAnswer:
        """One alarm."""
        return alarm_answer(find_alarm(site, identity))

    @routes.get("/rejections", tags=["recordings"])
    def rejections(limit: Limit = 100) -> list[RejectionAnswer]:
        """Recordings that were not judged, and why, newest first."""
        return [rejection_answer(rejection) for rejection in read.rejections(limit=limit)]

    return routes


def change_routes(site: Site) -> APIRouter:
    """Addresses of what a program may change."""
    routes = APIRouter(prefix="/api", dependencies=[Depends(_require_program)])

    @routes.post("/machines/{name}/events", tags=["machines"], status_code=204)
    def post_event(request: Request, name: str, event: EventRequest) -> None:
        """Add an event; after `maintenance` the healthy baseline is learned anew."""
        add_event(site, name, event.kind, visitor_name(request), event.note)

    @routes.post("/machines/{name}/silence", tags=["machines"], status_code=204)
    def post_silence(request: Request, name: str, wish: SilenceRequest) -> None:
        """Send no messages for some hours; alarms are raised and kept all the same."""
        silence(site, name, wish.hours, visitor_name(request), wish.note)

    @routes.delete("/machines/{name}/silence", tags=["machines"], status_code=204)
    def delete_silence(name: str) -> None:
        """Send messages again."""
        end_silence(site, name)

    @routes.post("/alarms/{identity}/acknowledge", tags=["alarms"])
    def post_acknowledgment(request: Request, identity: int, remark: Note) -> AlarmAnswer:
        """Acknowledge an alarm; 409 where it is not open."""
        acknowledge(site, identity, visitor_name(request), remark.note)
        return alarm_answer(find_alarm(site, identity))

    return routes


def _require_program(request: Request) -> None:
    """Changes need a token where there are logins: a browser's cookie alone could be sent by somebody's form."""
    visitor: Visitor = request.state.visitor
    if visitor.kind == "token":
        raise HTTPException(
            403, "This token may read and upload only; watch user NAME --token --control makes another."
        )
    if visitor.kind == "person":
        raise HTTPException(403, "Send a token: Authorization: Bearer TOKEN. The pages' forms need none.")


def _utc(time: datetime | None) -> datetime | None:
    return time.replace(tzinfo=UTC) if time is not None and time.tzinfo is None else time
