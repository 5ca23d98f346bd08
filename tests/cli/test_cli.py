"""The command line: what it prints, how it ends, and that one command's output feeds the next."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commandline import AT_15, DEFECT, QUICK, TINY, one_line, run, run_json
from plant import Plant

import swashtwin
from swashtwin.diagnosis import load_classifier
from swashtwin.recordings import load_recordings, write_index, write_recording


@pytest.fixture(scope="module")
def rig(plant: Plant) -> Path:
    """Index of two specimens, two classes, two repeats, at 15 MPa."""
    return plant.pair


@pytest.fixture(scope="module")
def chain(rig: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    """What split, calibrate, synthesize and train answer, each fed with the files of the one
    before.
    """
    folder = tmp_path_factory.mktemp("chain")
    answers = {"split": run_json("data", "split", rig, "--out", folder, "--test-fraction", 0.5)}
    train = answers["split"]["train"]
    out = folder / "calibration.json"
    answers["calibrate"] = run_json(
        "calibrate", train, "--specimen", "A", *AT_15, *DEFECT, *QUICK, "--out", out
    )
    windows = ("--count", 3, "--out", folder / "made.safetensors")
    answers["synthesize"] = run_json("synthesize", out, "--like", train, *windows)
    options = ("--test-fraction", 0, "--out", folder / "model.safetensors", *TINY)
    answers["train"] = run_json("train", train, "--add", folder / "made.safetensors", *options)
    return answers


def test_a_split_written_down_holds_every_recording_once(
    rig: Path, chain: dict[str, dict[str, Any]]
) -> None:
    sides = [
        {recording.recording_id for recording in load_recordings(chain["split"][name])}
        for name in ("train", "test")
    ]
    assert not sides[0] & sides[1]
    assert sides[0] | sides[1] == {recording.recording_id for recording in load_recordings(rig)}
    assert sides[1] == set(chain["split"]["test_recordings"])


def test_calibrate_uses_the_training_side_only_and_saves_what_it_tells(
    chain: dict[str, dict[str, Any]],
) -> None:
    answer = chain["calibrate"]
    assert set(answer["recording_ids"]) <= set(chain["split"]["train_recordings"])
    saved = swashtwin.load_calibration(answer["calibration"])
    assert [estimate["value"] for estimate in answer["estimates"]] == [
        estimate.value for estimate in saved.estimates
    ]
    assert (
        answer["calibrated_agreement"]["spectrum_value_error"]
        < answer["nominal_agreement"]["spectrum_value_error"]
    )
    assert "[interfaces.block_valve]" in Path(answer["interfaces"]).read_text(encoding="utf-8")


def test_the_fidelity_of_synthetic_windows_is_printed(
    chain: dict[str, dict[str, Any]], tmp_path: Path
) -> None:
    words = (
        "synthesize",
        chain["calibrate"]["calibration"],
        "--like",
        chain["split"]["train"],
        "--count",
        3,
    )
    facts = (*words, "--out", tmp_path / "made.safetensors")
    printed = run(*facts).stdout
    assert "Fidelity" in printed
    assert "Features that separate them best" in printed


def test_a_model_knows_every_recording_behind_it(chain: dict[str, dict[str, Any]]) -> None:
    classifier = load_classifier(Path(chain["train"]["model"]))
    assert set(chain["split"]["train_recordings"]) <= set(classifier.manifest)
    assert not set(chain["split"]["test_recordings"]) & set(classifier.manifest)
    assert chain["train"]["synthetic_windows"] == 3


def test_evaluate_tests_on_what_the_model_has_not_seen(
    rig: Path, chain: dict[str, dict[str, Any]]
) -> None:
    answer = run_json("evaluate", chain["train"]["model"], rig)
    assert answer["recordings"] == [
        recording.recording_id
        for recording in load_recordings(rig)
        if recording.recording_id in set(chain["split"]["test_recordings"])
    ]
    assert answer["split"] == "L2"
    assert "All 4 recordings" in one_line(
        run("evaluate", chain["train"]["model"], chain["split"]["train"], code=3)
    )
    assert sum(map(sum, answer["confusion"])) == answer["n_windows"]
    assert "g mean" in run("evaluate", chain["train"]["model"], rig).stdout


def test_train_refuses_to_test_on_a_recording_behind_the_synthetic_windows(
    rig: Path, chain: dict[str, dict[str, Any]], tmp_path: Path
) -> None:
    windows, out = chain["synthesize"]["windows"], tmp_path / "m.safetensors"
    result = run(
        "train",
        rig,
        "--add",
        windows,
        "--test-fraction",
        0.5,
        "--seed",
        1,
        "--out",
        out,
        *TINY,
        code=3,
    )
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


def test_simulate_writes_the_twin_of_a_calibration(
    chain: dict[str, dict[str, Any]], tmp_path: Path
) -> None:
    out = tmp_path / "worn.h5"
    words = ("twin", "simulate", "--duration", "0.2 s", "--out", out, *AT_15, *DEFECT, "--force")
    nominal = run_json(*words)
    calibrated = run_json(*words, "--calibration", chain["calibrate"]["calibration"])
    assert nominal["label"] == calibrated["label"] == "swash_plate"
    assert nominal["rms_m_s2"] != calibrated["rms_m_s2"]
    assert swashtwin.load_recording(out).synthetic
    assert "rms" in run(*words).stdout


@pytest.mark.parametrize(
    ("words", "said"),
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
    words: tuple[object, ...], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "kept").touch()
    assert said in one_line(run(*words, code=3))
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            lambda signal: np.where(np.arange(signal.shape[1]) == 7, np.nan, signal),
            "missing or infinite",
        ),
        (lambda signal: signal * 0 + 1.0, "every sample is 1"),
        (lambda signal: signal[:, :1500], "shorter than one revolution"),
    ],
)
def test_an_unfit_recording_is_named_by_inspect_and_refused_by_train(
    rig: Path, tmp_path: Path, change: Any, said: str
) -> None:
    recordings = load_recordings(rig)
    broken = replace(recordings[0], signal=change(recordings[0].signal))
    files = [
        write_recording(recording, tmp_path / f"{recording.recording_id}.h5")
        for recording in (broken, *recordings[1:])
    ]
    write_index([broken, *recordings[1:]], files, tmp_path)
    report = run_json("inspect", tmp_path, code=3)
    assert report["has_errors"]
    assert said in " ".join(finding["message"] for finding in report["recordings"][0]["findings"])
    refusal = one_line(run("train", tmp_path, "--out", tmp_path / "m.safetensors", *TINY, code=3))
    assert broken.recording_id in refusal
    assert not (tmp_path / "m.safetensors").exists()


def test_mixed_rates_and_a_lone_recording_are_refused(rig: Path, tmp_path: Path) -> None:
    recordings = [recording for recording in load_recordings(rig) if recording.label == "normal"]
    other = replace(recordings[0], sample_rate=12800.0, recording_id="slow", label="swash_plate")
    for name, members in {"mixed": [*recordings, other], "lone": recordings[:1]}.items():
        files = [
            write_recording(recording, tmp_path / name / f"{recording.recording_id}.h5")
            for recording in members
        ]
        write_index(members, files, tmp_path / name)
    assert "12800 Hz: slow (swash_plate)" in one_line(
        run("train", tmp_path / "mixed", *TINY, code=3)
    )
    assert run_json("inspect", tmp_path / "mixed", code=3)["has_errors"]
    assert "can be compared with others of the same machine" in one_line(
        run("train", tmp_path / "lone", code=3)
    )


@pytest.mark.parametrize("kind", ["train", "synthesize"])
def test_a_file_with_tampered_bytes_is_refused(
    rig: Path, chain: dict[str, dict[str, Any]], tmp_path: Path, kind: str
) -> None:
    path = Path(chain[kind]["model" if kind == "train" else "windows"])
    changed = bytearray(path.read_bytes())
    changed[-5] ^= 1
    tampered = tmp_path / path.name
    tampered.write_bytes(changed)
    words = ("evaluate", tampered, rig) if kind == "train" else ("train", rig, "--add", tampered)
    assert "was changed after it was saved" in one_line(run(*words, code=3))
    tampered.write_bytes(changed[:100])
    assert "damaged" in one_line(run(*words, code=3))
