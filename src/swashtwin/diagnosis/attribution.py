"""What each band and each moment adds to a network's answer: integrated gradients over samples or over levels.

Sundararajan, Taly and Yan 2017, arXiv:1703.01365. From silence (0 after the scaling) to the window x along a straight
line, the answer f changes by f(x) - f(0) = Σ_t x_t g_t with g the mean gradient of f on the way (completeness). The
same sum over frequencies, Σ_k (w_k / N) Re(X_k conj(G_k)), is the same integral in the basis of sines (Parseval), since
the way is the same; so one set of gradients tells moments and lines alike.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float32, Float64

from swashtwin.diagnosis.evidence_bands import band_sums, level_bands, level_shares, line_shares, signal_bands
from swashtwin.foundation import DataError
from swashtwin.learning import FittedClassifier, LevelNetwork, SolvedNetwork, WindowSet

if TYPE_CHECKING:
    from torch import nn

    from swashtwin.learning import Network

STEPS = 32
"""Points of the midpoint rule along the way."""
_MOMENTS = 10  # of a window, where gradients are over samples
_LEVEL_STEPS = 512  # points on the way of levels: an average of heads turns within a hundredth of it


def contributions(
    classifier: FittedClassifier, windows: WindowSet, label: int, rival: int, shaft: float | None
) -> dict[str, Any]:
    """Fields of an `Evidence` from consecutive windows of one recording: ``baseline``, ``margin``, ``gap``, ``bands``,
    ``lines`` and ``moments``; means over the windows.

    From silence over the samples; for a `LevelNetwork` from the training's mean over its levels, since logarithms of
    samples have no gradient at silence that says anything.

    Parameters
    ----------
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
) -> dict[str, Any]:
    scaled = classifier.normalization.apply(windows)
    gradient, change = mean_gradients(network, scaled, label, rival)
    _require_finite(gradient, windows)
    x, g = (part.transpose(1, 0, 2).reshape(part.shape[1], -1).astype(np.float64) for part in (scaled, gradient))
    count, n_samples = len(windows), x.shape[1]
    bands = signal_bands(classifier.sample_rate, shaft, n_samples)
    edges = np.linspace(0, n_samples, _MOMENTS * count + 1).astype(np.int64)[:-1]
    return {
        "baseline": "silence",
        "margin": float(change.mean()),
        "gap": _gap(float((x * g).sum()) / count, float(change.mean())),
        "bands": bands,
        "lines": band_sums(line_shares(x, g), bands, classifier.sample_rate, n_samples) / count,
        "moments": np.add.reduceat(x * g, edges, axis=1) / count,
    }


def _of_levels(
    classifier: FittedClassifier, network: LevelNetwork, windows: WindowSet, label: int, rival: int, shaft: float | None
) -> dict[str, Any]:
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
    return {
        "baseline": "the mean of the training",
        "margin": float(change.mean()),
        "gap": _gap(float(adds.sum()), float(change.mean())),
        "bands": bands,
        "lines": adds.sum(axis=0) @ shares,
        "moments": adds.sum(axis=2).T,
    }


def _gap(total: float, margin: float) -> float:
    """Share of the margin that the sum of all contributions misses."""
    return abs(total - margin) / max(abs(margin), 1e-12)


def _require_finite(gradient: np.ndarray, windows: WindowSet) -> None:
    if not np.isfinite(gradient).all():
        name = windows.recording_id[0]
        raise DataError(f"{name}: the network's gradients are not finite; is a sample too large?")


def mean_gradients(
    network: "nn.Module",
    signal: Float32[np.ndarray, "window *entry"],
    label: int,
    rival: int,
    *,
    steps: int = STEPS,
) -> tuple[Float64[np.ndarray, "window *entry"], Float64[np.ndarray, " window"]]:
    """(mean gradient on the way, f(x) - f(0)) of each window, f being the score of `label` less that of `rival`.

    Parameters
    ----------
    network : in evaluation mode.
    signal : scaled windows, as the network takes them.
    label, rival : indices of the two classes.
    steps : points of the midpoint rule.
    """
    import torch

    inputs = torch.from_numpy(signal)
    gradient = torch.zeros_like(inputs, dtype=torch.float64)
    for step in range(steps):
        point = (inputs * ((step + 0.5) / steps)).requires_grad_(True)
        scores = network(point)
        (slope,) = torch.autograd.grad((scores[:, label] - scores[:, rival]).sum(), point)
        gradient += slope.double() / steps
    with torch.no_grad():
        ends = network(torch.cat([inputs, torch.zeros_like(inputs[:1])])).double()
    answer = ends[:, label] - ends[:, rival]
    return gradient.numpy(), (answer[:-1] - answer[-1]).numpy()
