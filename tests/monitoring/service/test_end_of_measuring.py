"""A watch that ends while the severity of a fault is measured, which takes minutes."""

import logging
import threading
import time
from datetime import UTC, datetime
from pathlib import Path

import pytest
from mqtt_broker import free_port, wait_for
from tiny_prior import PISTONS, write_prior
from watched_pumps import LEARNING, hum, watch_config, write_hum

from swashtwin.foundation import ChildProcess
from swashtwin.monitoring import History, run_watch
from swashtwin.monitoring.alarms.suspect_severity import SeverityRequest, measure_severity
from swashtwin.monitoring.config.settings import Machine


def measure_for_minutes(request: SeverityRequest) -> None:
    """Note that the measurement has begun in the folder of the calibration."""
    assert request.machine.calibration is not None
    Path(request.machine.calibration).with_name("begun").touch()
    time.sleep(600)


def test_an_ended_measurement_is_no_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(SeverityRequest, "measure", measure_for_minutes)
    machine = Machine(name="pump-1", pistons=PISTONS, calibration=str(tmp_path / "any.json"))
    request = SeverityRequest(machine, "piston", Path("x.h5"), time=datetime.now(UTC))
    child = ChildProcess()
    stop = threading.Event()
    measuring = threading.Thread(target=measure_severity, args=(request, child, stop), daemon=True)

    measuring.start()
    wait_for((tmp_path / "begun").exists)
    stop.set()
    child.stop()
    measuring.join(30)

    assert not measuring.is_alive()
    assert caplog.records == []


@pytest.mark.nightly
@pytest.mark.parametrize("once", [False, True])
def test_a_watch_ends_at_once_while_a_severity_is_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, once: bool
) -> None:
    def at_speed(seed: int, gain: float = 1.0):
        return hum(seed, gain=gain).replace(attributes={"speed": "1500 rpm"})

    write_prior(tmp_path / "prior.safetensors", at_speed(98), at_speed(99, 6.0))
    calibration = tmp_path / "any.json"
    calibration.write_text("{}", encoding="utf-8")
    facts = f'pistons = {PISTONS}\nprior = "prior.safetensors"\ncalibration = "{calibration}"'
    config = watch_config(tmp_path, f"[page]\nport = {free_port()}\n", machine=facts)
    for number in range(LEARNING + 10):
        gain = 1.0 if number < LEARNING else 6.0
        write_hum(tmp_path / "incoming" / f"{number:03}.h5", number, number, gain=gain)

    monkeypatch.setattr(SeverityRequest, "measure", measure_for_minutes)
    stop = threading.Event()
    watching = threading.Thread(
        target=run_watch, args=(config,), kwargs={"once": once, "stop": stop}, daemon=True
    )
    watching.start()
    wait_for((tmp_path / "begun").exists, 120)
    stop.set()
    watching.join(10)

    assert not watching.is_alive()
    assert "severity" not in [thread.name for thread in threading.enumerate()]
    assert [record for record in caplog.records if record.levelno >= logging.WARNING] == []

    # what was interrupted is measured after the next start
    history = History.open("", config.folder, is_new=False)
    (alarm,) = history.reader.alarms("pump-1")
    history.close()
    assert "severity" not in alarm.evidence
