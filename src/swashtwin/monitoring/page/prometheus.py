"""Metrics for Prometheus and the health check."""

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from fastapi import APIRouter, Request
from prometheus_client import CollectorRegistry, ProcessCollector, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector
from starlette.responses import JSONResponse, Response

from swashtwin.foundation import VERSION, SwashTwinError
from swashtwin.monitoring.page.site import STATES, Site, state_of

if TYPE_CHECKING:
    from swashtwin.monitoring.status import WatchStatus


Values = Iterable[tuple[tuple[str, ...], float]]
"""Labels and value of each sample of a metric."""
_CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"


class WatchCollector(Collector):
    """Reads the history and the watch's status whenever Prometheus asks."""

    def __init__(self, site: Site) -> None:
        self._site = site

    def collect(self) -> Iterable[Metric]:
        """All metrics of the watch; those of the history are absent while it cannot be reached."""
        yield _gauge("build_info", "Version of swashtwin.", ("version",), [((VERSION,), 1)])
        reachable = True
        try:
            yield from self._history_metrics()
        except SwashTwinError:
            reachable = False
        yield _gauge("history_up", "1 while the history can be reached.", (), [((), reachable)])
        if self._site.status is not None:
            yield from _status_metrics(self._site.status())

    def _history_metrics(self) -> Iterator[Metric]:
        machines, read = self._site.machines(), self._site.history.reader
        newest = [(machine.name, machine.last) for machine in machines if machine.last is not None]
        for name, text, value in (
            (
                "alarm_capital",
                "Evidence against luck of the newest recording.",
                lambda last: last.capital,
            ),
            (
                "verdict_probability",
                "Probability of the newest recording's verdict.",
                lambda last: last.probability,
            ),
            (
                "verdict_confidence",
                "Confidence of the newest recording's verdict.",
                lambda last: last.confidence,
            ),
            (
                "last_recording_timestamp_seconds",
                "Time of the newest recording.",
                lambda last: last.time.timestamp(),
            ),
        ):
            known = [
                ((machine,), value(last)) for machine, last in newest if value(last) is not None
            ]
            yield _gauge(name, text, ("machine",), known)
        states = [
            ((machine.name, state.code), state_of(machine) == state)
            for machine in machines
            for state in STATES
        ]
        yield _gauge(
            "machine_state", "1 for the state that a machine is in.", ("machine", "state"), states
        )
        alarms = Counter(
            (alarm.machine, alarm.kind, alarm.state)
            for machine in machines
            for alarm in machine.alarms
        )
        yield _gauge(
            "alarms", "Alarms that are not closed.", ("machine", "kind", "state"), alarms.items()
        )
        yield _gauge(
            "alarm_threshold",
            "Evidence at which an alarm is raised.",
            (),
            [((), self._site.alarm_capital)],
        )
        recordings = read.recordings_by_state().items()
        yield _counter(
            "recordings", "Recordings judged, by state.", ("machine", "state"), recordings
        )
        rejections = [((reason,), count) for reason, count in read.rejections_by_reason().items()]
        yield _counter(
            "rejections", "Recordings that were not judged, by reason.", ("reason",), rejections
        )


def _status_metrics(status: "WatchStatus") -> Iterator[Metric]:
    for name, text, value in (
        ("start_time_seconds", "When the watch started.", status.started.timestamp()),
        ("recordings_waiting", "Recordings that are not judged yet.", status.waiting),
        ("messages_waiting", "Messages that are not sent yet.", status.outbox),
        ("free_bytes", "Free space of the watch's folder.", status.free_bytes),
        ("problems", "Problems of the watch.", len(status.problems)),
    ):
        yield _gauge(name, text, (), [((), value)])
    labels, named = (
        ("source", "kind"),
        [((source.name, source.kind), source) for source in status.sources],
    )
    connected = [(names, source.problem is None) for names, source in named]
    yield _gauge("source_connected", "1 while a source is connected.", labels, connected)
    received = [(names, source.received) for names, source in named]
    yield _counter("source_received", "Recordings received by a source.", labels, received)
    for name, value in status.counters.items():
        yield _counter(
            f"watch_{name}", f"Counted by the watch: {name.replace('_', ' ')}.", (), [((), value)]
        )


def metric_routes(site: Site) -> APIRouter:
    """Addresses for Prometheus and for health checks."""
    routes = APIRouter(tags=["watch"])
    registry = CollectorRegistry()
    registry.register(WatchCollector(site))
    ProcessCollector(namespace="swashtwin", registry=registry)

    @routes.get("/metrics", response_class=Response)
    def metrics() -> Response:
        """Metrics in Prometheus' text form."""
        return Response(generate_latest(registry), media_type=_CONTENT_TYPE)

    @routes.get("/health")
    def health(request: Request) -> JSONResponse:
        """200 while the watch works, else 503; what is wrong is told to those who may use the
        page.
        """
        problems = list(site.status().problems) if site.status is not None else []
        try:
            site.history.reader.sequence()
        except SwashTwinError:
            problems.append("the history cannot be reached")
        answer: dict[str, object] = {"status": "problem" if problems else "ok"}
        if request.state.visitor is not None:
            answer["problems"] = problems
        return JSONResponse(answer, 503 if problems else 200)

    return routes


def _gauge(name: str, text: str, labels: tuple[str, ...], values: Values) -> Metric:
    return _filled(GaugeMetricFamily(f"swashtwin_{name}", text, labels=labels), values)


def _counter(name: str, text: str, labels: tuple[str, ...], values: Values) -> Metric:
    return _filled(CounterMetricFamily(f"swashtwin_{name}", text, labels=labels), values)


def _filled(family: GaugeMetricFamily | CounterMetricFamily, values: Values) -> Metric:
    for labels, value in values:
        family.add_metric(labels, float(value))
    return family
