"""In which band of frequencies a signal is most impulsive: the kurtogram."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import InputError
from swashtwin.signals.spectra import transform

_LEVELS = 7
"""Halvings of the whole band, at most."""
_LEAST_VALUES = 200
"""Independent values of the envelope in a band, at least: the kurtosis of noise then scatters by 0.14."""
_SLOPE = 0.125
"""Width of a filter's slopes beyond either edge, relative to the band; neighbors add up to 1."""
_EDGE = 4
"""Values of the envelope dropped at either end, where the filter sees the signal's other end."""
_SURE = 3.0
"""Standard deviations of noise taken off a band's kurtosis before bands are compared."""
_CLEAR = 6.0
"""The same, that the best of hundreds of bands must exceed; noise reached 5.4 in 180 trials."""


@dataclass(frozen=True, eq=False)
class Kurtogram:
    """Spectral kurtosis of bands that halve and third the spectrum."""

    low: Float[np.ndarray, " band"]
    """Lower edge of each band [Hz]."""
    high: Float[np.ndarray, " band"]
    """Upper edge of each band [Hz]."""
    kurtosis: Float[np.ndarray, " band"]
    """E|c|⁴ / (E|c|²)² - 2 of each band's complex envelope c: 0 for Gaussian noise, -1 for one sine."""
    deviation: Float[np.ndarray, " band"]
    """Standard deviation of the kurtosis that Gaussian noise would have, 2 / √(bandwidth · duration)."""

    @property
    def best(self) -> int:
        """Band whose kurtosis lies highest after three standard deviations are taken off (our reading).

        Antoni takes the highest itself, which in a short recording is often a narrow band of plain noise. Bands that
        begin at 0 Hz have no part in it, as an envelope is one of something faster; the whole band where there is no
        other.
        """
        sure = np.where(self.low > 0, self.kurtosis - _SURE * self.deviation, -np.inf)
        return int(np.argmax(sure))

    @property
    def band(self) -> tuple[float, float]:
        """Edges [Hz] of the best band."""
        return float(self.low[self.best]), float(self.high[self.best])

    @property
    def impulsive(self) -> bool:
        """Whether the best band is more impulsive than noise would be."""
        return bool(self.kurtosis[self.best] > _CLEAR * self.deviation[self.best])


def kurtogram(signal: Float[np.ndarray, " time"], sample_rate: float, *, least_bandwidth: float = 0.0) -> Kurtogram:
    """Spectral kurtosis on the grid of Antoni's fast kurtogram (2007, DOI 10.1016/j.ymssp.2005.12.002).

    Bands are 1, 1/2, 1/3, 1/4, 1/6, 1/8, 1/12 ... of half the sample rate. Each band's complex envelope comes from the
    inverse transform of its part of the spectrum, with raised-cosine slopes, instead of from his tree of short filters.

    Parameters
    ----------
    least_bandwidth : narrowest band wanted [Hz]; an envelope holds frequencies up to half its band's width or so.

    Raises
    ------
    InputError
        The signal has fewer than 400 samples, or is constant.
    """
    n_samples = len(signal)
    if n_samples < 2 * _LEAST_VALUES or np.ptp(signal) == 0:
        raise InputError(f"{n_samples} samples, or constant ones, have no kurtogram; it takes {2 * _LEAST_VALUES}.")
    sample = np.arange(n_samples)
    detrended = signal - np.polyval(np.polyfit(sample, signal, 1), sample)
    spectrum = transform(detrended)
    rows = []
    halves = [2**level for level in range(_LEVELS + 1)]
    for count in sorted([*halves, *(3 * half for half in halves[:-1])]):
        width = sample_rate / 2 / count
        values = n_samples / sample_rate * width
        if count > 1 and (values < _LEAST_VALUES or width < least_bandwidth):
            continue
        for index in range(count):
            kurtosis = _kurtosis(spectrum, index / count, (index + 1) / count)
            rows.append((index * width, (index + 1) * width, kurtosis, 2 / math.sqrt(values)))
    low, high, value, deviation = np.array(rows).T
    return Kurtogram(low, high, value, deviation)


def _kurtosis(spectrum: np.ndarray, low: float, high: float) -> float:
    """Spectral kurtosis of the share `low` to `high` of the spectrum."""
    last = len(spectrum) - 1
    slope = _SLOPE * (high - low) * last
    first, end = max(1, math.floor(low * last - slope)), min(last, math.ceil(high * last + slope))
    line = np.arange(first, end + 1)
    rise = np.clip((line - low * last) / (2 * slope) + 0.5, 0, 1) if low > 0 else 1.0
    fall = np.clip((high * last - line) / (2 * slope) + 0.5, 0, 1) if high < 1 else 1.0
    weight = np.sin(np.pi / 2 * np.minimum(rise, fall))
    power = np.abs(np.fft.ifft(spectrum[line] * weight))[_EDGE:-_EDGE] ** 2
    mean = float(power.mean())
    return float((power**2).mean() / mean**2 - 2) if mean > 0 else -2.0
