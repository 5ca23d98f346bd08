"""Files as instruments write them: what they say of their numbers is obeyed or refused, and never
ignored.
"""

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


def assert_noise(
    recording: Recording, rate: float = RATE, unit: str = "m/s^2", factor: float = G
) -> None:
    assert recording.sample_rate == pytest.approx(rate, rel=1e-9)
    assert recording.unit == unit
    np.testing.assert_allclose(recording.signal[0], NOISE * factor, rtol=1e-9, atol=1e-9)


# ---- text tables


@pytest.mark.parametrize("unit", ["(\u03bcs)", "(\u00b5s)", "(us)", "[usec]"])
def test_every_way_to_write_a_microsecond_is_read(unit: str, tmp_path: Path) -> None:
    path = text(
        tmp_path / "a.csv", "Time,Channel A", f"{unit},(V)", "", *rows((TIME - 0.1) * 1e6, NOISE)
    )
    assert_noise(load_recording(path), unit="V", factor=1)


@pytest.mark.parametrize(
    "heading", ["x (g)", "x [g's]", "x [m/s²]", "x (ms-2)", "x (m/s^2)", "x (Volts)", "x [mV]"]
)
def test_units_are_read_as_people_write_them(heading: str, tmp_path: Path) -> None:
    recording = load_recording(
        text(tmp_path / "a.csv", f"time (s),{heading}", *rows(seconds(), NOISE))
    )
    assert recording.channels == ("x",)
    assert recording.unit == ("V" if "olt" in heading else "mV" if "mV" in heading else "m/s^2")
    assert_noise(recording, unit=recording.unit, factor=G if "g" in heading else 1)


def test_a_counter_that_skips_tells_lost_samples(tmp_path: Path) -> None:
    kept = np.arange(2000) != 700
    lines = rows(np.arange(2000)[kept], NOISE[kept])
    recording = load_recording(text(tmp_path / "a.csv", "sample,x [g]", *lines), sample_rate=RATE)
    assert recording.channels == ("x",)
    assert recording.attributes["time_gaps"] == "sample skips 1 samples at 1 places"


# ---- containers


def write_tdms(path: Path, *segments: dict[str, tuple[np.ndarray, dict[str, Any]]]) -> Path:
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(str(path)) as writer:
        for segment in segments:
            writer.write_segment(
                [
                    nptdms.ChannelObject("g", name, data, properties=facts)
                    for name, (data, facts) in segment.items()
                ]
            )
    return path


def waveform(start: str, rate: float = RATE, **more: Any) -> dict[str, Any]:
    return {
        "wf_start_time": np.datetime64(start),
        "wf_start_offset": 0.0,
        "wf_increment": 1 / rate,
        "unit_string": "g",
    } | more


def test_a_segment_that_goes_on_without_a_gap_is_no_other_recording(tmp_path: Path) -> None:
    goes_on = write_tdms(
        tmp_path / "b.tdms",
        {"x": (NOISE[:1000], waveform("2026-03-02T09:14:07"))},
        {"x": (NOISE[1000:], waveform("2026-03-02T09:14:07.100"))},
    )
    assert_noise(load_recording(goes_on))


@pytest.mark.parametrize(
    ("header", "speed"),
    [
        ("Speed sensor: 3", None),
        ("Speed channel: 2", None),
        ("Speed: 980", "980 rpm"),
        ("Drehzahl Pumpe: 980", "980 rpm"),
        ("Motor speed: 1500 rpm\nPump speed: 980 rpm", "980 rpm"),
    ],
)
def test_a_header_states_the_speed_of_the_pump(header: str, speed: str | None) -> None:
    assert parse_header_facts(RawFile({}, attributes={"header": header})).get("speed") == speed


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
