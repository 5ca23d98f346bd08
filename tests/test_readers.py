"""Every format gives back what was measured, or one line that says what is wrong with the file."""

import errno
import gzip
import os
import shutil
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from swashtwin.condition import OperatingCondition
from swashtwin.errors import (
    DataError,
    InputError,
    MissingExtraError,
    MissingFileError,
    SwashTwinError,
    UnitError,
)
from swashtwin.readers import formats, read_recording, read_recordings, write_index, write_recording
from swashtwin.readers.raw import snapped_rate
from swashtwin.recording import Recording
from swashtwin.units import MPa, celsius, rpm

DATA = Path(os.environ.get("SWASHTWIN_DATA", Path(__file__).parents[2] / "shared" / "data"))
needs_cwru = pytest.mark.skipif(not (DATA / "cwru").is_dir(), reason="the CWRU recordings are not on this machine")
needs_cavitation = pytest.mark.skipif(
    not (DATA / "pump_cavitation").is_dir(), reason="the pump cavitation recordings are not on this machine"
)
WRITABLE = ("h5", "mat", "wav", "csv", "tdms", "parquet", "npz", "mf4")
READABLE = (*WRITABLE, "uff")


@pytest.fixture
def recording() -> Recording:
    return Recording(
        signal=np.random.default_rng(0).standard_normal((2, 600)),
        sample_rate=25600.0,
        recording_id="normal_15MPa_1",
        channels=("axial x", "radial"),
        label="normal",
        condition=OperatingCondition(speed=rpm(860.0), discharge_pressure=MPa(15.0), oil_temperature=celsius(45.0)),
        specimen="A",
        attributes={"sensor": "352C33"},
    )


def write_uff(path: Path, signal: np.ndarray, step: float, unit: str = "m/s^2") -> None:
    import pyuff

    sets = [
        pyuff.prepare_58(
            id1=f"point {number}",
            func_type=1,
            rsp_node=number,
            rsp_dir=1,
            ref_node=0,
            ref_dir=0,
            ord_data_type=4,
            num_pts=len(row),
            abscissa_spacing=1,
            abscissa_min=0.0,
            abscissa_inc=step,
            abscissa_spec_data_type=17,
            ordinate_spec_data_type=12,
            orddenom_spec_data_type=0,
            ordinate_axis_units_lab=unit,
            data=row,
            x=np.arange(len(row)) * step,
        )
        for number, row in enumerate(signal)
    ]
    pyuff.UFF(str(path)).write_sets(sets, mode="overwrite")


def written(recording: Recording, folder: Path, suffix: str) -> Path:
    path = folder / f"file.{suffix}"
    if suffix == "uff":
        write_uff(path, recording.signal, 1 / recording.sample_rate)
        return path
    return write_recording(recording, path)


def read_back(path: Path) -> Recording:
    """The recording, told what its format has no place for."""
    return read_recording(path, **({"unit": "m/s^2"} if path.suffix == ".wav" else {}))


# ---- round trips


def test_hdf5_gives_back_the_whole_recording(recording: Recording, tmp_path: Path) -> None:
    synthetic = replace(recording, synthetic=True)
    back = read_recording(write_recording(synthetic, tmp_path / "other_name.h5"))
    for name in ("sample_rate", "recording_id", "channels", "unit", "label", "condition", "specimen", "synthetic"):
        assert getattr(back, name) == getattr(synthetic, name)
    np.testing.assert_array_equal(back.signal, synthetic.signal)
    assert back.attributes["sensor"] == "352C33"


def test_hdf5_gives_back_a_recording_of_which_little_is_known(tmp_path: Path) -> None:
    bare = Recording(signal=np.ones((1, 3)), sample_rate=1.5, recording_id="x", unit="1")
    back = read_recording(write_recording(bare, tmp_path / "x.h5"))
    assert (back.label, back.condition, back.specimen, back.unit) == (None, None, None, "1")


@pytest.mark.parametrize("suffix", WRITABLE)
def test_the_index_gives_back_what_a_format_loses(recording: Recording, tmp_path: Path, suffix: str) -> None:
    path = write_recording(recording, tmp_path / "deep" / f"a.{suffix}")
    write_index([recording], [path], tmp_path)
    (back,) = read_recordings(tmp_path)
    np.testing.assert_allclose(back.signal, recording.signal, rtol=1e-7 if suffix == "wav" else 1e-15)
    assert back.condition is not None
    assert recording.condition is not None
    assert back.condition.speed == pytest.approx(recording.condition.speed, rel=1e-12)
    for name in ("sample_rate", "recording_id", "channels", "unit", "label", "specimen", "synthetic"):
        assert getattr(back, name) == getattr(recording, name)
    assert back.attributes["sensor"] == "352C33"
    assert back.attributes["file"] == f"deep/a.{suffix}"


def test_a_universal_file_gives_back_its_time_responses(recording: Recording, tmp_path: Path) -> None:
    back = read_recording(written(recording, tmp_path, "uff"))
    np.testing.assert_allclose(back.signal, recording.signal, rtol=1e-9)
    assert back.channels == ("point 0", "point 1")
    assert (back.unit, back.sample_rate) == ("m/s^2", 25600.0)


@pytest.mark.parametrize("rate", [1000.0, 6400.0, 12000.0, 25600.0, 44100.0, 48000.0, 51200 / 3, 65536.0, 102400.0])
def test_a_step_of_six_digits_gives_back_the_exact_rate(rate: float, tmp_path: Path) -> None:
    write_uff(tmp_path / "a.uff", np.random.default_rng(1).standard_normal((1, 50)), 1 / rate)
    assert read_recording(tmp_path / "a.uff").sample_rate == pytest.approx(rate, rel=1e-12)


def test_a_step_that_no_sensible_rate_explains_is_kept() -> None:
    assert snapped_rate(1 / 12345.678, 1e-9) == pytest.approx(12345.678, rel=1e-12)


def test_matlab_7_3_is_read_like_version_5(tmp_path: Path) -> None:
    path, signal = tmp_path / "v73.mat", np.arange(40.0)
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in {"X105_DE_time": signal[None], "fs": np.array([[12000.0]])}.items():
            file[name] = value
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\x00\x02IM"
    with path.open("r+b") as file:
        file.write(head)
    back = read_recording(path, unit="1")
    np.testing.assert_array_equal(back.signal[0], signal)
    assert (back.channels, back.sample_rate) == (("X105_DE_time",), 12000.0)


def test_a_matrix_becomes_one_channel_per_column(tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", {"H": np.arange(30.0).reshape(10, 3), "rig": {"fs": 1000.0}})
    back = read_recording(tmp_path / "a.mat", unit="1", channels=["H(:,3)"], names=["z"])
    np.testing.assert_array_equal(back.signal[0], np.arange(2.0, 30.0, 3.0))
    assert (back.channels, back.sample_rate) == (("z",), 1000.0)


def test_vectors_of_a_foreign_hdf5_file_are_channels(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["run/acc"] = np.arange(20.0).reshape(10, 2)
        file["run/acc"].attrs.update({"unit": "g", "fs": 500.0})
    back = read_recording(tmp_path / "a.h5")
    assert (back.channels, back.sample_rate) == (("run/acc/0", "run/acc/1"), 500.0)
    assert back.signal[1, 1] == pytest.approx(3 * 9.80665)


# ---- text tables

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
    back = read_recording(path, sample_rate=100, unit="1")
    np.testing.assert_allclose(back.signal, [[1.5, -0.3], [2, 4]])
    assert back.channels == ("a", "b")
    assert back.recording_id == "a"


def test_a_told_dialect_is_obeyed(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("1 2\n7,5\n8,5\n")
    back = read_recording(tmp_path / "a.txt", sample_rate=1, unit="1", decimal=",", header_lines=1)
    np.testing.assert_array_equal(back.signal, [[7.5, 8.5]])


@pytest.mark.parametrize("encoding", ["utf-16", "latin-1", "utf-8-sig"])
def test_text_of_another_encoding_is_read(tmp_path: Path, encoding: str) -> None:
    (tmp_path / "a.csv").write_bytes("Zeit [s];Gehäuse [m/s²]\n0;1\n0,1;2\n0,2;3\n".encode(encoding))
    back = read_recording(tmp_path / "a.csv")
    assert (back.channels, back.unit, back.sample_rate) == (("Gehäuse",), "m/s^2", 10.0)


def test_a_number_with_a_comma_is_not_guessed_to_be_two_columns(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("3,14\n2,72\n")
    with pytest.raises(DataError, match="decimal comma"):
        read_recording(tmp_path / "a.csv", sample_rate=1, unit="1")


def test_a_coarsely_rounded_time_column_is_uniform(tmp_path: Path) -> None:
    time = np.round(np.arange(2000) / 25600, 4)
    rows = "\n".join(f"{t:.4f};{x}" for t, x in zip(time, range(2000), strict=True))
    (tmp_path / "a.csv").write_text("time;x [g]\n" + rows + "\n")
    back = read_recording(tmp_path / "a.csv")
    assert back.sample_rate == 25600.0
    assert "time_gaps" not in back.attributes


def test_a_gap_in_the_time_column_is_remembered(tmp_path: Path) -> None:
    time = np.arange(100) * 0.01
    time[60:] += 0.5
    rows = "\n".join(f"{t:.2f},{x}" for t, x in zip(time, range(100), strict=True))
    (tmp_path / "a.csv").write_text("t,x\n" + rows + "\n")
    back = read_recording(tmp_path / "a.csv", unit="1")
    assert back.sample_rate == 100.0
    assert back.attributes["time_gaps"] == "1 of 99 steps differ from the usual 0.01 s; the worst is 0.51 s at 0.59 s"


def test_a_short_row_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("a,b\n" + "1.5,2\n" * 100 + "1.5\n")
    with pytest.raises(DataError, match="line 102 has 1 columns, not 2"):
        read_recording(tmp_path / "a.csv", sample_rate=1, unit="1")


def test_a_word_among_the_numbers_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("a,b\n" + "1.5,2\n" * 100 + "1.5,overload\n")
    with pytest.raises(DataError, match="overload"):
        read_recording(tmp_path / "a.csv", sample_rate=1, unit="1")


def test_a_blank_field_is_nan(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("a,b\n1.5,2\n,3\n2.5,NaN\n")
    back = read_recording(tmp_path / "a.csv", sample_rate=1, unit="1")
    assert np.isnan(back.signal).tolist() == [[False, True, False], [False, False, True]]


# ---- units and scales


@pytest.mark.parametrize(
    ("unit", "factor", "kept"),
    [
        ("g", 9.80665, "m/s^2"),
        ("mg", 9.80665e-3, "m/s^2"),
        ("mm/s^2", 1e-3, "m/s^2"),
        ("m/s²", 1.0, "m/s^2"),
        ("Pa", 1.0, "Pa"),
        ("mm/s", 1.0, "mm/s"),
        ("1", 1.0, "1"),
    ],
)
def test_accelerations_become_si_and_the_rest_stays(tmp_path: Path, unit: str, factor: float, kept: str) -> None:
    (tmp_path / "a.csv").write_text("a\n1.5\n2.5\n")
    back = read_recording(tmp_path / "a.csv", sample_rate="1 kHz", unit=unit)
    np.testing.assert_allclose(back.signal, [[1.5 * factor, 2.5 * factor]])
    assert (back.unit, back.sample_rate) == (kept, 1000.0)


def test_integer_wav_needs_to_be_told_its_scale(tmp_path: Path) -> None:
    import soundfile

    soundfile.write(tmp_path / "a.wav", np.array([[0.5, 0.25], [-0.5, 0.125]]), 48000, subtype="PCM_16")
    with pytest.raises(DataError, match="calibration_factor"):
        read_recording(tmp_path / "a.wav", unit="g")
    back = read_recording(tmp_path / "a.wav", calibration_factor=["50 m/s^2", "10 g"])
    np.testing.assert_allclose(back.signal, [[25, -25], [2.5 * 9.80665, 1.25 * 9.80665]], rtol=1e-12)
    assert read_recording(tmp_path / "a.wav", unit="1").signal[0, 0] == 0.5


@pytest.mark.parametrize(
    ("facts", "error", "said"),
    [
        ({"sample_rate": 1000}, DataError, 'add unit = "g"'),
        ({"unit": "g"}, DataError, 'add sample_rate = "25.6 kHz"'),
        ({"unit": "bananas", "sample_rate": 1000}, UnitError, "not known"),
        ({"unit": "g", "sample_rate": "1000"}, UnitError, "no unit"),
        ({"unit": "g", "sample_rate": -5}, DataError, "must be positive"),
        ({"unit": "g", "sample_rate": 1000, "channels": ["c"]}, DataError, "it has 0 'a', 1 'b'"),
        ({"unit": "g", "sample_rate": 1000, "channels": [2]}, DataError, "it has 0 'a', 1 'b'"),
        ({"unit": "g", "sample_rate": 1000, "names": ["one"]}, DataError, "1 names for 2 channels"),
        ({"unit": "g", "sample_rate": 1000, "labl": "normal"}, DataError, "did you mean 'label'"),
        ({"unit": "g", "sample_rate": 1000, "label": 3}, DataError, "must be text"),
        ({"unit": "g", "sample_rate": 1000, "speed": "14.3 Hz"}, UnitError, "is a frequency; write it as"),
        ({"unit": "g", "sample_rate": 1000, "discharge_pressure": "15 MPa"}, DataError, "without speed"),
        (
            {"unit": "g", "sample_rate": 1000, "speed": "860 rpm", "discharge_pressure": "15 Pa"},
            DataError,
            "must exceed",
        ),
        ({"calibration_factor": "much", "sample_rate": 1000}, UnitError, "number with its unit"),
        ({"calibration_factor": ["1 g"], "sample_rate": 1000}, DataError, "1 calibration factors for 2 channels"),
        ({"calibration_factor": ["1 g", "1 Pa"], "sample_rate": 1000}, DataError, "different units"),
        ({"unit": "g", "sample_rate": 1000, "resample": "333.777 Hz"}, DataError, "ratio of whole numbers"),
        ({"unit": "g", "sample_rate": 1000, "sha256": "0" * 64}, DataError, "not the file that was indexed"),
        ({"unit": "g", "sample_rate": 1000, "time_column": "z"}, DataError, "no column 'z' for time_column"),
        ({"unit": "g", "sample_rate": 1000, "separator": ";", "decimal": ","}, DataError, "no table of numbers"),
    ],
)
def test_a_wrong_or_missing_fact_is_refused(
    tmp_path: Path, facts: dict[str, object], error: type[Exception], said: str
) -> None:
    (tmp_path / "a.csv").write_text("a,b\n1.5,2.5\n3.5,4.5\n")
    with pytest.raises(error, match=said) as caught:
        read_recording(tmp_path / "a.csv", **facts)
    assert "\n" not in str(caught.value)


def test_a_rate_that_contradicts_the_file_names_both(recording: Recording, tmp_path: Path) -> None:
    path = write_recording(recording, tmp_path / "a.h5")
    with pytest.raises(DataError, match=r"25600 Hz, the index says 12800 Hz"):
        read_recording(path, sample_rate="12.8 kHz")
    assert read_recording(path, sample_rate="25.61 kHz").sample_rate == 25610.0


def test_a_unit_that_contradicts_the_file_names_both_and_can_be_overruled(recording: Recording, tmp_path: Path) -> None:
    path = write_recording(recording, tmp_path / "a.h5")
    with pytest.raises(DataError, match=r"in m/s\^2, the index says g"):
        read_recording(path, unit="g")
    overruled = read_recording(path, calibration_factor="1 g")
    np.testing.assert_allclose(overruled.signal, recording.signal * 9.80665)


def test_columns_of_several_lengths_must_be_chosen(tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", {"X105_DE_time": np.ones(10), "X105_FE_time": np.ones(9), "X105RPM": 1797.0})
    with pytest.raises(DataError, match="X105_DE_time: 10, X105_FE_time: 9"):
        read_recording(tmp_path / "a.mat", sample_rate=12000, unit="g")
    back = read_recording(tmp_path / "a.mat", sample_rate=12000, unit="g", channels=["*_DE_time"], speed="1797 rpm")
    assert back.channels == ("X105_DE_time",)
    assert (back.condition, back.attributes["speed"], back.attributes["X105RPM"]) == (None, "1797 rpm", "1797")


def test_resampling_keeps_a_tone_and_says_so(tmp_path: Path) -> None:
    time = np.arange(4800) / 48000
    savemat(tmp_path / "a.mat", {"x": 3 + np.sin(2 * np.pi * 500 * time), "fs": 48000.0})
    back = read_recording(tmp_path / "a.mat", unit="1", resample="12 kHz")
    assert back.sample_rate == 12000.0
    np.testing.assert_allclose(back.signal[0, 50:-50], 3 + np.sin(2 * np.pi * 500 * back.time[50:-50]), atol=2e-3)
    assert "from 48000 Hz to 12000 Hz" in back.attributes["resampled"]


# ---- damaged files


@pytest.mark.parametrize("suffix", READABLE)
def test_a_missing_file_is_refused(suffix: str, tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="does not exist"):
        read_recording(tmp_path / f"a.{suffix}")


@pytest.mark.parametrize("suffix", READABLE)
def test_an_empty_file_is_refused(suffix: str, tmp_path: Path) -> None:
    (tmp_path / f"a.{suffix}").touch()
    with pytest.raises(DataError, match="empty"):
        read_recording(tmp_path / f"a.{suffix}")


@pytest.mark.parametrize("suffix", READABLE)
def test_a_cut_file_is_refused(recording: Recording, suffix: str, tmp_path: Path) -> None:
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
        read_recording(tmp_path / "a.csv.gz", sample_rate=1, unit="1")


def test_an_index_sees_a_text_file_cut_between_two_rows(recording: Recording, tmp_path: Path) -> None:
    path = write_recording(recording, tmp_path / "a.csv")
    write_index([recording], [path], tmp_path)
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:-100]))
    with pytest.raises(DataError, match="not the file that was indexed"):
        read_recordings(tmp_path)


def test_an_unknown_suffix_offers_the_supported(tmp_path: Path, recording: Recording) -> None:
    (tmp_path / "a.xlsx").write_text("x")
    with pytest.raises(DataError, match=r"'.xlsx' cannot be read; supported are .csv"):
        read_recording(tmp_path / "a.xlsx")
    with pytest.raises(InputError, match=r"'.uff' cannot be written; supported are .h5"):
        write_recording(recording, tmp_path / "a.uff")


def test_binary_rubbish_called_csv_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(bytes(range(256)) * 10)
    with pytest.raises(DataError, match="binary"):
        read_recording(tmp_path / "a.csv")


def _damaged(content: bytes, generator: np.random.Generator) -> bytes:
    if generator.random() < 0.4:
        return content[: int(generator.integers(1, len(content)))]
    changed = bytearray(content)
    reach = len(changed) if generator.random() < 0.5 else min(400, len(changed))  # half of them in the header
    for place in generator.integers(0, reach, int(generator.integers(1, 12))):
        changed[place] = int(generator.integers(0, 256))
    return bytes(changed)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # pyuff leaves damaged files open
@pytest.mark.parametrize("suffix", [*READABLE, "csv.gz"])
def test_a_damaged_file_is_read_or_refused_in_one_line(recording: Recording, suffix: str, tmp_path: Path) -> None:
    short = replace(recording, signal=recording.signal[:, :60])
    content = written(short, tmp_path, suffix.removesuffix(".gz")).read_bytes()
    content = gzip.compress(content) if suffix.endswith("gz") else content
    generator = np.random.default_rng(7)
    path = tmp_path / f"damaged.{suffix}"
    refused = 0
    for _ in range(100):
        path.write_bytes(_damaged(content, generator))
        try:
            back = read_back(path)
        except SwashTwinError as error:
            refused += "\n" not in str(error) or pytest.fail(f"two lines: {error}")
        else:
            assert back.signal.ndim == 2
    assert refused > 10


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


# ---- writing


@pytest.mark.parametrize("suffix", WRITABLE)
def test_a_full_disk_leaves_the_old_file_and_no_debris(
    recording: Recording, suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_recording(recording, tmp_path / f"a.{suffix}")
    old = path.read_bytes()
    module = import_module(f"swashtwin.readers.{formats._FORMATS['.' + suffix]}")

    def write_half(recording: Recording, target: Path) -> None:
        target.write_bytes(old[: len(old) // 2])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(module, "write", write_half)
    with pytest.raises(OSError, match="No space"):
        write_recording(replace(recording, signal=recording.signal + 1), path)
    assert path.read_bytes() == old
    assert [one.name for one in tmp_path.iterdir()] == [path.name]


def test_a_rate_that_wav_cannot_hold_is_refused(recording: Recording, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="whole rates"):
        write_recording(replace(recording, sample_rate=17066.7), tmp_path / "a.wav")


def test_a_missing_extra_is_named(recording: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_recording(recording, tmp_path / "a.tdms")

    def refuse(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr("swashtwin.readers.raw.import_module", refuse)
    with pytest.raises(MissingExtraError, match=r'pip install "swashtwin\[readers\]"'):
        read_recording(path)


# ---- public data


@needs_cavitation
def test_a_cavitation_recording_is_read_as_numpy_reads_it() -> None:
    path = DATA / "pump_cavitation" / "recordings" / "01_1_s700_healthy.dat.gz"
    back = read_recording(path, unit="1")
    with gzip.open(path, "rt") as file:
        expected = np.loadtxt(file, skiprows=8)
    np.testing.assert_array_equal(back.signal, expected[:, 1:].T)
    assert (back.sample_rate, back.channels) == (6400.0, ("ch 0", "ch 1", "ch 2", "ch 3", "ch 4"))


@needs_cwru
def test_a_bearing_recording_has_its_published_kurtosis(tmp_path: Path) -> None:
    from scipy.stats import kurtosis

    shutil.copy(DATA / "cwru" / "drive_end_12k" / "drive_end_12k_IR007_load0_rec105.mat", tmp_path / "a.mat")
    back = read_recording(tmp_path / "a.mat", sample_rate="12 kHz", unit="g", channels=["X105_DE_time"])
    assert kurtosis(back.signal[0], fisher=False) == pytest.approx(5.4, abs=0.05)
