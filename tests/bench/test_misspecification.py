"""The study of wrong twins tells what a mistake does to the values, and whether a calibration warned of it."""

import math
from functools import partial

import pytest
from commandline import run_json

import swashtwin.bench.questions.misspecification as study
from swashtwin.bench import StudyTable, run_misspecification
from swashtwin.bench.questions.wrong_twins import wrong_twins
from swashtwin.bench.rigs.writing import RigSize

CHOSEN = ("nothing", "mounting -50 %", "unit stated as g")


@pytest.fixture(scope="module")
def table() -> StudyTable:
    return run_misspecification(seeds=(2,), pumps=1, backgrounds=("own",), wrong=CHOSEN)


def test_a_right_twin_finds_the_values_and_is_not_warned_of(table: StudyTable) -> None:
    (trial,) = table.of(wrong="nothing", nuisances="none")
    assert trial.values["error"] < 0.05
    assert trial.values["coverage"] == 1
    assert trial.values["warned"] == 0
    assert math.isnan(trial.values["named"])


def test_a_wrong_mounting_spoils_the_fit_and_is_named(table: StudyTable) -> None:
    (right,), (wrong,) = (table.of(wrong=name, nuisances="none") for name in CHOSEN[:2])
    assert wrong.values["sve"] > 10 * right.values["sve"]
    assert wrong.values["warned"] == wrong.values["named"] == 1


def test_a_refusal_counts_as_a_warning_and_has_no_figures(table: StudyTable) -> None:
    (refused,) = table.of(wrong="unit stated as g", nuisances="none")
    assert refused.values == {"warned": 1.0, "named": 1.0}


def test_the_rig_s_pumps_are_compared_with_their_own_truth(monkeypatch: pytest.MonkeyPatch) -> None:
    """On recordings of 1.5 s, and without the refits that explain a misfit."""
    monkeypatch.setattr(study, "RigSize", partial(RigSize, duration=1.5))
    monkeypatch.setattr("swashtwin.calibration.notes.misfit_hypotheses", lambda *_: ())
    table = run_misspecification(seeds=(2,), pumps=1, backgrounds=("rig",), wrong=("nothing",))
    (trial,) = table.of(nuisances="usual")
    assert 0 < trial.values["sve"] < 1
    assert "stand-in for a machine" in table.origin


def test_the_command_prints_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "wrong_twins", lambda: wrong_twins()[:1])
    table = run_json("bench", "misspecification", "--specimens", 1, "--origin", "own", "--jobs", 1)
    assert [row["wrong"] for row in table["rows"]] == ["nothing", "nothing"]
    assert "no mistake passes without a warning" in table["answer"][0]
