"""The pages: machines, one machine, one recording, alarms, log."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import lru_cache
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from markupsafe import Markup
from starlette.responses import HTMLResponse, Response

from swashtwin.diagnosis import Check
from swashtwin.foundation import PASCALS, PressureUnit, convert_pressures, rpm
from swashtwin.monitoring.alarms.baseline import baseline_band_powers
from swashtwin.monitoring.history.reading import MachineOverview
from swashtwin.monitoring.history.schema import Alarm, Judgment
from swashtwin.monitoring.page.advice import (
    checks_of_alarm,
    checks_of_recording,
    suspected_label,
)
from swashtwin.monitoring.page.cards import SILENT, Card, Standing, build_card
from swashtwin.monitoring.page.charts import BAND_SPREADS, draw_trend
from swashtwin.monitoring.page.formatting import NO_VALUE, format_time, indicator_name, number
from swashtwin.monitoring.page.order_map import CHANGE_STEPS_DB, draw_order_map, order_of
from swashtwin.monitoring.page.pump_drawings import PumpDrawings
from swashtwin.monitoring.page.site import MAX_ID, Site
from swashtwin.monitoring.page.spectra import MAX_HEALTHY, draw_spectra
from swashtwin.monitoring.page.states import STATES, VERDICT_NAMES, group_indicators, state_of
from swashtwin.report import LivingPump

CARDS_PER_PAGE = 60
"""Machines on one page."""
ROWS_PER_TABLE = 25
"""Recordings in one table."""
N_SPARK_RECORDINGS = 40
"""Newest recordings of a machine that its card draws."""
URGENT_GROUP = "Needs attention"
"""Heading of the machines that need a person."""
OTHER_GROUP = "No action needed"
"""Heading of the machines without a site that need nobody."""
MAX_TREND_POINTS = 2000
"""Newest points of a trend that are drawn; a screen shows no more."""
_PAST_ALARMS = 200
_SHOWN_PAST_ALARMS = 10

# Drawn spectra that are kept, since an open page loads them with each change of the history.
_CACHED_SPECTRA = 16

_EVENTS_OF_MACHINE = 20
_LOG_ROWS = 100


@dataclass(frozen=True)
class Selection:
    """What the figures of a machine show, and what else can be selected."""

    channel: str
    """Channel; empty for values of the whole recording."""
    indicator: str
    """Indicator of the channel."""
    point: str
    """Operating point; empty for all."""
    channels: Sequence[str] = ()
    """All channels."""
    indicators: Sequence[tuple[str, Sequence[str]]] = ()
    """All indicators of the channel, by group."""
    points: Sequence[str] = ()
    """All operating points."""

    @property
    def title(self) -> str:
        """Title of the trend."""
        if self.channel:
            return f"{self.channel}: {self.indicator}"
        return VERDICT_NAMES.get(self.indicator, self.indicator)

    def filter_alarms(self, alarms: Iterable[Alarm]) -> Sequence[Alarm]:
        """Return the alarms of the operating point."""
        return [alarm for alarm in alarms if self.point in ("", alarm.point)]


class Pages:
    """The pages of one site."""

    def __init__(self, site: Site) -> None:
        self._site = site
        self._reader = site.history.reader
        self._site_names = {
            machine.name: machine.site for machine in site.config.machines if machine.site
        }
        self._drawings = PumpDrawings(site.config.pressure_unit)
        self._spectra = lru_cache(maxsize=_CACHED_SPECTRA)(self._draw_spectra)

    def _draw_spectra(
        self,
        identity: int,
        _: bool,
        healthy: tuple[int, ...],
        is_over_orders: bool = True,
        channel: str | None = None,
    ) -> Sequence[Markup]:
        """Draw the spectra of a recording; the second argument only renews the cached figure.

        It tells whether the samples are stored, which may change.
        """
        return draw_spectra(
            self._site,
            self._site.recording(identity),
            healthy,
            is_over_orders=is_over_orders,
            channel=channel,
        )

    def overview(
        self,
        request: Request,
        state: str = "",
        text: Annotated[str, Query(max_length=100)] = "",
        page: Annotated[int, Query(ge=1, le=100_000)] = 1,
    ) -> HTMLResponse:
        """Show all machines, the most urgent first."""
        site = self._site
        now = datetime.now(UTC)
        standings = sorted(
            (
                Standing.of(machine, self._site_names.get(machine.name, ""), now)
                for machine in site.machines()
            ),
            key=lambda standing: standing.urgency,
        )
        named = [standing for standing in standings if standing.matches("", text)]
        counts = Counter(standing.state for standing in named)
        counts[SILENT] = sum(standing.is_silent for standing in named)

        matching = [standing for standing in named if standing.matches(state, text)]
        page_count = max(1, math.ceil(len(matching) / CARDS_PER_PAGE))
        # Machines may have become fewer since the link was made.
        page = min(page, page_count)
        start = (page - 1) * CARDS_PER_PAGE
        page_standings = matching[start : start + CARDS_PER_PAGE]
        scores = self._reader.newest_scores(
            [standing.machine.name for standing in page_standings], N_SPARK_RECORDINGS
        )
        cards = [
            build_card(standing, scores[standing.machine.name], now) for standing in page_standings
        ]

        return site.render(
            request,
            "overview.html.jinja",
            groups=_group(cards),
            group_sizes=Counter(_group_name(standing) for standing in matching),
            n_urgent=sum(standing.needs_attention for standing in standings),
            summary=[(state, counts[state]) for state in (*STATES, SILENT) if counts[state]],
            selected_state=state,
            text=text,
            page=page,
            pages=page_count,
            total=len(standings),
            problems=site.problems,
        )

    def machine(
        self,
        request: Request,
        name: str,
        channel: str | None = None,
        indicator: str | None = None,
        point: str | None = None,
        before: Annotated[int | None, Query(ge=1, le=MAX_ID)] = None,
    ) -> HTMLResponse:
        """Show one machine: its alarms, trends, spectrum, recordings and events."""
        site = self._site
        overview = site.machine(name)
        configured_machine = site.config.machine(name)
        pump = None
        if configured_machine is not None:
            pump = configured_machine.pump

        rows = self._reader.recordings(name, before=before, limit=ROWS_PER_TABLE)
        older = None
        if len(rows) == ROWS_PER_TABLE:
            older = rows[-1].id

        alarms = self._reader.alarms(name, limit=_PAST_ALARMS)
        selection = self._select(overview, channel, indicator, point)
        baseline = self._load_baseline(name, selection)
        return site.render(
            request,
            "machine.html.jinja",
            machine=overview,
            state=state_of(overview),
            pump=pump,
            alarms=overview.alarms,
            past_alarms=[alarm for alarm in alarms if alarm.closed is not None][
                :_SHOWN_PAST_ALARMS
            ],
            rate=site.config.alarms.false_alarm_rate,
            limit=site.alarm_capital,
            recordings=rows,
            older=older,
            events=self._reader.events(name, limit=_EVENTS_OF_MACHINE),
            deviation=[
                self._draw_trend(name, Selection("", value, ""), alarms)
                for value in ("score", "capital")
            ],
            selection=selection,
            verdict_names=VERDICT_NAMES,
            band=f"Healthy baseline ± {BAND_SPREADS:g} spreads",
            trend=self._draw_trend(name, selection, alarms, baseline.get(selection.indicator)),
            has_baseline=selection.indicator in baseline,
            order_map=self._draw_order_map(name, selection, alarms, baseline),
            steps=CHANGE_STEPS_DB,
            newest_spectrum=self._draw_newest_spectrum(name, selection),
        )

    def _select(
        self,
        machine: MachineOverview,
        channel: str | None,
        indicator: str | None,
        point: str | None,
    ) -> Selection:
        """Return what the figures of a machine show, and what else can be selected.

        Without a request, it is what changed most in the machine's alarms, or else the first order.
        """
        points = [row.name for row in self._reader.operating_points(machine.name)]
        if point is None and machine.last is not None:
            point = machine.last.point
        if point is None or point not in points:
            point = ""

        names_by_channel: dict[str, list[str]] = {}
        for stored_channel, name in self._reader.indicator_names(machine.name):
            names_by_channel.setdefault(stored_channel, []).append(name)
        # Values of the verdict have no channel; every machine has them.
        names_by_channel[""] = list(VERDICT_NAMES)

        if channel is None:
            channel, indicator = _largest_change(machine.alarms) or (channel, indicator)
        if channel is None or channel not in names_by_channel:
            channel = next(iter(names_by_channel))
        groups = group_indicators(names_by_channel[channel])
        if indicator is None or indicator not in names_by_channel[channel]:
            indicator = groups[0][1][0]
        return Selection(channel, indicator, point, list(names_by_channel), groups, points)

    def _load_baseline(
        self, machine: str, selection: Selection
    ) -> Mapping[str, tuple[float, float]]:
        """Return (median, scatter) of each indicator of the selected channel, if it is known."""
        stored = self._reader.baseline(machine, selection.point)
        if not stored:
            return {}
        return {
            name: values
            for (channel, name), values in baseline_band_powers(stored).items()
            if channel == selection.channel
        }

    def _draw_trend(
        self,
        machine: str,
        selection: Selection,
        alarms: Sequence[Alarm],
        baseline: tuple[float, float] | None = None,
    ) -> Markup:
        indicator = selection.indicator
        trend = self._reader.trend(
            machine,
            selection.channel,
            indicator,
            point=selection.point or None,
            limit=MAX_TREND_POINTS,
        )

        size, unit = self._unit_of(selection.channel, indicator)
        limit = None
        if indicator == "capital":
            limit = self._site.alarm_capital

        return draw_trend(
            replace(trend, values=trend.values / size),
            VERDICT_NAMES.get(indicator, indicator),
            unit,
            selection.filter_alarms(alarms),
            baseline=baseline,
            limit=limit,
        )

    def _draw_order_map(
        self,
        machine: str,
        selection: Selection,
        alarms: Sequence[Alarm],
        baseline: Mapping[str, tuple[float, float]],
    ) -> Markup:
        """Return the map of the selected channel; empty if it has no shaft orders."""
        names = [name for _, group in selection.indicators for name in group]
        orders = sorted((order_of(name), name) for name in names if order_of(name) is not None)
        if not orders:
            return Markup("")

        table = self._reader.indicator_table(
            machine,
            selection.channel,
            [name for _, name in orders],
            point=selection.point or None,
            limit=MAX_TREND_POINTS,
        )
        configured_machine = self._site.config.machine(machine)
        pistons = None if configured_machine is None else configured_machine.piston_count
        return draw_order_map(table, baseline, pistons, selection.filter_alarms(alarms))

    def _draw_newest_spectrum(
        self, machine: str, selection: Selection
    ) -> tuple[Judgment, Markup] | None:
        """Return the newest recording whose samples are stored, and the selected channel's
        spectrum; `None` without one.
        """
        rows = self._reader.recordings(machine, point=selection.point or None, limit=ROWS_PER_TABLE)
        newest = next((row for row in rows if row.waveform is not None), None)
        if newest is None or selection.channel not in newest.channels:
            return None
        healthy = tuple(self._reader.healthy_files(newest, MAX_HEALTHY))
        spectra = self._spectra(newest.id, True, healthy, channel=selection.channel)
        if not spectra:
            return None
        return newest, spectra[0]

    def _unit_of(self, channel: str, indicator: str) -> tuple[float, str]:
        """Return the unit in which an indicator is shown, and its size in the history's unit."""
        if channel:
            return 1.0, "dB"
        pressure_unit = self._site.config.pressure_unit
        units = {
            "score": (1.0, "spreads"),
            "speed": (rpm(1), "rpm"),
            "pressure": (PASCALS[pressure_unit], pressure_unit),
        }
        return units.get(indicator, (1.0, ""))

    def recording(
        self,
        request: Request,
        identity: int,
        axis: Annotated[str, Query(max_length=20)] = "",
    ) -> HTMLResponse:
        """Show one recording: verdict, evidence, spectrum, facts."""
        judgment = self._site.recording(identity)
        older_rows = self._reader.recordings(judgment.machine, before=judgment.id, limit=1)
        earlier = next((row.id for row in older_rows), None)

        closed_alarms = self._reader.alarms(judgment.machine, state="closed", limit=ROWS_PER_TABLE)
        alarms = [
            alarm
            for alarm in (*self._site.machine(judgment.machine).alarms, *closed_alarms)
            if alarm.recording == judgment.id
            or (alarm.state != "closed" and alarm.opened <= judgment.time)
        ]

        healthy = tuple(self._reader.healthy_files(judgment, MAX_HEALTHY))
        healthy_caption = ""
        if healthy:
            healthy_caption = (
                f"Range of {len(healthy)} healthy recordings at the same operating point"
            )

        return self._site.render(
            request,
            "recording.html.jinja",
            judgment=judgment,
            reasons=judgment.reasons,
            alarms=alarms,
            checks=checks_of_recording(judgment),
            limit=self._site.alarm_capital,
            facts=_facts(judgment, self._site.config.pressure_unit),
            spectra=self._spectra(
                judgment.id, judgment.waveform is not None, healthy, axis != "frequency"
            ),
            is_over_orders=axis != "frequency" and judgment.speed is not None,
            healthy=healthy_caption,
            earlier=earlier,
            later=self._reader.later_recording(identity),
        )

    def alarms(self, request: Request, state: str = "") -> HTMLResponse:
        """Show alarms of all machines, newest first."""
        selected_state = ""
        if state in ("open", "acknowledged", "closed"):
            selected_state = state

        if selected_state == "closed":
            alarms = list(self._reader.alarms(state="closed", limit=_PAST_ALARMS))
        else:
            # Machines list every alarm that is not closed, however many closed ones came later.
            alarms = []
            for machine in self._reader.machines():
                alarms += machine.alarms
            alarms = [alarm for alarm in alarms if selected_state in ("", alarm.state)]
            alarms.sort(key=lambda alarm: alarm.id, reverse=True)

        return self._site.render(
            request, "alarms.html.jinja", alarms=alarms, selected_state=selected_state
        )

    def alarm(self, request: Request, identity: int) -> HTMLResponse:
        """Show one alarm."""
        alarm = self._site.alarm(identity)
        checks: Sequence[Check] = ()
        if alarm.kind == "pump" and alarm.closed is None:
            checks = checks_of_alarm(alarm, self._site.machine(alarm.machine).last)
        return self._site.render(
            request,
            "alarm.html.jinja",
            alarm=alarm,
            checks=checks,
            has_suspect=suspected_label(alarm.evidence) is not None,
        )

    def pump(self, request: Request, identity: int) -> Response:
        """Return the part of an alarm's page that takes seconds: the pump with the suspected fault.

        The page's script loads it. The answer has no content if the pump cannot be drawn.
        """
        alarm = self._site.alarm(identity)
        label = suspected_label(alarm.evidence)
        pumps: Sequence[LivingPump] = ()
        if label is not None:
            judgment = None
            if alarm.recording is not None:
                judgment = self._reader.recording(alarm.recording)
            pumps = self._drawings.draw(label, self._site.config.machine(alarm.machine), judgment)
        if not pumps:
            return Response(status_code=204)
        return self._site.render(request, "pump.html.jinja", pumps=pumps)

    def log(self, request: Request) -> HTMLResponse:
        """Show the status of the watch, recordings that were not judged, and events."""
        status = None
        if self._site.status is not None:
            status = self._site.status()
        return self._site.render(
            request,
            "log.html.jinja",
            status=status,
            rejections=self._reader.rejections(limit=_LOG_ROWS),
            events=self._reader.events(limit=_LOG_ROWS),
        )


def page_routes(site: Site) -> APIRouter:
    """Return the addresses of the pages."""
    routes = APIRouter(include_in_schema=False)
    pages = Pages(site)
    for path, page in (
        ("/", pages.overview),
        ("/machines/{name}", pages.machine),
        ("/recordings/{identity}", pages.recording),
        ("/alarms", pages.alarms),
        ("/alarms/{identity}", pages.alarm),
        ("/alarms/{identity}/pump", pages.pump),
        ("/log", pages.log),
    ):
        routes.get(path, response_class=HTMLResponse)(page)
    return routes


def _group_name(standing: Standing) -> str:
    """Return the heading under which the start page lists a machine."""
    if standing.needs_attention:
        return URGENT_GROUP
    return standing.site or OTHER_GROUP


def _group(cards: Iterable[Card]) -> Sequence[tuple[str, Sequence[Card]]]:
    """Return cards that are sorted by urgency, by their headings."""
    groups: dict[str, list[Card]] = {}
    for card in cards:
        groups.setdefault(_group_name(card.standing), []).append(card)
    return list(groups.items())


def _largest_change(alarms: Sequence[Alarm]) -> tuple[str, str] | None:
    """Return channel and indicator of the largest change in alarms; `None` if nothing changed."""
    changes: list[dict[str, Any]] = []
    for alarm in alarms:
        changes += alarm.evidence.get("moved") or []
    if not changes:
        return None

    largest = max(changes, key=lambda change: abs(change["change"]))
    return largest["channel"], indicator_name(largest["band"])


def _facts(judgment: Judgment, pressure_unit: PressureUnit) -> Sequence[tuple[str, str]]:
    shown_speed = None
    if judgment.speed is not None:
        shown_speed = judgment.speed / rpm(1)
    shown_pressure = None
    if judgment.pressure is not None:
        shown_pressure = judgment.pressure / PASCALS[pressure_unit]
    return (
        ("Operating point", convert_pressures(judgment.point or NO_VALUE, pressure_unit)),
        ("Speed", f"{number(shown_speed, 4)} rpm"),
        ("Discharge pressure", f"{number(shown_pressure)} {pressure_unit}"),
        ("Duration", f"{number(judgment.duration)} s"),
        ("Sample rate", f"{number(judgment.sample_rate, 5)} Hz"),
        ("Channels", ", ".join(judgment.channels)),
        ("Source", judgment.source),
        ("File", judgment.file or NO_VALUE),
        ("Received", format_time(judgment.received)),
        ("Model", judgment.model or NO_VALUE),
        ("Content", judgment.content),
    )
