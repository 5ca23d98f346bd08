"""Each channel of a file has its own rate and unit, and takes nothing from another channel."""

import re
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from recording_files import write_uff
from scipy.io import savemat

from swashtwin.foundation import DataError
from swashtwin.recordings import load_recording

G = 9.80665

# A fast and a slow channel, in g.
X = np.arange(20.0)
Y = np.arange(20.0) + 0.5
X_RATE = 25_600.0
Y_RATE = 12_800.0

FileWriter = Callable[[Path], Path]


# ---- files of two rates


def write_hdf5_data_sets(folder: Path) -> Path:
    with h5py.File(folder / "a.h5", "w") as file:
        file["x"] = X
        file["x"].attrs.update({"fs": X_RATE, "unit": "g"})
        file["y"] = Y
        file["y"].attrs.update({"fs": Y_RATE, "unit": "g"})
    return folder / "a.h5"


def write_hdf5_groups(folder: Path) -> Path:
    """Write a file whose rate is overridden by that of a group."""
    with h5py.File(folder / "a.h5", "w") as file:
        file.attrs.update({"fs": Y_RATE, "unit": "g"})
        file["fast/x"] = X
        file["fast"].attrs["fs"] = X_RATE
        file["slow/y"] = Y
    return folder / "a.h5"


def write_matlab_structures(folder: Path) -> Path:
    structures = {
        "a": {"x": X, "fs": X_RATE, "unit": "g"},
        "b": {"y": Y, "fs": Y_RATE, "unit": "g"},
    }
    savemat(folder / "a.mat", structures)
    return folder / "a.mat"


def write_archive(folder: Path) -> Path:
    """Write rates whose keys name their channel, before or behind its name."""
    np.savez(folder / "a.npz", x=X, y=Y, x_fs=X_RATE, fs_y=Y_RATE, unit="g")
    return folder / "a.npz"


def write_universal_file(folder: Path) -> Path:
    path = folder / "a.uff"
    write_uff(path, X[None], 1 / X_RATE, "g")
    first_set = path.read_text()
    write_uff(path, Y[None], 1 / Y_RATE, "g")
    second_set = path.read_text().replace("point 0", "point 1")

    path.write_text(first_set + second_set)
    return path


TWO_RATE_FILES = pytest.mark.parametrize(
    "write",
    [
        pytest.param(write_hdf5_data_sets, id="HDF5 data sets"),
        pytest.param(write_hdf5_groups, id="HDF5 groups"),
        pytest.param(write_matlab_structures, id="MATLAB structures"),
        pytest.param(write_archive, id="NPZ keys"),
        pytest.param(write_universal_file, id="universal file"),
    ],
)


@TWO_RATE_FILES
def test_channels_of_two_rates_are_refused_together(write: FileWriter, tmp_path: Path) -> None:
    message = r"several rates \(\S.*: 25600 Hz, \S.*: 12800 Hz\).*with channels"
    with pytest.raises(DataError, match=message) as refusal:
        load_recording(write(tmp_path))

    assert "\n" not in str(refusal.value)


@TWO_RATE_FILES
@pytest.mark.parametrize(
    ("channel", "rate", "values"),
    [pytest.param(0, X_RATE, X, id="fast"), pytest.param(1, Y_RATE, Y, id="slow")],
)
def test_a_selected_channel_has_its_own_rate(
    write: FileWriter, channel: int, rate: float, values: np.ndarray, tmp_path: Path
) -> None:
    loaded = load_recording(write(tmp_path), channels=[channel])

    assert loaded.sample_rate == rate
    np.testing.assert_allclose(loaded.signal[0], values * G)


@TWO_RATE_FILES
def test_the_rate_of_another_channel_contradicts_that_of_the_selected_one(
    write: FileWriter, tmp_path: Path
) -> None:
    with pytest.raises(DataError, match="12800 Hz, but 25600 Hz is specified"):
        load_recording(write(tmp_path), channels=[1], sample_rate="25.6 kHz")


# ---- rates that contradict each other


def test_two_rates_in_an_archive_are_refused_with_their_keys(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", x=X, fs=25600.0, sample_rate=12800.0)

    message = r"two sample rates for x \(fs = 25600\.0, sample_rate = 12800\.0\)"
    with pytest.raises(DataError, match=message):
        load_recording(tmp_path / "a.npz", unit="g")


def test_two_rates_of_a_data_set_are_refused_with_their_attributes(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["x"] = X
        file["x"].attrs.update({"fs": 25600.0, "samplerate": 12800.0})

    message = r"two sample rates for x \(fs = 25600\.0, samplerate = 12800\.0\)"
    with pytest.raises(DataError, match=message):
        load_recording(tmp_path / "a.h5", unit="g")


@pytest.mark.parametrize("rate", [0.0, -5.0])
def test_a_rate_that_is_not_positive_is_refused_even_if_another_is_specified(
    rate: float, tmp_path: Path
) -> None:
    savemat(tmp_path / "a.mat", {"x": X, "fs": rate})

    with pytest.raises(DataError, match=rf"a\.mat states a sample rate of {rate:g} Hz"):
        load_recording(tmp_path / "a.mat", unit="g", sample_rate="1 kHz")


def test_a_negative_rate_gives_way_to_a_second_one(tmp_path: Path) -> None:
    savemat(tmp_path / "b.mat", {"x": X, "fs": -5.0, "sample_rate": 2e3})

    assert load_recording(tmp_path / "b.mat", unit="g").sample_rate == 2e3


# ---- units


@pytest.fixture
def two_units_file(tmp_path: Path) -> Path:
    """Return a file of an acceleration in g and a pressure in Pa."""
    structures = {"fs": 1000.0, "a": {"x": X, "unit": "g"}, "b": {"y": Y, "unit": "Pa"}}
    savemat(tmp_path / "a.mat", structures)
    return tmp_path / "a.mat"


def test_channels_of_two_units_are_refused_together(two_units_file: Path) -> None:
    with pytest.raises(DataError, match="different units"):
        load_recording(two_units_file, channels=["a.x", "b.y"])


def test_only_the_acceleration_is_selected_by_default(two_units_file: Path) -> None:
    assert load_recording(two_units_file).channels == ("a.x",)


def test_a_selected_channel_has_its_own_unit(two_units_file: Path) -> None:
    assert load_recording(two_units_file, channels=["b.y"]).unit == "Pa"

    with pytest.raises(DataError, match=r"'b\.y' is in Pa, but g is specified"):
        load_recording(two_units_file, channels=["b.y"], unit="g")


# ---- vectors of times

TIMES = np.arange(len(X)) / 1000.0


def write_mat_with_times(folder: Path, **variables: object) -> Path:
    savemat(folder / "a.mat", {"x": X, "time": TIMES, "unit": "g", **variables})
    return folder / "a.mat"


def write_npz_with_times(folder: Path, **variables: object) -> Path:
    np.savez(folder / "a.npz", x=X, time=TIMES, unit="g", **variables)  # type: ignore[arg-type]
    return folder / "a.npz"


FILES_WITH_TIMES = pytest.mark.parametrize(
    "write",
    [
        pytest.param(write_mat_with_times, id="MATLAB"),
        pytest.param(write_npz_with_times, id="NPZ"),
    ],
)


@FILES_WITH_TIMES
@pytest.mark.parametrize("variables", [{}, {"fs": 1000.0}], ids=["times alone", "times and rate"])
def test_a_vector_of_times_gives_the_rate_and_is_no_channel(
    write: Callable[..., Path], variables: dict[str, float], tmp_path: Path
) -> None:
    loaded = load_recording(write(tmp_path, **variables))

    assert loaded.channels == ("x",)
    assert loaded.sample_rate == 1000.0


@FILES_WITH_TIMES
def test_a_vector_of_times_that_contradicts_the_rate_is_refused(
    write: Callable[..., Path], tmp_path: Path
) -> None:
    message = "two sample rates for x: 2000 Hz, and 1000 Hz by the times in time"
    with pytest.raises(DataError, match=message):
        load_recording(write(tmp_path, fs=2000.0))


# "t" is also the temperature, the torque or the tangential direction.
@FILES_WITH_TIMES
def test_a_vector_called_t_that_does_not_rise_is_a_channel(
    write: Callable[..., Path], tmp_path: Path
) -> None:
    path = write(tmp_path, fs=1000.0, t=np.sin(np.arange(len(X))))

    assert load_recording(path).channels == ("x", "t")


# ---- units at the end of names


def write_columns(path: Path, *names: str, factor: float = 1.0) -> Path:
    """Write noise in columns behind a time in steps of 0.1 ms."""
    noise = np.random.default_rng(5).standard_normal((2000, len(names)))
    rows = np.column_stack([np.arange(2000) * 1e-4, factor * noise])
    np.savetxt(path, rows, delimiter=",", header=",".join(["time", *names]), comments="")
    return path


TRAILING_UNITS = [
    *(("x_mg", "mg", G * 1e-3), ("DE mg", "mg", G * 1e-3), ("acc_m_s2", "m/s^2", 1.0)),
    *(("acc ms^-2", "m/s^2", 1.0), ("ch1_mps2", "m/s^2", 1.0), ("acc m/s2", "m/s^2", 1.0)),
    *(("acc2 mm/s²", "mm/s^2", 1e-3), ("acc_g", "g", G), ("ax_g", "g", G)),
]


@pytest.mark.parametrize(("name", "unit", "factor"), TRAILING_UNITS)
def test_a_unit_at_the_end_of_a_name_is_that_of_the_column(
    name: str, unit: str, factor: float, tmp_path: Path
) -> None:
    path = write_columns(tmp_path / "a.csv", name)

    loaded = load_recording(path)

    assert (loaded.channels, loaded.unit) == ((name,), "m/s^2")
    assert np.std(loaded.signal) == pytest.approx(factor, rel=0.05)
    other = "m/s^2" if unit == "g" else "g"
    with pytest.raises(DataError, match=f"is in {re.escape(unit)}, but {re.escape(other)} is"):
        load_recording(path, unit=other)


@pytest.mark.parametrize("name", ["vel mm/s", "vel_mm_s", "x_mV"])
def test_a_velocity_or_a_voltage_at_the_end_of_a_name_is_no_acceleration(
    name: str, tmp_path: Path
) -> None:
    with pytest.raises(DataError, match="but g is specified"):
        load_recording(write_columns(tmp_path / "a.csv", name), unit="g")


@pytest.mark.parametrize("names", [("sensor_f", "sensor_g"), ("g",), ("acc_x", "acc_g"), ("x_V",)])
def test_a_letter_that_numbers_a_sensor_is_no_unit(names: tuple[str, ...], tmp_path: Path) -> None:
    path = write_columns(tmp_path / "a.csv", *names)

    assert load_recording(path, unit="m/s^2").channels == names


COUNT_NAMES = pytest.mark.parametrize(
    "name", ["Acc (counts)", "ax_LSB", "ch1 counts", "X [counts]"]
)


@COUNT_NAMES
def test_counts_are_no_acceleration(name: str, tmp_path: Path) -> None:
    path = write_columns(tmp_path / "a.csv", name, factor=500.0)

    with pytest.raises(DataError, match=r"counts?, but g is|LSB, but g is") as refusal:
        load_recording(path, unit="g")

    assert "sensitivity='0.488 mg/count'" in str(refusal.value)
    scaled = load_recording(path, sensitivity="2 mg/count")
    assert np.std(scaled.signal) == pytest.approx(G, rel=0.05)


@pytest.mark.parametrize("name", ["Acc (counts)", "ax_LSB", "many counts here", "counts"])
def test_counts_are_read_as_plain_numbers(name: str, tmp_path: Path) -> None:
    assert load_recording(write_columns(tmp_path / "a.csv", name), unit="1").unit == "1"


# ---- sensitivities without a unit


@pytest.mark.parametrize(
    ("unit", "sensitivity"), [("Volts", "1 V/g"), ("mV", "1 mV/g"), ("counts", "1 g")]
)
def test_the_advice_about_a_sensitivity_without_a_unit_works(
    unit: str, sensitivity: str, tmp_path: Path
) -> None:
    path = tmp_path / "a.mat"
    savemat(path, {"x": X, "x_unit": unit, "x_sensitivity": 100.0, "fs": X_RATE})

    for facts in ({}, {"unit": "g"}):
        with pytest.raises(DataError, match=f"sensitivity='{sensitivity}'"):
            load_recording(path, **facts)

    np.testing.assert_allclose(load_recording(path, sensitivity=sensitivity).signal[0], X * G)


def test_a_sensitivity_beside_an_unknown_unit_may_be_applied(tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", {"x": X, "x_sensitivity": 100.0, "fs": X_RATE})

    np.testing.assert_allclose(load_recording(tmp_path / "a.mat", unit="g").signal[0], X * G)


# ---- channels of another quantity


def test_plain_numbers_are_proposed_for_channels_without_another_unit(tmp_path: Path) -> None:
    path = write_columns(tmp_path / "a.csv", "Acc (g)", "T (degF)")

    with pytest.raises(DataError, match="is in degF") as refusal:
        load_recording(path, channels=("Acc", "T*"))
    assert "unit='1'" not in str(refusal.value)

    with pytest.raises(DataError, match="Set unit='1' to read the plain numbers"):
        load_recording(path, channels=("T*",))
    assert load_recording(path, channels=("T*",), unit="1").unit == "1"
