"""Files as instruments write them: what they say of their numbers is obeyed or refused, and never ignored."""

import struct
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import soundfile
from recording_files import write_uff
from scipy.io import savemat

from swashtwin.foundation import DataError
from swashtwin.recordings import Recording, inspect_recording, load_recording

RATE = 10_000.0
NOISE = np.random.default_rng(3).normal(size=2000).round(5)
TIME = np.arange(2000) / RATE
G = 9.80665


def text(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def rows(*columns: Any, separator: str = ",", end: str = "") -> list[str]:
    return [separator.join(map(str, row)) + end for row in zip(*columns, strict=True)]


def seconds(digits: int = 6) -> list[str]:
    return [f"{value:.{digits}f}" for value in TIME]


def assert_noise(recording: Recording, rate: float = RATE, unit: str = "m/s^2", factor: float = G) -> None:
    assert recording.sample_rate == pytest.approx(rate, rel=1e-9)
    assert recording.unit == unit
    np.testing.assert_allclose(recording.signal[0], NOISE * factor, rtol=1e-9, atol=1e-9)


# ---- text tables


def test_a_labview_file_states_its_step_and_its_units(tmp_path: Path) -> None:
    head = [
        "LabVIEW Measurement\t", "Separator\tTab", "Decimal_Separator\t.", "***End_of_Header***\t", "\t",
        "Channels\t2\t\t",
        "Y_Unit_Label\tg\tg\t", "X_Dimension\tTime\tTime\t", "X0\t0.0\t0.0\t", "Delta_X\t1.0E-4\t1.0E-4\t",
        "***End_of_Header***\t\t\t", "X_Value\tacc_x\tacc_y\tComment",
    ]  # fmt: skip
    path = text(tmp_path / "a.lvm", *head, *rows(seconds(), NOISE, NOISE, separator="\t", end="\t"))
    recording = load_recording(path)
    assert_noise(recording)
    assert recording.channels == ("acc_x", "acc_y")
    head[-1] = "acc_x\tacc_y\tComment"
    assert_noise(load_recording(text(path, *head, *rows(NOISE, NOISE, separator="\t", end="\t"))))


@pytest.mark.parametrize("unit", ["(\u03bcs)", "(\u00b5s)", "(us)", "[usec]"])
def test_every_way_to_write_a_microsecond_is_read(unit: str, tmp_path: Path) -> None:
    path = text(tmp_path / "a.csv", "Time,Channel A", f"{unit},(V)", "", *rows((TIME - 0.1) * 1e6, NOISE))
    assert_noise(load_recording(path), unit="V", factor=1)


@pytest.mark.parametrize("heading", ["x (g)", "x [g's]", "x [m/s²]", "x (ms-2)", "x (m/s^2)", "x (Volts)", "x [mV]"])
def test_units_are_read_as_people_write_them(heading: str, tmp_path: Path) -> None:
    recording = load_recording(text(tmp_path / "a.csv", f"time (s),{heading}", *rows(seconds(), NOISE)))
    assert recording.channels == ("x",)
    assert recording.unit == ("V" if "olt" in heading else "mV" if "mV" in heading else "m/s^2")
    assert_noise(recording, unit=recording.unit, factor=G if "g" in heading else 1)


def test_rows_may_end_in_a_separator_and_the_heading_not(tmp_path: Path) -> None:
    path = text(tmp_path / "a.csv", '"time [s]";"x [g]"', *rows(seconds(), NOISE, separator=";", end=";"))
    assert_noise(load_recording(path))


def test_a_preamble_states_the_rate_and_a_counter_is_no_channel(tmp_path: Path) -> None:
    head = ["Project:\tRig", "Sensitivity (mV/g):\t100", "Temp1\t41,2", "Rate (Hz):\t10000", "", "Comment:\tcold",
            "Gain:\t1", "1\t2", "Index\tacc_z"]  # fmt: skip
    path = text(tmp_path / "a.txt", *head, *rows(range(2000), NOISE, separator="\t"))
    recording = load_recording(path, unit="g")
    assert_noise(recording)
    assert recording.attributes["counter_columns"] == "Index"


@pytest.mark.parametrize("digits", [4, 9])
def test_regular_loss_is_a_finding_and_no_lower_rate(digits: int, tmp_path: Path) -> None:
    kept = np.arange(2000) % 10 != 9
    lines = rows(np.array(seconds(digits))[kept], NOISE[kept])
    recording = load_recording(text(tmp_path / "a.csv", "time [s],x [g]", *lines))
    assert recording.sample_rate == RATE
    assert any(finding.kind == "gaps" for finding in inspect_recording(recording).findings)


def test_a_counter_that_skips_tells_lost_samples(tmp_path: Path) -> None:
    kept = np.arange(2000) != 700
    lines = rows(np.arange(2000)[kept], NOISE[kept])
    recording = load_recording(text(tmp_path / "a.csv", "sample,x [g]", *lines), sample_rate=RATE)
    assert recording.channels == ("x",)
    assert recording.attributes["time_gaps"] == "sample skips 1 samples at 1 places"


def test_offsets_of_summer_time_are_instants(tmp_path: Path) -> None:
    start = datetime(2026, 10, 25, 2, 59, 59)
    stamps = []
    for number in range(2000):
        moment = start + timedelta(milliseconds=number)
        late = moment >= datetime(2026, 10, 25, 3)
        stamps.append((moment - timedelta(hours=late)).isoformat(timespec="milliseconds") + f"+0{2 - late}:00")
    recording = load_recording(text(tmp_path / "a.csv", "timestamp,x [g]", *rows(stamps, NOISE)))
    assert_noise(recording, rate=1000.0)
    assert "time_gaps" not in recording.attributes


def test_the_exponent_of_fortran_is_read_and_a_column_that_rises_evenly_is_the_clock(tmp_path: Path) -> None:
    lines = [f"  {t:.8E}  {x:.8E}".replace("E", "D") for t, x in zip(TIME, NOISE, strict=True)]
    assert_noise(load_recording(text(tmp_path / "a.dat", *lines), unit="g"))


@pytest.mark.parametrize(("unit", "scale"), [("ms", 1e3), ("us", 1e6), ("s", 1.0)])
@pytest.mark.parametrize("name", ["timestamp", "timestamps", "time_stamp"])
def test_counts_since_1970_are_a_clock(name: str, unit: str, scale: float, tmp_path: Path) -> None:
    stamps = [f"{(1774430000 + number / 100) * scale:.2f}" for number in range(2000)]
    assert_noise(load_recording(text(tmp_path / "a.csv", f"{name},x [g]", *rows(stamps, NOISE))), rate=100.0)


def test_the_unit_of_the_clock_can_be_stated(tmp_path: Path) -> None:
    path = text(tmp_path / "a.csv", "tick,x [g]", *rows(range(0, 200_000, 100), NOISE))
    assert_noise(load_recording(path, time_column="tick", time_unit="us"))
    with pytest.raises(DataError, match=r"'tick' is in 'furlong', .*time_unit"):
        load_recording(path, time_column="tick", time_unit="furlong")


def test_rows_of_two_sensors_by_turns_are_refused(tmp_path: Path) -> None:
    lines = [
        f"IMU,{n / 1000},1.{n % 7},2" + (f"\nBARO,{n / 1000},101325,21" if n % 10 == 0 else "") for n in range(900)
    ]
    with pytest.raises(DataError, match=r"rows are of 2 sensors by turns \(BARO, IMU\)"):
        load_recording(text(tmp_path / "a.csv", "IMU,time,ax,ay", "BARO,time,p,T", *lines))


def test_fewer_headings_than_columns_are_refused_with_both_numbers(tmp_path: Path) -> None:
    path = text(tmp_path / "a.csv", "time [s];x [g]", *rows(seconds(), NOISE, NOISE, separator=";"))
    with pytest.raises(DataError, match="line 1 has 2 headings for 3 columns"):
        load_recording(path)


def test_volts_become_accelerations_by_the_sensitivity(tmp_path: Path) -> None:
    path = text(tmp_path / "a.csv", "time [s],ai0 [mV]", *rows(seconds(), NOISE * 99.7))
    assert load_recording(path).unit == "mV"
    assert_noise(load_recording(path, sensitivity="99.7 mV/g"))
    assert_noise(load_recording(path, sensitivity="0.0997 V/(m/s^2)"), factor=1)
    with pytest.raises(DataError, match="is for channels in pC"):
        load_recording(path, sensitivity="99.7 pC/g")


# ---- containers


@pytest.mark.parametrize("stated", [0, 4000 - 1200, 0xFFFFFFFF])
def test_the_length_of_a_wav_file_is_believed_over_its_header(stated: int, tmp_path: Path) -> None:
    soundfile.write(tmp_path / "a.wav", NOISE / 10, 48000, subtype="PCM_16")
    content = bytearray((tmp_path / "a.wav").read_bytes())
    at = content.index(b"data") + 4
    content[at : at + 4] = struct.pack("<I", stated)
    whole = load_recording(tmp_path / "a.wav", unit="1").signal
    (tmp_path / "a.wav").write_bytes(content)
    np.testing.assert_array_equal(load_recording(tmp_path / "a.wav", unit="1").signal, whole)
    assert whole.shape == (1, 2000)


def write_tdms(path: Path, *segments: dict[str, tuple[np.ndarray, dict[str, Any]]]) -> Path:
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(str(path)) as writer:
        for segment in segments:
            writer.write_segment(
                [nptdms.ChannelObject("g", name, data, properties=facts) for name, (data, facts) in segment.items()]
            )
    return path


def waveform(start: str, rate: float = RATE, **more: Any) -> dict[str, Any]:
    return {
        "wf_start_time": np.datetime64(start),
        "wf_start_offset": 0.0,
        "wf_increment": 1 / rate,
        "unit_string": "g",
    } | more


def scaled(kind: str) -> dict[str, Any]:
    return {
        "NI_Number_Of_Scales": 1, "NI_Scaling_Status": "unscaled", "NI_Scale[0]_Scale_Type": kind,
        "NI_Scale[0]_Linear_Slope": 1e-5, "NI_Scale[0]_Linear_Y_Intercept": 0.0,
        "NI_Scale[0]_Linear_Input_Source": 0xFFFFFFFF,
    }  # fmt: skip


def test_raw_integers_of_a_tdms_file_are_scaled_and_an_unknown_scale_is_refused(tmp_path: Path) -> None:
    integers = np.round(NOISE * 1e5).astype(np.int32)
    facts = waveform("2026-03-02T09:14:07")
    assert_noise(load_recording(write_tdms(tmp_path / "a.tdms", {"x": (integers, facts | scaled("Linear"))})))
    path = write_tdms(tmp_path / "b.tdms", {"x": (integers, facts | scaled("Reciprocal"))})
    with pytest.raises(DataError, match="Unsupported scale type: Reciprocal"):
        load_recording(path)


def test_recordings_appended_to_one_channel_are_recordings_of_their_own(tmp_path: Path) -> None:
    path = write_tdms(
        tmp_path / "a.tdms",
        {"x": (NOISE, waveform("2026-03-02T09:14:07"))},
        {"x": (NOISE[:500], waveform("2026-03-02T11:00:00", 5000.0))},
    )
    with pytest.raises(DataError, match=r"several rates \(x \[1\]: 10000 Hz, x \[2\]: 5000 Hz\)"):
        load_recording(path)
    assert_noise(load_recording(path, channels=["x [1]"]))
    assert load_recording(path, channels=["x [2]"]).n_samples == 500
    goes_on = write_tdms(
        tmp_path / "b.tdms",
        {"x": (NOISE[:1000], waveform("2026-03-02T09:14:07"))},
        {"x": (NOISE[1000:], waveform("2026-03-02T09:14:07.100"))},
    )
    assert_noise(load_recording(goes_on))


def test_channels_that_start_apart_are_no_recording(tmp_path: Path) -> None:
    moments = ("2026-03-02T09:14:07", "2026-03-02T09:14:10")
    path = write_tdms(
        tmp_path / "a.tdms", {name: (NOISE, waveform(moment)) for name, moment in zip("ab", moments, strict=True)}
    )
    with pytest.raises(DataError, match=r"start at different times \(a: 2026-03-02T09:14:07"):
        load_recording(path)
    assert_noise(load_recording(path, channels=["a"]))


def write_universal(path: Path, count: int, sets: int, binary: bool) -> Path:
    write_uff(path, NOISE[None, :count], 1 / RATE, "g")
    lines = path.read_text().splitlines()
    at = next(number for number, line in enumerate(lines) if line.strip() == "58")
    content = b""
    for number in range(sets):
        head = [*lines[at - 1 : at + 1], f"point {number}".ljust(80), *lines[at + 2 : at + 12]]
        data = "\n".join(lines[at + 12 : -1]).encode() + b"\n"
        if binary:
            head[1] = f"    58b     1     2          11{8 * count:12d}     0     0           0           0"
            data = NOISE[:count].astype("<f8").tobytes()
        content += "\n".join(head).encode() + b"\n" + data + b"    -1\n"
    path.write_bytes(content)
    return path


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("sets", [1, 2, 3])
@pytest.mark.parametrize("binary", [False, True])
def test_a_universal_file_has_any_number_of_sets(binary: bool, sets: int, tmp_path: Path) -> None:
    path = write_universal(tmp_path / "a.uff", 1001, sets, binary)
    recording = load_recording(path)
    assert recording.signal.shape == (sets, 1001)
    np.testing.assert_allclose(recording.signal[-1], NOISE[:1001] * G, rtol=1e-6, atol=1e-6)


def test_matlab_objects_are_refused_by_name_or_left_out(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as file:
        file["T"] = np.array([[3707764736, 2, 1, 1, 1, 1]], np.uint32)
        file["T"].attrs.update({"MATLAB_class": np.bytes_("table"), "MATLAB_object_decode": np.int32(3)})
        file["fs"] = np.array([[RATE]])
        file["fs"].attrs["MATLAB_class"] = np.bytes_("double")
    with (tmp_path / "a.mat").open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    with pytest.raises(DataError, match="T is a MATLAB table, which cannot be read; save its columns"):
        load_recording(tmp_path / "a.mat", unit="g")


def test_structures_of_an_array_are_signals_of_their_own(tmp_path: Path) -> None:
    kind = [("name", "O"), ("fs", "O"), ("unit", "O"), ("data", "O")]
    signals = np.array([("acc_x", RATE, "g", NOISE), ("acc_y", RATE / 2, "g", NOISE[:1000])], dtype=kind)
    savemat(tmp_path / "a.mat", {"ch": signals})
    with pytest.raises(DataError, match=r"ch\.acc_x\.data: 10000 Hz, ch\.acc_y\.data: 5000 Hz"):
        load_recording(tmp_path / "a.mat")
    assert_noise(load_recording(tmp_path / "a.mat", channels=["ch.acc_x.data"]))


def test_the_layouts_of_labchart_and_testlab_are_known(tmp_path: Path) -> None:
    chart = {
        "data": np.concatenate([NOISE, NOISE / 2]), "datastart": [[1.0], [2001.0]], "dataend": [[2000.0], [4000.0]],
        "samplerate": [[RATE], [RATE]], "titles": np.array(["acc_x", "acc_y"]), "unittext": "g",
        "unittextmap": [[1.0], [1.0]], "com": np.arange(5.0),
    }  # fmt: skip
    savemat(tmp_path / "a.mat", chart)
    recording = load_recording(tmp_path / "a.mat")
    assert_noise(recording)
    assert recording.channels == ("acc_x", "acc_y")
    lab = {"x_values": {"start_value": 0.0, "increment": 1 / RATE}, "y_values": {"values": NOISE, "unit": "g"}}
    savemat(tmp_path / "b.mat", {"Signal": lab})
    assert_noise(load_recording(tmp_path / "b.mat"))


def in_hdf5(path: Path, values: np.ndarray, **facts: Any) -> Path:
    with h5py.File(path, "w") as file:
        file["acc"] = values
        file["acc"].attrs.update({"fs": RATE, "units": "g", **facts})
    return path


def test_scales_and_missing_values_of_hdf5_are_obeyed(tmp_path: Path) -> None:
    integers = np.round((NOISE - 0.5) * 1e3).astype(">i2")
    recording = load_recording(in_hdf5(tmp_path / "a.h5", integers, scale_factor=1e-3, add_offset=0.5))
    np.testing.assert_allclose(recording.signal[0], NOISE * G, atol=0.0006 * G)
    values = np.where(np.arange(2000) % 100 == 7, -9999.0, NOISE)
    recording = load_recording(in_hdf5(tmp_path / "b.h5", values, _FillValue=-9999.0))
    assert np.isnan(recording.signal).sum() == 20
    gained = in_hdf5(tmp_path / "c.h5", NOISE / 2, gain=2.0)
    with pytest.raises(DataError, match=r'states gain = 2, .* such as sensitivity = "2 g"'):
        load_recording(gained)
    assert_noise(load_recording(gained, sensitivity="2 g"))


def test_a_master_of_angles_and_invalid_samples_of_mdf_are_no_measurement(tmp_path: Path) -> None:
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF() as file:
        file.append([asammdf.Signal(NOISE, timestamps=TIME, name="acc", unit="g")])
        file.groups[0].channels[0].sync_type = 2
        file.save(tmp_path / "a.mf4", overwrite=True)
    with pytest.raises(DataError, match="counts angle, not time"):
        load_recording(tmp_path / "a.mf4")


@pytest.mark.parametrize("write", ["hdf5", "npz", "mat", "parquet"])
def test_a_clock_is_found_by_what_it_does_in_every_format(write: str, tmp_path: Path) -> None:
    columns = {"a": TIME, "b": NOISE}
    path = tmp_path / f"a.{'h5' if write == 'hdf5' else write}"
    if write == "hdf5":
        with h5py.File(path, "w") as file:
            for name, values in columns.items():
                file[name] = values
    elif write == "parquet":
        pytest.importorskip("polars").DataFrame(columns).write_parquet(path)
    elif write == "npz":
        np.savez(path, a=TIME, b=NOISE)
    else:
        savemat(path, columns)
    recording = load_recording(path, unit="g")
    assert recording.channels == ("b",)
    assert_noise(recording)
