"""Ensembles of decision trees on vibration features, kept as arrays that are read without running
code.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float, Float32, Float64, Int

from swashtwin.foundation import derive_seed
from swashtwin.learning.features import feature_names, feature_values
from swashtwin.learning.networks.solved_network import SolvedNetwork


@dataclass(frozen=True, eq=False)
class Forest:
    """Decision trees whose nodes stand in one row: those of the first tree, then those of the
    second, and so on.
    """

    root: Int[np.ndarray, " tree"]
    """First node of each tree."""
    column: Int[np.ndarray, " node"]
    """Column that a node compares; -1 in a leaf."""
    threshold: Float[np.ndarray, " node"]
    """A row goes left where its value is at most this."""
    left: Int[np.ndarray, " node"]
    """Node on the left; a leaf names itself. The node on the right follows it."""
    probability: Float[np.ndarray, "node class"]
    """Share of each class among the training rows that came to a node, classes weighted alike."""

    def leaves(self, values: Float[np.ndarray, "row column"]) -> Int[np.ndarray, "row tree"]:
        """Leaf to which each row comes in each tree."""
        node = np.repeat(self.root[None], len(values), axis=0)
        rows = np.arange(len(values))[:, None]
        while (inner := (column := self.column[node]) >= 0).any():
            node = self.left[node] + (inner & ~(values[rows, column] <= self.threshold[node]))
        return node

    def predict_proba(
        self, values: Float[np.ndarray, "row column"]
    ) -> Float[np.ndarray, "row class"]:
        """Probability of each class: the mean over the trees."""
        return self.probability[self.leaves(values)].mean(axis=1)

    def tensors(self, share: type = np.float16) -> dict[str, np.ndarray]:
        """Its arrays by name, as narrow as they may be; the shares of classes in a leaf as numbers
        of type `share`.
        """
        narrow = {"root": np.int32, "column": np.int16, "threshold": np.float32, "left": np.int32}
        arrays = {name: getattr(self, name).astype(kind) for name, kind in narrow.items()}
        return {**arrays, "leaf_probability": self.probability[self.column < 0].astype(share)}

    @classmethod
    def of_tensors(cls, tensors: dict[str, np.ndarray]) -> "Forest":
        """The forest whose `tensors` these are; a `ValueError` where they contradict each other."""
        root, column, left = (tensors[name].astype(np.int64) for name in ("root", "column", "left"))
        threshold = tensors["threshold"].astype(np.float64)
        of_leaves = tensors["leaf_probability"].astype(np.float64)
        nodes, leaf = np.arange(column.size), column < 0
        fits = (
            column.ndim == 1
            and column.shape == threshold.shape == left.shape
            and of_leaves.shape[0] == leaf.sum()
        )
        if not fits or root.size == 0 or not ((root >= 0) & (root < column.size)).all():
            raise ValueError("its trees have not one entry for each node")
        if (left[leaf] != nodes[leaf]).any() or (left[~leaf] <= nodes[~leaf]).any():
            raise ValueError("a node of its trees leads back")
        if (left[~leaf] + 1 >= column.size).any():
            raise ValueError("a node of its trees leads out of them")
        probability = np.full((column.size, of_leaves.shape[1]), 1 / of_leaves.shape[1])
        probability[leaf] = of_leaves / of_leaves.sum(axis=1, keepdims=True)
        return cls(root, column, threshold, left, probability)


def forest_of(grown: Sequence[Any], classes: Int[np.ndarray, " class"], n_classes: int) -> Forest:
    """The forest of trees that scikit-learn grew, whose classes are some of the numbers below
    `n_classes`.
    """
    parts: list[tuple[np.ndarray, ...]] = []
    roots, first = [], 0
    for tree in (estimator.tree_ for estimator in grown):
        parts.append(_in_pairs(tree, first))
        roots.append(first)
        first += tree.node_count
    column, threshold, left, probability = (
        np.concatenate(part) for part in zip(*parts, strict=True)
    )
    of_all = np.zeros((len(probability), n_classes))
    of_all[:, classes] = probability
    return Forest(
        np.array(roots), column.astype(np.int64), threshold, left.astype(np.int64), of_all
    )


def _in_pairs(tree: Any, first: int) -> tuple[np.ndarray, ...]:
    """Arrays of a tree of scikit-learn, renumbered so that the right child of a node follows its
    left one.
    """
    left, right = tree.children_left, tree.children_right
    order, queue = [0], [0]
    for node in queue:
        if left[node] >= 0:
            order += [left[node], right[node]]
            queue += [left[node], right[node]]
    position = np.empty(len(order), dtype=np.int64)
    position[order] = np.arange(len(order))
    leaf = left[order] < 0
    threshold = tree.threshold[order].astype(
        np.float32
    )  # rows in single precision compare with the next one below it
    threshold = np.where(
        threshold > tree.threshold[order], np.nextafter(threshold, np.float32(-np.inf)), threshold
    )
    probability = tree.value[order, 0]
    return (
        np.where(leaf, -1, tree.feature[order]),
        np.where(leaf, 0.0, threshold),
        first + np.where(leaf, np.arange(len(order)), position[left[order]]),
        probability / probability.sum(axis=1, keepdims=True),
    )


class ExtraTrees(SolvedNetwork):
    """Extremely randomized trees (Geurts, Ernst and Wehenkel 2006, DOI 10.1007/s10994-006-6226-1)
    on `feature_values`.

    Trees need no scaling, no selection and hardly a setting: compare a network with them first.
    scikit-learn grows them; they are kept as arrays (`Forest`), so that neither a file nor an
    answer needs it.

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

    def represent_at(
        self,
        windows: Float32[np.ndarray, "window channel time"],
        turns: Float[np.ndarray, " window"],
    ) -> Float32[np.ndarray, "window feature"]:
        """`feature_values`; the speed is not looked at."""
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
        grown: Any = getattr(sklearn.ensemble, self.estimator)(
            self.settings["trees"], random_state=state, n_jobs=1
        )
        grown.fit(values, target)
        self.loaded(
            forest_of(grown.estimators_, grown.classes_, self.n_classes).tensors(np.float32)
        )

    def loaded(self, weights: Mapping[str, np.ndarray]) -> "ExtraTrees":
        """These trees with the nodes of saved ones; a `ValueError` where those contradict each
        other.
        """
        forest = Forest.of_tensors(dict(weights))
        n_columns = len(feature_names([""] * self.n_channels))
        if (
            forest.probability.shape[1] != self.n_classes
            or forest.column.max(initial=-1) >= n_columns
        ):
            raise ValueError("its trees do not fit the classes and channels")
        self.weights, self.forest = dict(weights), forest
        return self

    def scores(
        self, values: Float32[np.ndarray, "window feature"]
    ) -> Float64[np.ndarray, "window class"]:
        """Logarithm of the mean over the trees of the share of each class in the leaf that a window
        comes to.
        """
        assert self.forest is not None
        return np.log(np.maximum(self.forest.predict_proba(values), 1e-300))


class RandomForest(ExtraTrees):
    """Random forest (Breiman 2001, DOI 10.1023/A:1010933404324) on `feature_values`."""

    name: ClassVar[str] = "random_forest"
    estimator: ClassVar[str] = "RandomForestClassifier"
