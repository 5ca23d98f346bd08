"""A file that is missing, empty, cut off or of another kind is refused in one line."""

import gzip
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recording_files import READABLE, read_back, some_recording, written

from swashtwin.foundation import DataError, InputError, MissingFileError, SwashTwinError
from swashtwin.recordings import Recording, load_recording, load_recordings, write_index, write_recording


@pytest.fixture
def recording() -> Recording:
    return some_recording()


@pytest.mark.parametrize("suffix", READABLE)
def test_a_missing_an_empty_and_a_cut_file_are_refused(recording: Recording, suffix: str, tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="does not exist"):
        load_recording(tmp_path / f"a.{suffix}")
    (tmp_path / f"a.{suffix}").touch()
    with pytest.raises(DataError, match="empty"):
        load_recording(tmp_path / f"a.{suffix}")
    path = written(recording, tmp_path, suffix)
    content = path.read_bytes()
    length = 2 * len(content) // 3
    length += content[length:].index(b",") if suffix == "csv" else 0  # a row of text must be torn to be seen
    path.write_bytes(content[:length])
    with pytest.raises(DataError, match=r"cut off|damaged|no time response"):
        read_back(path)


def test_a_cut_gzip_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv.gz").write_bytes(gzip.compress(b"a,b\n" + b"1.5,2.5\n" * 500)[:-20])
    with pytest.raises(DataError, match="cut off"):
        load_recording(tmp_path / "a.csv.gz", sample_rate=1, unit="1")


def test_an_index_sees_a_text_file_cut_between_two_rows(recording: Recording, tmp_path: Path) -> None:
    path = write_recording(recording, tmp_path / "a.csv")
    write_index([recording], [path], tmp_path)
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:-100]))
    with pytest.raises(DataError, match="not the file that was indexed"):
        load_recordings(tmp_path)


def test_an_unknown_suffix_offers_the_supported(tmp_path: Path, recording: Recording) -> None:
    (tmp_path / "a.xlsx").write_text("x")
    with pytest.raises(DataError, match=r"'.xlsx' cannot be read; supported are .csv"):
        load_recording(tmp_path / "a.xlsx")
    with pytest.raises(InputError, match=r"'.uff' cannot be written; supported are .h5"):
        write_recording(recording, tmp_path / "a.uff")


def test_binary_rubbish_called_csv_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(bytes(range(256)) * 10)
    with pytest.raises(DataError, match="binary"):
        load_recording(tmp_path / "a.csv")


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # pyuff leaves damaged files open
@pytest.mark.parametrize("suffix", ["h5", "mat", "wav", "tdms", "uff", "parquet", "npz", "mf4"])
def test_no_truncation_of_a_binary_file_goes_unseen(recording: Recording, suffix: str, tmp_path: Path) -> None:
    short = replace(recording, signal=recording.signal[:, :60])
    path = written(short, tmp_path, suffix)
    content, whole = path.read_bytes(), read_back(path).signal
    for length in np.random.default_rng(3).integers(1, len(content), 60):
        path.write_bytes(content[:length])
        try:
            np.testing.assert_array_equal(read_back(path).signal, whole)
        except SwashTwinError:
            continue
