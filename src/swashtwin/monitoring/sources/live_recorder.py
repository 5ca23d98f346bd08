"""Recordings of a device that streams: one after the other, or one at each interval.

Whatever interrupts a recording is a separate event: a gap, samples that were discarded because
they were not taken in time, a changed sample rate, a device that vanishes or is back. What was
measured until then is a shorter recording.
"""

import math
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from swashtwin.foundation import DataError, InputError, SwashTwinError, plural
from swashtwin.monitoring.config.settings import MIN_LENGTH_S
from swashtwin.monitoring.sources.contents import specified_values
from swashtwin.monitoring.sources.live_device import (
    Block,
    DeviceChangedError,
    DeviceLostError,
    DeviceSettings,
    LiveDevice,
)
from swashtwin.monitoring.sources.tags import Tags
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Finding, Recording

if TYPE_CHECKING:
    from swashtwin.calibration import DetectedSpeed

MAX_BUFFER_BYTES = 256 << 20
"""Bytes of the samples of a recording, which is in memory until it is complete."""
FIRST_PAUSE_S = 1.0
"""Time before a device that vanished is tried again; each further pause is twice the previous."""
MAX_PAUSE_S = 30.0
"""Longest pause between two attempts."""
TYPICAL_SHAFT_FREQUENCY = 25.0
"""Speed [Hz] around which the spectrum is searched if none is specified; the search reaches from
470 to 4800 rpm."""

FindingKind = Literal[
    "gap", "overrun", "clock", "changed", "vanished", "back", "short", "stopped", "speed"
]


@dataclass(frozen=True)
class LiveSettings:
    """What is recorded, and how often."""

    device: DeviceSettings
    length: float
    """Length of a recording [s]."""
    interval: float | None = None
    """Time from the start of a recording to that of the next [s]; None leaves no gap."""
    name: str = "live"
    """Beginning of the name of each recording."""
    pulses_per_turn: int = 1
    """Pulses of the tachometer in a revolution."""
    speed: float | None = None
    """Angular speed of the shaft [rad/s], if it is constant."""
    pressure: float | None = None
    """Absolute pressure at the outlet [Pa], if it is constant; it needs a speed."""
    tags: Path | None = None
    """CSV file of speeds and pressures by time, as of a machine of the watch."""
    piston_count: int | None = None
    """Number of pistons, with which the speed is estimated or checked by the spectrum."""
    max_bytes: int = MAX_BUFFER_BYTES
    """Bytes that the samples of a recording may take in double precision."""

    def __post_init__(self) -> None:
        if not self.length >= MIN_LENGTH_S:
            raise InputError(
                f"A recording of {self.length:g} s is too short: record {MIN_LENGTH_S:g} s or "
                "more.",
                field="length",
            )
        if self.interval is not None and not self.interval >= self.length:
            raise InputError(
                f"A recording of {self.length:g} s does not fit into an interval of "
                f"{self.interval:g} s: choose a longer interval, or leave it out to record "
                "without a pause.",
                field="interval",
            )


@dataclass
class _Buffer:
    """Samples of the recording that is being made."""

    start: datetime
    blocks: list[Block] = field(default_factory=list)
    n_samples: int = 0

    def fill(self, block: Block, n_wanted: int, sample_rate: float) -> Block | None:
        """Add a block up to `n_wanted` samples, and return what is left of it."""
        first, rest = block.split(n_wanted - self.n_samples, sample_rate)
        self.blocks.append(first)
        self.n_samples += first.signal.shape[1]
        return rest


class LiveRecorder:
    """Records a device that is open."""

    def __init__(self, settings: LiveSettings) -> None:
        """Connect the device.

        Raises
        ------
        InputError, DataError
            As `LiveDevice`; or a recording takes too much memory.
        """
        self._settings = settings
        self._tags = None if settings.tags is None else Tags(settings.tags)
        self._device = self._open()
        self._buffer: _Buffer | None = None
        """Recording that is being made; None between two."""
        self._next_start = time.monotonic()
        """When the next recording begins [s], at the earliest."""
        self._notes: list[str] = []
        """Findings since the last recording, which the next one states."""

    def _open(self) -> LiveDevice:
        device = LiveDevice(self._settings.device)
        try:
            self._require_memory(device)
        except InputError:
            device.close()
            raise
        return device

    def _require_memory(self, device: LiveDevice) -> None:
        n_channels = len(device.channels)
        channels = plural(n_channels, "channel")
        n_rows = n_channels
        if self._settings.device.tacho is not None:
            n_rows += 1
            channels += " and a tachometer"
        max_length = self._settings.max_bytes / (8 * n_rows * device.sample_rate)
        if self._settings.length > max_length:
            raise InputError(
                f"A recording of {self._settings.length:g} s of {channels} at "
                f"{device.sample_rate:g} Hz is too large: record at most {max_length:.4g} s, one "
                "after the other.",
                field="length",
            )

    def run(self, stop: threading.Event) -> Iterator[Recording | Finding]:
        """Yield recordings, and what interrupts them, until `stop` is set.

        A recording that is under way then is yielded too, with what it has.
        """
        while not stop.is_set():
            try:
                blocks = self._device.read()
            except DeviceChangedError as cause:
                yield from self._interrupt("changed", cause.message)
                yield from self._resume(stop, is_connected=True)
                continue
            except DeviceLostError as cause:
                yield from self._interrupt("vanished", cause.message)
                yield from self._resume(stop, is_connected=False)
                continue
            for block in blocks:
                yield from self._take(block)

        if self._buffer is not None:
            yield from self._interrupt("stopped", "The recording was stopped.")

    def _take(self, block: Block) -> Iterator[Recording | Finding]:
        """Add a block to the recording, and yield what it completes or interrupts."""
        # A gap while no recording is due loses nothing.
        if block.n_missing and (self._buffer is not None or self._settings.interval is None):
            yield from self._interrupt(*self._describe_gap(block))

        n_wanted = round(self._settings.length * self._device.sample_rate)
        rest: Block | None = block
        while rest is not None:
            if self._buffer is None:
                if time.monotonic() < self._next_start:
                    return
                self._buffer = _Buffer(rest.start)
                if self._settings.interval is not None:
                    self._next_start = _next_start(self._next_start, self._settings.interval)

            rest = self._buffer.fill(rest, n_wanted, self._device.sample_rate)
            if self._buffer.n_samples == n_wanted:
                yield from self._complete()

    def _describe_gap(self, block: Block) -> tuple[FindingKind, str]:
        count = abs(block.n_missing)
        missing = f"{plural(count, 'sample')} ({count / self._device.sample_rate:.3g} s)"
        if block.n_missing < 0:
            return "clock", f"The clock of the device was set back by {missing}."
        if block.n_discarded:
            return "overrun", (
                f"{missing} were discarded: they arrived faster than they were recorded."
            )
        return "gap", f"The device left out {missing}."

    def _interrupt(self, kind: FindingKind, message: str) -> Iterator[Recording | Finding]:
        """Yield what interrupts the recording, and the part before it; then record again."""
        yield self._find(kind, message)
        self._next_start = time.monotonic()
        if self._buffer is None or not self._buffer.n_samples:
            self._buffer = None
            return

        # The end that a user wants is no warning.
        end_kind: FindingKind = "stopped" if kind == "stopped" else "short"
        length = self._buffer.n_samples / self._device.sample_rate
        if length < MIN_LENGTH_S:
            self._buffer = None
            yield self._find(end_kind, f"The {length:.3g} s before it are too short to be kept.")
            return
        yield self._find(end_kind, f"The recording ends after {length:.4g} s.")
        yield from self._complete()

    def _find(self, kind: FindingKind, message: str) -> Finding:
        self._notes.append(message)
        severity: Literal["note", "warning"] = "note" if kind in ("back", "stopped") else "warning"
        return Finding(kind, severity, None, message)

    def close(self) -> None:
        """Disconnect the device."""
        self._device.close()

    def _resume(self, stop: threading.Event, *, is_connected: bool) -> Iterator[Finding]:
        """Set the device up or connect it again, as often as it takes; yield when it is back."""
        start = time.monotonic()
        pause = FIRST_PAUSE_S
        problem = None
        while not stop.is_set():
            try:
                if is_connected:
                    self._device.set_up()
                    self._require_memory(self._device)
                else:
                    self._device.close()
                    self._device = self._open()
            except SwashTwinError as cause:
                is_connected = False
                if str(cause) != problem:
                    problem = str(cause)
                    yield self._find("vanished", problem)
                stop.wait(pause)
                pause = min(2 * pause, MAX_PAUSE_S)
                continue

            self._next_start = time.monotonic()
            yield self._find(
                "back",
                f"{self._settings.device.device} is recorded again after "
                f"{self._next_start - start:.1f} s, at {self._device.sample_rate:g} Hz.",
            )
            return

    def _complete(self) -> Iterator[Recording | Finding]:
        """Yield the recording with its speed, and what is unsure of the speed."""
        buffer = self._buffer
        assert buffer is not None
        self._buffer = None
        signal = np.concatenate([block.signal for block in buffer.blocks], axis=1)
        pulses = [block.tacho for block in buffer.blocks if block.tacho is not None]
        buffer.blocks.clear()

        recording = Recording(
            signal,
            self._device.sample_rate,
            _recording_name(self._settings.name, buffer.start),
            channels=self._device.channels,
            unit=self._device.unit,
            attributes={
                "device": self._settings.device.device,
                "date": buffer.start.isoformat(timespec="milliseconds"),
            },
        )
        if pulses:
            recording, problem = self._with_measured_speed(recording, np.concatenate(pulses))
        else:
            recording, problem = self._with_operating_point(recording)
        if problem is not None:
            yield self._find("speed", problem)

        if self._notes:
            attributes = {**recording.attributes, "findings": " ".join(self._notes)}
            recording = recording.replace(attributes=attributes)
            self._notes = []
        yield recording

    def _with_measured_speed(
        self, recording: Recording, pulses: np.ndarray
    ) -> tuple[Recording, str | None]:
        """Return the recording with the speed of its tachometer, or why there is none."""
        from swashtwin.signals import tachometer_angle

        tacho = recording.replace(signal=pulses[None], channels=("tachometer",), unit="1")
        try:
            angle = tachometer_angle(tacho, "tachometer", self._settings.pulses_per_turn)
        except DataError as cause:
            return recording, f"No speed by the tachometer: {cause}"

        recording = _state_speed(recording, angle.mean_speed, "tachometer")
        return recording.replace(speed=angle.speed), None

    def _with_operating_point(self, recording: Recording) -> tuple[Recording, str | None]:
        """Return the recording with its specified or estimated speed, and what is unsure."""
        values, source, problem = self._specified_values(recording)
        if "speed" not in values:
            if self._settings.piston_count is None or problem is not None:
                return recording, problem
            return self._with_estimated_speed(recording)

        speed = values["speed"]
        recording = _state_speed(recording, speed, source)
        if "discharge_pressure" in values:
            recording = recording.replace(condition=OperatingCondition(**values))
        if self._settings.piston_count is None:
            return recording, problem

        detected = self._detect_speed(recording, speed)
        if detected.contradicts:
            problem = (
                f"The lines of the spectrum show {_speed_text(2 * math.pi * detected.detected)} "
                f"({_doubt_text(detected)}), but {source} is {_speed_text(speed)}."
            )
        return recording, problem

    def _specified_values(self, recording: Recording) -> tuple[dict[str, float], str, str | None]:
        """Return the specified quantities [SI], their source, and why the tags have none."""
        if self._tags is None:
            values = {}
            if self._settings.speed is not None:
                values["speed"] = self._settings.speed
            if self._settings.pressure is not None:
                values["discharge_pressure"] = self._settings.pressure
            return values, "specified", None

        try:
            facts = self._tags.at(datetime.fromisoformat(recording.attributes["date"]))
        except DataError as cause:
            return {}, "", f"The operating point is unknown: {cause}"
        values = specified_values(facts)
        if "speed" not in values:
            return {}, "", f"The speed is unknown: {self._settings.tags} has none at this time."
        return values, "tags", None

    def _with_estimated_speed(self, recording: Recording) -> tuple[Recording, str | None]:
        detected = self._detect_speed(recording, 2 * math.pi * TYPICAL_SHAFT_FREQUENCY)
        if detected.is_clear:
            source = f"estimated from the spectrum ({_doubt_text(detected)})"
            return _state_speed(recording, 2 * math.pi * detected.detected, source), None
        return recording, (
            "The speed is unknown: the lines of the spectrum are too weak "
            f"({_doubt_text(detected)}). Specify a speed, tags or a tachometer."
        )

    def _detect_speed(self, recording: Recording, speed: float) -> "DetectedSpeed":
        # Imported here: a watch without a live source needs no search for lines.
        from swashtwin.calibration import detect_speed

        assert self._settings.piston_count is not None
        return detect_speed(recording, speed / (2 * math.pi), self._settings.piston_count)


def _state_speed(recording: Recording, speed: float, source: str) -> Recording:
    """Return a recording with its mean speed [rad/s] and the source of it as attributes."""
    attributes = {
        **recording.attributes,
        "speed": _speed_text(speed),
        "speed_source": source,
    }
    return recording.replace(attributes=attributes)


def _doubt_text(detected: "DetectedSpeed") -> str:
    """Return how clear the lines of an estimated speed are, beside what counts as clear."""
    from swashtwin.calibration import MIN_CONTRAST

    return f"contrast {detected.detected_contrast:.2g}; above {MIN_CONTRAST:g} is clear"


def _next_start(previous: float, interval: float) -> float:
    """Return the next time of the grid of an interval that still lies ahead."""
    n_intervals = max(1, math.ceil((time.monotonic() - previous) / interval))
    return previous + n_intervals * interval


def _recording_name(prefix: str, start: datetime) -> str:
    milliseconds = start.microsecond // 1000
    return f"{prefix}-{start:%Y%m%dT%H%M%S}-{milliseconds:03d}Z"


def _speed_text(speed: float) -> str:
    return f"{speed * 30 / math.pi:.6g} rpm"
