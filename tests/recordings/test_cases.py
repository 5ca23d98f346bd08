"""Small files as recorders and programs write them: each gives its right answer, by numbers, or is
refused by name.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swashtwin.foundation import DataError
from swashtwin.recordings import inspect_recordings, load_recording

CASES = Path(__file__).parent / "cases"
G = 9.80665
READ: list[tuple[str, dict[str, Any], float, int, str, list[float]]] = [
    # file, what it does not say, rate [Hz], samples, channels, rms [m/s^2 or V]
    ("01-lvm-notes-pump.lvm", {}, 10_000, 2000, "acc_x acc_y", [1.4596 * G, 0.7296 * G]),
    ("03-picoscope-us_greek_mu.csv", {}, 50_000, 2000, "Channel A,Channel B", [0.29241, 0.07297]),
    ("08-trailing-separator-log.csv", {}, 20_000, 2000, "acc_x acc_y", [1.46264 * G, 0.73077 * G]),
    ("09-preamble-export.txt", {"unit": "g"}, 12_800, 2048, "acc_z", [1.46269 * G]),
    ("13-dropped-samples-log.csv", {}, 1000, 2700, "acc", []),
    ("13-dropped-samples-fine_10.csv", {}, 25_600, 18432, "acc", []),
    ("15-dst-offset-log.csv", {}, 1000, 3000, "acc", []),
    ("17-d-exponent-fortran.dat", {"unit": "g"}, 10_000, 1500, "column_1", [1.46797 * G]),
    ("20-epoch-column-epoch_us.csv", {}, 4000, 3000, "acc", []),
    ("24-wav-never-closed-zero_data.wav", {"unit": "1"}, 48_000, 48000, "channel_0", []),
    ("27-wav-wrapped-wrapped.wav", {"unit": "1"}, 48_000, 48000, "channel_0", []),
    ("29-tdms-scale-scaled_int32.tdms", {}, 25_600, 25600, "acc_x acc_y", [13.868, 13.868]),
    ("32-tdms-appended-other_rate.tdms", {"channels": ["acc [1]"]}, 20_000, 2000, "acc [1]", []),
    ("32-tdms-appended-other_rate.tdms", {"channels": ["acc [2]"]}, 5000, 1000, "acc [2]", []),
    ("35-uff-58b-by_pyuff.uff", {}, 12_800, 1001, "acc z", [1.45387 * G]),
    (
        "35-uff-58b-sets3_std.uff",
        {},
        12_800,
        1001,
        "1+Z 2+Z 3+Z",
        [1.45387 * G, 1.45387 * G / 2, 1.45387 * G / 3],
    ),
    ("36-uff-odd-uneven-uneven_odd.uff", {}, 12_800, 1001, "pump", [1.45387 * G]),
    (
        "39-mat-struct-array-struct_array_rates.mat",
        {"channels": ["ch.acc_y.data"]},
        10_000,
        2000,
        "ch.acc_y.data",
        [],
    ),
    ("40-mat-labchart-labchart.mat", {}, 20_000, 4000, "acc_x acc_y", [1.46223 * G, 0.73184 * G]),
    ("42-hdf5-scale-offset-cf.h5", {}, 20_000, 4000, "acc", [1.46224 * G]),
    ("42-hdf5-scale-offset-fillvalue.h5", {}, 20_000, 4000, "acc", [14.325]),
    ("44-volts-iepe.csv", {"sensitivity": "99.7 mV/g"}, 20_000, 4096, "ai0", [14.289]),
    ("46-asammdf-exports-asammdf_export.csv", {"unit": "g"}, 20_000, 4000, "acc_x acc_y", []),
]
REFUSED = [
    ("21-tagged-rows-track.csv", r"rows are of 2 sensors by turns \(BARO, IMU\)"),
    ("22-short-header-log.csv", "line 1 has 2 headings for 3 columns"),
    ("29-tdms-scale-reciprocal.tdms", "Unsupported scale type: Reciprocal"),
    (
        "32-tdms-appended-other_rate.tdms",
        r"several rates \(acc \[1\]: 20000 Hz, acc \[2\]: 5000 Hz\)",
    ),
    ("31-tdms-start-times-two_starts.tdms", "different start times"),
    ("38-mat-datetime-table.mat", "T is a MATLAB table, which cannot be read; save its columns"),
    (
        "39-mat-struct-array-struct_array_rates.mat",
        r"ch\.acc_x\.data: 20000 Hz, ch\.acc_y\.data: 10000 Hz",
    ),
    ("43-mdf-master-angle.mf4", "counts angle, not time"),
]


@pytest.mark.parametrize(
    ("file", "options", "rate", "samples", "channels", "rms"), READ, ids=[row[0] for row in READ]
)
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_case_is_read_right(
    file: str, options: dict[str, Any], rate: float, samples: int, channels: str, rms: list[float]
) -> None:
    recording = load_recording(CASES / file, **options)
    assert recording.sample_rate == pytest.approx(rate, rel=1e-6)
    assert recording.n_samples == samples
    assert recording.channels in (tuple(channels.split()), tuple(channels.split(",")))
    if rms:
        np.testing.assert_allclose(np.sqrt(np.nanmean(recording.signal**2, axis=1)), rms, rtol=1e-4)
    findings = inspect_recordings([recording]).recordings[0].findings
    assert any(finding.kind == "gaps" for finding in findings) == file.startswith("13")


@pytest.mark.parametrize(("file", "reason"), REFUSED, ids=[row[0] for row in REFUSED])
def test_a_case_is_refused_by_name(file: str, reason: str) -> None:
    if file.endswith("mf4"):
        pytest.importorskip("asammdf")
    with pytest.raises(DataError, match=reason):
        load_recording(CASES / file)
