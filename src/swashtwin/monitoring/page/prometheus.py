"""Metrics for Prometheus, and the health check."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

from fastapi import APIRouter, Request
from prometheus_client import CollectorRegistry, ProcessCollector, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector
from starlette.responses import JSONResponse, Response

from swashtwin.foundation import VERSION, SwashTwinError
from swashtwin.monitoring.history.reading import MachineOverview
from swashtwin.monitoring.page.site import Site
from swashtwin.monitoring.page.states import STATES, state_of
from swashtwin.monitoring.status import WatchStatus

Samples = Iterable[tuple[tuple[str, ...], float | None]]
"""Labels and value of each sample of a metric; samples without a value are left out."""
_CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"


class WatchCollector(Collector):
    """Reads the history and the watch's status whenever Prometheus collects metrics."""

    def __init__(self, site: Site) -> None:
        self._site = site

    def collect(self) -> Iterable[Metric]:
        """Return all metrics; those of the history are absent while it cannot be reached."""
        yield _gauge("build_info", "Version of swashtwin.", ("version",), [((VERSION,), 1)])

        # A failing history must not hide the metrics that report it.
        is_reachable = True
        try:
            yield from self._history_metrics()
        except SwashTwinError:
            is_reachable = False
        yield _gauge("history_up", "1 while the history can be reached.", (), [((), is_reachable)])

        if self._site.status is not None:
            yield from _status_metrics(self._site.status())

    def _history_metrics(self) -> Iterator[Metric]:
        machines = self._site.machines()
        reader = self._site.history.reader
        yield from _machine_metrics(machines)

        alarm_counts = Counter(
            (alarm.machine, alarm.kind, alarm.state)
            for machine in machines
            for alarm in machine.alarms
        )
        alarm_labels = ("machine", "kind", "state")
        yield _gauge("alarms", "Alarms that are not closed.", alarm_labels, alarm_counts.items())

        limit = self._site.alarm_capital
        yield _gauge("alarm_threshold", "Evidence at which an alarm is raised.", (), [((), limit)])

        recordings = reader.recordings_by_state().items()
        yield _counter(
            "recordings", "Recordings judged, by state.", ("machine", "state"), recordings
        )

        rejections = [((reason,), count) for reason, count in reader.rejections_by_reason().items()]
        yield _counter(
            "rejections", "Recordings that were not judged, by reason.", ("reason",), rejections
        )


def _machine_metrics(machines: Sequence[MachineOverview]) -> Iterator[Metric]:
    newest = [(machine.name, machine.last) for machine in machines if machine.last is not None]
    label = ("machine",)
    yield _gauge(
        "alarm_capital",
        "Evidence of the newest recording.",
        label,
        [((name,), judgment.capital) for name, judgment in newest],
    )
    yield _gauge(
        "verdict_probability",
        "Probability of the newest recording's verdict.",
        label,
        [((name,), judgment.probability) for name, judgment in newest],
    )
    yield _gauge(
        "verdict_confidence",
        "Share of the newest recording's windows that agree with its verdict.",
        label,
        [((name,), judgment.confidence) for name, judgment in newest],
    )
    yield _gauge(
        "last_recording_timestamp_seconds",
        "Time of the newest recording.",
        label,
        [((name,), judgment.time.timestamp()) for name, judgment in newest],
    )

    yield _gauge(
        "machine_state",
        "1 for the state that a machine is in.",
        ("machine", "state"),
        [
            ((machine.name, state.code), state_of(machine) == state)
            for machine in machines
            for state in STATES
        ],
    )


def _status_metrics(status: WatchStatus) -> Iterator[Metric]:
    for name, text, value in (
        ("start_time_seconds", "When the watch started.", status.started.timestamp()),
        ("recordings_waiting", "Recordings that are not judged yet.", status.waiting),
        ("messages_waiting", "Messages that are not sent yet.", status.outbox),
        ("free_bytes", "Free space of the watch's folder.", status.free_bytes),
        ("problems", "Problems of the watch.", len(status.problems)),
    ):
        yield _gauge(name, text, (), [((), value)])

    labels = ("source", "kind")
    connected = [((source.name, source.kind), source.problem is None) for source in status.sources]
    yield _gauge("source_connected", "1 while a source is connected.", labels, connected)
    received = [((source.name, source.kind), source.received) for source in status.sources]
    yield _counter("source_received", "Recordings received by a source.", labels, received)

    for name, count in status.counters.items():
        text = f"Counted by the watch: {name.replace('_', ' ')}."
        yield _counter(f"watch_{name}", text, (), [((), count)])


def metric_routes(site: Site) -> APIRouter:
    """Return the addresses for Prometheus and for health checks."""
    routes = APIRouter(tags=["watch"])
    registry = CollectorRegistry()
    registry.register(WatchCollector(site))
    ProcessCollector(namespace="swashtwin", registry=registry)

    @routes.get("/metrics", response_class=Response)
    def metrics() -> Response:
        """Return metrics in the text format of Prometheus."""
        return Response(generate_latest(registry), media_type=_CONTENT_TYPE)

    @routes.get("/health")
    def health(request: Request) -> JSONResponse:
        """Return 200 while the watch works, else 503.

        The problems are listed only for visitors who may use the page.
        """
        problems = list(site.problems)
        try:
            site.history.reader.sequence()
        except SwashTwinError:
            problems.append("the history cannot be reached")

        content: dict[str, object] = {"status": "ok"}
        code = 200
        if problems:
            content["status"] = "problem"
            code = 503
        if request.state.visitor is not None:
            content["problems"] = problems
        return JSONResponse(content, code)

    return routes


def _gauge(name: str, text: str, labels: tuple[str, ...], samples: Samples) -> Metric:
    return _fill(GaugeMetricFamily(f"swashtwin_{name}", text, labels=labels), samples)


def _counter(name: str, text: str, labels: tuple[str, ...], samples: Samples) -> Metric:
    return _fill(CounterMetricFamily(f"swashtwin_{name}", text, labels=labels), samples)


def _fill(family: GaugeMetricFamily | CounterMetricFamily, samples: Samples) -> Metric:
    for labels, value in samples:
        if value is not None:
            family.add_metric(labels, float(value))
    return family
