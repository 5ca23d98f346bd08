"""Commands of the studies that run as tasks: what they refuse, how they are interrupted, and the page of their runs."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from commandline import one_line, run, run_json

from swashtwin.calibration import GaussNewton
from swashtwin.foundation import InputError, MPa
from swashtwin_bench import plan_of, run_plan
from swashtwin_bench.rigs.writing import RigSize
from swashtwin_bench.studies import runner
from swashtwin_bench.studies.cases import SCENARIOS


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    few = {"windows": 2, "scarce_windows": 3, "synthetic": 2, "held_out": 1}
    scenario = replace(SCENARIOS["quick"], method=GaussNewton(starts=1), **few)
    monkeypatch.setitem(SCENARIOS, "quick", scenario)
    size = RigSize(specimens=2, repeats=2, duration=0.9)
    for name in ("swashtwin_bench.rigs.writing.SIZES", "swashtwin_bench.studies.sources.SIZES"):
        monkeypatch.setattr(name, {"small": size})
    monkeypatch.setattr("swashtwin_bench.studies.sources.require_rig", lambda *_: None)
    monkeypatch.setattr("swashtwin_bench.rigs.writing.PRESSURES", (MPa(15),))


def test_a_study_on_the_rig_is_interrupted_resumed_and_reported(
    tiny: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keys, real = [], runner.run_task

    def interrupted(*arguments: Any) -> Any:
        if len(keys) == 1:
            keys.append("interrupted")
            raise KeyboardInterrupt
        keys.append(arguments[0].key)
        return real(*arguments)

    monkeypatch.setattr(runner, "run_task", interrupted)
    words = ("bench", "case1", "--rig", "--out", tmp_path / "out", "--jobs", 1, "--classifiers", "extra_trees")
    words = (*words, "--training-sets", "measured,nominal")
    assert "the same command resumes" in one_line(run(*words, code=130))
    answer = run_json(*words)
    assert len(keys) == 3
    assert {row["training_set"] for row in [*answer["rows"], *answer["rivals"]]} == {"measured", "nominal"}
    assert Path(answer["report"]).is_file()
    assert "2 of seed 0 done before" in run(*words).stderr
    gathered = run_json("bench", "report", tmp_path / "out", "--out", tmp_path / "page")
    assert [(study["study"], study["runs"]) for study in gathered["studies"]] == [("case1", 2)]
    assert "case1" in run("bench", "report", tmp_path / "out", "--out", tmp_path / "page").stdout


def test_a_study_on_version_two_keeps_its_fleets_beside_those_of_version_one(tiny: None, tmp_path: Path) -> None:
    words = ("bench", "case1", "--rig", "--rig-version", "2", "--out", tmp_path, "--jobs", 1)
    words = (*words, "--classifiers", "extra_trees", "--training-sets", "measured,nominal")
    assert {row["training_set"] for row in run_json(*words)["rows"]} == {"measured", "nominal"}
    assert (tmp_path / "rig2-small-0" / "recordings.toml").is_file()
    refused = run("bench", "case1", tmp_path / "rig2-small-0", "--rig-version", "2", code=2)
    assert "--rig-version" in refused.stderr


def test_report_of_a_folder_without_runs_ends_with_code_3(tmp_path: Path) -> None:
    assert "no finished run" in one_line(run("bench", "report", tmp_path, "--out", tmp_path / "page", code=3))


def test_report_of_no_folder_says_that_there_is_none(tmp_path: Path) -> None:
    line = one_line(run("bench", "report", tmp_path / "nowhere", "--out", tmp_path / "page", code=3))
    assert "does not exist" in line


@pytest.mark.parametrize(
    "words",
    [
        ("bench", "case1", "."), 
        ("bench", "public", "--data", "."),
        ("bench", "calibration"), ("bench", "wrong-twins"), ("bench", "paper"), ("demo",), ("bench", "report", "."),
    ],
)  # fmt: skip
@pytest.mark.parametrize("below", ["", "deeper"])
def test_a_file_where_a_folder_is_to_be_written_is_refused_before_the_work(
    words: tuple[str, ...], below: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").write_text("kept")
    output = run(*words, "--out", Path("taken") / below, code=2).stderr
    assert "is a file" in " ".join(output.replace("│", " ").split())
    assert (tmp_path / "taken").read_text() == "kept"


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("bench", "case1"), 2),
        (("bench", "case1", "x", "--rig", "--out", "y"), 2),
        (("bench", "case1", "--rig"), 2),
        (("bench", "noise", "x", "--classifiers", "guess"), 3),
        (("bench", "noise", "x", "--training-sets", "guess"), 3),
        (("bench", "noise", "x", "--address", "tcp://nowhere:1"), 3),
        (("bench", "paper", "--experiments", "guess"), 3),
        (("bench", "paper", "--size", "huge"), 2),
    ],
)
def test_what_cannot_be_run_is_refused_at_once(words: tuple[str, ...], code: int, tmp_path: Path) -> None:
    result = run(*words, code=code)
    assert not result.stdout
    assert result.stderr


@pytest.mark.parametrize("fast", [True, False])
def test_sixteen_bits_are_warned_of_where_the_processor_is_slow_with_them(
    fast: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swashtwin.foundation.has_bfloat16_arithmetic", lambda: fast, raising=False)
    words = ("bench", "paper", "--precision", "bfloat16", "--experiments", "guess", "--out", str(tmp_path / "runs"))
    assert ("slower here than float32" in run(*words, code=3).stderr) is not fast


def test_values_that_a_study_does_not_have_and_those_at_which_nothing_is_trained_are_named() -> None:
    line = one_line(run("bench", "few-shot", "x", "--values", "guess", code=3))
    assert "has no value 'guess' to choose; the values of real_windows are 0, 5," in line
    plan = plan_of("augmentation", "quick").of_training_sets(["calibrated"]).of_values(["0"])
    with pytest.raises(InputError, match="nothing to do: calibrated is not trained at synthetic 0"):
        run_plan(plan, [])
