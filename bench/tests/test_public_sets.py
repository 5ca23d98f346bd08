"""Public sets are read with the groups their makers' folders imply, as published and as staged."""

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


@pytest.fixture(scope="module")
def cavitation(public_data: Path) -> list[Recording]:
    return read_public_set("pump_cavitation", public_data / "pump_cavitation")


@pytest.fixture(scope="module")
def hydraulic(public_data: Path) -> list[Recording]:
    return read_public_set("uci_hydraulic", public_data / "uci_hydraulic")


# ---- bearings


def test_every_known_bearing_record_has_the_facts_of_the_staged_table(public_data: Path) -> None:
    records = _records()
    for row in rows_of(public_data / "cwru"):
        record = records[int(row["record"])][0]
        assert (record.label, str(record.mil), str(record.load)) == (
            row["label"],
            row["fault_size_mil"],
            row["load_hp"],
        )
        assert (record.kilohertz * 1000, record.specimen) == (int(row["fs_hz"]), row["bearing_id"])
        assert record.position == row["or_position"]
        assert record.end == (row["faulty_end"] if row["faulty_end"] != "none" else "DE")
    assert (
        sum(len(group) for group in records.values()) == 161 + 4
    )  # the set has 161; the normal ones at both ends


def test_bearing_recordings_have_their_own_rates_speeds_and_published_kurtosis(
    public_data: Path, tmp_path: Path
) -> None:
    rows = {row["record"]: row for row in rows_of(public_data / "cwru")}
    for number in ("97", "105", "174", "237", "278", "3001"):
        shutil.copy(public_data / "cwru" / rows[number]["file"], tmp_path)
    recordings = read_cwru(tmp_path)
    assert [recording.recording_id for recording in recordings] == [
        "cwru_97_DE",
        "cwru_97_FE",
        "cwru_105_DE",
        "cwru_174_DE",
        "cwru_237_DE",
        "cwru_278_FE",
        "cwru_3001_DE",
    ]
    assert [recording.sample_rate for recording in recordings] == [
        48e3,
        48e3,
        12e3,
        48e3,
        12e3,
        12e3,
        12e3,
    ]
    assert [recording.attributes["speed"] for recording in recordings[1:3]] == [
        "1796 rpm",
        "1797 rpm",
    ]
    assert recordings[-1].attributes["speed"] == "1797 rpm"  # it has no speed of its own
    assert [recording.specimen for recording in recordings[:2]] == ["DE-healthy", "FE-healthy"]
    for recording in recordings:
        row = rows[recording.attributes["record"]]
        if recording.attributes["end"] == "DE":
            assert kurtosis(recording.signal[0], fisher=False) == pytest.approx(
                float(row["kurtosis_DE"]), abs=6e-4
            )


def test_the_staged_table_adds_checksums_and_known_problems(
    public_data: Path, tmp_path: Path
) -> None:
    row = next(row for row in rows_of(public_data / "cwru") if row["record"] == "236")
    path = tmp_path / row["file"]
    path.parent.mkdir()
    shutil.copy(public_data / "cwru" / row["file"], path)
    shutil.copy(public_data / "cwru" / "files.csv", tmp_path)
    (recording,) = read_cwru(tmp_path)
    assert recording.attributes["known_problem"].startswith("DE clipped in sections")
    savemat(path, {"X236_DE_time": np.arange(5.0), "X236RPM": 1748.0})
    with pytest.raises(DataError, match="not the file that was indexed"):
        read_cwru(tmp_path)


def test_a_bearing_file_of_the_original_site_is_read_at_its_faulty_end(tmp_path: Path) -> None:
    vectors = {
        f"X{number}_{end}_time": np.arange(5.0) + int(number)
        for number in ("098", "099")
        for end in ("DE", "FE")
    }
    savemat(tmp_path / "99.mat", {**vectors, "X099RPM": 1748.0})
    savemat(
        tmp_path / "12k_FE_IR007_1_279.mat",
        {"X279_DE_time": np.arange(4.0), "X279_FE_time": np.arange(6.0)},
    )
    savemat(tmp_path / "B007.mat", {"X118_DE_time": np.arange(4.0)})
    drive, fan, fault = read_cwru(tmp_path)
    np.testing.assert_allclose(drive.signal[0], (np.arange(5.0) + 99) * 9.80665)
    assert (drive.attributes["speed"], fan.attributes["end"], fan.label) == (
        "1748 rpm",
        "FE",
        "normal",
    )
    assert (fault.signal.shape, fault.attributes["speed"], fault.specimen) == (
        (1, 6),
        "1772 rpm",
        "FE-inner_race-7",
    )
    savemat(tmp_path / "122_0.mat", {"x": np.arange(4.0)})
    with pytest.raises(DataError, match=r"no variable X\.\.\._DE_time; it has x"):
        read_cwru(tmp_path)


# ---- pumps


def test_the_cavitation_set_has_its_speeds_states_and_repeats(cavitation: list[Recording]) -> None:
    cells = Counter(
        (recording.attributes["speed_nominal"], recording.label) for recording in cavitation
    )
    assert len(cells) == 15
    assert set(cells.values()) == {3}
    assert Counter(recording.attributes["repeat"] for recording in cavitation) == {
        "1": 15,
        "2": 15,
        "3": 15,
    }
    assert {(recording.sample_rate, recording.signal.shape) for recording in cavitation} == {
        (6400.0, (5, 32810))
    }
    assert (cavitation[0].attributes["speed"], cavitation[0].attributes["flow"]) == (
        "714 rpm",
        "2.741 m^3/h",
    )
    assert len(cut_windows(cavitation, length=3281)) == 450


def test_cavitation_files_are_known_by_their_original_names(
    public_data: Path, tmp_path: Path
) -> None:
    staged = public_data / "pump_cavitation" / "recordings" / "15_3_s1200_cavitation100.dat.gz"
    content = gzip.decompress(staged.read_bytes())
    (tmp_path / "15 3 s1200 cavitation100.dat").write_bytes(content)
    (tmp_path / "notes.dat").write_text("of something else")
    (recording,) = read_public_set("pump_cavitation", tmp_path)
    assert (recording.recording_id, recording.label) == (
        "15_3_s1200_cavitation100",
        "cavitation100",
    )
    assert recording.attributes["speed"] == recording.attributes["speed_nominal"] == "1200 rpm"
    np.testing.assert_array_equal(
        recording.signal, np.loadtxt(content.decode().splitlines(), skiprows=8)[:, 1:].T
    )


@pytest.mark.nightly
def test_the_motor_set_has_the_blocks_of_its_table(public_data: Path) -> None:
    folder = public_data / "motor_pump_industrial"
    recordings = read_public_set("motor_pump_industrial", folder)
    table = {row["file"]: row for row in rows_of(folder)}
    assert len(recordings) == len(table) == 220
    for recording in recordings:
        row = table[recording.attributes["file"]]
        assert (
            recording.label,
            recording.attributes["block"],
            recording.attributes["transient"],
        ) == (
            row["label"],
            row["block"],
            row["transient"],
        )
    assert {
        (recording.sample_rate, recording.channels, recording.signal.shape)
        for recording in recordings
    } == {(1000.0, ("x", "y", "z"), (3, 5000))}


@pytest.mark.nightly
def test_the_hydraulic_set_has_the_labels_and_runs_of_its_table(
    public_data: Path, hydraulic: list[Recording]
) -> None:
    table = rows_of(public_data / "uci_hydraulic", "cycles.csv")
    assert len(hydraulic) == len(table) == 2205
    for recording, row in zip(hydraulic, table, strict=True):
        assert recording.label == row.pop("label")
        assert {name: recording.attributes[name] for name in row} == row
    assert {recording.signal.shape for recording in hydraulic} == {(17, 600)}


@pytest.mark.nightly
def test_slow_sensors_of_the_hydraulic_set_are_held_and_fast_ones_are_as_measured(
    public_data: Path, hydraulic: list[Recording]
) -> None:
    folder, recording = public_data / "uci_hydraulic", hydraulic[700]
    for name, path in (("FS1", "original/FS1.txt.gz"), ("PS3", "mean_1hz/PS3_mean1hz.tsv.gz")):
        with gzip.open(folder / path, "rt") as file:
            expected = np.array(file.readlines()[700].split(), dtype=float)
        row = recording.signal[recording.channels.index(name)]
        np.testing.assert_array_equal(row, np.repeat(expected, 600 // len(expected)))
        assert recording.attributes[f"{name}_rate"] == f"{len(expected) // 60} Hz"


@pytest.mark.nightly
def test_hydraulic_originals_of_100_hz_become_means_over_a_tenth_of_a_second(
    tmp_path: Path,
) -> None:
    pressure = np.random.default_rng(0).normal(150, 1, (4, 6000)).round(2)
    np.savetxt(tmp_path / "PS1.txt", pressure, fmt="%.2f", delimiter="\t")
    np.savetxt(tmp_path / "TS1.txt", np.arange(240.0).reshape(4, 60), fmt="%.3f", delimiter="\t")
    profile = [(3, 100, 0, 130, 1), (3, 100, 0, 130, 0), (3, 100, 2, 130, 0), (20, 100, 0, 130, 0)]
    np.savetxt(tmp_path / "profile.txt", profile, fmt="%d", delimiter="\t")
    recordings = read_uci_hydraulic(tmp_path)
    np.testing.assert_allclose(
        recordings[2].signal[0], pressure[2].reshape(600, 10).mean(axis=1), rtol=1e-12
    )
    assert [recording.label for recording in recordings] == [
        "no_leakage",
        "no_leakage",
        "severe_leakage",
        "no_leakage",
    ]
    assert [recording.attributes["pump_run"] for recording in recordings] == ["0", "0", "1", "2"]
    assert [recording.attributes["cooler_block"] for recording in recordings] == [
        "0",
        "0",
        "0",
        "1",
    ]
    (tmp_path / "TS1.txt").write_text("1.5\t2\n")
    with pytest.raises(DataError, match="1 cycles"):
        read_uci_hydraulic(tmp_path)


# ---- folders of something else


@pytest.mark.parametrize("name", PUBLIC_SETS)
def test_a_folder_without_the_set_is_refused_in_one_line(name: str, tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="not a folder"):
        read_public_set(name, tmp_path / "nowhere")
    with pytest.raises(DataError, match="Give the folder that holds the set"):
        read_public_set(name, tmp_path)
    savemat(tmp_path / "a.mat", {"x": np.arange(5.0)})
    for other in ("a.dat", "a.txt"):
        (tmp_path / other).write_text("a,b\n1.5,2\n")
    with pytest.raises(DataError, match="holds no") as caught:
        read_public_set(name, tmp_path)
    assert "\n" not in str(caught.value)
