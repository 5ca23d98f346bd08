"""The estimators by name, each with the settings it is always used with."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from sklearn.ensemble import ExtraTreesClassifier, RandomForestClassifier
from sklearn.linear_model import LogisticRegression, RidgeClassifierCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC

from swashtwin.learning.estimators.decisions import DecisionSoftmax
from swashtwin.learning.features import FeatureTable
from swashtwin.learning.windows.window_set import WindowSet

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
