"""The estimators by name, each with the settings it is always used with."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from sklearn.base import BaseEstimator, ClassifierMixin, clone
from sklearn.ensemble import ExtraTreesClassifier, RandomForestClassifier
from sklearn.linear_model import LogisticRegression, RidgeClassifierCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC

from swashtwin.learning.features import FeatureTable
from swashtwin.learning.windows.window_set import WindowSet


class DecisionSoftmax(ClassifierMixin, BaseEstimator):
    """A classifier whose probabilities are the softmax of its decision values; with two classes, of (-d, d).

    The likeliest class is the one that the classifier decides for, and the order of the classes its own; the height of
    a probability means little until `learn_confidence` calibrates it.
    """

    def __init__(self, decider: Any) -> None:
        self.decider = decider

    def fit(self, X: Float[np.ndarray, "window column"], y: Int[np.ndarray, " window"]) -> "DecisionSoftmax":
        """The same, its classifier fitted."""
        self.decider_ = clone(self.decider).fit(X, y)
        self.classes_ = self.decider_.classes_
        return self

    def predict_proba(self, X: Float[np.ndarray, "window column"]) -> Float[np.ndarray, "window class"]:
        """Probability of each class for each row."""
        decision = self.decider_.decision_function(X)
        if decision.ndim == 1:
            decision = np.stack([-decision, decision], axis=1)
        share = np.exp(decision - decision.max(axis=1, keepdims=True), dtype=np.float64)
        return share / share.sum(axis=1, keepdims=True)

    def predict(self, X: Float[np.ndarray, "window column"]) -> Int[np.ndarray, " window"]:
        """Likeliest class of each row."""
        return self.classes_[self.predict_proba(X).argmax(axis=1)]


N_TREES = 300
"""Trees of a forest; more change no figure here."""

RIDGE_PENALTIES = np.logspace(-3, 3, 10)
"""Penalties that cross-validation chooses from, as the authors of ROCKET do."""


@dataclass(frozen=True)
class Baseline:
    """An estimator of scikit-learn, and what it is fitted on. No setting was chosen by any score of this package."""

    title: str
    """What it is called in a table."""
    paper: str
    """DOI of where it was first written down."""
    estimator: Callable[[int], Any]
    """Makes the estimator from a seed; it learns each column's scale itself where it needs one."""
    fit_columns: Callable[[WindowSet, int], Callable[[WindowSet], FeatureTable]] | None = None
    """Makes, from training windows and a seed, what computes its columns; None where those are vibration features."""


def _ridge(seed: int) -> Any:
    return make_pipeline(StandardScaler(), DecisionSoftmax(RidgeClassifierCV(alphas=RIDGE_PENALTIES)))


BASELINES: dict[str, Baseline] = {
    "extra_trees": Baseline(
        "extra trees", "10.1007/s10994-006-6226-1",
        lambda seed: ExtraTreesClassifier(N_TREES, random_state=seed, n_jobs=1),
    ),
    "random_forest": Baseline(
        "random forest", "10.1023/A:1010933404324",
        lambda seed: RandomForestClassifier(N_TREES, random_state=seed, n_jobs=1),
    ),
    "svm": Baseline(
        "SVM (RBF)", "10.1007/BF00994018",
        lambda seed: make_pipeline(StandardScaler(), DecisionSoftmax(SVC(kernel="rbf", C=1.0, gamma="scale"))),
    ),
    "logistic": Baseline(
        "logistic regression", "10.1111/j.2517-6161.1958.tb00292.x",
        lambda seed: make_pipeline(StandardScaler(), LogisticRegression(max_iter=5000)),
    ),
    "ridge": Baseline("ridge", "10.1080/00401706.1970.10488634", _ridge),
}  # fmt: skip
"""The classifiers without a network, by name."""
