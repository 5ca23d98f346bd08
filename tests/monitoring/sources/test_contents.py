"""A delivered file becomes a recording at its operating point, or the reason why it cannot."""

import json
import os
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from itertools import count
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


def recording(**facts) -> Recording:
    # Values of single precision, which a file stores without a change.
    signal = np.random.default_rng(0).normal(size=(2, 256)).astype(np.float32).astype(float)
    return Recording(signal, 1000.0, "a", **{"channels": ("x", "y"), **facts})


def next_file(spool: Spool) -> SpoolFile:
    file = spool.next(0.0)
    assert file is not None
    return file


@pytest.fixture
def deliver(tmp_path: Path) -> Deliver:
    """Return a function that puts a recording as a file, or bytes, into a spool."""
    numbers = count()

    def put(content: Recording | bytes, file: str = "a.h5", **facts: str) -> SpoolFile:
        if isinstance(content, Recording):
            content = write_recording(content, tmp_path / file).read_bytes()
        spool = Spool(tmp_path / f"spool-{next(numbers)}")
        spool.add(Delivery("inbox", file, NOW, "pump-1", facts), content)
        return next_file(spool)

    return put


def test_samples_of_a_message_are_in_si_units(tmp_path: Path) -> None:
    header = {
        "rate": "1 kHz",
        "unit": "g",
        "channels": ["x", "y"],
        "type": "float32",
        "speed": "1500 rpm",
        "pressure": "15 MPa",
    }
    samples = np.array([[1, 2], [3, 4]], "<f4")
    payload = json.dumps(header).encode() + b"\n" + samples.tobytes()
    spool = Spool(tmp_path)
    spool.add(*read_message(payload, "mqtt", NOW, "pump-1"))

    contents = read_contents(next_file(spool), PUMP, None).recording

    # A message has all channels of one instant after each other, a recording a row for each.
    assert contents.signal == pytest.approx(9.80665 * samples.T)
    assert contents.unit == "m/s^2"
    assert contents.channels == ("x", "y")
    assert contents.sample_rate == 1000
    assert contents.condition is not None
    assert contents.condition.speed == pytest.approx(rpm(1500))
    assert contents.condition.discharge_pressure == pytest.approx(MPa(15))


def test_recordings_without_a_signal_differ_by_their_time(deliver: Deliver) -> None:
    # All recordings of a dead sensor have the same samples, and are no duplicates.
    flat = Recording(np.zeros((1, 64)), 1000.0, "a")
    digests = set()
    for age in (2, 1):
        time = NOW - timedelta(minutes=age)
        file = deliver(flat, time=time.isoformat())
        digests.add(read_contents(file, PUMP, None).digest)

    assert len(digests) == 2


@pytest.mark.parametrize(
    ("content", "file", "settings", "message"),
    [
        pytest.param(b"no HDF5 file", "a.h5", {}, "a.h5", id="other format than its suffix"),
        pytest.param(b"", "a.wav", {}, "empty", id="empty"),
        pytest.param(b"text", "notes.xyz", {}, "cannot be read", id="unknown suffix"),
        pytest.param(recording(), "a.h5", {"sample_rate": 2000.0}, "1000 Hz", id="sample rate"),
        pytest.param(recording(), "a.h5", {"channels": ("x", "z")}, "no channel 'z'", id="channel"),
        pytest.param(recording(), "a.h5", {"unit": "V"}, "V", id="unit"),
    ],
)
def test_what_cannot_be_read_as_configured_is_rejected_with_a_reason(
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
    # The path in the spool means nothing to a reader.
    assert str(spooled.path.parent) not in str(caught.value)


# Each place has values of its own, so that a result names its place. A measurement knows more than
# a message, and a log of another system more than the configuration.
TAGS_TEXT = "time,speed,pressure\n2026-11-23T13:50:00Z,1200,12\n"
IN_FILE = OperatingCondition(rpm(1500), MPa(15))
IN_MESSAGE = {"speed": "1300 rpm", "pressure": "13 MPa"}


@pytest.mark.parametrize(
    ("condition", "facts", "tags_file", "expected_rpm", "expected_mpa"),
    [
        pytest.param(IN_FILE, {}, "tags.csv", 1500, 15, id="file"),
        pytest.param(None, IN_MESSAGE, "tags.csv", 1300, 13, id="message"),
        pytest.param(None, {"pressure": "13 MPa"}, "tags.csv", 1200, 13, id="message and tags"),
        pytest.param(None, {}, "tags.csv", 1200, 12, id="tags"),
        pytest.param(None, {}, None, 900, 9, id="configuration"),
        pytest.param(None, {}, "missing.csv", 900, 9, id="configuration if tags are missing"),
    ],
)
def test_the_operating_point_is_taken_from_the_file_then_message_then_tags_then_configuration(
    deliver: Deliver,
    tmp_path: Path,
    condition: OperatingCondition | None,
    facts: dict[str, str],
    tags_file: str | None,
    expected_rpm: float,
    expected_mpa: float,
) -> None:
    (tmp_path / "tags.csv").write_text(TAGS_TEXT)
    tags = Tags(tmp_path / tags_file) if tags_file else None
    machine = Machine(
        name="pump-1",
        speed=rpm(900),
        discharge_pressure=MPa(9),
        tags=tmp_path / "tags.csv",
    )

    file = deliver(recording(condition=condition), "a.h5", **facts)
    contents = read_contents(file, machine, tags)

    assert contents.recording.condition is not None
    assert contents.recording.condition.speed == pytest.approx(rpm(expected_rpm))
    assert contents.recording.condition.discharge_pressure == pytest.approx(MPa(expected_mpa))
    # Only tags that cannot be read are worth a note.
    assert bool(contents.notes) == (tags_file == "missing.csv")


def test_a_speed_alone_is_kept_and_no_pressure_is_invented(deliver: Deliver) -> None:
    machine = Machine(name="pump-1", speed=rpm(900))

    contents = read_contents(deliver(recording()), machine, None).recording

    assert contents.condition is None
    assert contents.attributes["speed"] == "900.0 rpm"


@pytest.mark.parametrize(
    ("year", "note"),
    [
        pytest.param(2031, "lies in the future", id="clock ahead"),
        # A time zone or five minutes more would leave the range of years.
        pytest.param(9999, "lies in the future", id="last year of datetime"),
        # Clocks that were never set start in 1970 or 1980.
        pytest.param(1980, "before 1990", id="clock never set"),
    ],
)
def test_an_impossible_time_is_replaced_by_that_of_arrival(
    deliver: Deliver, year: int, note: str
) -> None:
    file = deliver(recording(), time=f"{year}-12-31T23:59:59+00:00")

    contents = read_contents(file, PUMP, None)

    assert contents.time == NOW
    assert note in contents.notes[0]


def test_a_tag_holds_for_an_hour(tmp_path: Path) -> None:
    path = tmp_path / "tags.csv"
    path.write_text("time,speed\n2026-11-23T13:00:00Z,900 rpm\n")
    tags = Tags(path)

    assert tags.at(NOW) == {"speed": "900 rpm"}
    assert tags.at(NOW + timedelta(seconds=1)) == {}
    # Nor does it hold for a time before its own.
    assert tags.at(NOW - timedelta(hours=2)) == {}


def test_tags_are_read_again_after_a_change_but_without_a_line_that_is_half_written(
    tmp_path: Path,
) -> None:
    path = tmp_path / "tags.csv"
    path.write_text("time,speed\n2026-11-23T13:00:00Z,900 rpm\n")
    tags = Tags(path)
    assert tags.at(NOW) == {"speed": "900 rpm"}

    # The other system writes 1498 in two pieces; 149 would be a wrong speed.
    for text in ("2026-11-23T13:30:00Z,1200\n2026-11-23T13:55:00Z,149", "8"):
        with path.open("a") as file:
            file.write(text)
        assert tags.at(NOW) == {"speed": "1200.0 rpm"}

    # However long the file stands still, half a line is none: a line break ends it.
    changed = path.stat().st_mtime - 11
    os.utime(path, (changed, changed))
    assert tags.at(NOW) == {"speed": "1200.0 rpm"}
    with path.open("a") as file:
        file.write("\n")
    assert tags.at(NOW) == {"speed": "1498.0 rpm"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        pytest.param("", "must begin with a line", id="empty"),
        pytest.param("when,speed\n", "must begin with a line", id="no column of times"),
        pytest.param("time,speed\nyesterday,5\n", "line 2", id="invalid time"),
        pytest.param("time,speed\n2026-11-23,fast\n", "line 2", id="invalid speed"),
    ],
)
def test_invalid_tags_are_reported_with_the_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "tags.csv"
    path.write_text(text)

    with pytest.raises(DataError, match=message):
        Tags(path).at(NOW)
