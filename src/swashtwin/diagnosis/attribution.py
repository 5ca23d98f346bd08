"""What each band adds to a network's answer: integrated gradients over samples or over levels.

Sundararajan, Taly and Yan 2017, arXiv:1703.01365. From silence (0 after the scaling) to the window
x along a straight line, the answer f changes by f(x) - f(0) = Σ_t x_t g_t with g the mean gradient
of f on the way (completeness). The same sum over frequencies, Σ_k (w_k / N) Re(X_k conj(G_k)), is
the same integral in the basis of sines (Parseval), since the way is the same. Lines are summed in
orders of the shaft and third octaves, of the signal and of its envelope.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Float32, Float64

from swashtwin.foundation import DataError
from swashtwin.learning import (
    BandPowerNetwork,
    FittedClassifier,
    SolvedNetwork,
    WindowSet,
)
from swashtwin.signals import BandPower, line_frequencies, transform

if TYPE_CHECKING:
    from torch import nn

    from swashtwin.learning import Network


ORDERS = 40
"""Orders of the shaft that stand one by one; higher ones, which a wandering speed smears, in third
octaves.
"""


@dataclass(frozen=True)
class Band:
    """One order of the shaft, one third octave, or a whole channel."""

    name: str
    """Such as ``"order 7"``, ``"1.8-2.2 kHz"``, ``"envelope order 7"`` or ``"waveform shape"``."""
    low: float
    """Lower edge [Hz]."""
    high: float
    """Upper edge [Hz]."""
    order: int | None = None
    """Order of the shaft in its middle, or None for a third octave."""
    part: str = "signal"
    """What it is a band of: ``"signal"``, ``"envelope"``, or ``"whole"`` for what belongs to no
    band.
    """


def signal_bands(sample_rate: float, shaft: float | None, n_samples: int) -> tuple[Band, ...]:
    """Orders as far as the samples resolve them, and third octaves above; they cover all
    frequencies, without gap.
    """
    nyquist, bands = sample_rate / 2, list[Band]()
    edge, resolution = max(sample_rate / n_samples, 1.0), sample_rate / n_samples
    if shaft is not None and resolution < shaft / 4 and 1.5 * shaft < nyquist:
        edge = 0.5 * shaft
        bands.append(Band("below order 0.5", 0.0, edge))
        for order in range(1, ORDERS + 1):
            if (order + 0.5) * shaft > nyquist:
                break
            edge = (order + 0.5) * shaft
            bands.append(Band(f"order {order}", (order - 0.5) * shaft, edge, order))
    else:
        bands.append(Band(f"below {format_frequency(edge)}", 0.0, edge))
    while edge < nyquist:
        above = min(edge * 2 ** (1 / 3), nyquist)
        if above * 2 ** (1 / 6) > nyquist:
            above = nyquist
        bands.append(Band(f"{format_frequency(edge)} to {format_frequency(above)}", edge, above))
        edge = above
    return tuple(bands)


def evidence_bands(sample_rate: float, shaft: float | None, n_samples: int) -> tuple[Band, ...]:
    """`signal_bands`, the same of the envelopes, and what belongs to no band."""
    signal = signal_bands(sample_rate, shaft, n_samples)
    envelope = [replace(band, name=f"envelope {band.name}", part="envelope") for band in signal]
    whole = [Band(name, 0.0, sample_rate / 2, part="whole") for name in _WHOLE.values()]
    return (*signal, *envelope, *whole)


_WHOLE = {
    ("deviation", False): "overall level",
    ("deviation", True): "envelope level",
    ("shape", None): "waveform shape",
}


def format_frequency(frequency: float) -> str:
    """Frequency in words, with two digits of kHz or three of Hz."""
    return f"{frequency / 1000:.2g} kHz" if frequency >= 1000 else f"{frequency:.3g} Hz"


def feature_shares(
    band_powers: tuple[BandPower, ...], bands: tuple[Band, ...], sample_rate: float, turns: float
) -> Float64[np.ndarray, "level band"]:
    """Share of each level in each of `evidence_bands`, by overlap in frequency; those of a level sum
    to 1.

    `turns` are turns of the shaft per sample.
    """
    shares = np.zeros((len(band_powers), len(bands)))
    names = [band.name for band in bands]
    for row, level in zip(shares, band_powers, strict=True):
        if level.quantity != "power":
            key = (level.quantity, None if level.quantity == "shape" else level.is_envelope)
            row[names.index(_WHOLE[key])] = 1.0
            continue
        part = "envelope" if level.is_envelope else "signal"
        low, high = (edge * sample_rate for edge in level.edges(turns))
        for index, band in enumerate(bands):
            if band.part == part:
                row[index] = max(0.0, min(high, band.high) - max(low, band.low))
        if row.any():
            row /= row.sum()
        else:  # beyond the spectrum
            row[max(index for index, band in enumerate(bands) if band.part == part)] = 1.0
    return shares


def band_sums(
    lines: Float64[np.ndarray, "channel line"],
    bands: tuple[Band, ...],
    sample_rate: float,
    n_samples: int,
) -> Float64[np.ndarray, "channel band"]:
    """Sum of the lines in each band; the last holds the last line too."""
    frequency = line_frequencies(n_samples, sample_rate)
    band = np.clip(
        np.searchsorted([band.high for band in bands], frequency, side="right"), 0, len(bands) - 1
    )
    return np.stack([np.bincount(band, weights=row, minlength=len(bands)) for row in lines])


def line_shares(
    signal: Float[np.ndarray, "channel time"], gradient: Float[np.ndarray, "channel time"]
) -> Float64[np.ndarray, "channel line"]:
    """What each line of the spectrum (`signals.transform`) adds to the answer; their sum is Σ
    signal · gradient.
    """
    n = signal.shape[-1]
    both = transform(signal) * np.conj(transform(gradient))
    weight = np.full(both.shape[-1], 2.0)
    weight[0] = 1.0
    if n % 2 == 0:
        weight[-1] = 1.0
    return np.asarray(weight / n * both.real, dtype=np.float64)


STEPS = 32
"""Points of the midpoint rule along the way."""
_LEVEL_STEPS = (
    512  # points on the way of levels: an average of heads turns within a hundredth of it
)


def contributions(
    classifier: FittedClassifier, windows: WindowSet, label: int, rival: int, shaft: float | None
) -> dict[str, Any]:
    """Fields of an `Evidence` from consecutive windows of one recording: ``baseline``, ``margin``,
    ``gap``, ``bands`` and ``lines``; means over the windows.

    From silence over the samples; for a `BandPowerNetwork` from the training's mean over its levels,
    since logarithms of samples have no gradient at silence that says anything.

    Parameters
    ----------
    label, rival : indices of the two classes.
    shaft : speed of the shaft [Hz], or None where it is not stated.
    """
    network = classifier.network
    if isinstance(network, BandPowerNetwork):
        return _of_levels(classifier, network, windows, label, rival, shaft)
    if isinstance(network, SolvedNetwork):
        raise DataError(
            f"the network {network.name} has no gradients, so no line can be named that speaks for a class."
        )
    return _of_samples(classifier, network, windows, label, rival, shaft)


def _of_samples(
    classifier: FittedClassifier,
    network: "Network",
    windows: WindowSet,
    label: int,
    rival: int,
    shaft: float | None,
) -> dict[str, Any]:
    scaled = classifier.normalization.apply(windows)
    gradient, change = mean_gradients(network, scaled, label, rival)
    _require_finite(gradient, windows)
    x, g = (
        part.transpose(1, 0, 2).reshape(part.shape[1], -1).astype(np.float64)
        for part in (scaled, gradient)
    )
    count, n_samples = len(windows), x.shape[1]
    bands = signal_bands(classifier.sample_rate, shaft, n_samples)
    return {
        "baseline": "silence",
        "margin": float(change.mean()),
        "gap": _gap(float((x * g).sum()) / count, float(change.mean())),
        "bands": bands,
        "lines": band_sums(line_shares(x, g), bands, classifier.sample_rate, n_samples) / count,
    }


def _of_levels(
    classifier: FittedClassifier,
    network: BandPowerNetwork,
    windows: WindowSet,
    label: int,
    rival: int,
    shaft: float | None,
) -> dict[str, Any]:
    band_powers = classifier.embed(windows).astype(np.float32)
    gradient, change = network.mean_gradient(band_powers, label, rival, _LEVEL_STEPS)
    _require_finite(gradient, windows)
    count, n_channels = len(windows), windows.n_channels
    adds = (band_powers * gradient).reshape(count, n_channels, -1) / count
    turns = float(windows.turns_per_sample[0])
    catalogue = network.catalogue(classifier.length)
    bands = evidence_bands(classifier.sample_rate, shaft, classifier.length)
    usual = network.settings["turns"]
    shares = feature_shares(
        catalogue, bands, classifier.sample_rate, turns if np.isfinite(turns) else usual
    )
    return {
        "baseline": "the mean of the training",
        "margin": float(change.mean()),
        "gap": _gap(float(adds.sum()), float(change.mean())),
        "bands": bands,
        "lines": adds.sum(axis=0) @ shares,
    }


def _gap(total: float, margin: float) -> float:
    """Share of the margin that the sum of all contributions misses."""
    return abs(total - margin) / max(abs(margin), 1e-12)


def _require_finite(gradient: np.ndarray, windows: WindowSet) -> None:
    if not np.isfinite(gradient).all():
        name = windows.recording_id[0]
        raise DataError(f"{name}: the network's gradients are not finite; is a sample too large?")


def mean_gradients(
    network: "nn.Module", signal: Float32[np.ndarray, "window *entry"], label: int, rival: int
) -> tuple[Float64[np.ndarray, "window *entry"], Float64[np.ndarray, " window"]]:
    """(mean gradient on the way, f(x) - f(0)) of each scaled window, f being the score of `label`
    less `rival`'s.
    """
    import torch

    inputs = torch.from_numpy(signal)
    gradient = torch.zeros_like(inputs, dtype=torch.float64)
    for step in range(STEPS):
        point = (inputs * ((step + 0.5) / STEPS)).requires_grad_(True)
        scores = network(point)
        (slope,) = torch.autograd.grad((scores[:, label] - scores[:, rival]).sum(), point)
        gradient += slope.double() / STEPS
    with torch.no_grad():
        ends = network(torch.cat([inputs, torch.zeros_like(inputs[:1])])).double()
    answer = ends[:, label] - ends[:, rival]
    return gradient.numpy(), (answer[:-1] - answer[-1]).numpy()
