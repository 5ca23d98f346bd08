"""Parquet, NPZ, MDF and time columns: what a file states is read, and checked."""

from collections.abc import Iterable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from swashtwin.foundation import DataError
from swashtwin.recordings import Recording, load_recording, write_recording
from swashtwin.recordings.formats import isolation, parquet
from swashtwin.recordings.formats.raw_file import ReadOptions

G = 9.80665
N_SAMPLES = 400
SIGNAL = np.random.default_rng(0).standard_normal((2, N_SAMPLES))


# ---- Parquet and NPZ


def write_parquet(path: Path, **columns: object) -> Path:
    import polars

    polars.DataFrame(columns).write_parquet(path)
    return path


def test_a_parquet_table_has_its_units_and_rate_and_nan_for_missing_samples(
    tmp_path: Path,
) -> None:
    columns = {
        "time [ms]": np.arange(N_SAMPLES) / 4,
        "x [g]": [None, *SIGNAL[0, 1:]],
        "note": ["a"] * N_SAMPLES,
    }
    path = write_parquet(tmp_path / "a.parquet", **columns)

    loaded = load_recording(path)

    assert loaded.channels == ("x",)
    assert (loaded.unit, loaded.sample_rate) == ("m/s^2", 4000.0)
    assert np.isnan(loaded.signal[0, 0])
    np.testing.assert_allclose(loaded.signal[0, 1:], SIGNAL[0, 1:] * G)


def test_slices_of_a_large_parquet_table_are_read_in_any_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parquet, "_MAX_CACHED_BYTES", 0)
    monkeypatch.setattr(parquet, "BLOCK_SAMPLES", 1)
    monkeypatch.setattr(parquet, "_BATCH_ROWS", 64)
    path = write_parquet(tmp_path / "a.parquet", x=SIGNAL[0], y=SIGNAL[1])

    columns = parquet.read(path, ReadOptions(sample_rate="1 kHz")).columns

    for first, end in [(100, 130), (120, 330), (5, 7), (0, N_SAMPLES), (399, 400)]:
        np.testing.assert_array_equal(columns["y"][first:end], SIGNAL[1, first:end])
        np.testing.assert_array_equal(columns["x"][first:end], SIGNAL[0, first:end])


@pytest.mark.parametrize(
    ("footer", "message"),
    [
        pytest.param(b"\xff" * 40, "its footer is damaged", id="no structure"),
        pytest.param(b"\x1c" * 5000, "its footer is damaged", id="nested without end"),
        pytest.param(b"\x15\x02\x26\x08\x00", "ValueError: ", id="no columns"),
    ],
)
def test_a_damaged_footer_of_a_parquet_table_is_refused_with_the_reason(
    footer: bytes, message: str, tmp_path: Path
) -> None:
    length = len(footer).to_bytes(4, "little")
    (tmp_path / "a.parquet").write_bytes(b"PAR1" + bytes(9) + footer + length + b"PAR1")

    with pytest.raises(DataError, match=message):
        load_recording(tmp_path / "a.parquet", unit="1")


@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
def test_time_stamps_of_a_parquet_table_give_the_rate(unit: str, tmp_path: Path) -> None:
    import polars

    start = datetime(2026, 4, 10, 16, 22)
    moments = [start + timedelta(milliseconds=2 * number) for number in range(N_SAMPLES)]
    stamps = polars.Series(moments).cast(polars.Datetime(unit))
    path = write_parquet(tmp_path / "a.parquet", time=stamps, x=SIGNAL[0])

    loaded = load_recording(path, unit="1")

    assert loaded.channels == ("x",)
    assert loaded.sample_rate == 500.0


# numpy stores objects as pickles, which run code when they are loaded.
def test_an_archive_of_objects_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", x=np.array([1.5, "b", None], dtype=object))

    with pytest.raises(DataError, match="allow_pickle=False"):
        load_recording(tmp_path / "a.npz", unit="1")


# ---- MDF


def write_mdf(path: Path, *groups: tuple[str, np.ndarray, float, str]) -> Path:
    """Write groups of one channel, each with its name, samples, rate and unit."""
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="4.10") as file:
        for name, values, rate, unit in groups:
            time = np.arange(len(values)) / rate
            file.append([asammdf.Signal(values, timestamps=time, name=name, unit=unit)])
        file.save(path, overwrite=True)
    return path


@pytest.fixture
def measurement_of_two_rates(tmp_path: Path) -> Path:
    """Return a file of an acceleration at 25.6 kHz and a speed at 100 Hz."""
    return write_mdf(
        tmp_path / "a.mf4",
        ("acc", SIGNAL[0], 25600.0, "g"),
        ("speed", SIGNAL[1, :50], 100.0, "rpm"),
    )


@pytest.mark.parametrize("options", [{}, {"channels": ["acc"]}], ids=["by default", "by name"])
def test_the_vibration_is_selected_from_a_measurement_of_several_rates(
    measurement_of_two_rates: Path, options: dict[str, list[str]]
) -> None:
    loaded = load_recording(measurement_of_two_rates, **options)

    assert (loaded.unit, loaded.sample_rate) == ("m/s^2", 25600.0)
    np.testing.assert_allclose(loaded.signal[0], SIGNAL[0] * G)


def test_all_channels_of_a_measurement_of_several_rates_are_refused(
    measurement_of_two_rates: Path,
) -> None:
    message = r"several rates \(acc: 25600 Hz, speed: 100 Hz\), .* with channels"
    with pytest.raises(DataError, match=message):
        load_recording(measurement_of_two_rates, channels=["*"])


# ---- the time column


def write_csv(path: Path, heading: str, times: Iterable[object], values: Iterable[object]) -> Path:
    rows = "".join(f"{time},{value}\n" for time, value in zip(times, values, strict=True))
    path.write_text(f"{heading}\n{rows}")
    return path


HUNDREDTHS = [f"{number / 100:.2f}" for number in range(60)]
HALVES = [f"{number}.5" for number in range(60)]


def test_a_time_in_minutes_gives_the_rate_per_second(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "a.csv", "time [min],x", HUNDREDTHS, HALVES)

    assert load_recording(path, unit="1").sample_rate == pytest.approx(100 / 60, rel=1e-9)


def test_a_time_in_a_unit_of_something_else_is_refused(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "a.csv", "time [g],x", HUNDREDTHS, HALVES)

    with pytest.raises(DataError, match="in 'g', which is not one of s, ms"):
        load_recording(path, unit="1")


# An early first sample and late other ones, by part of a step and by several.
@pytest.mark.parametrize("error_steps", [0.4, 3.0])
@pytest.mark.parametrize(("index", "direction"), [(0, -1), (17, 1), (59, 1)])
def test_one_wrong_time_does_not_shift_the_rate(
    index: int, direction: int, error_steps: float, tmp_path: Path
) -> None:
    time = np.arange(60) / 25600
    time[index] += direction * error_steps / 25600
    path = write_csv(tmp_path / "a.csv", "time [s],x", time.tolist(), SIGNAL[0, :60].tolist())

    assert load_recording(path, unit="1").sample_rate == 25600.0


# Rates of audio and of measuring systems, a third of one, and one that no clock divides into.
@pytest.mark.parametrize("rate", [1000.0, 25600.0, 44100.0, 51200 / 3, 12345.678])
@pytest.mark.parametrize("suffix", ["csv", "parquet", "mf4"])
def test_a_written_time_column_gives_back_the_rate(
    suffix: str, rate: float, tmp_path: Path
) -> None:
    recording = Recording(SIGNAL, rate, "a", channels=("x", "y"))

    path = write_recording(recording, tmp_path / f"a.{suffix}")

    assert load_recording(path).sample_rate == pytest.approx(rate, rel=1e-9)


# ---- safety


def test_reading_a_file_runs_no_module_of_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_parquet(tmp_path / "a.parquet", x=SIGNAL[0])
    trace = tmp_path / "was_here"
    for name in ("nanoarrow", "json"):
        module = tmp_path / f"{name}.py"
        module.write_text(f"open({str(trace)!r}, 'w')\n", encoding="utf-8")

    # a new process would search the current folder first
    isolation.stop()
    monkeypatch.chdir(tmp_path)
    try:
        assert load_recording(path, sample_rate=1000.0, unit="1").signal.shape[1] == N_SAMPLES
    finally:
        isolation.stop()

    assert not trace.exists()
