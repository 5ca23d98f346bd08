"""Features of a whole window: narrow lines, logarithmic bands and the shape of the waveform.

They describe the signal and three envelopes, and nothing here has weights. Each feature is
log10 of a power or of an amplitude, or a number that no gain changes. The *gain response* of a
feature is how much a gain changes it, so that a gain can be applied to, or removed from, the
features themselves.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from jaxtyping import Complex64, Float, Float32

from swashtwin.signals import (
    BandPower,
    band_shares,
    equal_bands,
    hann_taper,
    inverse_transform,
    logarithmic_edges,
    power_below,
    running_sums,
    transform,
)

FLOOR = 1e-7
"""Added to each power before its logarithm, in the square of the scaled unit; windows are expected
scaled (`Normalization`), which makes it negligible.
"""
MIN_DEVIATION = 1e-6
"""Smallest deviation of a channel that is divided by, in the scaled unit."""
MIN_ORDER_WIDTH = 1e-3
"""Width of an order within the spectrum [lines] below which the order lies beyond it."""
N_SHAPE = 5
"""Numbers of the waveform: log10 deviation, and four that no gain changes."""


@dataclass(frozen=True)
class SpectrumBands:
    """Table of the bands of one spectrum."""

    n_orders: int
    """Shaft orders that have a band each, if the speed is used."""
    n_narrow: int
    """Bands of equal width that take their place, if it is not."""
    narrow_share: float
    """Share of the spectrum, from its lower end, that the narrow bands cover."""
    n_wide: int
    """Logarithmic bands over the whole spectrum."""

    def n_lines(self, uses_orders: bool) -> int:
        """Return the number of narrow bands, of orders or of equal width."""
        return self.n_orders if uses_orders else self.n_narrow


SIGNAL_BANDS = SpectrumBands(n_orders=72, n_narrow=200, narrow_share=200 / 1024, n_wide=48)
ENVELOPE_BANDS = SpectrumBands(n_orders=40, n_narrow=64, narrow_share=64 / 1024, n_wide=24)
ENVELOPES_ABOVE = (0.0, 1000 / 12800, 4000 / 12800)
"""Shares of half the sample rate above which envelopes are taken: of all, above 1 kHz and above
4 kHz at 25.6 kHz.
"""


@lru_cache(maxsize=4)
def window_bands(length: int, uses_orders: bool) -> tuple[BandPower, ...]:
    """Return what each feature of a channel is of, in the order of `window_features`.

    Edges are in periods per sample, or in orders, for windows of `length` samples.

    Examples
    --------
    >>> window_bands(2048, True)[5].edges(0.01)
    (0.005, 0.015)
    """
    envelope = [
        *_spectrum_features(ENVELOPE_BANDS, length, uses_orders, is_envelope=True),
        BandPower("", True, None, 0.0, 0.5, "deviation"),
    ]
    signal = _spectrum_features(SIGNAL_BANDS, length, uses_orders, is_envelope=False)
    return (*signal, *envelope * len(ENVELOPES_ABOVE))


def _spectrum_features(
    bands: SpectrumBands, length: int, uses_orders: bool, *, is_envelope: bool
) -> list[BandPower]:
    """Return what the features of one spectrum are of, in the order of `_measure_spectrum`."""
    features = [BandPower("", is_envelope, None, 0.0, 0.5, "deviation")]
    for _ in range(N_SHAPE - 1):
        features.append(BandPower("", is_envelope, None, 0.0, 0.5, "shape"))

    if uses_orders:
        for order in range(1, bands.n_orders + 1):
            features.append(BandPower("", is_envelope, order, order - 0.5, order + 0.5))
    else:
        first, end = equal_bands(length // 2, bands.n_narrow, bands.narrow_share)
        low = ((first + 0.5) / length).tolist()
        high = ((end + 0.5) / length).tolist()
        for low_edge, high_edge in zip(low, high, strict=True):
            features.append(BandPower("", is_envelope, None, low_edge, high_edge))

    edges = (logarithmic_edges(length // 2, bands.n_wide) / length).tolist()
    for low_edge, high_edge in pairwise(edges):
        features.append(BandPower("", is_envelope, None, low_edge, high_edge))
    return features


def gain_response(uses_orders: bool) -> Float32[np.ndarray, " feature"]:
    """Return by how many decades each feature rises if the channel becomes ten times as loud.

    Examples
    --------
    >>> gain_response(True)[:6].tolist()
    [1.0, 0.0, 0.0, 0.0, 0.0, 2.0]
    """
    decades = {"power": 2.0, "deviation": 1.0, "shape": 0.0}
    quantities = [feature.quantity for feature in window_bands(2, uses_orders)]
    return np.array([decades[quantity] for quantity in quantities], dtype=np.float32)


def window_features(
    windows: Float32[np.ndarray, "window channel time"], turns: Float[np.ndarray, " window"] | None
) -> Float32[np.ndarray, "window channel feature"]:
    """Return the features of each channel, the logarithm of its deviation first.

    Parameters
    ----------
    turns : turns of the shaft per sample in each window, by which narrow lines are orders of the
        shaft; None takes lines of equal width over the lowest fifth of the spectrum.
    """
    x = windows - windows.mean(axis=-1, keepdims=True)
    deviation = np.maximum(np.sqrt(_mean_product(x, x)), np.float32(MIN_DEVIATION))
    x /= deviation
    parts = _measure_spectrum(x, turns, SIGNAL_BANDS)

    spectrum = transform(x)
    for share in ENVELOPES_ABOVE:
        envelope = _high_pass_envelope(x, spectrum, first_envelope_line(share, x.shape[-1]))
        mean = envelope.mean(axis=-1, keepdims=True)
        envelope -= mean
        parts += _measure_spectrum(envelope, turns, ENVELOPE_BANDS)
        parts.append(np.log10(mean + FLOOR))

    features = np.concatenate(parts, axis=-1, dtype=np.float32)
    # The features are of the channel divided by its deviation; this is the channel itself again.
    features += gain_response(turns is not None) * np.log10(deviation)
    return features


def first_envelope_line(share: float, length: int) -> int:
    """Return the first line of an envelope of what lies above a share of half the sample rate."""
    return math.floor(share * (length // 2)) + 1


def _mean_product(x: np.ndarray, y: np.ndarray) -> Float32[np.ndarray, "window channel 1"]:
    return (np.einsum("wct,wct->wc", x, y) / np.float32(x.shape[-1]))[..., None]


def _high_pass_envelope(
    x: Float32[np.ndarray, "window channel time"],
    spectrum: Complex64[np.ndarray, "window channel line"],
    first: int,
) -> Float32[np.ndarray, "window channel time"]:
    """Return the magnitude of the analytic signal of the lines from `first` on.

    `spectrum` is the transform of `x`, whose mean is 0.
    """
    length = x.shape[-1]
    lines = spectrum.copy()
    lines[..., :first] = 0
    in_phase = x if first == 1 else inverse_transform(lines, length)
    square = in_phase**2

    lines *= np.complex64(-1j)
    square += inverse_transform(lines, length) ** 2
    square += np.float32(1e-12)  # whose root has a finite derivative where networks need one
    return np.sqrt(square, out=square)


def _measure_spectrum(
    x: Float32[np.ndarray, "window channel time"],
    turns: Float[np.ndarray, " window"] | None,
    bands: SpectrumBands,
) -> list[np.ndarray]:
    """Return the shape of a waveform of mean 0, and log10 powers of narrow and wide bands."""
    length = x.shape[-1]
    lines = transform(x * hann_taper(length).astype(np.float32))[..., 1:]
    power = (lines.real**2 + lines.imag**2) / np.float32(length)

    if turns is None:
        narrow = _equal_band_powers(power, bands)
    else:
        narrow = _order_powers(power, turns * length, bands.n_orders)
    wide = power @ band_shares(length // 2, bands.n_wide).astype(np.float32)
    return [
        *_waveform_shape(x),
        np.log10(np.float32(narrow) + np.float32(FLOOR)),
        np.log10(np.float32(wide) + np.float32(FLOOR)),
    ]


def _equal_band_powers(
    power: Float32[np.ndarray, "window channel line"], bands: SpectrumBands
) -> Float[np.ndarray, "window channel band"]:
    """Return the mean power of the lines in each band of equal width."""
    first, end = equal_bands(power.shape[-1], bands.n_narrow, bands.narrow_share)
    sums = running_sums(power[..., : end[-1]])
    return (sums[..., end] - sums[..., first]) / (end - first)


def _order_powers(
    power: Float32[np.ndarray, "window channel line"],
    lines_per_order: Float[np.ndarray, " window"],
    n_orders: int,
) -> Float[np.ndarray, "window channel order"]:
    """Return the mean power of the lines within half an order of each order.

    An order beyond the spectrum has that of the last line.
    """
    edges = (np.arange(n_orders + 1) + 0.5) * lines_per_order[:, None]
    edges = np.clip(edges, 0.5, power.shape[-1] + 0.5)[:, None]
    width = np.diff(edges)

    sums = running_sums(power[..., : int(edges.max() + 0.5)])
    mean = np.diff(power_below(sums, edges)) / np.maximum(width, 1e-6)
    return np.where(width < MIN_ORDER_WIDTH, power[..., -1:], mean)


def _waveform_shape(
    x: Float32[np.ndarray, "window channel time"],
) -> tuple[Float32[np.ndarray, "window channel 1"], ...]:
    """Return log10 deviation, skewness, log kurtosis, log crest factor, mean |x| over deviation."""
    deviation = np.sqrt(_mean_product(x, x)) + np.float32(1e-6)
    z = x / deviation
    square = z * z
    magnitude = np.abs(z)
    # Added before a logarithm: a silent channel has kurtosis and crest factor 0.
    offset = np.float32(1e-3)
    return (
        np.log10(deviation),
        _mean_product(square, z),
        np.log(_mean_product(square, square) + offset),
        np.log(magnitude.max(axis=-1, keepdims=True) + offset),
        magnitude.mean(axis=-1, keepdims=True),
    )
