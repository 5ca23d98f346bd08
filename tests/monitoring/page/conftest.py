"""A plant of four pumps whose history the pages show: one worn, one healthy, one new, one with a broken sensor."""

import hashlib
import math
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from fastapi import FastAPI
from judgments import rejection
from starlette.testclient import TestClient

from swashtwin.foundation import MPa, rpm
from swashtwin.monitoring.alarms.monitor import PointJudgment, PointMonitor, PointState
from swashtwin.monitoring.config.loading import load_watch_config
from swashtwin.monitoring.config.settings import WatchConfig
from swashtwin.monitoring.history.history import History
from swashtwin.monitoring.history.tables import Judgment
from swashtwin.monitoring.page.application import build_app
from swashtwin.monitoring.service.running import WatchStatus
from swashtwin.monitoring.sources.delivery import Standing
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording

NOW = datetime.now(UTC).replace(microsecond=0)
SPEED, PRESSURE = rpm(1500), MPa(15)
POINT = "1500 rpm, 15 MPa"
_CLASSES = ("swash_plate", "normal", "piston", "valve_plate", "cylinder_block")
_CONFIG = """
folder = "data"
[alarms]
learning = 10
[[machine]]
name = "pump-1"
pump = "25scy14-1b"
[[machine]]
name = "pump-2"
pump = "25scy14-1b"
[[machine]]
name = "pump-3"
[[machine]]
name = "presse-4"
[[source]]
kind = "http"
"""


@dataclass
class Plant:
    """A configuration with its history."""

    config: WatchConfig
    history: History

    def add(self, name: str, count: int, *, wear_from: int = 10**6, flat_from: int = 10**6) -> None:
        """File `count` recordings of a machine, worn or with a dead sensor from one on."""
        monitor, state, alarms = PointMonitor(name, learning=10), None, {}
        for index in range(count):
            recording = _recording(name, index, wear=max(0, index - wear_from + 1), is_flat=index >= flat_from)
            point_judgment = monitor.judge(recording, state, point=POINT)
            self._file(name, index, count, recording, point_judgment, alarms)
            state = point_judgment.state

    def _file(
        self,
        name: str,
        index: int,
        count: int,
        recording: Recording,
        point_judgment: PointJudgment,
        alarms: dict[str, int],
    ) -> None:
        time = NOW - timedelta(hours=6 * (count - index))
        is_worn = point_judgment.is_large or point_judgment.is_alarm
        label = "swash_plate" if is_worn else "normal"
        classes = sorted(_CLASSES, key=lambda name: name != label)
        shares = dict(zip(classes, (0.93, 0.03, 0.02, 0.01, 0.01), strict=True))
        content = hashlib.sha256(f"{name} {index}".encode()).hexdigest()
        waveform = self.history.waveforms.write(name, time, content, recording)
        with self.history.machine(name) as machine:
            judgment = Judgment(
                content=content,
                time=time,
                received=time + timedelta(seconds=1),
                source="http",
                file=f"{name}-{index}.h5".replace("/", "-"),
                channels=list(recording.channels),
                unit=recording.unit,
                sample_rate=recording.sample_rate,
                duration=2.0,
                state=_state(point_judgment),
                point=POINT,
                speed=SPEED,
                pressure=PRESSURE,
                label=label,
                probability=0.93,
                confidence=0.97,
                model="1c09f2a7d1e0b3c4",
                alarm_p=point_judgment.p_value,
                capital=point_judgment.capital,
                reasons={
                    "sentences": list(point_judgment.reasons),
                    "notes": list(point_judgment.notes),
                    "findings": [finding.to_dict() for finding in point_judgment.findings],
                    "moved": [change.to_dict() for change in point_judgment.moved],
                    "learned": point_judgment.learned,
                    "probabilities": shares,
                    "is_unknown": False,
                },
            )
            identity = machine.add_recording(judgment, point_judgment.levels, waveform)
            _save(machine, point_judgment.state)
            for kind, change in (("pump", point_judgment.pump), ("sensor", point_judgment.sensor)):
                if change == "raised":
                    alarms[kind] = machine.open_alarm(kind, POINT, time, point_judgment.to_dict(), identity).id


def _save(machine: object, state: PointState) -> None:
    machine.save_point(POINT, speed=SPEED, baseline=state.baseline, test=state.test)


def _state(point_judgment: PointJudgment) -> str:
    if point_judgment.stage != "watching":
        return point_judgment.stage
    return "alarm" if point_judgment.is_alarm else "unusual" if point_judgment.is_large else "normal"


def _recording(name: str, index: int, *, wear: int, is_flat: bool) -> Recording:
    """Lines of shaft and pistons in noise; wear lifts the piston-pass lines."""
    generator = np.random.default_rng([index, *name.encode()])
    time = np.arange(12800) / 6400
    signal = 0.05 * generator.normal(size=(3, time.size))
    for order, level in ((1, 0.3), (7, 1.0), (14, 0.6), (21, 0.4), (28, 0.2)):
        rise = 1 + 0.6 * min(wear, 8) if order > 1 else 1
        phase = generator.uniform(0, 2 * math.pi, (3, 1))
        amplitude = level * rise * (1 + 0.05 * generator.normal(size=(3, 1)))
        signal += amplitude * np.sin(2 * math.pi * 25 * order * time + phase)
    if is_flat:
        signal[1] = 0.0
    condition = OperatingCondition(speed=SPEED, discharge_pressure=PRESSURE)
    return Recording(signal, 6400.0, f"{index}", channels=("x", "y", "z"), unit="m/s²", condition=condition)


@pytest.fixture(scope="session")
def filled_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a configuration and its history, to be copied by who changes it."""
    folder = tmp_path_factory.mktemp("plant")
    (folder / "watch.toml").write_text(_CONFIG, encoding="utf-8")
    config = load_watch_config(folder / "watch.toml")
    history = History.open("", config.folder)
    plant = Plant(config, history)
    plant.add("pump-1", 40, wear_from=28)
    plant.add("pump-2", 30)
    plant.add("pump-3", 4)
    plant.add("presse-4", 16, flat_from=13)
    with history.machine("pump-2") as machine:
        machine.add_event("note", "Ada", "Oil changed <b>twice</b>", NOW - timedelta(days=3))
    detail = "no machine is called pump-9"
    history.reject(
        rejection("x<script>.csv", "0" * 64, received=NOW, machine="pump-9", reason="machine", detail=detail)
    )
    history.close()
    return folder


@pytest.fixture
def plant(filled_folder: Path, tmp_path: Path) -> Iterator[Plant]:
    """A plant of one's own."""
    folder = tmp_path / "plant"
    shutil.copytree(filled_folder, folder)
    config = load_watch_config(folder / "watch.toml")
    history = History.open("", config.folder)
    yield Plant(config, history)
    history.close()


def watch_status() -> WatchStatus:
    """A watch that works."""
    source = Standing("http", "http")
    source.succeed(86)
    return WatchStatus(NOW, 2, 1, (source,), 5 * 10**9, {"judged": 90.0, "seconds_judging": 2.5})


@pytest.fixture
def application(plant: Plant) -> FastAPI:
    """The page of the plant on this computer, without logins."""
    return build_app(plant.config, plant.history, status=watch_status)


@pytest.fixture(scope="session")
def shared_application(filled_folder: Path) -> Iterator[FastAPI]:
    """The page of a plant that no test changes."""
    config = load_watch_config(filled_folder / "watch.toml")
    history = History.open("", config.folder)
    yield build_app(config, history, status=watch_status)
    history.close()


@pytest.fixture
def reader(shared_application: FastAPI) -> TestClient:
    """A browser without scripts that changes nothing."""
    return TestClient(shared_application, base_url="http://127.0.0.1:8642", follow_redirects=False)


@pytest.fixture
def client(application: FastAPI) -> TestClient:
    """A browser without scripts on this computer."""
    return TestClient(application, base_url="http://127.0.0.1:8642", follow_redirects=False)
