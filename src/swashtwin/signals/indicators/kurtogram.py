"""In which band of frequencies a signal is most impulsive: the kurtogram."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy
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
    """E|c|⁴ / (E|c|²)² - 2 of each band's complex envelope c: 0 for Gaussian noise, -1 for one sine. Of bands that lie
    clearly below the best it is known to about their deviation only."""
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
    time = np.arange(n_samples) - (n_samples - 1) / 2
    spectrum = transform(signal - signal.mean() - (time @ signal) / (time @ time) * time)
    edges = []
    halves = [2**level for level in range(_LEVELS + 1)]
    for count in sorted([*halves, *(3 * half for half in halves[:-1])]):
        width = sample_rate / 2 / count
        values = n_samples / sample_rate * width
        if count > 1 and (values < _LEAST_VALUES or width < least_bandwidth):
            continue
        edges += [(index / count, (index + 1) / count, 2 / math.sqrt(values)) for index in range(count)]
    low, high, deviation = np.array(edges).T
    single = spectrum.astype(np.complex64)
    kurtosis = np.array([_kurtosis(single, *edge, is_exact=False) for edge in zip(low, high, strict=True)])
    score = np.where(low > 0, kurtosis - _SURE * deviation, -np.inf)
    margin = deviation + 0.1 * (kurtosis + 2)
    candidates = score + margin >= (score - margin).max()
    candidates[0] = True
    for index in np.flatnonzero(candidates):
        kurtosis[index] = _kurtosis(spectrum, low[index], high[index])
    return Kurtogram(low * sample_rate / 2, high * sample_rate / 2, kurtosis, deviation)


def _kurtosis(spectrum: np.ndarray, low: float, high: float, *, is_exact: bool = True) -> float:
    """Spectral kurtosis of the share `low` to `high` of the spectrum.

    Not exact, the envelope is sampled at a number of points that is fast to transform, which shifts it by less than
    the scatter of noise: enough to tell which bands can be the best.
    """
    first, weight = _filter(len(spectrum) - 1, low, high)
    lines = spectrum[first : first + len(weight)] * weight.astype(spectrum.real.dtype)
    count = len(weight) if is_exact else scipy.fft.next_fast_len(len(weight))
    envelope = scipy.fft.ifft(lines, count, overwrite_x=True)[_EDGE:-_EDGE]
    power = envelope.real**2
    power += envelope.imag**2
    mean = float(power.mean(dtype=np.float64))
    return float((power @ power) / power.size / mean**2 - 2) if mean > 0 else -2.0


@lru_cache(maxsize=256)
def _filter(last: int, low: float, high: float) -> tuple[int, Float[np.ndarray, " line"]]:
    """First line and weights of the filter of a band of a spectrum of `last` + 1 lines."""
    slope = _SLOPE * (high - low) * last
    first, end = max(1, math.floor(low * last - slope)), min(last, math.ceil(high * last + slope))
    line = np.arange(first, end + 1)
    rise = np.clip((line - low * last) / (2 * slope) + 0.5, 0, 1) if low > 0 else 1.0
    fall = np.clip((high * last - line) / (2 * slope) + 0.5, 0, 1) if high < 1 else 1.0
    return first, np.sin(np.pi / 2 * np.minimum(rise, fall)) * np.ones(len(line))
