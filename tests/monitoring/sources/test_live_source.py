"""The live source of a watch: what it delivers, and what it reports."""

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from errno import ENOSPC, EROFS
from pathlib import Path

import numpy as np
import pytest
from mqtt_broker import wait_for

from swashtwin.foundation import MissingExtraError, SwashTwinError, packages
from swashtwin.monitoring import run_watch
from swashtwin.monitoring.config.config_file import load_watch_config
from swashtwin.monitoring.config.settings import LiveSource, WatchConfig
from swashtwin.monitoring.sources.contents import read_contents
from swashtwin.monitoring.sources.delivery import Accept, Delivery
from swashtwin.monitoring.sources.live import LiveWatch
from swashtwin.monitoring.sources.spool import Spool
from swashtwin.recordings import Finding, Recording, write_recording

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


def test_properties_are_numbers_or_texts(tmp_path: Path) -> None:
    properties = (
        'properties = { NumberOfChannels = 3, "AI 1/Amplitude" = 0.5, "AI 1/Waveform" = "Rect" }'
    )
    config = load(tmp_path, CONFIG.replace("[[source]]", f"[[source]]\n{properties}"))
    spool = Spool(tmp_path / "spool")
    with recording(config, spool.add) as watch:
        wait_for(lambda: watch.status.received > 0)

    assert watch.status.problem is None
    file = spool.next(1.0)
    assert file is not None
    signal = read_contents(file, config.machines[0], None).recording.signal
    # A rectangle of 0.5 V from a sensor of 100 mV/g, with little noise.
    assert np.median(np.abs(signal)) == pytest.approx(5 * 9.80665, rel=0.1)


def test_what_a_killed_watch_had_written_is_delivered_at_the_next_start(tmp_path: Path) -> None:
    config = load(tmp_path, CONFIG.replace("device0", "device9"))
    date = "2026-03-01T08:30:00+00:00"
    earlier = Recording(
        np.ones((1, 20_000)), 50e3, "pump-1-1", channels=("AI 1",), attributes={"date": date}
    )
    write_recording(earlier, config.folder / "live" / "live" / "pump-1-1.h5")
    deliveries = []

    def accept(delivery: Delivery, content: bytes | Path) -> str:
        deliveries.append(delivery)
        return ""

    with recording(config, accept) as watch:
        wait_for(lambda: watch.status.problem is not None)

    (delivery,) = deliveries
    assert (delivery.file, delivery.machine) == ("pump-1-1.h5", "pump-1")
    assert delivery.facts == {"time": date}


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


def complete_recording() -> Recording:
    date = {"date": "2026-11-23T14:00:00+00:00"}
    return Recording(np.zeros((1, 20_000)), 50e3, "pump-1", attributes=date)


def unstarted(config: WatchConfig, accept: Accept) -> LiveWatch:
    """Return the live source of a configuration, which records nothing by itself."""
    pytest.importorskip("opendaq")
    (source,) = config.sources
    assert isinstance(source, LiveSource)
    return LiveWatch(source, accept, config)


def test_a_disk_that_can_only_be_read_does_not_end_the_source(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*arguments: object, **options: object) -> str:
        raise OSError(EROFS, "Read-only file system")

    watch = unstarted(load(tmp_path), refuse)
    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", refuse)
        watch._deliver(complete_recording())

    assert "cannot be written: Read-only file system" in str(watch.status.problem)


def test_an_unsure_speed_stays_the_problem_and_is_logged_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    watch = unstarted(load(tmp_path), lambda *_: "")
    recording = complete_recording()

    for contrast in ("1.2", "1.3"):
        watch._report(Finding("speed", "warning", None, f"No speed (contrast {contrast})."))
        watch._deliver(recording)

    assert watch.status.received == 2
    assert watch.status.problem == "No speed (contrast 1.3)."
    assert [record.message for record in caplog.records] == [
        "source live: No speed (contrast 1.2)."
    ]

    watch._deliver(recording)
    assert watch.status.problem is None


def test_a_single_pass_states_that_it_records_nothing(tmp_path: Path) -> None:
    pytest.importorskip("opendaq")

    status = run_watch(load(tmp_path), once=True)

    assert status.problems == (
        "source live: not recorded: a live source needs a watch that keeps running",
    )


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"0.4 s"', '"0.05 s"', "length = 0.05 s is too short; it must be 0.1 s or more"),
        ('["AI 1"]', '["AI 1", "AI 1"]', "contains a name twice"),
        ('["AI 1"]', '["AI 2"]', "tachometer = 'AI 2' is one of the channels too"),
    ],
)
def test_an_entry_that_cannot_be_recorded_is_refused(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    with pytest.raises(SwashTwinError, match=message) as caught:
        load(tmp_path, CONFIG.replace(old, new))

    assert "watch.toml" in str(caught.value)


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
