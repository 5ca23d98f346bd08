"""The matrix of wrong twins and unusual truths counts warnings, and the coverage of values called
identified.
"""

from functools import partial
from pathlib import Path
from typing import Any

import pytest
from commandline import run_json

import swashtwin_bench.questions.wrong_twin_study as study
from swashtwin.foundation import InputError
from swashtwin.pump import Pump
from swashtwin_bench.questions.twin_matrix import RIGHT, matrix_cases, with_mount
from swashtwin_bench.results.table import Trial
from swashtwin_bench.rigs.writing import RigSize

CASES = {case.name: case for case in matrix_cases()}


# ---- the matrix


def test_the_matrix_has_at_least_sixty_cases_of_different_names() -> None:
    names = {(case.family, case.name) for case in matrix_cases()}
    assert len(names) == len(matrix_cases()) >= 60


def test_the_matrix_has_each_kind_of_mistake() -> None:
    families = {case.family for case in matrix_cases()}
    expected = {
        RIGHT,
        "mount",
        "bearing",
        "gain",
        "cross-talk",
        "odd truth",
        "piston count",
        "pressure",
        "unit",
    }
    assert expected <= families


def test_a_factor_along_one_axis_changes_that_stiffness_alone(pump: Pump) -> None:
    changed = with_mount(pump, 1.2, 1.0, 1.0)
    assert changed.mount.stiffness_x == pytest.approx(1.2 * pump.mount.stiffness_x)
    assert changed.mount.stiffness_y == pump.mount.stiffness_y


# ---- the study


@pytest.fixture
def run_study(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """Function that runs the study of a right twin and of one with nine pistons."""
    selected_cases = (CASES["nothing, truth 1"], CASES["9 pistons"])
    monkeypatch.setattr(study, "matrix_cases", lambda: selected_cases)
    arguments = ("study", "wrong-twins", "--seeds", "100", "--jobs", 1, "--out", tmp_path)
    return partial(run_json, "bench", *arguments)


def test_the_table_counts_finished_cases_which_are_not_calibrated_again(
    run_study: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = run_study()
    right, pistons = table["rows"]
    assert right["family"] == RIGHT
    assert right["identified"]["mean"] == right["covered"]["mean"] >= 2
    assert right["warned"]["mean"] == 0
    # a wrong number of pistons is a mistake that a warning can name
    assert pistons["warned"]["mean"] == pistons["named"]["mean"] == 1

    counts, _ = table["details"]["families"]
    assert counts["trials"] == 1
    assert counts["covered"] == counts["identified"] == right["identified"]["mean"]

    def refuse(*_: object) -> None:
        raise InputError("calibrated again")

    monkeypatch.setattr(study, "calibrate", refuse)
    assert run_study()["rows"] == table["rows"]


def test_a_pump_of_the_rig_is_measured_twice_at_the_study_s_pressure(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(study, "RigSize", partial(RigSize, duration=1.3))
    recordings, truth = study._rig_pump(100)
    conditions = [recording.condition for recording in recordings]
    pressures = [condition.discharge_pressure for condition in conditions if condition]
    assert pressures == [1e7, 1e7]
    assert (truth > 0).all()


# ---- its answer


def trial(
    family: str, identified: int, covered: int, *, errs: bool = False, warned: bool = False
) -> Trial:
    """Return a trial with these counts."""
    values = {
        "identified": identified,
        "covered": covered,
        "errs": float(errs),
        "warned": float(warned),
    }
    return Trial({"family": family}, 0, values)


def test_the_answer_names_a_family_whose_identified_values_do_not_hold() -> None:
    trials = [
        trial(RIGHT, 3, 3),
        trial("oil", 2, 1, errs=True),
        trial("unit", 0, 0, errs=True, warned=True),
    ]
    coverage, warnings, _ = study._answer(trials)

    assert "4 of 5 (80%)" in coverage
    assert "oil (50%)" in coverage
    assert "1 of 2 (50%) of the wrong twins" in warnings
    assert "0 of 1 (0%) of the right ones" in warnings


def test_the_interval_of_a_family_counts_trials_and_not_values() -> None:
    # six values of one trial share its mistake, so they say less than six trials
    one_trial = [trial("few", 6, 6)]
    six_trials = [trial("many", 1, 1)] * 6
    few, many = study.family_counts([*one_trial, *six_trials])

    assert few["identified"] == many["identified"] == 6
    assert few["interval"][0] < many["interval"][0]
