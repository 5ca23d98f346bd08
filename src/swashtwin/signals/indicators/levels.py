"""Levels in a band of frequencies: root mean squares of acceleration and, by integration, of velocity.

One-sided power density (Welch, Hann taper, half-overlapping segments of 2 s, mean removed), the taper's noise
bandwidth corrected: a sine of amplitude 1 reads 0.7071 in any band that holds it. A spectral line that a band's edge
cuts is shared in proportion.
"""

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import InputError
from swashtwin.signals.spectra import power_density

SEGMENT = 2.0
"""Length of the segments [s], so that lines lie 0.5 Hz apart; the whole signal where it is shorter."""


Spectrum = tuple[Float[np.ndarray, " frequency"], Float[np.ndarray, "channel frequency"]]


def segment_length(n_samples: int, sample_rate: float) -> int:
    """Samples of the segments whose `power_density` the levels are read from."""
    return min(n_samples, round(SEGMENT * sample_rate))


def band_rms(
    signal: Float[np.ndarray, "channel time"],
    sample_rate: float,
    low: float,
    high: float,
    *,
    spectrum: Spectrum | None = None,
) -> Float[np.ndarray, " channel"]:
    """Root mean square between `low` and `high` [Hz], in the signal's unit; its square is the band's energy.

    Parameters
    ----------
    spectrum : `power_density` of the signal in segments of `segment_length`, where it is at hand.

    Raises
    ------
    InputError
        No band, one that reaches above half the sample rate, or one narrower than a spectral line.

    Examples
    --------
    >>> time = np.arange(4000) / 1000
    >>> print(band_rms(np.sin(2 * np.pi * 50 * time)[None], 1000.0, 10, 100).round(4))
    [0.7071]
    """
    return _level(signal, sample_rate, low, high, integrated=False, spectrum=spectrum)


def velocity_rms(
    acceleration: Float[np.ndarray, "channel time"],
    sample_rate: float,
    low: float = 10.0,
    high: float = 1000.0,
    *,
    spectrum: Spectrum | None = None,
) -> Float[np.ndarray, " channel"]:
    """Root mean square [m/s] of the velocity between `low` and `high` [Hz], of an acceleration [m/s^2].

    The power density is divided by the angular frequency squared, which needs no start value and lets no offset drift.
    10 to 1000 Hz is the band in which vibration severity of machines is commonly stated. No zone of ISO 20816 applies
    to piston pumps; compare with the machine's own baseline (`indicators.trend`).

    Raises
    ------
    InputError
        No band, one that reaches above half the sample rate, or one below which the recording holds no full period.
    """
    return _level(acceleration, sample_rate, low, high, integrated=True, spectrum=spectrum)


def _level(
    signal: Float[np.ndarray, "channel time"],
    rate: float,
    low: float,
    high: float,
    *,
    integrated: bool,
    spectrum: Spectrum | None = None,
) -> Float[np.ndarray, " channel"]:
    n_samples = signal.shape[-1]
    if not 0 <= low < high <= rate / 2:
        raise InputError(f"a band of {low:g} to {high:g} Hz is none at {rate:g} Hz; it lies in 0 to {rate / 2:g} Hz.")
    length = segment_length(n_samples, rate)
    width = rate / length
    if high - low < width or (integrated and low < 2 * width):
        raise InputError(
            f"{n_samples / rate:.3g} s resolve {width:.3g} Hz, too little for {low:g} to {high:g} Hz; record longer."
        )
    frequency, density = power_density(signal, rate, length) if spectrum is None else spectrum
    share = np.clip(np.minimum(frequency + width / 2, high) - np.maximum(frequency - width / 2, low), 0, None)
    if integrated:
        share[1:] /= (2 * np.pi * frequency[1:]) ** 2  # the first line is below the band
    return np.sqrt(density @ share)
