"""Classifiers without a network: all of one kind, and honest about their recordings."""

import numpy as np
import pytest

from swashtwin.foundation import DataError, InputError, LeakError
from swashtwin.learning import (
    BASELINES,
    Classifier,
    FeatureTable,
    WindowSet,
    cut_windows,
    evaluate,
    extract_features,
    fit_baseline,
    fit_extra_trees,
)
from swashtwin.learning.estimators.registry import DecisionSoftmax
from swashtwin.recordings import Recording

CLASSES = ("normal", "piston", "valve_plate")
ON_FEATURES = [name for name, baseline in BASELINES.items() if baseline.fit_columns is None]


def tones(tag: str, *, per_class: int = 3, classes: tuple[str, ...] = CLASSES, gain: float = 1.0) -> WindowSet:
    recordings = []
    for index, label in enumerate(classes):
        for number in range(per_class):
            name = f"{tag} {label} {number}"
            draw = np.random.default_rng(list(name.encode()))
            phase = 2 * np.pi * (0.05 + 0.06 * index) * np.arange(640) + draw.uniform(0, 6)
            signal = gain * (np.sin(phase) + 0.3 * draw.normal(size=phase.size))
            recordings.append(Recording(signal[None], 1000.0, name, label=label))
    return cut_windows(recordings, length=128)


@pytest.mark.parametrize("name", ON_FEATURES)
@pytest.mark.parametrize("classes", [CLASSES, CLASSES[:2]])
def test_every_classifier_on_features_tells_tones_of_new_recordings_apart(name: str, classes: tuple[str, ...]) -> None:
    baseline = fit_baseline(name, tones("train", classes=classes), manifest=["twin"])
    assert isinstance(baseline, Classifier)
    test = tones("test", classes=classes)
    probability = baseline.predict_proba(test)
    np.testing.assert_allclose(probability.sum(axis=1), 1)
    assert evaluate(baseline, test).accuracy > 0.9
    assert (baseline.predict(test) == np.array(classes)[probability.argmax(axis=1)]).all()
    assert "twin" in baseline.manifest
    with pytest.raises(LeakError):
        evaluate(baseline, tones("train", classes=classes))


@pytest.mark.parametrize("name", ON_FEATURES)
def test_the_same_seed_gives_the_same_probabilities(name: str) -> None:
    train, test = tones("train"), tones("test")
    first, second = (fit_baseline(name, train, seed=3).predict_proba(test) for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_extra_trees_by_name_are_the_extra_trees() -> None:
    train, test = tones("train"), tones("test")
    by_name, by_hand = fit_baseline("extra_trees", train, seed=2), fit_extra_trees(train, seed=2)
    np.testing.assert_array_equal(by_name.predict_proba(test), by_hand.predict_proba(test))


@pytest.mark.parametrize("name", ["svm", "logistic", "ridge"])
def test_a_column_counts_the_same_in_whatever_unit_it_is(name: str) -> None:
    def in_other_units(windows: WindowSet) -> FeatureTable:
        table = extract_features(windows)
        return FeatureTable(table.values * np.geomspace(1e-3, 1e3, table.values.shape[1]), table.names)

    train, test = tones("train"), tones("test")
    plain, changed = fit_baseline(name, train), fit_baseline(name, train, features=in_other_units)
    np.testing.assert_allclose(changed.predict_proba(test), plain.predict_proba(test), atol=1e-3)


def test_the_softmax_of_decisions_decides_as_the_decisions_do() -> None:
    from sklearn.linear_model import RidgeClassifier

    draw = np.random.default_rng(0)
    for n_classes in (2, 4):
        target = draw.integers(n_classes, size=80)
        columns = draw.normal(size=(80, 5)) + 0.5 * target[:, None]
        soft, hard = DecisionSoftmax(RidgeClassifier()).fit(columns, target), RidgeClassifier().fit(columns, target)
        probability = soft.predict_proba(columns)
        np.testing.assert_array_equal(soft.predict(columns), hard.predict(columns))
        np.testing.assert_allclose(probability.sum(axis=1), 1)
        decision = hard.decision_function(columns)
        steps = np.diff(np.log(probability), axis=1)
        np.testing.assert_allclose(steps, 2 * decision[:, None] if n_classes == 2 else np.diff(decision, axis=1))


def test_an_unknown_classifier_and_a_missing_class_are_refused() -> None:
    train = tones("train")
    with pytest.raises(InputError, match="Did you mean 'random_forest'"):
        fit_baseline("random forest", train)
    with pytest.raises(DataError, match="valve_plate has no training window"):
        fit_baseline("ridge", train.subset(train.target < 2))
