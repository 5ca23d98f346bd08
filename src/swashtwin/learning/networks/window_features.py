"""Levels of a whole window: narrow lines, logarithmic bands and the shape of the waveform, of
signal and envelopes.

Nothing here has weights. Each level is log10 of a power or of an amplitude, or a number that no
gain changes; by how much a gain changes it is its gain response, so that a gain can be applied to,
or removed from, the levels themselves.
"""

import math
from functools import lru_cache, partial
from itertools import pairwise

import numpy as np
from jaxtyping import Complex64, Float, Float32, Int

from swashtwin.learning.features import running_sums, up_to
from swashtwin.learning.healthy.band_power_layout import BandPower
from swashtwin.signals import band_shares, hann_taper, inverse_transform, transform

FLOOR = 1e-7
"""Added to each power before its logarithm, in the square of the scaled unit; windows are expected
scaled (`Normalization`), which makes it negligible.
"""
N_ORDERS, N_ENVELOPE_ORDERS = 72, 40
"""Orders of the shaft whose lines stand one by one, of the signal and of an envelope."""
_LINES, LINE_SHARE, _ENVELOPE_LINES, ENVELOPE_SHARE = 200, 200 / 1024, 64, 64 / 1024
BANDS, ENVELOPE_BANDS = 48, 24
ENVELOPE_FROM = (0.0, 1000 / 12800, 4000 / 12800)
"""Shares of half the sample rate above which envelopes are taken: of all, above 1 kHz and 4 kHz at
25.6 kHz.
"""
LEAST_DEVIATION, NARROWEST = (
    1e-6,
    1e-3,
)  # of a channel, in the scaled unit; of an order within the spectrum [lines]
_N_SHAPE = 5  # log10 deviation, and four numbers that no gain changes


@lru_cache(maxsize=4)
def window_bands(length: int, orders: bool) -> tuple[BandPower, ...]:
    """What each level of a channel is of, in the order of `window_features`, for windows of `length`
    samples.

    Edges are in periods per sample, or in orders.

    Examples
    --------
    >>> window_bands(2048, True)[5].edges(0.01)
    (0.005, 0.015)
    """

    def of(is_envelope: bool, n_lines: int, share: float, n_bands: int) -> list[BandPower]:
        n, level = length // 2, partial(BandPower, "", is_envelope)
        if orders:
            lines = [level(order, order - 0.5, order + 0.5) for order in range(1, n_lines + 1)]
        else:
            edges = (((edge + 0.5) / length).tolist() for edge in narrow_edges(n, n_lines, share))
            lines = [level(None, *pair) for pair in zip(*edges, strict=True)]
        bands = pairwise(
            (np.geomspace(0.5, n + 0.5, n_bands + 1) / length).tolist()
        )  # the edges of `band_shares`
        whole = [level(None, 0.0, 0.5, name) for name in ("deviation", *["shape"] * (_N_SHAPE - 1))]
        return [*whole, *lines, *(level(None, *pair) for pair in bands)]

    counts = line_counts(orders)
    envelope = [
        *of(True, counts[1], ENVELOPE_SHARE, ENVELOPE_BANDS),
        BandPower("", True, None, 0.0, 0.5, "deviation"),
    ]
    return (*of(False, counts[0], LINE_SHARE, BANDS), *envelope * len(ENVELOPE_FROM))


def window_features(
    windows: Float32[np.ndarray, "window channel time"], turns: Float[np.ndarray, " window"] | None
) -> Float32[np.ndarray, "window channel level"]:
    """Levels of each channel, the logarithm of its deviation first.

    Narrow lines are orders of the shaft, which turns so far per sample in each window; without
    `turns` they are of equal width over the lowest fifth of the spectrum.
    """
    x = windows - windows.mean(axis=-1, keepdims=True)
    deviation = np.maximum(np.sqrt(_mean_product(x, x)), np.float32(LEAST_DEVIATION))
    x /= deviation
    length, counts = x.shape[-1], line_counts(turns is not None)
    parts = _band_features(x, turns, counts[0], LINE_SHARE, BANDS)
    spectrum = transform(x)
    for above in ENVELOPE_FROM:
        envelope = _envelope(x, spectrum, math.floor(above * (length // 2)) + 1)
        mean = envelope.mean(axis=-1, keepdims=True)
        envelope -= mean
        parts += [
            *_band_features(envelope, turns, counts[1], ENVELOPE_SHARE, ENVELOPE_BANDS),
            np.log10(mean + FLOOR),
        ]
    features = np.concatenate(parts, axis=-1, dtype=np.float32)
    features += gain_response(turns is not None) * np.log10(deviation)
    return features


def line_counts(orders: bool) -> tuple[int, int]:
    """Narrow lines of the signal, and of an envelope."""
    return (N_ORDERS, N_ENVELOPE_ORDERS) if orders else (_LINES, _ENVELOPE_LINES)


def narrow_edges(
    n_lines: int, n_narrow: int, share: float
) -> tuple[Int[np.ndarray, " band"], Int[np.ndarray, " band"]]:
    """(first line, line after the last) of each of `n_narrow` bands over the lowest `share` of a
    spectrum's lines.
    """
    lowest, band = max(1, round(share * n_lines)), np.arange(n_narrow)
    return band * lowest // n_narrow, -(-(band + 1) * lowest // n_narrow)


def gain_response(orders: bool) -> Float32[np.ndarray, " level"]:
    """How many decades each level of a channel rises when the channel is ten times as loud.

    Examples
    --------
    >>> gain_response(True)[:6].tolist()
    [1.0, 0.0, 0.0, 0.0, 0.0, 2.0]
    """
    decades = {"power": 2.0, "deviation": 1.0, "shape": 0.0}
    return np.array(
        [decades[level.quantity] for level in window_bands(2, orders)], dtype=np.float32
    )


def _mean_product(x: np.ndarray, y: np.ndarray) -> Float32[np.ndarray, "window channel 1"]:
    return (np.einsum("wct,wct->wc", x, y) / np.float32(x.shape[-1]))[..., None]


def _envelope(
    x: Float32[np.ndarray, "window channel time"],
    spectrum: Complex64[np.ndarray, "window channel line"],
    first: int,
) -> Float32[np.ndarray, "window channel time"]:
    """Magnitude of the analytic signal of the lines from `first` on; `spectrum` is the transform of
    `x`, of mean 0.
    """
    length = x.shape[-1]
    lines = spectrum.copy()
    lines[..., :first] = 0
    square = (x if first == 1 else inverse_transform(lines, length)) ** 2
    lines *= np.complex64(-1j)
    square += inverse_transform(lines, length) ** 2
    square += np.float32(1e-12)
    return np.sqrt(square, out=square)


def _band_features(
    x: Float32[np.ndarray, "window channel time"],
    turns: Float[np.ndarray, " window"] | None,
    n_narrow: int,
    share: float,
    n_bands: int,
) -> list[np.ndarray]:
    """Shape of the waveform, levels of narrow lines, levels of logarithmic bands; the mean of `x`
    is 0.
    """
    lines = transform(x * hann_taper(x.shape[-1]).astype(np.float32))[..., 1:]
    power, n = (lines.real**2 + lines.imag**2) / np.float32(x.shape[-1]), x.shape[-1] // 2
    if turns is None:
        first, last = narrow_edges(n, n_narrow, share)
        sums = running_sums(power[..., : last[-1]])
        narrow = (sums[..., last] - sums[..., first]) / (last - first)
    else:
        edges = np.clip(
            (np.arange(n_narrow + 1) + 0.5) * (turns * x.shape[-1])[:, None], 0.5, n + 0.5
        )[:, None]
        width, sums = np.diff(edges), running_sums(power[..., : int(edges.max() + 0.5)])
        narrow = np.diff(up_to(sums, edges)) / np.maximum(width, 1e-6)
        narrow = np.where(width < NARROWEST, power[..., -1:], narrow)  # beyond the spectrum
    bands = narrow, power @ band_shares(n, n_bands).astype(np.float32)
    return [
        *_waveform_shape(x),
        *(np.log10(np.float32(part) + np.float32(FLOOR)) for part in bands),
    ]


def _waveform_shape(
    x: Float32[np.ndarray, "window channel time"],
) -> tuple[Float32[np.ndarray, "window channel 1"], ...]:
    """log10 deviation, skewness, log kurtosis, log crest factor, mean of |x| over deviation."""
    deviation = np.sqrt(_mean_product(x, x)) + np.float32(1e-6)
    z = x / deviation
    square, magnitude = z * z, np.abs(z)
    least = np.float32(1e-3)
    return (
        np.log10(deviation),
        _mean_product(square, z),
        np.log(_mean_product(square, square) + least),
        np.log(magnitude.max(axis=-1, keepdims=True) + least),
        magnitude.mean(axis=-1, keepdims=True),
    )
