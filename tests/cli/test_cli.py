"""The command line: what it prints, how it ends, and that one command's output feeds the next."""

import resource
import shlex
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commandline import AT_15, DEFECT, QUICK, TINY, one_line, run, run_json

import swashtwin
from swashtwin.calibration import GaussNewton, load_calibration
from swashtwin.diagnosis import load_classifier
from swashtwin.foundation import MPa
from swashtwin.learning import TrainingSettings, load_windows
from swashtwin.pump import new_pump
from swashtwin.recordings import Recording, load_recordings, write_index, write_recording
from swashtwin_bench import rig_recordings
from swashtwin_bench.rigs.writing import RigSize
from swashtwin_bench.rivals.models import DEFAULT, MODELS, Model
from swashtwin_bench.studies.plans import plan_of


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two specimens, two classes, two repeats, at 15 MPa."""
    folder = tmp_path_factory.mktemp("rig")
    size = RigSize(specimens=2, repeats=2, duration=1.3)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("swashtwin_bench.rigs.writing.PRESSURES", (MPa(15),))
        recordings = [recording for recording, _ in rig_recordings(0, size, labels=("normal", "swash_plate"))]
    files = [write_recording(recording, folder / f"{recording.recording_id}.h5") for recording in recordings]
    write_index(recordings, files, folder)
    return folder


@pytest.fixture(scope="module")
def chain(rig: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    """What split, calibrate, synthesize and train answer, each fed with the files of the one before."""
    folder = tmp_path_factory.mktemp("chain")
    answers = {"split": run_json("data", "split", rig, "--out", folder, "--test-fraction", 0.5)}
    train = answers["split"]["train"]
    out = folder / "calibration.json"
    answers["calibrate"] = run_json("calibrate", train, *AT_15, *DEFECT, *QUICK, "--out", out)
    windows = ("--count", 3, "--out", folder / "made.safetensors")
    answers["synthesize"] = run_json("synthesize", out, "--like", train, *windows)
    options = ("--test-fraction", 0, "--out", folder / "model.safetensors", *TINY)
    answers["train"] = run_json("train", train, "--add", folder / "made.safetensors", *options)
    return answers


def test_a_split_written_down_holds_every_recording_once(rig: Path, chain: dict[str, dict[str, Any]]) -> None:
    sides = [
        {recording.recording_id for recording in load_recordings(chain["split"][name])} for name in ("train", "test")
    ]
    assert not sides[0] & sides[1]
    assert sides[0] | sides[1] == {recording.recording_id for recording in load_recordings(rig)}
    assert sides[1] == set(chain["split"]["test_recordings"])


def test_calibrate_uses_the_training_side_only_and_saves_what_it_tells(chain: dict[str, dict[str, Any]]) -> None:
    answer = chain["calibrate"]
    assert set(answer["recording_ids"]) <= set(chain["split"]["train_recordings"])
    saved = swashtwin.load_calibration(answer["calibration"])
    assert [estimate["value"] for estimate in answer["estimates"]] == [estimate.value for estimate in saved.estimates]
    assert answer["fit_after"]["spectrum_value_error"] < answer["fit_before"]["spectrum_value_error"]
    assert "[interfaces.block_valve]" in Path(answer["interfaces"]).read_text(encoding="utf-8")


def test_a_housing_that_bends_is_kept_by_the_calibrated_twin(chain: dict[str, dict[str, Any]], tmp_path: Path) -> None:
    freed = ("--set", "phases=false", "--set", "nuisances=housing", "--set", "starts=1")
    train, out = chain["split"]["train"], tmp_path / "twin.json"
    answer = run_json("calibrate", train, *AT_15, *DEFECT, *freed, "--set", "bounds=3", "--out", out)
    assert answer["fit_after"]["spectrum_value_error"] < answer["fit_before"]["spectrum_value_error"]
    twin = load_calibration(out).twin
    assert twin.path is not None
    assert twin.scales.excitation != 1


def test_synthetic_windows_carry_the_recordings_behind_them(chain: dict[str, dict[str, Any]]) -> None:
    windows = load_windows(chain["synthesize"]["windows"])
    assert len(windows) == 3
    assert windows.synthetic.all()
    assert set(windows.manifest) == set(chain["split"]["train_recordings"])


def test_the_fidelity_of_synthetic_windows_is_printed(chain: dict[str, dict[str, Any]], tmp_path: Path) -> None:
    words = ("synthesize", chain["calibrate"]["calibration"], "--like", chain["split"]["train"], "--count", 3)
    facts = (*words, "--out", tmp_path / "made.safetensors")
    printed = run(*facts).stdout
    assert "fidelity: " in printed
    assert "Features that tell them most" in printed
    answer = run_json(*facts)
    assert {"auroc", "features", "spectral_distance_db"} <= set(answer["fidelity"])


def test_a_model_knows_every_recording_behind_it(chain: dict[str, dict[str, Any]]) -> None:
    classifier = load_classifier(Path(chain["train"]["model"]))
    assert set(chain["split"]["train_recordings"]) <= set(classifier.manifest)
    assert not set(chain["split"]["test_recordings"]) & set(classifier.manifest)
    assert chain["train"]["synthetic_windows"] == 3


def test_evaluate_tests_on_what_the_model_has_not_seen(rig: Path, chain: dict[str, dict[str, Any]]) -> None:
    answer = run_json("evaluate", chain["train"]["model"], rig, "--level", "L2")
    assert answer["recordings"] == [
        recording.recording_id
        for recording in load_recordings(rig)
        if recording.recording_id in set(chain["split"]["test_recordings"])
    ]
    assert answer["level"] == "L2"
    assert "is stated" not in run("evaluate", chain["train"]["model"], rig, "--level", "L2").stderr
    assert "these recordings are L2" in " ".join(
        run("evaluate", chain["train"]["model"], rig, "--level", "L4").stderr.split()
    )
    assert sum(map(sum, answer["confusion"])) == answer["n_windows"]
    assert "g mean" in run("evaluate", chain["train"]["model"], rig).stdout


def test_diagnose_names_a_class_and_writes_a_report(
    rig: Path, chain: dict[str, dict[str, Any]], tmp_path: Path
) -> None:
    file, model, test = next(rig.glob("*.h5")), chain["train"]["model"], chain["split"]["test"]
    answer = run_json("diagnose", model, file, test, "--report", tmp_path)
    assert answer["diagnoses"][0]["recording_id"] == file.stem
    assert len(answer["diagnoses"]) == 1 + len(load_recordings(test))
    assert Path(answer["report"]).is_file()


def test_train_holds_whole_recordings_out(rig: Path, tmp_path: Path) -> None:
    answer = run_json("train", rig, "--test-fraction", 0.5, "--out", tmp_path / "m.safetensors", *TINY)
    manifest = load_classifier(Path(answer["model"])).manifest
    assert answer["held_out"]
    assert not set(answer["held_out"]) & set(manifest)
    scores = run_json("evaluate", answer["model"], rig)
    assert sorted(scores["recordings"]) == answer["held_out"]


def test_train_refuses_to_test_on_a_recording_behind_the_synthetic_windows(
    rig: Path, chain: dict[str, dict[str, Any]], tmp_path: Path
) -> None:
    windows, out = chain["synthesize"]["windows"], tmp_path / "m.safetensors"
    result = run("train", rig, "--add", windows, "--test-fraction", 0.5, "--seed", 1, "--out", out, *TINY, code=3)
    assert "split first" in one_line(result)
    assert not out.exists()


def test_an_interrupted_training_goes_on_to_the_same_bits(
    rig: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ("train", rig, "--test-fraction", 0.5, *TINY, "--set", "epochs=2")
    run(*words, "--out", tmp_path / "straight.safetensors")
    resumable = (*words, "--out", tmp_path / "resumed.safetensors", "--checkpoint", tmp_path / "checkpoint")
    from swashtwin.learning.training import loop

    save = loop.save_checkpoint

    def save_and_interrupt(*arguments: Any) -> None:
        save(*arguments)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(loop, "save_checkpoint", save_and_interrupt)
        assert "--resume" in one_line(run(*resumable, code=130))
    assert not (tmp_path / "resumed.safetensors").exists()
    assert run_json(*resumable, "--resume")["epochs"] == 2
    assert (tmp_path / "resumed.safetensors").read_bytes() == (tmp_path / "straight.safetensors").read_bytes()


def test_an_interrupted_rig_goes_on_to_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from swashtwin_bench.rigs import writing

    real, written = writing.write_recording, iter(range(3))

    def interrupted(recording: Recording, path: Path) -> Path:
        if next(written, None) is None:
            raise KeyboardInterrupt
        return real(recording, path)

    monkeypatch.setattr(writing, "SIZES", {"small": RigSize(specimens=1, repeats=1, duration=0.2)})
    monkeypatch.setattr(writing, "PRESSURES", (MPa(15),))
    with monkeypatch.context() as patch:
        patch.setattr(writing, "write_recording", interrupted)
        line = one_line(run("bench", "rig", tmp_path / "rig", code=130))
    assert "the same command continues" in line
    assert len(list((tmp_path / "rig").rglob("*.h5"))) == 3
    run("bench", "rig", tmp_path / "rig")
    run("bench", "rig", tmp_path / "whole")
    files = {path.relative_to(tmp_path / "rig") for path in (tmp_path / "rig").rglob("*.*")}
    assert len(files) == 7
    for file in files:
        assert (tmp_path / "rig" / file).read_bytes() == (tmp_path / "whole" / file).read_bytes()


@pytest.mark.nightly  # .ci/run runs the demo itself
def test_the_demo_leaves_a_model_a_twin_and_a_diagnosis_and_its_commands_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = {"windows": 2, "synthetic": 2, "held_out": 1, "test_windows": None, "method": GaussNewton(starts=1)}
    network = Model("bitcn", {"stride": 32, "channels": (8, 8)}, TrainingSettings(epochs=1))
    monkeypatch.setitem(MODELS["quick"], DEFAULT, network)
    plan = plan_of("case2")
    plan = replace(plan, scenario=replace(plan.scenario, **small))
    monkeypatch.setattr("swashtwin_bench.demo.plan_of", lambda study, size: plan)
    for module in ("rigs.writing", "demo"):
        monkeypatch.setattr(f"swashtwin_bench.{module}.SIZES", {"small": RigSize(2, repeats=2, duration=1.3)})
    monkeypatch.setattr("swashtwin.learning.choice.choosing.MOST_WINDOWS", 60)
    answer = run_json("demo", "--out", tmp_path, "--jobs", 1)
    assert {"study", "size", "seeds", "rows", "wall_s", "device", "version", "command", "report"} <= set(answer)
    wanted = [(name, level) for name in ("measured", "nominal", "calibrated") for level in ("L2", "L4")]
    assert [(row["training_set"], row["level"]) for row in answer["rows"]] == 2 * wanted
    for row in answer["rows"]:
        for metric in ("accuracy", "recall", "f1", "g_mean"):
            assert set(row[metric]) == {"mean", "std", "values"}
    page = Path(answer["report"]).read_text(encoding="utf-8")
    assert "<h1>A fault nobody recorded at this pressure: can a twin replace" in page
    assert page.index("With the twin and without") < page.index("Case II of the paper")
    unseen = [name for name in answer["splits"]["0"]["L4"] if "swash_plate_15MPa" in name]
    assert [verdict["recording_id"] for verdict in answer["with_twin"]] == unseen
    model, twin = load_classifier(answer["model"]), load_calibration(answer["twin"])
    used = {name for name in (*model.manifest, *twin.recording_ids) if not name.startswith("synthetic")}
    assert not [name for name in used if "swash_plate_15MPa" in name or name in answer["splits"]["0"]["L4"]]
    again = run("demo", "--out", tmp_path, "--jobs", 1)
    assert "6 of seed 0 done before" in again.stderr
    assert "No figure here says" in " ".join(again.stdout.split())
    assert len(answer["next"]) == 3
    for command in answer["next"]:
        assert command in again.stdout
        run(*shlex.split(command.replace("1 min", "2 s"))[1:])


def test_rig_writes_an_index_that_inspect_reads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("swashtwin_bench.rigs.writing.SIZES", {"small": RigSize(specimens=1, repeats=1, duration=0.2)})
    monkeypatch.setattr("swashtwin_bench.rigs.writing.PRESSURES", (MPa(15),))
    monkeypatch.chdir(tmp_path)
    answer = run_json("bench", "rig", "rig", "--seed", 3, "--format", "csv")
    report = run_json("inspect", answer["index"])
    assert len(report["recordings"]) == 5
    assert not report["has_errors"]
    assert "5 recordings" in run("inspect", tmp_path / "rig").stdout
    assert 'format was "csv", now "h5"' in one_line(run("bench", "rig", tmp_path / "rig", "--seed", 3, code=3))


def test_index_proposes_what_split_and_inspect_read(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for label in ("normal", "piston"):
        for number in (1, 2):
            rows = "\n".join(f"{value:.6f}" for value in rng.standard_normal(400))
            (tmp_path / f"{label}_{number}.csv").write_text(f"x\n{rows}\n")
    answer = run_json("index", tmp_path, "--sample-rate", "2 kHz", "--unit", "g")
    assert (answer["recordings"], answer["classes"]) == (4, ["normal", "piston"])
    assert "--force" in one_line(run("index", tmp_path, "--sample-rate", "2 kHz", "--unit", "g", code=3))
    assert "4 recordings" in run("index", tmp_path, "--sample-rate", "2 kHz", "--unit", "g", "--force").stdout
    run("data", "split", tmp_path, "--test-fraction", 0.5)
    assert len(load_recordings(tmp_path / "test.toml")) == 2
    facts = ("--sample-rate", "2 kHz", "--unit", "g")
    assert run_json("inspect", tmp_path / "normal_1.csv", *facts)["recordings"][0]["sample_rate"] == 2000.0


def test_a_new_pump_is_shown_with_every_number_and_its_source(tmp_path: Path) -> None:
    path = run_json("twin", "pump", "new", "mine.toml", "--out", tmp_path)["pump"]
    assert path == str(tmp_path / "mine.toml")
    answer = run_json("twin", "pump", "show", path)
    assert answer["name"] == "mine"
    assert all(parameter["source"] for parameter in answer["parameters"])
    assert {parameter["name"]: parameter["unit"] for parameter in answer["parameters"]}[
        "interfaces.block_valve.stiffness"
    ] == "N/m"
    assert {parameter["name"] for parameter in answer["parameters"]} == set(swashtwin.load_pump(path).sources)
    assert "block_valve" in run("twin", "pump", "show").stdout


def test_simulate_writes_the_twin_of_a_calibration(chain: dict[str, dict[str, Any]], tmp_path: Path) -> None:
    out = tmp_path / "worn.h5"
    words = ("twin", "simulate", "--duration", "0.2 s", "--out", out, *AT_15, *DEFECT, "--force")
    nominal = run_json(*words)
    calibrated = run_json(*words, "--calibration", chain["calibrate"]["calibration"])
    assert nominal["label"] == calibrated["label"] == "swash_plate"
    assert nominal["rms_m_s2"] != calibrated["rms_m_s2"]
    assert swashtwin.load_recording(out).synthetic
    assert "rms" in run(*words).stdout


def test_a_simulated_calibration_keeps_its_fault(chain: dict[str, dict[str, Any]], tmp_path: Path) -> None:
    words = ("twin", "simulate", "--duration", "0.2 s", "--out", tmp_path / "s.h5", *AT_15)
    assert run_json(*words, "--calibration", chain["calibrate"]["calibration"])["label"] == "swash_plate"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("inspect", "nowhere"), "nowhere"),
        (("inspect", "nowhere.h5"), "nowhere.h5 does not exist"),
        (("calibrate", "nowhere.toml", *AT_15), "nowhere.toml does not exist"),
        (("evaluate", "nowhere.safetensors", "nowhere"), "nowhere.safetensors does not exist"),
        (("synthesize", "no.json", "--like", "x", "--count", 1, "--out", "y"), "no.json"),
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
        (lambda signal: np.where(np.arange(signal.shape[1]) == 7, np.nan, signal), "missing or infinite"),
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
        write_recording(recording, tmp_path / f"{recording.recording_id}.h5") for recording in (broken, *recordings[1:])
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
        files = [write_recording(recording, tmp_path / name / f"{recording.recording_id}.h5") for recording in members]
        write_index(members, files, tmp_path / name)
    assert "12800 Hz: slow (swash_plate)" in one_line(run("train", tmp_path / "mixed", *TINY, code=3))
    assert run_json("inspect", tmp_path / "mixed", code=3)["has_errors"]
    assert "5 are needed at least" in one_line(run("train", tmp_path / "lone", code=3))


def test_an_unknown_class_in_an_index_is_answered_with_the_nearest(rig: Path, tmp_path: Path) -> None:
    text = (rig / "recordings.toml").read_text(encoding="utf-8").replace('label = "normal"', 'label = "norml"', 1)
    (rig / "misspelt.toml").write_text(text, encoding="utf-8")
    assert "did you mean 'normal'?" in run("inspect", rig / "misspelt.toml", code=3).stdout


def test_a_bare_number_in_a_pump_file_is_refused(tmp_path: Path) -> None:
    path = new_pump("mine", folder=tmp_path)
    text = path.read_text(encoding="utf-8")
    line = next(line for line in text.splitlines() if line.startswith("piston_diameter"))
    path.write_text(text.replace(line, "piston_diameter = 17"), encoding="utf-8")
    said = one_line(run("twin", "simulate", *AT_15, "--pump", path, "--out", tmp_path / "x.h5", code=3))
    assert "rotating_group.piston_diameter" in said
    assert "bare" in said


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


def test_testing_on_a_training_recording_is_refused(rig: Path, chain: dict[str, dict[str, Any]]) -> None:
    seen = chain["split"]["train_recordings"][0]
    assert seen in one_line(run("evaluate", chain["train"]["model"], rig, "--id", seen, code=3))
    assert "all 4 recordings" in one_line(run("evaluate", chain["train"]["model"], chain["split"]["train"], code=3))


@pytest.mark.parametrize(
    "words",
    [
        ("twin", "pump", "new", "mine", "--out", "."),
    ],
)
def test_a_full_disk_leaves_the_old_file_and_nothing_half_written(words: tuple[str, ...], tmp_path: Path) -> None:
    (tmp_path / "full.h5").write_text("old")

    def only_a_kilobyte() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1024, 1024))

    process = subprocess.run(
        [sys.executable, "-B", "-m", "swashtwin", *words],
        cwd=tmp_path,
        preexec_fn=only_a_kilobyte,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (process.returncode, process.stdout) == (3, "")
    assert process.stderr.splitlines() == ["swashtwin: error: File too large; nothing is half-written."]
    assert [path.name for path in tmp_path.iterdir()] == ["full.h5"]
    assert (tmp_path / "full.h5").read_text() == "old"


def test_a_target_that_cannot_be_written_is_refused_before_the_work(tmp_path: Path) -> None:
    line = one_line(run("train", tmp_path / "nowhere.toml", "--out", tmp_path, code=3))
    assert "is a folder; name a file" in line
    line = one_line(run("calibrate", tmp_path / "n.toml", *AT_15, "--out", tmp_path / "pump.toml", code=3))
    assert "must end in .json" in line
