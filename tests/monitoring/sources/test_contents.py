"""A delivered file becomes a recording at its operating point, or the reason why it cannot."""

import json
import os
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from swashtwin.foundation import DataError, MPa, rpm
from swashtwin.monitoring.config.settings import Machine
from swashtwin.monitoring.sources.contents import read_contents
from swashtwin.monitoring.sources.delivery import Delivery, RejectionError
from swashtwin.monitoring.sources.message_format import read_message
from swashtwin.monitoring.sources.spool import Spool, SpoolFile
from swashtwin.monitoring.sources.tags import Tags
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording, write_recording

NOW = datetime(2026, 11, 23, 14, tzinfo=UTC)
PUMP = Machine(name="pump-1")
Deliver = Callable[..., SpoolFile]


def recording(seed: int = 0, **facts) -> Recording:
    signal = np.random.default_rng(seed).normal(size=(2, 256)).astype(np.float32).astype(float)
    return Recording(signal, 1000.0, "a", **{"channels": ("x", "y"), **facts})


@pytest.fixture
def deliver(tmp_path: Path) -> Deliver:
    """Puts a recording as a file, or bytes, into a spool."""

    def put(content: Recording | bytes, file: str = "a.h5", **facts: str) -> SpoolFile:
        if isinstance(content, Recording):
            content = write_recording(content, tmp_path / file).read_bytes()
        spool = Spool(tmp_path / f"spool-{len(list(tmp_path.iterdir()))}")
        spool.add(Delivery("inbox", file, NOW, "pump-1", facts), content)
        waiting = spool.next(0.0)
        assert waiting is not None
        return waiting

    return put


def test_samples_of_a_message_are_in_si_units(tmp_path: Path) -> None:
    header = {"rate": "1 kHz", "unit": "g", "channels": ["x", "y"], "type": "float32"}
    header |= {"speed": "1500 rpm", "pressure": "15 MPa"}
    payload = json.dumps(header).encode() + b"\n" + np.array([[1, 2], [3, 4]], "<f4").tobytes()
    spool = Spool(tmp_path)
    spool.add(*read_message(payload, "mqtt", NOW, "pump-1"))
    file = spool.next(0.0)
    assert file is not None
    contents = read_contents(file, PUMP, None).recording
    assert contents.signal == pytest.approx(9.80665 * np.array([[1, 3], [2, 4]]))
    assert (contents.unit, contents.channels, contents.sample_rate) == ("m/s^2", ("x", "y"), 1000)
    assert contents.condition is not None
    assert (contents.condition.speed, contents.condition.discharge_pressure) == pytest.approx(
        (rpm(1500), MPa(15))
    )


def test_recordings_without_a_signal_differ_by_their_time(deliver: Deliver) -> None:
    flat = Recording(np.zeros((1, 64)), 1000.0, "a")
    early, late = ((NOW - timedelta(minutes=age)).isoformat() for age in (2, 1))
    digests = {read_contents(deliver(flat, time=time), PUMP, None).digest for time in (early, late)}
    assert len(digests) == 2


@pytest.mark.parametrize(
    ("content", "file", "settings", "message"),
    [
        (b"no HDF5 file", "a.h5", {}, "a.h5"),
        (b"", "a.wav", {}, "empty"),
        (b"text", "notes.xyz", {}, "cannot be read"),
        (recording(), "a.h5", {"sample_rate": 2000.0}, "1000 Hz"),
        (recording(), "a.h5", {"channels": ("x", "z")}, "no channel 'z'"),
        (recording(), "a.h5", {"unit": "V"}, "V"),
    ],
)
def test_what_cannot_be_read_as_configured_has_a_reason_that_names_the_file(
    deliver: Deliver,
    content: Recording | bytes,
    file: str,
    settings: dict[str, object],
    message: str,
) -> None:
    spooled = deliver(content, file)
    with pytest.raises(RejectionError) as caught:
        read_contents(spooled, Machine(name="pump-1", **settings), None)
    assert caught.value.reason == "broken"
    assert message in str(caught.value)
    assert str(spooled.path.parent) not in str(caught.value)


def test_the_operating_point_is_that_of_the_file_then_the_message_then_the_tags_then_the_configuration(
    deliver: Deliver, tmp_path: Path
) -> None:
    tags = tmp_path / "tags.csv"
    tags.write_text("time,speed,pressure\n2026-11-23T13:50:00Z,1200,12\n")
    machine = Machine(name="pump-1", speed=rpm(900), discharge_pressure=MPa(9), tags=tags)
    at_15 = OperatingCondition(rpm(1500), MPa(15))
    missing = Tags(tmp_path / "missing.csv")
    cases = [
        (deliver(recording(condition=at_15), "a.h5"), Tags(tags), (1500, 15)),
        (deliver(recording(), "b.h5", speed="1300 rpm", pressure="13 MPa"), Tags(tags), (1300, 13)),
        (deliver(recording(), "c.h5", pressure="13 MPa"), Tags(tags), (1200, 13)),
        (deliver(recording(), "d.h5"), Tags(tags), (1200, 12)),
        (deliver(recording(), "e.h5"), None, (900, 9)),
        (deliver(recording(), "f.h5"), missing, (900, 9)),
    ]
    for file, tag_file, (speed, pressure) in cases:
        contents = read_contents(file, machine, tag_file)
        assert bool(contents.notes) == (tag_file is missing)
        condition = contents.recording.condition
        assert condition is not None
        assert (condition.speed, condition.discharge_pressure) == pytest.approx(
            (rpm(speed), MPa(pressure))
        )


def test_a_speed_alone_is_kept_and_no_pressure_is_invented(deliver: Deliver) -> None:
    contents = read_contents(
        deliver(recording()), Machine(name="pump-1", speed=rpm(900)), None
    ).recording
    assert contents.condition is None
    assert contents.attributes["speed"] == "900.0 rpm"


@pytest.mark.parametrize(
    ("year", "note"),
    [(2031, "lies in the future"), (9999, "lies in the future"), (1980, "before 1990")],
)
def test_a_time_that_cannot_be_is_replaced_by_that_of_arrival(
    deliver: Deliver, year: int, note: str
) -> None:
    contents = read_contents(deliver(recording(), time=f"{year}-12-31T23:59:59+00:00"), PUMP, None)
    assert contents.time == NOW
    assert note in contents.notes[0]


def test_a_tag_holds_for_an_hour_and_the_file_is_read_again_when_it_changed_but_no_half_line(
    tmp_path: Path,
) -> None:
    path = tmp_path / "tags.csv"
    path.write_text("time,speed\n2026-11-23T13:00:00Z,900 rpm\n")
    tags = Tags(path)
    assert tags.at(NOW) == {"speed": "900 rpm"}
    assert tags.at(NOW + timedelta(seconds=1)) == tags.at(NOW - timedelta(hours=2)) == {}
    for line in ("2026-11-23T13:30:00Z,1200\n2026-11-23T13:55:00Z,149", "8"):
        with path.open("a") as file:
            file.write(line)
        assert tags.at(NOW) == {"speed": "1200.0 rpm"}
    os.utime(path, (path.stat().st_mtime - 11,) * 2)
    assert tags.at(NOW) == {"speed": "1498.0 rpm"}
    for text, message in (
        ("", "must begin with a line"),
        ("when,speed\n", "must begin with a line"),
        ("time,speed\nyesterday,5\n", "line 2"),
        ("time,speed\n2026-11-23,fast\n", "line 2"),
    ):
        path.write_text(text)
        with pytest.raises(DataError, match=message):
            Tags(path).at(NOW)
