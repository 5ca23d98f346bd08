"""Recordings of one's own on the command line: indexed, converted, inspected, diagnosed."""

import re
import shlex
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from commandline import FACTS, one_line, run, run_json, write_tones

from swashtwin.diagnosis import save_classifier
from swashtwin.learning import TrainingSettings, build_network, cut_windows, fit
from swashtwin.recordings import load_recordings


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Four text tables of two classes."""
    return write_tones(tmp_path, 2)


def test_convert_writes_a_store_that_inspect_train_and_diagnose_read(folder: Path) -> None:
    run("index", folder, *FACTS)
    store = folder / "store.h5"
    answer = run_json("data", "convert", folder, "--out", store)
    assert (answer["recordings"], answer["seconds"], answer["bytes"]) == (
        4,
        1.2,
        store.stat().st_size,
    )
    for back, recording in zip(load_recordings(store), load_recordings(folder), strict=True):
        assert (back.recording_id, back.label) == (recording.recording_id, recording.label)
        np.testing.assert_array_equal(back.signal, recording.signal)
    assert len(run_json("inspect", store)["recordings"]) == 4
    windows = cut_windows(load_recordings(store), length=50)
    classifier = fit(
        build_network("bitcn", 1, 2, channels=(2,)),
        windows,
        settings=TrainingSettings(epochs=1),
        seed=0,
    )
    model = save_classifier(classifier, folder / "m.safetensors")
    verdicts = run_json("diagnose", model, store)["diagnoses"]
    assert verdicts == run_json("diagnose", model, folder)["diagnoses"]
    assert [verdict["n_windows"] for verdict in verdicts] == [12] * 4


@pytest.mark.parametrize("command", ["inspect", "data convert"])
def test_errors_of_a_single_file_name_options_and_those_of_an_index_name_keys(
    folder: Path, command: str
) -> None:
    out = ("--out", folder / "s.h5") if command == "data convert" else ()
    line = one_line(run(*command.split(), folder / "normal_1.csv", *out, code=3))
    assert 'Set --sample-rate "25.6 kHz"' in line
    line = one_line(
        run(*command.split(), folder / "normal_1.csv", "--sample-rate", "2 kHz", *out, code=3)
    )
    assert "Set --unit g" in line
    (folder / "recordings.toml").write_text('format = 1\n[[recording]]\nfile = "normal_1.csv"\n')
    said = run(*command.split(), folder, *out, code=3)
    assert 'Set sample_rate = "25.6 kHz"' in (
        said.stdout if command == "inspect" else one_line(said)
    )


def test_findings_of_many_recordings_are_said_once_by_kind(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    for number in range(26):
        label, pressure = ("normal", 5) if number < 8 else ("piston", 10)
        rows = np.full(300, float(number)) if number in (3, 4) else random.standard_normal(300)
        (tmp_path / f"{label}_{pressure}MPa_{number}.csv").write_text(
            "x\n" + "\n".join(f"{x:.6f}" for x in rows)
        )
    run("index", tmp_path, *FACTS, "--speed", "860 rpm")
    short = run("inspect", tmp_path, code=3).stdout
    assert "2 more rows: --json has them." in short
    assert "normal_5MPa_3, x: every sample is" in short
    assert "normal_5MPa_4, x" not in short
    assert "(constant in 1 more recordings)" in short
    assert len(run_json("inspect", tmp_path, code=3)["recordings"]) == 26


def test_inspect_names_every_file_that_cannot_be_used_and_what_differs(folder: Path) -> None:
    run("index", folder, *FACTS)
    (folder / "normal_1.csv").write_text("x\n1\ntext\n")
    (folder / "piston_2.csv").unlink()
    (folder / "normal_2.csv").write_text((folder / "normal_2.csv").read_text().replace("x", "y"))
    report = run_json("inspect", folder, code=3)
    kinds = [finding["kind"] for finding in report["findings"] if finding["severity"] == "error"]
    assert kinds == ["unreadable", "unreadable", "channels"]
    assert {record["recording_id"] for record in report["recordings"]} == {"normal_2", "piston_1"}
    refusal = one_line(run("train", folder, "--out", folder / "m.safetensors", code=3))
    assert "normal_1.csv" in refusal


def test_check_answers_whether_recordings_are_sound_and_enough(folder: Path) -> None:
    run("index", folder, *FACTS, "--speed", "860 rpm", "--pressure", "15 MPa")
    answer = run_json("check", folder, "--window", 256)
    assert answer["answer"] == "The data are sound and enough to train and to test."
    assert {use["name"]: use["state"] for use in answer["uses"]} == {
        "training of a classifier": "yes",
        "detection from healthy recordings alone": "no",
        "test on recordings that were not trained on": "yes",
        "test on specimens that were not trained on": "no",
        "test at operating conditions that were not trained at": "no",
        "calibrated confidence": "no",
        "calibration of a twin": "no",
    }
    assert (
        "not enough: calibrated confidence: an error rate of 0.1 needs 9"
        in run("check", folder).stdout
    )
    (folder / "piston_2.csv").unlink()
    run("index", folder, *FACTS, "--force")
    said = run("check", folder, code=5).stdout
    assert "The data are sound, but not enough: no test on recordings" in said
    assert "piston: only one recording, two are needed" in said
    (folder / "piston_1.csv").write_text((folder / "normal_1.csv").read_text())
    assert (
        "The data are not sound (1 finding to mend); the usable"
        in run("check", folder, code=3).stdout
    )


def test_index_says_what_it_guessed_and_asks_a_terminal(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "--sample-rate" in one_line(run("index", folder, code=3))
    answers = iter(["2 kHz", "g"])
    monkeypatch.setattr("swashtwin.cli.recordings._ask", lambda key, question: next(answers))
    monkeypatch.setattr(
        "swashtwin.cli.recordings.sys", SimpleNamespace(stdin=SimpleNamespace(isatty=lambda: True))
    )
    output = run("index", folder).stdout
    assert "label: normal (2), piston (2), from its name" in output
    assert {recording.sample_rate for recording in load_recordings(folder)} == {2000.0}


def test_the_commands_of_the_page_on_one_s_own_recordings_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    for label in ("normal", "piston"):
        for number in range(1, 6):
            path = tmp_path / "mine" / label / f"15MPa_{number}.csv"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(
                "x\n" + "".join(f"{value:.6f}\n" for value in rng.standard_normal(1024))
            )
    text = (Path(__file__).parents[2] / "docs" / "how-to" / "recordings.md").read_text(
        encoding="utf-8"
    )
    blocks = re.findall(r"```\n(.*?)```", text, re.DOTALL)
    commands = [line for block in blocks for line in block.splitlines()]
    user_work = ["index", "inspect", "check", "train", "evaluate", "diagnose"]
    assert [line.split()[1] for line in commands] == [*user_work, "twin", "twin", "twin"]
    for line in commands[:-1]:
        run(*shlex.split(line)[1:])
    effects = {
        entry["name"]: entry["effect"]
        for entry in run_json(*shlex.split(commands[-1])[1:])["effects"]
    }
    printed = re.findall(r"`(\w+\.\w+)` \| (\d+) %", text)
    assert printed == [
        (name, f"{100 * effects[name]:.0f}") for name in list(effects)[: len(printed)]
    ]
    assert len(printed) == 5
    assert max(effect for name, effect in effects.items() if name.startswith("interfaces.")) < 0.02


def test_an_index_of_no_matching_file_says_so(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x\n1\n2\n")
    assert "no file whose path matches" in one_line(
        run("index", tmp_path, "--include", "*.wav", code=3)
    )
