"""The twin of a machine in service: calibrated anew from what the watch recorded, and how severe a fault is."""

import logging
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from swashtwin.foundation import DataError, InputError, file_name
from swashtwin.monitoring.config import Machine, WatchConfig
from swashtwin.monitoring.history import Estimate, History, HistoryError, StoredRecording
from swashtwin.pump import FAULT_KINDS, Fault, OperatingCondition, load_pump
from swashtwin.recordings import Recording

if TYPE_CHECKING:
    from swashtwin.calibration import Calibration
    from swashtwin.pump import Pump

PER_POINT = 5
"""Recordings of each operating point that a calibration takes: the newest healthy ones."""
_WORN = 3
"""Recordings of an alarm that are looked at for one of which the model names a fault, newest first."""
_LOOK = 60.0
"""Seconds between two looks for machines that are due."""
_log = logging.getLogger("swashtwin.watch")


@dataclass(frozen=True)
class TwinUpdate:
    """What a calibration in service gave."""

    machine: str
    """Name of the machine."""
    calibration: Path
    """File of the new calibration."""
    recordings: int
    """How many healthy recordings it rests on."""
    estimates: tuple[Estimate, ...]
    """The six values, then the severity of a fault where an alarm names one, with intervals of 90 %."""
    changes: tuple[str, ...]
    """Values whose interval does not meet that of the calibration before, in words."""


def update_twin(config: WatchConfig, history: History, machine: str, *, seed: int = 0) -> TwinUpdate:
    """New values of a machine's twin, which the history then holds.

    The twin is calibrated on the newest healthy recordings since the last maintenance, `PER_POINT` of each operating
    point. Where an alarm of the pump is open and the machine's model names a fault of its recordings, the severity of
    that fault is estimated with the new twin.

    Raises
    ------
    InputError
        The configuration has no such machine, or the machine has no pump and no twin.
    DataError
        No healthy recording with a waveform, a speed and a pressure is there, or none can be calibrated on.
    HistoryError
        The database cannot be reached.
    """
    from swashtwin.calibration import calibrate

    settings = config.machine(machine)
    if settings is None:
        listed = ", ".join(item.name for item in config.machines[:20])
        raise InputError(f"{config.path} has no machine {machine!r}; there are {listed}.")
    pump = _pump(settings, config)
    healthy = _healthy_recordings(history, machine)
    if not healthy:
        raise DataError(
            f"{machine} has no healthy recording with a stored waveform, a speed and a discharge pressure since its "
            "last maintenance; wait until its baseline is learned."
        )
    calibration = calibrate(pump, healthy, explain_misfit=False, seed=seed)
    now = datetime.now(UTC)
    path = config.folder / "twins" / f"{file_name(machine)}-{now:%Y%m%dT%H%M%S}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    calibration.save(path)
    estimates = [
        Estimate(estimate.name, estimate.value, *estimate.interval, estimate.unit) for estimate in calibration.estimates
    ]
    estimates += _severity(history, machine, calibration, healthy)
    before = history.read.recalibrations(machine)
    changes = _changes(before[-1].estimates, estimates) if before else ()
    note = "; ".join([f"on {len(healthy)} healthy recordings", *changes])
    with history.machine(machine) as transaction:
        transaction.add_recalibration(now, tuple(estimates), note)
    return TwinUpdate(machine, path, len(healthy), tuple(estimates), changes)


def is_due(history: History, machine: str) -> bool:
    """Whether the baseline has been learned since the last maintenance, and the twin not been calibrated since."""
    since = _last_maintenance(history, machine)
    updates = history.read.recalibrations(machine)
    is_new = not updates or (since is not None and updates[-1].time < since)
    return is_new and bool(history.read.recordings(machine, state="normal", since=since, limit=1))


class TwinKeeper:
    """Calibrates the twins of machines that are due, one after the other, in a process of its own."""

    def __init__(self, config: WatchConfig, history: History) -> None:
        self._config = config
        self._history = history
        self._failed: dict[str, datetime | None] = {}  # by machine, the maintenance after which a calibration failed

    def run(self, stop: threading.Event) -> None:
        """Look for machines that are due until `stop` is set."""
        names = [machine.name for machine in self._config.machines if machine.twin is not None]
        while not stop.wait(_LOOK):
            for name in names:
                if not stop.is_set():
                    self._keep(name, stop)

    def _keep(self, name: str, stop: threading.Event) -> None:
        try:
            maintenance = _last_maintenance(self._history, name)
            has_failed = name in self._failed and self._failed[name] == maintenance
            if has_failed or not is_due(self._history, name):
                return
        except HistoryError:
            return  # the thread that judges reports it; the next look comes
        command = [sys.executable, "-m", "swashtwin", "watch", "recalibrate", str(self._config.path), name]
        with tempfile.TemporaryFile("w+", encoding="utf-8") as errors:
            process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=errors)
            while process.poll() is None:
                if stop.wait(0.5):
                    process.terminate()
                    process.wait()
                    return
            if process.returncode:
                self._failed[name] = maintenance
                errors.seek(0)
                reasons = errors.read().strip().splitlines()[-1:]
                _log.warning("the twin of %s was not calibrated: %s", name, *reasons or ["no reason was given"])


def _pump(machine: Machine, config: WatchConfig) -> "Pump":
    from swashtwin.calibration import load_calibration

    if machine.twin is not None:
        return load_calibration(machine.twin).twin.pump
    if machine.pump is not None:
        return load_pump(machine.pump)
    raise InputError(f'{config.path}: machine {machine.name!r} needs twin = "FILE.json" or pump = "NAME" for a twin.')


def _last_maintenance(history: History, machine: str) -> datetime | None:
    return next((event.time for event in history.read.events(machine) if event.kind == "maintenance"), None)


def _healthy_recordings(history: History, machine: str) -> list[Recording]:
    since = _last_maintenance(history, machine)
    recordings: list[Recording] = []
    for point in history.read.points(machine):
        stored = [
            item
            for state in ("normal", "learning")
            for item in history.read.recordings(machine, point=point.name, state=state, since=since, limit=PER_POINT)
        ]
        recordings += _waveforms(history, stored, "normal")[:PER_POINT]
    return recordings


def _waveforms(history: History, stored: Sequence[StoredRecording], label: str) -> list[Recording]:
    """Recordings whose samples are kept, with the operating point at which they were judged."""
    recordings = []
    for item in stored:
        speed, pressure = item.judgment.speed, item.judgment.pressure
        recording = history.read.waveform(item.id) if speed is not None and pressure is not None else None
        if recording is not None and speed is not None and pressure is not None:
            condition = recording.condition or OperatingCondition(speed=speed, discharge_pressure=pressure)
            recordings.append(recording.replace(recording_id=str(item.id), label=label, condition=condition))
    return recordings


def _severity(
    history: History, machine: str, calibration: "Calibration", healthy: Sequence[Recording]
) -> list[Estimate]:
    """Severity of the fault that the model names for the newest recording of an open alarm, if it names one."""
    from swashtwin.calibration import estimate_severity

    if not any(alarm.kind == "pump" for alarm in history.read.alarms(machine, state="open")):
        return []
    for item in history.read.recordings(machine, state="alarm", limit=_WORN):
        fault = _typical_fault(item.judgment.label)
        worn = [] if fault is None else _waveforms(history, [item], fault.label)
        if fault is not None and worn:
            (result,) = estimate_severity(calibration, worn, fault, healthy=healthy).estimates
            severity = result.severity
            per_unit = severity.dimension.per_unit
            value, low, high = (float(number) / per_unit for number in (severity.value, *severity.interval))
            return [Estimate(f"{fault.label} {severity.dimension.name}", value, low, high, severity.dimension.unit)]
    return []


def _typical_fault(label: str | None) -> Fault | None:
    return next((fault for fault in FAULT_KINDS.values() if fault is not None and fault.label == label), None)


def _changes(before: Sequence[Estimate], after: Sequence[Estimate]) -> tuple[str, ...]:
    """Values whose intervals do not meet, in words."""
    earlier = {estimate.name: estimate for estimate in before}
    words = []
    for estimate in after:
        old = earlier.get(estimate.name)
        ends = None if old is None else (old.low, old.high, estimate.low, estimate.high)
        if old is None or ends is None or None in ends or old.value <= 0:
            continue
        low, high, new_low, new_high = (float(end) for end in ends if end is not None)
        if new_low > high or new_high < low:
            words.append(f"{estimate.name} is {estimate.value / old.value:.2g} times what it was")
    return tuple(words)
