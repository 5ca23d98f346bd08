"""The pages: machines, one machine, one recording, alarms, log."""

from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import timedelta
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from starlette.responses import HTMLResponse

from swashtwin.diagnosis import Check, next_checks
from swashtwin.monitoring.history import Alarm, MachineOverview, StoredRecording
from swashtwin.monitoring.page.content.charts import sparkline
from swashtwin.monitoring.page.content.languages import Language
from swashtwin.monitoring.page.content.levels import chosen_level
from swashtwin.monitoring.page.content.machine_states import STATES, alarm_state, by_urgency, state_of
from swashtwin.monitoring.page.routes.records import all_machines, find_alarm, find_machine, find_recording
from swashtwin.monitoring.page.site import Site

CARDS = 60
"""Machines on one page."""
ROWS = 25
"""Recordings in one table."""
QUIET = timedelta(days=1)
"""A machine that sent nothing for so long is marked."""
_SPARKS = 60
_PAST_ALARMS = 200


def page_routes(site: Site) -> APIRouter:
    """Addresses of the pages."""
    routes = APIRouter(default_response_class=HTMLResponse, include_in_schema=False)
    read = site.history.read

    @routes.get("/")
    def overview(
        request: Request,
        state: str = "",
        text: Annotated[str, Query(max_length=100)] = "",
        page: Annotated[int, Query(ge=1, le=100_000)] = 1,
    ) -> HTMLResponse:
        machines = sorted(all_machines(site), key=by_urgency)
        counts = Counter(state_of(machine) for machine in machines)
        fitting = [
            machine
            for machine in machines
            if state in ("", state_of(machine).code) and text.casefold() in machine.name.casefold()
        ]
        pages = max(1, -(-len(fitting) // CARDS))
        shown = fitting[(min(page, pages) - 1) * CARDS : min(page, pages) * CARDS]
        return site.render(
            request,
            "overview.html.jinja",
            cards=[_card(site, machine) for machine in shown],
            summary=[(state, counts[state]) for state in STATES if counts[state]],
            chosen=state,
            text=text,
            page=min(page, pages),
            pages=pages,
            total=len(machines),
            problems=() if site.status is None else site.status().problems,
        )

    @routes.get("/machines/{name}")
    def machine(
        request: Request,
        name: str,
        channel: str | None = None,
        level: str | None = None,
        point: str | None = None,
        before: Annotated[int | None, Query(ge=1, lt=2**31)] = None,
    ) -> HTMLResponse:
        overview = find_machine(site, name)
        level_choice = chosen_level(site, overview, channel, level, point)
        rows = read.recordings(name, before=before, limit=ROWS)
        setting = site.config.machine(name)
        recalibrations = read.recalibrations(name)
        estimates = {estimate.name for recalibration in recalibrations for estimate in recalibration.estimates}
        return site.render(
            request,
            "machine.html.jinja",
            machine=overview,
            state=state_of(overview),
            pump=None if setting is None else setting.pump,
            is_silenced=_is_silenced(site, overview),
            alarms=_with_states(overview.alarms),
            past_alarms=read.alarms(name, state="closed", limit=10),
            rate=site.config.alarms.false_alarm_rate,
            limit=site.alarm_capital,
            recordings=rows,
            older=rows[-1].id if len(rows) == ROWS else None,
            events=read.events(name, limit=20),
            estimates=[(estimate, level_choice.estimate_address(estimate)) for estimate in sorted(estimates)],
            **level_choice.context(site.language(request)),
        )

    @routes.get("/recordings/{identity}")
    def recording(request: Request, identity: int) -> HTMLResponse:
        stored = find_recording(site, identity)
        reasons = stored.judgment.reasons
        language = site.language(request)
        before = read.recordings(stored.machine, before=stored.id, limit=1)
        past_alarms = read.alarms(stored.machine, state="closed", limit=ROWS)
        open_alarms = find_machine(site, stored.machine).alarms
        alarms = [
            alarm
            for alarm in (*open_alarms, *past_alarms)
            if alarm.recording == stored.id or (alarm.state != "closed" and alarm.opened <= stored.judgment.time)
        ]
        verdict: Mapping[str, Any] = reasons.get("verdict") or {}
        probabilities: Mapping[str, float] = verdict.get("probabilities") or {}
        return site.render(
            request,
            "recording.html.jinja",
            recording=stored,
            reasons=reasons,
            alarms=_with_states(alarms),
            probabilities=sorted(probabilities.items(), key=lambda item: -item[1]),
            no_verdict=verdict.get("no_verdict"),
            is_unknown=_is_unknown(stored),
            checks=_checks(stored),
            moved=reasons.get("moved") or [],
            sentences=_sentences(stored),
            notes=reasons.get("notes") or [],
            learning=site.config.alarms.learning,
            limit=site.alarm_capital,
            facts=_facts(stored, language),
            earlier=before[0].id if before else None,
            later=read.later_recording(identity),
        )

    @routes.get("/alarms")
    def alarms(request: Request, state: str = "") -> HTMLResponse:
        chosen = state if state in ("open", "acknowledged", "closed") else ""
        if chosen == "closed":
            shown = list(read.alarms(state=chosen, limit=_PAST_ALARMS))
        else:
            waiting = (alarm for machine in read.machines() for alarm in machine.alarms)
            shown = sorted((alarm for alarm in waiting if chosen in ("", alarm.state)), key=lambda alarm: -alarm.id)
        return site.render(request, "alarms.html.jinja", alarms=_with_states(shown), chosen=chosen)

    @routes.get("/alarms/{identity}")
    def alarm(request: Request, identity: int) -> HTMLResponse:
        stored = find_alarm(site, identity)
        return site.render(request, "alarm.html.jinja", alarm=stored, state=alarm_state(stored))

    @routes.get("/log")
    def log(request: Request) -> HTMLResponse:
        return site.render(
            request,
            "log.html.jinja",
            status=None if site.status is None else site.status(),
            rejections=read.rejections(limit=100),
            events=read.events(limit=100),
        )

    return routes


def _card(site: Site, machine: MachineOverview) -> dict[str, Any]:
    capital = site.history.read.trend(machine.name, "", "capital", limit=_SPARKS).values
    last = machine.last
    return {
        "machine": machine,
        "state": state_of(machine),
        "is_silenced": _is_silenced(site, machine),
        "is_quiet": last is not None and site.clock() - last.judgment.time > QUIET,
        "line": sparkline(capital.tolist(), site.alarm_capital),
    }


def _is_silenced(site: Site, machine: MachineOverview) -> bool:
    return machine.silenced is not None and machine.silenced > site.clock()


def _with_states(alarms: Sequence[Alarm]) -> list[tuple[Alarm, Any]]:
    return [(alarm, alarm_state(alarm)) for alarm in alarms]


def _sentences(stored: StoredRecording) -> Sequence[str]:
    reasons = stored.judgment.reasons
    findings = [finding["sentence"] for finding in reasons.get("findings") or []]
    return [*findings, *(reasons.get("sentences") or [])] if not reasons.get("moved") else findings


def _is_unknown(stored: StoredRecording) -> bool:
    """Whether the model calls the recording unlike those of its training."""
    verdict = stored.judgment.reasons.get("verdict") or {}
    return bool((verdict.get("trust") or {}).get("unknown"))


def _checks(stored: StoredRecording) -> Sequence[Check]:
    judgment = stored.judgment
    if judgment.label in (None, "abnormal"):
        return next_checks(unknown=True)
    return next_checks(judgment.label, unknown=_is_unknown(stored))


def _facts(stored: StoredRecording, language: Language) -> Sequence[tuple[str, str]]:
    judgment = stored.judgment
    speed = None if judgment.speed is None else judgment.speed * 30 / 3.141592653589793
    pressure = None if judgment.pressure is None else judgment.pressure / 1e6
    return (
        ("Operating point", judgment.point or "—"),
        ("Speed", f"{language.number(speed, 4)} rpm"),
        ("Discharge pressure", f"{language.number(pressure)} MPa"),
        ("Duration", f"{language.number(judgment.duration)} s"),
        ("Sample rate", f"{language.number(judgment.sample_rate, 5)} Hz"),
        ("Channels", ", ".join(judgment.channels)),
        ("Source", judgment.source),
        ("File", judgment.file or "—"),
        ("Received", language.moment(judgment.received)),
        ("Model", judgment.model or "—"),
        ("Content", judgment.content),
    )
