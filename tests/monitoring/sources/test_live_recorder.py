"""What a recorder makes of a stream: recordings, findings on what interrupts them, and speeds.

The stream is a substitute whose blocks are listed; `test_live_device.py` has a device of openDAQ.
"""

import math
import threading
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from pump_signals import RATE, SHAFT

from swashtwin.foundation import InputError
from swashtwin.monitoring.sources import live_recorder
from swashtwin.monitoring.sources.live_device import (
    Block,
    DeviceChangedError,
    DeviceLostError,
    DeviceSettings,
    LiveDevice,
)
from swashtwin.monitoring.sources.live_recorder import LiveRecorder, LiveSettings
from swashtwin.recordings import Finding, Recording

START = datetime(2026, 11, 23, 14, tzinfo=UTC)
Step = Block | Exception | None
"""What one read of the substitute does; None is nothing yet."""


class Stream(LiveDevice):
    """A device that returns listed blocks, and sets `stop` when there are no more."""

    def __init__(self, steps: Sequence[Step], stop: threading.Event) -> None:
        self.sample_rate = RATE
        self.channels: tuple[str, ...] = ("x",)
        self.unit = "m/s^2"
        self.n_opened = 0
        self.is_closed = False
        self.failures: list[Exception] = []
        self._steps = list(steps)
        self._stop = stop

    def __call__(self, settings: DeviceSettings) -> "Stream":
        if self.n_opened and self.failures:
            raise self.failures.pop(0)
        self.n_opened += 1
        self.is_closed = False
        return self

    def read(self) -> list[Block]:
        step = self._steps.pop(0)
        if not self._steps:
            self._stop.set()
        if isinstance(step, Exception):
            raise step
        return [] if step is None else [step]

    def close(self) -> None:
        self.is_closed = True

    def set_up(self) -> None:
        if self.failures:
            raise self.failures.pop(0)


def block(
    first: int, count: int, *, missing: int = 0, discarded: int = 0, tacho: bool = False
) -> Block:
    """Return a block whose samples are their own numbers."""
    numbers = np.arange(first, first + count, dtype=float)
    start = START + timedelta(seconds=first / RATE)
    return Block(numbers[None], numbers if tacho else None, missing, discarded, start)


Record = Callable[..., tuple[list[Recording], list[Finding]]]


@pytest.fixture
def stop() -> threading.Event:
    return threading.Event()


@pytest.fixture
def record(monkeypatch: pytest.MonkeyPatch, stop: threading.Event) -> Record:
    """Return what a recorder yields for the steps of a stream."""
    monkeypatch.setattr(live_recorder, "FIRST_PAUSE_S", 0.001)

    def record(
        *steps: Step, length: float = 0.2, failures: Sequence[Exception] = (), **settings: object
    ) -> tuple[list[Recording], list[Finding]]:
        stream = Stream(steps, stop)
        stream.failures = list(failures)
        monkeypatch.setattr(live_recorder, "LiveDevice", stream)
        recorder = LiveRecorder(LiveSettings(DeviceSettings("stream"), length, **settings))
        items = list(recorder.run(stop))
        recorder.close()
        assert stream.is_closed
        recordings = [item for item in items if isinstance(item, Recording)]
        return recordings, [item for item in items if isinstance(item, Finding)]

    return record


def numbers_of(recordings: Sequence[Recording]) -> list[tuple[int, int]]:
    """Return the first and last sample of each recording, which must count up without a gap."""
    for recording in recordings:
        assert (np.diff(recording.signal[0]) == 1).all()
    return [(int(item.signal[0, 0]), int(item.signal[0, -1])) for item in recordings]


def test_recordings_follow_each_other_without_a_lost_sample(record: Record) -> None:
    recordings, findings = record(block(0, 1500), None, block(1500, 4500))

    assert numbers_of(recordings) == [(0, 1999), (2000, 3999), (4000, 5999)]
    assert findings == []
    assert [item.attributes["date"] for item in recordings] == [
        "2026-11-23T14:00:00.000+00:00",
        "2026-11-23T14:00:00.200+00:00",
        "2026-11-23T14:00:00.400+00:00",
    ]
    assert [item.recording_id for item in recordings][1] == "live-20261123T140000-200Z"


def test_a_gap_ends_a_recording_and_is_a_finding(record: Record) -> None:
    recordings, findings = record(block(0, 1500), block(1600, 2000, missing=100))

    assert numbers_of(recordings) == [(0, 1499), (1600, 3599)]
    assert [item.kind for item in findings] == ["gap", "short"]
    assert findings[0].message == "The device left out 100 samples (0.01 s)."
    assert "left out 100 samples" in recordings[0].attributes["findings"]
    assert "findings" not in recordings[1].attributes


def test_a_gap_between_two_recordings_is_a_finding_too(record: Record) -> None:
    recordings, findings = record(block(0, 2000), block(2100, 2000, missing=100))

    assert numbers_of(recordings) == [(0, 1999), (2100, 4099)]
    assert [item.kind for item in findings] == ["gap"]


@pytest.mark.parametrize(
    ("second", "kind", "message"),
    [
        (block(9000, 500, missing=7500, discarded=7500), "overrun", "7500 samples (0.75 s) were"),
        (block(0, 500, missing=-1500), "clock", "set back by 1500 samples"),
    ],
)
def test_what_interrupts_a_recording_is_named(
    record: Record, second: Block, kind: str, message: str
) -> None:
    recordings, findings = record(block(0, 1500), second)

    assert [recording.n_samples for recording in recordings] == [1500]
    assert findings[0].kind == kind
    assert message in findings[0].message


def test_a_part_that_is_too_short_is_left_out_and_said(record: Record) -> None:
    recordings, findings = record(block(0, 900), block(1000, 2000, missing=100))

    assert numbers_of(recordings) == [(1000, 2999)]
    assert findings[1].message == "The 0.09 s before it are too short to be kept."


def test_a_changed_device_is_set_up_again(record: Record) -> None:
    recordings, findings = record(
        block(0, 1500), DeviceChangedError("stream changed its rate."), block(0, 2000)
    )

    assert [item.kind for item in findings] == ["changed", "short", "back"]
    assert numbers_of(recordings) == [(0, 1499), (0, 1999)]


def test_a_device_that_vanished_is_tried_until_it_is_back(record: Record) -> None:
    gone = DeviceLostError("the device does not answer.")
    recordings, findings = record(
        block(0, 1500), DeviceLostError("no sample."), block(0, 2000), failures=[gone, gone]
    )

    # A reason that stays the same is reported once.
    assert [item.kind for item in findings] == ["vanished", "short", "vanished", "back"]
    assert numbers_of(recordings) == [(0, 1499), (0, 1999)]
    assert "is recorded again after" in recordings[1].attributes["findings"]


def test_what_was_recorded_until_a_stop_is_kept(record: Record) -> None:
    recordings, findings = record(block(0, 1500), None)

    assert numbers_of(recordings) == [(0, 1499)]
    assert [item.message for item in findings] == [
        "The recording was stopped.",
        "The recording ends after 0.15 s.",
    ]
    assert [item.severity for item in findings] == ["note", "note"]


def test_an_interval_lies_between_two_starts(record: Record) -> None:
    recordings, _ = record(block(0, 5000), block(5000, 5000), interval=3600.0)

    assert numbers_of(recordings) == [(0, 1999)]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"length": 0.01}, "too short"),
        ({"interval": 0.1}, "does not fit into an interval of 0.1 s"),
        ({"length": 1e5}, "is too large: record at most 3355 s"),
    ],
)
def test_a_length_that_cannot_be_recorded_is_refused(
    record: Record, settings: dict[str, float], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        record(block(0, 10), **settings)


def test_a_tachometer_counts_as_a_channel_in_memory(
    monkeypatch: pytest.MonkeyPatch, stop: threading.Event
) -> None:
    monkeypatch.setattr(live_recorder, "LiveDevice", Stream([None], stop))
    device = DeviceSettings("stream", tacho="pulses")

    with pytest.raises(InputError, match=r"1 channel and a tachometer .* at most 1678 s"):
        LiveRecorder(LiveSettings(device, 1e5))


def test_the_speed_is_estimated_from_the_lines_of_the_pistons(record: Record) -> None:
    ((recording,), findings) = record(harmonic_block(), length=4.0, piston_count=7)

    number, unit = recording.attributes["speed"].split()
    assert (float(number), unit) == (pytest.approx(60 * SHAFT, rel=0.005), "rpm")
    assert recording.attributes["speed_source"].startswith("estimated from the spectrum (contrast")
    assert findings == []


def harmonic_block() -> Block:
    """Return four seconds with ten lines at multiples of seven times the shaft frequency."""
    time = np.arange(40000) / RATE
    noise = 0.05 * np.random.default_rng(1).standard_normal(time.size)
    lines = [np.cos(2 * math.pi * 7 * k * SHAFT * time + k) for k in range(1, 13)]
    return Block((np.sum(lines, axis=0) + noise)[None], None, 0, 0, START)


def test_a_speed_without_lines_is_unknown_and_said(record: Record) -> None:
    noise = np.random.default_rng(2).standard_normal((1, 40000))
    ((recording,), findings) = record(Block(noise, None, 0, 0, START), length=4.0, piston_count=7)

    assert "speed" not in recording.attributes
    assert findings[0].message.startswith("The speed is unknown: the lines of the spectrum are too")


def test_a_specified_speed_that_the_lines_contradict_is_a_finding(record: Record) -> None:
    ((recording,), findings) = record(
        harmonic_block(), length=4.0, piston_count=7, speed=2 * math.pi * 1.3 * SHAFT
    )

    assert recording.attributes["speed"] == "1170 rpm"
    assert "show 9" in findings[0].message
    assert "but specified is 1170 rpm" in findings[0].message


def test_tags_give_the_operating_point(record: Record, tmp_path: Path) -> None:
    tags = tmp_path / "tags.csv"
    tags.write_text("time,speed,pressure\n2026-11-23T13:59:00Z,1480,14\n", encoding="utf-8")

    ((recording, *_), findings) = record(block(0, 2000), tags=tags)

    assert recording.condition is not None
    assert recording.condition.speed == pytest.approx(1480 * math.pi / 30)
    assert recording.condition.discharge_pressure == 14e6
    assert recording.attributes["speed_source"] == "tags"
    assert findings == []


def test_tags_that_end_too_early_are_a_finding(record: Record, tmp_path: Path) -> None:
    tags = tmp_path / "tags.csv"
    tags.write_text("time,speed\n2026-11-22T13:59:00Z,1480\n", encoding="utf-8")

    (_, findings) = record(block(0, 2000), tags=tags)

    assert "tags.csv has none at this time" in findings[0].message


def test_a_tachometer_without_pulses_is_a_finding(record: Record) -> None:
    ((recording,), findings) = record(block(0, 2000, tacho=True))

    assert "speed" not in recording.attributes
    assert findings[0].message.startswith("No speed by the tachometer: ")
