"""Event logs and descriptions of a device that recorders write are left out by name."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from swashtwin.foundation import DataError
from swashtwin.recordings import propose_index

CASES = Path(__file__).parent / "cases"


def write_table(path: Path, n_rows: int, label: str = "") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = ["acc,label" if label else "acc"]
    for sample in np.random.default_rng(n_rows).normal(size=n_rows):
        rows.append(f"{sample:.4f},{label}" if label else f"{sample:.4f}")
    path.write_text("\n".join(rows))


def test_meta_files_of_a_phone_are_left_out_in_one_note(tmp_path: Path) -> None:
    folder = shutil.copytree(CASES / "K21-phone", tmp_path / "phone")
    (folder / "meta" / "device.csv").write_text(
        '"property","value"\n"deviceModel","Pixel 7"\n"fileFormat","1.17"\n'
    )

    proposal = propose_index(folder, unit="m/s^2", sample_rate="400 Hz")

    assert [entry["file"] for entry in proposal.index["recording"]] == ["Raw Data.csv"]
    (finding,) = proposal.skipped
    assert finding.message.startswith("meta/device.csv, meta/time.csv: text and few numbers")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("events.txt", "Zeit;Ereignis\n0,5;Start\n12,25;Pumpe an\n60,0;Pumpe aus\n"),
        ("log/sensor_info.tsv", "key\tvalue\nvendor\tBosch\nrange\t16\nfirmware\tv2.1\n"),
        ("marks.csv", "1,2026-01-03,Pump on\n2,2026-01-03,Pump off\n3,2026-01-03,Pump on\n"),
    ],
)
def test_event_logs_and_descriptions_are_left_out(tmp_path: Path, name: str, text: str) -> None:
    write_table(tmp_path / "normal_1.csv", 2000)
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text(text)

    proposal = propose_index(tmp_path, unit="g", sample_rate="1 kHz")

    assert [entry["file"] for entry in proposal.index["recording"]] == ["normal_1.csv"]
    (finding,) = proposal.skipped
    assert finding.message.startswith(f"{name}: text and few numbers")


def test_a_short_recording_with_a_column_of_words_is_not_left_out(tmp_path: Path) -> None:
    write_table(tmp_path / "wear_1.csv", 2000)
    write_table(tmp_path / "normal_1.csv", 50)
    write_table(tmp_path / "normal_2.csv", 900, label="normal")

    proposal = propose_index(tmp_path, unit="g", sample_rate="1 kHz")

    assert len(proposal.index["recording"]) == 3
    assert not proposal.skipped


def slow_log(heading: str, step_s: float, n_rows: int) -> str:
    rows = [f"{step_s * row:g},{40 + row % 7 + row / 100:.2f}" for row in range(n_rows)]
    return "\n".join([heading, *rows])


def result_table(heading: str, first_cell: str, n_rows: int) -> str:
    rows = [f"{first_cell}{row},{row}.5,{row}.25,3.{row}" for row in range(n_rows)]
    return "\n".join([heading, *rows])


@pytest.mark.parametrize(
    ("name", "text", "reason"),
    [
        (
            "temperatures.csv",
            slow_log("time (s),oil temperature (degF)", 10.0, 60),
            "holds no vibration: oil temperature (degF)",
        ),
        ("load.csv", slow_log("t [s],Torque (N m)", 0.001, 4000), "holds no vibration: Torque"),
        ("trend.csv", slow_log("t [s],Channel 1", 1.0, 3000), "is a log at 1 Hz, too slow"),
        ("oil.csv", slow_log("time,oil", 10.0, 30), "holds 30 rows of oil without a sample rate"),
        (
            "results.csv",
            result_table("file,rms,peak,kurtosis", "15MPa_", 40),
            "holds 40 rows of rms, peak, kurtosis without a sample rate",
        ),
        (
            "summary.csv",
            result_table("run,rms,peak,kurtosis", "", 6),
            "holds 6 rows of run, rms, peak and 1 more without a sample rate",
        ),
    ],
)
@pytest.mark.parametrize("unit", [None, "1", "g"])
def test_logs_and_results_beside_recordings_are_left_out(
    name: str, text: str, reason: str, unit: str | None, tmp_path: Path
) -> None:
    for label in ("normal", "piston"):
        write_table(tmp_path / label / "1.csv", 2000)
        recording = tmp_path / label / "1.csv"
        recording.write_text(
            recording.read_text().replace("acc", "acc" if unit == "1" else "acc (g)")
        )
    (tmp_path / name).write_text(text)

    proposal = propose_index(tmp_path, unit=unit, sample_rate="10 kHz")

    files = [entry["file"] for entry in proposal.index["recording"]]
    assert files == ["normal/1.csv", "piston/1.csv"]
    (finding,) = proposal.skipped
    assert name in finding.message
    if unit != "g":  # with g, a file of other quantities is refused before
        assert f"{name} {reason}" in finding.message
        assert finding.remedy == "If it is a recording, add it to the index."


def test_other_quantities_are_indexed_if_there_is_no_vibration(tmp_path: Path) -> None:
    for label in ("normal", "piston"):
        text = slow_log("t [s],Torque (N m)", 0.001, 4000)
        (tmp_path / f"{label}.csv").write_text(text)

    proposal = propose_index(tmp_path, unit="1")

    assert len(proposal.index["recording"]) == 2
    assert not proposal.skipped


def test_an_error_of_a_slow_log_alone_is_reported(tmp_path: Path) -> None:
    (tmp_path / "normal.csv").write_text(slow_log("t [s],Channel 1", 1.0, 300))

    with pytest.raises(DataError, match=r"a sample rate of 1 Hz, but 10000 Hz is specified"):
        propose_index(tmp_path, unit="g", sample_rate="10 kHz")


def test_a_folder_of_files_that_are_not_supported_names_their_suffixes(tmp_path: Path) -> None:
    for number in range(3):
        (tmp_path / f"normal_{number}.xls").write_text("1\t2\n")

    with pytest.raises(DataError, match=r"no file to index, but 3 \.xls files: supported are"):
        propose_index(tmp_path, unit="g")


@pytest.mark.parametrize(
    ("names", "listed"),
    [
        (["piston_1.xls"], "piston_1.xls"),
        (["b/p_6.zip", "b/p_7.bin", "p_5.xlsx"], "b/p_6.zip, b/p_7.bin, p_5.xlsx"),
        (["piston_1", "run.2024"], "piston_1, run.2024"),
    ],
)
def test_files_of_unknown_formats_are_left_out_in_one_note(
    names: list[str], listed: str, tmp_path: Path
) -> None:
    write_table(tmp_path / "normal_1.csv", 200)
    for name in [*names, "README.md", "desktop.ini", "Thumbs.db", ".git/index", "train.toml"]:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"\1\2")

    proposal = propose_index(tmp_path, unit="g", sample_rate="1 kHz")
    included = propose_index(tmp_path, unit="g", sample_rate="1 kHz", include=["normal*"])

    (finding,) = proposal.skipped
    assert finding.message == f"{listed}: files of formats that cannot be read."
    assert "save these as CSV" in finding.remedy
    assert not included.skipped
