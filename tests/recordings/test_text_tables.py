"""Text tables of every dialect are read, and what is not a number is named."""

import gzip
from pathlib import Path

import numpy as np
import pytest

from swashtwin.foundation import DataError
from swashtwin.recordings import load_recording

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
    loaded = load_recording(tmp_path / "a.txt", sample_rate=1, unit="1", decimal=",", header_lines=1)
    np.testing.assert_array_equal(loaded.signal, [[7.5, 8.5]])


@pytest.mark.parametrize("encoding", ["utf-16", "latin-1", "utf-8-sig"])
def test_text_of_another_encoding_is_read(tmp_path: Path, encoding: str) -> None:
    (tmp_path / "a.csv").write_bytes("Zeit [s];Gehäuse [m/s²]\n0;1\n0,1;2\n0,2;3\n".encode(encoding))
    loaded = load_recording(tmp_path / "a.csv")
    assert (loaded.channels, loaded.unit, loaded.sample_rate) == (("Gehäuse",), "m/s^2", 10.0)


def test_a_number_with_a_comma_is_not_guessed_to_be_two_columns(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("3,14\n2,72\n")
    with pytest.raises(DataError, match="decimal comma"):
        load_recording(tmp_path / "a.csv", sample_rate=1, unit="1")


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
    assert loaded.attributes["time_gaps"] == "1 of 99 steps differ from the usual 0.01 s; the worst is 0.51 s at 0.59 s"


def test_a_short_row_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("a,b\n" + "1.5,2\n" * 100 + "1.5\n")
    with pytest.raises(DataError, match="line 102 has 1 columns, not 2"):
        load_recording(tmp_path / "a.csv", sample_rate=1, unit="1")


def test_a_word_among_the_numbers_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("a,b\n" + "1.5,2\n" * 100 + "1.5,overload\n")
    with pytest.raises(DataError, match="overload"):
        load_recording(tmp_path / "a.csv", sample_rate=1, unit="1")


def test_a_blank_field_is_nan(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("a,b\n1.5,2\n,3\n2.5,NaN\n")
    loaded = load_recording(tmp_path / "a.csv", sample_rate=1, unit="1")
    assert np.isnan(loaded.signal).tolist() == [[False, True, False], [False, False, True]]
