"""Text tables of every dialect are read, and what is not a number is named."""

import gzip
import re
from collections.abc import Iterable
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swashtwin.foundation import DataError, InputError, resumable_folders
from swashtwin.recordings import (
    ReadOptions,
    Recording,
    inspect_recordings,
    load_recording,
    require_usable,
    write_recording,
)
from swashtwin.recordings.formats import column_store, csv, text_blocks


def table_text(heading: str, *columns: Iterable[Any]) -> str:
    """Return a table with commas between its columns."""
    lines = [heading, *(",".join(map(str, row)) for row in zip(*columns, strict=True))]
    return "\n".join(lines) + "\n"


# ---- dialects

# The same two channels, as programs and countries write them.
DIALECTS = {
    "comma": "a,b\n1.5,2\n-3e-1,4\n",
    "semicolon and decimal comma": "a;b\n1,5;2\n-3e-1;4\n",
    "tab": "a\tb\n1.5\t2\n-0.3\t4\n",
    "blanks": "a b\n  1.5   2\n -0.3  4\n",
    "header block": "Recorder 7\nDate; 2026-04-10\n\na;b\n1,5;2\n-0,3;4\n",
    "trailing separator": "a;b;\n1.5;2;\n-0.3;4;\n",
    "windows line ends": "a,b\r\n1.5,2\r\n-0.3,4\r\n",
    "padded fields": "a , b\n 1.5, 2\n-0.3, 4\n",
    "comment mark": "# a,b\n1.5,2\n-0.3,4\n",
    "quoted names": '"a";"b"\n1.5;2\n-0.3;4\n',
}


def assert_dialect_read(path: Path) -> None:
    loaded = load_recording(path, sample_rate=100, unit="1")

    np.testing.assert_allclose(loaded.signal, [[1.5, -0.3], [2, 4]])
    assert loaded.channels == ("a", "b")
    assert loaded.recording_id == "a"


@pytest.mark.parametrize("text", DIALECTS.values(), ids=DIALECTS.keys())
def test_every_dialect_of_a_text_table_is_read(text: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(text.encode())

    assert_dialect_read(path)


@pytest.mark.parametrize("text", DIALECTS.values(), ids=DIALECTS.keys())
def test_every_dialect_of_a_compressed_text_table_is_read(text: str, tmp_path: Path) -> None:
    path = tmp_path / "a.dat.gz"
    path.write_bytes(gzip.compress(text.encode()))

    assert_dialect_read(path)


def test_a_specified_dialect_is_used_in_place_of_the_detected_one(tmp_path: Path) -> None:
    # The rows alone would be two columns.
    path = tmp_path / "a.txt"
    path.write_text("1 2\n7,5\n8,5\n")

    loaded = load_recording(path, sample_rate=1, unit="1", decimal=",", header_lines=1)

    np.testing.assert_array_equal(loaded.signal, [[7.5, 8.5]])


# Excel writes UTF-16 as "Unicode text", CP1252 as CSV, and UTF-8 with a byte order mark.
@pytest.mark.parametrize("encoding", ["utf-16", "cp1252", "utf-8-sig"])
@pytest.mark.parametrize("line_end", ["\n", "\r\n"], ids=["unix", "windows"])
def test_text_of_another_encoding_is_read(tmp_path: Path, encoding: str, line_end: str) -> None:
    text = line_end.join(["Zeit [s];Gehäuse [m/s²]", "0;1", "0,1;2", "0,2;3", ""])
    (tmp_path / "a.csv").write_bytes(text.encode(encoding))

    loaded = load_recording(tmp_path / "a.csv")

    assert loaded.channels == ("Gehäuse",)
    assert loaded.unit == "m/s^2"
    assert loaded.sample_rate == 10.0


@pytest.mark.parametrize("name", ["a.csv", "a.csv.gz"])
def test_a_text_that_ends_within_a_character_or_block_is_damaged(name: str, tmp_path: Path) -> None:
    text = "Zeit [s];x [m/s²]\n" + "".join(f"{k},0;1\n" for k in range(50))
    content = text.encode("utf-16")
    if name.endswith(".gz"):
        content = gzip.compress(content)
    (tmp_path / name).write_bytes(content[:-1])

    with pytest.raises(DataError, match=rf"{name} is damaged, cut off, or not a"):
        load_recording(tmp_path / name)


# ---- time columns


def test_a_coarsely_rounded_time_column_is_uniform(tmp_path: Path) -> None:
    # Steps of 39 us, rounded to 0.1 ms, are mostly 0 or 0.1 ms.
    times = [f"{time:.4f}" for time in np.arange(2000) / 25600]
    (tmp_path / "a.csv").write_text(table_text("time,x [g]", times, range(2000)).replace(",", ";"))

    loaded = load_recording(tmp_path / "a.csv")

    assert loaded.sample_rate == 25600.0
    assert "time_gaps" not in loaded.attributes


def test_a_gap_in_the_time_column_makes_a_recording_unusable(tmp_path: Path) -> None:
    time = np.arange(100) * 0.01
    time[60:] += 0.5
    times = [f"{moment:.2f}" for moment in time]
    (tmp_path / "a.csv").write_text(table_text("t,x", times, range(100)))

    loaded = load_recording(tmp_path / "a.csv", unit="1")

    assert loaded.sample_rate == 100.0
    expected = "1 of 99 steps differ from the usual 0.01 s; the worst is 0.51 s at 0.59 s"
    assert loaded.attributes["time_gaps"] == expected
    with pytest.raises(DataError, match="1 of 99 steps differ"):
        require_usable(loaded)


def stamped_rows(pattern: str, count: int = 60, step: float = 0.005) -> str:
    """Return rows with a time stamp every `step` seconds from 8 o'clock on.

    In `pattern`, a format of `datetime.strftime`, ``%ms`` are the milliseconds and ``%n`` is the
    number of the row.
    """
    start = datetime(2019, 9, 11, 8)
    rows = []
    for number in range(count):
        moment = start + timedelta(seconds=step * number)
        milliseconds = f"{moment.microsecond // 1000:03d}"
        row_pattern = pattern.replace("%ms", milliseconds).replace("%n", str(number))
        rows.append(moment.strftime(row_pattern))
    return "".join(rows)


ISO_ROWS = stamped_rows("%Y-%m-%d %H:%M:%S.%ms,%n\n")
STAMPED_TABLES = {
    "ISO": "t,x\n" + ISO_ROWS,
    "ISO with T and zone": "t,x\n" + stamped_rows("%Y-%m-%dT%H:%M:%S.%msZ,%n\n"),
    "ISO and a status word": "t,x,status\n" + stamped_rows("%Y-%m-%d %H:%M:%S.%ms,%n,OK\n"),
    "European": "Zeit;x\n" + stamped_rows("%d.%m.%Y %H:%M:%S,%ms;%n,0\n"),
    "slashes": "when;x\n" + stamped_rows("%d/%m/%Y %H:%M:%S.%ms;%n\n"),
    "American": "when;x\n" + stamped_rows("%m/%d/%Y %I:%M:%S.%ms AM;%n\n"),
    "time of the day": "Uhrzeit\tx\n" + stamped_rows("%H:%M:%S.%ms\t%n\n"),
    "date behind the time": "Time   \tx\t\n" + stamped_rows("%H:%M:%S.%ms %d-%m-%Y\t %n\n"),
    "two columns": "Date;Time;x\n" + stamped_rows("%d.%m.%Y;%H:%M:%S.%ms;%n\n"),
    "blanks, no header": stamped_rows("%Y-%m-%d %H:%M:%S.%ms %n\n"),
}


@pytest.mark.parametrize("text", STAMPED_TABLES.values(), ids=STAMPED_TABLES.keys())
def test_time_stamps_give_the_rate(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(text)

    loaded = load_recording(tmp_path / "a.csv", unit="1")

    assert loaded.sample_rate == 200.0
    np.testing.assert_array_equal(loaded.signal, [np.arange(60)])


# The 11th of September may be the 9th of November; a later 25th decides.
AMERICAN_ROWS = stamped_rows("%m/%d/%Y %H:%M:%S.%ms,%n\n") + stamped_rows(
    "09/25/2019 %H:%M:%S.%ms,%n\n"
)


def test_a_later_date_decides_between_day_and_month(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,x\n" + AMERICAN_ROWS)

    date = csv.read(tmp_path / "a.csv", ReadOptions()).attributes["date"]

    assert date.startswith("2019-09-11T08:00")


def test_dates_of_two_orders_are_refused(tmp_path: Path) -> None:
    european_rows = stamped_rows("25/09/2019 %H:%M:%S.%ms,%n\n")
    (tmp_path / "a.csv").write_text("t,x\n" + AMERICAN_ROWS + european_rows)

    with pytest.raises(DataError, match="no one order of day, month and year"):
        csv.read(tmp_path / "a.csv", ReadOptions())


def test_a_blank_first_time_stamp_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,x\n,0\n" + ISO_ROWS)

    with pytest.raises(DataError, match="has no time at its first sample"):
        csv.read(tmp_path / "a.csv", ReadOptions())


def test_time_stamps_without_a_date_continue_over_midnight(tmp_path: Path) -> None:
    # 300 samples from a second before midnight to two seconds after it
    rows = []
    for number in range(300):
        seconds = 86_399.0 + number / 100
        hour = int(seconds // 3600) % 24
        minute = int(seconds // 60) % 60
        rows.append(f"{hour:02d}:{minute:02d}:{seconds % 60:05.2f};{seconds}\n")
    (tmp_path / "a.csv").write_text("t;x\n" + "".join(rows))

    loaded = load_recording(tmp_path / "a.csv", unit="1")

    assert loaded.sample_rate == 100.0
    assert "time_gaps" not in loaded.attributes


def test_time_stamps_in_whole_seconds_leave_the_rate_to_the_user(tmp_path: Path) -> None:
    # 640 samples at 256 Hz have three different stamps
    rows = stamped_rows("%Y-%m-%d %H:%M:%S,%n\n", 640, 1 / 256)
    (tmp_path / "a.csv").write_text("t,x\n" + rows)

    with pytest.raises(DataError, match="does not state its sample rate"):
        load_recording(tmp_path / "a.csv", unit="1")
    assert load_recording(tmp_path / "a.csv", unit="1", sample_rate=256).n_samples == 640


# ---- headings


def test_a_second_line_of_headings_states_the_units(tmp_path: Path) -> None:
    rows = "".join(f"{number / 100};{number};OK\n".replace(".", ",") for number in range(9))
    (tmp_path / "a.csv").write_text(
        "Drehzahl;1500 1/min\nDruck;120 bar\nZeit;Gehäuse;Status\ns;m/s²;-\n" + rows
    )

    loaded = load_recording(tmp_path / "a.csv")

    assert loaded.channels == ("Gehäuse",)
    assert loaded.unit == "m/s^2"
    assert loaded.sample_rate == 100.0


# pandas writes the numbers of columns without names as headings
@pytest.mark.parametrize("heading", ["time,1,2", "0,1,2"])
def test_numbers_of_columns_are_headings_and_no_samples(heading: str, tmp_path: Path) -> None:
    rows = "".join(f"{number / 10},{number}.5,{number}\n" for number in range(9))
    (tmp_path / "a.csv").write_text(f"{heading}\n{rows}")

    assert load_recording(tmp_path / "a.csv", sample_rate=10, unit="1").n_samples == 9


def test_a_name_like_a_formula_is_escaped_in_a_file_and_restored(tmp_path: Path) -> None:
    # A spreadsheet would follow the link.
    signal = np.array([[1.0, 2.0, 3.0]])
    recording = Recording(signal, 10.0, "a", channels=("=HYPERLINK(1)",), unit="1")

    path = write_recording(recording, tmp_path / "a.csv")

    assert "'=HYPERLINK(1) [1]" in path.read_text()
    assert load_recording(path, unit="1").channels == ("=HYPERLINK(1)",)


# ---- blank fields and words


def test_a_blank_field_is_a_missing_sample(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("a,b\n1.5,2\n,3\n2.5,NaN\n")

    loaded = load_recording(tmp_path / "a.csv", sample_rate=1, unit="1")

    assert np.isnan(loaded.signal).tolist() == [[False, True, False], [False, False, True]]


@pytest.mark.parametrize("text", ["", "N/A", '"--"'])
def test_a_table_of_one_column_may_lack_samples(text: str, tmp_path: Path) -> None:
    numbers = [str(number / 8) for number in range(40)]
    numbers[20] = text
    (tmp_path / "a.csv").write_text("\n".join(["x [g]", *numbers, ""]))

    raw = csv.read(tmp_path / "a.csv", ReadOptions())

    assert np.flatnonzero(np.isnan(raw.columns["x"][0:40])).tolist() == [20]


def test_blank_rows_are_missing_samples_unless_they_end_the_table(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x;y\n1;2\n;\n3;\n;\n;\n\n")

    loaded = load_recording(tmp_path / "a.csv", sample_rate=100, unit="1")

    np.testing.assert_array_equal(loaded.signal, [[1, np.nan, 3], [2, np.nan, np.nan]])


@pytest.mark.parametrize(
    "tail",
    [
        pytest.param("\n\n\n", id="empty lines"),
        pytest.param(",,\n,,\n", id="blank rows"),
        pytest.param(",,\n\n,,\n", id="empty line between blank rows"),
        pytest.param("\n,,\n\n\n,,\n\n", id="blank rows between empty lines"),
        pytest.param("\r\n,,\r\n", id="windows line ends"),
    ],
)
def test_an_empty_tail_of_any_kind_ends_a_table(tail: str, tmp_path: Path) -> None:
    rows = "".join(f"{number / 1000},{number}.5,2.5\n" for number in range(50))
    path = tmp_path / "a.csv"
    path.write_bytes(f"time,x,y\n{rows}{tail}".encode())

    assert load_recording(path, unit="g").n_samples == 50


# An alarm may be on from the start, come up, or come up in the last row alone.
@pytest.mark.parametrize("n_blank_rows", [0, 18, 59])
def test_columns_of_words_and_counters_are_skipped_and_reported(
    n_blank_rows: int, tmp_path: Path
) -> None:
    numbers = np.arange(60)
    status = [""] * n_blank_rows + ["ALARM"] * (60 - n_blank_rows)
    (tmp_path / "a.csv").write_text(
        table_text("count,x,y,status", numbers, numbers + 0.5, numbers**2, status)
    )

    loaded = load_recording(tmp_path / "a.csv", sample_rate=100, unit="1")

    np.testing.assert_array_equal(loaded.signal, [numbers + 0.5, numbers**2])
    findings = inspect_recordings([loaded]).recordings[0].findings
    assert [finding.message for finding in findings if finding.kind == "left_out"] == [
        "columns of text or dates were skipped: status.",
        "columns that count the samples were skipped: count.",
    ]


def test_a_word_that_appears_late_in_a_blank_column_loses_no_row(tmp_path: Path) -> None:
    # The kind of a column is determined by its first rows.
    (tmp_path / "a.csv").write_text("x;y;note\n" + "1;2;\n" * 2000 + "3;4;stopped\n")

    loaded = load_recording(tmp_path / "a.csv", sample_rate=100, unit="1")

    assert loaded.n_samples == 2001
    assert loaded.attributes["text_columns"] == "note"


# ---- refusals

LATER_ROWS = "1.5,2\n" * 60


@pytest.mark.parametrize(
    ("text", "message"),
    [
        pytest.param(
            "x,y\n" + "1.5,2\n" * 17 + "1.5,overload\n" + LATER_ROWS,
            "line 19: 'overload' in column 'y'",
            id="word among numbers",
        ),
        pytest.param(
            "x,y\noverload,2\n" + LATER_ROWS,
            "line 2: 'overload' in column 'x' is not a number; correct it.",
            id="word in the first row",
        ),
        pytest.param(
            "x\n" + "1.5\n" * 9 + "overload\n" + "1.5\n" * 60,
            "line 11: 'overload'",
            id="word in the only column",
        ),
        pytest.param(
            "t;x\n" + stamped_rows("%H:%M:%S.%ms;%n\n") + "later;7\n",
            "line 62: 'later' in column 't' is not a time stamp",
            id="word among time stamps",
        ),
        pytest.param(
            "t;x\n" + stamped_rows("%H:%M:%S.%ms;%n\n") + "12:00:01.000 late;7\n",
            "line 62: '12:00:01.000 late' in column 't' is not a time stamp",
            id="text behind a time stamp",
        ),
        pytest.param(
            "x,y\n" + LATER_ROWS + '"1.5"\n', "line 62 has 1 columns, not 2", id="short quoted row"
        ),
        pytest.param(
            "x;y\n" + "1,25;2\n" * 60 + "1.25;2\n",
            "line 62: '1.25' in column 'x'",
            id="point after commas",
        ),
        pytest.param(
            "x,y\n1.5\n" + LATER_ROWS, "line 2 has 1 columns, not 2", id="short first row"
        ),
    ],
)
def test_a_row_that_does_not_fit_the_others_is_refused_by_its_line(
    text: str, message: str, tmp_path: Path
) -> None:
    (tmp_path / "a.csv").write_text(text)

    with pytest.raises(DataError, match=message):
        load_recording(tmp_path / "a.csv", sample_rate=1, unit="1")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        pytest.param("3,14\n2,72\n", "may be two columns or one decimal comma", id="comma alone"),
        pytest.param(
            "x;y\n1,234;2\n1,500;3\n",
            "'1,234' may be 1234, or 1.234",
            id="three digits behind each comma",
        ),
        pytest.param(
            "x;y\n1.234,5;2\n-1.500,5;3\n",
            "'1.234,5' has marks for thousands",
            id="points for thousands",
        ),
        pytest.param(
            "x;y\n" + "1,25;2\n" * 60 + "1 025;2\n",
            "line 62: '1 025' in column 'x' has marks for thousands",
            id="blank for thousands",
        ),
    ],
)
def test_numbers_that_may_be_read_in_two_ways_are_refused(
    text: str, message: str, tmp_path: Path
) -> None:
    (tmp_path / "a.csv").write_text(text)

    with pytest.raises(DataError, match=message):
        load_recording(tmp_path / "a.csv", sample_rate=1, unit="1")


def test_marks_for_thousands_are_refused_with_a_specified_decimal_mark(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x;y\n" + "1.5;1,294.25\n" * 60)

    with pytest.raises(DataError, match=r"'1,294\.25' has marks for thousands"):
        load_recording(tmp_path / "a.csv", sample_rate=1, unit="1", decimal=".")


NUMBERS_WITH_DECORATION = [
    pytest.param("t,x,y", "{0},[{1}],[{1}]", "'[0.25]'", id="brackets"),
    pytest.param("t,x,y", "{0},({1}),{0}", "'(0.25)'", id="parentheses in one column"),
    pytest.param("t;x", "{0};{1}g", "'0.25g'", id="unit without a blank"),
    pytest.param("t,x", "{0},{1} m/s²", "'0.25 m/s²'", id="unit of SI"),
    pytest.param("Values", "x={1};y={0}", "'x=0.25'", id="name and number"),
    pytest.param("Values", "[{1}, {0}]", "'[0.25'", id="list"),
    pytest.param("t,x", "{0},{1} [mV]", "'0.25 [mV]'", id="unit in brackets"),
]


@pytest.mark.parametrize(("heading", "row", "value"), NUMBERS_WITH_DECORATION)
def test_numbers_with_units_or_brackets_in_cells_are_refused_by_value_and_line(
    heading: str, row: str, value: str, tmp_path: Path
) -> None:
    rows = [row.format(number / 100, number + 0.25) for number in range(60)]
    (tmp_path / "a.csv").write_text("\n".join([heading, *rows]))

    message = f"line 2: {re.escape(value)} is a number with a unit, a name or brackets"
    with pytest.raises(DataError, match=message):
        load_recording(tmp_path / "a.csv", sample_rate=100, unit="g")


TEXTS_BESIDE_SIGNALS = [
    pytest.param("Battery", "{1:.3f} V", id="voltage of a battery"),
    pytest.param("Battery", "3.6{0} V", id="voltage of a battery with more digits"),
    pytest.param("frame", "[{0}]", id="number of a frame"),
    pytest.param("id", "A{0}:0", id="identifier"),
    pytest.param("temp", "{1:.2f} °C", id="temperature"),
    pytest.param("node", "k={0}", id="name and number"),
    pytest.param("Gewicht", "{0}.5 g", id="weight"),
    pytest.param("supply", "({1:.2f} mV)", id="supply in parentheses"),
]


@pytest.mark.parametrize("signals", ["acc_x [g]", "CH1", "X;Y"])
@pytest.mark.parametrize(("heading", "text"), TEXTS_BESIDE_SIGNALS)
def test_texts_with_numbers_beside_signals_are_left_out(
    heading: str, text: str, signals: str, tmp_path: Path
) -> None:
    names = signals.split(";")
    rng = np.random.default_rng(11)
    rows = []
    for number, samples in enumerate(rng.standard_normal((60, len(names)))):
        fields = [f"{number / 100:.2f}", *(f"{sample:.5f}" for sample in samples)]
        rows.append(",".join([*fields, text.format(number, 3 + number / 100)]))
    heading_line = ",".join(["time_s", *names, heading])
    (tmp_path / "a.csv").write_text("\n".join([heading_line, *rows]))

    recording = load_recording(tmp_path / "a.csv", unit="g")

    assert len(recording.channels) == len(names)
    assert recording.attributes["text_columns"] == heading


@pytest.mark.parametrize(
    ("names", "decorated"),
    [
        (("acc_x", "acc_y"), "[{0:.4f}]"),
        (("CH1", "CH2"), "{0:.4f} mV"),
        (("X", "Motor"), "{0:.4f} m/s²"),
        (("temp", "Motor"), "({0:.4f})"),
        (("index", "Motor"), "'{0:.4f}'"),
    ],
)
def test_a_signal_in_brackets_beside_another_column_is_asked_about(
    names: tuple[str, str], decorated: str, tmp_path: Path
) -> None:
    samples = np.random.default_rng(12).standard_normal((60, 2))
    if names[0] == "index":
        samples[:, 0] = np.arange(60)
    rows = [f"{first:.4f},{decorated.format(second)}" for first, second in samples]
    (tmp_path / "a.csv").write_text("\n".join([",".join(names), *rows]))
    options = {"sample_rate": 100, "unit": "g"}

    with pytest.raises(DataError, match=r"is a number with a unit, .* Export") as caught:
        load_recording(tmp_path / "a.csv", **options)
    assert caught.value.field == "channels"

    selected = load_recording(tmp_path / "a.csv", channels=(names[0],), **options)
    assert selected.channels == names[:1]


@pytest.mark.parametrize("text", ["12 V", "23.{0} °C", "P{0}"])
def test_texts_with_numbers_that_are_no_samples_are_left_out(text: str, tmp_path: Path) -> None:
    rows = [f"{number / 7:.3f},{text.format(number)}" for number in range(60)]
    (tmp_path / "a.csv").write_text("\n".join(["x,remark", *rows]))

    recording = load_recording(tmp_path / "a.csv", sample_rate=100, unit="g")

    assert recording.attributes["text_columns"] == "remark"


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        pytest.param(
            "Zeit;X;Y;Z\n" + "".join(f"{row / 100:.2f}\n" for row in range(40)),
            {},
            r"the rows hold 1 of 4 columns, only the times \(Zeit; no X, Y, Z\)",
            id="no other separator",
        ),
        pytest.param(
            "time (ms)|ax|ay\n" + "".join(f"{row}\n" for row in range(40)),
            {"header_lines": 1},
            "the rows hold 1 of 3 columns, only the times",
            id="specified header",
        ),
        pytest.param(
            "Zeit;Nr;X;Y\n" + "".join(f"0,{row}\n" for row in range(40)),
            {"separator": ","},
            r"the rows hold 2 of 4 columns \(Zeit; no X, Y\)",
            id="separator of the decimals",
        ),
        pytest.param(
            "Timestamp,X,Y\n" + "".join(f"2026-03-02 09:14:{row:02}\n" for row in range(40)),
            {},
            "holds times only .such as 2026-03-02 09:14:39.",
            id="time stamps",
        ),
        pytest.param(
            "Zeit, s\n" + "".join(f"{row / 100:.2f}\n" for row in range(40)),
            {},
            "holds times only .Zeit, s.",
            id="unit behind a comma",
        ),
    ],
)
def test_rows_that_hold_only_the_times_are_refused(
    text: str, options: dict[str, Any], message: str, tmp_path: Path
) -> None:
    (tmp_path / "a.csv").write_text(text)

    with pytest.raises(DataError, match=message):
        load_recording(tmp_path / "a.csv", sample_rate=100, unit="g", **options)


def test_one_column_may_have_a_heading_with_a_comma(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("acceleration,z\n0.5\n-1.5\n0.25\n")

    assert load_recording(tmp_path / "a.csv", sample_rate=100, unit="g").n_samples == 3


def test_a_text_without_a_table_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("Pump 3 runs\nPump 4 runs well\nmeasured, on Friday 3\n")

    with pytest.raises(DataError, match="no table of numbers"):
        load_recording(tmp_path / "a.csv", sample_rate=1, unit="1")


def test_a_compressed_file_that_unpacks_to_much_more_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(text_blocks, "_UNLIMITED_TEXT_BYTES", 1 << 16)
    (tmp_path / "a.csv.gz").write_bytes(gzip.compress(b"x\n" + b"0\n" * (1 << 18)))

    with pytest.raises(DataError, match="unpacks to more than 300 times its size"):
        csv.read(tmp_path / "a.csv.gz", ReadOptions())


def test_a_file_of_one_endless_line_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(text_blocks, "MAX_LINE_BYTES", 1 << 10)
    (tmp_path / "a.csv").write_text("1" * (1 << 13))

    with pytest.raises(DataError, match="has a line of more than"):
        csv.read(tmp_path / "a.csv", ReadOptions())


# ---- in blocks

CASES = Path(__file__).parent / "cases"

BLOCK_TEXTS = {
    "carriage returns": "t,x\r" + "".join(f"{k / 100},{k % 7}\r" for k in range(40)),
    "two carriage returns": "t,x\r\r\n" + "".join(f"{k / 100},{k % 7}\r\r\n" for k in range(40)),
    "blank rows at the end": "x;y\n1;2\n;\n3;4\n" + ";\n" * 60,
    "repeated header": ("x,y\n" + "1,2\n3,4\n" * 20 + "\n") * 3,
    "time stamps": "t,x\n" + "".join(f"2026-04-10 23:59:{k:02},{k}\n" for k in range(60)),
    "missing time stamp": "t,x\n" + "".join(f"12:00:{k:02},{k}\n" for k in range(30)) + ",1\n",
    "text in a blank column": "x;y;note\n" + "1;2;\n" * 60 + "3;4;stopped\n",
    "damaged row": "x,y\n" + "1,2\n" * 60 + "1\n" + "3,4\n",
    "UTF-16": "\ufeffx;µ\n" + "1,5;−2\n" * 60,
}


@pytest.mark.parametrize(
    "content",
    [
        *[
            pytest.param(text.encode("utf-16" if name == "UTF-16" else "utf-8"), id=name)
            for name, text in BLOCK_TEXTS.items()
        ],
        *[
            pytest.param(path.read_bytes(), id=path.name)
            for path in sorted(CASES.iterdir())
            if path.suffix in (".csv", ".txt", ".lvm", ".dat")
        ],
    ],
)
def test_blocks_of_a_text_and_numbers_in_a_file_do_not_change_the_table(
    content: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(content)
    whole = outcome_of_reading(path)

    # Longer than the beginning that shows a binary file, unless the file is short.
    block_bytes = min(4096, max(16, len(content) // 5))
    monkeypatch.setattr(text_blocks, "_BLOCK_BYTES", block_bytes)
    monkeypatch.setattr(text_blocks, "_FIRST_BLOCK_BYTES", block_bytes)
    monkeypatch.setattr(column_store, "_MAX_BYTES_IN_MEMORY", 64)

    assert outcome_of_reading(path) == whole


def outcome_of_reading(path: Path) -> tuple[Any, ...]:
    """Return the content of a file, or the text of the error, that can be compared."""
    try:
        raw = csv.read(path, ReadOptions())
    except DataError as error:
        return (str(error),)
    samples = {name: np.asarray(column[:]).tobytes() for name, column in raw.columns.items()}
    return (samples, raw.sample_rate, raw.units, raw.attributes, raw.breaks)


def test_numbers_without_space_for_their_temporary_file_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.csv").write_text("x,y\n" + "1,2\n" * 60)
    monkeypatch.setattr(column_store, "_MAX_BYTES_IN_MEMORY", 64)
    monkeypatch.setattr(resumable_folders, "_DISK_RESERVE_BYTES", 1 << 60)

    with pytest.raises(InputError, match=r"a\.csv: its numbers do not fit .*TMPDIR"):
        csv.read(tmp_path / "a.csv", ReadOptions())


def test_a_part_of_a_column_in_a_file_is_read_without_the_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(column_store, "_MAX_BYTES_IN_MEMORY", 0)
    store = column_store.ColumnStore(tmp_path / "a.csv", [0, 3])
    for first in (0, 4, 5):
        rows = np.arange(float(first), first + 4 if first == 0 else first + 1)
        store.append({0: rows, 3: -rows}, len(rows))

    column = store.column(3)

    assert len(column) == 6
    assert column[3:6].tolist() == [-3, -4, -5]
    assert column[1:6:2].tolist() == [-1, -3, -5]
    assert column[6:9].tolist() == []


def test_a_text_larger_than_memory_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = "".join(f"{k / 1000:.3f},{k % 7}\n" for k in range(20_000))
    (tmp_path / "a.csv").write_text("t [s],x [g]\n" + rows)
    monkeypatch.setenv("SWASHTWIN_MEMORY_GB", "0.0001")

    recording = load_recording(tmp_path / "a.csv")

    assert recording.slice(0, 8).signal[0, 6] == pytest.approx(6 * 9.80665)
