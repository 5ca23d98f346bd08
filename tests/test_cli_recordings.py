"""Recordings of one's own on the command line: indexed, converted, inspected, diagnosed."""

import re
import shlex
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from commandline import one_line, run, run_json

from swashtwin.diagnosis import save_classifier
from swashtwin.networks import build_network
from swashtwin.readers import open_store, read_recordings
from swashtwin.training import TrainingSettings, fit
from swashtwin.windows import cut_windows


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Four text tables of two classes."""
    rng = np.random.default_rng(0)
    for label in ("normal", "piston"):
        for number in (1, 2):
            rows = "\n".join(f"{value:.6f}" for value in rng.standard_normal(400))
            (tmp_path / f"{label}_{number}.csv").write_text(f"x\n{rows}\n")
    return tmp_path


FACTS = ("--sample-rate", "2 kHz", "--unit", "g")


def test_convert_writes_a_store_that_inspect_train_and_diagnose_read(folder: Path) -> None:
    run("index", folder, *FACTS)
    store = folder / "store.h5"
    told = run_json("convert", folder, "--out", store)
    assert (told["recordings"], told["seconds"], told["bytes"]) == (4, 0.8, store.stat().st_size)
    for back, one in zip(open_store(store), read_recordings(folder), strict=True):
        assert (back.recording_id, back.label) == (one.recording_id, one.label)
        np.testing.assert_array_equal(back.loaded().signal, one.signal)
    assert len(run_json("inspect", store)["recordings"]) == 4
    windows = cut_windows(open_store(store), length=50)
    classifier = fit(build_network("bitcn", 1, 2, channels=(2,)), windows, settings=TrainingSettings(epochs=1), seed=0)
    model = save_classifier(classifier, folder / "m.safetensors")
    verdicts = run_json("diagnose", model, store)["diagnoses"]
    assert verdicts == run_json("diagnose", model, folder)["diagnoses"]
    assert [one["n_windows"] for one in verdicts] == [8] * 4


def test_convert_replaces_a_store_only_where_told(folder: Path) -> None:
    file = folder / "normal_1.csv"
    assert "1 recordings, 0.2 s" in run("convert", file, "--out", folder / "a.h5", *FACTS).stdout
    before = (folder / "a.h5").read_bytes()
    assert "--overwrite" in one_line(run("convert", file, "--out", folder / "a.h5", *FACTS, code=3))
    assert "does not say its sample rate" in one_line(
        run("convert", file, "--out", folder / "a.h5", "--overwrite", code=3)
    )
    assert (folder / "a.h5").read_bytes() == before


def test_index_says_what_it_guessed_and_asks_a_terminal(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "--sample-rate" in one_line(run("index", folder, code=3))
    answers = iter(["2 kHz", "g"])
    monkeypatch.setattr("swashtwin.cli.recordings._asked", lambda key, question: next(answers))
    monkeypatch.setattr("swashtwin.cli.recordings.sys", SimpleNamespace(stdin=SimpleNamespace(isatty=lambda: True)))
    told = run("index", folder).stdout
    assert "label: normal (2), piston (2), says its name" in told
    assert {one.sample_rate for one in read_recordings(folder)} == {2000.0}


def test_the_commands_of_the_page_on_one_s_own_recordings_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    for label in ("normal", "piston"):
        for number in range(1, 6):
            path = tmp_path / "mine" / label / f"15MPa_{number}.csv"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text("x\n" + "".join(f"{value:.6f}\n" for value in rng.standard_normal(1024)))
    text = (Path(__file__).parents[1] / "docs" / "recordings.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```\n(.*?)```", text, re.DOTALL)
    commands = [line for block in blocks for line in block.splitlines()]
    assert [shlex.split(line)[1] for line in commands] == [
        "index", "inspect", "convert", "train", "evaluate", "diagnose",
    ]  # fmt: skip
    for line in commands:
        run(*shlex.split(line)[1:])
