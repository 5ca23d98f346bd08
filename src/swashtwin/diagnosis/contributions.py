"""What each band and each moment adds to a network's answer, by integrated gradients over samples or over levels."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64

from swashtwin.diagnosis.attribution import line_shares, mean_gradients
from swashtwin.diagnosis.evidence_bands import Band, band_sums, level_bands, level_shares, signal_bands
from swashtwin.foundation import DataError
from swashtwin.learning import FittedClassifier, LevelNetwork, SolvedNetwork, WindowSet

if TYPE_CHECKING:
    from swashtwin.learning import Network

_MOMENTS = 10  # of a window, where gradients are over samples
_LEVEL_STEPS = 512  # points on the way of levels: an average of heads turns within a hundredth of it


@dataclass(frozen=True, eq=False)
class Contributions:
    """What adds to the score of a class less that of its rival; means over the windows."""

    baseline: str
    """What the windows are compared with, in words."""
    margin: float
    """The score, less that of the baseline."""
    total: float
    """Sum of all contributions; short of `margin` by what finitely many points on the way miss."""
    bands: tuple[Band, ...]
    """Bands."""
    lines: Float64[np.ndarray, "channel band"]
    """What each band adds."""
    moments: Float64[np.ndarray, "channel moment"]
    """What each moment adds; the moments are of equal length."""


def contributions(
    classifier: FittedClassifier, windows: WindowSet, label: int, rival: int, shaft: float | None
) -> Contributions:
    """Contributions of consecutive windows of one recording.

    From silence over the samples; for a `LevelNetwork` from the training's mean over its levels, since logarithms of
    samples have no gradient at silence that says anything.

    Parameters
    ----------
    classifier : with the scaling of the recording.
    label, rival : indices of the two classes.
    shaft : speed of the shaft [Hz], or None where it is not stated.

    Raises
    ------
    DataError
        The gradients are not finite.
    """
    network = classifier.network
    if isinstance(network, LevelNetwork):
        return _of_levels(classifier, network, windows, label, rival, shaft)
    if isinstance(network, SolvedNetwork):
        raise DataError(
            f"the network {network.name} has no gradients, so no line can be named that speaks for a class."
        )
    return _of_samples(classifier, network, windows, label, rival, shaft)


def _of_samples(
    classifier: FittedClassifier, network: "Network", windows: WindowSet, label: int, rival: int, shaft: float | None
) -> Contributions:
    scaled = classifier.normalization.apply(windows)
    gradient, change = mean_gradients(network, scaled, label, rival)
    _require_finite(gradient, windows)
    x, g = (part.transpose(1, 0, 2).reshape(part.shape[1], -1).astype(np.float64) for part in (scaled, gradient))
    count, n_samples = len(windows), x.shape[1]
    bands = signal_bands(classifier.sample_rate, shaft, n_samples)
    edges = np.linspace(0, n_samples, _MOMENTS * count + 1).astype(np.int64)[:-1]
    return Contributions(
        baseline="silence",
        margin=float(change.mean()),
        total=float((x * g).sum()) / count,
        bands=bands,
        lines=band_sums(line_shares(x, g), bands, classifier.sample_rate, n_samples) / count,
        moments=np.add.reduceat(x * g, edges, axis=1) / count,
    )


def _of_levels(
    classifier: FittedClassifier, network: LevelNetwork, windows: WindowSet, label: int, rival: int, shaft: float | None
) -> Contributions:
    levels = classifier.embed(windows).astype(np.float32)
    gradient, change = network.mean_gradient(levels, label, rival, _LEVEL_STEPS)
    _require_finite(gradient, windows)
    count, n_channels = len(windows), windows.n_channels
    adds = (levels * gradient).reshape(count, n_channels, -1) / count
    turns = float(windows.turns_per_sample[0])
    catalogue = network.catalogue(classifier.length)
    bands = level_bands(classifier.sample_rate, shaft, classifier.length)
    usual = network.settings["turns"]
    shares = level_shares(catalogue, bands, classifier.sample_rate, turns if np.isfinite(turns) else usual)
    return Contributions(
        baseline="the mean of the training",
        margin=float(change.mean()),
        total=float(adds.sum()),
        bands=bands,
        lines=adds.sum(axis=0) @ shares,
        moments=adds.sum(axis=2).T,
    )


def _require_finite(gradient: np.ndarray, windows: WindowSet) -> None:
    if not np.isfinite(gradient).all():
        name = windows.recording_id[0]
        raise DataError(f"{name}: the network's gradients are not finite; is a sample too large?")
