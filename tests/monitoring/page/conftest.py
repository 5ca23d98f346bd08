"""A plant of four pumps whose history the pages show: one worn, one healthy, one new, one with a
broken sensor.
"""

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
from swashtwin.monitoring.config.config_file import load_watch_config
from swashtwin.monitoring.config.settings import WatchConfig
from swashtwin.monitoring.history.history import History
from swashtwin.monitoring.page.watch_page import build_watch_page
from swashtwin.monitoring.service.filing import ModelVerdict
from swashtwin.monitoring.service.judging import Pipeline
from swashtwin.monitoring.sources.delivery import Delivery
from swashtwin.monitoring.sources.spool import Spool
from swashtwin.monitoring.status import SourceStatus, WatchStatus
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording, write_recording

NOW = datetime.now(UTC).replace(microsecond=0)
SPEED, PRESSURE = rpm(1500), MPa(15)
_CLASSES = ("swash_plate", "normal", "piston", "valve_plate", "cylinder_block")
_CONFIG = """
folder = "data"
[alarms]
baseline_recordings = 10
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
        """Deliver `count` recordings of a machine, worn or with a dead sensor from one on; its
        model sees the wear.
        """
        spool, pipeline = Spool(self.config.folder / "spool"), Pipeline(self.config, self.history)
        for index in range(count):
            wear = max(0, index - wear_from + 1)
            recording = _recording(name, index, wear=wear, is_flat=index >= flat_from)
            label = "swash_plate" if wear else "normal"
            shares = dict.fromkeys(_CLASSES, 0.0175) | {label: 0.93}
            verdict = ModelVerdict(
                model="1c09f2a7d1e0b3c4",
                answer={"probabilities": shares},
                label=label,
                probability=0.93,
                confidence=0.97,
            )
            pipeline._diagnose = lambda *_, verdict=verdict: verdict
            time = NOW - timedelta(hours=6 * (count - index))
            path = write_recording(recording, self.config.folder / f"{name}-{index}.h5")
            delivery = Delivery(
                "http", path.name, time + timedelta(seconds=1), name, {"time": time.isoformat()}
            )
            spool.add(delivery, path)
            file = spool.next(0)
            assert file is not None
            assert pipeline.judge(file).state != "rejected"
            spool.remove(file)


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
    return Recording(
        signal, 6400.0, f"{index}", channels=("x", "y", "z"), unit="m/s^2", condition=condition
    )


@pytest.fixture(scope="session")
def filled_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a configuration and its history, to be copied by who changes it."""
    folder = tmp_path_factory.mktemp("plant")
    (folder / "watch.toml").write_text(_CONFIG, encoding="utf-8")
    config = load_watch_config(folder / "watch.toml")
    history = History.open("", config.folder)
    plant = Plant(config, history)
    plant.add("pump-1", 34, wear_from=22)
    plant.add("pump-2", 18)
    plant.add("pump-3", 4)
    plant.add("presse-4", 16, flat_from=13)
    with history.machine("pump-2") as machine:
        machine.add_event("note", "Ada", "Oil changed <b>twice</b>")
    detail = "no machine is called pump-9"
    history.reject(
        rejection(
            "x<script>.csv",
            "0" * 64,
            received=NOW,
            machine="pump-9",
            reason="machine",
            detail=detail,
        )
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
    source = SourceStatus("http", "http")
    source.succeed(86)
    return WatchStatus(NOW, 2, 1, (source,), 5 * 10**9, {"judged": 90.0, "seconds_judging": 2.5})


@pytest.fixture
def application(plant: Plant) -> FastAPI:
    """The page of the plant on this computer, without logins."""
    return build_watch_page(plant.config, plant.history, status=watch_status)


@pytest.fixture(scope="session")
def shared_application(filled_folder: Path) -> Iterator[FastAPI]:
    """The page of a plant that no test changes."""
    config = load_watch_config(filled_folder / "watch.toml")
    history = History.open("", config.folder)
    yield build_watch_page(config, history, status=watch_status)
    history.close()


@pytest.fixture
def reader(shared_application: FastAPI) -> TestClient:
    """A browser without scripts that changes nothing."""
    return TestClient(shared_application, base_url="http://127.0.0.1:8642", follow_redirects=False)


@pytest.fixture
def client(application: FastAPI) -> TestClient:
    """A browser without scripts on this computer."""
    return TestClient(application, base_url="http://127.0.0.1:8642", follow_redirects=False)
