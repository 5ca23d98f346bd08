"""The estimators by name, each with the settings it is always used with."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from sklearn.ensemble import ExtraTreesClassifier, RandomForestClassifier
from sklearn.linear_model import LogisticRegression, RidgeClassifierCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer, StandardScaler
from sklearn.svm import SVC

from swashtwin.learning.estimators.decisions import DecisionSoftmax

N_TREES = 300
"""Trees of a forest; more change no figure here."""

_PENALTIES = np.logspace(-3, 3, 10)  # those that the authors of ROCKET let cross-validation choose from


@dataclass(frozen=True)
class Baseline:
    """An estimator of scikit-learn, and what it is fitted on. No setting was chosen by any score of this package."""

    title: str
    """What it is called in a table."""
    columns: str
    """``"features"`` (of vibration), or the kernels that make its columns out of the windows themselves."""
    paper: str
    """DOI of where it was first written down."""
    estimator: Callable[[int], Any]
    """Makes the estimator from a seed; it learns each column's scale itself where it needs one."""


def _ridge(seed: int) -> Any:
    return make_pipeline(StandardScaler(), DecisionSoftmax(RidgeClassifierCV(alphas=_PENALTIES)))


def _kernel_ridge(seed: int) -> Any:
    ridge = DecisionSoftmax(RidgeClassifierCV(alphas=_PENALTIES))
    return make_pipeline(StandardScaler(with_mean=False, copy=False), ridge)


def _counted_ridge(seed: int) -> Any:
    return make_pipeline(FunctionTransformer(_root_of_counts), _kernel_ridge(seed))


def _root_of_counts(columns: np.ndarray) -> np.ndarray:
    return np.sqrt(np.maximum(columns, 0))


BASELINES: dict[str, Baseline] = {
    "extra_trees": Baseline(
        "extra trees", "features", "10.1007/s10994-006-6226-1",
        lambda seed: ExtraTreesClassifier(N_TREES, random_state=seed, n_jobs=1),
    ),
    "random_forest": Baseline(
        "random forest", "features", "10.1023/A:1010933404324",
        lambda seed: RandomForestClassifier(N_TREES, random_state=seed, n_jobs=1),
    ),
    "svm": Baseline(
        "SVM (RBF)", "features", "10.1007/BF00994018",
        lambda seed: make_pipeline(StandardScaler(), DecisionSoftmax(SVC(kernel="rbf", C=1.0, gamma="scale"))),
    ),
    "logistic": Baseline(
        "logistic regression", "features", "10.1111/j.2517-6161.1958.tb00292.x",
        lambda seed: make_pipeline(StandardScaler(), LogisticRegression(max_iter=5000)),
    ),
    "ridge": Baseline("ridge", "features", "10.1080/00401706.1970.10488634", _ridge),
    "minirocket": Baseline("MiniRocket", "minirocket", "10.1145/3447548.3467231", _kernel_ridge),
    "multirocket": Baseline("MultiRocket", "multirocket", "10.1007/s10618-022-00844-1", _kernel_ridge),
    "hydra": Baseline("Hydra", "hydra", "10.1007/s10618-023-00939-3", _counted_ridge),
}  # fmt: skip
"""Every classifier without a network."""
