"""Scores are as defined, refuse training recordings, and do not depend on the order of classes."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from imblearn.metrics import geometric_mean_score
from sklearn.metrics import balanced_accuracy_score

from swashtwin.foundation import DataError, InputError, LeakError, MPa, rpm
from swashtwin.learning import (
    Scores,
    WindowSet,
    evaluate,
    g_mean,
    pooled_probabilities,
    split_between,
)
from swashtwin.learning.evaluation.scores import accuracy_interval, g_mean_laplace
from swashtwin.learning.training.training_reference import TrainingReference
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording

CLASSES = ("normal", "swash_plate", "piston")


@dataclass(frozen=True, eq=False)
class Oracle:
    """Classifier that answers with given probabilities."""

    answers: np.ndarray
    classes: tuple[str, ...] = CLASSES
    manifest: tuple[str, ...] = ()

    def predict_proba(self, windows: WindowSet) -> np.ndarray:
        return self.answers[: len(windows)]


def measured(
    target, recordings=None, classes=CLASSES, *, pressure=None, synthetic=False
) -> WindowSet:
    count = len(target)
    if recordings is None:
        recordings = target
    names = [f"rec {value}" for value in recordings]

    if pressure is None:
        pressure = np.full(count, np.nan)

    return WindowSet(
        signal=np.zeros((count, 1, 4), dtype=np.float32),
        target=np.array(target, dtype=np.int64),
        classes=classes,
        recording_id=np.array(names, dtype=np.str_),
        specimen=np.full(count, "", dtype=np.str_),
        discharge_pressure=np.array(pressure, dtype=np.float64),
        speed=np.full(count, np.nan),
        start=np.arange(count, dtype=np.int64),
        synthetic=np.full(count, synthetic),
        sample_rate=1000.0,
        channels=("acceleration",),
    )


def confident(predicted, n_classes: int = 3, confidence: float = 0.9) -> np.ndarray:
    remaining_probability = (1 - confidence) / (n_classes - 1)
    return np.where(np.eye(n_classes)[predicted] > 0, confidence, remaining_probability)


def scores_of(target, predicted, classes=CLASSES) -> Scores:
    """Scores of confident predictions."""
    oracle = Oracle(confident(predicted, len(classes)), classes)
    return evaluate(oracle, measured(target, classes=classes))


def test_scores_of_a_confusion_worked_by_hand():
    target = [0] * 4 + [1] * 4 + [2] * 2
    predicted = [0, 0, 0, 1, 1, 1, 0, 0, 2, 2]
    scores = evaluate(Oracle(confident(predicted)), measured(target), split="L2")

    assert scores.confusion.tolist() == [[3, 1, 0], [2, 2, 0], [0, 0, 2]]
    assert scores.accuracy == pytest.approx(0.7)
    assert dict(scores.recall) == {"normal": 0.75, "swash_plate": 0.5, "piston": 1.0}
    assert scores.macro_recall == pytest.approx(0.75)
    assert scores.macro_f1 == pytest.approx((6 / 9 + 4 / 7 + 1) / 3)
    assert scores.g_mean == pytest.approx((0.75 * 0.5) ** (1 / 3))
    assert scores.g_mean_laplace == pytest.approx((3.5 / 5 * 2.5 / 5 * 2.5 / 3) ** (1 / 3))
    assert scores.false_alarm_rate == pytest.approx(1 / 4)
    assert scores.missed_fault_rate == pytest.approx(2 / 6)
    assert scores.calibration_error == pytest.approx(0.2)
    assert dict(scores.reasons) == {}
    assert scores.n_windows == 10
    assert scores.n_recordings == 3


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3)), min_size=1, max_size=40))
def test_the_g_mean_is_imbalanced_learns_and_the_macro_recall_scikit_learns(pairs):
    target, predicted = np.array(pairs).T
    assume(len(set(target)) > 1 and set(target) >= set(predicted))
    order = {label: index for index, label in enumerate(sorted(set(target.tolist())))}
    confusion = np.zeros((len(order), len(order)), dtype=np.int64)

    for actual, answer in pairs:
        confusion[order[actual], order[answer]] += 1

    expected = geometric_mean_score(target, predicted, average="multiclass", correction=0.0)
    assert g_mean(confusion) == pytest.approx(expected)

    classes = tuple(f"class {index}" for index in range(4))
    scores = scores_of(target, predicted, classes)
    expected = balanced_accuracy_score(target, predicted)
    assert scores.macro_recall == pytest.approx(expected)


def test_the_g_mean_is_zero_if_a_recall_is_zero_and_its_laplace_form_is_not():
    confusion = np.array([[5, 0], [4, 0]])
    assert g_mean(confusion) == 0
    assert g_mean_laplace(confusion) == pytest.approx(math.sqrt(5.5 / 6 * 0.5 / 5))


def test_a_class_without_test_windows_makes_the_g_mean_nan_with_a_reason():
    scores = scores_of(target=[0, 1, 1], predicted=[0, 0, 1])
    assert math.isnan(scores.g_mean)
    assert math.isnan(scores.g_mean_laplace)
    assert math.isnan(scores.recall["piston"])
    assert scores.reasons["g_mean"] == "no test window of piston"
    assert scores.macro_recall == pytest.approx(0.75)
    assert "piston" in scores.reasons["macro_recall"]


def test_rates_that_healthy_windows_cannot_give_are_nan_with_a_reason():
    scores = scores_of(target=[0, 0], predicted=[0, 1])
    assert scores.false_alarm_rate == 0.5
    assert math.isnan(scores.missed_fault_rate)
    assert scores.reasons["missed_fault_rate"] == "no faulty test window"
    assert scores.reasons["macro_auroc"] == "every test window is of one class"


def test_rates_need_a_healthy_class():
    scores = scores_of(target=[0, 1], predicted=[0, 1], classes=("a", "b"))
    assert scores.reasons["false_alarm_rate"] == "no healthy class, so no false-alarm rate"
    assert scores.reasons["missed_fault_rate"] == "no healthy class, so no missed-fault rate"


def test_a_confusion_of_two_healthy_classes_is_not_a_false_alarm():
    scores = scores_of(
        target=[0, 0, 1, 1, 2],
        predicted=[0, 1, 0, 2, 1],
        classes=("gut", "normal", "b"),
    )
    assert scores.false_alarm_rate == 0.25
    assert scores.missed_fault_rate == 1


@settings(max_examples=30, deadline=None)
@given(st.permutations(range(3)), st.permutations(range(3)), st.integers(0, 2**20))
def test_scores_do_not_depend_on_the_order_of_the_classes(classifier_order, test_order, seed):
    draw = np.random.default_rng(seed)
    target = draw.integers(0, 3, 30)
    recording = draw.integers(0, 4, 30)
    recording = 4 * target + recording
    answers = draw.dirichlet(np.ones(3), 30)
    plain = evaluate(Oracle(answers), measured(target, recording))

    names = np.array(CLASSES)
    classifier_classes = tuple(names[classifier_order].tolist())
    test_classes = tuple(names[test_order].tolist())
    shuffled_target = np.argsort(test_order)[target]
    shuffled = evaluate(
        Oracle(answers[:, classifier_order], classifier_classes),
        measured(shuffled_target, recording, test_classes),
    )

    for name, value in plain.to_dict().items():
        if name in ("classes", "recall", "confusion", "cells"):
            continue  # these are listed by class
        if isinstance(value, float | list):
            value = pytest.approx(value)
        assert shuffled.to_dict()[name] == value
    assert dict(shuffled.recall) == pytest.approx(dict(plain.recall), nan_ok=True)
    expected = plain.confusion[np.ix_(classifier_order, classifier_order)]
    assert shuffled.confusion.tolist() == expected.tolist()


def test_a_recording_is_decided_by_the_mean_log_probability_of_its_windows():
    # two windows favor class 1, the third is sure of class 0: a majority would err, the mean
    # logarithm does not
    answers = np.array([[0.4, 0.5, 0.1], [0.4, 0.5, 0.1], [0.97, 0.01, 0.02]])
    scores = evaluate(Oracle(answers), measured([0, 0, 0]))

    assert scores.accuracy == pytest.approx(1 / 3)
    assert scores.recording_accuracy == 1

    expected = np.prod(answers, axis=0) ** (1 / 3)
    np.testing.assert_allclose(pooled_probabilities(answers), expected / expected.sum())
    assert np.isfinite(pooled_probabilities(np.array([[1.0, 0.0]]))).all()


def test_each_cell_of_class_and_pressure_has_its_recall():
    pressure = [5e6, 5e6, 15e6, 15e6, np.nan]
    windows = measured([1, 1, 1, 1, 0], range(5), pressure=pressure)
    scores = evaluate(Oracle(confident([1, 1, 0, 1, 0])), windows)

    cells = [
        (cell.label, cell.discharge_pressure, cell.n_windows, cell.recall) for cell in scores.cells
    ]
    assert cells == [
        ("normal", None, 1, 1.0),
        ("swash_plate", 5e6, 2, 1.0),
        ("swash_plate", 15e6, 2, 0.5),
    ]


def test_the_interval_depends_on_recordings_and_not_on_windows():
    # three of four recordings are right, in all of their 50 windows
    is_right = np.repeat([True, True, True, False], 50)
    recording = np.repeat(np.arange(4), 50)
    by_recording = accuracy_interval(is_right, recording)
    assert by_recording == (0.25, 1.0)

    low, high = accuracy_interval(is_right, np.arange(200))
    assert 0.65 < low < 0.75 < high < 0.85

    # 0 is the default seed
    assert accuracy_interval(is_right, recording, seed=0) == by_recording


def test_the_interval_of_recordings_without_an_error_is_that_of_their_number():
    is_right = np.ones(60, dtype=bool)
    recording = np.repeat(np.arange(20), 3)
    low, high = accuracy_interval(is_right, recording)

    # 20 recordings without an error are possible at an accuracy of 84 %
    assert round(low, 3) == 0.839
    assert high == 1.0


def test_synthetic_recordings_are_refused_by_name():
    windows = measured([1], synthetic=True)
    with pytest.raises(LeakError, match="rec 1 is synthetic"):
        evaluate(Oracle(confident([1])), windows)


def test_training_recordings_are_refused_by_name():
    oracle = Oracle(confident([0, 1, 2]), manifest=("rec 0", "rec 2", "rec 7"))
    with pytest.raises(LeakError, match="recording rec 0 and 1 more had a part"):
        evaluate(oracle, measured([0, 1, 2]))


@pytest.mark.parametrize(
    ("windows", "error", "message"),
    [
        (measured([-1]), DataError, "has no label"),
        (measured([0]).subset(np.array([], dtype=np.int64)), DataError, "no window"),
        (
            measured([0], classes=("normal", "loose")),
            InputError,
            "does not know the class 'loose'",
        ),
    ],
    ids=["unlabeled", "empty", "unknown class"],
)
def test_windows_that_cannot_be_scored_are_refused(
    windows: WindowSet, error: type[Exception], message: str
):
    with pytest.raises(error, match=message):
        evaluate(Oracle(confident([0])), windows)


def test_an_unknown_split_is_refused():
    with pytest.raises(InputError, match="Invalid split 'L9': it must be one of L0, L1"):
        evaluate(Oracle(confident([0])), measured([0]), split="L9")


def test_the_split_follows_from_machines_and_operating_points() -> None:
    at_5 = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(5.0))
    at_15 = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(15.0))
    reference = TrainingReference(
        recording_id=("a", "b"),
        label=("normal", "piston"),
        specimen=("A", "A"),
        condition=np.array([[at_5.speed, at_5.discharge_pressure]] * 2),
        features=np.zeros((2, 1), np.float32),
        statistics=np.zeros((2, 1, 1)),
    )

    def tested(specimen: str | None, condition: OperatingCondition | None) -> Recording:
        return Recording(np.zeros((1, 8)), 1000.0, "t", specimen=specimen, condition=condition)

    assert split_between(reference, [tested("A", at_5), tested("A", None)]) == "L2"
    assert split_between(reference, [tested("A", at_15)]) == "L3"
    assert split_between(reference, [tested("B", at_5)]) == "L4"
    assert split_between(reference, [tested("A", at_5), tested("B", at_5)]) is None
    assert split_between(reference, [tested(None, at_5)]) is None
