"""Powers of spectral lines, and what of them lies between two edges: what levels of every kind are made of."""

import numpy as np
from jaxtyping import Float, Float64

from swashtwin.signals import hann_taper, tapered_transform

_LEAST_SHIFT, _ALIKE = 3.0, 0.25
"""A channel as a whole moved where the median change of its bands is at least so many dB, and the bands differ from it
by so little, relative to it, in the median."""


def line_powers(signal: Float[np.ndarray, "*batch time"]) -> Float[np.ndarray, "*batch line"]:
    """Mean square of each line of the spectrum but the first, mean removed, Hann taper; of the signal's precision."""
    length = signal.shape[-1]
    spectrum = tapered_transform(signal)[..., 1:]
    power = spectrum.real**2 + spectrum.imag**2
    power *= power.dtype.type(2 / (length * np.sum(hann_taper(length) ** 2)))
    return np.asarray(power)


def running_sums(power: Float[np.ndarray, "*batch line"]) -> Float64[np.ndarray, "*batch edge"]:
    """Power of all lines before each edge between two lines."""
    sums = np.zeros((*power.shape[:-1], power.shape[-1] + 1))
    np.cumsum(power, axis=-1, dtype=np.float64, out=sums[..., 1:])
    return sums


def between(
    sums: Float64[np.ndarray, "*batch edge"], low: Float[np.ndarray, "*band"], high: Float[np.ndarray, "*band"]
) -> Float64[np.ndarray, "..."]:
    """Power between two edges, in lines; a line at an edge counts by its share.

    Parameters
    ----------
    sums : `running_sums` of the lines 1, 2, ...

    Examples
    --------
    >>> sums = running_sums(np.array([1.0, 2.0, 3.0]))
    >>> between(sums, np.array([0.5, 2.5]), np.array([2.0, 9.0])).tolist()
    [2.0, 3.0]
    """

    def up_to(edge: np.ndarray) -> np.ndarray:
        place = np.clip(edge - 0.5, 0, sums.shape[-1] - 1)
        line = np.minimum(place.astype(np.int64), sums.shape[-1] - 2)
        return np.asarray(sums[..., line] + (place - line) * (sums[..., line + 1] - sums[..., line]))

    return up_to(high) - up_to(low)


def common_shift(change: Float[np.ndarray, "*channel band"]) -> Float[np.ndarray, "*channel"]:
    """Change [dB] of a channel whose bands nearly all moved alike, as a gain moves them; else 0."""
    shift = np.median(change, axis=-1)
    rest = np.median(np.abs(change - shift[..., None]), axis=-1)
    return np.where((np.abs(shift) >= _LEAST_SHIFT) & (rest <= _ALIKE * np.abs(shift)), shift, 0.0)
