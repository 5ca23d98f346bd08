"""The process: sources, one thread that judges, one that sends messages, and the page, until it is
told to stop.
"""

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
from swashtwin.monitoring.alarms.channels import AlarmMessage, send
from swashtwin.monitoring.config.settings import FolderSource, HttpSource, MqttSource, WatchConfig
from swashtwin.monitoring.history.database import HistoryError
from swashtwin.monitoring.history.history import History
from swashtwin.monitoring.history.schema import Message
from swashtwin.monitoring.sources.delivery import Delivery, check_facts
from swashtwin.monitoring.sources.folder import FolderWatch
from swashtwin.monitoring.sources.mqtt import MqttWatch
from swashtwin.monitoring.sources.spool import Spool, lock_folder
from swashtwin.monitoring.status import SourceStatus, WatchStatus

if TYPE_CHECKING:
    from swashtwin.monitoring.service.judging import Outcome, Pipeline

_PATIENCE = 0.5
"""Seconds between looks at whether to stop."""
_FIRST_PAUSE, _LONGEST_PAUSE = 0.2, 15.0
"""Seconds before a recording is tried again that the history did not take; each is twice the one
before.
"""
_END = 20.0
"""Seconds that threads have to come to their end."""
_SWEEP = 600.0
"""Seconds between two looks for waveforms that retention gave up, and between giving back
memory.
"""
_FIRST_DELAY, _LONGEST_DELAY = 2.0, 600.0
"""Seconds before another attempt at a message; each is twice the one before."""
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
        self._sender = Sender(config, history)
        name = hashlib.sha256(
            f"{socket.gethostname()} {config.folder.resolve()}".encode()
        ).hexdigest()[:16]
        self._sources: list[FolderWatch | MqttWatch] = []
        self._uploads: SourceStatus | None = None
        for source in config.sources:
            match source:
                case FolderSource():
                    self._sources.append(FolderWatch(source, self._spool.add, config.folder))
                case MqttSource():
                    self._sources.append(MqttWatch(source, self._spool.add, f"swashtwin-{name}"))
                case HttpSource():
                    self._uploads = SourceStatus(source.name, source.kind)
        self._counters = {"judged": 0.0, "rejected": 0.0, "failures": 0.0, "seconds_judging": 0.0}
        self._model_problems: list[str] = []
        self._history_problem: str | None = None
        self._swept = -_SWEEP

    def run(self, stop: threading.Event, started: Callable[[str], None]) -> None:
        """Watch until `stop` is set."""
        from swashtwin.monitoring.page.server import serving_page
        from swashtwin.monitoring.page.watch_page import build_watch_page

        page = self.config.page
        application = build_watch_page(self.config, self.history, self.upload, self.status)
        with serving_page(application, page.host, page.port):
            tasks: dict[str, Callable[[], None]] = {
                f"source {source.status.name}": partial(source.run, self._stop)
                for source in self._sources
            }
            tasks |= {
                "judge": self._judge_all,
                "outbox": partial(self._sender.run, self._stop, self._sweep),
            }
            threads = [
                threading.Thread(target=task, name=name, daemon=True)
                for name, task in tasks.items()
            ]
            for thread in threads:
                thread.start()
            started(page.address)
            try:
                while not stop.wait(_PATIENCE):
                    if dead := [thread.name for thread in threads if not thread.is_alive()]:
                        raise SwashTwinError(f"the thread {dead[0]!r} ended; see the log.")
            finally:
                self._stop.set()
                for thread in threads:
                    thread.join(_END)

    def run_once(self, stop: threading.Event) -> None:
        """Take and judge what the folders hold now and what waits in the spool, and send its
        messages.
        """
        pipeline = self._open_pipeline()
        folders = [source for source in self._sources if isinstance(source, FolderWatch)]
        threads = [threading.Thread(target=source.drain, args=(stop,)) for source in folders]
        for thread in threads:
            thread.start()
        while not stop.is_set() and (self._spool or any(thread.is_alive() for thread in threads)):
            self._judge_next(pipeline, stop)
        for thread in threads:
            thread.join()
        self._sender.send_all()
        measuring = threading.Thread(target=self._measure, args=(pipeline, stop), daemon=True)
        measuring.start()
        while measuring.is_alive() and not stop.is_set():
            measuring.join(_PATIENCE)
        self._sender.send_all()
        self._sweep()

    def upload(self, path: Path, name: str, machine: str | None, facts: Mapping[str, str]) -> str:
        """SHA-256 of an uploaded file, which now waits in the spool.

        Raises
        ------
        InputError
            No source takes uploads, or a fact cannot be read.
        OSError
            The disk or the spool is full.
        """
        if self._uploads is None:
            raise InputError('this watch takes no uploads; add [[source]] with kind = "http".')
        try:
            digest = self._spool.add(
                Delivery(
                    self._uploads.name, name, datetime.now(UTC), machine or None, check_facts(facts)
                ),
                path,
            )
        except OSError as cause:
            self._uploads.fail(cause.strerror or str(cause))
            raise
        self._uploads.succeed(1)
        return digest

    def status(self) -> WatchStatus:
        """How the watch is doing; without any look at the disk but for its free space."""
        statuses = [source.status for source in self._sources] + (
            [self._uploads] if self._uploads else []
        )
        problems = [
            f"source {item.name}: {item.problem}" for item in statuses if item.problem is not None
        ]
        problems += filter(None, (self._history_problem, self._sender.problem))
        return WatchStatus(
            started=self._started,
            waiting=len(self._spool),
            outbox=self._sender.waiting,
            sources=tuple(statuses),
            free_bytes=shutil.disk_usage(self.config.folder).free,
            counters=dict(self._counters),
            problems=(*problems, *self._model_problems),
        )

    def _judge_all(self) -> None:
        pipeline = self._open_pipeline()
        if any(machine.calibration is not None for machine in self.config.machines):
            threading.Thread(
                target=self._measure_all, args=(pipeline,), name="severity", daemon=True
            ).start()
        while not self._stop.is_set():
            self._judge_next(pipeline, self._stop)

    def _measure_all(self, pipeline: "Pipeline") -> None:
        """Measure severities after recordings; nobody waits for this thread, not even the end."""
        seen = -1.0
        while not self._stop.wait(_PATIENCE):
            judged = self._counters["judged"]
            if judged != seen:
                if self._measure(pipeline, self._stop):
                    seen = judged
                else:
                    self._stop.wait(_LONGEST_PAUSE)

    @staticmethod
    def _measure(pipeline: "Pipeline", stop: threading.Event) -> bool:
        """Whether all severities are measured, or nobody waits for them any more."""
        try:
            pipeline.measure_severities(stop)
        except Exception as cause:  # the history is away, or has ended with the watch
            _log.warning("no severity was measured: %s", cause)
            return False
        return True

    def _open_pipeline(self) -> "Pipeline":
        """What judges, with its models; importing it takes a second, in which the page answers
        already.
        """
        from swashtwin.monitoring.service.judging import Pipeline

        pipeline = Pipeline(self.config, self.history)
        self._model_problems = pipeline.load_models()
        return pipeline

    def _judge_next(self, pipeline: "Pipeline", stop: threading.Event) -> None:
        """Judge the recording that waits longest, as often as it takes until the history has it."""
        file = self._spool.next(_PATIENCE)
        pause = _FIRST_PAUSE
        while file is not None and not stop.is_set():
            began = time.thread_time()
            try:
                outcome = pipeline.judge(file)
                self._spool.remove(file)
            except (HistoryError, OSError) as cause:
                self._history_problem = f"waiting for the history: {cause}"
                _log.warning("%s", self._history_problem)
                if (
                    not file.path.is_file()
                ):  # somebody removed it, and no attempt will bring it back
                    self._spool.remove(file)
                    return
                stop.wait(pause)
                pause = min(2 * pause, _LONGEST_PAUSE)
                continue
            self._history_problem = None
            self._counters["seconds_judging"] += time.thread_time() - began
            self._counters["rejected" if outcome.state == "rejected" else "judged"] += 1
            self._counters["failures"] += outcome.has_failed
            self._progress(outcome)
            return

    def _sweep(self) -> None:
        if time.monotonic() - self._swept >= _SWEEP:
            self._swept = time.monotonic()
            return_memory()
            with suppress(HistoryError, OSError):
                self.history.waveforms.sweep()


class Sender:
    """Sends what is in the outbox for the channels of one configuration; others' messages are left
    to others.
    """

    def __init__(self, config: WatchConfig, history: History) -> None:
        self._history = history
        self._channels = {channel.name: channel for channel in config.channels}
        self._folder = config.folder
        self.waiting = 0
        """Messages that are not sent yet."""
        self.problem: str | None = None
        """What keeps the messages from being sent, in one line."""

    def run(self, stop: threading.Event, every: Callable[[], None] = lambda: None) -> None:
        """Send messages until `stop` is set; `every` is called at each look."""
        while not stop.wait(_PATIENCE):
            self.send_all()
            every()

    def send_all(self) -> None:
        """Send what may be sent now."""
        try:
            while messages := self._history.outbox.claim(tuple(self._channels)):
                for message in messages:
                    self._send(message)
            self.waiting = self._history.outbox.waiting(tuple(self._channels))
            if not self.waiting:
                self.problem = None
        except HistoryError as cause:
            self.problem = str(cause)

    def _send(self, message: Message) -> None:
        try:
            send(AlarmMessage(**message.body), self._channels[message.channel], folder=self._folder)
        except (SwashTwinError, OSError, ValueError, TypeError, KeyError) as cause:
            self.problem = str(cause)
            _log.warning("%s", self.problem)
            delay = min(_FIRST_DELAY * 2.0 ** min(message.attempts, 20), _LONGEST_DELAY)
            self._history.outbox.failed(message.id, str(cause), delay)
        else:
            self._history.outbox.sent(message.id)


def run_watch(
    config: WatchConfig,
    *,
    once: bool = False,
    stop: threading.Event | None = None,
    started: Callable[[str], None] = lambda address: None,
    progress: "Callable[[Outcome], None]" = lambda outcome: None,
) -> WatchStatus:
    """How a watch ended that ran until `stop` was set, or once through what is there.

    Parameters
    ----------
    once : judge what the folders hold and return, without the page.
    started : called with the page's address once everything runs.
    progress : called with what became of each recording, in the thread that judges.

    Raises
    ------
    InputError
        Another watch uses the same folder, or the page's port is taken.
    HistoryError
        The history cannot be opened.
    """
    stop = threading.Event() if stop is None else stop
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
