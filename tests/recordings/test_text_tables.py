"""Text tables of every dialect are read, and what is not a number is named."""

import gzip
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from swashtwin.foundation import DataError
from swashtwin.recordings import (
    ReadOptions,
    Recording,
    inspect_recordings,
    load_recording,
    require_usable,
    write_recording,
)
from swashtwin.recordings.formats import csv

TABLES = {
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


@pytest.mark.parametrize("text", TABLES.values(), ids=TABLES.keys())
@pytest.mark.parametrize("suffix", ["csv", "dat.gz"])
def test_every_dialect_of_a_text_table_is_read(text: str, suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{suffix}"
    path.write_bytes(gzip.compress(text.encode()) if suffix.endswith("gz") else text.encode())
    loaded = load_recording(path, sample_rate=100, unit="1")
    np.testing.assert_allclose(loaded.signal, [[1.5, -0.3], [2, 4]])
    assert loaded.channels == ("a", "b")
    assert loaded.recording_id == "a"


def test_a_told_dialect_is_obeyed(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("1 2\n7,5\n8,5\n")
    loaded = load_recording(
        tmp_path / "a.txt", sample_rate=1, unit="1", decimal=",", header_lines=1
    )
    np.testing.assert_array_equal(loaded.signal, [[7.5, 8.5]])


@pytest.mark.parametrize("encoding", ["utf-16", "cp1252", "utf-8-sig"])
@pytest.mark.parametrize("line", ["\n", "\r\n"])
def test_text_of_another_encoding_is_read(tmp_path: Path, encoding: str, line: str) -> None:
    text = line.join(("Zeit [s];Gehäuse [m/s²]", "0;1", "0,1;2", "0,2;3", ""))
    (tmp_path / "a.csv").write_bytes(text.encode(encoding))
    loaded = load_recording(tmp_path / "a.csv")
    assert (loaded.channels, loaded.unit, loaded.sample_rate) == (("Gehäuse",), "m/s^2", 10.0)


def test_a_coarsely_rounded_time_column_is_uniform(tmp_path: Path) -> None:
    time = np.round(np.arange(2000) / 25600, 4)
    rows = "\n".join(f"{t:.4f};{x}" for t, x in zip(time, range(2000), strict=True))
    (tmp_path / "a.csv").write_text("time;x [g]\n" + rows + "\n")
    loaded = load_recording(tmp_path / "a.csv")
    assert loaded.sample_rate == 25600.0
    assert "time_gaps" not in loaded.attributes


def test_a_gap_in_the_time_column_is_remembered(tmp_path: Path) -> None:
    time = np.arange(100) * 0.01
    time[60:] += 0.5
    rows = "\n".join(f"{t:.2f},{x}" for t, x in zip(time, range(100), strict=True))
    (tmp_path / "a.csv").write_text("t,x\n" + rows + "\n")
    loaded = load_recording(tmp_path / "a.csv", unit="1")
    assert loaded.sample_rate == 100.0
    assert (
        loaded.attributes["time_gaps"]
        == "1 of 99 steps differ from the usual 0.01 s; the worst is 0.51 s at 0.59 s"
    )
    with pytest.raises(DataError, match="1 of 99 steps differ"):
        require_usable(loaded)


def test_a_blank_field_is_nan(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("a,b\n1.5,2\n,3\n2.5,NaN\n")
    loaded = load_recording(tmp_path / "a.csv", sample_rate=1, unit="1")
    assert np.isnan(loaded.signal).tolist() == [[False, True, False], [False, False, True]]


def rows_of(pattern: str, count: int = 60, step: float = 0.005) -> str:
    """Rows with a time stamp every 5 ms from 8 o'clock on."""
    start = datetime(2019, 9, 11, 8)
    moments = (start + timedelta(seconds=step * number) for number in range(count))
    return "".join(
        moment.strftime(
            pattern.replace("%ms", f"{moment.microsecond // 1000:03d}").replace("%n", str(number))
        )
        for number, moment in enumerate(moments)
    )


STAMPS = {
    "ISO": "t,x\n" + rows_of("%Y-%m-%d %H:%M:%S.%ms,%n\n"),
    "ISO with T and zone": "t,x\n" + rows_of("%Y-%m-%dT%H:%M:%S.%msZ,%n\n"),
    "ISO and a status word": "t,x,status\n" + rows_of("%Y-%m-%d %H:%M:%S.%ms,%n,OK\n"),
    "European": "Zeit;x\n" + rows_of("%d.%m.%Y %H:%M:%S,%ms;%n,0\n"),
    "slashes": "when;x\n" + rows_of("%d/%m/%Y %H:%M:%S.%ms;%n\n"),
    "American": "when;x\n" + rows_of("%m/%d/%Y %I:%M:%S.%ms AM;%n\n"),
    "time of the day": "Uhrzeit\tx\n" + rows_of("%H:%M:%S.%ms\t%n\n"),
    "date behind the time": "Time   \tx\t\n" + rows_of("%H:%M:%S.%ms %d-%m-%Y\t %n\n"),
    "two columns": "Date;Time;x\n" + rows_of("%d.%m.%Y;%H:%M:%S.%ms;%n\n"),
    "blanks, no header": rows_of("%Y-%m-%d %H:%M:%S.%ms %n\n"),
}


@pytest.mark.parametrize("text", STAMPS.values(), ids=STAMPS.keys())
def test_time_stamps_give_the_rate(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(text)
    loaded = load_recording(tmp_path / "a.csv", unit="1")
    assert loaded.sample_rate == 200.0
    np.testing.assert_array_equal(loaded.signal, [np.arange(60)])


def test_dates_of_two_orders_are_refused(tmp_path: Path) -> None:
    lines = rows_of("%m/%d/%Y %H:%M:%S.%ms,%n\n") + rows_of("09/25/2019 %H:%M:%S.%ms,%n\n")
    (tmp_path / "a.csv").write_text("t,x\n" + lines)
    assert (
        csv.read(tmp_path / "a.csv", ReadOptions())
        .attributes["date"]
        .startswith("2019-09-11T08:00")
    )
    (tmp_path / "a.csv").write_text("t,x\n" + lines + rows_of("25/09/2019 %H:%M:%S.%ms,%n\n"))
    with pytest.raises(DataError, match="no one order of day, month and year"):
        csv.read(tmp_path / "a.csv", ReadOptions())


def test_a_blank_first_stamp_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,x\n,0\n" + rows_of("%Y-%m-%d %H:%M:%S.%ms,%n\n"))
    with pytest.raises(DataError, match="has no time at its first sample"):
        csv.read(tmp_path / "a.csv", ReadOptions())


def test_time_stamps_run_over_midnight(tmp_path: Path) -> None:
    seconds = [86_399.0 + number / 100 for number in range(300)]
    clocks = [
        f"{int(s // 3600) % 24:02d}:{int(s // 60) % 60:02d}:{s % 60:05.2f};{s}\n" for s in seconds
    ]
    (tmp_path / "a.csv").write_text("t;x\n" + "".join(clocks))
    loaded = load_recording(tmp_path / "a.csv", unit="1")
    assert (loaded.sample_rate, loaded.attributes.get("time_gaps")) == (100.0, None)


def test_time_stamps_too_coarse_to_tell_the_rate_state_none(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,x\n" + rows_of("%Y-%m-%d %H:%M:%S,%n\n", 640, 1 / 256))
    with pytest.raises(DataError, match="does not state its sample rate"):
        load_recording(tmp_path / "a.csv", unit="1")
    assert load_recording(tmp_path / "a.csv", unit="1", sample_rate=256).n_samples == 640


@pytest.mark.parametrize("empty", [0, 18, 59])
def test_a_column_of_words_is_named_and_left_out(empty: int, tmp_path: Path) -> None:
    words = ["" if number < empty else "ALARM" for number in range(60)]
    rows = "".join(f"{n},{n}.5,{n * n},{word}\n" for n, word in enumerate(words))
    (tmp_path / "a.csv").write_text(f"count,x,y,status\n{rows}")
    loaded = load_recording(tmp_path / "a.csv", sample_rate=100, unit="1")
    np.testing.assert_array_equal(loaded.signal, [np.arange(60) + 0.5, np.arange(60) ** 2])
    notes = [
        finding.message
        for finding in inspect_recordings([loaded]).recordings[0].findings
        if finding.kind == "left_out"
    ]
    assert notes == [
        "columns of text or dates were skipped: status.",
        "columns that count the samples were skipped: count.",
    ]


def test_a_word_that_appears_late_in_a_blank_column_loses_no_row(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x;y;note\n" + "1;2;\n" * 2000 + "3;4;stopped\n")
    loaded = load_recording(tmp_path / "a.csv", sample_rate=100, unit="1")
    assert (loaded.n_samples, loaded.attributes["text_columns"]) == (2001, "note")


def test_rows_without_a_value_at_the_end_are_left_out_and_others_are_nan(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x;y\n1;2\n;\n3;\n;\n;\n\n")
    loaded = load_recording(tmp_path / "a.csv", sample_rate=100, unit="1")
    np.testing.assert_array_equal(loaded.signal, [[1, np.nan, 3], [2, np.nan, np.nan]])


def test_units_stand_in_a_second_line_of_headings(tmp_path: Path) -> None:
    rows = "".join(f"{n / 100};{n};OK\n".replace(".", ",") for n in range(9))
    (tmp_path / "a.csv").write_text(
        "Drehzahl;1500 1/min\nDruck;120 bar\nZeit;Gehäuse;Status\ns;m/s²;-\n" + rows
    )
    loaded = load_recording(tmp_path / "a.csv")
    assert (loaded.channels, loaded.unit, loaded.sample_rate) == (("Gehäuse",), "m/s^2", 100.0)


def test_numbered_columns_are_headings_and_no_samples(tmp_path: Path) -> None:
    for head in ("time,1,2", "0,1,2"):
        (tmp_path / "a.csv").write_text(
            f"{head}\n" + "".join(f"{n / 10},{n}.5,{n}\n" for n in range(9))
        )
        assert load_recording(tmp_path / "a.csv", sample_rate=10, unit="1").n_samples == 9


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "x,y\n" + "1.5,2\n" * 17 + "1.5,overload\n" + "1.5,2\n" * 60,
            "line 19: 'overload' in column 'y'",
        ),
        (
            "x,y\noverload,2\n" + "1.5,2\n" * 60,
            "line 2: 'overload' in column 'x' is not a number; correct it.",
        ),
        ("x\n" + "1.5\n" * 9 + "overload\n" + "1.5\n" * 60, "line 11: 'overload'"),
        ("x,y\n1.5\n" + "1.5,2\n" * 60, "line 2 has 1 columns, not 2"),
        ("3,14\n2,72\n", "may be two columns or one decimal comma"),
        ("x;y\n1,234;2\n1,500;3\n", "'1,234' may be 1234, or 1.234"),
        ("x;y\n1.234,5;2\n-1.500,5;3\n", "'1.234,5' has marks for thousands"),
        ("x;y\n" + "1,25;2\n" * 60 + "1.25;2\n", "line 62: '1.25' in column 'x'"),
        (
            "x;y\n" + "1,25;2\n" * 60 + "1 025;2\n",
            "line 62: '1 025' in column 'x' has marks for thousands",
        ),
        (
            "t;x\n" + rows_of("%H:%M:%S.%ms;%n\n") + "later;7\n",
            "line 62: 'later' in column 't' is not a time stamp",
        ),
        ("Pump 3 runs\nPump 4 runs well\nmeasured, on Friday 3\n", "no table of numbers"),
    ],
)
def test_no_row_is_lost_in_silence(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(DataError, match=message):
        load_recording(tmp_path / "a.csv", sample_rate=1, unit="1")


def test_a_bomb_and_an_endless_line_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(csv, "_UNLIMITED_TEXT_BYTES", 1 << 16)
    (tmp_path / "a.csv.gz").write_bytes(gzip.compress(b"x\n" + b"0\n" * (1 << 18)))
    with pytest.raises(DataError, match="unpacks to more than 300 times its size"):
        csv.read(tmp_path / "a.csv.gz", ReadOptions())
    monkeypatch.setattr(csv, "_MAX_HEAD_BYTES", 1 << 10)
    (tmp_path / "a.csv").write_text("1" * (1 << 13))
    with pytest.raises(DataError, match="has a line of more than"):
        csv.read(tmp_path / "a.csv", ReadOptions())


def test_a_name_like_a_formula_is_no_formula_in_the_file(tmp_path: Path) -> None:
    recording = Recording(
        np.array([[1.0, 2.0, 3.0]]), 10.0, "a", channels=("=HYPERLINK(1)",), unit="1"
    )
    path = write_recording(recording, tmp_path / "a.csv")
    assert "'=HYPERLINK(1) [1]" in path.read_text()
    assert load_recording(path, unit="1").channels == ("=HYPERLINK(1)",)


@pytest.mark.parametrize(
    "tail", ["\n\n\n", ",,\n,,\n", ",,\n\n,,\n", "\n,,\n\n\n,,\n\n", "\r\n,,\r\n"]
)
def test_an_empty_tail_of_any_kind_ends_a_table(tail: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(
        ("time,x,y\n" + "".join(f"{n / 1000},{n}.5,2.5\n" for n in range(50)) + tail).encode()
    )
    assert load_recording(path, unit="g").n_samples == 50
