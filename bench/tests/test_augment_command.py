"""A scarce cell of one's own recordings, filled on the command line."""

from pathlib import Path

import numpy as np
import pytest
from commandline import one_line, run, run_json

from swashtwin.foundation import MPa, rpm, stream
from swashtwin.learning import load_windows
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording, write_index, write_recording
from swashtwin_bench import FILLERS

FACTS = ("--label", "piston", "--pressure", "15 MPa", "--count", 8, "--window", 256)


@pytest.fixture(scope="module")
def index(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three recordings of each of two classes at two pressures, of which one cell has one."""
    folder = tmp_path_factory.mktemp("own")
    recordings = []
    for label, pressure, number in [(a, b, c) for a in ("normal", "piston") for b in (10, 15) for c in range(3)]:
        if (label, pressure) == ("piston", 15) and number:
            continue
        name = f"{label}_{pressure}_{number}"
        signal = stream(0, name).normal(size=(2, 2000)) * (1 + 0.2 * number)
        condition = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(pressure))
        recordings.append(
            Recording(signal, 3000.0, name, channels=("x", "y"), label=label, specimen="A", condition=condition)
        )
    files = [write_recording(recording, folder / f"{recording.recording_id}.h5") for recording in recordings]
    return write_index(recordings, files, folder)


def test_a_filled_cell_is_written_for_training_and_its_likeness_told(index: Path, tmp_path: Path) -> None:
    out = tmp_path / "cell.safetensors"
    answer = run_json("bench", "augment", index, "--filler", "jitter", *FACTS, "--out", out)
    assert (answer["count"], answer["measured_in_cell"], answer["pressure_pa"]) == (8, 7, MPa(15))
    assert answer["compared_with"] == "training windows of the cell"
    assert answer["fidelity"]["discriminative_auroc"] is None  # the cell has one recording
    assert set(answer["fidelity"]["spectral_distance_db"]) == {"x", "y"}
    windows = load_windows(out)
    assert windows.synthetic.all()
    assert len(windows.manifest) == 10
    model = tmp_path / "model.safetensors"
    facts = (
        "--test-fraction",
        0,
        "--network",
        "spectral_bitcn",
        "--set",
        "epochs=1",
        "--set",
        "channels=2",
        "--out",
        model,
    )
    trained = run_json("train", index, "--add", out, *facts)
    assert trained["synthetic_windows"] == 8


def test_held_out_recordings_are_compared_with_where_they_are_given(index: Path, tmp_path: Path) -> None:
    run("data", "split", index, "--test-fraction", 0.4, "--out", tmp_path / "parts")
    parts = ("--held-out", tmp_path / "parts" / "test.toml", "--out", tmp_path / "cell.safetensors")
    facts = ("--label", "normal", "--pressure", "10 MPa", "--count", 8, "--window", 256)
    answer = run_json("bench", "augment", tmp_path / "parts" / "train.toml", "--filler", "duplicate", *facts, *parts)
    assert answer["compared_with"] == "held-out windows of the cell"
    said = run(
        "bench", "augment", tmp_path / "parts" / "train.toml", "--filler", "smote", *facts, *parts, "--seed", 1
    ).stdout
    assert "held-out windows of the cell" in said
    assert "swashtwin train" in said


def test_a_pressure_is_not_given_to_windows_that_state_none(tmp_path: Path) -> None:
    signals = [stream(0, str(number)).normal(size=(2, 2000)) for number in range(2)]
    recordings = [
        Recording(signal, 3000.0, f"p{index}", channels=("x", "y"), label="piston")
        for index, signal in enumerate(signals)
    ]
    files = [write_recording(recording, tmp_path / f"{recording.recording_id}.h5") for recording in recordings]
    index, out = write_index(recordings, files, tmp_path), tmp_path / "cell.safetensors"
    line = one_line(run("bench", "augment", index, "--filler", "jitter", *FACTS, "--out", out, code=3))
    assert "states its pressure" in line
    assert not out.exists()
    run("bench", "augment", index, "--filler", "jitter", *FACTS[:2], *FACTS[4:], "--out", out)
    assert out.is_file()


def test_what_cannot_be_filled_is_said_in_a_line(index: Path, tmp_path: Path) -> None:
    out = ("--out", tmp_path / "cell.safetensors")
    assert "--filler" in run("bench", "augment", index, "--filler", "gan", *FACTS, *out, code=2).stderr
    assert "--pressure" in one_line(
        run(
            "bench",
            "augment",
            index,
            "--filler",
            "jitter",
            "--label",
            "piston",
            "--count",
            8,
            "--window",
            256,
            *out,
            code=3,
        )
    )
    assert "not among the windows' classes" in one_line(
        run("bench", "augment", index, "--filler", "jitter", *FACTS[2:], "--label", "slipper", *out, code=3)
    )
    assert not (tmp_path / "cell.safetensors").exists()
    assert np.all([name in run("bench", "augment", "--help").stdout for name in FILLERS])
