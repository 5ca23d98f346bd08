"""The twin of a machine in service."""

import threading
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from commandline import one_line, run
from judgments import judgment
from watched_pumps import watch_config

from swashtwin.foundation import DataError, InputError
from swashtwin.monitoring import History, WatchConfig, record_event, update_twin
from swashtwin.monitoring.history import Estimate
from swashtwin.monitoring.service import twins
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, Pump

POINT = "860 rpm, 15 MPa"


@pytest.fixture
def config(tmp_path: Path) -> WatchConfig:
    return watch_config(tmp_path, machine='pump = "25scy14-1b"')


@pytest.fixture
def history(config: WatchConfig):
    history = History.open("", config.folder)
    yield history
    history.close()


def file_recording(history: History, twin: Twin, number: int, **changes: object) -> None:
    """File a recording of the twin as judged."""
    recording = twin.simulate(1.3, 6400.0, phase=1.0 + number, recording_id=str(number))
    condition = twin.condition
    facts = {"point": POINT, "speed": condition.speed, "pressure": condition.discharge_pressure, **changes}
    stored = judgment(number, **{"time": datetime.now(UTC) + timedelta(seconds=number), **facts})
    path = history.waveforms.write("pump-1", stored.time, stored.content, recording)
    with history.machine("pump-1") as transaction:
        transaction.add_recording(stored, {}, path)
        transaction.save_point(POINT, speed=condition.speed, pressure=condition.discharge_pressure, baseline={})


def test_a_twin_is_calibrated_on_healthy_recordings_and_its_values_stand_in_the_history(
    config: WatchConfig, history: History, pump: Pump, at_15: OperatingCondition
) -> None:
    file_recording(history, Twin(pump, at_15, bandwidth=2600), 0)
    assert twins.is_due(history, "pump-1")
    update = update_twin(config, history, "pump-1")
    (stored,) = history.read.recalibrations("pump-1")
    assert stored.estimates == update.estimates
    assert update.recordings == 1
    assert update.calibration.is_file()
    for estimate, truth in zip(update.estimates, Twin(pump, at_15, bandwidth=2600).values.tolist(), strict=True):
        assert estimate.low is not None
        assert estimate.high is not None
        assert estimate.low <= truth <= estimate.high
    assert not twins.is_due(history, "pump-1")


def test_after_maintenance_a_twin_is_due_once_new_healthy_recordings_are_there(
    config: WatchConfig, history: History, pump: Pump, at_15: OperatingCondition
) -> None:
    twin = Twin(pump, at_15, bandwidth=2600)
    file_recording(history, twin, -60)
    with history.machine("pump-1") as transaction:
        transaction.add_recalibration(datetime.now(UTC), ())
    assert not twins.is_due(history, "pump-1")
    record_event(config, history, "pump-1", who="a fitter", note="new slippers", maintenance=True)
    assert not twins.is_due(history, "pump-1")
    with pytest.raises(DataError, match="no healthy recording"):
        update_twin(config, history, "pump-1")
    file_recording(history, twin, 1, state="learning")
    assert not twins.is_due(history, "pump-1")
    file_recording(history, twin, 2)
    assert twins.is_due(history, "pump-1")


def test_a_machine_without_pump_and_twin_is_refused(tmp_path: Path) -> None:
    config = watch_config(tmp_path)
    history = History.open("", config.folder)
    with pytest.raises(InputError, match=r'needs twin = "FILE\.json" or pump = "NAME"'):
        update_twin(config, history, "pump-1")
    with pytest.raises(InputError, match="has no machine 'pump-9'; there are pump-1"):
        update_twin(config, history, "pump-9")
    history.close()


def test_values_whose_intervals_do_not_meet_are_named() -> None:
    before = (Estimate("a", 1.0, 0.8, 1.2), Estimate("b", 1.0, 0.8, 1.2))
    after = (Estimate("a", 2.0, 1.8, 2.2), Estimate("b", 1.3, 1.1, 1.5), Estimate("c", 1.0, 0.0, 2.0))
    assert twins._changes(before, after) == ("a is 2 times what it was",)


def test_a_watch_calibrates_the_twin_that_is_due_in_a_process_of_its_own(
    config: WatchConfig, history: History, pump: Pump, at_15: OperatingCondition, monkeypatch: pytest.MonkeyPatch
) -> None:
    commands: list[list[str]] = []

    class Process:
        returncode = 0

        def __init__(self, command: list[str], **options: object) -> None:
            commands.append(command)

        def poll(self) -> int:
            stop.set()
            return 0

    stop = threading.Event()
    monkeypatch.setattr(twins, "_LOOK", 0.01)
    monkeypatch.setattr(twins.subprocess, "Popen", Process)
    (machine,) = config.machines
    with_twin = replace(config, machines=(replace(machine, twin=Path("twin.json")),))
    file_recording(history, Twin(pump, at_15, bandwidth=2600), 0)
    twins.TwinKeeper(with_twin, history).run(stop)
    assert commands[0][1:] == ["-m", "swashtwin", "watch", "recalibrate", str(config.path), "pump-1"]


def test_the_command_says_what_is_missing(config: WatchConfig) -> None:
    assert "no healthy recording" in one_line(run("watch", "recalibrate", config.path, "pump-1", code=3))
