"""Each format gives back what was measured, or a damaged file is refused."""

import gzip
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from recording_files import READABLE, WRITABLE, read_back, some_recording, write_uff, written
from scipy.io import savemat

from swashtwin.foundation import DataError, InputError, MissingExtraError, MissingFileError
from swashtwin.recordings import (
    Recording,
    load_recording,
    load_recordings,
    write_index,
    write_recording,
)
from swashtwin.recordings.formats import isolation


@pytest.fixture
def recording() -> Recording:
    return some_recording()


# ---- round trips

# WAV holds single precision.
SIGNAL_TOLERANCES = {"wav": 1e-7}


@pytest.mark.parametrize("suffix", WRITABLE)
def test_a_file_and_its_index_give_back_every_fact(
    recording: Recording, tmp_path: Path, suffix: str
) -> None:
    path = write_recording(recording, tmp_path / "deep" / f"a.{suffix}")
    write_index([recording], [path], tmp_path)

    (loaded,) = load_recordings(tmp_path)

    tolerance = SIGNAL_TOLERANCES.get(suffix, 1e-15)
    np.testing.assert_allclose(loaded.signal, recording.signal, rtol=tolerance)
    for name in (
        "sample_rate",
        "recording_id",
        "channels",
        "unit",
        "label",
        "specimen",
        "synthetic",
    ):
        assert getattr(loaded, name) == getattr(recording, name)
    assert loaded.attributes["sensor"] == "352C33"
    assert loaded.attributes["file"] == f"deep/a.{suffix}"

    # a quantity is written with 15 digits
    assert loaded.condition is not None
    assert recording.condition is not None
    assert loaded.condition.speed == pytest.approx(recording.condition.speed, rel=1e-12)


def test_a_universal_file_gives_back_its_time_responses(
    recording: Recording, tmp_path: Path
) -> None:
    loaded = load_recording(written(recording, tmp_path, "uff"))

    np.testing.assert_allclose(loaded.signal, recording.signal, rtol=1e-9)
    assert loaded.channels == ("point 0", "point 1")
    assert (loaded.unit, loaded.sample_rate) == ("m/s^2", 25600.0)


# The format states the sample period, 39.0625 us as 3.90625E-05.
@pytest.mark.parametrize(
    "rate", [1000.0, 6400.0, 12000.0, 25600.0, 44100.0, 48000.0, 51200 / 3, 65536.0, 102400.0]
)
def test_a_sample_period_of_six_digits_gives_back_the_exact_rate(
    rate: float, tmp_path: Path
) -> None:
    signal = np.random.default_rng(1).standard_normal((1, 50))
    write_uff(tmp_path / "a.uff", signal, 1 / rate)

    assert load_recording(tmp_path / "a.uff").sample_rate == pytest.approx(rate, rel=1e-12)


def test_matlab_7_3_is_read_like_version_5(tmp_path: Path) -> None:
    # Version 7.3 is HDF5 behind a head of 512 bytes.
    path = tmp_path / "v73.mat"
    signal = np.arange(40.0)
    with h5py.File(path, "w", userblock_size=512) as file:
        file["X105_DE_time"] = signal[None]
        file["fs"] = np.array([[12000.0]])
        for data_set in file.values():
            data_set.attrs["MATLAB_class"] = np.bytes_("double")
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\x00\x02IM"
    with path.open("r+b") as file:
        file.write(head)

    loaded = load_recording(path, unit="1")

    np.testing.assert_array_equal(loaded.signal[0], signal)
    assert loaded.channels == ("X105_DE_time",)
    assert loaded.sample_rate == 12000.0


def test_a_matrix_becomes_one_channel_per_column(tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", {"H": np.arange(30.0).reshape(10, 3), "rig": {"fs": 1000.0}})

    loaded = load_recording(tmp_path / "a.mat", unit="1", channels=["H(:,3)"], names=["z"])

    np.testing.assert_array_equal(loaded.signal[0], np.arange(2.0, 30.0, 3.0))
    assert loaded.channels == ("z",)
    assert loaded.sample_rate == 1000.0


# ---- what cannot be written or read


def test_a_rate_that_wav_cannot_hold_is_refused(recording: Recording, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="whole rates"):
        write_recording(replace(recording, sample_rate=17066.7), tmp_path / "a.wav")


def test_a_missing_library_is_reported_with_the_extra_that_installs_it(
    recording: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_recording(recording, tmp_path / "a.tdms")
    (tmp_path / "nptdms.py").write_text("raise ImportError('nptdms')")
    monkeypatch.syspath_prepend(tmp_path)

    # a new process reads the file, without the library that the first one has imported
    isolation.stop()
    with pytest.raises(MissingExtraError, match=r'pip install "swashtwin\[readers\]"'):
        load_recording(path)
    isolation.stop()


def test_a_file_of_an_unknown_format_is_refused_with_the_readable_ones(tmp_path: Path) -> None:
    (tmp_path / "a.xlsx").write_text("x")

    with pytest.raises(DataError, match=r"'.xlsx' cannot be read; supported are .csv"):
        load_recording(tmp_path / "a.xlsx")


def test_a_format_that_is_only_read_is_refused_with_the_writable_ones(
    recording: Recording, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=r"'.uff' cannot be written; supported are .h5"):
        write_recording(recording, tmp_path / "a.uff")


# ---- damaged files


@pytest.mark.parametrize("suffix", READABLE)
def test_a_missing_file_is_refused(suffix: str, tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="does not exist"):
        load_recording(tmp_path / f"a.{suffix}")


@pytest.mark.parametrize("suffix", READABLE)
def test_an_empty_file_is_refused(suffix: str, tmp_path: Path) -> None:
    (tmp_path / f"a.{suffix}").touch()

    with pytest.raises(DataError, match="empty"):
        load_recording(tmp_path / f"a.{suffix}")


def cut_off(path: Path, length: int) -> None:
    """Keep only the first bytes of a file, as an interrupted copy does."""
    path.write_bytes(path.read_bytes()[:length])


@pytest.mark.parametrize("suffix", [suffix for suffix in READABLE if suffix != "csv"])
def test_a_file_that_is_cut_off_is_refused(
    recording: Recording, suffix: str, tmp_path: Path
) -> None:
    path = written(recording, tmp_path, suffix)
    cut_off(path, 2 * path.stat().st_size // 3)

    with pytest.raises(DataError, match=r"cut off|damaged|no time response"):
        read_back(path)


def test_a_table_that_is_cut_off_within_a_row_is_refused(
    recording: Recording, tmp_path: Path
) -> None:
    # A table of fewer whole rows is a complete one: only a torn row shows the cut.
    path = written(recording, tmp_path, "csv")
    cut_off(path, path.read_bytes().index(b",", 2 * path.stat().st_size // 3))

    with pytest.raises(DataError, match=r"cut off|damaged|no time response"):
        read_back(path)


def test_a_cut_gzip_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv.gz").write_bytes(gzip.compress(b"a,b\n" + b"1.5,2.5\n" * 500)[:-20])

    with pytest.raises(DataError, match="cut off"):
        load_recording(tmp_path / "a.csv.gz", sample_rate=1, unit="1")


def test_a_binary_file_called_csv_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(bytes(range(256)) * 10)

    with pytest.raises(DataError, match="binary"):
        load_recording(tmp_path / "a.csv")
