"""Classifiers for few specimens: few weights, and none that a new machine would upset."""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float, Shaped
from scipy.optimize import minimize
from scipy.special import expit
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler


class SharedWeights(ClassifierMixin, BaseEstimator):
    """Conditional logit: each class has measures of its own, and all classes share the weights.

    The probability of class c is softmax(w · x_c) over the classes, x_c being the measures of class c and w common to
    all of them (McFadden 1974). "The line at its own order stands out" counts the same for each seat of a flaw, so that
    the recordings of one seat help with the others, and no weight can learn one bearing by heart.

    Parameters
    ----------
    strength : inverse strength of the L2 penalty on the weights.
    """

    def __init__(self, strength: float = 1.0) -> None:
        self.strength = strength

    def fit(self, X: Float[np.ndarray, "unit feature"], y: Shaped[np.ndarray, " unit"]) -> "SharedWeights":
        """The estimator, fitted on columns class after class (sorted names), each with the same measures."""
        self.classes_, target, count = np.unique(y, return_inverse=True, return_counts=True)
        measures = X.reshape(len(X), len(self.classes_), -1)
        of_class = np.take_along_axis(measures, target[:, None, None], axis=1)
        unit, other = np.nonzero(np.arange(len(self.classes_)) != target[:, None])
        against = of_class[unit, 0] - measures[unit, other]
        self.scale_ = np.maximum(against.std(axis=0), 1e-12)
        pairs = np.concatenate([against, -against]) / self.scale_
        won = np.repeat([1, 0], len(against))
        weight = np.tile((len(y) / len(self.classes_) / count[target])[unit], 2)
        logistic = LogisticRegression(C=self.strength, fit_intercept=False, max_iter=2000)
        self.weights_ = logistic.fit(pairs, won, sample_weight=weight).coef_[0]
        return self

    def predict_proba(self, X: Float[np.ndarray, "unit feature"]) -> Float[np.ndarray, "unit class"]:
        """Probability of each class."""
        score = X.reshape(len(X), len(self.classes_), -1) / self.scale_ @ self.weights_
        power = np.exp(score - score.max(axis=1, keepdims=True))
        return power / power.sum(axis=1, keepdims=True)

    def predict(self, X: Float[np.ndarray, "unit feature"]) -> Shaped[np.ndarray, " unit"]:
        """Likeliest class."""
        return self.classes_[self.predict_proba(X).argmax(axis=1)]


class GrowingSigns(ClassifierMixin, BaseEstimator):
    """Logistic regression on signs that grow with a fault: no weight is below zero.

    Where one machine of each class is all there is to learn from, most differences between them are the machines'. A
    fault makes its signs grow, so a difference the other way round is none of its own: training may leave a sign out
    but never turn it round. The classes weigh alike.

    Parameters
    ----------
    strength : inverse strength of the L2 penalty on the weights.
    faulty : the class with the fault; there is one other.
    """

    def __init__(self, strength: float = 1.0, faulty: str = "faulty") -> None:
        self.strength = strength
        self.faulty = faulty

    def fit(self, X: Float[np.ndarray, "unit feature"], y: Shaped[np.ndarray, " unit"]) -> "GrowingSigns":
        """The estimator, fitted on columns each of which grows with a fault."""
        self.classes_ = np.unique(y)
        self.mean_, self.scale_ = X.mean(axis=0), np.maximum(X.std(axis=0), 1e-12)
        scaled, side = (X - self.mean_) / self.scale_, np.where(y == self.faulty, 1.0, -1.0)
        share = np.where(side > 0, (side > 0).mean(), (side < 0).mean())

        def loss(weights: np.ndarray) -> tuple[float, np.ndarray]:
            margin = side * (scaled @ weights[:-1] + weights[-1])
            pull = -side * expit(-margin) / (2 * share)
            penalty = 0.5 / self.strength * weights[:-1] @ weights[:-1]
            slope = np.append(pull @ scaled + weights[:-1] / self.strength, pull.sum())
            return float(np.sum(np.logaddexp(0, -margin) / (2 * share)) + penalty), slope

        bounds = [(0.0, None)] * X.shape[1] + [(None, None)]
        self.weights_ = minimize(loss, np.zeros(len(bounds)), jac=True, method="L-BFGS-B", bounds=bounds).x
        return self

    def predict_proba(self, X: Float[np.ndarray, "unit feature"]) -> Float[np.ndarray, "unit class"]:
        """Probability of each class."""
        score = (X - self.mean_) / self.scale_ @ self.weights_[:-1] + self.weights_[-1]
        return np.where(self.classes_[None, :] == self.faulty, expit(score)[:, None], expit(-score)[:, None])

    def predict(self, X: Float[np.ndarray, "unit feature"]) -> Shaped[np.ndarray, " unit"]:
        """Likeliest class."""
        return self.classes_[self.predict_proba(X).argmax(axis=1)]


class Discriminant(LinearDiscriminantAnalysis):
    """Linear discriminant with equal priors: what varies within the classes alike (temperature) is taken off."""

    def fit(self, X: Float[np.ndarray, "unit feature"], y: Shaped[np.ndarray, " unit"]) -> "Discriminant":
        """The estimator, fitted with one prior for all classes."""
        classes = np.unique(y)
        self.priors = np.full(len(classes), 1 / len(classes))
        super().fit(X, y)
        return self


def _logistic(strength: float) -> Any:
    return make_pipeline(StandardScaler(), LogisticRegression(C=strength, class_weight="balanced", max_iter=3000))


def _with_squares() -> Any:
    bent = PolynomialFeatures(2, include_bias=False)
    return make_pipeline(StandardScaler(), bent, StandardScaler(), Discriminant(solver="lsqr", shrinkage=1e-3))


N_TREES = 100
"""Trees of the usual rival."""


def extra_trees(seed: int) -> ExtraTreesClassifier:
    """The usual rival: extremely randomized trees."""
    return ExtraTreesClassifier(N_TREES, random_state=seed, class_weight="balanced", n_jobs=1)


ESTIMATORS: dict[str, Callable[[int], Any]] = {
    "linear discriminant": lambda seed: Discriminant(),
    "shrunk discriminant": lambda seed: make_pipeline(StandardScaler(), Discriminant(solver="lsqr", shrinkage="auto")),
    "curved discriminant": lambda seed: _with_squares(),
    "logistic 0.1": lambda seed: _logistic(0.1),
    "logistic 1": lambda seed: _logistic(1.0),
    "shared weights 0.01": lambda seed: SharedWeights(0.01),
    "shared weights 0.1": lambda seed: SharedWeights(0.1),
    "shared weights 1": lambda seed: SharedWeights(1.0),
    "growing signs 0.1": lambda seed: GrowingSigns(0.1),
    "growing signs 1": lambda seed: GrowingSigns(1.0),
    "extra trees": extra_trees,
}
"""Makers of unfitted classifiers by name, given a seed; the number is the inverse strength of the L2 penalty."""
