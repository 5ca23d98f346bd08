"""Points between measured windows: SMOTE and ADASYN."""

from dataclasses import dataclass

import numpy as np
from imblearn import over_sampling
from jaxtyping import Float
from scipy.spatial.distance import cdist

from swashtwin.foundation import DataError, derive_seed, random_stream
from swashtwin.learning import WindowSet
from swashtwin.synthesis import require_count
from swashtwin_bench.fillers.filler import fill_cell, find_sources


class NoNeighborsError(DataError):
    """There is nothing between which a point could be put."""


@dataclass(frozen=True)
class SMOTE:
    """Points between a window of the cell and its neighbors (Chawla et al. 2002, DOI
    10.1613/jair.953).

    They are put between samples, as most of the field does: the sum of two windows that begin at
    different angles of the shaft is quieter than either.
    """

    neighbors: int = 5
    """How many neighbors of a window are looked at; fewer where the cell has no more."""

    def __call__(
        self, train: WindowSet, *, label: str, pressure: float, count: int, seed: int
    ) -> WindowSet:
        """`count` windows between measured ones of the cell (`Filler`)."""
        return _fill("SMOTE", self.neighbors, train, label, pressure, count, seed)


@dataclass(frozen=True)
class ADASYN:
    """As `SMOTE`, more where windows of other classes are near (He et al. 2008, DOI
    10.1109/IJCNN.2008.4633969).

    Where nothing of another class is among the nearest, the neighborhood is doubled until something
    is, up to the cell's size; ADASYN itself says nothing of that case.
    """

    neighbors: int = 5
    """How many neighbors of a window are looked at."""

    def __call__(
        self, train: WindowSet, *, label: str, pressure: float, count: int, seed: int
    ) -> WindowSet:
        """`count` windows between measured ones of the cell (`Filler`)."""
        return _fill("ADASYN", self.neighbors, train, label, pressure, count, seed)


def _fill(
    name: str, neighbors: int, train: WindowSet, label: str, pressure: float, count: int, seed: int
) -> WindowSet:
    require_count(count)
    sources = find_sources(train, label, pressure)
    others = np.flatnonzero(~train.synthetic & (train.label != label))
    if len(sources) < 2:
        raise NoNeighborsError(
            f"{name} puts points between windows, and of {label} there is one; give it two."
        )
    others = others if name == "ADASYN" else others[:1]  # SMOTE does not look at them
    considered = np.concatenate([sources, others])
    flat = train.signal[considered].reshape(len(considered), -1)
    points = _between(name, flat, len(sources), count, neighbors, derive_seed(seed, name, label))
    nearest = cdist(points, flat[: len(sources)]).argmin(axis=1)
    signal = points.reshape(count, *train.signal.shape[1:])
    return fill_cell(
        signal,
        sources[nearest],
        train=train,
        name=name.lower(),
        label=label,
        pressure=pressure,
        seed=seed,
    )


def _between(
    name: str,
    points: Float[np.ndarray, "window value"],
    pool: int,
    count: int,
    neighbors: int,
    seed: int,
) -> Float[np.ndarray, "synthetic value"]:
    """`count` points between the first `pool` of `points`; the others are of other classes."""
    target = (np.arange(len(points)) < pool).astype(int)
    if len(points) == pool:  # the library wants a second class
        points, target = np.concatenate([points, points[:1]]), np.append(target, 0)
    counts = {
        1: pool + count + (pool if name == "ADASYN" else 0)
    }  # ADASYN rounds the share of each window
    neighborhood = min(neighbors, pool - 1)
    while True:
        option = {"k_neighbors": neighborhood} if name == "SMOTE" else {"n_neighbors": neighborhood}
        sampler = getattr(over_sampling, name)(
            sampling_strategy=counts, random_state=seed % 2**32, **option
        )
        try:
            synthetic = sampler.fit_resample(points, target)[0][len(points) :]
            break
        except RuntimeError as cause:  # ADASYN: no window of another class is near
            if neighborhood == pool - 1:
                raise NoNeighborsError(
                    f"{name} finds no window of another class near the {pool} of the cell."
                ) from cause
            neighborhood = min(2 * neighborhood, pool - 1)
    return synthetic[random_stream(seed, "kept").permutation(len(synthetic))[:count]]
