"""Every format gives back what was measured, or refuses a damaged file; writing one leaves nothing
half-done.
"""

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


@pytest.mark.parametrize("suffix", WRITABLE)
def test_the_index_gives_back_what_a_format_loses(
    recording: Recording, tmp_path: Path, suffix: str
) -> None:
    path = write_recording(recording, tmp_path / "deep" / f"a.{suffix}")
    write_index([recording], [path], tmp_path)
    (loaded,) = load_recordings(tmp_path)
    np.testing.assert_allclose(
        loaded.signal, recording.signal, rtol=1e-7 if suffix == "wav" else 1e-15
    )
    assert loaded.condition is not None
    assert recording.condition is not None
    assert loaded.condition.speed == pytest.approx(recording.condition.speed, rel=1e-12)
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


def test_a_universal_file_gives_back_its_time_responses(
    recording: Recording, tmp_path: Path
) -> None:
    loaded = load_recording(written(recording, tmp_path, "uff"))
    np.testing.assert_allclose(loaded.signal, recording.signal, rtol=1e-9)
    assert loaded.channels == ("point 0", "point 1")
    assert (loaded.unit, loaded.sample_rate) == ("m/s^2", 25600.0)


@pytest.mark.parametrize(
    "rate", [1000.0, 6400.0, 12000.0, 25600.0, 44100.0, 48000.0, 51200 / 3, 65536.0, 102400.0]
)
def test_a_step_of_six_digits_gives_back_the_exact_rate(rate: float, tmp_path: Path) -> None:
    write_uff(tmp_path / "a.uff", np.random.default_rng(1).standard_normal((1, 50)), 1 / rate)
    assert load_recording(tmp_path / "a.uff").sample_rate == pytest.approx(rate, rel=1e-12)


def test_matlab_7_3_is_read_like_version_5(tmp_path: Path) -> None:
    path, signal = tmp_path / "v73.mat", np.arange(40.0)
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in {"X105_DE_time": signal[None], "fs": np.array([[12000.0]])}.items():
            file[name] = value
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\x00\x02IM"
    with path.open("r+b") as file:
        file.write(head)
    loaded = load_recording(path, unit="1")
    np.testing.assert_array_equal(loaded.signal[0], signal)
    assert (loaded.channels, loaded.sample_rate) == (("X105_DE_time",), 12000.0)


def test_a_matrix_becomes_one_channel_per_column(tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", {"H": np.arange(30.0).reshape(10, 3), "rig": {"fs": 1000.0}})
    loaded = load_recording(tmp_path / "a.mat", unit="1", channels=["H(:,3)"], names=["z"])
    np.testing.assert_array_equal(loaded.signal[0], np.arange(2.0, 30.0, 3.0))
    assert (loaded.channels, loaded.sample_rate) == (("z",), 1000.0)


# ---- writing


def test_a_rate_that_wav_cannot_hold_is_refused(recording: Recording, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="whole rates"):
        write_recording(replace(recording, sample_rate=17066.7), tmp_path / "a.wav")


def test_a_missing_extra_is_named(
    recording: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_recording(recording, tmp_path / "a.tdms")

    (tmp_path / "nptdms.py").write_text("raise ImportError('nptdms')")
    monkeypatch.syspath_prepend(tmp_path)
    isolation.stop()
    with pytest.raises(MissingExtraError, match=r'pip install "swashtwin\[readers\]"'):
        load_recording(path)
    isolation.stop()


# ---- damaged files


@pytest.mark.parametrize("suffix", READABLE)
def test_a_missing_an_empty_and_a_cut_file_are_refused(
    recording: Recording, suffix: str, tmp_path: Path
) -> None:
    with pytest.raises(MissingFileError, match="does not exist"):
        load_recording(tmp_path / f"a.{suffix}")
    (tmp_path / f"a.{suffix}").touch()
    with pytest.raises(DataError, match="empty"):
        load_recording(tmp_path / f"a.{suffix}")
    path = written(recording, tmp_path, suffix)
    content = path.read_bytes()
    length = 2 * len(content) // 3
    length += (
        content[length:].index(b",") if suffix == "csv" else 0
    )  # a row of text must be torn to be seen
    path.write_bytes(content[:length])
    with pytest.raises(DataError, match=r"cut off|damaged|no time response"):
        read_back(path)


def test_a_cut_gzip_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv.gz").write_bytes(gzip.compress(b"a,b\n" + b"1.5,2.5\n" * 500)[:-20])
    with pytest.raises(DataError, match="cut off"):
        load_recording(tmp_path / "a.csv.gz", sample_rate=1, unit="1")


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
