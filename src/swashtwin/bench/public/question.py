"""What is asked of a public set: units to tell apart, what is known of each, and what must stay apart."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Shaped


@dataclass(frozen=True, eq=False)
class Units:
    """Pieces of recordings that a classifier learns from, with their features."""

    label: Shaped[np.ndarray, " unit"]
    """Class of each."""
    recording: Shaped[np.ndarray, " unit"]
    """Recording each was taken from; it is decided as a whole."""
    group: Shaped[np.ndarray, " unit"]
    """What the honest split keeps apart."""
    inner: Shaped[np.ndarray, " unit"]
    """What settings are chosen by: the like of `group`, kept apart within the training side."""
    features: Mapping[str, Float[np.ndarray, "unit feature"]]
    """Features by name."""

    def __len__(self) -> int:
        return len(self.label)


@dataclass(frozen=True)
class Setting:
    """One way to tell the classes apart."""

    features: str
    """Name of the features."""
    estimator: str
    """Name of the classifier (`ESTIMATORS`)."""

    def __str__(self) -> str:
        return f"{self.features} / {self.estimator}"


@dataclass(frozen=True)
class Fold:
    """Groups on either side."""

    name: str
    """What is tested."""
    train: frozenset[str]
    """Groups to learn from."""
    test: frozenset[str]
    """Groups to be told apart."""

    def sides(self, group: Shaped[np.ndarray, " unit"]) -> tuple[Bool[np.ndarray, " unit"], Bool[np.ndarray, " unit"]]:
        """(training units, test units)."""
        return np.isin(group, sorted(self.train)), np.isin(group, sorted(self.test))


@dataclass(frozen=True, eq=False)
class Question:
    """One honest split of one public set."""

    split: str
    """Its name, such as ``"cwru/size"``."""
    units: Units
    """Units with the features that are meant to carry over."""
    settings: tuple[Setting, ...]
    """What is chosen from, within each training side."""
    folds: tuple[Fold, ...]
    """Every pair of sides."""
    windows: Units
    """Units as they are usually cut, with the usual features, for the extra trees (``"usual"``)."""
