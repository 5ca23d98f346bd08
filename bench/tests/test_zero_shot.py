"""The zero-shot study on a very small rig: no measured fault teaches the prior, and no reference is
tested.
"""

import json
from dataclasses import replace
from typing import Any

import pytest

from swashtwin.diagnosis import PriorClassifier
from swashtwin.foundation import DataError
from swashtwin.recordings import Recording
from swashtwin_bench import Work
from swashtwin_bench.questions import zero_shot
from swashtwin_bench.questions.zero_shot import (
    ORACLE,
    SAME,
    UNSEEN,
    ZeroShotSplit,
    adapted_to,
    few_healthy,
    left_out,
    prior_trials,
    split_zero_shot,
)


@pytest.fixture(scope="module")
def two_pressures(recordings: list[Recording]) -> list[Recording]:
    """Recordings of three pumps at 5 and 15 MPa."""
    return [recording for recording in recordings if "_10MPa_" not in recording.recording_id]


@pytest.fixture(scope="module")
def split(two_pressures: list[Recording]) -> ZeroShotSplit:
    return split_zero_shot(two_pressures, 0, 1)


def ids_of(recordings: list[Recording], label: str) -> frozenset[str]:
    """Return the ids of the recordings of a class."""
    return frozenset(recording.recording_id for recording in recordings if recording.label == label)


@pytest.fixture
def small_prior(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the shipped prior by one with every fortieth of its virtual pumps."""
    prior = PriorClassifier.load("25scy14-1b")
    assert prior.virtual is not None
    is_selected = prior.virtual.number % 40 == 0
    parts = {
        name: getattr(prior.virtual, name)[is_selected] for name in ("change", "target", "number")
    }
    small = replace(prior, virtual=replace(prior.virtual, **parts))
    monkeypatch.setattr(PriorClassifier, "load", lambda name: small)


@pytest.fixture
def one_held_out_pump(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hold out one pump: the tiny rig has only three."""
    monkeypatch.setattr(split_zero_shot, "__defaults__", (1,))


# ---- the split


@pytest.mark.parametrize("seed", range(4))
def test_every_recording_has_one_role(two_pressures: list[Recording], seed: int) -> None:
    split = split_zero_shot(two_pressures, seed, 1)
    roles = [split.healthy, split.faulty, split.tests[SAME], split.tests[UNSEEN]]
    assert sum(map(len, roles)) == len(frozenset().union(*roles)) == len(two_pressures)


@pytest.mark.parametrize("seed", range(4))
def test_references_are_healthy_and_unseen_pumps_are_in_no_training(
    two_pressures: list[Recording], seed: int
) -> None:
    split = split_zero_shot(two_pressures, seed, 1)
    assert not any("normal" in name for name in split.faulty)
    assert all("normal" in name for name in split.healthy)

    # an id begins with the name of its pump
    assert {name[0] for name in split.tests[UNSEEN]}.isdisjoint(split.pumps)


def test_a_single_healthy_recording_is_refused_by_name(two_pressures: list[Recording]) -> None:
    few = [recording for recording in two_pressures if recording.recording_id != "A_normal_5MPa_1"]
    with pytest.raises(DataError, match="A_normal_5MPa_2 is the only healthy recording"):
        split_zero_shot(few, 0, 1)


def test_three_held_out_pumps_need_four(two_pressures: list[Recording]) -> None:
    with pytest.raises(DataError, match="at least 4 specimens"):
        split_zero_shot(two_pressures, 0, 3)


# ---- the study


@pytest.fixture
def table(
    two_pressures: list[Recording], small_prior: None, one_held_out_pump: None
) -> dict[str, Any]:
    """JSON of the study."""
    study = zero_shot.zero_shot(Work(), zero_shot.ZeroShotSettings(), two_pressures)
    return json.loads(json.dumps(study.to_dict(), allow_nan=False))  # type: ignore[no-any-return]


def test_the_rows_are_those_of_the_schema(table: dict[str, Any]) -> None:
    assert table["study"] == "zero-shot"
    columns = {"training_set", "test", "recording_balanced_accuracy", "recall_piston"}
    assert all(columns <= row.keys() for row in table["rows"])
    assert {row["test"] for row in table["rows"]} == {SAME, UNSEEN}
    assert "stand-in for a machine" in table["origin"]

    # a prior that was never taught a fault cannot name it
    without_piston = [row for row in table["rows"] if row["training_set"] == left_out("piston")]
    assert [row["recall_piston"]["mean"] for row in without_piston] == [0.0, 0.0]
    assert all(0 <= row["unknown_piston"]["mean"] <= 1 for row in without_piston)


@pytest.mark.usefixtures("small_prior", "one_held_out_pump")
def test_fewer_healthy_recordings_adapt_a_prior_of_the_fleet_or_of_each_pump(
    two_pressures: list[Recording],
) -> None:
    settings = zero_shot.ZeroShotSettings(healthy=(1,))
    study = zero_shot.zero_shot(Work(), settings, two_pressures)
    names = {row["training_set"] for row in study.rows()}
    assert names == {adapted_to(1), adapted_to(1, alone=True)}
    assert adapted_to(1, alone=True) in study.answer[0]


def test_fewer_healthy_recordings_are_a_part_of_more(two_pressures: list[Recording]) -> None:
    normal = [recording for recording in two_pressures if recording.label == "normal"]
    one_each = ids_of(few_healthy(normal, 1, 0), "normal")
    two_each = ids_of(few_healthy(normal, 2, 0), "normal")

    # three pumps at two pressures, of two recordings each
    assert len(one_each) == 6
    assert one_each < two_each == ids_of(two_pressures, "normal")


@pytest.mark.usefixtures("small_prior")
def test_measured_faults_that_lack_a_class_leave_it_without_probability(
    two_pressures: list[Recording], split: ZeroShotSplit
) -> None:
    pistons = ids_of(two_pressures, "piston")
    only_pistons = replace(
        split,
        healthy=ids_of(two_pressures, "normal"),
        faulty=pistons,
        tests={SAME: pistons},
    )

    scores = {}
    for trial in prior_trials(two_pressures, only_pistons, 0):
        scores[trial.factors["training_set"]] = trial.values
    assert scores[ORACLE]["recall_piston"] == 1.0
