"""Parquet, NPZ, MDF and the time column of any table: what they say is read, and nothing is taken
on trust.
"""

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from swashtwin.foundation import DataError
from swashtwin.recordings import Recording, load_recording, write_recording
from swashtwin.recordings.formats import isolation

SIGNAL = np.random.default_rng(0).standard_normal((2, 400))


def write_parquet(path: Path, **columns: object) -> Path:
    import polars

    polars.DataFrame(columns).write_parquet(path)
    return path


def test_a_parquet_table_has_its_units_its_rate_and_nan_for_what_is_missing(tmp_path: Path) -> None:
    columns = {
        "time [ms]": np.arange(400) / 4,
        "x [g]": [None, *SIGNAL[0, 1:]],
        "note": ["a"] * 400,
    }
    loaded = load_recording(write_parquet(tmp_path / "a.parquet", **columns))
    assert (loaded.channels, loaded.unit, loaded.sample_rate) == (("x",), "m/s^2", 4000.0)
    assert np.isnan(loaded.signal[0, 0])
    np.testing.assert_allclose(loaded.signal[0, 1:], SIGNAL[0, 1:] * 9.80665)


@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
def test_time_stamps_of_a_parquet_table_give_the_rate(unit: str, tmp_path: Path) -> None:
    import polars

    start = datetime(2026, 4, 10, 16, 22)
    stamps = polars.Series([start + timedelta(milliseconds=2 * i) for i in range(400)]).cast(
        polars.Datetime(unit)
    )
    loaded = load_recording(
        write_parquet(tmp_path / "a.parquet", time=stamps, x=SIGNAL[0]), unit="1"
    )
    assert (loaded.channels, loaded.sample_rate) == (("x",), 500.0)


def test_an_archive_that_would_run_code_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", x=np.array([1.5, "b", None], dtype=object))
    with pytest.raises(DataError, match="allow_pickle=False"):
        load_recording(tmp_path / "a.npz", unit="1")


# ---- MDF


def write_mdf(path: Path, *groups: tuple[str, np.ndarray, float, str]) -> Path:
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="4.10") as file:
        for name, values, rate, unit in groups:
            time = np.arange(len(values)) / rate
            file.append([asammdf.Signal(values, timestamps=time, name=name, unit=unit)])
        file.save(path, overwrite=True)
    return path


def test_channels_of_one_rate_are_chosen_from_a_measurement_of_several(tmp_path: Path) -> None:
    path = write_mdf(
        tmp_path / "a.mf4",
        ("acc", SIGNAL[0], 25600.0, "g"),
        ("speed", SIGNAL[1, :50], 100.0, "rpm"),
    )
    for facts in ({}, {"channels": ["acc"]}):
        loaded = load_recording(path, **facts)
        assert (loaded.unit, loaded.sample_rate) == ("m/s^2", 25600.0)
        np.testing.assert_allclose(loaded.signal[0], SIGNAL[0] * 9.80665)
    with pytest.raises(
        DataError, match=r"several rates \(acc: 25600 Hz, speed: 100 Hz\), .* with channels"
    ):
        load_recording(path, channels=["*"])


# ---- the time column


def test_a_time_in_minutes_is_not_taken_for_seconds(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(
        "time [min],x\n" + "".join(f"{i / 100:.2f},{i}.5\n" for i in range(60))
    )
    assert load_recording(tmp_path / "a.csv", unit="1").sample_rate == pytest.approx(
        100 / 60, rel=1e-9
    )
    (tmp_path / "a.csv").write_text(
        "time [g],x\n" + "".join(f"{i / 100:.2f},{i}.5\n" for i in range(60))
    )
    with pytest.raises(DataError, match="in 'g', which is not one of s, ms"):
        load_recording(tmp_path / "a.csv", unit="1")


@pytest.mark.parametrize("index", [0, 17, 59])
@pytest.mark.parametrize("error", [0.4, 3.0])
def test_one_wrong_sample_of_the_time_does_not_shift_the_rate(
    index: int, error: float, tmp_path: Path
) -> None:
    recording = Recording(SIGNAL[:1, :60], 25600.0, "a", unit="1")
    time = recording.time
    time[index] += error / 25600 * (-1 if index == 0 else 1)
    lines = "".join(
        f"{t!r},{x!r}\n" for t, x in zip(time.tolist(), recording.signal[0].tolist(), strict=True)
    )
    (tmp_path / "a.csv").write_text("time [s],x\n" + lines)
    assert load_recording(tmp_path / "a.csv", unit="1").sample_rate == 25600.0


@pytest.mark.parametrize("suffix", ["csv", "parquet", "mf4"])
@pytest.mark.parametrize("rate", [1000.0, 25600.0, 44100.0, 51200 / 3, 12345.678])
def test_a_written_time_column_gives_back_the_rate(
    suffix: str, rate: float, tmp_path: Path
) -> None:
    path = write_recording(
        Recording(SIGNAL, rate, "a", channels=("x", "y")), tmp_path / f"a.{suffix}"
    )
    assert load_recording(path).sample_rate == pytest.approx(rate, rel=1e-9)


def test_reading_a_file_runs_no_module_of_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = write_parquet(tmp_path / "a.parquet", x=SIGNAL[0])
    for name in ("polars", "json"):
        (tmp_path / f"{name}.py").write_text(
            f"open({str(tmp_path / 'was_here')!r}, 'w')\n", encoding="utf-8"
        )
    isolation.stop()
    monkeypatch.chdir(tmp_path)
    try:
        assert load_recording(file, sample_rate=1000.0, unit="1").signal.shape[1] == 400
    finally:
        isolation.stop()
    assert not (tmp_path / "was_here").exists()
