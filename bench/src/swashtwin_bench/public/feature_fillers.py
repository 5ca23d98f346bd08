"""Filling a scarce cell from data alone: copies, shaken copies, and points between neighbors."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from swashtwin.foundation import derive_seed, stream
from swashtwin.learning import WindowSet, extract_features
from swashtwin_bench.fillers.interpolation import NoNeighborsError, oversampler

_SHAKE = 0.05
"""Noise of a shaken copy over its window's standard deviation."""
_NEIGHBORS = 5
"""Neighbors that SMOTE and ADASYN look at."""
_GAIN = 0.1
"""Spread of a shaken copy's gain."""

FeatureFiller = Callable[
    [WindowSet, Float[np.ndarray, "window feature"], Bool[np.ndarray, " window"], int, int], np.ndarray
]
"""Features of new windows, from (windows, their features, which to draw from, how many, seed)."""


def _copies(windows: WindowSet, features: np.ndarray, pool: np.ndarray, count: int, seed: int) -> np.ndarray:
    return features[stream(seed, "copies").choice(np.flatnonzero(pool), count)]


def _shaken(windows: WindowSet, features: np.ndarray, pool: np.ndarray, count: int, seed: int) -> np.ndarray:
    random = stream(seed, "shaken")
    source = windows.subset(random.choice(np.flatnonzero(pool), count))
    signal = source.signal.astype(np.float64)
    noise = _SHAKE * signal.std(axis=2, keepdims=True) * random.standard_normal(signal.shape)
    gain = 1 + _GAIN * random.standard_normal((count, 1, 1))
    shaken = (gain * (signal + noise)).astype(source.signal.dtype)
    return extract_features(replace(source, signal=shaken)).values


def _between(name: str) -> FeatureFiller:
    """A sampler of imbalanced-learn, between windows of the pool; it raises `NoNeighborsError` where it cannot."""

    def fill(windows: WindowSet, features: np.ndarray, pool: np.ndarray, count: int, seed: int) -> np.ndarray:
        sampler = oversampler(name)
        counts = {1: int(pool.sum()) + count}
        scale = np.maximum(features.std(axis=0), 1e-12)
        fitted_sampler = sampler(sampling_strategy=counts, random_state=derive_seed(seed, name) % 2**32)
        if pool.sum() <= _NEIGHBORS:
            raise NoNeighborsError(f"{pool.sum()} windows; {name} looks at {_NEIGHBORS} neighbors of each.")
        try:
            resampled, _ = fitted_sampler.fit_resample(features / scale, pool.astype(int))
        except (ValueError, RuntimeError) as cause:
            if name != "ADASYN":
                raise
            raise NoNeighborsError("ADASYN finds no window of another class near the pool.") from cause
        return resampled[len(features) :] * scale

    return fill


FEATURE_FILLERS: dict[str, FeatureFiller | None] = {
    "nothing": None,
    "copies": _copies,
    "shaken copies": _shaken,
    "SMOTE": _between("SMOTE"),
    "ADASYN": _between("ADASYN"),
}
"""Ways to fill, by name. SMOTE (DOI 10.1613/jair.953) and ADASYN (DOI 10.1109/IJCNN.2008.4633969) work on features."""
