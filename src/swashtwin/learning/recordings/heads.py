"""Heads on levels of whole recordings: a linear discriminant and extremely randomized trees, quiet and noisy."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float, Float64, Int

from swashtwin.foundation import derive_seed
from swashtwin.learning.networks.forest import Forest, forest_of
from swashtwin.learning.networks.level_network import discriminant

_TREES = 150
_LEAST_DEVIATION = 0.1
"""Least deviation that a level is divided by [dB]; less is rounding."""
_SOFT = 1e-3
"""Least probability by trees, whose leaves are certain."""


@dataclass(frozen=True, eq=False)
class Head:
    """A discriminant and trees on the same rows."""

    mean: Float64[np.ndarray, " level"]
    deviation: Float64[np.ndarray, " level"]
    weight: Float64[np.ndarray, "class level"]
    bias: Float64[np.ndarray, " class"]
    trees: Mapping[str, np.ndarray]
    """`Forest.tensors`."""

    def __post_init__(self) -> None:
        classes, levels = self.weight.shape
        if self.mean.shape != (levels,) or self.deviation.shape != (levels,) or self.bias.shape != (classes,):
            raise ValueError("a head on whole recordings does not fit itself")
        if self._forest.probability.shape[1] != classes or self._forest.column.max(initial=-1) >= levels:
            raise ValueError("the trees on whole recordings do not fit the classes and levels")

    @cached_property
    def _forest(self) -> Forest:
        return Forest.of_tensors(dict(self.trees))

    def log_probabilities(
        self, values: Float[np.ndarray, "recording level"]
    ) -> tuple[Float64[np.ndarray, "recording class"], Float64[np.ndarray, "recording class"]]:
        """(logarithms of the discriminant's probabilities, of those of the trees)."""
        scores = ((values - self.mean) / self.deviation) @ self.weight.T + self.bias
        scores -= scores.max(axis=1, keepdims=True)
        scores -= np.log(np.exp(scores).sum(axis=1, keepdims=True))
        return scores, np.log(np.maximum(self._forest.predict_proba(values.astype(np.float32)), _SOFT))


@dataclass(frozen=True, eq=False)
class Heads:
    """A head for recordings as they are, one for noisy ones, and trees that tell which a recording is.

    Trained on both at once, changes from a machine's own healthy recordings lost 6 points on clean recordings of new
    pumps (rig fleets 100 and 101 of version 2), trained on clean ones alone 40 points under noise at 5 dB.
    """

    clean: Head
    noisy: Head
    """Trained on recordings as they are and with noise."""
    gate: Head
    """Of the classes clean and noisy; its trees decide."""

    def log_probabilities(
        self, values: Float[np.ndarray, "recording level"]
    ) -> tuple[Float64[np.ndarray, "recording class"], Float64[np.ndarray, "recording class"]]:
        """(logarithms of the discriminants' probabilities, of those of the trees)."""
        noise = self.gate.log_probabilities(values)[1]
        pairs = zip(self.clean.log_probabilities(values), self.noisy.log_probabilities(values), strict=True)
        first, second = (np.logaddexp(noise[:, :1] + clean, noise[:, 1:] + noisy) for clean, noisy in pairs)
        return first, second


def fit_heads(
    values: Float[np.ndarray, "copy recording level"], target: Int[np.ndarray, " recording"], n_classes: int, seed: int
) -> Heads:
    """Heads found from the levels of recordings as they are, and of copies with noise."""
    n_copies, n_recordings = values.shape[:2]
    rows = values.reshape(n_copies * n_recordings, -1)
    is_copy = np.repeat(np.minimum(np.arange(n_copies), 1), n_recordings)
    return Heads(
        clean=_fit_head(values[0], target, n_classes, derive_seed(seed, "clean")),
        noisy=_fit_head(rows, np.tile(target, n_copies), n_classes, derive_seed(seed, "noisy")),
        gate=_fit_head(rows, is_copy, 2, derive_seed(seed, "gate")),
    )


def _fit_head(
    values: Float[np.ndarray, "row level"], target: Int[np.ndarray, " row"], n_classes: int, seed: int
) -> Head:
    from sklearn.ensemble import ExtraTreesClassifier

    values = values.astype(np.float64)
    mean, deviation = values.mean(axis=0), np.maximum(values.std(axis=0), _LEAST_DEVIATION)
    linear = discriminant(((values - mean) / deviation).astype(np.float32), target, n_classes)
    grown: Any = ExtraTreesClassifier(_TREES, class_weight="balanced", random_state=seed % 2**32, n_jobs=1)
    trees = forest_of(grown.fit(values.astype(np.float32), target), n_classes).tensors(np.float32)
    weight, bias = (linear[name].astype(np.float64) for name in ("discriminant", "discriminant.bias"))
    return Head(mean, deviation, weight, bias, trees)
