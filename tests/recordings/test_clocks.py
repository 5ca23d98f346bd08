"""Clocks that are written in batches, belong to some rows only, or begin again."""

from pathlib import Path

import h5py
import numpy as np
import polars as pl
import pytest

from swashtwin.foundation import DataError
from swashtwin.recordings import inspect_recordings, load_recording

CASES = Path(__file__).parent / "cases"
G = 9.80665


def vibration(n_samples: int, seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).standard_normal(n_samples)
    return np.asarray(np.round(np.sin(0.3 * np.arange(n_samples)) + 0.2 * noise, 5))


def write_table(
    path: Path, columns: dict[str, np.ndarray], separator: str = ",", decimal: str = "."
) -> Path:
    """Write columns as text; NaN, and what lies below a shorter column, is blank."""
    n_rows = max(map(len, columns.values()))
    lines = [separator.join(columns)]
    for row in range(n_rows):
        cells = []
        for values in columns.values():
            is_blank = row >= len(values) or np.isnan(values[row])
            cells.append("" if is_blank else f"{values[row]:.12g}".replace(".", decimal))
        lines.append(separator.join(cells))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def errors_of(path: Path, **options: object) -> list[str]:
    recording = load_recording(path, **options)
    (report,) = inspect_recordings([recording]).recordings
    return [finding.message for finding in report.findings if finding.severity == "error"]


# ---- batches


def batched(n_samples: int, rate: float, batch: int, stretch: float) -> np.ndarray:
    """Return times of batches, whose samples are `stretch` times as far apart as they were."""
    number = np.arange(n_samples)
    begin = number // batch * batch
    return np.asarray((begin + stretch * (number - begin)) / rate)


def test_a_specified_rate_overrules_a_clock_of_batches() -> None:
    recording = load_recording(CASES / "K13-batch_short.csv", sample_rate="4 kHz")
    (report,) = inspect_recordings([recording]).recordings

    assert recording.sample_rate == 4000
    assert recording.n_samples == 3200
    messages = {finding.severity: finding.message for finding in report.findings}
    assert "error" not in messages
    assert "written in batches" in messages["note"]


def test_without_a_rate_the_batches_are_reported_with_the_mean_rate() -> None:
    (message,) = errors_of(CASES / "K13-batch_short.csv")

    assert "written in batches" in message
    assert "4008.1 Hz" in message


@pytest.mark.parametrize(
    ("heading", "factor", "stretch", "batch"),
    [
        ("time [ms]", 1e3, 0.5, 50),
        ("Zeit [s]", 1.0, 0.9, 32),
        # All samples of a batch have the time at which it was sent.
        ("timestamp_us", 1e6, 0.0, 64),
    ],
)
def test_batches_in_tables_of_other_programs(
    tmp_path: Path, heading: str, factor: float, stretch: float, batch: int
) -> None:
    columns = {
        heading: factor * batched(3000, 2000.0, batch, stretch),
        "acc [g]": vibration(3000),
    }
    path = write_table(tmp_path / "a.csv", columns, ";", ",")

    recording = load_recording(path, sample_rate="2 kHz")

    assert recording.sample_rate == 2000
    assert recording.n_samples == 3000
    assert errors_of(path, sample_rate="2 kHz") == []


def test_batches_of_one_time_ask_for_the_rate(tmp_path: Path) -> None:
    columns = {"time [s]": batched(3000, 2000.0, 64, 0.0), "acc [g]": vibration(3000)}
    pl.DataFrame(columns).write_parquet(tmp_path / "a.parquet")

    with pytest.raises(DataError, match="written in batches") as refusal:
        load_recording(tmp_path / "a.parquet")

    assert refusal.value.field == "sample_rate"
    recording = load_recording(tmp_path / "a.parquet", sample_rate="2 kHz")
    assert recording.sample_rate == 2000


def test_lost_samples_are_no_batches(tmp_path: Path) -> None:
    time = np.arange(4000) / 2000
    is_kept = np.arange(4000) % 200 < 180
    columns = {"time [s]": time[is_kept], "acc [g]": vibration(4000)[is_kept]}
    path = write_table(tmp_path / "a.csv", columns)

    (message,) = errors_of(path, sample_rate="2 kHz")

    assert "the time column has gaps" in message


def with_header(path: Path, header: str, times: np.ndarray) -> Path:
    """Write a table of times [s] and accelerations below header lines."""
    write_table(path, {"time [s]": times, "acc [g]": vibration(len(times))})
    path.write_text(f"{header}\n{path.read_text(encoding='utf-8')}", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("header", "stretch"),
    [
        pytest.param("Sampling frequency [Hz]: 2000", 0.2, id="short steps within a batch"),
        pytest.param("# Sample rate: 2 kHz", 0.0, id="one time for a batch"),
        pytest.param("Abtastrate: 2000 Hz", 0.97, id="steps nearly right"),
    ],
)
def test_the_rate_of_a_header_overrules_a_clock_of_batches(
    tmp_path: Path, header: str, stretch: float
) -> None:
    path = with_header(tmp_path / "a.csv", header, batched(3000, 2000.0, 50, stretch))

    recording = load_recording(path)

    assert recording.sample_rate == 2000
    assert recording.attributes["batch_columns"] == "time"
    assert errors_of(path) == []


@pytest.mark.parametrize(
    "times",
    [
        pytest.param(batched(3000, 4000.0, 50, 0.2), id="batches of another rate"),
        pytest.param(np.arange(3000) / 4000, id="even steps of another rate"),
    ],
)
def test_a_header_that_contradicts_the_mean_of_its_clock_is_refused(
    tmp_path: Path, times: np.ndarray
) -> None:
    path = with_header(tmp_path / "a.csv", "Sampling frequency [Hz]: 2000", times)

    with pytest.raises(DataError, match="states two sample rates"):
        load_recording(path)


def test_a_named_time_column_overrules_the_rate_of_a_header(tmp_path: Path) -> None:
    times = batched(3000, 2000.0, 50, 0.2)
    path = with_header(tmp_path / "a.csv", "Sampling frequency [Hz]: 2000", times)

    assert load_recording(path, time_column="time").sample_rate == 10_000


def test_a_rate_that_contradicts_batches_is_refused() -> None:
    with pytest.raises(DataError, match="5050 Hz"):
        load_recording(CASES / "K13-batch_short.csv", sample_rate="4.4 kHz")


# ---- rows of several sensors


@pytest.mark.parametrize(
    ("channel", "rate", "n_samples"), [("imu0", 1000, 1000), ("imu1", 800, 800)]
)
def test_a_channel_of_a_union_of_rows_has_its_own_rate(
    channel: str, rate: float, n_samples: int
) -> None:
    path = CASES / "K14-union_two_rates.csv"

    recording = load_recording(path, unit="g", channels=(channel,))

    assert (recording.sample_rate, recording.n_samples) == (rate, n_samples)
    assert errors_of(path, unit="g", channels=(channel,)) == []


def test_a_union_of_two_rates_asks_for_the_channels() -> None:
    with pytest.raises(DataError, match=r"imu0: 1000 Hz, imu1: 800 Hz") as refusal:
        load_recording(CASES / "K14-union_two_rates.csv", unit="g")

    assert refusal.value.field == "channels"


def union_table() -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return the rows of an acceleration at 2 kHz and a force at 500 Hz, and both signals.

    The times of the force are among those of the acceleration.
    """
    acceleration = vibration(2000)
    force = vibration(500, 1)
    sparse = np.full(2000, np.nan)
    sparse[::4] = force
    table = {"Zeit [ms]": np.arange(2000) / 2, "Beschl": acceleration, "Kraft": sparse}
    return table, {"Beschl": acceleration, "Kraft": force}


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
@pytest.mark.parametrize(("channel", "rate"), [("Beschl", 2000), ("Kraft", 500)])
def test_a_slower_channel_in_some_of_the_rows(
    tmp_path: Path, suffix: str, channel: str, rate: float
) -> None:
    table, signals = union_table()
    path = tmp_path / f"a.{suffix}"
    if suffix == "csv":
        write_table(path, table, ";", ",")
    else:
        pl.DataFrame(table).write_parquet(path)

    recording = load_recording(path, unit="g", channels=(channel,))

    assert recording.sample_rate == rate
    np.testing.assert_allclose(recording.signal[0], G * signals[channel], rtol=1e-12)


def test_dropouts_are_no_rows_of_another_sensor(tmp_path: Path) -> None:
    signal = vibration(3000)
    signal[np.random.default_rng(2).random(3000) < 0.1] = np.nan
    columns = {"time": np.arange(3000) / 2000, "acc": signal, "other": vibration(3000, 1)}
    path = write_table(tmp_path / "a.csv", columns)

    (message,) = errors_of(path, unit="g", channels=("acc",))

    assert "of 3000 samples are missing" in message


@pytest.mark.parametrize("suffix", ["csv", "npz"])
@pytest.mark.parametrize(
    ("channel", "rate", "n_samples"), [("x", 1000, 2000), ("y", 400, 800), ("z", 800, 1600)]
)
def test_pairs_of_time_and_signal_that_end_in_different_rows(
    tmp_path: Path, suffix: str, channel: str, rate: float, n_samples: int
) -> None:
    columns = {
        "t1": np.arange(2000) / 1000,
        "x": vibration(2000),
        "t2": np.arange(800) / 400,
        "y": vibration(800, 1),
        "t3": np.arange(1600) / 800,
        "z": vibration(1600, 2),
    }
    path = tmp_path / f"a.{suffix}"
    if suffix == "csv":
        write_table(path, columns)
    else:
        np.savez(path, allow_pickle=False, **columns)

    recording = load_recording(path, unit="g", channels=(channel,))

    assert (recording.sample_rate, recording.n_samples) == (rate, n_samples)
    assert errors_of(path, unit="g", channels=(channel,)) == []


@pytest.mark.parametrize(
    "headings",
    [
        ("Time_acc1", "Time_acc2"),
        ("X", "X2"),
        ("t_acc", "t_mic"),
        ("Zeit Sensor A", "Zeit Sensor B"),
    ],
)
def test_times_that_alternate_with_signals_need_no_usual_name(
    tmp_path: Path, headings: tuple[str, str]
) -> None:
    columns = {
        headings[0]: np.arange(3000) / 1000,
        "acc": vibration(3000),
        headings[1]: np.arange(1500) / 500,
        "mic": vibration(1500, 1),
    }
    path = write_table(tmp_path / "a.csv", columns, ";", ",")

    for channel, rate, n_samples in (("acc", 1000, 3000), ("mic", 500, 1500)):
        recording = load_recording(path, unit="g", channels=(channel,))
        assert (recording.sample_rate, recording.n_samples) == (rate, n_samples)


def test_a_pressure_that_rises_beside_a_time_is_no_second_clock(tmp_path: Path) -> None:
    columns = {
        "time [s]": np.arange(3000) / 1000,
        "acc": vibration(3000),
        "pressure": np.arange(3000) / 500,
        "mic": vibration(3000, 1),
    }
    path = write_table(tmp_path / "a.csv", columns)

    assert load_recording(path, unit="g", channels=("mic",)).sample_rate == 1000


@pytest.mark.parametrize(("channel", "rate"), [("a", 1000), ("b", 250)])
def test_pairs_of_one_length_have_the_rate_of_their_own_time(
    tmp_path: Path, channel: str, rate: float
) -> None:
    columns = {
        "time 1 [s]": np.arange(2000) / 1000,
        "a": vibration(2000),
        "time 2 [s]": np.arange(2000) / 250,
        "b": vibration(2000, 1),
    }
    path = write_table(tmp_path / "a.csv", columns)

    recording = load_recording(path, unit="g", channels=(channel,))

    assert recording.sample_rate == rate


# ---- counters that begin again


def test_microseconds_that_begin_again_go_on() -> None:
    recording = load_recording(CASES / "K15-micros.csv", unit="g")

    assert recording.sample_rate == 4000
    assert recording.n_samples == 2000


@pytest.mark.parametrize(
    ("heading", "bits", "step", "divisor", "rate"),
    [
        # 16 bits of microseconds begin again every 65 ms.
        ("micros", 16, 500, 1, 2000),
        ("time_us", 32, 100, 1, 10_000),
        ("timestamp [ms]", 32, 5, 1, 200),
        # A program that divided the counter to seconds.
        ("time [s]", 32, 250, 10**6, 4000),
        ("time_us", 24, 1000, 1, 1000),
    ],
)
def test_counters_of_some_bits_go_on(
    tmp_path: Path, heading: str, bits: int, step: int, divisor: int, rate: float
) -> None:
    counts = ((1 << bits) - 700 * step - 3 + step * np.arange(2000)) % (1 << bits)
    path = write_table(tmp_path / "a.csv", {heading: counts / divisor, "ax": vibration(2000)})

    recording = load_recording(path, unit="g")

    assert recording.sample_rate == pytest.approx(rate, rel=1e-9)
    assert recording.n_samples == 2000
    assert errors_of(path, unit="g") == []


def test_an_unsigned_counter_in_hdf5_goes_on(tmp_path: Path) -> None:
    counts = (np.uint32(4294960000) + np.uint32(50) * np.arange(3000, dtype=np.uint32)).astype(
        np.uint32
    )
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time_us"] = counts
        file["acc"] = vibration(3000)

    recording = load_recording(tmp_path / "a.h5", unit="g")

    assert recording.sample_rate == 20_000
    assert recording.n_samples == 3000


def test_ticks_that_begin_again_need_their_unit_only(tmp_path: Path) -> None:
    counts = (60_000 + 40 * np.arange(4000)) % 65_536
    path = write_table(tmp_path / "a.csv", {"ticks": counts, "ax": vibration(4000)})

    recording = load_recording(path, unit="g", time_column="ticks", time_unit="us")

    assert recording.sample_rate == 25_000
    assert recording.n_samples == 4000


def test_a_clock_that_is_set_to_zero_begins_another_recording(tmp_path: Path) -> None:
    columns = {"time_us": np.tile(50 * np.arange(1000), 2), "ax": vibration(2000)}
    path = write_table(tmp_path / "a.csv", columns)

    with pytest.raises(DataError, match="different start times"):
        load_recording(path, unit="g")


def test_blocks_of_65536_samples_are_not_joined(tmp_path: Path) -> None:
    time = np.tile(np.arange(65_536), 2)
    pl.DataFrame({"time_ms": time, "ax": vibration(2 * 65_536)}).write_parquet(
        tmp_path / "a.parquet"
    )

    with pytest.raises(DataError, match="different start times"):
        load_recording(tmp_path / "a.parquet", unit="g")


def test_samples_lost_as_a_counter_begins_again_are_a_gap(tmp_path: Path) -> None:
    counts = (2**32 - 700 * 250 + 250 * np.arange(2000)) % 2**32
    kept = np.delete(counts, [699, 700, 701]).astype(float)
    path = write_table(tmp_path / "a.csv", {"micros": kept, "ax": vibration(1997)})

    (message,) = errors_of(path, unit="g")

    assert "the worst is 0.001 s" in message


def test_ticks_without_a_unit_ask_for_it_or_for_the_rate(tmp_path: Path) -> None:
    counts = (60_000.0 + 40 * np.arange(4000)) % 65_536
    path = write_table(tmp_path / "a.csv", {"ticks": counts, "ax": vibration(4000)})

    with pytest.raises(DataError) as refusal:
        load_recording(path, unit="g")

    assert refusal.value.field in ("time_unit", "sample_rate")


@pytest.mark.parametrize(("rate", "period"), [(10_000, 500), (1000, 300), (20_000, 1100)])
def test_samples_that_are_lost_now_and_then_lower_no_rate(
    tmp_path: Path, rate: int, period: int
) -> None:
    counts = np.arange(8000)
    counts = counts[counts % period != 7]
    path = write_table(tmp_path / "a.csv", {"time (s)": counts / rate, "a": vibration(len(counts))})
    recording = load_recording(path, unit="g")
    assert recording.sample_rate == rate
    assert "differ from the usual" in recording.attributes["time_gaps"]


def test_a_clock_that_is_sometimes_read_late_lost_nothing(tmp_path: Path) -> None:
    times = np.arange(8000) / 1000
    times[7::300] += 0.6e-3
    path = write_table(tmp_path / "a.csv", {"time (s)": times, "a": vibration(8000)})
    assert load_recording(path, unit="g").sample_rate == 1000
