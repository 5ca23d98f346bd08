"""The study of confidence keeps its roles apart, and finds every row."""

import json
import math
from pathlib import Path

import pytest
from tree_models import fit_trees

from swashtwin.learning import (
    FittedClassifier,
    TrainingSettings,
    WindowSet,
    cut_windows,
    learn_confidence,
)
from swashtwin.pump import CLASSES
from swashtwin_bench import Work
from swashtwin_bench.questions import confidence
from swashtwin_bench.questions.confidence import METRICS, ConfidenceStudySettings, record_roles
from swashtwin_bench.rivals.baselines import UNSCALED
from swashtwin_bench.rivals.models import MODELS, Model

TINY = ConfidenceStudySettings(trained_pumps=1, validation_pumps=1, unseen_pumps=1, duration=0.2)


def test_no_recording_has_two_roles_and_the_unseen_pumps_are_unseen() -> None:
    parts = record_roles(0, TINY)
    ids = [recording.recording_id for some in parts.values() for recording in some]
    assert len(set(ids)) == len(ids)
    specimens = {role: {recording.specimen for recording in some} for role, some in parts.items()}
    assert specimens["train"] == specimens["same"] == specimens["L2"]
    assert not specimens["L4"] & (specimens["train"] | specimens["other"])
    assert not specimens["other"] & specimens["train"]
    for some in parts.values():
        assert {recording.label for recording in some} == set(CLASSES)


@pytest.mark.nightly
def test_every_row_has_every_figure_and_is_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    training = TrainingSettings(epochs=1, normalization="set")
    small = {"bitcn": Model("bitcn", {"stride": 32, "channels": (8, 8)}, training)}
    monkeypatch.setitem(MODELS, "quick", {**small, "extra_trees": Model("extra_trees", {"trees": 10}, UNSCALED)})
    study = confidence.confidence(Work((0,), out=tmp_path), TINY)
    monkeypatch.setattr(confidence, "_training", None)
    assert confidence.confidence(Work((0,), out=tmp_path), TINY).rows() == study.rows()
    table = json.loads(json.dumps(study.to_dict(), allow_nan=False))
    assert len(table["rows"]) == 8
    for row in table["rows"]:
        assert all(row[name]["mean"] is not None for name in METRICS)
        assert 1 <= row["set_size"]["mean"] <= 5
        assert math.isclose(
            row["unknown_auroc"]["mean"], sum(row[f"auroc_{label}"]["mean"] for label in CLASSES) / 5, rel_tol=1e-9
        )
    assert "stand-in for a machine" in table["origin"]
    assert "sets asked to hold 90%" in table["answer"][0]
    assert "bitcn less extra_trees, paired by fleet (n = 1)" in table["answer"][-1]


def test_confidence_that_the_training_learned_has_rows_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    parts = record_roles(0, TINY)

    def train_trees(model: Model, train: WindowSet, *, seed: int) -> FittedClassifier:
        validation = [recording for recording in parts["same"] if recording.label != "valve_plate"]
        return learn_confidence(fit_trees(train), cut_windows(validation, like=train))

    monkeypatch.setattr(confidence, "train_model", train_trees)
    result = confidence._training(parts, "chosen", "valve_plate", 0, TINY)
    assert set(result) == {"same", "other", "training"}
    assert result["training"] == result["same"] != result["other"]
