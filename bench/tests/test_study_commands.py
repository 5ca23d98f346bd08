"""Commands of the studies: refusals, interruption, and the page of their runs."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from commandline import one_line, run, run_json

from swashtwin.calibration import GaussNewton
from swashtwin.foundation import InputError, MPa
from swashtwin_bench import PLANS, Work, run_study
from swashtwin_bench.cli.studies import STUDIES
from swashtwin_bench.questions.alarms import AlarmStudySettings
from swashtwin_bench.results.reported import PAPER_STUDY
from swashtwin_bench.rigs.writing import RigSize
from swashtwin_bench.studies import runner
from swashtwin_bench.studies.plan import PlanSettings
from swashtwin_bench.studies.plans import SCENARIOS
from swashtwin_bench.studies.registry import QUESTIONS, read_settings


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the size quick take seconds: two pumps, one pressure, few windows."""
    few_windows: dict[str, Any] = {
        "windows": 2,
        "scarce_windows": 3,
        "synthetic": 2,
        "held_out": 1,
    }
    scenario = SCENARIOS["ours", "quick"]
    scenario = replace(scenario, method=GaussNewton(starts=1), **few_windows)
    monkeypatch.setitem(SCENARIOS, ("ours", "quick"), scenario)

    size = RigSize(specimens=2, repeats=2, duration=0.9)
    for module in ("rigs.writing", "studies.runner"):
        monkeypatch.setattr(f"swashtwin_bench.{module}.SIZES", {"small": size})
    monkeypatch.setattr("swashtwin_bench.rigs.writing.PRESSURES", (MPa(15),))
    # a rig of one pressure is not a complete one
    monkeypatch.setattr("swashtwin_bench.studies.runner.require_rig", lambda *_: None)


def words_of(stderr: str) -> str:
    """Return a message without the frame and the line breaks of a terminal."""
    return " ".join(stderr.replace("│", " ").split())


def test_the_command_knows_every_study() -> None:
    # the experiments of the paper are parts of one study
    plans = {name for name in PLANS if not name.startswith(PAPER_STUDY)}
    assert set(STUDIES) == {"paper", *plans, *QUESTIONS}


def case1(out: Path, *settings: str) -> tuple[Any, ...]:
    """Return the arguments of Case I in one process with these settings."""
    arguments: list[Any] = ["bench", "study", "case1", "--out", out, "--jobs", 1]
    for setting in settings:
        arguments += ["--set", setting]
    return tuple(arguments)


def test_a_study_on_the_rig_is_interrupted_resumed_and_reported(
    tiny: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keys = []
    train_and_test = runner.train_and_test

    def interrupted(task: Any, *arguments: Any, **keywords: Any) -> Any:
        keys.append(task.key)
        if len(keys) == 2:
            raise KeyboardInterrupt
        return train_and_test(task, *arguments, **keywords)

    monkeypatch.setattr(runner, "train_and_test", interrupted)
    out = tmp_path / "out"
    arguments = case1(out, "classifiers=extra_trees", "training_sets=measured,nominal")
    assert "same command continues" in one_line(run(*arguments, code=130))
    assert (out / "rig-small-0" / "recordings.toml").is_file()

    # of the two tasks, only the interrupted one runs again
    answer = run_json(*arguments)
    assert len(keys) == 3
    assert {row["training_set"] for row in answer["rows"]} == {"measured", "nominal"}
    assert Path(answer["report"]).is_file()

    finished = run(*arguments)
    assert "2 of seed 0 already finished" in finished.stderr
    assert "L4: highest accuracy" in finished.stdout


# ---- refusals


@pytest.mark.parametrize(
    "arguments",
    [
        ("bench", "study", "case1", "."),
        ("bench", "study", "paper"),
        ("demo",),
    ],
)
@pytest.mark.parametrize("subfolder", ["", "deeper"])
def test_a_file_in_place_of_the_output_folder_is_refused_before_the_work(
    arguments: tuple[str, ...], subfolder: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").write_text("kept")

    result = run(*arguments, "--out", Path("taken") / subfolder, code=3)
    assert "is a file" in words_of(result.stderr)
    assert (tmp_path / "taken").read_text() == "kept"


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (("study", "cas1"), 2, "did you mean case1"),
        (("study", "case1"), 3, "needs a folder"),
        (("study", "case1", "x", "--size", "medium"), 3, "no size 'medium'"),
        (("study", "ablation"), 2, "unknown study 'ablation'"),
        (("study", "noise", "x", "--set", "classifiers=guess"), 3, "Unknown classifier 'guess'"),
        (
            ("study", "augmentation", "x", "--set", "values=guess"),
            3,
            "no value of synthetic 'guess'; there are 0, 72,",
        ),
        (("study", "alarms", "--seeds", "x"), 2, "whole numbers"),
        (("study", "alarms", "--set", "pump=2"), 3, "no setting 'pump'; its settings are pumps,"),
        (("study", "alarms", "--set", "pumps=two"), 3, "Invalid pumps 'two' of alarms"),
        (("study", "alarms", "x"), 3, "builds its own"),
        (("study", "public"), 3, "the folder of the public data sets"),
        (("study", "paper", "--set", "experiments=guess"), 3, "no experiment guess"),
        (("study", "paper"), 3, "the paper needs a folder"),
        (("study", "paper", "--size", "huge"), 2, "huge"),
    ],
)
def test_an_invalid_command_is_refused_at_once(
    arguments: tuple[str, ...], code: int, message: str
) -> None:
    result = run("bench", *arguments, code=code)
    assert not result.stdout
    assert message in words_of(result.stderr)


@pytest.mark.parametrize("has_bfloat16", [True, False])
def test_sixteen_bits_cause_a_warning_if_the_processor_is_slow_with_them(
    has_bfloat16: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "swashtwin_bench.cli.studies._has_bfloat16_arithmetic", lambda: has_bfloat16
    )
    # the unknown classifier ends the study after the warning
    settings = ("--set", "precision=bfloat16", "--set", "classifiers=guess")
    result = run("bench", "study", "case1", "x", *settings, code=3)
    assert ("slower here than float32" in result.stderr) is not has_bfloat16


# ---- settings


def test_settings_are_read_from_texts() -> None:
    texts = {"classifiers": "bitcn, tcn", "window": "4096", "rig": "2"}
    expected = PlanSettings(("bitcn", "tcn"), window=4096, rig="2")
    assert read_settings(PlanSettings, texts, "case1") == expected


def test_settings_are_read_from_values() -> None:
    # the library passes numbers, the command line passes texts
    settings = read_settings(AlarmStudySettings, {"duration": "0.5", "pumps": 3}, "alarms")
    assert (settings.duration, settings.pumps) == (0.5, 3)


def test_an_unknown_study_and_a_study_without_seeds_are_refused() -> None:
    with pytest.raises(InputError, match="Unknown study 'guess'"):
        run_study("guess")
    with pytest.raises(InputError, match="at least one seed"):
        Work(())
