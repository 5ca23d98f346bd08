"""The pages: machines, one machine, one recording, alarms, log."""

import math
from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from markupsafe import Markup
from starlette.responses import HTMLResponse

from swashtwin.diagnosis import Check, next_checks
from swashtwin.monitoring.alarms.baseline import baseline_band_powers
from swashtwin.monitoring.history.reading import MachineOverview
from swashtwin.monitoring.history.schema import Judgment
from swashtwin.monitoring.page.charts import BAND_SPREADS, MOST_HEALTHY, draw_spectrum, draw_trend
from swashtwin.monitoring.page.site import (
    STATES,
    VERDICT_NAMES,
    Site,
    grouped_levels,
    moment_text,
    number,
    state_of,
    stored_name,
)

CARDS = 60
"""Machines on one page."""
ROWS = 25
"""Recordings in one table."""
QUIET = timedelta(days=1)
"""A machine that sent nothing for so long is marked."""
MOST_POINTS = 2000
"""Points of a trend; the newest."""
_PAST_ALARMS = 200
_SPECTRA = 16
"""Drawn spectra that are kept, since an open page asks for them with each change of the history."""


class Pages:
    """The pages of one site."""

    def __init__(self, site: Site) -> None:
        self._site = site
        self._read = site.history.reader
        self._spectra = lru_cache(maxsize=_SPECTRA)(self._drawn)

    def _drawn(self, number: int, _: bool, healthy: tuple[int, ...]) -> Sequence[Markup]:
        return draw_spectrum(self._site, self._site.recording(number), healthy)

    def overview(
        self,
        request: Request,
        state: str = "",
        text: Annotated[str, Query(max_length=100)] = "",
        page: Annotated[int, Query(ge=1, le=100_000)] = 1,
    ) -> HTMLResponse:
        """All machines, the most urgent first."""
        site = self._site
        machines = sorted(
            site.machines(), key=lambda machine: (STATES.index(state_of(machine)), machine.name)
        )
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
            cards=[
                {
                    "machine": machine,
                    "state": state_of(machine),
                    "is_quiet": machine.last is not None
                    and datetime.now(UTC) - machine.last.time > QUIET,
                }
                for machine in shown
            ],
            summary=[(state, counts[state]) for state in STATES if counts[state]],
            chosen=state,
            text=text,
            page=min(page, pages),
            pages=pages,
            total=len(machines),
            problems=() if site.status is None else site.status().problems,
        )

    def machine(
        self,
        request: Request,
        name: str,
        channel: str | None = None,
        level: str | None = None,
        point: str | None = None,
        before: Annotated[int | None, Query(ge=1, lt=2**31)] = None,
    ) -> HTMLResponse:
        """One machine: its alarms, trends, recordings and events."""
        site = self._site
        overview = site.machine(name)
        rows = self._read.recordings(name, before=before, limit=ROWS)
        setting = site.config.machine(name)
        return site.render(
            request,
            "machine.html.jinja",
            machine=overview,
            state=state_of(overview),
            pump=None if setting is None else setting.pump,
            alarms=overview.alarms,
            past_alarms=self._read.alarms(name, state="closed", limit=10),
            rate=site.config.alarms.false_alarm_rate,
            limit=site.alarm_capital,
            recordings=rows,
            older=rows[-1].id if len(rows) == ROWS else None,
            events=self._read.events(name, limit=20),
            evidence=self._trend(name, "", "capital", ""),
            **self._chosen_level(overview, channel, level, point),
        )

    def _chosen_level(
        self, machine: MachineOverview, channel: str | None, level: str | None, point: str | None
    ) -> dict[str, Any]:
        """What was asked for, where the machine has it; else what moved most in its alarm, else its
        first order.
        """
        by_channel: dict[str, list[str]] = {}
        for its_channel, name in self._read.indicator_names(machine.name):
            by_channel.setdefault(its_channel, []).append(name)
        by_channel[""] = list(VERDICT_NAMES)
        points = [known.name for known in self._read.operating_points(machine.name)]
        if point is None:
            point = (machine.last.point if machine.last is not None else None) or ""
        point = point if point in points else ""
        if channel is None:
            moved = [
                change for alarm in machine.alarms for change in alarm.evidence.get("moved") or []
            ]
            furthest = max(moved, key=lambda change: abs(change["change"]), default=None)
            if furthest is not None:
                channel, level = furthest["channel"], stored_name(furthest["band"])
        if channel not in by_channel:
            channel = next(iter(by_channel))
        groups = grouped_levels(by_channel[channel])
        if level not in by_channel[channel]:
            level = groups[0][1][0]
        stored = self._read.baseline(machine.name, point)
        baseline = baseline_band_powers(stored).get((channel, level)) if stored else None
        return {
            "channel": channel,
            "level": level,
            "point": point,
            "channels": list(by_channel),
            "levels": groups,
            "points": points,
            "level_title": f"{channel}: {level}" if channel else VERDICT_NAMES[level][0],
            "verdict_names": {name: title for name, (title, _) in VERDICT_NAMES.items()},
            "trend": self._trend(machine.name, channel, level, point, baseline),
            "band": f"Healthy baseline ± {BAND_SPREADS:g} spreads" if baseline else "",
        }

    def _trend(
        self,
        machine: str,
        channel: str,
        level: str,
        point: str,
        baseline: tuple[float, float] | None = None,
    ) -> Markup:
        title, unit = VERDICT_NAMES.get(level, (level, "dB"))
        return draw_trend(
            self._read.trend(machine, channel, level, point=point or None, limit=MOST_POINTS),
            title,
            unit,
            [
                alarm
                for alarm in self._read.alarms(machine, limit=_PAST_ALARMS)
                if point in ("", alarm.point)
            ],
            baseline=baseline,
            limit=self._site.alarm_capital if level == "capital" else None,
        )

    def recording(self, request: Request, identity: int) -> HTMLResponse:
        """One recording: verdict, evidence, spectrum, facts."""
        judgment = self._site.recording(identity)
        before = self._read.recordings(judgment.machine, before=judgment.id, limit=1)
        past_alarms = self._read.alarms(judgment.machine, state="closed", limit=ROWS)
        alarms = [
            alarm
            for alarm in (*self._site.machine(judgment.machine).alarms, *past_alarms)
            if alarm.recording == judgment.id
            or (alarm.state != "closed" and alarm.opened <= judgment.time)
        ]
        healthy = tuple(self._read.healthy_files(judgment, MOST_HEALTHY))
        return self._site.render(
            request,
            "recording.html.jinja",
            judgment=judgment,
            reasons=judgment.reasons,
            alarms=alarms,
            checks=_checks(judgment),
            limit=self._site.alarm_capital,
            facts=_facts(judgment),
            spectra=self._spectra(judgment.id, judgment.waveform is not None, healthy),
            healthy=f"Range of {len(healthy)} healthy recordings at the same operating point"
            if healthy
            else "",
            earlier=before[0].id if before else None,
            later=self._read.later_recording(identity),
        )

    def alarms(self, request: Request, state: str = "") -> HTMLResponse:
        """Alarms of all machines, newest first."""
        chosen = state if state in ("open", "acknowledged", "closed") else ""
        if chosen == "closed":
            shown = list(self._read.alarms(state=chosen, limit=_PAST_ALARMS))
        else:
            waiting = (alarm for machine in self._read.machines() for alarm in machine.alarms)
            shown = sorted(
                (alarm for alarm in waiting if chosen in ("", alarm.state)),
                key=lambda alarm: -alarm.id,
            )
        return self._site.render(request, "alarms.html.jinja", alarms=shown, chosen=chosen)

    def alarm(self, request: Request, identity: int) -> HTMLResponse:
        """One alarm."""
        return self._site.render(request, "alarm.html.jinja", alarm=self._site.alarm(identity))

    def log(self, request: Request) -> HTMLResponse:
        """How the watch is doing, what was not judged, and events."""
        return self._site.render(
            request,
            "log.html.jinja",
            status=None if self._site.status is None else self._site.status(),
            rejections=self._read.rejections(limit=100),
            events=self._read.events(limit=100),
        )


def page_routes(site: Site) -> APIRouter:
    """Addresses of the pages and their figures."""
    routes = APIRouter(include_in_schema=False)
    pages = Pages(site)
    for path, page in (
        ("/", pages.overview),
        ("/machines/{name}", pages.machine),
        ("/recordings/{identity}", pages.recording),
        ("/alarms", pages.alarms),
        ("/alarms/{identity}", pages.alarm),
        ("/log", pages.log),
    ):
        routes.get(path, response_class=HTMLResponse)(page)
    return routes


def _checks(judgment: Judgment) -> Sequence[Check]:
    suspect = judgment.reasons.get("suspect")
    if judgment.label is None and suspect and suspect["certainty"] == "sure":
        return next_checks(suspect["label"])
    if judgment.label in (None, "abnormal"):
        return next_checks(unknown=True)
    return next_checks(judgment.label, unknown=bool(judgment.reasons["verdict"].get("unknown")))


def _facts(judgment: Judgment) -> Sequence[tuple[str, str]]:
    speed = None if judgment.speed is None else judgment.speed * 30 / math.pi
    pressure = None if judgment.pressure is None else judgment.pressure / 1e6
    return (
        ("Operating point", judgment.point or "—"),
        ("Speed", f"{number(speed, 4)} rpm"),
        ("Discharge pressure", f"{number(pressure)} MPa"),
        ("Duration", f"{number(judgment.duration)} s"),
        ("Sample rate", f"{number(judgment.sample_rate, 5)} Hz"),
        ("Channels", ", ".join(judgment.channels)),
        ("Source", judgment.source),
        ("File", judgment.file or "—"),
        ("Received", moment_text(judgment.received)),
        ("Model", judgment.model or "—"),
        ("Content", judgment.content),
    )
