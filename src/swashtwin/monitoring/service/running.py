"""The process of a watch: sources, judgment, messages and the page, each in a thread."""

import hashlib
import logging
import shutil
import socket
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from swashtwin.foundation import InputError, SwashTwinError, return_memory
from swashtwin.monitoring.config.settings import (
    FolderSource,
    HttpSource,
    LiveSource,
    MqttSource,
    WatchConfig,
)
from swashtwin.monitoring.history.database import HistoryError
from swashtwin.monitoring.history.history import History
from swashtwin.monitoring.service.deliveries import N_IN_A_ROW
from swashtwin.monitoring.service.outbox_sender import OutboxSender
from swashtwin.monitoring.sources.delivery import Delivery, accept_facts
from swashtwin.monitoring.sources.folder import FolderWatch
from swashtwin.monitoring.sources.live import LiveWatch
from swashtwin.monitoring.sources.mqtt import MqttWatch
from swashtwin.monitoring.sources.spool import Spool, lock_folder
from swashtwin.monitoring.status import SourceStatus, WatchStatus

if TYPE_CHECKING:
    from swashtwin.monitoring.service.judging import Outcome, Pipeline
    from swashtwin.monitoring.service.severities import SeverityMeasurer

POLL_INTERVAL_S = 0.5
"""Time between two looks at whether to stop."""
FIRST_PAUSE_S = 0.2
"""Time before a recording that the history did not take is tried again; each further pause is twice
the previous one.
"""
MAX_PAUSE_S = 15.0
"""Longest pause: a history that is back is used within a quarter of a minute."""
STOP_TIMEOUT_S = 20.0
"""Time that each thread has to end; systemd kills a service after 90 s by default."""
SWEEP_INTERVAL_S = 600.0
"""Time between two searches for waveforms without a recording, and between returns of memory."""
_log = logging.getLogger("swashtwin.watch")


class Watch:
    """A watch that runs in this process."""

    def __init__(
        self, config: WatchConfig, history: History, progress: "Callable[[Outcome], None]"
    ) -> None:
        self.config = config
        self.history = history
        self._progress = progress
        self._started = datetime.now(UTC)
        self._stop = threading.Event()
        self._spool = Spool(config.folder / "spool")
        self._sender = OutboxSender(config, history)
        self._sources: list[FolderWatch | MqttWatch | LiveWatch] = []
        self._uploads: SourceStatus | None = None
        self._n_refused_uploads = 0
        """Uploads in a row whose facts were invalid."""
        self._open_sources()
        self._counters = {"judged": 0.0, "rejected": 0.0, "failures": 0.0, "seconds_judging": 0.0}
        self._model_problems: list[str] = []
        self._pipeline: Pipeline | None = None
        self._measurer: SeverityMeasurer | None = None
        self._measuring: threading.Thread | None = None
        self._announced_keys: set[str] = set()
        """Recordings that wait for tags and were reported to `progress`."""
        self._history_problem: str | None = None
        self._last_sweep = -SWEEP_INTERVAL_S

    def _open_sources(self) -> None:
        # The name of an MQTT session must stay the same over restarts, and differ between watches.
        identity = f"{socket.gethostname()} {self.config.folder.resolve()}"
        digest = hashlib.sha256(identity.encode()).hexdigest()[:16]

        for source in self.config.sources:
            match source:
                case FolderSource():
                    self._sources.append(FolderWatch(source, self._spool.add, self.config.folder))
                case MqttSource():
                    self._sources.append(MqttWatch(source, self._spool.add, f"swashtwin-{digest}"))
                case LiveSource():
                    self._sources.append(LiveWatch(source, self._spool.add, self.config))
                case HttpSource():
                    self._uploads = SourceStatus(source.name, source.kind)

    def run(self, stop: threading.Event, started: Callable[[str], None]) -> None:
        """Watch until `stop` is set.

        Raises
        ------
        SwashTwinError
            A thread ended unexpectedly: a watch without it would look alive and judge nothing.
        """
        from swashtwin.monitoring.page.server import serving_page
        from swashtwin.monitoring.page.watch_page import build_watch_page

        page = self.config.page
        application = build_watch_page(self.config, self.history, self.upload, self.status)
        with serving_page(application, page.host, page.port):
            threads = self._start_threads()
            started(page.address)
            try:
                while not stop.wait(POLL_INTERVAL_S):
                    _require_alive(threads)
            finally:
                self._stop.set()
                for thread in threads:
                    thread.join(STOP_TIMEOUT_S)
                self._end_measuring()

    def _start_threads(self) -> list[threading.Thread]:
        tasks: dict[str, Callable[[], None]] = {
            f"source {source.status.name}": partial(source.run, self._stop)
            for source in self._sources
        }
        tasks["judge"] = self._judge_all
        tasks["outbox"] = partial(self._sender.run, self._stop, self._sweep)

        threads = []
        for name, task in tasks.items():
            thread = threading.Thread(target=task, name=name, daemon=True)
            thread.start()
            threads.append(thread)
        return threads

    def run_once(self, stop: threading.Event) -> None:
        """Judge what the folders and the spool hold now, and send the messages of it."""
        pipeline = self._open_pipeline()
        for source in self._sources:
            if isinstance(source, LiveWatch):
                source.status.fail("not recorded: a live source needs a watch that keeps running")
        folders = [source for source in self._sources if isinstance(source, FolderWatch)]
        threads = [threading.Thread(target=folder.drain, args=(stop,)) for folder in folders]
        for thread in threads:
            thread.start()

        while not stop.is_set():
            is_delivering = any(thread.is_alive() for thread in threads)
            if not is_delivering and len(self._spool) == self._spool.n_held:
                break
            self._judge_next(pipeline, stop)
        for thread in threads:
            thread.join()

        # Alarms are reported before their severities are measured, which may take minutes.
        self._sender.send_all()
        measuring = self._start_measuring(partial(_measure_severities, stop=stop))
        while measuring.is_alive() and not stop.is_set():
            measuring.join(POLL_INTERVAL_S)
        self._end_measuring()
        self._sender.send_all()

        self._sweep()

    def upload(self, path: Path, name: str, machine: str | None, facts: Mapping[str, str]) -> str:
        """Put an uploaded file into the spool, and return its SHA-256.

        Raises
        ------
        InputError
            No source takes uploads, or a fact is invalid.
        OSError
            The disk or the spool is full.
        """
        if self._uploads is None:
            raise InputError(
                'This watch takes no uploads: add a [[source]] with kind = "http" to its '
                "configuration."
            )

        try:
            accepted_facts = accept_facts(facts)
        except InputError as cause:
            self._n_refused_uploads += 1
            if self._n_refused_uploads >= N_IN_A_ROW:
                self._uploads.fail(
                    f"{self._n_refused_uploads} uploads in a row were refused; the last one: "
                    f"{cause}"
                )
            raise
        delivery = Delivery(
            self._uploads.name, name, datetime.now(UTC), machine or None, accepted_facts
        )
        try:
            digest = self._spool.add(delivery, path)
        except OSError as cause:
            self._uploads.fail(cause.strerror or str(cause))
            raise
        self._uploads.succeed(1)
        self._n_refused_uploads = 0
        return digest

    def status(self) -> WatchStatus:
        """Return how the watch is doing.

        Nothing but the free space is read from the disk, so that a health check stays fast.
        """
        statuses = [source.status for source in self._sources]
        if self._uploads is not None:
            statuses.append(self._uploads)

        problems = [
            f"source {status.name}: {status.problem}"
            for status in statuses
            if status.problem is not None
        ]
        for problem in (self._history_problem, self._sender.problem):
            if problem:
                problems.append(problem)
        problems += self._model_problems
        if self._pipeline is not None:
            problems += self._pipeline.delivery_problems

        return WatchStatus(
            started=self._started,
            waiting=len(self._spool),
            outbox=self._sender.waiting,
            sources=tuple(statuses),
            free_bytes=shutil.disk_usage(self.config.folder).free,
            counters=dict(self._counters),
            problems=tuple(problems),
        )

    def _judge_all(self) -> None:
        pipeline = self._open_pipeline()
        if any(machine.calibration is not None for machine in self.config.machines):
            self._start_measuring(self._measure_repeatedly)

        while not self._stop.is_set():
            self._judge_next(pipeline, self._stop)

    def _start_measuring(self, measure: "Callable[[SeverityMeasurer], object]") -> threading.Thread:
        """Start a thread that measures severities; no recording waits for it."""
        from swashtwin.monitoring.service.severities import SeverityMeasurer

        measurer = SeverityMeasurer(self.config, self.history)
        thread = threading.Thread(target=measure, args=(measurer,), name="severity", daemon=True)
        self._measurer = measurer
        self._measuring = thread
        thread.start()
        return thread

    def _end_measuring(self) -> None:
        """End a measurement, which would take minutes, before the history is closed.

        It is measured after the next start.
        """
        if self._measurer is None or self._measuring is None:
            return
        self._measurer.end()
        self._measuring.join(STOP_TIMEOUT_S)

    def _measure_repeatedly(self, measurer: "SeverityMeasurer") -> None:
        """Measure severities after new recordings."""
        n_measured = -1.0
        while not self._stop.wait(POLL_INTERVAL_S):
            n_judged = self._counters["judged"]
            if n_judged == n_measured:
                continue
            if _measure_severities(measurer, self._stop):
                n_measured = n_judged
            else:
                self._stop.wait(MAX_PAUSE_S)

    def _open_pipeline(self) -> "Pipeline":
        """Return what judges recordings, with its models loaded.

        Its import takes a second, in which the page already answers.
        """
        from swashtwin.monitoring.service.judging import Pipeline

        pipeline = Pipeline(self.config, self.history)
        self._model_problems = pipeline.load_models()
        self._pipeline = pipeline
        return pipeline

    def _judge_next(self, pipeline: "Pipeline", stop: threading.Event) -> None:
        """Judge the recording that has waited longest, until the history has it."""
        if self._spool.n_held and pipeline.may_resume():
            pipeline.resume()
            self._spool.release()
        file = self._spool.next(POLL_INTERVAL_S)
        if file is None:
            return

        pause = FIRST_PAUSE_S
        while not stop.is_set():
            thread_time = time.thread_time()
            try:
                outcome = pipeline.judge(file)
                if outcome.is_waiting:
                    self._spool.hold(file)
                else:
                    self._spool.remove(file)
            except (HistoryError, OSError) as cause:
                self._history_problem = f"waiting for the history: {cause}"
                _log.warning("%s", self._history_problem)
                if not file.path.is_file():
                    # It was removed by somebody else, and no further attempt can judge it.
                    self._spool.remove(file)
                    return
                stop.wait(pause)
                pause = min(2 * pause, MAX_PAUSE_S)
                continue

            self._history_problem = None
            self._counters["seconds_judging"] += time.thread_time() - thread_time
            if outcome.is_waiting:
                self._announce(file.key, outcome)
                return
            self._announced_keys.discard(file.key)
            if outcome.state == "rejected":
                self._counters["rejected"] += 1
            else:
                self._counters["judged"] += 1
            self._counters["failures"] += outcome.has_failed
            self._progress(outcome)
            return

    def _announce(self, key: str, outcome: "Outcome") -> None:
        """Report once that a recording waits, however often it is tried."""
        if key not in self._announced_keys:
            self._announced_keys.add(key)
            self._progress(outcome)

    def _sweep(self) -> None:
        """Return memory to the system, and remove waveforms without a recording, now and then."""
        now = time.monotonic()
        if now - self._last_sweep < SWEEP_INTERVAL_S:
            return
        self._last_sweep = now
        return_memory()
        with suppress(HistoryError, OSError):
            self.history.waveforms.sweep()


def _require_alive(threads: list[threading.Thread]) -> None:
    for thread in threads:
        if not thread.is_alive():
            raise SwashTwinError(f"The thread {thread.name!r} ended unexpectedly; see the log.")


def _measure_severities(measurer: "SeverityMeasurer", stop: threading.Event) -> bool:
    """Return whether all severities are measured; False if the history could not be used."""
    try:
        measurer.measure_all(stop)
    except Exception as cause:  # a severity is no reason to end the watch
        _log.warning("No severity was measured: %s", cause)
        return False
    return True


def run_watch(
    config: WatchConfig,
    *,
    once: bool = False,
    stop: threading.Event | None = None,
    started: Callable[[str], None] = lambda address: None,
    progress: "Callable[[Outcome], None]" = lambda outcome: None,
) -> WatchStatus:
    """Run a watch until `stop` is set, or once, and return its status at the end.

    Parameters
    ----------
    once : judge what the folders hold and return, without the page.
    started : called with the page's address when everything runs.
    progress : called with what became of each recording, in the thread that judges.

    Raises
    ------
    InputError
        Another watch uses the same folder, or the page's port is taken.
    HistoryError
        The history cannot be opened.
    """
    if stop is None:
        stop = threading.Event()
    with lock_folder(config.folder):
        history = History.open(config.history_url, config.folder, config.retention)
        try:
            watch = Watch(config, history, progress)
            if once:
                watch.run_once(stop)
            else:
                watch.run(stop, started)
            return watch.status()
        finally:
            history.close()
