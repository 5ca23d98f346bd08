"""Binary files as users of other readers have reported them are read right, or refused by name.

Unless a case says otherwise, a file holds `NOISE` in g at 10 kHz. A comment that begins with
``owner/project`` names the public thread that reported such a file.
"""

import struct
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import soundfile
from recording_files import write_uff
from reported_cases import (
    COUNTS,
    IS_MISSING,
    N_SAMPLES,
    NOISE,
    NOISE_WITH_GAPS,
    RATE,
    READ_CASE,
    REFUSED_CASE,
    TIME,
    VOLTS,
    FileWriter,
    assert_reads,
    assert_refuses,
    reads,
    refuses,
)
from scipy import sparse
from scipy.io import savemat

# Some of the libraries leave a file open that they cannot read.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")


# ---- TDMS


def tdms_file(values: np.ndarray, **properties: Any) -> FileWriter:
    """Return a writer of a TDMS file of one channel with properties, by default 10 kHz and g."""

    def write(folder: Path) -> Path:
        nptdms = pytest.importorskip("nptdms")
        channel_properties = {
            "wf_increment": 1 / RATE,
            "unit_string": "g",
            "NI_Scaling_Status": "unscaled",
            **properties,
        }
        channel = nptdms.ChannelObject("group", "x", values, properties=channel_properties)
        with nptdms.TdmsWriter(str(folder / "a.tdms")) as writer:
            writer.write_segment([channel])
        return folder / "a.tdms"

    return write


# Input of a scale that is the raw data, not the output of another scale.
RAW_DATA = 0xFFFFFFFF


def linear_scale(number: int, slope: float, source: int) -> dict[str, Any]:
    """Return the properties of a linear scale whose input is the scale `source`."""
    prefix = f"NI_Scale[{number}]_"
    return {
        f"{prefix}Scale_Type": "Linear",
        f"{prefix}Linear_Slope": slope,
        f"{prefix}Linear_Y_Intercept": 0.0,
        f"{prefix}Linear_Input_Source": source,
        "NI_Number_Of_Scales": number + 1,
    }


def daqmx_file(folder: Path) -> Path:
    """Write raw data of a DAQmx task with a linear scale, as LabVIEW streams it to the disk."""
    nptdms_files = pytest.importorskip("nptdms.test.test_daqmx")
    hex_text = nptdms_files.string_hexlify
    hex_number = nptdms_files.hexlify_value

    # Each property has a type, 0x20 for text, and its value with the length of a text before it.
    properties = {
        "NI_Number_Of_Scales": (3, hex_number("<i", 2)),
        "NI_Scaling_Status": (0x20, hex_number("<I", 8) + hex_text("unscaled")),
        "NI_Scale[1]_Scale_Type": (0x20, hex_number("<I", 6) + hex_text("Linear")),
        "NI_Scale[1]_Linear_Slope": (10, hex_number("<d", 1e-4)),
        "NI_Scale[1]_Linear_Y_Intercept": (10, hex_number("<d", 0.0)),
        "NI_Scale[1]_Linear_Input_Source": (7, hex_number("<I", 0)),
        "wf_increment": (10, hex_number("<d", 1 / RATE)),
        "unit_string": (0x20, hex_number("<I", 1) + hex_text("g")),
    }
    scaler = nptdms_files.daqmx_scaler_metadata(0, 3, 0)
    channel = nptdms_files.daqmx_channel_metadata("x", N_SAMPLES, [2], [scaler], properties)

    file = nptdms_files.GeneratedFile()
    metadata = nptdms_files.segment_objects_metadata(
        nptdms_files.root_metadata(), nptdms_files.group_metadata(), channel
    )
    samples = COUNTS.astype("<i2").tobytes()
    file.add_segment(nptdms_files.segment_toc(), metadata, samples, binary_data=True)
    (folder / "a.tdms").write_bytes(file.get_bytes_io_file().getvalue())
    return folder / "a.tdms"


@pytest.mark.parametrize(
    READ_CASE,
    [
        # adamreeve/npTDMS/issues/64
        reads("linear scale", tdms_file(COUNTS, **linear_scale(0, 1e-4, RAW_DATA))),
        # adamreeve/npTDMS/issues/120: the second scale converts what the first one returns.
        reads(
            "chain of two scales",
            tdms_file(COUNTS, **(linear_scale(0, 1e-3, RAW_DATA) | linear_scale(1, 0.1, 0))),
        ),
        # adamreeve/npTDMS/issues/125
        reads("raw data of a DAQmx task", daqmx_file),
        # Programs without waveforms leave the increment at 0 and state the rate as they like.
        reads(
            "rate as a property of another name",
            tdms_file(NOISE, wf_increment=0.0, **{"Sampling Rate": RATE}),
        ),
        reads(
            "sensitivity and its unit in two properties",
            tdms_file(VOLTS, unit_string="V", Sensitivity=100.0, **{"Sensitivity Units": "mV/g"}),
        ),
    ],
)
def test_properties_of_a_tdms_channel_give_its_scale_and_rate(
    write: FileWriter, options: dict[str, Any], expected: np.ndarray, tmp_path: Path
) -> None:
    assert_reads(write(tmp_path), options, expected)


@pytest.mark.parametrize(
    REFUSED_CASE,
    [
        # adamreeve/npTDMS/issues/91: raw counts are not returned in place of the scaled samples.
        refuses(
            "scale of an unknown type",
            tdms_file(
                COUNTS,
                **linear_scale(0, 1.0, 0) | {"NI_Scale[0]_Scale_Type": "PieceWisePolynomial"},
            ),
            "Unsupported scale type: PieceWisePolynomial",
        ),
        # A spectrum has an increment too, which is no sample period.
        refuses(
            "samples along a frequency",
            tdms_file(NOISE, wf_xunit_string="Hz"),
            "runs along Hz, not time",
        ),
    ],
)
def test_a_tdms_channel_that_is_no_scaled_time_signal_is_refused(
    write: FileWriter, options: dict[str, Any], message: str, tmp_path: Path
) -> None:
    assert_refuses(write(tmp_path), options, message)


# ---- universal files


def uff_file(
    data: bytes, *, data_type: int = 2, is_even: bool = True, is_binary: bool = False
) -> FileWriter:
    """Return a writer of a universal file with this block of data.

    Parameters
    ----------
    data_type : 2 for single and 4 for double precision.
    is_even : False if the data state the time of each sample.
    """

    def write(folder: Path) -> Path:
        path = folder / "a.uff"
        write_uff(path, NOISE[None], 1 / RATE, "g")
        lines = path.read_text(encoding="ascii").splitlines()

        # The head of a data set 58 begins before its number and has eleven records.
        number_line = next(number for number, line in enumerate(lines) if line.strip() == "58")
        head = lines[number_line - 1 : number_line + 12]
        head[8] = f"{data_type:10d}{N_SAMPLES:10d}{int(is_even):10d}" + head[8][30:]
        if is_binary:
            n_bytes = len(data.rstrip(b"\n"))
            head[1] = (
                f"    58b     1     2          11{n_bytes:12d}     0     0           0           0"
            )

        path.write_bytes("\n".join(head).encode() + b"\n" + data + b"    -1\n")
        return path

    return write


def uff_text(numbers: np.ndarray) -> bytes:
    """Return numbers as the text of a universal file, six fields of 13 characters a line."""
    fields = [f"{number:13.5E}" for number in numbers]
    lines = ["".join(fields[start : start + 6]) for start in range(0, len(fields), 6)]
    return "\n".join(lines).encode()


@pytest.mark.parametrize(
    READ_CASE,
    [
        # ladisk/pyuff/issues/22: a pair of zeros more than the head states.
        reads(
            "pairs of time and value",
            uff_file(
                uff_text(np.column_stack([[*TIME, 0.0], [*NOISE, 0.0]]).ravel()) + b"\n",
                is_even=False,
            ),
        ),
        # ladisk/pyuff/issues/29: the last line is filled with an empty field.
        reads("blanks after the last number", uff_file(uff_text(NOISE) + b" " * 13 + b"\n")),
        # ladisk/pyuff/issues/38: a line break follows the bytes, which their count leaves out.
        reads(
            "binary, double precision",
            uff_file(NOISE.astype("<f8").tobytes() + b"\n", data_type=4, is_binary=True),
        ),
        # ladisk/pyuff/issues/61
        reads(
            "binary, single precision",
            uff_file(NOISE.astype("<f4").tobytes(), data_type=2, is_binary=True),
        ),
    ],
)
def test_a_universal_file_of_any_layout_is_read(
    write: FileWriter, options: dict[str, Any], expected: np.ndarray, tmp_path: Path
) -> None:
    assert_reads(write(tmp_path), options, expected)


# ---- MATLAB


def mat_file(**variables: Any) -> FileWriter:
    def write(folder: Path) -> Path:
        savemat(folder / "a.mat", variables)
        return folder / "a.mat"

    return write


def cells(*values: Any) -> np.ndarray:
    """Return a row of MATLAB cells."""
    array = np.empty(len(values), dtype=object)
    array[:] = values
    return array


# A structure array with the samples and their unit in fields.
STRUCTURES = np.array(
    [("x", NOISE, {"unit": "g"})], dtype=[("name", "O"), ("data", "O"), ("meta", "O")]
)

# What version 5 of the format holds in place of an object, such as a datetime.
OPAQUE_OBJECT = np.array([0xDD000000, 2, 1, 1, 1, 1], np.uint32)[:, None]

# LabChart exports the integers of its converter, and the scale of each channel and block.
LABCHART = {
    "data": COUNTS,
    "datastart": [[1.0]],
    "dataend": [[401.0]],
    "samplerate": [[RATE]],
    "titles": np.array(["x"]),
    "unittext": np.array(["g"]),
    "unittextmap": [[1.0]],
    "scaleunits": [[1e-4]],
    "scaleoffset": [[0.0]],
}

# Siemens Testlab exports nested structures.
TESTLAB = {
    "x_values": {"increment": 1e-4},
    "y_values": {"values": NOISE, "quantity": {"label": "g"}},
}

TIME_AND_NOISE = np.stack([TIME, NOISE], axis=1)


@pytest.mark.parametrize(
    READ_CASE,
    [
        # scipy/scipy/issues/7895
        reads("structure array", mat_file(s=STRUCTURES, fs=RATE), unit="g"),
        # skjerns/mat7.3/issues/28
        reads("sparse vector", mat_file(x=sparse.csc_matrix(NOISE[:, None]), fs=RATE, unit="g")),
        reads("export of LabChart", mat_file(**LABCHART)),
        reads("export of Testlab", mat_file(s=TESTLAB)),
        reads(
            "export of PicoScope",
            mat_file(Tstart=0.0, Tinterval=1e-4, Length=N_SAMPLES, A=NOISE),
            unit="g",
        ),
        reads(
            "lists of names and units of a matrix",
            mat_file(
                data=NOISE[:, None] * [1, 2],
                names=cells("x", "p"),
                units=cells("g", "bar"),
                Ts=1e-4,
            ),
            channels=["x"],
        ),
        reads(
            "lists of names and units of cells",
            mat_file(
                data=cells(NOISE, NOISE * 2),
                names=cells("x", "p"),
                units=cells("g", "bar"),
                fs=RATE,
            ),
        ),
        reads("rate in kHz", mat_file(x=NOISE, fs_kHz=10.0, unit="g")),
    ],
)
def test_names_units_and_rates_of_a_matlab_file_are_read_from_its_layout(
    write: FileWriter, options: dict[str, Any], expected: np.ndarray, tmp_path: Path
) -> None:
    assert_reads(write(tmp_path), options, expected)


@pytest.mark.parametrize(
    READ_CASE,
    [
        reads("X and Y", mat_file(X=TIME, Y=NOISE[:, None], unit="g")),
        reads("column of a matrix with a unit", mat_file(data=TIME_AND_NOISE, fs=RATE, unit="g")),
        reads("column of a matrix", mat_file(data=TIME_AND_NOISE, fs=RATE), unit="g"),
        # A ramp that contradicts the rate is no time, but it is no vibration either.
        reads(
            "ramp of another slope",
            mat_file(data=np.stack([0.3 * TIME, NOISE], axis=1), fs=RATE),
            unit="g",
        ),
        # Ten steps a millisecond could count samples, so the user states the unit of the time.
        reads(
            "milliseconds",
            mat_file(data=np.stack([np.arange(N_SAMPLES) / 10, NOISE], axis=1), unit="g"),
            time_unit="ms",
        ),
    ],
)
def test_the_time_in_a_matlab_file_is_no_channel(
    write: FileWriter, options: dict[str, Any], expected: np.ndarray, tmp_path: Path
) -> None:
    assert_reads(write(tmp_path), options, expected)


@pytest.mark.parametrize(
    REFUSED_CASE,
    [
        # tbeu/matio/issues/359: six integers stand for the object; they are no samples.
        refuses(
            "object",
            mat_file(s={"t": OPAQUE_OBJECT}, fs=RATE),
            r"left out: s\.t \(a MATLAB object\)",
        ),
        refuses(
            "complex numbers", mat_file(x=NOISE + 1j, fs=RATE), r"left out: x \(complex numbers\)"
        ),
    ],
)
def test_a_matlab_file_without_real_vectors_is_refused_with_what_it_holds(
    write: FileWriter, options: dict[str, Any], message: str, tmp_path: Path
) -> None:
    assert_refuses(write(tmp_path), options, message)


# ---- WAV


SAMPLE_BYTES = 4


def wav_file(n_stated_bytes: int, tail: bytes = b"") -> FileWriter:
    """Return a writer of a WAV file of NOISE / 8, which states another length than it has.

    The eighth keeps the noise within the full scale of 1.
    """

    def write(folder: Path) -> Path:
        path = folder / "a.wav"
        soundfile.write(path, NOISE / 8, int(RATE), subtype="FLOAT")
        content = bytearray(path.read_bytes())

        # The length stands behind "RIFF" and again behind "data".
        stated_length = struct.pack("<I", n_stated_bytes)
        data_length = content.index(b"data") + 4
        content[4:8] = stated_length
        content[data_length : data_length + 4] = stated_length

        end = data_length + 4 + N_SAMPLES * SAMPLE_BYTES
        path.write_bytes(content[:end] + tail)
        return path

    return write


def rf64_file(folder: Path) -> Path:
    soundfile.write(folder / "a.wav", NOISE / 8, int(RATE), subtype="FLOAT", format="RF64")
    return folder / "a.wav"


@pytest.mark.parametrize(
    READ_CASE,
    [
        # naudio/NAudio/issues/688: a program that writes to a pipe never learns the length.
        reads("greatest length", wav_file(0xFFFFFFFF), NOISE / 8, unit="g"),
        # rs1729/RS/issues/39: a recorder that was switched off never writes it.
        reads("no length", wav_file(0), NOISE / 8, unit="g"),
        # breakfastquay/rubberband/issues/101
        reads(
            "length below that of the samples",
            wav_file(N_SAMPLES * SAMPLE_BYTES - 1200),
            NOISE / 8,
            unit="g",
        ),
        # SatDump/SatDump/pull/340: RF64 is WAV for more than 4 GB.
        reads("length of 64 bits", rf64_file, NOISE / 8, unit="g"),
        reads(
            "zeros behind the samples",
            wav_file(N_SAMPLES * SAMPLE_BYTES, b"\0" * 4096),
            NOISE / 8,
            unit="g",
        ),
        reads(
            "half a sample behind the others",
            wav_file(N_SAMPLES * SAMPLE_BYTES, b"\1\2"),
            NOISE / 8,
            unit="g",
        ),
    ],
)
def test_a_wav_file_with_a_wrong_length_gives_every_sample(
    write: FileWriter, options: dict[str, Any], expected: np.ndarray, tmp_path: Path
) -> None:
    assert_reads(write(tmp_path), options, expected)


# ---- HDF5, NPZ and MDF


def hdf5_file(
    values: np.ndarray, file_attributes: dict[str, Any] | None = None, **attributes: Any
) -> FileWriter:
    """Return a writer of an HDF5 file of one data set, by default in g at 10 kHz."""

    def write(folder: Path) -> Path:
        with h5py.File(folder / "a.h5", "w") as file:
            file["x"] = values
            file.attrs.update(file_attributes or {})
            file["x"].attrs.update({"sampling_rate": "10 kHz", "units": "g", **attributes})
        return folder / "a.h5"

    return write


@pytest.mark.parametrize(
    READ_CASE,
    [
        # Unidata/netcdf4-python/issues/554
        reads(
            "scale with a lower bound",
            hdf5_file(COUNTS, scale_factor=1e-4, valid_min=np.int16(-32000)),
        ),
        reads("scale of the whole file", hdf5_file(COUNTS, {"scale_factor": 1e-4})),
        # HDFGroup/h5pyd/issues/44: 1e37 in single precision differs from 1e37 in double.
        reads(
            "fill value in single precision",
            hdf5_file(np.where(IS_MISSING, 1e37, NOISE).astype("f4"), _FillValue=1e37),
            NOISE_WITH_GAPS,
        ),
        # opera-adt/COMPASS/pull/167: an attribute that only resembles that of the convention
        reads(
            "fill value of another name",
            hdf5_file(np.where(IS_MISSING, -9.0e3, NOISE), fill_value=-9.0e3),
            NOISE_WITH_GAPS,
        ),
        # nasa-jpl/autoRIFT/pull/92: the range is that of the counts, before they are scaled.
        reads(
            "samples outside the valid range",
            hdf5_file(
                np.where(IS_MISSING, 32767, COUNTS), scale_factor=1e-4, valid_range=[-32000, 32000]
            ),
            NOISE_WITH_GAPS,
        ),
        reads("rate with its unit in the name", hdf5_file(NOISE, sampling_rate=[], fs_khz=10.0)),
        # Whether a gain is applied already is unknown, so the user states the sensitivity.
        reads("sensitivity in place of a gain", hdf5_file(NOISE / 2, gain=2.0), sensitivity="2 g"),
        reads(
            "sensitivity in place of a gain in words",
            hdf5_file(COUNTS, gain="0.0001 g"),
            sensitivity="0.0001 g",
        ),
        reads(
            "names of which two are the same",
            hdf5_file(np.stack([NOISE] * 3), channel_names=["acc", "acc", "ref"]),
            channels=["x/2"],
        ),
        reads(
            "lists of names and units",
            hdf5_file(np.stack([NOISE, NOISE]), names=["x", "tach"], units=["g", "V"]),
            channels=["x/x"],
        ),
    ],
)
def test_attributes_of_an_hdf5_data_set_are_obeyed(
    write: FileWriter, options: dict[str, Any], expected: np.ndarray, tmp_path: Path
) -> None:
    assert_reads(write(tmp_path), options, expected)


@pytest.mark.parametrize(
    REFUSED_CASE,
    [
        refuses(
            "scale of another name",
            hdf5_file(COUNTS, Calibration_Factor=1e-4),
            "calibration_factor = 0.0001, and not",
        ),
        refuses(
            "gain in words",
            hdf5_file(COUNTS, gain="0.0001 g"),
            "gain = 0.0001 g.* sensitivity='0.0001 g'",
        ),
        refuses(
            "sensitivity without a unit",
            hdf5_file(VOLTS, units="V", Sensitivity=100),
            "sensitivity 100 of 'x' without",
        ),
        refuses(
            "range of one bound",
            hdf5_file(NOISE, valid_range=[4.0]),
            "states 1 numbers as valid_range, and not 2",
        ),
        refuses(
            "two scales of three channels",
            hdf5_file(np.stack([COUNTS] * 3), scale_factor=[1e-4, 1.0]),
            "2 numbers as scale_factor, and not 1",
        ),
    ],
)
def test_an_hdf5_data_set_with_ambiguous_attributes_is_refused(
    write: FileWriter, options: dict[str, Any], message: str, tmp_path: Path
) -> None:
    assert_refuses(write(tmp_path), options, message)


def npz_file(**arrays: np.ndarray) -> FileWriter:
    def write(folder: Path) -> Path:
        np.savez(folder / "a.npz", **arrays)
        return folder / "a.npz"

    return write


@pytest.mark.parametrize(
    READ_CASE,
    [
        reads(
            "calendar times",
            npz_file(time=np.datetime64("2026-03-02", "ns") + np.arange(401) * 100_000, x=NOISE),
            unit="g",
        ),
        reads(
            "fields of one array",
            npz_file(record=np.rec.fromarrays([TIME, NOISE], names="t,x")),
            unit="g",
        ),
    ],
)
def test_the_time_in_an_archive_of_numpy_gives_the_rate(
    write: FileWriter, options: dict[str, Any], expected: np.ndarray, tmp_path: Path
) -> None:
    assert_reads(write(tmp_path), options, expected)


# Kind of a master channel of MDF that counts samples.
SAMPLE_INDEX = 4


def mdf_file(sync_type: int | None = None, **facts: Any) -> FileWriter:
    """Return a writer of an MDF file, whose master channel is the time unless a kind is given."""

    def write(folder: Path) -> Path:
        asammdf = pytest.importorskip("asammdf")
        with asammdf.MDF() as file:
            file.append([asammdf.Signal(NOISE, timestamps=TIME, name="x", unit="g", **facts)])
            if sync_type is not None:
                file.groups[0].channels[0].sync_type = sync_type
            file.save(folder / "a.mf4", overwrite=True)
        return folder / "a.mf4"

    return write


# danielhrisca/asammdf/issues/96
def test_samples_that_an_mdf_file_marks_as_invalid_are_missing(tmp_path: Path) -> None:
    path = mdf_file(invalidation_bits=IS_MISSING)(tmp_path)

    assert_reads(path, {}, NOISE_WITH_GAPS)


def test_an_mdf_file_that_counts_samples_needs_a_rate(tmp_path: Path) -> None:
    path = mdf_file(SAMPLE_INDEX)(tmp_path)

    assert_refuses(path, {}, "counts samples, not time. Add sample_rate")
    assert_reads(path, {"sample_rate": RATE}, NOISE)
