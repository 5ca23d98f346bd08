"""Ensembles of decision trees on vibration features."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float, Float32, Float64, Int

from swashtwin.foundation import derive_seed
from swashtwin.learning.features import feature_values
from swashtwin.learning.networks.forest import Forest, forest_of
from swashtwin.learning.networks.solved_network import SolvedNetwork


class ExtraTrees(SolvedNetwork):
    """Extremely randomized trees (Geurts, Ernst and Wehenkel 2006, DOI 10.1007/s10994-006-6226-1) on `feature_values`.

    Trees need no scaling, no selection and hardly a setting: compare a network with them first. scikit-learn grows
    them; they are kept as arrays (`Forest`), so that neither a file nor an answer needs it.

    Parameters
    ----------
    n_channels : channels of a window.
    n_classes : classes told apart.
    trees : number of trees.

    Examples
    --------
    >>> ExtraTrees(1, 2).represent_at(np.zeros((3, 1, 256), dtype=np.float32), np.zeros(3)).shape
    (3, 82)
    """

    name: ClassVar[str] = "extra_trees"
    estimator: ClassVar[str] = "ExtraTreesClassifier"
    """Class of `sklearn.ensemble` that grows them."""

    def __init__(self, n_channels: int, n_classes: int, *, trees: int = 300) -> None:
        super().__init__(n_channels=n_channels, n_classes=n_classes, trees=trees)
        self.forest: Forest | None = None
        """The trees; None before they are grown."""

    def represent_at(
        self, windows: Float32[np.ndarray, "window channel time"], turns: Float[np.ndarray, " window"]
    ) -> Float32[np.ndarray, "window feature"]:
        """`feature_values`; the speed is not looked at."""
        with np.errstate(over="ignore", invalid="ignore"):
            return feature_values(windows).astype(np.float32)

    def solve(
        self, values: Float32[np.ndarray, "window feature"], target: Int[np.ndarray, " window"], seed: int
    ) -> None:
        """Grow the trees."""
        import sklearn.ensemble

        state = derive_seed(seed, self.name.replace("_", " ")) % 2**32
        grown: Any = getattr(sklearn.ensemble, self.estimator)(self.settings["trees"], random_state=state, n_jobs=1)
        self.loaded(forest_of(grown.fit(values, target), self.n_classes).tensors(np.float32))

    def loaded(self, weights: Mapping[str, np.ndarray]) -> "ExtraTrees":
        """These trees with the nodes of saved ones; a `ValueError` where those contradict each other."""
        forest = Forest.of_tensors(dict(weights))
        columns, n_columns = (
            int(forest.column.max(initial=-1)),
            self.represent_at(np.zeros((1, self.n_channels, 16), dtype=np.float32), np.zeros(1)).shape[1],
        )
        if forest.probability.shape[1] != self.n_classes or columns >= n_columns:
            raise ValueError("its trees do not fit the classes and channels")
        self.weights, self.forest = dict(weights), forest
        return self

    def scores(self, values: Float32[np.ndarray, "window feature"]) -> Float64[np.ndarray, "window class"]:
        """Logarithm of the mean over the trees of the share of each class in the leaf that a window comes to."""
        assert self.forest is not None
        return np.log(np.maximum(self.forest.predict_proba(values), 1e-300))


class RandomForest(ExtraTrees):
    """Random forest (Breiman 2001, DOI 10.1023/A:1010933404324) on `feature_values`.

    Parameters
    ----------
    n_channels : channels of a window.
    n_classes : classes told apart.
    trees : number of trees.
    """

    name: ClassVar[str] = "random_forest"
    estimator: ClassVar[str] = "RandomForestClassifier"
