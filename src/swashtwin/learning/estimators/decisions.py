"""Probabilities of classifiers that only decide."""

from typing import Any

import numpy as np
from jaxtyping import Float, Int
from sklearn.base import BaseEstimator, ClassifierMixin, clone


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
