"""Twins that fill what recordings lack, on the command line: synthesize and train."""

import shutil
from pathlib import Path

import pytest
from commandline import one_line, run, run_json
from plant import Plant

from swashtwin.foundation import MPa, mm
from swashtwin.learning import load_windows
from swashtwin.pump import SwashPlateDefect
from swashtwin.recordings import load_recordings, write_index, write_recording
from swashtwin.synthesis import Filling
from swashtwin_bench import rig_recordings
from swashtwin_bench.rigs.writing import RigSize

PUMP = "25scy14-1b"
RECESS = "swash_plate=swash_plate:depth=0.07mm"


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of two pumps at two pressures without the recess at 15 MPa."""
    folder = tmp_path_factory.mktemp("rig")
    pairs = rig_recordings(
        0, RigSize(2, 2, 1.2), labels=("normal", "swash_plate"), pressures=(MPa(10), MPa(15))
    )
    recordings = [
        recording for recording, _ in pairs if "swash_plate_15MPa" not in recording.recording_id
    ]
    files = [
        write_recording(recording, folder / f"{recording.recording_id}.h5")
        for recording in recordings
    ]
    write_index(recordings, files, folder)
    return folder


def test_synthesize_without_a_class_fills_what_is_short(rig: Path, tmp_path: Path) -> None:
    out = tmp_path / "filled.safetensors"
    options = ("--fill", "cells", "--count", 2, "--fault-of", RECESS, "--window", 2048)
    answer = run_json("synthesize", PUMP, "--like", rig, *options, "--out", out)

    cells = answer["filling"]["cells"]
    filled = [(cell["label"], cell["pressure"], cell["count"]) for cell in cells if cell["count"]]
    assert filled == [("swash_plate", MPa(15), 2)]

    # the shell and Python make the same windows
    filling = Filling(
        PUMP, fill="cells", count=2, fault_of={"swash_plate": SwashPlateDefect(depth=mm(0.07))}
    )
    plan = filling.plan(load_recordings(rig), window=2048)
    assert (load_windows(out).signal == plan.simulate().signal).all()
    assert answer["filling"]["notes"] == list(plan.notes)


def test_synthesize_prints_the_plan(rig: Path, tmp_path: Path) -> None:
    out = tmp_path / "filled.safetensors"
    options = ("--fill", "points", "--count", 1, "--window", 2048)
    result = run("synthesize", PUMP, "--like", rig, *options, "--out", out)

    assert "Filling (points): 2 synthetic windows in 2 cells" in result.stdout
    assert "0 (short)" in result.stdout
    assert "severities of swash_plate are typical values" in result.stderr
    assert f"train {rig} --add {out}" in " ".join(result.stdout.split())


def test_nothing_to_fill_is_reported_before_anything_is_written(rig: Path, tmp_path: Path) -> None:
    out = tmp_path / "filled.safetensors"
    # the healthy class is the only one left, at no point short
    index = rig / "recordings.toml"
    healthy = tmp_path / "healthy.toml"
    recordings = load_recordings(index).where(label="normal")
    files = [rig / f"{recording.recording_id}.h5" for recording in recordings]
    write_index(recordings, files, healthy)

    line = one_line(run("synthesize", PUMP, "--like", healthy, "--out", out, code=3))
    assert "There is nothing to simulate. All recordings are healthy." in line
    assert "--fault-of" in line
    assert not out.exists()

    # the fix that it proposes works
    options = ("--fault-of", "piston=piston", "--fill", "all", "--count", 1)
    run("synthesize", PUMP, "--like", healthy, *options, "--out", out)
    assert set(load_windows(out).label) == {"normal", "piston"}


def test_train_fills_what_is_short_in_one_command(rig: Path, tmp_path: Path) -> None:
    out = tmp_path / "model.safetensors"
    network = ("--network", "extra_trees", "--set", "trees=5", "--window", 2048)
    options = ("--twin", PUMP, "--fault-of", RECESS, "--test-fraction", 0.4)
    answer = run_json("train", rig, *options, *network, "--out", out)

    filled = {
        (cell["label"], cell["pressure"]): cell["count"] for cell in answer["filling"]["cells"]
    }
    assert filled["swash_plate", MPa(15)] == filled["normal", MPa(15)] == 72
    assert answer["synthetic_windows"] == sum(filled.values())
    assert answer["held_out"]
    assert run_json("evaluate", out, rig)["recordings"] == answer["held_out"]

    result = run("train", rig, *options, *network, "--out", out, "--force")
    assert result.stdout.index("Filling (points)") < result.stdout.index("trained on")
    # synthetic windows are no recordings that could calibrate the confidence
    n_trained = len(load_recordings(rig)) - len(answer["held_out"])
    assert f"the {n_trained} " in " ".join(result.stderr.split())


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        pytest.param(("--fill", "all", "--fault", "piston"), "--fault-of", id="one fault"),
        pytest.param(("--pressure", "15 MPa"), "windows of one class", id="one pressure"),
        pytest.param(("--count", "3"), "pumps, fill cells: add --fill", id="nominal, one class"),
        pytest.param(
            ("--count", "3", "--fault-of", "a=piston"), "Use --fault.", id="faults of one class"
        ),
        pytest.param(("--fill", "all", "--fault-of", "piston"), "must be CLASS=FAULT", id="pair"),
    ],
)
def test_options_of_one_class_and_of_filling_do_not_mix(
    rig: Path, tmp_path: Path, options: tuple[str, ...], reason: str
) -> None:
    out = tmp_path / "filled.safetensors"
    stderr = run("synthesize", PUMP, "--like", rig, *options, "--out", out, code=2).stderr
    assert reason in " ".join(stderr.replace("│", " ").split())


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        pytest.param(("--fill", "all"), "Specify one with --twin", id="no twin"),
        pytest.param(("--twin", PUMP, "--add", "x"), "does not combine with --twin", id="add"),
    ],
)
def test_train_names_the_option_that_is_missing(
    rig: Path, options: tuple[str, ...], reason: str
) -> None:
    stderr = run("train", rig, *options, code=2).stderr
    assert reason in " ".join(stderr.replace("│", " ").split())


def test_a_healthy_class_of_another_name_is_refused(rig: Path, tmp_path: Path) -> None:
    # It got no window, but all faults did.
    options = ("--fault-of", "as new=normal", "--out", tmp_path / "filled.safetensors")
    line = one_line(run("synthesize", PUMP, "--like", rig, *options, code=3))
    assert "Label healthy recordings normal" in line


def test_an_unknown_fault_is_reported_with_its_class(rig: Path) -> None:
    line = one_line(run("train", rig, "--twin", PUMP, "--fault-of", "ice=glace", code=3))
    assert "The class 'ice' stands for 'glace'. Invalid fault 'glace': must be one of" in line


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        pytest.param(
            "fill.h5",
            "holds synthetic windows, not a twin: add them with train --add",
            id="windows",
        ),
        pytest.param("recordings.h5", "is not a twin", id="recordings"),
        pytest.param("model.safetensors", "holds a classifier, not a twin", id="model"),
    ],
)
def test_another_file_in_place_of_a_twin_is_reported(
    name: str, reason: str, rig: Path, plant: Plant, tmp_path: Path
) -> None:
    originals = {"fill.h5": plant.synthetic, "recordings.h5": plant.worn}
    shutil.copy(originals.get(name, plant.model), tmp_path / name)

    line = one_line(run("train", rig, "--twin", tmp_path / name, code=3))

    assert f"{name} {reason}. A twin is a calibration (.json" in line
    assert "or one of 25scy14-1b" in line


def test_a_missing_calibration_is_reported(rig: Path) -> None:
    line = one_line(run("train", rig, "--twin", "nowhere.json", code=3))
    assert "nowhere.json" in line


def test_a_decimal_comma_of_a_fault_is_reported_with_its_remedy(rig: Path) -> None:
    # It separated the dimensions, and the error was one of --fault.
    options = ("--twin", PUMP, "--fault-of", "piston=piston:clearance=0,06mm")
    stderr = run("train", rig, *options, code=2).stderr
    assert "Write a decimal point: 'piston:clearance=0.06mm'" in stderr


def test_another_file_than_a_calibration_is_reported(rig: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.json"
    other.write_text('{"format": "h5"}')
    line = one_line(run("train", rig, "--twin", other, code=3))
    assert "not a calibration" in line
    assert "alibrate again" not in line
