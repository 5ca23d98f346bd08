"""The live source of a watch: what it delivers, and what it reports."""

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from errno import ENOSPC
from pathlib import Path

import pytest
from mqtt_broker import wait_for

from swashtwin.foundation import MissingExtraError, packages
from swashtwin.monitoring.config.config_file import load_watch_config
from swashtwin.monitoring.config.settings import LiveSource, WatchConfig
from swashtwin.monitoring.sources.contents import read_contents
from swashtwin.monitoring.sources.delivery import Accept, Delivery
from swashtwin.monitoring.sources.live import LiveWatch
from swashtwin.monitoring.sources.spool import Spool

CONFIG = """
folder = "watch"

[[machine]]
name = "pump-1"
discharge_pressure = "15 MPa"

[[source]]
kind = "live"
device = "daqref://device0"
machine = "pump-1"
length = "0.4 s"
sample_rate = "50 kHz"
sensitivity = "100 mV/g"
channels = ["AI 1"]
tachometer = "AI 2"
"""


def load(folder: Path, text: str = CONFIG) -> WatchConfig:
    path = folder / "watch.toml"
    path.write_text(text, encoding="utf-8")
    return load_watch_config(path)


@contextmanager
def recording(config: WatchConfig, accept: Accept) -> Iterator[LiveWatch]:
    """Run the live source of a configuration in a thread."""
    pytest.importorskip("opendaq")
    (source,) = config.sources
    assert isinstance(source, LiveSource)
    watch = LiveWatch(source, accept, config)
    stop = threading.Event()
    thread = threading.Thread(target=watch.run, args=(stop,))
    thread.start()
    try:
        yield watch
    finally:
        stop.set()
        thread.join()


def test_recordings_reach_the_spool_with_the_measured_operating_point(tmp_path: Path) -> None:
    config = load(tmp_path)
    spool = Spool(tmp_path / "spool")
    with recording(config, spool.add) as watch:
        wait_for(lambda: watch.status.received > 1)

    file = spool.next(1.0)
    assert file is not None
    contents = read_contents(file, config.machines[0], None)
    assert contents.recording.channels == ("AI 1",)
    assert contents.recording.unit == "m/s^2"
    assert contents.recording.n_samples == 20_000
    condition = contents.recording.condition
    assert condition is not None
    assert condition.shaft_frequency == pytest.approx(10.0, rel=1e-3)
    assert condition.discharge_pressure == 15e6

    # Nothing is left beside the spool.
    assert list((config.folder / "live").rglob("*.h5")) == []


def test_a_device_that_does_not_answer_is_the_problem_of_the_source(tmp_path: Path) -> None:
    config = load(tmp_path, CONFIG.replace("device0", "device9"))
    with recording(config, lambda *_: "") as watch:
        wait_for(lambda: watch.status.problem is not None)

    assert "'daqref://device9' does not answer" in str(watch.status.problem)


def test_a_full_disk_loses_a_recording_and_is_reported(tmp_path: Path) -> None:
    def refuse(delivery: Delivery, content: bytes | Path) -> str:
        raise OSError(ENOSPC, "No space left on device")

    config = load(tmp_path)
    problems = []
    with recording(config, refuse) as watch:
        wait_for(lambda: watch.status.problem is not None)
        problems.append(watch.status.problem)

    assert problems == [
        "a recording of 0.4 s is lost, because it cannot be written: No space left on device"
    ]
    assert list((config.folder / "live").rglob("*.h5")) == []


def test_without_opendaq_the_watch_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "opendaq", raising=False)
    monkeypatch.setattr(packages, "find_spec", lambda name: None)
    config = load(tmp_path)
    (source,) = config.sources
    assert isinstance(source, LiveSource)

    with pytest.raises(MissingExtraError, match=r'pip install "swashtwin\[live\]"'):
        LiveWatch(source, lambda *_: "", config)
