"""Settings chosen within the training side, scores on the test side, and the score that a leaky split would print."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from sklearn.metrics import recall_score
from sklearn.model_selection import LeaveOneGroupOut, StratifiedGroupKFold, StratifiedKFold

from swashtwin.foundation import DataError, derive_seed, stream
from swashtwin_bench.public.estimators import ESTIMATORS, extra_trees
from swashtwin_bench.public.question import Fold, Question, Setting, Units

_TRAIN_SHARE = 0.8
"""Share of the training units that a seed draws."""
_FEW_GROUPS = 3
"""Up to so many inner groups each is held out once; more are dealt into as many folds."""


@dataclass(frozen=True)
class FoldScore:
    """Scores of one fold."""

    fold: str
    """What was tested."""
    setting: str
    """What inner validation chose."""
    inner: float
    """Balanced accuracy by which it was chosen."""
    balanced_accuracy: float
    """On the test side, a decision for each recording."""
    rival: float
    """Of extra trees on the usual features, a decision for each window."""


def score_fold(question: Question, fold: Fold, seed: int) -> FoldScore:
    """What the chosen setting, and the usual trees, score on a fold."""
    units = question.units
    train, test = fold.sides(units.group)
    indices = _draw_training_units(train, units.label, seed)
    setting, inner = choose(question, indices, seed)
    X = units.features[setting.features]
    fitted = _maker(setting, seed).fit(X[indices], units.label[indices])
    score = _by_recording(fitted, X[test], units.label[test], units.recording[test])
    windows = question.windows
    train, test = fold.sides(windows.group)
    usual = windows.features["usual"]
    trees = extra_trees(derive_seed(seed, "trees") % 2**32).fit(usual[train], windows.label[train])
    rival = balanced_accuracy(windows.label[test], trees.predict(usual[test]))
    return FoldScore(fold.name, str(setting), inner, score, rival)


def choose(question: Question, indices: Int[np.ndarray, " drawn"], seed: int) -> tuple[Setting, float]:
    """(setting, its score) with the highest balanced accuracy over inner folds of the drawn units.

    Among equals the one with the highest mean log-probability of the truth.
    """
    units = question.units
    label, recording = units.label[indices], units.recording[indices]
    inner = list(_inner_folds(label, units.inner[indices], seed))
    ranked = []
    for index, setting in enumerate(question.settings):
        X = units.features[setting.features][indices]
        scores = []
        for train, test in inner:
            fitted = _maker(setting, seed).fit(X[train], label[train])
            score = _by_recording(fitted, X[test], label[test], recording[test])
            scores.append((score, _mean_log(fitted, X[test], label[test])))
        accuracy, likelihood = np.mean(scores, axis=0)
        ranked.append((round(float(accuracy), 9), float(likelihood), -index))
    best = max(range(len(ranked)), key=ranked.__getitem__)
    return question.settings[best], ranked[best][0]


def leaky_scores(question: Question, setting: Setting, seed: int) -> tuple[float, float]:
    """(chosen setting, extra trees): balanced accuracy over five folds of units dealt at random, as in most papers."""
    groups = set().union(*(fold.train | fold.test for fold in question.folds))
    balanced = _at_random(question.units, groups, setting.features, _maker(setting, seed), seed)
    trees = extra_trees(derive_seed(seed, "trees") % 2**32)
    return balanced, _at_random(question.windows, groups, "usual", trees, seed)


def balanced_accuracy(label: Shaped[np.ndarray, " unit"], predicted: Shaped[np.ndarray, " unit"]) -> float:
    """Mean recall of the classes that are there."""
    return float(recall_score(label, predicted, labels=np.unique(label), average="macro"))


def _at_random(units: Units, groups: set[str], features: str, estimator: Any, seed: int) -> float:
    is_used = np.isin(units.group, sorted(groups))
    X, label = units.features[features][is_used], units.label[is_used]
    predicted = np.empty_like(label)
    for train, test in StratifiedKFold(5, shuffle=True, random_state=seed).split(X, label):
        predicted[test] = estimator.fit(X[train], label[train]).predict(X[test])
    return balanced_accuracy(label, predicted)


def _maker(setting: Setting, seed: int) -> Any:
    return ESTIMATORS[setting.estimator](derive_seed(seed, "estimator") % 2**32)


def _draw_training_units(
    train: Bool[np.ndarray, " unit"], label: Shaped[np.ndarray, " unit"], seed: int
) -> Int[np.ndarray, " drawn"]:
    """Training units of a seed: four fifths of each class, at least one."""
    random = stream(seed, "training units")
    indices = []
    for name in np.unique(label[train]):
        of_class = np.flatnonzero(train & (label == name))
        indices.append(random.choice(of_class, max(1, round(_TRAIN_SHARE * len(of_class))), replace=False))
    return np.sort(np.concatenate(indices))


def _inner_folds(
    label: Shaped[np.ndarray, " drawn"], group: Shaped[np.ndarray, " drawn"], seed: int
) -> Iterator[tuple[Int[np.ndarray, " train"], Int[np.ndarray, " test"]]]:
    blank, groups = np.zeros(len(label)), np.unique(group)
    if len(groups) < 2:
        raise DataError(f"only {groups[0]} is left to learn from; choosing settings needs two groups to keep apart.")
    if len(groups) <= _FEW_GROUPS:
        yield from LeaveOneGroupOut().split(blank, label, group)
    else:
        dealt = StratifiedGroupKFold(_FEW_GROUPS, shuffle=True, random_state=seed)
        yield from dealt.split(blank, label, group)


def _by_recording(
    fitted: Any,
    X: Float[np.ndarray, "unit feature"],
    label: Shaped[np.ndarray, " unit"],
    recording: Shaped[np.ndarray, " unit"],
) -> float:
    """Balanced accuracy of recordings, each decided by the mean log-probability over its units."""
    _, first, inverse = np.unique(recording, return_index=True, return_inverse=True)
    logarithm = np.log(np.maximum(fitted.predict_proba(X), 1e-12))
    total = np.zeros((len(first), logarithm.shape[1]))
    np.add.at(total, inverse, logarithm)
    predicted = np.asarray(fitted.classes_)[total.argmax(axis=1)]
    return balanced_accuracy(label[first], predicted)


def _mean_log(fitted: Any, X: Float[np.ndarray, "unit feature"], label: Shaped[np.ndarray, " unit"]) -> float:
    """Mean log-probability of the truth; a class that training lacked counts as the floor."""
    probability = fitted.predict_proba(X)
    of_true_class = np.where(np.asarray(fitted.classes_)[None, :] == label[:, None], probability, 0.0).sum(axis=1)
    return float(np.mean(np.log(np.maximum(of_true_class, 1e-12))))
