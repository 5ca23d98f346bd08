"""Properties of files that users of readers have reported publicly, and their kin: read right, or
refused by name.
"""

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import soundfile
from recording_files import write_uff
from scipy import sparse
from scipy.io import savemat

from swashtwin.foundation import DataError
from swashtwin.recordings import load_recording

RATE, G = 10_000.0, 9.80665
NOISE = np.random.default_rng(4).normal(size=401).round(4)
TIME = np.arange(401) / RATE
TIMES = [f"{value:.4f}" for value in TIME]
COUNTS = np.round(NOISE * 1e4).astype(np.int16)
FILL = np.arange(401) % 100 == 7


def text(name: str, *lines: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        (folder / name).write_text("\n".join(lines) + "\n", encoding="utf-8")
        return folder / name

    return write


def rows(separator: str, *columns: Any, end: str = "") -> list[str]:
    return [separator.join(map(str, row)) + end for row in zip(*columns, strict=True)]


def commas(values: Any) -> list[str]:
    return [str(value).replace(".", ",") for value in values]


def tdms(values: np.ndarray, **facts: Any) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        nptdms = pytest.importorskip("nptdms")
        facts_all = {
            "wf_increment": 1 / RATE,
            "unit_string": "g",
            "NI_Scaling_Status": "unscaled",
        } | facts
        with nptdms.TdmsWriter(str(folder / "a.tdms")) as writer:
            writer.write_segment([nptdms.ChannelObject("group", "x", values, properties=facts_all)])
        return folder / "a.tdms"

    return write


def linear(number: int, slope: float, source: int) -> dict[str, Any]:
    head = f"NI_Scale[{number}]_"
    return {
        head + "Scale_Type": "Linear", head + "Linear_Slope": slope, head + "Linear_Y_Intercept": 0.0,
        head + "Linear_Input_Source": source, "NI_Number_Of_Scales": number + 1,
    }  # fmt: skip


def daqmx(folder: Path) -> Path:
    """Raw data of a DAQmx task with a linear scale, as LabVIEW streams it to the disk."""
    made = pytest.importorskip("nptdms.test.test_daqmx")
    text_of, number = made.string_hexlify, made.hexlify_value
    facts = {
        "NI_Number_Of_Scales": (3, number("<i", 2)),
        "NI_Scaling_Status": (0x20, number("<I", 8) + text_of("unscaled")),
        "NI_Scale[1]_Scale_Type": (0x20, number("<I", 6) + text_of("Linear")),
        "NI_Scale[1]_Linear_Slope": (10, number("<d", 1e-4)),
        "NI_Scale[1]_Linear_Y_Intercept": (10, number("<d", 0.0)),
        "NI_Scale[1]_Linear_Input_Source": (7, number("<I", 0)),
        "wf_increment": (10, number("<d", 1 / RATE)),
        "unit_string": (0x20, number("<I", 1) + text_of("g")),
    }
    channel = made.daqmx_channel_metadata(
        "x", len(COUNTS), [2], [made.daqmx_scaler_metadata(0, 3, 0)], facts
    )
    file = made.GeneratedFile()
    head = made.segment_objects_metadata(made.root_metadata(), made.group_metadata(), channel)
    file.add_segment(made.segment_toc(), head, COUNTS.astype("<i2").tobytes(), binary_data=True)
    (folder / "a.tdms").write_bytes(file.get_bytes_io_file().getvalue())
    return folder / "a.tdms"


def universal(kind: str, *, tail: bytes = b"", even: bool = True) -> Callable[[Path], Path]:
    """A universal file whose samples are text, or binary in double (d) or single precision (f)."""

    def write(folder: Path) -> Path:
        path = folder / "a.uff"
        write_uff(path, NOISE[None], 1 / RATE, "g")
        lines = path.read_text(encoding="ascii").splitlines()
        at = next(number for number, line in enumerate(lines) if line.strip() == "58")
        head = lines[at - 1 : at + 12]
        numbers = NOISE if even else np.ravel([[*TIME, 0.0], [*NOISE, 0.0]], order="F")
        fields = [f"{number:13.5E}" for number in numbers]
        data = "\n".join("".join(fields[n : n + 6]) for n in range(0, len(fields), 6)).encode()
        head[8] = f"{4 if kind == 'd' else 2:10d}{401:10d}{int(even):10d}" + head[8][30:]
        if kind in "df":
            data = NOISE.astype(f"<f{8 if kind == 'd' else 4}").tobytes()
            head[1] = (
                f"    58b     1     2          11{len(data):12d}     0     0           0           0"
            )
        path.write_bytes(
            "\n".join(head).encode()
            + b"\n"
            + data
            + tail
            + (b"" if kind in "df" else b"\n")
            + b"    -1\n"
        )
        return path

    return write


def wav(stated: int, tail: bytes = b"") -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        soundfile.write(folder / "a.wav", NOISE / 8, int(RATE), subtype="FLOAT")
        content = bytearray((folder / "a.wav").read_bytes())
        at = content.index(b"data") + 4
        content[4:8], content[at : at + 4] = (
            struct.pack("<I", stated & 0xFFFFFFFF),
            struct.pack("<I", stated),
        )
        (folder / "a.wav").write_bytes(content[: at + 4 + 401 * 4] + tail if tail else content)
        return folder / "a.wav"

    return write


def rf64(folder: Path) -> Path:
    soundfile.write(folder / "a.wav", NOISE / 8, int(RATE), subtype="FLOAT", format="RF64")
    return folder / "a.wav"


def mat(**variables: Any) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        savemat(folder / "a.mat", variables)
        return folder / "a.mat"

    return write


def hdf5(
    values: np.ndarray, of_file: dict[str, Any] | None = None, **facts: Any
) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        with h5py.File(folder / "a.h5", "w") as file:
            file["x"] = values
            file.attrs.update(of_file or {})
            file["x"].attrs.update({"sampling_rate": "10 kHz", "units": "g", **facts})
        return folder / "a.h5"

    return write


def mdf(**facts: Any) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        asammdf = pytest.importorskip("asammdf")
        with asammdf.MDF() as file:
            file.append([asammdf.Signal(NOISE, timestamps=TIME, name="x", unit="g", **facts)])
            file.save(folder / "a.mf4", overwrite=True)
        return folder / "a.mf4"

    return write


LVM = [
    "LabVIEW Measurement", "Separator{0}{1}", "Decimal_Separator{0}.", "X_Columns{0}One", "***End_of_Header***", "",
    "Notes{0}X values guaranteed valid only for acc_x", "Channels{0}1", "Samples{0}401", "Date{0}2016/08/11",
    "Time{0}15:37:48.375", "Y_Unit_Label{0}g", "X_Dimension{0}Time", "X0{0}0.0", "Delta_X{0}1.0E-4",
    "***End_of_Header***", "X_Value{0}x{0}Comment",
]  # fmt: skip
TAB = [line.format("\t", "Tab") for line in LVM]
COMMA = [line.format(",", "Comma") for line in LVM]
OBJECT = np.array([0xDD000000, 2, 1, 1, 1, 1], np.uint32)[:, None]
CELLS = np.array([("x", NOISE, {"unit": "g"})], dtype=[("name", "O"), ("data", "O"), ("meta", "O")])
MISSING = np.where(FILL, np.nan, NOISE)
TWICE = [*rows("\t", TIMES, NOISE, end="\t"), *rows("\t", TIMES, NOISE, end="\t")]
NPTDMS, PYUFF, SCIPY = "adamreeve/npTDMS", "ladisk/pyuff", "scipy/scipy"

# where it was reported | file | options | samples [g] at 10 kHz, or a part of the refusal
READ: list[tuple[str, Callable[[Path], Path], dict[str, Any], Any]] = [
    (f"{NPTDMS}/issues/64", tdms(COUNTS, **linear(0, 1e-4, 0xFFFFFFFF)), {}, NOISE),
    (f"{NPTDMS}/issues/120", tdms(COUNTS, **(linear(0, 1e-3, 0xFFFFFFFF) | linear(1, 0.1, 0))), {}, NOISE),
    (f"{NPTDMS}/issues/125", daqmx, {}, NOISE),
    (f"{NPTDMS}/issues/91", tdms(COUNTS, **(linear(0, 1.0, 0) | {"NI_Scale[0]_Scale_Type": "PieceWisePolynomial"})), {},
     "Unsupported scale type: PieceWisePolynomial"),
    (f"{PYUFF}/issues/22", universal("a", even=False), {}, NOISE),
    (f"{PYUFF}/issues/29", universal("a", tail=b" " * 13), {}, NOISE),
    (f"{PYUFF}/issues/38", universal("d", tail=b"\n"), {}, NOISE),
    (f"{PYUFF}/issues/61", universal("f"), {}, NOISE),
    (f"{SCIPY}/issues/7895", mat(s=CELLS, fs=RATE), {"unit": "g"}, NOISE),
    ("tbeu/matio/issues/359", mat(s={"t": OBJECT}, fs=RATE), {}, r"left out: s\.t \(a MATLAB object\)"),
    ("skjerns/mat7.3/issues/28", mat(x=sparse.csc_matrix(NOISE[:, None]), fs=RATE, unit="g"), {}, NOISE),
    ("naudio/NAudio/issues/688", wav(0xFFFFFFFF), {"unit": "g"}, NOISE / 8),
    ("rs1729/RS/issues/39", wav(0), {"unit": "g"}, NOISE / 8),
    ("breakfastquay/rubberband/issues/101", wav(401 * 4 - 1200), {"unit": "g"}, NOISE / 8),
    ("SatDump/SatDump/pull/340", rf64, {"unit": "g"}, NOISE / 8),
    ("pola-rs/polars/issues/10585", text("a.csv", "t [s],x [g]", *rows(",", TIMES, NOISE), "0.0401,1,2"), {},
     "line 403 has 3 columns, not 2"),
    ("pola-rs/polars/issues/18797", text("a.csv", "t;x", *rows(";", commas(TIMES), ["1.299,99"] * 401)), {},
     "marks for thousands"),
    ("MilesMcBain/datapasta/issues/27", text("a.csv", "t [s],x [g]", *rows(",", TIMES, NOISE, end=",")), {}, NOISE),
    ("mccdaq/daqhats/issues/15", text("a.txt", *rows("   ", commas(TIMES), commas(NOISE))), {"unit": "g"}, NOISE),
    ("ladisk/lvm_read/issues/5", text("a.lvm", *TAB, *rows("\t", TIMES, NOISE, end="\t")), {}, NOISE),
    ("ladisk/lvm_read/pull/15", text("a.lvm", *COMMA, *rows(",", TIMES, NOISE, end=",")), {}, NOISE),
    ("ladisk/lvm_read/pull/10", text("a.lvm", *TAB, *TWICE), {}, r"x \[2\]: sample 401 of the file"),
    ("ladisk/lvm_read/pull/10", text("a.lvm", *TAB, *TWICE), {"channels": ["x [2]"]}, NOISE),
    ("Unidata/netcdf4-python/issues/554", hdf5(COUNTS, scale_factor=1e-4, valid_min=np.int16(-32000)), {}, NOISE),
    ("HDFGroup/h5pyd/issues/44", hdf5(np.where(FILL, 1e37, NOISE).astype("f4"), _FillValue=1e37), {}, MISSING),
    ("opera-adt/COMPASS/pull/167", hdf5(np.where(FILL, -9.0e3, NOISE), fill_value=-9.0e3), {}, MISSING),
    ("nasa-jpl/autoRIFT/pull/92", hdf5(np.where(FILL, 32767, COUNTS), scale_factor=1e-4, valid_range=[-32000, 32000]),
     {}, MISSING),
    ("danielhrisca/asammdf/issues/96", mdf(invalidation_bits=FILL), {}, MISSING),
]  # fmt: skip

EPOCH = [f"{1774430000 + value:.4f}" for value in TIME]
VOLTS = (NOISE * 0.1).round(6)
SHORT = text("a.csv", "t [s],x [g],y [g],z [g]", *rows(",", TIMES, NOISE, NOISE))
HEAD = [
    "Record Length,401,Points",
    "Sample Interval,1.0E-04,s",
    "Vertical Units,V",
    "Sensitivity (mV/g):,100",
    "n,x",
]
TAGS = ["ACC" if number % 3 else "GYR" for number in range(401)]
LISTS = mat(data=NOISE[:, None] * [1, 2], names=np.array(["x", "p"], object), units=np.array(["g", "bar"], object),
            Ts=1e-4)  # fmt: skip
CHART = mat(data=COUNTS, datastart=[[1.0]], dataend=[[401.0]], samplerate=[[RATE]], titles=np.array(["x"]),
            unittext=np.array(["g"]), unittextmap=[[1.0]], scaleunits=[[1e-4]], scaleoffset=[[0.0]])  # fmt: skip
SENSED = text("a.csv", "Sensitivity: 100 mV/g", "t [s],x", *rows(",", TIMES, VOLTS))
LATE = [str(x) if number < 399 else f"{x:.6e}".replace("e", "D") for number, x in enumerate(NOISE)]
RECORDS = np.rec.fromarrays([TIME, NOISE], names="t,x")


def npz(**arrays: np.ndarray) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        np.savez(folder / "a.npz", **arrays)
        return folder / "a.npz"

    return write


def of_samples(folder: Path) -> Path:
    """An MDF file whose master channel counts samples."""
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF() as file:
        file.append([asammdf.Signal(NOISE, timestamps=TIME, name="x", unit="g")])
        file.groups[0].channels[0].sync_type = 4
        file.save(folder / "a.mf4", overwrite=True)
    return folder / "a.mf4"


READ += [
    ("no time column", text("a.lvm", *TAB, *(f"\t{x}\t" for x in NOISE)), {}, NOISE),
    ("preamble of a scope", text("a.csv", *HEAD, *rows(",", range(401), VOLTS)), {}, NOISE),
    ("start and increment", text("a.csv", "X,CH1,Start,Increment,", "Sequence,Volt,0.0,1.0e-04",
                                 *rows(",", range(401), NOISE, end=",")), {"unit": "g"}, NOISE),
    ("two clocks", text("a.csv", "t1 [s],x [g],t2 [s],y [g]", *rows(",", TIMES, NOISE, TIMES, NOISE)),
     {"channels": ["x"]}, NOISE),
    ("hours", text("a.csv", "time (h),x [g]", *rows(",", TIME / 3600, NOISE)), {}, NOISE),
    ("days", text("a.csv", "t,x [g]", *rows(",", 46083 + TIME / 86400, NOISE)), {}, NOISE),
    ("seconds since 1970", text("a.csv", "c0,x [g]", *rows(",", EPOCH, NOISE)), {}, NOISE),
    ("ticks", text("a.csv", "tick,x [g]", *rows(",", range(0, 40100, 100), NOISE)), {}, "would be 0.01 Hz"),
    ("ticks", text("a.csv", "tick,x [g]", *rows(",", range(0, 40100, 100), NOISE)), {"time_unit": "us"}, NOISE),
    ("lost or coarse", text("a.csv", "t [s],x [g]", *rows(",", *(np.delete(each, range(3, 401, 4)) for each in
                                                                 (TIMES, NOISE)))), {}, "too coarse to tell 10000 Hz"),
    ("counter begins again", text("a.csv", "n,t [s],x [g]", *rows(",", np.arange(401) % 256, TIMES, NOISE)), {}, NOISE),
    ("tags in the last column", text("a.csv", "t,x,sensor", *rows(",", TIMES, NOISE, TAGS)), {}, "2 sensors by turns"),
    ("tags as numbers", text("a.csv", *rows(",", np.arange(401) % 3, TIMES, NOISE)), {}, "3 sensors by turns"),
    ("more headings", SHORT, {}, "line 1 has 4 headings for 3 columns"),
    ("overflow", text("a.csv", "t [s],x [g]", *rows(",", TIMES, ["\u221e", *NOISE[1:]])), {},
     np.array([np.inf, *NOISE[1:]])),
    ("offset in hours", text("a.csv", "t,x [g]", *rows(",", [f"2026-03-02 09:00:00.{n:04d}+02" for n in range(401)],
                                                       NOISE)), {}, NOISE),
    ("two rates", text("a.csv", "Sample rate: 20000", "t [s],x [g]", *rows(",", TIMES, NOISE)), {},
     "two sample rates for x"),
    ("two rates", text("a.csv", "Sample rate: 20000", "t [s],x [g]", *rows(",", TIMES, NOISE)), {"time_column": "t"},
     NOISE),
    ("times that stand", text("a.csv", "timestamp,t [s],x [g]", *rows(",", [EPOCH[0]] * 401, TIMES, NOISE)), {}, NOISE),
    ("words for missing", text("a.csv", "t [s],x [g]", *rows(",", TIMES, np.where(FILL, "N/A", NOISE.astype(str)))), {},
     MISSING),
    ("rate of the group", tdms(NOISE, wf_increment=0.0, **{"Sampling Rate": RATE}), {}, NOISE),
    ("along a frequency", tdms(NOISE, wf_xunit_string="Hz"), {}, "runs along Hz, not time"),
    ("sensitivity of a channel", tdms(VOLTS, unit_string="V", Sensitivity=100.0, **{"Sensitivity Units": "mV/g"}), {},
     NOISE),
    ("lists of names and units", LISTS, {"channels": ["x"]}, NOISE),
    ("integers of LabChart", CHART, {}, NOISE),
    ("complex numbers", mat(x=NOISE + 1j, fs=RATE), {}, r"left out: x \(complex numbers\)"),
    ("calendar times", npz(time=np.datetime64("2026-03-02", "ns") + np.arange(401) * 100_000, x=NOISE), {"unit": "g"},
     NOISE),
    ("fields", npz(record=RECORDS), {"unit": "g"}, NOISE),
    ("samples count", of_samples, {}, "counts samples, not time. Add sample_rate"),
    ("samples count", of_samples, {"sample_rate": RATE}, NOISE),
    *((f"stated as {line}", text("a.csv", line, "Unit: g", "x", *rows(",", NOISE)), {}, NOISE) for line in (
        "Sample rate: 10 kS/s", "Samples per second: 10000", "ODR: 10000 Hz", '"Sampling Rate","10000","Hz"',
        "fs = 10000 # Hz", "Acquisition rate: 10000 samples/second", "\u0394T: 1e-4 s")),
    ("thousands", text("a.txt", "Sample rate: 10,000 Hz", "Unit: g", "", *rows(" ", NOISE, NOISE)), {},
     "does not state its sample rate"),
    ("numbered headings", text("a.csv", "t [s],Y[0],Y[1]", *rows(",", TIMES, NOISE, NOISE)),
     {"unit": "g", "channels": ["Y[1]"]}, NOISE),
    ("parentheses in a unit", text("a.csv", "t,x", "s,m/(s^2)", *rows(",", TIMES, NOISE)), {}, NOISE / G),
    ("words for missing", text("a.csv", "t [s],x [g]", *rows(",", TIMES, np.where(FILL, "1.#QNAN", NOISE.astype(str)))),
     {}, MISSING),
    ("time in a matrix with a unit", mat(data=np.stack([TIME, NOISE], axis=1), fs=RATE, unit="g"), {}, NOISE),
    ("X against Y", mat(X=TIME, Y=NOISE[:, None], unit="g"), {}, NOISE),
    ("layout of PicoScope", mat(Tstart=0.0, Tinterval=1e-4, Length=401, A=NOISE), {"unit": "g"}, NOISE),
    ("rate in kHz", mat(x=NOISE, fs_kHz=10.0, unit="g"), {}, NOISE),
    ("line of types", text("a.csv", "t;x", "s;g", "float;float", *rows(";", TIMES, NOISE)), {}, NOISE),
    ("names of cells", mat(data=np.array([NOISE, NOISE * 2, None], object)[:2], names=np.array(["x", "p"], object),
                           units=np.array(["g", "bar"], object), fs=RATE), {}, NOISE),
    ("layout of Testlab", mat(s={"x_values": {"increment": 1e-4}, "y_values": {
        "values": NOISE, "quantity": {"label": "g"}}}), {}, NOISE),
    ("another word for a scale", hdf5(COUNTS, Calibration_Factor=1e-4), {}, "calibration_factor = 0.0001, and not"),
    ("milliseconds that count", mat(data=np.stack([np.arange(401) / 10, NOISE], axis=1), unit="g"),
     {"time_unit": "ms"}, NOISE),
    ("sensitivity of each", text("a.csv", "Channel,x,y", "Sensitivity,100 mV/g,50 mV/g", "Unit,V,V", "t [s],x,y",
                                 *rows(",", TIMES, VOLTS, VOLTS)), {"channels": ["y"]}, 2 * NOISE),
    ("unit after in", text("a.csv", "Time in seconds,x in m/s\u00b2", *rows(",", TIMES, NOISE)), {}, NOISE / G),
    ("headings of numpy", text("a.dat", "# t [s] x [g]", *rows(" ", TIMES, NOISE)), {}, NOISE),
    ("no column of comments", text("a.lvm", *TAB, *rows("\t", TIMES, NOISE)), {}, NOISE),
    ("a sensor now and then", text("a.csv", "t,sensor,x", *rows(",", TIMES, COUNTS % 8 == 0, NOISE)), {},
     "2 sensors by turns"),
    ("rate with a suffix", hdf5(NOISE, sampling_rate=[], fs_khz=10.0), {}, NOISE),
    ("gain that is applied", hdf5(NOISE / 2, gain=2.0), {"sensitivity": "2 g"}, NOISE),
    ("time beside a stated rate", mat(data=np.stack([TIME, NOISE], axis=1), fs=RATE), {"unit": "g"}, NOISE),
    ("ramp beside a stated rate", mat(data=np.stack([0.3 * TIME, NOISE], axis=1), fs=RATE), {"unit": "g"}, NOISE),
    ("frequency of the mains", text("a.csv", "Frequency: 50 Hz", "Unit: g", "x", *rows(",", NOISE)), {},
     "does not state its sample rate"),
    ("angle", text("a.csv", "angle,x [g]", *rows(",", 36 * TIME, NOISE)), {}, "does not state its sample rate"),
    ("angle", text("a.csv", "angle,x [g]", *rows(",", 36 * TIME, NOISE)), {"sample_rate": RATE}, NOISE),
    ("sensitivity without volts", SENSED, {}, "unit='V' or unit='mV'"),
    ("sensitivity without volts", SENSED, {"unit": "g"}, VOLTS),  # applied already, as is said
    ("sensitivity without volts", SENSED, {"unit": "V"}, NOISE),
    ("scale in words", hdf5(COUNTS, gain="0.0001 g"), {}, "gain = 0.0001 g.* sensitivity='0.0001 g'"),
    ("scale in words", hdf5(COUNTS, gain="0.0001 g"), {"sensitivity": "0.0001 g"}, NOISE),
    ("scale of the file", hdf5(COUNTS, of_file={"scale_factor": 1e-4}), {}, NOISE),
    ("one unit for two", text("a.csv", "Sensitivity: 100, 10.2 mV/g", "t [s],x [V],y [V]",
                              *rows(",", TIMES, VOLTS, VOLTS)), {"channels": ["x"]}, NOISE),
    ("sensitivity without a unit", hdf5(VOLTS, units="V", Sensitivity=100), {}, "sensitivity 100 of 'x' without"),
    ("two names for three", hdf5(np.stack([NOISE] * 3), channel_names=["acc", "acc", "ref"]), {"channels": ["x/2"]},
     NOISE),
    ("one bound", hdf5(NOISE, valid_range=[4.0]), {}, "states 1 numbers as valid_range, and not 2"),
    ("two scales", hdf5(np.stack([COUNTS] * 3), scale_factor=[1e-4, 1.0]), {}, "2 numbers as scale_factor, and not 1"),
    ("zeros behind the samples", wav(401 * 4, b"\0" * 4096), {"unit": "g"}, NOISE / 8),
    ("half a frame behind", wav(401 * 4, b"\1\2"), {"unit": "g"}, NOISE / 8),
    ("late exponents", text("a.csv", "t [s],x [g]", *rows(",", TIMES, LATE)), {}, NOISE),
    ("typographic minus", text("a.csv", "t [s],x [g]",
                               *rows(",", TIMES, [str(x).replace("-", "\u2212") for x in NOISE])), {}, NOISE),
    ("lists beside a matrix", hdf5(np.stack([NOISE, NOISE]), names=["x", "tach"], units=["g", "V"]),
     {"channels": ["x/x"]}, NOISE),
]  # fmt: skip


@pytest.mark.parametrize(
    ("thread", "write", "options", "right"), READ, ids=[row[0] for row in READ]
)
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_file_as_publicly_reported_is_read_right_or_refused(
    thread: str, write: Callable[[Path], Path], options: dict[str, Any], right: Any, tmp_path: Path
) -> None:
    path = write(tmp_path)
    if isinstance(right, str):
        with pytest.raises(DataError, match=right):
            load_recording(path, **options)
        return
    recording = load_recording(path, **options)
    assert recording.sample_rate == pytest.approx(RATE, rel=1e-6)
    assert (recording.n_channels, recording.unit) == (1, "m/s^2")
    np.testing.assert_allclose(recording.signal[0], right * G, rtol=1e-5, atol=1e-5)
