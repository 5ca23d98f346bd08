"""A user's recordings on the command line: indexed, converted, inspected, diagnosed."""

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

HOW_TO = Path(__file__).parents[2] / "docs" / "how-to" / "recordings.md"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Four text tables of two classes."""
    return write_tones(tmp_path, 2)


def test_convert_writes_the_recordings_of_an_index_to_one_file(folder: Path) -> None:
    run("index", folder, *FACTS)
    store = folder / "store.h5"

    answer = run_json("data", "convert", folder, "--out", store)

    assert answer["recordings"] == 4
    assert answer["seconds"] == 1.2
    assert answer["bytes"] == store.stat().st_size
    for stored, original in zip(load_recordings(store), load_recordings(folder), strict=True):
        assert stored.recording_id == original.recording_id
        assert stored.label == original.label
        np.testing.assert_array_equal(stored.signal, original.signal)
    assert len(run_json("inspect", store)["recordings"]) == 4


def test_a_store_is_diagnosed_like_the_files_that_it_was_converted_from(folder: Path) -> None:
    run("index", folder, *FACTS)
    store = folder / "store.h5"
    run("data", "convert", folder, "--out", store)
    windows = cut_windows(load_recordings(store), length=50)
    network = build_network("bitcn", 1, 2, channels=(2,))
    classifier = fit(network, windows, settings=TrainingSettings(epochs=1), seed=0)
    model = save_classifier(classifier, folder / "m.safetensors")

    diagnoses = run_json("diagnose", model, store)["diagnoses"]

    assert diagnoses == run_json("diagnose", model, folder)["diagnoses"]
    # 600 samples in windows of 50
    assert [diagnosis["n_windows"] for diagnosis in diagnoses] == [12] * 4


@pytest.mark.parametrize("command", ["inspect", "data convert"])
def test_errors_of_a_single_file_name_options_and_those_of_an_index_name_keys(
    folder: Path, command: str
) -> None:
    arguments = command.split()
    file = folder / "normal_1.csv"
    out = ("--out", folder / "s.h5") if command == "data convert" else ()

    without_rate = one_line(run(*arguments, file, *out, code=3))
    assert 'Set --sample-rate "25.6 kHz"' in without_rate

    without_unit = one_line(run(*arguments, file, "--sample-rate", "2 kHz", *out, code=3))
    assert "Set --unit g" in without_unit

    (folder / "recordings.toml").write_text('format = 1\n[[recording]]\nfile = "normal_1.csv"\n')
    result = run(*arguments, folder, *out, code=3)
    # inspect lists unreadable files among its findings
    message = result.stdout if command == "inspect" else one_line(result)
    assert 'Set sample_rate = "25.6 kHz"' in message


def test_equal_findings_of_many_recordings_are_printed_once(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    for number in range(26):
        label, pressure = ("normal", 5) if number < 8 else ("piston", 10)
        # recordings 3 and 4 are constant
        if number in (3, 4):
            samples = np.full(300, float(number))
        else:
            samples = random.standard_normal(300)
        file = tmp_path / f"{label}_{pressure}MPa_{number}.csv"
        file.write_text("x\n" + "\n".join(f"{sample:.6f}" for sample in samples))
    run("index", tmp_path, *FACTS, "--speed", "860 rpm")

    output = run("inspect", tmp_path, code=3).stdout

    assert "2 more rows: --json has them." in output
    assert "normal_5MPa_3, x: every sample is" in output
    assert "normal_5MPa_4, x" not in output
    assert "(Similar: normal_5MPa_4.)" in output
    assert len(run_json("inspect", tmp_path, code=3)["recordings"]) == 26


def test_inspect_lists_every_unusable_file_and_a_channel_that_differs(folder: Path) -> None:
    run("index", folder, *FACTS)
    (folder / "normal_1.csv").write_text("x\n1\ntext\n")
    (folder / "piston_2.csv").unlink()
    renamed_channel = (folder / "normal_2.csv").read_text().replace("x", "y")
    (folder / "normal_2.csv").write_text(renamed_channel)

    report = run_json("inspect", folder, code=3)

    kinds = [finding["kind"] for finding in report["findings"] if finding["severity"] == "error"]
    assert kinds == ["unreadable", "unreadable", "channels"]
    readable_ids = {recording["recording_id"] for recording in report["recordings"]}
    assert readable_ids == {"normal_2", "piston_1"}

    refusal = one_line(run("train", folder, "--out", folder / "m.safetensors", code=3))
    assert "normal_1.csv" in refusal


def test_check_lists_the_uses_that_two_recordings_of_a_class_are_enough_for(folder: Path) -> None:
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
    output = run("check", folder).stdout
    assert "not enough: calibrated confidence: an error rate of 0.1 needs 9" in output


def test_check_exits_with_5_for_sound_data_that_are_too_few_to_test(folder: Path) -> None:
    (folder / "piston_2.csv").unlink()
    run("index", folder, *FACTS)

    output = run("check", folder, code=5).stdout

    assert "The data are sound, but not enough: no test on recordings" in output
    assert "piston: only one recording, two are needed" in output


def test_check_exits_with_3_for_a_copy_under_another_label(folder: Path) -> None:
    (folder / "piston_2.csv").unlink()
    (folder / "piston_1.csv").write_text((folder / "normal_1.csv").read_text())
    run("index", folder, *FACTS)

    output = run("check", folder, code=3).stdout

    assert "The data are not sound (1 finding to mend); the usable" in output


def test_index_prints_what_it_guessed_and_asks_for_the_rest_on_a_terminal(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # without a terminal nobody can answer
    assert "--sample-rate" in one_line(run("index", folder, code=3))

    answers = iter(["2 kHz", "g"])
    terminal = SimpleNamespace(isatty=lambda: True)
    monkeypatch.setattr("swashtwin.cli.recordings._ask", lambda key, question: next(answers))
    monkeypatch.setattr("swashtwin.cli.recordings.sys", SimpleNamespace(stdin=terminal))
    output = run("index", folder).stdout

    assert "label: normal (2), piston (2), from its name" in output
    assert {recording.sample_rate for recording in load_recordings(folder)} == {2000.0}


def test_the_commands_of_the_how_to_on_recordings_run_as_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    random = np.random.default_rng(0)
    for label in ("normal", "piston"):
        (tmp_path / "mine" / label).mkdir(parents=True)
        for number in range(1, 6):
            (tmp_path / "mine" / label / f"15MPa_{number}.csv").write_text(noise_table(random))
    (tmp_path / "new.csv").write_text(noise_table(random))
    page = HOW_TO.read_text(encoding="utf-8")
    blocks = re.findall(r"```\n(.*?)```", page, re.DOTALL)
    commands = [line for block in blocks for line in block.splitlines()]

    # the whole way from files to a diagnosis, in its order
    user_work = ["index", "inspect", "check", "train", "evaluate", "diagnose"]
    assert [line.split()[1] for line in commands] == [*user_work, "twin", "twin", "twin"]
    for line in commands[:-1]:
        run(*shlex.split(line)[1:])

    # the last command prints the page's table of effects, largest first
    answer = run_json(*shlex.split(commands[-1])[1:])
    effects = {entry["name"]: entry["effect"] for entry in answer["effects"]}
    table = re.findall(r"`(\w+\.\w+)` \| (\d+) %", page)
    assert len(table) == 5
    largest = list(effects)[: len(table)]
    assert table == [(name, f"{100 * effects[name]:.0f}") for name in largest]

    interfaces = [effect for name, effect in effects.items() if name.startswith("interfaces.")]
    assert max(interfaces) < 0.02


def noise_table(random: np.random.Generator) -> str:
    """Return a CSV file with one column of noise, four turns long at 860 rev/min and 25.6 kHz."""
    samples = "".join(f"{sample:.6f}\n" for sample in random.standard_normal(8192))
    return "x\n" + samples


def test_index_reports_that_no_file_matches(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x\n1\n2\n")

    refusal = one_line(run("index", tmp_path, "--include", "*.wav", code=3))

    assert "no file whose path matches" in refusal
