"""Points between measured windows: SMOTE and ADASYN, on samples or on spectra."""

from dataclasses import dataclass
from importlib import import_module
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from scipy.spatial.distance import cdist

from swashtwin.foundation import DataError, MissingExtraError, derive_seed, stream
from swashtwin.learning import WindowSet
from swashtwin.synthesis import fill_cell, require_count, sources_of
from swashtwin_bench.fillers.log_spectra import log_amplitude, with_amplitude
from swashtwin_bench.fillers.periodic_extension import cut_extensions, extension_length, periodic_extensions

Space = Literal["samples", "spectrum"]
"""Where points are put between windows: their samples, or the logarithm of their amplitude spectra."""


class NoNeighborsError(DataError):
    """There is nothing between which a point could be put."""


@dataclass(frozen=True)
class SMOTE:
    """Points between a window of the cell and its neighbors (Chawla et al. 2002, DOI 10.1613/jair.953).

    On ``"samples"``, as most of the field does: the sum of two windows that begin at different angles of the shaft is
    quieter than either. On ``"spectrum"``, which is our sample of what would be fair: logarithms of the amplitudes are
    interpolated, and each point has the phases of the measured window nearest to it.
    """

    space: Space = "samples"
    """Where the points are put."""
    neighbors: int = 5
    """How many neighbors of a window are looked at; fewer where the cell has no more."""

    def __call__(self, train: WindowSet, *, label: str, pressure: float, count: int, seed: int) -> WindowSet:
        """`count` windows between measured ones of the cell (`Filler`)."""
        return _fill("SMOTE", self.space, self.neighbors, train, label, pressure, count, seed)


@dataclass(frozen=True)
class ADASYN:
    """As `SMOTE`, more where windows of other classes are near (He et al. 2008, DOI 10.1109/IJCNN.2008.4633969).

    Where nothing of another class is among the nearest, the neighborhood is doubled until something is, up to the
    cell's size; ADASYN itself says nothing of that case.
    """

    space: Space = "samples"
    """Where the points are put."""
    neighbors: int = 5
    """How many neighbors of a window are looked at."""

    def __call__(self, train: WindowSet, *, label: str, pressure: float, count: int, seed: int) -> WindowSet:
        """`count` windows between measured ones of the cell (`Filler`)."""
        return _fill("ADASYN", self.space, self.neighbors, train, label, pressure, count, seed)


def oversampler(name: str) -> Any:
    """Class `name` of imbalanced-learn's over-samplers.

    Raises
    ------
    MissingExtraError
        It is not installed.
    """
    try:
        return getattr(import_module("imblearn.over_sampling"), name)
    except ImportError as cause:
        raise MissingExtraError(
            f'{name} needs imbalanced-learn, which is not installed: pip install "swashtwin[rivals]".'
        ) from cause


def _fill(
    name: str, space: Space, neighbors: int, train: WindowSet, label: str, pressure: float, count: int, seed: int
) -> WindowSet:
    require_count(count)
    sources = sources_of(train, label, pressure)
    others = np.flatnonzero(~train.synthetic & (train.label != label))
    if len(sources) < 2:
        raise NoNeighborsError(f"{name} puts points between windows, and of {label} there is one; give it two.")
    others = others if name == "ADASYN" else others[:1]  # SMOTE does not look at them
    considered = np.concatenate([sources, others])
    if space == "samples":
        signals = train.signal[considered]
        flat = signals.reshape(len(signals), -1)
    else:
        signals = periodic_extensions(train, considered, max(extension_length(train, int(i)) for i in sources))
        flat = log_amplitude(signals)
    points = _between(name, flat, len(sources), count, neighbors, derive_seed(seed, name, label))
    nearest = cdist(points, flat[: len(sources)]).argmin(axis=1)
    if space == "samples":
        signal = points.reshape(count, *signals.shape[1:])
    else:
        extensions = with_amplitude(signals[nearest], points)
        signal = cut_extensions(extensions, train, sources[nearest], stream(seed, name, "angle", label))
    filler_name = name.lower() if space == "samples" else f"{name.lower()}_spectrum"
    return fill_cell(signal, sources[nearest], train=train, name=filler_name, label=label, pressure=pressure, seed=seed)


def _between(
    name: str, points: Float[np.ndarray, "window value"], pool: int, count: int, neighbors: int, seed: int
) -> Float[np.ndarray, "synthetic value"]:
    """`count` points between the first `pool` of `points`; the others are of other classes."""
    target = (np.arange(len(points)) < pool).astype(int)
    if len(points) == pool:  # the library wants a second class
        points, target = np.concatenate([points, points[:1]]), np.append(target, 0)
    counts = {1: pool + count + (pool if name == "ADASYN" else 0)}  # ADASYN rounds the share of each window
    neighborhood = min(neighbors, pool - 1)
    while True:
        option = {"k_neighbors": neighborhood} if name == "SMOTE" else {"n_neighbors": neighborhood}
        sampler = oversampler(name)(sampling_strategy=counts, random_state=seed % 2**32, **option)
        try:
            synthetic = sampler.fit_resample(points, target)[0][len(points) :]
            break
        except RuntimeError as cause:  # ADASYN: no window of another class is near
            if neighborhood == pool - 1:
                raise NoNeighborsError(
                    f"{name} finds no window of another class near the {pool} of the cell."
                ) from cause
            neighborhood = min(2 * neighborhood, pool - 1)
    return synthetic[stream(seed, "kept").permutation(len(synthetic))[:count]]
