"""The kurtogram: in which band of a signal impulses stand out most."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy
from jaxtyping import Complex, Float, Float32, Int
from numpy.lib.stride_tricks import sliding_window_view

from swashtwin.foundation import InputError
from swashtwin.signals.spectra import MAX_BLOCK_SAMPLES

MAX_HALVINGS = 7
"""Halvings of the whole band."""
MIN_VALUES = 200
"""Independent values of the envelope in a band; the kurtosis of noise then scatters by 0.14."""
SLOPE_SHARE = 0.125
"""Width of a filter's slopes beyond either edge, relative to the band; neighbors add up to 1."""
EDGE_VALUES = 4
"""Values of the envelope dropped at either end: the filter wraps around to the other end there."""
NOISE_DEVIATIONS = 3.0
"""Standard deviations of noise taken off a band's kurtosis before bands are compared."""
BANDS_AT_ONCE = 8
"""Bands transformed together, because the processor handles several at a time."""
MAX_CACHED_LINES = 1 << 19
"""Lines of a spectrum up to which its filters are cached; larger ones take too much memory."""


@dataclass(frozen=True, eq=False)
class Kurtogram:
    """Spectral kurtosis of bands that halve and third the spectrum."""

    low: Float[np.ndarray, " band"]
    """Lower edge of each band [Hz]."""
    high: Float[np.ndarray, " band"]
    """Upper edge of each band [Hz]."""
    kurtosis: Float[np.ndarray, " band"]
    """E|c|⁴ / (E|c|²)² - 2 of each band's complex envelope c: 0 for Gaussian noise, -1 for one
    sine.
    """
    deviation: Float[np.ndarray, " band"]
    """Standard deviation of the kurtosis of Gaussian noise, 2 / √(bandwidth · duration)."""

    @property
    def best(self) -> int:
        """Index of the band with the highest kurtosis less three standard deviations (our reading).

        Antoni takes the highest itself, which in a short recording is often a narrow band of plain
        noise. Bands that begin at 0 Hz are excluded, as an envelope is one of something faster; if
        there is no other band, it is the whole one.
        """
        significant = self.kurtosis - NOISE_DEVIATIONS * self.deviation
        return int(np.argmax(np.where(self.low > 0, significant, -np.inf)))

    @property
    def band(self) -> tuple[float, float]:
        """Edges [Hz] of the best band."""
        return float(self.low[self.best]), float(self.high[self.best])


def kurtograms(
    signal: Float[np.ndarray, "channel time"], sample_rate: float, *, min_bandwidth: float = 0.0
) -> list[Kurtogram]:
    """Return the spectral kurtosis of each channel on the grid of Antoni's fast kurtogram.

    Bands are 1, 1/2, 1/3, 1/4, 1/6, 1/8, 1/12 ... of half the sample rate; of those that begin at 0
    Hz only the whole one is included, as an envelope is one of something faster. Each band's
    complex envelope comes from the inverse transform of its part of the spectrum, with
    raised-cosine slopes, instead of from a tree of short filters (DOI 10.1016/j.ymssp.2005.12.002).
    Zeros pad the part to a length that is fast to transform, which samples the same envelope a
    little more closely (our reading: Antoni's envelopes have a length that his tree
    decides); the kurtosis of noise moves by less than its deviation. Transforms are of single
    precision.

    Parameters
    ----------
    min_bandwidth : narrowest band considered [Hz]; an envelope holds frequencies up to about half
        the width of its band.
    """
    n_samples = signal.shape[-1]
    if n_samples < 2 * MIN_VALUES or (np.ptp(signal, axis=-1) == 0).any():
        raise InputError(
            f"A kurtogram of {n_samples} samples is not possible: it needs {2 * MIN_VALUES} "
            "samples that are not constant."
        )
    spectra = _standardized_spectra(signal)

    edges = []
    kurtosis = []
    halves = [2**halving for halving in range(MAX_HALVINGS + 1)]
    thirds = [3 * count for count in halves[:-1]]
    for count in sorted([*halves, *thirds]):
        width = sample_rate / 2 / count
        n_values = n_samples / sample_rate * width
        if count > 1 and (n_values < MIN_VALUES or width < min_bandwidth):
            continue
        deviation = 2 / math.sqrt(n_values)
        first_band = 1 if count > 1 else 0
        for band in range(first_band, count):
            edges.append((band / count, (band + 1) / count, deviation))
        kurtosis.append(_spectral_kurtosis(spectra, count))

    low, high, deviations = np.array(edges).T
    nyquist = sample_rate / 2
    return [
        Kurtogram(low * nyquist, high * nyquist, row, deviations)
        for row in np.concatenate(kurtosis, axis=1)
    ]


def _standardized_spectra(
    signal: Float[np.ndarray, "channel time"],
) -> Complex[np.ndarray, "channel line"]:
    """Return the transform of each channel without its linear trend, of standard deviation 1."""
    n_samples = signal.shape[-1]
    time = np.arange(n_samples) - (n_samples - 1) / 2
    slope = ((signal @ time) / (time @ time))[:, None]
    trend = slope * time + signal.mean(axis=-1, keepdims=True)

    moving = signal - trend
    moving /= moving.std(axis=-1, keepdims=True)
    spectra: np.ndarray = scipy.fft.rfft(moving, overwrite_x=True)
    return spectra.astype(np.complex64)


def _spectral_kurtosis(
    spectra: Complex[np.ndarray, "channel line"], count: int
) -> Float[np.ndarray, "channel band"]:
    """Return the spectral kurtosis of `count` equal bands; of several, the first is excluded."""
    n_channels = len(spectra)
    last_line = spectra.shape[1] - 1
    if last_line < MAX_CACHED_LINES:
        first, weights = _band_filters(last_line, count)
    else:
        first, weights = _band_filters.__wrapped__(last_line, count)
    width = weights.shape[1] // 2

    # Complex numbers as pairs of real ones: a filter weighs both parts alike, and real products
    # take half the time.
    padded = np.pad(spectra, ((0, 0), (0, width))).view(np.float32)
    bands = sliding_window_view(padded, 2 * width, axis=1)
    at_once = max(1, MAX_BLOCK_SAMPLES // (width * n_channels) // BANDS_AT_ONCE) * BANDS_AT_ONCE

    kurtosis = np.empty((n_channels, len(first)))
    for start in range(0, len(first), at_once):
        part = slice(start, start + at_once)
        shape = (n_channels, len(first[part]), scipy.fft.next_fast_len(width))
        lines = np.zeros(shape, spectra.dtype)
        filtered = lines.view(np.float32)[..., : 2 * width]
        np.multiply(bands[:, 2 * first[part]], weights[part], out=filtered)

        envelope = scipy.fft.ifft(lines, axis=-1, overwrite_x=True)
        envelope = envelope[..., EDGE_VALUES:-EDGE_VALUES]
        power = envelope.real**2
        power += envelope.imag**2
        mean = power.mean(axis=-1)
        power /= np.where(mean > 0, mean, 1)[..., None]
        kurtosis[:, part] = np.einsum("cbt,cbt->cb", power, power) / power.shape[-1] - 2
    return kurtosis


@lru_cache(maxsize=2 * MAX_HALVINGS + 1)
def _band_filters(
    last_line: int, count: int
) -> tuple[Int[np.ndarray, " band"], Float32[np.ndarray, "band part"]]:
    """Return the first line of each band's filter, and its weights of real and imaginary parts."""
    first_band = 1 if count > 1 else 0
    edges = last_line * np.arange(first_band, count + 1) / count
    slope = SLOPE_SHARE * last_line / count

    # Line 0 is the mean, which no band holds.
    first = np.maximum(1, np.floor(edges[:-1] - slope)).astype(int)
    end = np.minimum(last_line, np.ceil(edges[1:] + slope)).astype(int)
    line = first[:, None] + np.arange(int((end - first).max()) + 1)

    rise = np.ones_like(line, dtype=float)
    if count > 1:
        rise = np.clip((line - edges[:-1, None]) / (2 * slope) + 0.5, 0, 1)
    # Nothing lies above half the sample rate, so the last band has no upper slope.
    upper_slope = np.clip((edges[1:, None] - line) / (2 * slope) + 0.5, 0, 1)
    fall = np.where(edges[1:, None] < last_line, upper_slope, 1.0)

    weights = np.where(line <= end[:, None], np.sin(np.pi / 2 * np.minimum(rise, fall)), 0.0)
    return first, np.repeat(weights.astype(np.float32), 2, axis=1)
