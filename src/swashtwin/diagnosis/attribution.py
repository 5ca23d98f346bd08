"""Contribution of each band to a network's answer, by integrated gradients.

Sundararajan, Taly and Yan 2017, arXiv:1703.01365. From silence (0 after the scaling) to the window
x along a straight line, the answer f changes by f(x) - f(0) = Σ_t x_t g_t, where g is the mean
gradient of f on the path (completeness). The same sum over frequencies, Σ_k (w_k / N) Re(X_k
conj(G_k)), is the same integral in the basis of sines (Parseval), since the path is the same. Lines
are summed in orders of the shaft and third octaves, of the signal and of its envelope.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Float32, Float64

from swashtwin.foundation import DataError
from swashtwin.learning import (
    FeatureNetwork,
    FittedClassifier,
    SolvedNetwork,
    WindowSet,
)
from swashtwin.signals import BandPower, line_frequencies, transform

if TYPE_CHECKING:
    from torch import nn

    from swashtwin.learning import Network


MAX_ORDER = 40
"""Highest order of the shaft with its own band. A varying speed smears higher ones, which are
summed in third octaves."""
STEPS = 32
"""Points of the midpoint rule on the path of samples."""

# Points on the path of band powers: an average of heads turns within a hundredth of it.
_BAND_POWER_STEPS = 512

_THIRD_OCTAVE = 2 ** (1 / 3)

# Name of each feature that belongs to no band, by its quantity and whether it is an envelope's.
_WHOLE_CHANNEL_NAMES = {
    ("deviation", False): "overall level",
    ("deviation", True): "envelope level",
    ("shape", None): "waveform shape",
}


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
    """Of what it is a band: ``"signal"``, ``"envelope"``, or ``"whole"`` for a feature that belongs
    to no band."""


def signal_bands(sample_rate: float, shaft: float | None, n_samples: int) -> tuple[Band, ...]:
    """Return orders of the shaft, if the samples resolve them, and third octaves above.

    They cover all frequencies without a gap.

    Parameters
    ----------
    shaft : shaft frequency [Hz]; None for third octaves only.
    """
    nyquist = sample_rate / 2
    resolution = sample_rate / n_samples
    bands: list[Band] = []

    if shaft is not None and resolution < shaft / 4 and 1.5 * shaft < nyquist:
        edge = 0.5 * shaft
        bands.append(Band("below order 0.5", 0.0, edge))
        for order in range(1, MAX_ORDER + 1):
            if (order + 0.5) * shaft > nyquist:
                break
            edge = (order + 0.5) * shaft
            bands.append(Band(f"order {order}", (order - 0.5) * shaft, edge, order))
    else:
        edge = max(resolution, 1.0)
        bands.append(Band(f"below {format_frequency(edge)}", 0.0, edge))

    while edge < nyquist:
        upper_edge = min(edge * _THIRD_OCTAVE, nyquist)
        # A remainder below a sixth octave joins the last band.
        if upper_edge * 2 ** (1 / 6) > nyquist:
            upper_edge = nyquist
        name = f"{format_frequency(edge)} to {format_frequency(upper_edge)}"
        bands.append(Band(name, edge, upper_edge))
        edge = upper_edge
    return tuple(bands)


def evidence_bands(sample_rate: float, shaft: float | None, n_samples: int) -> tuple[Band, ...]:
    """Return `signal_bands`, the same of the envelopes, and what belongs to no band."""
    signal = signal_bands(sample_rate, shaft, n_samples)
    envelope = [replace(band, name=f"envelope {band.name}", part="envelope") for band in signal]
    nyquist = sample_rate / 2
    whole = [Band(name, 0.0, nyquist, part="whole") for name in _WHOLE_CHANNEL_NAMES.values()]
    return (*signal, *envelope, *whole)


def format_frequency(frequency: float) -> str:
    """Return a frequency as text, with two digits of kHz or three of Hz."""
    if frequency >= 1000:
        return f"{frequency / 1000:.2g} kHz"
    return f"{frequency:.3g} Hz"


def feature_shares(
    band_powers: tuple[BandPower, ...], bands: tuple[Band, ...], sample_rate: float, turns: float
) -> Float64[np.ndarray, "feature band"]:
    """Return the share of each feature in each of `evidence_bands`, by overlap in frequency.

    The shares of a feature sum to 1.

    Parameters
    ----------
    turns : turns of the shaft per sample.
    """
    shares = np.zeros((len(band_powers), len(bands)))
    names = [band.name for band in bands]

    for row, band_power in zip(shares, band_powers, strict=True):
        if band_power.quantity != "power":
            is_shape = band_power.quantity == "shape"
            key = (band_power.quantity, None if is_shape else band_power.is_envelope)
            row[names.index(_WHOLE_CHANNEL_NAMES[key])] = 1.0
            continue

        part = "envelope" if band_power.is_envelope else "signal"
        columns = [index for index, band in enumerate(bands) if band.part == part]
        low, high = (edge * sample_rate for edge in band_power.edges(turns))
        for index in columns:
            band = bands[index]
            row[index] = max(0.0, min(high, band.high) - max(low, band.low))
        if row.any():
            row /= row.sum()
        else:
            # At this speed its frequencies lie beyond the spectrum.
            row[columns[-1]] = 1.0
    return shares


def band_sums(
    lines: Float64[np.ndarray, "channel line"],
    bands: tuple[Band, ...],
    sample_rate: float,
    n_samples: int,
) -> Float64[np.ndarray, "channel band"]:
    """Return the sum of the spectral lines in each band; the last band includes the last line."""
    upper_edges = [band.high for band in bands]
    frequency = line_frequencies(n_samples, sample_rate)
    band_index = np.searchsorted(upper_edges, frequency, side="right")
    band_index = np.clip(band_index, 0, len(bands) - 1)
    return np.stack([np.bincount(band_index, weights=row, minlength=len(bands)) for row in lines])


def line_shares(
    signal: Float[np.ndarray, "channel time"], gradient: Float[np.ndarray, "channel time"]
) -> Float64[np.ndarray, "channel line"]:
    """Return what each spectral line (`signals.transform`) adds to the answer.

    The sum over the lines is Σ signal · gradient.
    """
    n = signal.shape[-1]
    product = transform(signal) * np.conj(transform(gradient))

    # All lines but the first and, of an even length, the last stand for two frequencies.
    weight = np.full(product.shape[-1], 2.0)
    weight[0] = 1.0
    if n % 2 == 0:
        weight[-1] = 1.0
    return np.asarray(weight / n * product.real, dtype=np.float64)


def attribute_answer(
    classifier: FittedClassifier, windows: WindowSet, label: int, rival: int, shaft: float | None
) -> dict[str, Any]:
    """Return what each band adds to the score of `label` less that of `rival`.

    The path starts at silence in the space of samples; of a `FeatureNetwork` at the training's
    mean in the space of its features, since the logarithm of samples has no useful gradient at
    silence.

    Parameters
    ----------
    windows : consecutive windows of one recording.
    label, rival : indices of the two classes.
    shaft : speed of the shaft [Hz]; None if not specified.

    Returns
    -------
    The fields ``baseline``, ``margin``, ``completeness_error``, ``bands`` and ``contributions`` of
    an `Evidence`, means over the windows.
    """
    network = classifier.network
    if isinstance(network, FeatureNetwork):
        return _attribute_to_features(classifier, network, windows, label, rival, shaft)
    if isinstance(network, SolvedNetwork):
        raise DataError(
            f"The network {network.name} has no gradients, so the lines that speak for a class "
            "cannot be computed."
        )
    return _attribute_to_samples(classifier, network, windows, label, rival, shaft)


def _attribute_to_samples(
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

    # Consecutive windows form one signal, whose spectrum has finer lines.
    signal = _join_windows(scaled)
    slope = _join_windows(gradient)
    n_windows = len(windows)
    n_samples = signal.shape[1]
    margin = float(change.mean())

    bands = signal_bands(classifier.layout.sample_rate, shaft, n_samples)
    sums = band_sums(line_shares(signal, slope), bands, classifier.layout.sample_rate, n_samples)
    return {
        "baseline": "silence",
        "margin": margin,
        "completeness_error": _completeness_error(
            float((signal * slope).sum()) / n_windows, margin
        ),
        "bands": bands,
        "contributions": sums / n_windows,
    }


def _join_windows(
    windows: Float[np.ndarray, "window channel time"],
) -> Float64[np.ndarray, "channel joined_time"]:
    n_channels = windows.shape[1]
    return windows.transpose(1, 0, 2).reshape(n_channels, -1).astype(np.float64)


def _attribute_to_features(
    classifier: FittedClassifier,
    network: FeatureNetwork,
    windows: WindowSet,
    label: int,
    rival: int,
    shaft: float | None,
) -> dict[str, Any]:
    features = classifier.embed(windows).astype(np.float32)
    gradient, change = network.mean_gradient(features, label, rival, _BAND_POWER_STEPS)
    _require_finite(gradient, windows)

    n_windows = len(windows)
    products = (features * gradient).reshape(n_windows, windows.n_channels, -1) / n_windows
    margin = float(change.mean())

    turns = float(windows.turns_per_sample[0])
    if not np.isfinite(turns):
        turns = network.settings["turns"]
    bands = evidence_bands(classifier.layout.sample_rate, shaft, classifier.layout.length)
    catalogue = network.catalogue(classifier.layout.length)
    shares = feature_shares(catalogue, bands, classifier.layout.sample_rate, turns)
    return {
        "baseline": "the mean of the training",
        "margin": margin,
        "completeness_error": _completeness_error(float(products.sum()), margin),
        "bands": bands,
        "contributions": products.sum(axis=0) @ shares,
    }


def _completeness_error(total: float, margin: float) -> float:
    """Return the share of the margin that the sum of all contributions misses."""
    return abs(total - margin) / max(abs(margin), 1e-12)


def _require_finite(gradient: np.ndarray, windows: WindowSet) -> None:
    if not np.isfinite(gradient).all():
        name = windows.recording_id[0]
        raise DataError(f"{name}: the network's gradients are not finite; is a sample too large?")


def mean_gradients(
    network: "nn.Module", signal: Float32[np.ndarray, "window *entry"], label: int, rival: int
) -> tuple[Float64[np.ndarray, "window *entry"], Float64[np.ndarray, " window"]]:
    """Return the mean gradient on the path, and f(x) - f(0), of each scaled window.

    f is the score of `label` less that of `rival`.
    """
    import torch

    inputs = torch.from_numpy(signal)
    gradient = torch.zeros_like(inputs, dtype=torch.float64)
    for step in range(STEPS):
        point = (inputs * ((step + 0.5) / STEPS)).requires_grad_(True)
        scores = network(point)
        difference = scores[:, label] - scores[:, rival]
        (slope,) = torch.autograd.grad(difference.sum(), point)
        gradient += slope.double() / STEPS

    with torch.no_grad():
        silence = torch.zeros_like(inputs[:1])
        scores = network(torch.cat([inputs, silence])).double()
    difference = scores[:, label] - scores[:, rival]
    return gradient.numpy(), (difference[:-1] - difference[-1]).numpy()
