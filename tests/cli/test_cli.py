"""The command line: what it prints, how it exits, and that one command's output feeds the next."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commandline import AT_15, DEFECT, QUICK, TINY, one_line, run, run_json
from plant import Plant

import swashtwin
from swashtwin.diagnosis import load_classifier
from swashtwin.recordings import Recording, load_recordings, write_index, write_recording

Answers = dict[str, dict[str, Any]]
"""JSON of each command of the chain, by its name."""


@pytest.fixture(scope="module")
def rig(plant: Plant) -> Path:
    """Return the index of two specimens, two classes, two repeats, at 15 MPa."""
    return plant.pair


@pytest.fixture(scope="module")
def chain(rig: Path, tmp_path_factory: pytest.TempPathFactory) -> Answers:
    """Return the answers of split, calibrate, synthesize and train, each fed with the previous."""
    folder = tmp_path_factory.mktemp("chain")
    calibration = folder / "calibration.json"
    windows = folder / "made.safetensors"
    model = folder / "model.safetensors"

    answers = {"split": run_json("data", "split", rig, "--out", folder, "--test-fraction", 0.5)}
    train_index = answers["split"]["train"]
    answers["calibrate"] = run_json(
        "calibrate", train_index, "--specimen", "A", *AT_15, *DEFECT, *QUICK, "--out", calibration
    )
    answers["synthesize"] = run_json(
        "synthesize", calibration, "--like", train_index, "--count", 3, "--out", windows
    )
    answers["train"] = run_json(
        "train", train_index, "--add", windows, "--test-fraction", 0, "--out", model, *TINY
    )
    return answers


def write_indexed(recordings: Sequence[Recording], folder: Path) -> None:
    """Write recordings and their index to a folder."""
    files = [
        write_recording(recording, folder / f"{recording.recording_id}.h5")
        for recording in recordings
    ]
    write_index(recordings, files, folder)


def test_a_split_contains_every_recording_once(rig: Path, chain: Answers) -> None:
    train_ids = {recording.recording_id for recording in load_recordings(chain["split"]["train"])}
    test_ids = {recording.recording_id for recording in load_recordings(chain["split"]["test"])}

    assert not train_ids & test_ids
    assert train_ids | test_ids == {recording.recording_id for recording in load_recordings(rig)}
    assert test_ids == set(chain["split"]["test_recordings"])


def test_calibrate_uses_only_the_training_side_and_saves_what_it_prints(chain: Answers) -> None:
    answer = chain["calibrate"]
    assert set(answer["recording_ids"]) <= set(chain["split"]["train_recordings"])

    saved = swashtwin.load_calibration(answer["calibration"])
    printed_values = [estimate["value"] for estimate in answer["estimates"]]
    assert printed_values == [estimate.value for estimate in saved.estimates]

    calibrated_error = answer["calibrated_agreement"]["spectrum_value_error"]
    nominal_error = answer["nominal_agreement"]["spectrum_value_error"]
    assert calibrated_error < nominal_error
    assert "[interfaces.block_valve]" in Path(answer["interfaces"]).read_text(encoding="utf-8")


def test_the_fidelity_of_synthetic_windows_is_printed(chain: Answers, tmp_path: Path) -> None:
    calibration = chain["calibrate"]["calibration"]
    train_index = chain["split"]["train"]
    out = tmp_path / "made.safetensors"

    printed = run(
        "synthesize", calibration, "--like", train_index, "--count", 3, "--out", out
    ).stdout

    assert "Fidelity" in printed
    assert "Features that separate them best" in printed


def test_a_model_lists_every_recording_that_it_rests_on(chain: Answers) -> None:
    classifier = load_classifier(Path(chain["train"]["model"]))

    assert set(chain["split"]["train_recordings"]) <= set(classifier.manifest)
    assert not set(chain["split"]["test_recordings"]) & set(classifier.manifest)
    assert chain["train"]["synthetic_windows"] == 3


def test_evaluate_tests_only_on_recordings_that_were_not_trained_on(
    rig: Path, chain: Answers
) -> None:
    model = chain["train"]["model"]
    test_ids = set(chain["split"]["test_recordings"])

    answer = run_json("evaluate", model, rig)
    assert answer["recordings"] == [
        recording.recording_id
        for recording in load_recordings(rig)
        if recording.recording_id in test_ids
    ]
    assert answer["split"] == "L2"
    assert sum(map(sum, answer["confusion"])) == answer["n_windows"]
    assert "g mean" in run("evaluate", model, rig).stdout

    refusal = one_line(run("evaluate", model, chain["split"]["train"], code=3))
    assert "Excluded: 4 that the model was trained on" in refusal


def test_train_refuses_to_test_on_a_recording_behind_the_synthetic_windows(
    rig: Path, chain: Answers, tmp_path: Path
) -> None:
    windows = chain["synthesize"]["windows"]
    out = tmp_path / "m.safetensors"
    options = ("--add", windows, "--test-fraction", 0.5, "--seed", 1, "--out", out)

    result = run("train", rig, *options, *TINY, code=3)

    assert "Split the recordings first" in one_line(result)
    assert not out.exists()


def test_a_new_pump_is_shown_with_every_number_and_its_source(tmp_path: Path) -> None:
    path = run_json("twin", "pump", "new", "mine.toml", "--out", tmp_path)["pump"]
    assert path == str(tmp_path / "mine.toml")

    answer = run_json("twin", "pump", "show", path)
    assert answer["name"] == "mine"
    assert all(parameter["source"] for parameter in answer["parameters"])
    units = {parameter["name"]: parameter["unit"] for parameter in answer["parameters"]}
    assert units["interfaces.block_valve.stiffness"] == "N/m"
    assert set(units) == set(swashtwin.load_pump(path).sources)

    assert "block_valve" in run("twin", "pump", "show").stdout


def test_simulate_writes_the_twin_of_a_calibration(chain: Answers, tmp_path: Path) -> None:
    out = tmp_path / "worn.h5"
    calibration = chain["calibrate"]["calibration"]
    command = ("twin", "simulate", "--duration", "0.2 s", "--out", out, *AT_15, *DEFECT, "--force")

    nominal = run_json(*command)
    calibrated = run_json(*command, "--calibration", calibration)

    assert nominal["label"] == calibrated["label"] == "swash_plate"
    assert nominal["rms_m_s2"] != calibrated["rms_m_s2"]
    assert swashtwin.load_recording(out).synthetic
    assert "rms" in run(*command).stdout


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (("inspect", "nowhere.h5"), "nowhere.h5 does not exist"),
        (("calibrate", "nowhere.toml", *AT_15), "nowhere.toml does not exist"),
        (("evaluate", "nowhere.safetensors", "nowhere"), "nowhere.safetensors does not exist"),
        (("train", "nowhere", "--add", "no.safetensors"), "no.safetensors does not exist"),
        (("twin", "pump", "show", "26scy"), "25scy14-1b"),
        (("bench", "rig", ".", "--seed", 0), "not empty"),
    ],
)
def test_bad_input_ends_with_one_line_and_code_3(
    command: tuple[object, ...], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "original").touch()

    assert message in one_line(run(*command, code=3))
    assert [path.name for path in tmp_path.iterdir()] == ["original"]


def with_missing_sample(signal: np.ndarray) -> np.ndarray:
    return np.where(np.arange(signal.shape[1]) == 7, np.nan, signal)


def made_constant(signal: np.ndarray) -> np.ndarray:
    return signal * 0 + 1.0


def cut_short(signal: np.ndarray) -> np.ndarray:
    # 1,500 samples at 25.6 kHz are 0.84 turns at 860 rpm
    return signal[:, :1500]


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (with_missing_sample, "missing or infinite"),
        (made_constant, "every sample is 1"),
        (cut_short, "shorter than one revolution"),
    ],
)
def test_an_unusable_recording_is_reported_by_inspect_and_refused_by_train(
    rig: Path, tmp_path: Path, damage: Callable[[np.ndarray], np.ndarray], message: str
) -> None:
    first, *others = load_recordings(rig)
    damaged = replace(first, signal=damage(first.signal))
    write_indexed([damaged, *others], tmp_path)
    model = tmp_path / "m.safetensors"

    report = run_json("inspect", tmp_path, code=3)
    assert report["has_errors"]
    findings = report["recordings"][0]["findings"]
    assert message in " ".join(finding["message"] for finding in findings)

    refusal = one_line(run("train", tmp_path, "--out", model, *TINY, code=3))
    assert damaged.recording_id in refusal
    assert not model.exists()


def test_recordings_of_different_rates_are_refused(rig: Path, tmp_path: Path) -> None:
    healthy = [recording for recording in load_recordings(rig) if recording.label == "normal"]
    slow = replace(healthy[0], sample_rate=12800.0, recording_id="slow", label="swash_plate")
    write_indexed([*healthy, slow], tmp_path)

    refusal = one_line(run("train", tmp_path, *TINY, code=3))
    assert "12800 Hz: slow (swash_plate)" in refusal
    assert run_json("inspect", tmp_path, code=3)["has_errors"]


def test_a_single_healthy_recording_is_refused(rig: Path, tmp_path: Path) -> None:
    healthy = [recording for recording in load_recordings(rig) if recording.label == "normal"]
    write_indexed(healthy[:1], tmp_path)

    refusal = one_line(run("train", tmp_path, code=3))
    assert "can be compared with others of the same machine" in refusal


@pytest.mark.parametrize("kind", ["train", "synthesize"])
def test_a_file_with_tampered_bytes_is_refused(
    rig: Path, chain: Answers, tmp_path: Path, kind: str
) -> None:
    if kind == "train":
        original = Path(chain["train"]["model"])
    else:
        original = Path(chain["synthesize"]["windows"])
    tampered = tmp_path / original.name
    if kind == "train":
        command: tuple[object, ...] = ("evaluate", tampered, rig)
    else:
        command = ("train", rig, "--add", tampered)

    # one bit of a tensor near the end
    content = bytearray(original.read_bytes())
    content[-5] ^= 1
    tampered.write_bytes(content)
    assert "was changed after it was saved" in one_line(run(*command, code=3))

    # a file cut off within its header
    tampered.write_bytes(content[:100])
    assert "damaged" in one_line(run(*command, code=3))
