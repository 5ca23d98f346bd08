"""Shapes that are not those of one recording, files never closed, and integers with a scale."""

import re
from pathlib import Path
from typing import Any

import h5py
import nptdms
import numpy as np
import polars as pl
import pytest
import scipy.io

from swashtwin.foundation import DataError
from swashtwin.recordings import Recording, inspect_recordings, load_recording

CASES = Path(__file__).parent / "cases"
G = 9.80665
WINDOWS = np.random.default_rng(0).standard_normal((6, 2, 512))


def findings_of(recording: Recording) -> dict[str, str]:
    (report,) = inspect_recordings([recording]).recordings
    return {finding.kind: finding.message for finding in report.findings}


# ---- arrays of three axes, and windows in rows


def write_arrays(path: Path, arrays: dict[str, Any]) -> Path:
    if path.suffix == ".npz":
        np.savez(path, allow_pickle=False, **arrays)
    elif path.suffix == ".mat":
        scipy.io.savemat(path, arrays)
    else:
        with h5py.File(path, "w") as file:
            for name, values in arrays.items():
                file[name] = values
    return path


def test_the_array_of_windows_is_named_and_its_labels_are_no_recording() -> None:
    with pytest.raises(DataError, match=r"data \(6 x 2 x 512\) has 3 axes") as refusal:
        load_recording(CASES / "K11-three_d.npz", unit="g")

    assert refusal.value.field == "channels"


@pytest.mark.parametrize("suffix", [".npz", ".mat", ".h5"])
def test_an_array_of_three_axes_is_refused_in_each_format(tmp_path: Path, suffix: str) -> None:
    arrays = {"X_train": WINDOWS, "y_train": np.arange(6.0), "fs": 12_000.0}
    path = write_arrays(tmp_path / f"a{suffix}", arrays)

    with pytest.raises(DataError, match=r"X_train \(6 x 2 x 512\)"):
        load_recording(path, unit="g")
    assert load_recording(path, unit="g", channels=("y_train",)).n_samples == 6


@pytest.mark.parametrize("suffix", [".npz", ".mat", ".h5"])
def test_a_small_array_beside_a_signal_is_named(tmp_path: Path, suffix: str) -> None:
    arrays = {"acc": np.arange(9000.0), "thumbnail": np.ones((8, 8, 3)), "fs": 12_000.0}
    path = write_arrays(tmp_path / f"a{suffix}", arrays)

    recording = load_recording(path, unit="g")

    assert recording.n_samples == 9000
    assert "thumbnail (8 x 8 x 3)" in findings_of(recording)["left_out"]


def test_a_table_of_windows_is_asked_about() -> None:
    path = CASES / "K11-har.txt"
    options = {"unit": "g", "sample_rate": "4 kHz"}

    with pytest.raises(DataError, match="64 numbered columns of 220 samples") as refusal:
        load_recording(path, **options)

    assert refusal.value.field == "channels"
    assert load_recording(path, channels=("*",), **options).n_channels == 64


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".npz", ".mat", ".h5"])
@pytest.mark.parametrize("shape", [(300, 128), (100, 1024)])
def test_windows_in_rows_are_asked_about_in_each_format(
    tmp_path: Path, suffix: str, shape: tuple[int, int]
) -> None:
    rows = np.random.default_rng(1).standard_normal(shape)
    path = tmp_path / f"a{suffix}"
    if suffix in (".csv", ".parquet"):
        table = pl.DataFrame(rows, schema=[f"s{number}" for number in range(shape[1])])
        if suffix == ".csv":
            table.write_csv(path)
        else:
            table.write_parquet(path)
    else:
        write_arrays(path, {"X": rows})

    with pytest.raises(DataError, match="numbered columns of"):
        load_recording(path, unit="g", sample_rate="4 kHz")


@pytest.mark.parametrize(
    "others", [{}, {"y": np.arange(100) % 3}, {"Fs": 1e4, "t": np.arange(7.0)}]
)
def test_the_advice_about_windows_in_rows_works(tmp_path: Path, others: dict[str, Any]) -> None:
    rows = np.random.default_rng(1).standard_normal((100, 2048))
    path = write_arrays(tmp_path / "a.mat", {"X": rows, **others})
    facts = {"unit": "g", "sample_rate": "10 kHz"}

    with pytest.raises(DataError, match="numbered columns of") as refusal:
        load_recording(path, **facts)

    advice = re.search(r"such as '(.*?)'", str(refusal.value))
    assert advice is not None
    assert load_recording(path, channels=(advice[1],), **facts).n_channels == 100


def test_lists_in_cells_are_asked_about(tmp_path: Path) -> None:
    table = pl.DataFrame({"label": [0, 1], "fenster": [[0.1, 0.2, 0.3], [0.2, 0.1, 0.4]]})
    table.write_parquet(tmp_path / "a.parquet")

    with pytest.raises(DataError, match="each cell of fenster holds several numbers"):
        load_recording(tmp_path / "a.parquet", unit="g", sample_rate="4 kHz")


def test_many_microphones_are_channels(tmp_path: Path) -> None:
    signal = np.random.default_rng(2).standard_normal((5000, 64))
    path = write_arrays(tmp_path / "a.npz", {"p": signal, "fs": 25_600.0})

    assert load_recording(path, unit="1").n_channels == 64


# ---- files that were never closed


def write_tdms(
    path: Path, channels: dict[str, np.ndarray], segments: int = 1, **properties: Any
) -> Path:
    """Write channels in several segments, with further properties of the first one."""
    first, *_ = channels
    with nptdms.TdmsWriter(str(path)) as writer:
        for number in range(segments):
            objects = []
            for name, samples in channels.items():
                clock = {"wf_increment": 5e-5, "wf_start_offset": 0.0, "unit_string": "g"}
                facts = clock | (properties if name == first else {})
                part = np.array_split(samples, segments)[number]
                objects.append(nptdms.ChannelObject("g", name, part, properties=facts))
            writer.write_segment(objects)
    return path


def leave_unclosed(path: Path, n_lost_bytes: int = 0) -> Path:
    """Set the length of the last segment to unknown, as a recorder does until it is closed."""
    content = bytearray(path.read_bytes())
    position = content.rfind(b"TDSm")
    content[position + 12 : position + 20] = b"\xff" * 8
    path.write_bytes(content[: len(content) - n_lost_bytes])
    return path


def test_a_tdms_file_that_was_never_closed_is_read_with_a_finding() -> None:
    recording = load_recording(CASES / "K19-crash_whole.tdms")

    assert (recording.sample_rate, recording.n_samples) == (20_000, 4000)
    assert "never closed" in findings_of(recording)["unclosed"]


@pytest.mark.parametrize("segments", [1, 3])
@pytest.mark.parametrize(("n_lost_bytes", "min_samples"), [(0, 3000), (800, 2899), (803, 2899)])
def test_a_crash_in_the_last_segment_keeps_what_all_channels_have(
    tmp_path: Path, segments: int, n_lost_bytes: int, min_samples: int
) -> None:
    channels = {name: np.arange(3000.0) + offset for offset, name in enumerate("xy")}
    path = leave_unclosed(write_tdms(tmp_path / "a.tdms", channels, segments), n_lost_bytes)

    recording = load_recording(path)

    assert min_samples <= recording.n_samples <= 3000
    for samples, written in zip(recording.signal, channels.values(), strict=True):
        np.testing.assert_allclose(samples, G * written[: recording.n_samples])
    assert "unclosed" in findings_of(recording)


def test_a_copy_that_was_cut_off_is_refused(tmp_path: Path) -> None:
    path = write_tdms(tmp_path / "a.tdms", {"x": np.arange(3000.0)})
    path.write_bytes(path.read_bytes()[:-800])

    with pytest.raises(DataError, match="cut off"):
        load_recording(path)


def test_a_wav_file_that_was_never_closed_has_the_same_finding() -> None:
    recording = load_recording(CASES / "24-wav-never-closed-zero_data.wav", unit="1")
    wrapped = load_recording(CASES / "27-wav-wrapped-wrapped.wav", unit="1")

    assert "never closed" in findings_of(recording)["unclosed"]
    assert "unclosed" not in findings_of(wrapped)


# ---- scales of other quantities


def scale(kind: str) -> dict[str, Any]:
    return {
        "NI_Scaling_Status": "unscaled",
        "NI_Number_Of_Scales": 1,
        "NI_Scale[0]_Scale_Type": kind,
        "NI_Scale[0]_Linear_Slope": 1.0,
    }


@pytest.mark.parametrize("kind", ["Strain", "RTD", "Thermocouple", "Thermistor", "Dehnung"])
def test_a_scale_of_a_sensor_is_refused_by_its_name(tmp_path: Path, kind: str) -> None:
    channels = {"s": np.arange(900, dtype=np.int16)}
    path = write_tdms(tmp_path / "a.tdms", channels, **scale(kind))

    with pytest.raises(DataError, match=f"Unsupported scale type: {kind}, of 's'"):
        load_recording(path)


def test_a_channel_with_such_a_scale_is_left_out_by_name(tmp_path: Path) -> None:
    channels = {"strain": np.arange(900, dtype=np.int16), "acc": np.arange(900.0)}
    path = write_tdms(tmp_path / "a.tdms", channels, **scale("Strain"))

    recording = load_recording(path)

    assert recording.channels == ("acc",)
    assert "strain (scale type Strain)" in findings_of(recording)["left_out"]
    with pytest.raises(DataError, match="Unsupported scale type: Strain"):
        load_recording(path, channels=("strain",))


# ---- integers beside which a number stands

COUNTS = np.round(900 * np.random.default_rng(3).standard_normal(3000)).astype(np.int16)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("sensitivity", 0.000488),
        ("full_scale", 16),
        ("lsb", 6.1e-5),
        ("counts_per_g", 2048),
        ("g_per_digit", 0.00049),
        ("range", "±16 g"),
        ("Messbereich", "50 g"),
        ("Empfindlichkeit", 0.1),
        ("mg_per_lsb", 0.488),
        ("adc_bits", 24),
        ("vref", 2.5),
    ],
)
@pytest.mark.parametrize("place", ["data set", "file", "group"])
def test_a_number_beside_counts_is_asked_about(
    tmp_path: Path, name: str, value: Any, place: str
) -> None:
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        group = file.create_group("run")
        group["acc"] = COUNTS
        group["acc"].attrs["fs"] = 6400.0
        {"data set": group["acc"], "file": file, "group": group}[place].attrs[name] = value

    with pytest.raises(DataError, match=f"(?i){name} = .* beside integers") as refusal:
        load_recording(path, unit="g")

    assert refusal.value.field == "sensitivity"
    recording = load_recording(path, sensitivity="0.488 mg/count")
    np.testing.assert_allclose(recording.signal[0], 0.488e-3 * G * COUNTS)


def test_counts_of_an_unknown_scale_can_be_read_without_a_unit(tmp_path: Path) -> None:
    path = write_arrays(tmp_path / "a.npz", {"acc": COUNTS, "fs": 6400.0, "lsb": 0.488})

    assert load_recording(path, unit="1").n_samples == 3000


@pytest.mark.parametrize("suffix", [".npz", ".mat"])
@pytest.mark.parametrize("name", ["lsb", "vollausschlag", "acc_scale_mg"])
def test_a_number_beside_counts_in_other_formats(tmp_path: Path, suffix: str, name: str) -> None:
    arrays = {"acc": COUNTS, "fs": 6400.0, name: 0.488}
    path = write_arrays(tmp_path / f"a{suffix}", arrays)

    with pytest.raises(DataError, match=r"= 0\.488 beside integers"):
        load_recording(path, unit="g")


def test_numbers_with_another_meaning_are_not_asked_about(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    facts = {"fs": 6400, "n_samples": 3000, "speed_rpm": 1480, "serial_number": 4711, "gain": 1}
    with h5py.File(path, "w") as file:
        file["acc"] = COUNTS
        file["acc"].attrs.update({**facts, "date": "2026-03-02", "sensor": "352C33", "channel": 2})

    assert load_recording(path, unit="g").n_samples == 3000


def test_a_number_beside_floating_point_samples_is_not_asked_about(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["acc"] = COUNTS.astype(float)
        file["acc"].attrs.update({"fs": 6400, "range": 16})

    assert load_recording(path, unit="g").n_samples == 3000
