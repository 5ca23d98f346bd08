"""Units, clocks and rates are read as instruments write them, in every format."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from swashtwin.recordings import Recording, load_recording
from swashtwin.recordings.fact_extraction import parse_header_facts
from swashtwin.recordings.formats.raw_file import RawFile

RATE = 10_000.0
G = 9.80665
N_SAMPLES = 2000
NOISE = np.random.default_rng(3).normal(size=N_SAMPLES).round(5)
TIME = np.arange(N_SAMPLES) / RATE
TIME_TEXTS = [f"{value:.6f}" for value in TIME]


def write_table(path: Path, head: list[str], *columns: Iterable[Any]) -> Path:
    """Write columns with commas between them, below the lines of `head`."""
    rows = [",".join(map(str, row)) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")
    return path


def assert_noise(recording: Recording, unit: str = "m/s^2", factor: float = G) -> None:
    """Check that a recording is `NOISE` at 10 kHz, times a factor."""
    assert recording.sample_rate == pytest.approx(RATE, rel=1e-9)
    assert recording.unit == unit
    np.testing.assert_allclose(recording.signal[0], NOISE * factor, rtol=1e-9, atol=1e-9)


# ---- text tables


@pytest.mark.parametrize(
    "unit",
    [
        # Unicode has two characters that look the same.
        pytest.param("(\u03bcs)", id="Greek letter mu"),
        pytest.param("(\u00b5s)", id="micro sign"),
        pytest.param("(us)", id="us"),
        pytest.param("[usec]", id="usec"),
    ],
)
def test_every_way_to_write_a_microsecond_is_read(unit: str, tmp_path: Path) -> None:
    # An oscilloscope begins before its trigger, at a negative time.
    microseconds = (TIME - 0.1) * 1e6
    head = ["Time,Channel A", f"{unit},(V)", ""]
    path = write_table(tmp_path / "a.csv", head, microseconds, NOISE)

    assert_noise(load_recording(path), unit="V", factor=1)


@pytest.mark.parametrize(
    ("heading", "unit", "factor"),
    [
        ("x (g)", "m/s^2", G),
        ("x [g's]", "m/s^2", G),
        ("x [m/s²]", "m/s^2", 1),
        ("x (ms-2)", "m/s^2", 1),
        ("x (m/s^2)", "m/s^2", 1),
        ("x (Volts)", "V", 1),
        ("x [mV]", "mV", 1),
    ],
)
def test_units_are_read_as_people_write_them(
    heading: str, unit: str, factor: float, tmp_path: Path
) -> None:
    path = write_table(tmp_path / "a.csv", [f"time (s),{heading}"], TIME_TEXTS, NOISE)

    recording = load_recording(path)

    assert recording.channels == ("x",)
    assert_noise(recording, unit, factor)


def test_a_counter_that_skips_a_number_shows_a_lost_sample(tmp_path: Path) -> None:
    received = np.delete(np.arange(N_SAMPLES), 700)
    path = write_table(tmp_path / "a.csv", ["sample,x [g]"], received, NOISE[received])

    recording = load_recording(path, sample_rate=RATE)

    assert recording.channels == ("x",)
    assert recording.attributes["time_gaps"] == "sample skips 1 samples at 1 places"


@pytest.mark.parametrize(
    "header", ["Speed: 980", "Drehzahl Pumpe: 980", "Motor speed: 1500 rpm\nPump speed: 980 rpm"]
)
def test_a_header_states_the_speed_of_the_pump(header: str) -> None:
    facts = parse_header_facts(RawFile({}, attributes={"header": header}))

    assert facts["speed"] == "980 rpm"


# These are numbers of a channel, not of revolutions.
@pytest.mark.parametrize("header", ["Speed sensor: 3", "Speed channel: 2"])
def test_the_number_of_a_speed_sensor_is_no_speed(header: str) -> None:
    assert "speed" not in parse_header_facts(RawFile({}, attributes={"header": header}))


# ---- containers


def write_tdms(path: Path, *segments: tuple[np.ndarray, str]) -> Path:
    """Write segments of a channel, each with its samples and its start."""
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(str(path)) as writer:
        for samples, start in segments:
            properties = {
                "wf_start_time": np.datetime64(start),
                "wf_start_offset": 0.0,
                "wf_increment": 1 / RATE,
                "unit_string": "g",
            }
            channel = nptdms.ChannelObject("g", "x", samples, properties=properties)
            writer.write_segment([channel])
    return path


# A logger that writes once a second begins a segment each time.
def test_segments_that_follow_without_a_gap_are_one_recording(tmp_path: Path) -> None:
    path = write_tdms(
        tmp_path / "b.tdms",
        (NOISE[:1000], "2026-03-02T09:14:07"),
        (NOISE[1000:], "2026-03-02T09:14:07.100"),
    )

    assert_noise(load_recording(path))


def write_hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["a"] = TIME
        file["b"] = NOISE


def write_parquet(path: Path) -> None:
    polars = pytest.importorskip("polars")
    polars.DataFrame({"a": TIME, "b": NOISE}).write_parquet(path)


@pytest.mark.parametrize(
    ("suffix", "write"),
    [
        pytest.param("h5", write_hdf5, id="HDF5"),
        pytest.param("npz", lambda path: np.savez(path, a=TIME, b=NOISE), id="NPZ"),
        pytest.param("mat", lambda path: savemat(path, {"a": TIME, "b": NOISE}), id="MATLAB"),
        pytest.param("parquet", write_parquet, id="Parquet"),
    ],
)
def test_a_column_of_times_is_detected_by_its_values(
    suffix: str, write: Callable[[Path], None], tmp_path: Path
) -> None:
    path = tmp_path / f"a.{suffix}"
    write(path)

    recording = load_recording(path, unit="g")

    assert recording.channels == ("b",)
    assert_noise(recording)
