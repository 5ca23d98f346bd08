"""Public sets are read with the groups that their folders imply, as published and as staged."""

import csv
import gzip
import shutil
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat
from scipy.stats import kurtosis

from swashtwin.foundation import DataError, MissingFileError
from swashtwin.learning import cut_windows
from swashtwin.recordings import Recording
from swashtwin_bench import read_public_set
from swashtwin_bench.public.readers.cwru import _records, read_cwru
from swashtwin_bench.public.readers.uci_hydraulic import read_uci_hydraulic
from swashtwin_bench.public.sets import PUBLIC_SETS


def rows_of(folder: Path, name: str = "files.csv") -> list[dict[str, str]]:
    with (folder / name).open() as file:
        return list(csv.DictReader(file))


def attribute_of(recordings: list[Recording], name: str) -> list[str]:
    return [recording.attributes[name] for recording in recordings]


# ---- bearings


def test_every_known_bearing_record_has_the_facts_of_the_staged_table(public_data: Path) -> None:
    records = _records()
    for row in rows_of(public_data / "cwru"):
        record = records[int(row["record"])][0]
        assert record.label == row["label"]
        assert str(record.mil) == row["fault_size_mil"]
        assert str(record.load) == row["load_hp"]
        assert record.kilohertz * 1000 == int(row["fs_hz"])
        assert record.specimen == row["bearing_id"]
        assert record.position == row["or_position"]

        # a healthy record is read at the drive end first
        faulty_end = row["faulty_end"] if row["faulty_end"] != "none" else "DE"
        assert record.end == faulty_end


def test_every_record_of_the_bearing_set_is_known() -> None:
    # the set has 161 records; the four normal ones are read at both ends
    assert sum(len(group) for group in _records().values()) == 161 + 4


@pytest.fixture(scope="module")
def bearings(public_data: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Recording]:
    """Recordings of six files that differ in rate, end and speed."""
    folder = tmp_path_factory.mktemp("cwru")
    rows = {row["record"]: row for row in rows_of(public_data / "cwru")}
    for number in ("97", "105", "174", "237", "278", "3001"):
        shutil.copy(public_data / "cwru" / rows[number]["file"], folder)
    return read_cwru(folder)


def test_a_bearing_is_read_at_its_faulty_end_and_a_healthy_one_at_both(
    bearings: list[Recording],
) -> None:
    assert [recording.recording_id for recording in bearings] == [
        "cwru_97_DE",
        "cwru_97_FE",
        "cwru_105_DE",
        "cwru_174_DE",
        "cwru_237_DE",
        "cwru_278_FE",
        "cwru_3001_DE",
    ]
    assert [recording.specimen for recording in bearings[:2]] == ["DE-healthy", "FE-healthy"]


def test_bearing_recordings_have_their_own_rates_and_speeds(bearings: list[Recording]) -> None:
    rates = [recording.sample_rate for recording in bearings]
    assert rates == [48e3, 48e3, 12e3, 48e3, 12e3, 12e3, 12e3]

    # record 97 has its measured speed; 3001 has none, and so that of its load
    speeds = attribute_of(bearings, "speed")
    assert speeds[1:3] == ["1796 rpm", "1797 rpm"]
    assert speeds[-1] == "1797 rpm"


def test_bearing_recordings_have_their_published_kurtosis(
    bearings: list[Recording], public_data: Path
) -> None:
    rows = {row["record"]: row for row in rows_of(public_data / "cwru")}
    for recording in bearings:
        if recording.attributes["end"] != "DE":
            continue
        # published to three decimals
        expected = float(rows[recording.attributes["record"]]["kurtosis_DE"])
        assert kurtosis(recording.signal[0], fisher=False) == pytest.approx(expected, abs=6e-4)


@pytest.fixture
def record_236(public_data: Path, tmp_path: Path) -> Path:
    """File of record 236 in a folder with the staged table."""
    row = next(row for row in rows_of(public_data / "cwru") if row["record"] == "236")
    path = tmp_path / row["file"]
    path.parent.mkdir()
    shutil.copy(public_data / "cwru" / row["file"], path)
    shutil.copy(public_data / "cwru" / "files.csv", tmp_path)
    return path


@pytest.mark.usefixtures("record_236")
def test_the_staged_table_adds_known_problems(tmp_path: Path) -> None:
    (recording,) = read_cwru(tmp_path)
    assert recording.attributes["known_problem"].startswith("DE clipped in sections")


def test_a_file_with_another_checksum_than_in_the_staged_table_is_refused(
    record_236: Path, tmp_path: Path
) -> None:
    savemat(record_236, {"X236_DE_time": np.arange(5.0), "X236RPM": 1748.0})
    with pytest.raises(DataError, match="not the file that was indexed"):
        read_cwru(tmp_path)


def test_bearing_files_of_the_original_site_are_read(tmp_path: Path) -> None:
    # file 99 also holds the signals of 98, as the published one does
    vectors = {}
    for number in ("098", "099"):
        for end in ("DE", "FE"):
            vectors[f"X{number}_{end}_time"] = np.arange(5.0) + int(number)
    savemat(tmp_path / "99.mat", {**vectors, "X099RPM": 1748.0})

    fan_end_fault = {"X279_DE_time": np.arange(4.0), "X279_FE_time": np.arange(6.0)}
    savemat(tmp_path / "12k_FE_IR007_1_279.mat", fan_end_fault)
    # a name without the number of its record is no record
    savemat(tmp_path / "B007.mat", {"X118_DE_time": np.arange(4.0)})

    drive, fan, fault = read_cwru(tmp_path)
    np.testing.assert_allclose(drive.signal[0], (np.arange(5.0) + 99) * 9.80665)
    assert drive.attributes["speed"] == "1748 rpm"
    assert (fan.attributes["end"], fan.label) == ("FE", "normal")
    assert fault.signal.shape == (1, 6)
    assert (fault.attributes["speed"], fault.specimen) == ("1772 rpm", "FE-inner_race-7")


def test_a_bearing_file_without_its_signal_is_refused(tmp_path: Path) -> None:
    savemat(tmp_path / "122_0.mat", {"x": np.arange(4.0)})
    with pytest.raises(DataError, match=r"no variable X\.\.\._DE_time; it has x"):
        read_cwru(tmp_path)


# ---- pumps


@pytest.fixture(scope="module")
def cavitation(public_data: Path) -> list[Recording]:
    return read_public_set("pump_cavitation", public_data / "pump_cavitation")


@pytest.fixture(scope="module")
def hydraulic(public_data: Path) -> list[Recording]:
    return read_public_set("uci_hydraulic", public_data / "uci_hydraulic")


def test_the_cavitation_set_has_its_speeds_states_and_repeats(cavitation: list[Recording]) -> None:
    cells = Counter(
        (recording.attributes["speed_nominal"], recording.label) for recording in cavitation
    )
    assert len(cells) == 15
    assert set(cells.values()) == {3}
    repeats = Counter(attribute_of(cavitation, "repeat"))
    assert repeats == {"1": 15, "2": 15, "3": 15}


def test_cavitation_recordings_have_their_rate_speed_and_flow(cavitation: list[Recording]) -> None:
    layouts = {(recording.sample_rate, recording.signal.shape) for recording in cavitation}
    assert layouts == {(6400.0, (5, 32810))}

    attributes = cavitation[0].attributes
    assert (attributes["speed"], attributes["flow"]) == ("714 rpm", "2.741 m^3/h")
    # ten windows of each of the 45 recordings
    assert len(cut_windows(cavitation, length=3281)) == 450


def test_cavitation_files_are_known_by_their_original_names(
    public_data: Path, tmp_path: Path
) -> None:
    name = "15_3_s1200_cavitation100"
    staged = public_data / "pump_cavitation" / "recordings" / f"{name}.dat.gz"
    content = gzip.decompress(staged.read_bytes())
    # the original names have spaces
    (tmp_path / "15 3 s1200 cavitation100.dat").write_bytes(content)
    (tmp_path / "notes.dat").write_text("of something else")

    (recording,) = read_public_set("pump_cavitation", tmp_path)
    assert (recording.recording_id, recording.label) == (name, "cavitation100")
    assert recording.attributes["speed"] == recording.attributes["speed_nominal"] == "1200 rpm"

    # the first column is the time
    table = np.loadtxt(content.decode().splitlines(), skiprows=8)
    np.testing.assert_array_equal(recording.signal, table[:, 1:].T)


@pytest.mark.nightly
def test_the_motor_set_has_the_blocks_of_its_table(public_data: Path) -> None:
    folder = public_data / "motor_pump_industrial"
    recordings = read_public_set("motor_pump_industrial", folder)
    rows = {row["file"]: row for row in rows_of(folder)}
    assert len(recordings) == len(rows) == 220

    for recording in recordings:
        attributes = recording.attributes
        row = rows[attributes["file"]]
        assert recording.label == row["label"]
        assert (attributes["block"], attributes["transient"]) == (row["block"], row["transient"])

        assert recording.sample_rate == 1000.0
        assert recording.channels == ("x", "y", "z")
        assert recording.signal.shape == (3, 5000)


@pytest.mark.nightly
def test_the_hydraulic_set_has_the_labels_and_runs_of_its_table(
    public_data: Path, hydraulic: list[Recording]
) -> None:
    rows = rows_of(public_data / "uci_hydraulic", "cycles.csv")
    assert len(hydraulic) == len(rows) == 2205

    for recording, row in zip(hydraulic, rows, strict=True):
        assert recording.label == row.pop("label")
        assert {name: recording.attributes[name] for name in row} == row
        assert recording.signal.shape == (17, 600)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("name", "path"),
    [
        ("FS1", "original/FS1.txt.gz"),
        ("PS3", "mean_1hz/PS3_mean1hz.tsv.gz"),
    ],
)
def test_slow_sensors_of_the_hydraulic_set_are_held_and_fast_ones_are_as_measured(
    name: str, path: str, public_data: Path, hydraulic: list[Recording]
) -> None:
    recording = hydraulic[700]
    with gzip.open(public_data / "uci_hydraulic" / path, "rt") as file:
        expected = np.array(file.readlines()[700].split(), dtype=float)

    # a cycle lasts 60 s and has 600 samples
    channel = recording.signal[recording.channels.index(name)]
    np.testing.assert_array_equal(channel, np.repeat(expected, 600 // len(expected)))
    assert recording.attributes[f"{name}_rate"] == f"{len(expected) // 60} Hz"


def save_table(path: Path, values: object, number_format: str) -> None:
    np.savetxt(path, np.asarray(values), fmt=number_format, delimiter="\t")


PROFILE = (
    (3, 100, 0, 130, 1),
    (3, 100, 0, 130, 0),
    (3, 100, 2, 130, 0),
    (20, 100, 0, 130, 0),
)
"""Cooler, valve, leakage, accumulator and stability of four cycles."""

PRESSURE = np.random.default_rng(0).normal(150, 1, (4, 6000)).round(2)
"""Pressure of four cycles at 100 Hz."""


@pytest.fixture(scope="module")
def originals(tmp_path_factory: pytest.TempPathFactory) -> list[Recording]:
    """Four cycles in the form in which the set was published."""
    folder = tmp_path_factory.mktemp("originals")
    save_table(folder / "profile.txt", PROFILE, "%d")
    save_table(folder / "PS1.txt", PRESSURE, "%.2f")
    save_table(folder / "TS1.txt", np.arange(240.0).reshape(4, 60), "%.3f")
    return read_uci_hydraulic(folder)


@pytest.mark.nightly
def test_hydraulic_originals_of_100_hz_become_means_over_a_tenth_of_a_second(
    originals: list[Recording],
) -> None:
    means = PRESSURE[2].reshape(600, 10).mean(axis=1)
    np.testing.assert_allclose(originals[2].signal[0], means, rtol=1e-12)


@pytest.mark.nightly
def test_the_profile_of_hydraulic_originals_gives_labels_and_groups(
    originals: list[Recording],
) -> None:
    labels = [recording.label for recording in originals]
    assert labels == ["no_leakage", "no_leakage", "severe_leakage", "no_leakage"]

    # a run ends when the leakage of the pump changes, a block when the cooler does
    assert attribute_of(originals, "pump_run") == ["0", "0", "1", "2"]
    assert attribute_of(originals, "cooler_block") == ["0", "0", "0", "1"]


def test_a_sensor_of_the_hydraulic_set_with_other_cycles_is_refused(tmp_path: Path) -> None:
    save_table(tmp_path / "profile.txt", PROFILE, "%d")
    (tmp_path / "TS1.txt").write_text("1.5\t2\n")
    with pytest.raises(DataError, match="1 cycles"):
        read_uci_hydraulic(tmp_path)


def test_a_damaged_table_of_the_hydraulic_set_is_refused_by_its_name(tmp_path: Path) -> None:
    save_table(tmp_path / "profile.txt", PROFILE, "%d")
    (tmp_path / "TS1.txt").write_text("1.5\t2\n1.5\tx\n")
    with pytest.raises(DataError, match=r"TS1\.txt is not a table of numbers"):
        read_uci_hydraulic(tmp_path)


# ---- folders of something else


@pytest.mark.parametrize("name", PUBLIC_SETS)
def test_a_missing_or_empty_folder_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="not a folder"):
        read_public_set(name, tmp_path / "nowhere")
    with pytest.raises(DataError, match="Give the folder that holds the set"):
        read_public_set(name, tmp_path)


@pytest.mark.parametrize("name", PUBLIC_SETS)
def test_a_folder_of_other_files_is_refused_in_one_line(name: str, tmp_path: Path) -> None:
    # files with the suffixes of the sets
    savemat(tmp_path / "a.mat", {"x": np.arange(5.0)})
    for file_name in ("a.dat", "a.txt"):
        (tmp_path / file_name).write_text("a,b\n1.5,2\n")

    with pytest.raises(DataError, match="holds no") as error:
        read_public_set(name, tmp_path)
    assert "\n" not in str(error.value)
