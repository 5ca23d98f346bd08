"""Classifiers of scikit-learn on vibration features, as networks that are solved, not trained."""

from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float, Float32, Float64, Int
from scipy.special import log_softmax
from sklearn.linear_model import LogisticRegression, RidgeClassifierCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC

from swashtwin.learning import SolvedNetwork, TrainingSettings, feature_values, register_network

UNSCALED = TrainingSettings(epochs=1, normalization="none")
"""Training on features: they need no scaling of the windows, and no epochs."""


class OnFeatures(SolvedNetwork):
    """A classifier on standardized `feature_values`; it cannot be saved.

    The logarithm of a probability is the log-softmax of the decision values; for two classes, of
    (-d, d). These probabilities are not calibrated before `learn_confidence`. No setting was
    selected by a score of this package.
    """

    estimator: ClassVar[Any]
    """The unfitted classifier."""

    def __init__(self, n_channels: int, n_classes: int) -> None:
        super().__init__(n_channels=n_channels, n_classes=n_classes)
        self._fitted: Any = None

    def represent_at(
        self,
        windows: Float32[np.ndarray, "window channel time"],
        turns: Float[np.ndarray, " window"],
    ) -> Float32[np.ndarray, "window feature"]:
        """Return `feature_values`, which do not depend on the speed."""
        return feature_values(windows).astype(np.float32)

    def solve(
        self,
        values: Float32[np.ndarray, "window feature"],
        target: Int[np.ndarray, " window"],
        seed: int,
    ) -> None:
        """Fit the classifier."""
        pipeline = make_pipeline(StandardScaler(), self.estimator)
        self._fitted = pipeline.fit(values.astype(np.float64), target)

    def scores(
        self, values: Float32[np.ndarray, "window feature"]
    ) -> Float64[np.ndarray, "window class"]:
        """Return the logarithm of the probability of each class."""
        decision = self._fitted.decision_function(values.astype(np.float64))
        if decision.ndim == 1:
            decision = np.stack([-decision, decision], axis=1)
        return np.asarray(log_softmax(decision, axis=1))


class SupportVectors(OnFeatures):
    """Support vector machine with a Gaussian kernel (Cortes and Vapnik 1995).

    DOI 10.1007/BF00994018.
    """

    name: ClassVar[str] = "svm"
    estimator: ClassVar[Any] = SVC(kernel="rbf", C=1.0, gamma="scale")


class Logistic(OnFeatures):
    """Logistic regression (Cox 1958, DOI 10.1111/j.2517-6161.1958.tb00292.x)."""

    name: ClassVar[str] = "logistic"
    estimator: ClassVar[Any] = LogisticRegression(max_iter=5000)


class Ridge(OnFeatures):
    """Ridge classifier, penalty by cross-validation (Hoerl and Kennard 1970).

    DOI 10.1080/00401706.1970.10488634.
    """

    name: ClassVar[str] = "ridge"
    estimator: ClassVar[Any] = RidgeClassifierCV(alphas=np.logspace(-3, 3, 10))


BASELINES: tuple[type[OnFeatures], ...] = (SupportVectors, Logistic, Ridge)
"""All classifiers of this module."""

ON_FEATURES = ("extra_trees", "random_forest", *(baseline.name for baseline in BASELINES))
"""Names of all networks that use features instead of windows."""

for _baseline in BASELINES:
    register_network(_baseline.name, _baseline)
