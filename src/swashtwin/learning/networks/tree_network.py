"""Ensembles of decision trees on vibration features, kept as plain arrays.

Arrays can be read from a file without running code, which a pickle cannot.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float, Float32, Float64, Int, Int16, Int32

from swashtwin.foundation import derive_seed
from swashtwin.learning.features import feature_names, feature_values
from swashtwin.learning.networks.solved_network import SolvedNetwork


@dataclass(frozen=True, eq=False)
class Forest:
    """Decision trees whose nodes stand in one list, tree after tree.

    Raises
    ------
    ValueError
        The arrays contradict each other, as in a damaged file.
    """

    root: Int32[np.ndarray, " tree"]
    """First node of each tree."""
    column: Int16[np.ndarray, " node"]
    """Column that a node compares; -1 in a leaf."""
    threshold: Float32[np.ndarray, " node"]
    """A row goes left if its value is at most this."""
    left: Int32[np.ndarray, " node"]
    """Node on the left; a leaf names itself. The node on the right follows it."""
    leaf_probability: Float32[np.ndarray, "leaf class"]
    """Share of each class among the training rows in a leaf, classes weighted alike."""

    def __post_init__(self) -> None:
        if [getattr(self, field.name).dtype.kind for field in fields(self)] != [*"iifif"]:
            raise ValueError("its trees have values of another type")
        nodes = np.arange(self.column.size)
        is_leaf = self.column < 0
        has_consistent_sizes = (
            self.column.ndim == 1
            and self.column.shape == self.threshold.shape == self.left.shape
            and self.leaf_probability.shape[:1] == (is_leaf.sum(),)
            and self.leaf_probability.ndim == 2
        )
        if (
            not has_consistent_sizes
            or self.root.size == 0
            or not ((self.root >= 0) & (self.root < nodes.size)).all()
        ):
            raise ValueError("its trees do not have one entry for each node")

        # Without these two, walking down a tree of a damaged file would never end, or leave it.
        left_of_inner = self.left[~is_leaf]
        if (self.left[is_leaf] != nodes[is_leaf]).any() or (left_of_inner <= nodes[~is_leaf]).any():
            raise ValueError("a node of its trees leads back")
        if (left_of_inner >= nodes.size - 1).any():
            raise ValueError("a node of its trees leads out of them")

    @cached_property
    def probability(self) -> Float64[np.ndarray, "node class"]:
        """Share of each class in a node, summing to 1; only those of leaves count."""
        shares = self.leaf_probability.astype(np.float64)
        probability = np.full((self.column.size, self.n_classes), 1 / self.n_classes)
        probability[self.column < 0] = shares / shares.sum(axis=1, keepdims=True)
        return probability

    @property
    def n_classes(self) -> int:
        """Number of classes."""
        return self.leaf_probability.shape[1]

    def fits(self, n_columns: int, n_classes: int) -> bool:
        """Return whether it has these classes and compares only these columns."""
        return self.n_classes == n_classes and int(self.column.max(initial=-1)) < n_columns

    def leaves(self, values: Float[np.ndarray, "row column"]) -> Int[np.ndarray, "row tree"]:
        """Return the leaf that each row reaches in each tree."""
        node = np.repeat(self.root[None], len(values), axis=0)
        rows = np.arange(len(values))[:, None]
        while True:
            column = self.column[node]
            is_inner = column >= 0
            if not is_inner.any():
                return node
            goes_right = is_inner & ~(values[rows, column] <= self.threshold[node])
            node = self.left[node] + goes_right

    def predict_proba(
        self, values: Float[np.ndarray, "row column"]
    ) -> Float[np.ndarray, "row class"]:
        """Return the probability of each class: the mean over the trees."""
        return self.probability[self.leaves(values)].mean(axis=1)


def forest_of(
    estimators: Sequence[Any], classes: Int[np.ndarray, " class"], n_classes: int
) -> Forest:
    """Return the forest of trees that scikit-learn grew.

    Parameters
    ----------
    classes : classes of the trees, some of the numbers below `n_classes`.
    """
    parts: list[tuple[np.ndarray, ...]] = []
    roots = []
    n_nodes = 0
    for estimator in estimators:
        parts.append(_pair_children(estimator.tree_, n_nodes))
        roots.append(n_nodes)
        n_nodes += estimator.tree_.node_count
    column, threshold, left, shares = (np.concatenate(part) for part in zip(*parts, strict=True))

    leaf_shares = shares[column < 0]
    leaf_probability = np.zeros((len(leaf_shares), n_classes), dtype=np.float32)
    leaf_probability[:, classes] = leaf_shares
    return Forest(
        root=np.array(roots, dtype=np.int32),
        column=column.astype(np.int16),
        threshold=threshold.astype(np.float32),
        left=left.astype(np.int32),
        leaf_probability=leaf_probability,
    )


def _pair_children(tree: Any, first: int) -> tuple[np.ndarray, ...]:
    """Return column, threshold, left child and shares of the nodes of a tree of scikit-learn.

    The nodes are renumbered from `first` on, so that the right child follows the left one.
    """
    left = tree.children_left
    right = tree.children_right
    order = [0]
    for node in order:  # grows while it is read: breadth first
        if left[node] >= 0:
            order += [left[node], right[node]]
    position = np.empty(len(order), dtype=np.int64)
    position[order] = np.arange(len(order))
    is_leaf = left[order] < 0

    # Rows of single precision are compared: the next such number at or below the threshold parts
    # them the same way.
    exact = tree.threshold[order]
    threshold = exact.astype(np.float32)
    below = np.nextafter(threshold, np.float32(-np.inf))
    threshold = np.where(threshold > exact, below, threshold)

    shares = tree.value[order, 0]
    return (
        np.where(is_leaf, -1, tree.feature[order]),
        np.where(is_leaf, 0.0, threshold),
        first + np.where(is_leaf, np.arange(len(order)), position[left[order]]),
        shares / shares.sum(axis=1, keepdims=True),
    )


class ExtraTrees(SolvedNetwork):
    """Extremely randomized trees on `feature_values`.

    Geurts, Ernst and Wehenkel 2006, DOI 10.1007/s10994-006-6226-1. Trees need no scaling, no
    selection and hardly a setting: compare a network with them first. scikit-learn grows them; they
    are kept as arrays (`Forest`), so that neither a file nor an answer needs it.

    Parameters
    ----------
    n_channels : channels of a window.
    n_classes : number of classes.
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

    def represent_at(
        self,
        windows: Float32[np.ndarray, "window channel time"],
        turns: Float[np.ndarray, " window"],
    ) -> Float32[np.ndarray, "window feature"]:
        """Return `feature_values`; the speed is not used."""
        with np.errstate(over="ignore", invalid="ignore"):
            return feature_values(windows).astype(np.float32)

    def solve(
        self,
        values: Float32[np.ndarray, "window feature"],
        target: Int[np.ndarray, " window"],
        seed: int,
    ) -> None:
        """Grow the trees."""
        import sklearn.ensemble

        state = derive_seed(seed, self.name.replace("_", " ")) % 2**32
        ensemble_class: Any = getattr(sklearn.ensemble, self.estimator)
        ensemble = ensemble_class(self.settings["trees"], random_state=state, n_jobs=1)
        ensemble.fit(values, target)
        forest = forest_of(ensemble.estimators_, ensemble.classes_, self.n_classes)
        self.loaded({field.name: getattr(forest, field.name) for field in fields(forest)})

    def loaded(self, weights: Mapping[str, np.ndarray]) -> "ExtraTrees":
        """Return these trees with saved nodes; raise a `ValueError` if they are contradictory."""
        forest = Forest(**weights)
        n_columns = len(feature_names([""] * self.n_channels))
        if not forest.fits(n_columns, self.n_classes):
            raise ValueError("its trees do not fit the classes and channels")
        self.weights = dict(weights)
        self.forest = forest
        return self

    def scores(
        self, values: Float32[np.ndarray, "window feature"]
    ) -> Float64[np.ndarray, "window class"]:
        """Return the logarithm of the mean share of each class in the leaves of a window."""
        assert self.forest is not None
        return np.log(np.maximum(self.forest.predict_proba(values), 1e-300))


class RandomForest(ExtraTrees):
    """Random forest (Breiman 2001, DOI 10.1023/A:1010933404324) on `feature_values`."""

    name: ClassVar[str] = "random_forest"
    estimator: ClassVar[str] = "RandomForestClassifier"
