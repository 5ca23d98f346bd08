"""The study of new conditions holds each out whole, and sets its price beside a score on known ones."""

import numpy as np
import pytest

from swashtwin.bench import StudyTable, run_conditions
from swashtwin.bench.questions.conditions import REMEDIES, TREES, ConditionStudySettings
from swashtwin.foundation import DataError
from swashtwin.learning import TrainingSettings


@pytest.fixture(scope="module")
def of_one_pump(recordings):
    labels = ("normal", "piston")
    return [recording for recording in recordings if recording.specimen == "A" and recording.label in labels]


@pytest.fixture(scope="module")
def study(of_one_pump) -> StudyTable:
    small = ConditionStudySettings(
        windows=2,
        training=TrainingSettings(epochs=1, normalization="set"),
        network={"stride": 32, "channels": (4,), "dilations": (1,)},
    )
    return run_conditions(of_one_pump, settings=small)


def test_every_condition_is_held_out_once_for_every_classifier(study):
    held_out = [
        row["held_out"] for row in study.details["single"] if row["level"] == "L3" and row["classifier"] == TREES
    ]
    assert len(held_out) == len(set(held_out)) == 3
    assert {row["classifier"] for row in study.rows()} == {*REMEDIES, TREES}
    assert all(len(study.values("recall", classifier=name, level="L3")) == 3 for name in REMEDIES)


def test_known_conditions_are_scored_beside_new_ones(study):
    assert {row["level"] for row in study.rows()} == {"L2", "L3"}
    assert np.isfinite(study.values("recall", classifier=TREES, level="L2")).all()
    assert "never trained on" in study.answer[0]


def test_one_condition_alone_cannot_be_held_out(of_one_pump):
    same = [recording for recording in of_one_pump if recording.condition == of_one_pump[0].condition]
    with pytest.raises(DataError, match="one condition"):
        run_conditions(same, settings=ConditionStudySettings(windows=2))
