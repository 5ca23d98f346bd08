"""Tags files as historians, spreadsheets and German systems write them."""

import os
from datetime import UTC, datetime, timedelta
from pathlib import Path
from zoneinfo import ZoneInfo

import pytest

from swashtwin.foundation import DataError, parse_quantity
from swashtwin.monitoring.sources.tags import Tags, TagsPendingError

NOON = datetime(2025, 11, 24, 12, tzinfo=UTC)
BERLIN = ZoneInfo("Europe/Berlin")


def tags_of(folder: Path, content: str | bytes, zone: ZoneInfo | None = None) -> Tags:
    path = folder / "tags.csv"
    if isinstance(content, str):
        content = content.encode()
    path.write_bytes(content)
    return Tags(path, zone)


def operating_point(tags: Tags, time: datetime = NOON) -> tuple[float, float]:
    """Return the speed [rpm] and the pressure [MPa] at a time."""
    facts = tags.require_at(time)
    speed = parse_quantity(facts["speed"], "rad/s", name="speed") * 30 / 3.141592653589793
    pressure = parse_quantity(facts["pressure"], "Pa", name="pressure") / 1e6
    return round(speed, 6), round(pressure, 6)


ISO = "2025-11-24T11:59:00Z"
SECONDS = int((NOON - timedelta(minutes=1)).timestamp())


@pytest.mark.parametrize(
    "text",
    [
        f"time,speed,pressure\n{ISO},1498,15.1\n",
        f"time;speed;pressure\n{ISO};1498;15.1\n",
        f"time\tspeed\tpressure\n{ISO}\t1498\t15,1\n",
        f"time;speed;pressure\n{ISO};1.498;15,1\n",
        f"time;speed;pressure\n{ISO};1498,0;15,1\n",
        f'time,speed,pressure\n{ISO},"1,498.0",15.1\n',
        f"\ufefftime,speed,pressure\n{ISO},1498,15.1\n",
        f"sep=;\ntime;speed;pressure;\n{ISO};1498;15.1;\n",
        f"time,speed,pressure\n{SECONDS},1498,15.1\n",
        f"time,speed,pressure\n{SECONDS}.5,1498,15.1\n",
        f"time;speed;pressure\n{SECONDS},25;1498;15,1\n",
        f"time [ms],speed,pressure\n{SECONDS}000,1498,15.1\n",
        f"time,speed,pressure\n{SECONDS}000000000,1498,15.1\n",
        "Zeit;Drehzahl [1/min];Druck [bar]\n24.11.2025 11:59:00Z;1498;151,0\n",
        "time (UTC);speed_rpm;pressure_bar\n24.11.2025 11:59;1498;151.0\n",
        "Date,Time UTC,speed,pressure\n2025-11-24,11:59:00,1498,15.1\n",
        "time,speed,pressure\n2025/11/24 11:59:00 UTC,1498 rpm,151 bar\n",
        "time,tank,speed,pressure,note\n2025-11-24 12:59:00 +01:00,5,1498,15.1,\n",
    ],
)
def test_the_operating_point_is_read_whatever_separates_cells_and_marks_decimals(
    tmp_path: Path, text: str
) -> None:
    assert operating_point(tags_of(tmp_path, text)) == (1498.0, 15.1)


@pytest.mark.parametrize("encoding", ["utf-16", "cp1252"])
def test_spreadsheets_write_other_encodings(tmp_path: Path, encoding: str) -> None:
    text = f"time;speed;pressure;temperature [°C]\r\n{ISO};1498;15,1;45\r\n"
    assert operating_point(tags_of(tmp_path, text.encode(encoding))) == (1498.0, 15.1)


def test_times_without_a_zone_are_asked_for_and_the_answer_works(tmp_path: Path) -> None:
    text = "time;speed;pressure\n24.11.2025 12:59:00;1498;15,1\n"
    with pytest.raises(TagsPendingError, match=r"tags\.csv.*line 2.*tags_zone"):
        tags_of(tmp_path, text).at(NOON)
    assert operating_point(tags_of(tmp_path, text, BERLIN)) == (1498.0, 15.1)


def test_the_hour_that_comes_twice_is_in_the_order_of_the_lines(tmp_path: Path) -> None:
    lines = ["02:10:00,1000,10", "02:50:00,1100,11", "02:10:00,1200,12", "02:50:00,1300,13"]
    text = "time,speed,pressure\n" + "".join(f"2025-10-26 {line}\n" for line in lines)
    tags = tags_of(tmp_path, text, BERLIN)
    start = datetime(2025, 10, 26, 0, 10, tzinfo=UTC)
    speeds = [operating_point(tags, start + timedelta(minutes=m))[0] for m in (0, 40, 60, 100)]
    assert speeds == [1000, 1100, 1200, 1300]


@pytest.mark.parametrize(
    ("cell", "message"),
    [
        ("Bad Input", "'Bad Input' is not a number"),
        ("", "no speed"),
        ("#N/A", "not a number"),
        ("-1498", "impossible"),
        ("nan", "not a number"),
        ("1e9", "impossible"),
        ("1498 parsec", "unknown unit"),
    ],
)
def test_a_bad_line_spoils_its_own_span_only(tmp_path: Path, cell: str, message: str) -> None:
    text = (
        "time,speed,pressure\n"
        f"2025-11-24T11:30:00Z,1000,10\n2025-11-24T11:50:00Z,{cell},11\n"
        "2025-11-24T12:10:00Z,1200,12\n"
    )
    tags = tags_of(tmp_path, text)
    assert operating_point(tags, NOON - timedelta(minutes=15)) == (1000, 10)
    with pytest.raises(DataError, match=rf"tags\.csv.*line 3: .*{message}") as caught:
        tags.at(NOON)
    assert not isinstance(caught.value, TagsPendingError)
    assert operating_point(tags, NOON + timedelta(minutes=15)) == (1200, 12)


@pytest.mark.parametrize("pressure", ["2190", "-3", "151"])
def test_an_impossible_pressure_is_refused_with_its_line(tmp_path: Path, pressure: str) -> None:
    text = f"time,speed,pressure\n2025-11-24T11:00:00Z,1400,14\n{ISO},1498,{pressure}\n"
    with pytest.raises(DataError, match=r"line 3: pressure.*impossible"):
        tags_of(tmp_path, text).at(NOON)


def test_a_line_without_a_readable_time_spoils_what_follows_the_one_before(tmp_path: Path) -> None:
    text = (
        "time,speed,pressure\n2025-11-24T11:30:00Z,1000,10\nBad,1100,11\n"
        "2025-11-24T12:10:00Z,1200,12\n"
    )
    with pytest.raises(DataError, match="line 3"):
        tags_of(tmp_path, text).at(NOON)
    assert operating_point(tags_of(tmp_path, text), NOON + timedelta(minutes=15)) == (1200, 12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("when,rpm\n1,2\n", "must begin with a line"),
        (f"{ISO},1498,15.1\n", "must begin with a line"),
        (f"time,speed,speed 2\n{ISO},1,2\n", "speed 2"),
        (f"time,speed [furlong],pressure\n{ISO},1,2\n", "furlong"),
        (f"time;speed;pressure\n{ISO};1,498;15,100\n", "two readings"),
        (f"time;speed;pressure\n{ISO};1498.5;15,1\n", "decimal point"),
        (f"time,speed,pressure\n{ISO},1498,0,15,1\n", "Separate cells with ;"),
        ("time,speed,pressure\n11/12/2025 11:59,1498,15.1\n", "ISO 8601"),
        ("time,speed,pressure\n45985.5,1498,15.1\n", "since 1970"),
        ("time,speed,pressure\n1980-01-06T00:00:00Z,1498,15.1\n", "before 1990"),
    ],
)
def test_what_has_two_readings_or_none_is_a_problem_that_names_file_and_fix(
    tmp_path: Path, text: str, message: str
) -> None:
    with pytest.raises(TagsPendingError, match=rf"tags\.csv.*{message}"):
        tags_of(tmp_path, text).at(NOON)


@pytest.mark.parametrize("age_s", [0, 3600])
def test_half_a_line_is_none_until_another_follows(tmp_path: Path, age_s: float) -> None:
    tags = tags_of(tmp_path, f"time,pressure,speed\n2025-11-24T11:30:00Z,10,1000\n{ISO},15.1,149")
    path = tmp_path / "tags.csv"
    os.utime(path, (path.stat().st_mtime - age_s,) * 2)
    assert operating_point(tags) == (1000.0, 10.0)
    with path.open("a") as file:
        file.write("8\n")
    assert operating_point(tags) == (1498.0, 15.1)


def test_a_recording_behind_the_end_of_the_file_waits_and_one_in_a_gap_does_not(
    tmp_path: Path,
) -> None:
    tags = tags_of(tmp_path, "time,speed\n2025-11-24T09:00:00Z,1000\n")
    with pytest.raises(TagsPendingError, match="ends at 2025-11-24 09:00:00"):
        tags.require_at(NOON)
    assert not tags.has_changed()

    with (tmp_path / "tags.csv").open("a") as file:
        file.write("2025-11-24T13:00:00Z,1100\n")
    assert tags.has_changed()
    with pytest.raises(DataError, match="no line in the hour before") as caught:
        tags.require_at(NOON)
    assert not isinstance(caught.value, TagsPendingError)
