"""Interpolation between measured windows: SMOTE and ADASYN."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from imblearn import over_sampling
from jaxtyping import Float
from scipy.spatial.distance import cdist

from swashtwin.foundation import DataError, derive_seed, random_stream
from swashtwin.learning import WindowSet
from swashtwin.synthesis import require_count
from swashtwin_bench.fillers.filler import fill_cell, find_sources


class NoNeighborsError(DataError):
    """There are no windows to interpolate between."""


@dataclass(frozen=True)
class SMOTE:
    """Interpolation between a window of the cell and its neighbors (Chawla et al. 2002).

    DOI 10.1613/jair.953. It interpolates between samples, as most of the field does: the mean of
    two windows that begin at different shaft angles has less power than either.
    """

    neighbors: int = 5
    """Number of neighbors of a window; fewer if the cell is smaller."""

    def __call__(
        self, train: WindowSet, *, label: str, pressure: float, count: int, seed: int
    ) -> WindowSet:
        """Return `count` windows between measured windows of the cell (`Filler`)."""
        return _fill("SMOTE", self.neighbors, train, label, pressure, count, seed)


@dataclass(frozen=True)
class ADASYN:
    """`SMOTE` with more windows near those of other classes (He et al. 2008).

    DOI 10.1109/IJCNN.2008.4633969. If no window of another class is among the neighbors, the
    neighborhood is doubled until one is, up to the size of the cell; ADASYN does not define this
    case.
    """

    neighbors: int = 5
    """Number of neighbors of a window."""

    def __call__(
        self, train: WindowSet, *, label: str, pressure: float, count: int, seed: int
    ) -> WindowSet:
        """Return `count` windows between measured windows of the cell (`Filler`)."""
        return _fill("ADASYN", self.neighbors, train, label, pressure, count, seed)


def _fill(
    name: str, neighbors: int, train: WindowSet, label: str, pressure: float, count: int, seed: int
) -> WindowSet:
    require_count(count)
    sources = find_sources(train, label, pressure)
    if len(sources) < 2:
        raise NoNeighborsError(
            f"{name} interpolates between windows, and of {label} there is one: it needs two."
        )

    rivals = np.flatnonzero(~train.synthetic & (train.label != label))
    if name == "SMOTE":
        rivals = rivals[:1]  # SMOTE ignores them; the library needs a second class
    candidates = np.concatenate([sources, rivals])
    points = train.signal[candidates].reshape(len(candidates), -1)
    synthetic = _interpolate(
        name, points, len(sources), count, neighbors, derive_seed(seed, name, label)
    )

    # The nearest measured window provides the facts of a synthetic one.
    nearest = cdist(synthetic, points[: len(sources)]).argmin(axis=1)
    return fill_cell(
        synthetic.reshape(count, *train.signal.shape[1:]),
        sources[nearest],
        train=train,
        name=name.lower(),
        label=label,
        pressure=pressure,
        seed=seed,
    )


def _interpolate(
    name: str,
    points: Float[np.ndarray, "window value"],
    n_sources: int,
    count: int,
    neighbors: int,
    seed: int,
) -> Float[np.ndarray, "synthetic value"]:
    """Return `count` points between the first `n_sources` of `points`.

    The other points are of other classes.
    """
    target = (np.arange(len(points)) < n_sources).astype(int)
    if len(points) == n_sources:  # the library needs a second class
        points = np.concatenate([points, points[:1]])
        target = np.append(target, 0)

    n_total = n_sources + count
    if name == "ADASYN":
        # It rounds the share of each window, and so may make fewer; the surplus is dropped below.
        n_total += n_sources

    n_neighbors = min(neighbors, n_sources - 1)
    while True:
        sampler = _build_sampler(name, n_neighbors, n_total, seed)
        try:
            resampled = sampler.fit_resample(points, target)[0]
            break
        except RuntimeError as cause:  # ADASYN: no window of another class is a neighbor
            if n_neighbors == n_sources - 1:
                raise NoNeighborsError(
                    f"{name} finds no window of another class near the {n_sources} of the cell."
                ) from cause
            n_neighbors = min(2 * n_neighbors, n_sources - 1)

    synthetic = resampled[len(points) :]
    return synthetic[random_stream(seed, "kept").permutation(len(synthetic))[:count]]


def _build_sampler(name: str, n_neighbors: int, n_total: int, seed: int) -> Any:
    common = {"sampling_strategy": {1: n_total}, "random_state": seed % 2**32}
    if name == "SMOTE":
        return over_sampling.SMOTE(k_neighbors=n_neighbors, **common)
    return over_sampling.ADASYN(n_neighbors=n_neighbors, **common)
