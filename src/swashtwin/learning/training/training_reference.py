"""The training recordings by their vibration features: what a new recording is compared with."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Float64

from swashtwin.learning.features import extract_features
from swashtwin.learning.windows.window_set import WindowSet

MOST_RECORDINGS = 2000
"""Most recordings in a reference; of more, this many are taken, evenly spaced in the order of their ids."""

_LEAST_VARIANCE = 1e-6
"""Added to each feature's shrunk variance, for classes of one recording have none."""


@dataclass(frozen=True, eq=False)
class TrainingReference:
    """Mean features of each measured recording of the training; it holds no samples."""

    recording_id: tuple[str, ...]
    """The recordings, in the order of their ids."""
    label: tuple[str, ...]
    """Class of each."""
    features: Float64[np.ndarray, "recording feature"]
    """Mean of each feature over the windows of the recording."""

    def distances(self, features: Float[np.ndarray, " feature"]) -> Float64[np.ndarray, " recording"]:
        """Distance of each training recording from one with these mean features, 0 where they are the same.

        Root mean square over the features, each in units of its standard deviation between the training recordings; a
        feature that does not differ between them counts in its own unit.
        """
        deviation = self.features.std(axis=0)
        offset = (self.features - features) / np.where(deviation > 0, deviation, 1.0)
        return np.asarray(np.sqrt(np.mean(offset**2, axis=1)), dtype=np.float64)

    def ood_score(self, features: Float[np.ndarray, " feature"]) -> float:
        """Out-of-distribution score of these mean features: a relative Mahalanobis distance, per feature.

        The squared Mahalanobis distance from the nearest class mean, in the covariance within the classes, less that
        from the mean of all, in the covariance of all (Ren and others 2021, arXiv:2106.09022), so that what varies
        between all recordings anyhow counts for little. Covariances are shrunk (Ledoit and Wolf 2004), for there are
        more features than recordings. It may be negative; only its order means anything. Of a single class it is the
        plain distance.
        """
        space = self._space
        scaled = (features - space.mean) / space.deviation
        offset = scaled - space.centers
        nearest = np.einsum("cf,fg,cg->c", offset, space.within, offset).min()
        return float(nearest - scaled @ space.overall @ scaled) / scaled.size

    def cross_fitted_scores(self) -> Float64[np.ndarray, " recording"]:
        """`ood_score` of each training recording by nine in ten of the others; NaN where none is of its class."""
        fold, label = np.arange(len(self.label)) % 10, np.array(self.label)
        scores = np.full(len(label), np.nan)
        for number in np.unique(fold):
            used = fold != number
            scored = np.flatnonzero(~used & np.isin(label, label[used]))
            names = np.array(self.recording_id)[used]
            others = TrainingReference(tuple(names.tolist()), tuple(label[used].tolist()), self.features[used])
            scores[scored] = [others.ood_score(self.features[index]) for index in scored]
        return scores

    @cached_property
    def _space(self) -> "_Space":
        deviation = self.features.std(axis=0)
        deviation = np.where(deviation > 0, deviation, 1.0)
        mean = self.features.mean(axis=0)
        scaled = (self.features - mean) / deviation
        names, index = np.unique(self.label, return_inverse=True)
        centers = np.stack([scaled[index == number].mean(axis=0) for number in range(len(names))])
        overall = _precision(scaled) if len(names) > 1 else np.zeros((scaled.shape[1],) * 2)
        return _Space(mean, deviation, centers, _precision(scaled - centers[index]), overall)


@dataclass(frozen=True, eq=False)
class _Space:
    """Means and inverse covariances of the training recordings, in standard deviations."""

    mean: Float64[np.ndarray, " feature"]
    deviation: Float64[np.ndarray, " feature"]
    centers: Float64[np.ndarray, "class feature"]
    within: Float64[np.ndarray, "feature feature"]
    overall: Float64[np.ndarray, "feature feature"]


def shrunk_covariance(rows: Float[np.ndarray, "recording feature"]) -> Float64[np.ndarray, "feature feature"]:
    """Covariance of the rows, shrunk towards a multiple of the identity by Ledoit and Wolf (2004).

    (1 - s) S + s m I with S the covariance, m the mean of its diagonal (DOI 10.1016/S0047-259X(03)00096-4); as
    scikit-learn's `LedoitWolf`, whose import would take longer than a diagnosis.
    """
    n_rows, n_features = rows.shape
    centered = rows - rows.mean(axis=0)
    squares = centered**2
    covariance = centered.T @ centered / n_rows
    trace = squares.sum() / n_rows
    mean = trace / n_features
    norm = float((covariance**2).sum())
    beta = (float((squares.T @ squares).sum()) / n_rows - norm) / (n_features * n_rows)
    delta = (norm - 2 * mean * trace + n_features * mean**2) / n_features
    shrinkage = min(beta, delta) / delta if min(beta, delta) > 0 else 0.0
    return np.asarray((1 - shrinkage) * covariance + shrinkage * mean * np.eye(n_features))


def _precision(rows: Float[np.ndarray, "recording feature"]) -> Float64[np.ndarray, "feature feature"]:
    covariance = shrunk_covariance(rows)
    return np.asarray(np.linalg.inv(covariance + _LEAST_VARIANCE * np.eye(len(covariance))))


def build_reference(windows: WindowSet) -> TrainingReference | None:
    """Reference of the measured recordings among training windows, or None where all are synthetic."""
    names = np.unique(windows.recording_id[~windows.synthetic])
    if not names.size:
        return None
    names = names[np.unique(np.linspace(0, names.size - 1, min(MOST_RECORDINGS, names.size)).round().astype(np.int64))]
    parts = [windows.subset((windows.recording_id == name) & ~windows.synthetic) for name in names]
    return TrainingReference(
        recording_id=tuple(names.tolist()),
        label=tuple(str(part.label[0]) for part in parts),
        features=np.stack([extract_features(part).values.mean(axis=0) for part in parts]),
    )
