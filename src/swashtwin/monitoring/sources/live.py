"""A device that the watch itself records.

No device keeps what is not taken, so a recording that the disk does not take is lost, and the
status of the source says so.
"""

import logging
import threading
from contextlib import closing, suppress
from datetime import UTC, datetime
from pathlib import Path

from swashtwin.foundation import SwashTwinError, require_modules, safe_file_name
from swashtwin.monitoring.config.settings import LiveSource, WatchConfig
from swashtwin.monitoring.sources.delivery import MAX_RECORDING_BYTES, Accept, Delivery
from swashtwin.monitoring.sources.live_device import DeviceSettings
from swashtwin.monitoring.sources.live_recorder import (
    FIRST_PAUSE_S,
    MAX_PAUSE_S,
    LiveRecorder,
    LiveSettings,
)
from swashtwin.monitoring.status import SourceStatus
from swashtwin.recordings import Finding, Recording, load_recording, write_recording

_HEADER_BYTES = 1 << 20
"""Bytes of a file that are no samples, at most."""
_log = logging.getLogger("swashtwin.watch")


class LiveWatch:
    """Records one device."""

    def __init__(self, source: LiveSource, accept: Accept, config: WatchConfig) -> None:
        """Record `source` into the folder of the watch.

        Raises
        ------
        MissingExtraError
            openDAQ is not installed.
        """
        require_modules("opendaq", extra="live", need="a live source")
        self.status = SourceStatus(source.name, source.kind)
        self._source = source
        self._accept = accept
        self._folder = config.folder / "live" / safe_file_name(source.name)
        self._settings = _recorder_settings(source, config)
        self._speed_problem: str | None = None
        """What is unsure of the speed of the recording that follows."""
        self._is_speed_unsure = False
        """Whether the last recording had such a problem."""

    def run(self, stop: threading.Event) -> None:
        """Record until `stop` is set."""
        self._deliver_earlier()
        pause = FIRST_PAUSE_S
        while not stop.is_set():
            try:
                recorder = LiveRecorder(self._settings)
            except SwashTwinError as cause:
                self._fail(str(cause))
                stop.wait(pause)
                pause = min(2 * pause, MAX_PAUSE_S)
                continue

            self.status.succeed()
            with closing(recorder):
                for item in recorder.run(stop):
                    if isinstance(item, Finding):
                        self._report(item)
                    else:
                        self._deliver(item)

    def _fail(self, problem: str) -> None:
        if problem != self.status.problem:
            _log.warning("source %s: %s", self.status.name, problem)
        self.status.fail(problem)

    def _report(self, finding: Finding) -> None:
        """Show a finding until the next recording is delivered.

        What is unsure of a speed precedes its recording, and stays until a recording without it.
        """
        if finding.kind == "speed":
            self._speed_problem = finding.message
            return
        if finding.severity == "note":
            _log.info("source %s: %s", self.status.name, finding.message)
        else:
            self._fail(finding.message)

    def _deliver(self, recording: Recording) -> None:
        """Put a complete recording into the spool.

        One that was cut off is left out: it would differ from the baseline by its length alone.
        """
        speed_problem = self._speed_problem
        self._speed_problem = None
        if recording.n_samples < round(self._settings.length * recording.sample_rate):
            return

        path = self._folder / f"{recording.recording_id}.h5"
        try:
            write_recording(recording, path)
            self._hand_over(path, recording)
        except OSError as cause:
            self._fail(
                f"a recording of {recording.duration:.4g} s is lost, because it cannot be written: "
                f"{cause.strerror or cause}"
            )
            with suppress(OSError):  # a disk that can only be read
                path.unlink(missing_ok=True)
            return
        self._finish(speed_problem)

    def _deliver_earlier(self) -> None:
        """Put recordings into the spool that a watch had written when it was killed."""
        for path in sorted(self._folder.glob("*.h5")):
            try:
                self._hand_over(path, load_recording(path))
            except (OSError, SwashTwinError) as cause:
                self._fail(f"{path} of an earlier run is not judged: {cause}")

    def _hand_over(self, path: Path, recording: Recording) -> None:
        """Put the file of a recording into the spool, which moves it."""
        delivery = Delivery(
            self._source.name,
            path.name,
            datetime.now(UTC),
            self._source.machine,
            {"time": recording.attributes["date"]},
        )
        self._accept(delivery, path)

    def _finish(self, speed_problem: str | None) -> None:
        """Count a delivered recording, and show what is unsure of its speed.

        A problem is logged once while each recording has one: its numbers differ each time.
        """
        was_unsure = self._is_speed_unsure
        self._is_speed_unsure = speed_problem is not None
        if speed_problem is None:
            self.status.succeed(1)
            return

        if not was_unsure:
            _log.warning("source %s: %s", self.status.name, speed_problem)
        self.status.received += 1
        self.status.fail(speed_problem)


def _recorder_settings(source: LiveSource, config: WatchConfig) -> LiveSettings:
    machine = config.machine(source.machine)
    assert machine is not None  # the configuration was checked

    # Any other speed is better than one of the spectrum.
    piston_count = None
    if machine.speed is None and machine.tags is None and source.tachometer is None:
        piston_count = machine.piston_count

    device = DeviceSettings(
        source.device,
        channels=source.channels,
        tacho=source.tachometer,
        sample_rate=source.sample_rate,
        unit=source.unit,
        sensitivity=source.sensitivity,
        properties=source.properties,
    )
    return LiveSettings(
        device,
        source.length,
        interval=source.interval,
        name=safe_file_name(source.machine),
        pulses_per_turn=source.pulses_per_turn,
        piston_count=piston_count,
        max_bytes=MAX_RECORDING_BYTES - _HEADER_BYTES,
    )
