"""Figures as JSON for the page's own script."""

from typing import Annotated, Any

from fastapi import APIRouter, HTTPException, Query, Request

from swashtwin.monitoring.page.content.charts import Figure, interval_figure, spectrum_figure, trend_figure
from swashtwin.monitoring.page.content.levels import baseline_band
from swashtwin.monitoring.page.content.spectra import compared_spectrum
from swashtwin.monitoring.page.content.wording import VERDICT_NAMES, level_name
from swashtwin.monitoring.page.routes.records import find_machine, find_recording
from swashtwin.monitoring.page.site import Site

MOST_POINTS = 2000
"""Points of a trend; the newest."""
_MOST_ALARMS = 200

Short = Annotated[str, Query(max_length=200)]


def chart_routes(site: Site) -> APIRouter:
    """Addresses of the figures."""
    routes = APIRouter(prefix="/charts", include_in_schema=False)
    read = site.history.read

    @routes.get("/machines/{name}/trend")
    def trend(request: Request, name: str, level: Short, channel: Short = "", point: Short = "") -> dict[str, Any]:
        find_machine(site, name)
        language = site.language(request)
        title, unit = VERDICT_NAMES.get(level, (level_name(level, language), "dB"))
        values = read.trend(name, channel, level, point=point or None, limit=MOST_POINTS)
        alarms = [alarm for alarm in read.alarms(name, limit=_MOST_ALARMS) if point in ("", alarm.point)]
        return trend_figure(
            values,
            language(title) if level in VERDICT_NAMES else title,
            unit,
            alarms,
            language,
            band=baseline_band(site, name, point, channel, level),
            limit=site.alarm_capital if level == "capital" else None,
        )

    @routes.get("/machines/{name}/twin")
    def twin(name: str, estimate: Short) -> Figure:
        find_machine(site, name)
        return interval_figure(read.recalibrations(name), estimate)

    @routes.get("/recordings/{identity}")
    def spectrum(request: Request, identity: int) -> dict[str, Any]:
        stored = find_recording(site, identity)
        comparison = compared_spectrum(site, stored)
        if comparison is None:
            raise HTTPException(404, "This recording has no spectrum.")
        return spectrum_figure(comparison, site.language(request))

    return routes
