"""What the columns of a file run along: clocks of any kind, spectra, sensors by turns, counters."""

from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
import scipy.io
from numpy.typing import ArrayLike

from swashtwin.foundation import DataError
from swashtwin.recordings import load_recording

RATE = 2000.0
N_SAMPLES = 1200
TIME_S = np.arange(N_SAMPLES) / RATE
NOISE = np.random.default_rng(3).standard_normal((3, N_SAMPLES))

SUFFIXES = [".csv", ".mat", ".npz", ".parquet", ".h5"]


def write_columns(path: Path, columns: dict[str, ArrayLike]) -> Path:
    """Write columns in the format of the suffix."""
    arrays = {name: np.asarray(values) for name, values in columns.items()}
    match path.suffix:
        case ".csv":
            lines = [",".join(arrays)]
            rows = zip(*(values.tolist() for values in arrays.values()), strict=True)
            lines += [",".join(map(repr, row)) for row in rows]
            path.write_text("\n".join(lines) + "\n")
        case ".mat":
            scipy.io.savemat(path, arrays)
        case ".npz":
            np.savez(path, allow_pickle=False, **arrays)
        case ".parquet":
            polars.DataFrame(arrays).write_parquet(path)
        case ".h5":
            h5py = pytest.importorskip("h5py")
            with h5py.File(path, "w") as file:
                for name, values in arrays.items():
                    file[name] = values
    return path


# ---- spectra


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(
    ("axis", "values", "step"),
    [
        ("f", "Pxx", 0.5),
        ("freq_Hz", "amplitude", 2.5),
        ("Ordnung", "Pegel", 0.1),
        ("x", "PSD", 1.5),
    ],
)
def test_a_spectrum_is_refused_in_each_format(
    axis: str, values: str, step: float, suffix: str, tmp_path: Path
) -> None:
    path = write_columns(
        tmp_path / f"a{suffix}", {axis: step * np.arange(N_SAMPLES), values: NOISE[0] ** 2}
    )

    with pytest.raises(DataError, match=f"holds a spectrum .*{values}.*export the time waveform"):
        load_recording(path, unit="g", sample_rate="25.6 kHz")


def test_a_spectrum_beside_its_time_signal_is_left_out(tmp_path: Path) -> None:
    n_lines = 257
    path = write_columns(
        tmp_path / "a.npz",
        {
            "t": TIME_S,
            "acc": NOISE[0],
            "f": np.arange(n_lines) * RATE / 512,
            "Pxx": NOISE[1, :n_lines] ** 2,
        },
    )

    recording = load_recording(path, unit="g")

    assert recording.channels == ("acc",)
    assert recording.sample_rate == RATE
    assert recording.attributes["spectrum_columns"] == "f, Pxx"


def test_a_frequency_that_was_recorded_over_time_is_no_axis(tmp_path: Path) -> None:
    path = write_columns(
        tmp_path / "a.csv",
        {"time": TIME_S, "frequency": 20 + 5 * TIME_S, "acc": NOISE[0]},
    )

    assert load_recording(path, unit="g", channels=("acc",)).sample_rate == RATE


# ---- what is no clock

OTHER_AXES = ["pressure", "Last", "angle", "turns", "setpoint", "Hub", "depth_mm", "p"]


@pytest.mark.parametrize("suffix", [".csv", ".mat", ".parquet"])
@pytest.mark.parametrize("name", OTHER_AXES)
def test_another_quantity_that_rises_evenly_gives_no_rate(
    name: str, suffix: str, tmp_path: Path
) -> None:
    path = write_columns(tmp_path / f"a{suffix}", {name: TIME_S, "acc": NOISE[0]})

    with pytest.raises(DataError, match="does not state its sample rate"):
        load_recording(path, unit="g", channels=("acc",))
    recording = load_recording(path, unit="g", channels=("acc",), sample_rate="4 kHz")
    assert recording.sample_rate == 4000


def test_a_column_without_a_name_never_overrides_a_specified_rate(tmp_path: Path) -> None:
    path = write_columns(tmp_path / "a.csv", {"x": TIME_S, "acc": NOISE[0]})

    assert load_recording(path, unit="g").sample_rate == RATE
    assert load_recording(path, unit="g", sample_rate="5 kHz").sample_rate == 5000


# ---- clocks by name

CLOCK_NAMES = [
    ("time_min", 60.0),
    ("minutes", 60.0),
    ("Minuten", 60.0),
    ("Zeit_ms", 1e-3),
    ("elapsedTimeMs", 1e-3),
    ("hours", 3600.0),
    ("Zeit (h)", 3600.0),
    ("timestamp_us", 1e-6),
    ("seconds_elapsed", 1.0),
]


@pytest.mark.parametrize(("name", "unit_s"), CLOCK_NAMES)
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_clock_counts_the_unit_in_its_name(
    name: str, unit_s: float, suffix: str, tmp_path: Path
) -> None:
    path = write_columns(tmp_path / f"a{suffix}", {name: TIME_S / unit_s, "x": NOISE[0]})

    recording = load_recording(path, unit="g")

    assert recording.channels == ("x",)
    assert recording.sample_rate == pytest.approx(RATE, rel=1e-6)


# ---- a clock in several columns


def clock_in_parts(kind: str) -> dict[str, ArrayLike]:
    ns = 1_700_000_000_999_000_000 + np.arange(N_SAMPLES, dtype=np.int64) * 500_000
    match kind:
        case "sec, nsec":
            return {"sec": ns // 10**9, "nsec": ns % 10**9}
        case "tv_sec, tv_usec":
            return {"tv_sec": ns // 10**9, "tv_usec": ns // 1000 % 10**6}
        case "Stunde, Minute, Sekunde":
            seconds = 3 * 3600 + 59.5 + TIME_S
            return {
                "Stunde": seconds // 3600,
                "Minute": seconds // 60 % 60,
                "Sekunde": np.round(seconds % 60, 4),
            }
        case _:
            return {"s": ns // 10**9 % 100, "ms": ns / 10**6 % 1000}


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(
    "kind", ["sec, nsec", "tv_sec, tv_usec", "Stunde, Minute, Sekunde", "s, ms"]
)
def test_a_clock_in_several_columns_is_one_clock(kind: str, suffix: str, tmp_path: Path) -> None:
    path = write_columns(
        tmp_path / f"a{suffix}", {**clock_in_parts(kind), "ax": NOISE[0], "ay": NOISE[1]}
    )

    recording = load_recording(path, unit="g")

    assert recording.channels == ("ax", "ay")
    assert recording.sample_rate == pytest.approx(RATE, rel=1e-6)


# ---- sensors by turns


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(
    ("name", "numbers"),
    [("channel", (1, 2, 3)), ("Sensor_Nr", (0, 1)), ("addr", (104, 105)), ("wert2", (1, 2, 3, 4))],
)
def test_rows_of_sensors_told_by_a_number_are_refused(
    name: str, numbers: tuple[int, ...], suffix: str, tmp_path: Path
) -> None:
    count = len(numbers)
    columns: dict[str, Any] = {
        "time": np.repeat(TIME_S[: N_SAMPLES // count], count),
        name: np.tile(numbers, N_SAMPLES // count),
        "value": NOISE[0],
    }
    path = write_columns(tmp_path / f"a{suffix}", columns)

    with pytest.raises(DataError, match=f"rows are of {count} sensors by turns"):
        load_recording(path, unit="g")


# ---- counters


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".h5"])
@pytest.mark.parametrize(
    ("name", "size"), [("rec#", None), ("packet", None), ("Zaehler", 256), ("frame_id", 1000)]
)
def test_a_counter_tells_how_many_samples_are_lost(
    name: str, size: int | None, suffix: str, tmp_path: Path
) -> None:
    counts = np.delete(np.arange(N_SAMPLES), [*range(300, 307), 900])
    columns = {name: counts % (size or 10**9), "x": NOISE[0, counts], "y": NOISE[1, counts]}
    path = write_columns(tmp_path / f"a{suffix}", columns)

    recording = load_recording(path, unit="g", sample_rate=RATE)

    assert recording.channels == ("x", "y")
    assert recording.attributes["time_gaps"] == f"{name} skips 8 samples at 2 places"
