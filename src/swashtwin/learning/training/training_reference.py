"""The recordings a classifier was trained on, by their vibration features: what a new one is compared with."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Float64

from swashtwin.learning.features import extract_features
from swashtwin.learning.windows.window_set import WindowSet

MOST = 2000
"""Recordings that a classifier keeps; of more, as many are kept, evenly spaced in the order of their ids."""

_LEAST_VARIANCE = 1e-6
"""Added to each feature's shrunk variance, for classes of one recording have none."""


@dataclass(frozen=True, eq=False)
class KnownRecordings:
    """One row of mean features for each measured recording of the training; no reading is kept."""

    recording_id: tuple[str, ...]
    """The recordings, in the order of their ids."""
    label: tuple[str, ...]
    """Class of each."""
    features: Float64[np.ndarray, "recording feature"]
    """Mean of each feature over the windows of the recording."""

    def distances(self, features: Float[np.ndarray, " feature"]) -> Float64[np.ndarray, " recording"]:
        """Distance of each known recording from one of these mean features, 0 where they are the same.

        Root mean square over the features, each in units of its standard deviation between the known recordings; a
        feature that does not differ between them counts in its own unit.
        """
        deviation = self.features.std(axis=0)
        apart = (self.features - features) / np.where(deviation > 0, deviation, 1.0)
        return np.asarray(np.sqrt(np.mean(apart**2, axis=1)), dtype=np.float64)

    def strangeness(self, features: Float[np.ndarray, " feature"]) -> float:
        """How unlike every known class these mean features are: a relative Mahalanobis distance, for each feature.

        The squared Mahalanobis distance from the nearest class mean, in the covariance within the classes, less that
        from the mean of all, in the covariance of all (Ren and others 2021, arXiv:2106.09022), so that what varies
        between all recordings anyhow counts for little. Covariances are shrunk (Ledoit and Wolf 2004), for there are
        more features than recordings. It may be negative; only its order means anything. Of a single class it is the
        plain distance.
        """
        space = self._space
        known = (features - space.mean) / space.deviation
        apart = known - space.centers
        own = np.einsum("cf,fg,cg->c", apart, space.within, apart).min()
        return float(own - known @ space.overall @ known) / known.size

    @cached_property
    def _space(self) -> "_Space":
        from sklearn.covariance import LedoitWolf

        def precision(rows: np.ndarray) -> np.ndarray:
            shrunk = LedoitWolf().fit(rows).covariance_
            return np.asarray(np.linalg.inv(shrunk + _LEAST_VARIANCE * np.eye(len(shrunk))))

        deviation = self.features.std(axis=0)
        deviation = np.where(deviation > 0, deviation, 1.0)
        mean = self.features.mean(axis=0)
        known = (self.features - mean) / deviation
        names, place = np.unique(self.label, return_inverse=True)
        centers = np.stack([known[place == index].mean(axis=0) for index in range(len(names))])
        overall = precision(known) if len(names) > 1 else np.zeros((known.shape[1],) * 2)
        return _Space(mean, deviation, centers, precision(known - centers[place]), overall)


@dataclass(frozen=True, eq=False)
class _Space:
    """Means and inverse covariances of known recordings, in standard deviations."""

    mean: Float64[np.ndarray, " feature"]
    deviation: Float64[np.ndarray, " feature"]
    centers: Float64[np.ndarray, "class feature"]
    within: Float64[np.ndarray, "feature feature"]
    overall: Float64[np.ndarray, "feature feature"]


def known_recordings(windows: WindowSet) -> KnownRecordings | None:
    """The measured recordings among training windows, by `extract_features`, or None where all are synthetic."""
    names = np.unique(windows.recording_id[~windows.synthetic])
    if not names.size:
        return None
    names = names[np.unique(np.linspace(0, names.size - 1, min(MOST, names.size)).round().astype(np.int64))]
    own = [windows.subset((windows.recording_id == name) & ~windows.synthetic) for name in names]
    return KnownRecordings(
        recording_id=tuple(names.tolist()),
        label=tuple(str(some.label[0]) for some in own),
        features=np.stack([extract_features(some).values.mean(axis=0) for some in own]),
    )
