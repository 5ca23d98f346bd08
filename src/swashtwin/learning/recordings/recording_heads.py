"""Trees that classify whole recordings, clean and noisy ones."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int

from swashtwin.foundation import derive_seed
from swashtwin.learning.networks.tree_network import Forest, forest_of

N_TREES = 150
"""Trees of a forest."""
MIN_PROBABILITY = 1e-3
"""Smallest probability by trees: their leaves are certain, but a new machine is not."""


@dataclass(frozen=True, eq=False)
class Heads:
    """Trees for clean recordings, trees for noisy ones, and a gate that weighs the two.

    All are extremely randomized trees on band powers or their changes.

    Trained on both at once, changes from a machine's own healthy recordings lost 6 points on clean
    recordings of new pumps (rig fleets 100 and 101 of version 2), trained on clean ones alone 40
    points under noise at 5 dB.
    """

    clean: Forest
    noisy: Forest
    """Trained on clean and on noisy recordings."""
    gate: Forest
    """Of the classes clean and noisy."""

    def fit_sizes(self, n_columns: int, n_classes: int) -> bool:
        """Return whether all heads have these classes and columns."""
        return (
            self.clean.fits(n_columns, n_classes)
            and self.noisy.fits(n_columns, n_classes)
            and self.gate.fits(n_columns, 2)
        )

    def log_probabilities(
        self, values: Float[np.ndarray, "recording column"]
    ) -> Float64[np.ndarray, "recording class"]:
        """Return the logarithms of the probabilities, weighted by the gate."""
        rows = values.astype(np.float32)
        gate, clean, noisy = (
            np.log(np.maximum(forest.predict_proba(rows), MIN_PROBABILITY))
            for forest in (self.gate, self.clean, self.noisy)
        )
        return np.logaddexp(gate[:, :1] + clean, gate[:, 1:] + noisy)


def fit_heads(
    values: Float[np.ndarray, "copy recording column"],
    target: Int[np.ndarray, " recording"],
    n_classes: int,
    seed: int,
) -> Heads:
    """Return heads fitted to clean recordings, the first copy, and to their noisy copies."""
    n_copies, n_recordings = values.shape[:2]
    rows = values.reshape(n_copies * n_recordings, -1)
    is_noisy = np.repeat(np.minimum(np.arange(n_copies), 1), n_recordings)
    return Heads(
        clean=_fit_forest(values[0], target, n_classes, derive_seed(seed, "clean")),
        noisy=_fit_forest(rows, np.tile(target, n_copies), n_classes, derive_seed(seed, "noisy")),
        gate=_fit_forest(rows, is_noisy, 2, derive_seed(seed, "gate")),
    )


def _fit_forest(
    values: Float[np.ndarray, "row column"],
    target: Int[np.ndarray, " row"],
    n_classes: int,
    seed: int,
) -> Forest:
    from sklearn import config_context
    from sklearn.tree import ExtraTreeClassifier
    from sklearn.utils.class_weight import compute_sample_weight

    rows = values.astype(np.float32)
    weights = compute_sample_weight("balanced", target)
    states = np.random.RandomState(seed % 2**32).randint(2**31 - 1, size=N_TREES).tolist()

    # The trees of an `ExtraTreesClassifier` one by one, which takes three quarters of its time.
    estimators = []
    with config_context(skip_parameter_validation=True):
        for state in states:
            tree = ExtraTreeClassifier(random_state=state)
            estimators.append(tree.fit(rows, target, weights, check_input=False))
    return forest_of(estimators, estimators[0].classes_, n_classes)
