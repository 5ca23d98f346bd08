"""The zero-shot study on a very small rig: no measured fault teaches the prior, no reference is
tested.
"""

import json
from dataclasses import replace

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
    return [recording for recording in recordings if "_10MPa_" not in recording.recording_id]


@pytest.fixture(scope="module")
def split(two_pressures: list[Recording]) -> ZeroShotSplit:
    return split_zero_shot(two_pressures, 0, 1)


@pytest.fixture
def small_prior(monkeypatch: pytest.MonkeyPatch) -> None:
    """The shipped prior with every fortieth of its virtual pumps, in place of the whole."""
    prior = PriorClassifier.load("25scy14-1b")
    assert prior.virtual is not None
    few = prior.virtual.number % 40 == 0
    parts = {name: getattr(prior.virtual, name)[few] for name in ("change", "target", "number")}
    monkeypatch.setattr(
        PriorClassifier,
        "load",
        lambda name: replace(prior, virtual=replace(prior.virtual, **parts)),
    )


@pytest.mark.parametrize("seed", range(4))
def test_no_recording_has_two_roles(two_pressures: list[Recording], seed: int) -> None:
    split = split_zero_shot(two_pressures, seed, 1)
    roles = [split.healthy, split.faulty, split.tests[SAME], split.tests[UNSEEN]]
    assert sum(map(len, roles)) == len(frozenset().union(*roles)) == len(two_pressures)
    assert not any("normal" in name for name in split.faulty)
    assert all("normal" in name for name in split.healthy)
    assert {name[0] for name in split.tests[UNSEEN]}.isdisjoint(split.pumps)


@pytest.mark.usefixtures("small_prior")
def test_the_rows_are_those_of_the_schema(
    two_pressures: list[Recording], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(split_zero_shot, "__defaults__", (1,))
    study = zero_shot.zero_shot(Work(), zero_shot.ZeroShotSettings(), two_pressures)
    table = json.loads(json.dumps(study.to_dict(), allow_nan=False))
    assert table["study"] == "zero-shot"
    for name in ("training_set", "test", "recording_balanced_accuracy", "recall_piston"):
        assert all(name in row for row in table["rows"])
    assert {row["test"] for row in table["rows"]} == {SAME, UNSEEN}
    without = [row for row in table["rows"] if row["training_set"] == left_out("piston")]
    assert [row["recall_piston"]["mean"] for row in without] == [0.0, 0.0]
    assert all(0 <= row["unknown_piston"]["mean"] <= 1 for row in without)
    assert "stand-in for a machine" in table["origin"]


@pytest.mark.usefixtures("small_prior")
def test_fewer_healthy_recordings_adapt_a_prior_of_the_fleet_or_of_each_pump(
    two_pressures: list[Recording], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(split_zero_shot, "__defaults__", (1,))
    study = zero_shot.zero_shot(Work(), zero_shot.ZeroShotSettings(healthy=(1,)), two_pressures)
    assert {row["training_set"] for row in study.rows()} == {
        adapted_to(1),
        adapted_to(1, alone=True),
    }
    assert adapted_to(1, alone=True) in study.answer[0]
    normal = [recording for recording in two_pressures if recording.label == "normal"]
    one, two = ({item.recording_id for item in few_healthy(normal, count, 0)} for count in (1, 2))
    assert len(one) == 6
    assert one < two == {recording.recording_id for recording in normal}


@pytest.mark.usefixtures("small_prior")
def test_measured_faults_that_lack_a_class_leave_it_without_probability(
    two_pressures: list[Recording], split: ZeroShotSplit
) -> None:
    normal = {recording.recording_id for recording in two_pressures if recording.label == "normal"}
    pistons = {recording.recording_id for recording in two_pressures if recording.label == "piston"}
    split = replace(
        split,
        healthy=frozenset(normal),
        faulty=frozenset(pistons),
        tests={SAME: frozenset(pistons)},
    )
    scores = {
        trial.factors["training_set"]: trial.values
        for trial in prior_trials(two_pressures, split, 0)
    }
    assert scores[ORACLE]["recall_piston"] == 1.0


def test_a_single_healthy_recording_is_refused_by_name(two_pressures: list[Recording]) -> None:
    few = [recording for recording in two_pressures if recording.recording_id != "A_normal_5MPa_1"]
    with pytest.raises(DataError, match="A_normal_5MPa_2 is the only healthy recording"):
        split_zero_shot(few, 0, 1)


def test_three_pumps_held_out_need_four(two_pressures: list[Recording]) -> None:
    with pytest.raises(DataError, match="at least 4 specimens"):
        split_zero_shot(two_pressures, 0, 3)
