"""A plant of four pumps whose history the pages show.

One pump is worn, one healthy, one new, and one has a broken sensor.
"""

import math
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from build_once import built_once
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
OPERATING_POINT = OperatingCondition(speed=rpm(1500), discharge_pressure=MPa(15))
_NEVER = 10**6
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

    def add(
        self, name: str, count: int, *, wear_from: int = _NEVER, flat_from: int = _NEVER
    ) -> None:
        """Judge `count` recordings of a machine, six hours apart.

        Parameters
        ----------
        wear_from : number of the first recording of a worn pump, which its model sees.
        flat_from : number of the first recording with a dead sensor.
        """
        spool = Spool(self.config.folder / "spool")
        pipeline = Pipeline(self.config, self.history)

        for number in range(count):
            wear = max(0, number - wear_from + 1)
            recording = _recording(name, number, wear=wear, is_flat=number >= flat_from)
            path = write_recording(recording, self.config.folder / f"{name}-{number}.h5")

            verdict = _verdict("swash_plate" if wear else "normal")
            pipeline._diagnose = lambda *_, verdict=verdict: verdict

            time = NOW - timedelta(hours=6 * (count - number))
            facts = {"time": time.isoformat()}
            spool.add(Delivery("http", path.name, time + timedelta(seconds=1), name, facts), path)
            file = spool.next(0)
            assert file is not None
            assert pipeline.judge(file).state != "rejected"
            spool.remove(file)


def _verdict(label: str) -> ModelVerdict:
    """Return what a model would answer; training one would take longer than all pages."""
    probabilities = dict.fromkeys(_CLASSES, 0.0175) | {label: 0.93}
    return ModelVerdict(
        model="1c09f2a7d1e0b3c4",
        answer={"probabilities": probabilities},
        label=label,
        probability=0.93,
        confidence=0.97,
    )


def _recording(name: str, number: int, *, wear: int, is_flat: bool) -> Recording:
    """Return lines of shaft and pistons in noise; wear raises the lines of piston passes."""
    generator = np.random.default_rng([number, *name.encode()])
    time = np.arange(12800) / 6400
    signal = 0.05 * generator.normal(size=(3, time.size))
    for order, level in ((1, 0.3), (7, 1.0), (14, 0.6), (21, 0.4), (28, 0.2)):
        rise = 1 + 0.6 * min(wear, 8) if order > 1 else 1
        phase = generator.uniform(0, 2 * math.pi, (3, 1))
        scatter = 1 + 0.05 * generator.normal(size=(3, 1))
        amplitude = level * rise * scatter
        signal += amplitude * np.sin(2 * math.pi * 25 * order * time + phase)
    if is_flat:
        signal[1] = 0.0

    return Recording(
        signal,
        6400.0,
        f"{number}",
        channels=("x", "y", "z"),
        unit="m/s^2",
        condition=OPERATING_POINT,
    )


@pytest.fixture(scope="session")
def filled_folder(shared_folder: Path) -> Path:
    """Folder of a configuration and its history; a test that changes it takes a copy."""
    return built_once(shared_folder / "watched", fill)


def fill(folder: Path) -> None:
    """Write a configuration, and the history of what it has judged."""
    folder.mkdir()
    (folder / "watch.toml").write_text(_CONFIG, encoding="utf-8")
    config = load_watch_config(folder / "watch.toml")
    history = History.open("", config.folder)

    # Ten recordings are learned from; twelve more are watched before the wear begins.
    plant = Plant(config, history)
    plant.add("pump-1", 34, wear_from=22)
    plant.add("pump-2", 18)
    plant.add("pump-3", 4)
    plant.add("presse-4", 16, flat_from=13)

    # Texts of strangers, which a page must show and not run.
    with history.machine("pump-2") as machine:
        machine.add_event("note", "Ada", "Oil changed <b>twice</b>")
    stranger = rejection(
        "x<script>.csv",
        "0" * 64,
        received=NOW,
        machine="pump-9",
        reason="machine",
        detail="no machine is called pump-9",
    )
    history.reject(stranger)

    history.close()


@pytest.fixture
def plant(filled_folder: Path, tmp_path: Path) -> Iterator[Plant]:
    """A copy of the plant that a test may change."""
    folder = tmp_path / "plant"
    shutil.copytree(filled_folder, folder)
    config = load_watch_config(folder / "watch.toml")
    history = History.open("", config.folder)
    yield Plant(config, history)
    history.close()


def watch_status() -> WatchStatus:
    """Return the status of a watch without a problem."""
    source = SourceStatus("http", "http")
    source.succeed(86)
    counters = {"judged": 90.0, "seconds_judging": 2.5}
    return WatchStatus(NOW, 2, 1, (source,), 5 * 10**9, counters)


@pytest.fixture
def application(plant: Plant) -> FastAPI:
    """The page of the plant on this computer, without logins."""
    return build_watch_page(plant.config, plant.history, status=watch_status)


@pytest.fixture(scope="session")
def shared_application(
    filled_folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[FastAPI]:
    """The page of a plant that no test changes."""
    folder = tmp_path_factory.mktemp("shown") / "plant"
    shutil.copytree(filled_folder, folder)
    config = load_watch_config(folder / "watch.toml")
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
