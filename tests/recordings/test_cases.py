"""Small files as recorders and programs write them: each is read right, or refused by name."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swashtwin.foundation import DataError
from swashtwin.recordings import Recording, inspect_recordings, load_recording

CASES = Path(__file__).parent / "cases"
G = 9.80665

# Some of the libraries leave a file open that they cannot read to its end.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")


@dataclass(frozen=True, kw_only=True)
class Case:
    """A file and the recording that it holds."""

    file: str
    rate: float
    """Hz"""
    n_samples: int
    channels: tuple[str, ...]
    rms: tuple[float, ...] = ()
    """m/s^2 or V; empty if it is not checked."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """What the file does not state."""


TEXT_CASES = [
    Case(
        file="01-lvm-notes-pump.lvm",
        rate=10_000,
        n_samples=2000,
        channels=("acc_x", "acc_y"),
        rms=(1.4596 * G, 0.7296 * G),
    ),
    Case(
        file="03-picoscope-us_greek_mu.csv",
        rate=50_000,
        n_samples=2000,
        channels=("Channel A", "Channel B"),
        rms=(0.29241, 0.07297),
    ),
    Case(
        file="08-trailing-separator-log.csv",
        rate=20_000,
        n_samples=2000,
        channels=("acc_x", "acc_y"),
        rms=(1.46264 * G, 0.73077 * G),
    ),
    Case(
        file="09-preamble-export.txt",
        rate=12_800,
        n_samples=2048,
        channels=("acc_z",),
        rms=(1.46269 * G,),
        options={"unit": "g"},
    ),
    # The clock is set back by an hour at the end of summer time.
    Case(file="15-dst-offset-log.csv", rate=1000, n_samples=3000, channels=("acc",)),
    Case(
        file="17-d-exponent-fortran.dat",
        rate=10_000,
        n_samples=1500,
        channels=("column_1",),
        rms=(1.46797 * G,),
        options={"unit": "g"},
    ),
    Case(file="20-epoch-column-epoch_us.csv", rate=4000, n_samples=3000, channels=("acc",)),
    # Seconds and nanoseconds are one clock.
    Case(
        file="K10-sec_nsec.csv",
        rate=1000,
        n_samples=1800,
        channels=("ax", "ay"),
        options={"unit": "g", "sample_rate": "1 kHz"},
    ),
    # The name of the clock says minutes.
    Case(file="K12-m3.csv", rate=4000, n_samples=1500, channels=("acc",)),
    Case(
        file="44-volts-iepe.csv",
        rate=20_000,
        n_samples=4096,
        channels=("ai0",),
        rms=(14.289,),
        options={"sensitivity": "99.7 mV/g"},
    ),
    Case(
        file="46-asammdf-exports-asammdf_export.csv",
        rate=20_000,
        n_samples=4000,
        channels=("acc_x", "acc_y"),
        options={"unit": "g"},
    ),
]

WAV_AND_TDMS_CASES = [
    # A recorder that was never stopped left the length at 0.
    Case(
        file="24-wav-never-closed-zero_data.wav",
        rate=48_000,
        n_samples=48_000,
        channels=("channel_0",),
        options={"unit": "1"},
    ),
    Case(
        file="27-wav-wrapped-wrapped.wav",
        rate=48_000,
        n_samples=48_000,
        channels=("channel_0",),
        options={"unit": "1"},
    ),
    Case(
        file="29-tdms-scale-scaled_int32.tdms",
        rate=25_600,
        n_samples=25_600,
        channels=("acc_x", "acc_y"),
        rms=(13.868, 13.868),
    ),
    # A measurement was appended at another rate, so the user selects one of the two.
    Case(
        file="32-tdms-appended-other_rate.tdms",
        rate=20_000,
        n_samples=2000,
        channels=("acc [1]",),
        options={"channels": ["acc [1]"]},
    ),
    Case(
        file="32-tdms-appended-other_rate.tdms",
        rate=5000,
        n_samples=1000,
        channels=("acc [2]",),
        options={"channels": ["acc [2]"]},
    ),
]

UFF_MATLAB_AND_HDF5_CASES = [
    Case(
        file="35-uff-58b-by_pyuff.uff",
        rate=12_800,
        n_samples=1001,
        channels=("acc z",),
        rms=(1.45387 * G,),
    ),
    Case(
        file="35-uff-58b-sets3_std.uff",
        rate=12_800,
        n_samples=1001,
        channels=("1+Z", "2+Z", "3+Z"),
        rms=(1.45387 * G, 1.45387 * G / 2, 1.45387 * G / 3),
    ),
    Case(
        file="36-uff-odd-uneven-uneven_odd.uff",
        rate=12_800,
        n_samples=1001,
        channels=("pump",),
        rms=(1.45387 * G,),
    ),
    Case(
        file="39-mat-struct-array-struct_array_rates.mat",
        rate=10_000,
        n_samples=2000,
        channels=("ch.acc_y.data",),
        options={"channels": ["ch.acc_y.data"]},
    ),
    Case(
        file="40-mat-labchart-labchart.mat",
        rate=20_000,
        n_samples=4000,
        channels=("acc_x", "acc_y"),
        rms=(1.46223 * G, 0.73184 * G),
    ),
    Case(
        file="42-hdf5-scale-offset-cf.h5",
        rate=20_000,
        n_samples=4000,
        channels=("acc",),
        rms=(1.46224 * G,),
    ),
    Case(
        file="42-hdf5-scale-offset-fillvalue.h5",
        rate=20_000,
        n_samples=4000,
        channels=("acc",),
        rms=(14.325,),
    ),
]

DROPPED_SAMPLES_CASES = [
    Case(file="13-dropped-samples-log.csv", rate=1000, n_samples=2700, channels=("acc",)),
    Case(file="13-dropped-samples-fine_10.csv", rate=25_600, n_samples=18_432, channels=("acc",)),
    # A counter skips twelve numbers.
    Case(
        file="K08-rec_skip12.csv",
        rate=4000,
        n_samples=1500,
        channels=("AX", "AY"),
        options={"unit": "g", "sample_rate": "4 kHz"},
    ),
]


def file_of(case: Case) -> str:
    return case.file


def assert_case(case: Case) -> Recording:
    """Check the rate, length, channels and levels of a case, and return its recording."""
    recording = load_recording(CASES / case.file, **case.options)

    assert recording.sample_rate == pytest.approx(case.rate, rel=1e-6)
    assert recording.n_samples == case.n_samples
    assert recording.channels == case.channels
    if case.rms:
        rms = np.sqrt(np.nanmean(recording.signal**2, axis=1))
        np.testing.assert_allclose(rms, case.rms, rtol=1e-4)
    return recording


def has_gaps(recording: Recording) -> bool:
    findings = inspect_recordings([recording]).recordings[0].findings
    return any(finding.kind == "gaps" for finding in findings)


@pytest.mark.parametrize(
    "case", [*TEXT_CASES, *WAV_AND_TDMS_CASES, *UFF_MATLAB_AND_HDF5_CASES], ids=file_of
)
def test_a_file_is_read_right_and_without_gaps(case: Case) -> None:
    recording = assert_case(case)

    assert not has_gaps(recording)


@pytest.mark.parametrize("case", DROPPED_SAMPLES_CASES, ids=file_of)
def test_a_file_with_dropped_samples_is_read_with_its_gaps(case: Case) -> None:
    recording = assert_case(case)

    assert has_gaps(recording)


REFUSED_FILES = {
    # A logger writes the rows of two sensors in turn.
    "21-tagged-rows-track.csv": r"rows are of 2 sensors by turns \(BARO, IMU\)",
    "22-short-header-log.csv": "line 1 has 2 headings for 3 columns",
    "29-tdms-scale-reciprocal.tdms": "Unsupported scale type: Reciprocal",
    "32-tdms-appended-other_rate.tdms": (
        r"several rates \(acc \[1\]: 20000 Hz, acc \[2\]: 5000 Hz\)"
    ),
    "31-tdms-start-times-two_starts.tdms": "different start times",
    "38-mat-datetime-table.mat": "T is a MATLAB table, which cannot be read; save its columns",
    "39-mat-struct-array-struct_array_rates.mat": (
        r"ch\.acc_x\.data: 20000 Hz, ch\.acc_y\.data: 10000 Hz"
    ),
    "K01-spectrum_hz.csv": r"holds a spectrum \(Amplitude over Frequency\)",
    "K01-freq.mat": r"holds a spectrum \(Pxx over f\)",
    # What rises evenly beside the samples is not the time.
    "K02-pressure.csv": "does not state its sample rate",
    "K02-turns.csv": "does not state its sample rate",
    "K03-log.csv": r"the rows hold 1 of 4 columns, only the times \(Timestamp; no X, Y, Z\)",
    "K07-interleaved_number.csv": r"rows are of 3 sensors by turns \(channel: 1, 2, 3\)",
    "K16-units_in_cells.csv": (
        "line 2: '0.4333 g' is a number with a unit, .* and 'g' in the heading"
    ),
    # Order tracking samples by the shaft's angle.
    "43-mdf-master-angle.mf4": "counts angle, not time",
}


@pytest.mark.parametrize(("file", "reason"), REFUSED_FILES.items(), ids=REFUSED_FILES.keys())
def test_a_file_that_is_not_read_is_refused_with_the_reason(file: str, reason: str) -> None:
    if file.endswith("mf4"):
        pytest.importorskip("asammdf")

    with pytest.raises(DataError, match=reason):
        load_recording(CASES / file)
