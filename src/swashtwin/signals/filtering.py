"""Noise added to a signal, and the part of it within a band."""

from functools import lru_cache
from typing import Literal

import numpy as np
import scipy
from jaxtyping import Float

from swashtwin.foundation import InputError, random_stream
from swashtwin.signals.spectra import inverse_transform, transform

NoiseKind = Literal["white", "pink", "hum"]
"""Spectrum of noise; see `add_noise`."""

MAINS, MAINS_TOLERANCE = 50.0, 0.1
"""Frequency of the mains, and how far hum is off it at most [Hz]."""

HARMONICS = 20
"""Harmonics of hum, 50 Hz to 1 kHz; fewer where half the sample rate is lower."""


def add_noise(
    signal: Float[np.ndarray, "channel time"],
    snr_db: float,
    seed: int,
    *purpose: object,
    kind: NoiseKind = "white",
    sample_rate: float = 0.0,
) -> Float[np.ndarray, "channel time"]:
    """Signal with noise of a stated signal-to-noise ratio [dB] added.

    The signal's power is its variance over the whole of `signal`, per channel
    (docs/explanation/method.md, "Noise").

    - ``"white"``: Gaussian, the same density at all frequencies.
    - ``"pink"``: Gaussian, the density falls as 1/f from the first line of the signal to half the
      sample rate.
    - ``"hum"``: the first 20 harmonics of the mains with amplitudes 1/h, phases uniform and drawn
      for each channel, at 50 ± 0.1 Hz, drawn once for all channels; nothing where half the sample
      rate is lower.

    Parameters
    ----------
    purpose : names the random stream, usually the recording's id and the repeat.
    sample_rate : samples per second [Hz]; hum needs it.

    Raises
    ------
    InputError
        Hum, and no sample rate is stated.
    """
    power = signal.var(axis=-1, keepdims=True)
    scale = np.sqrt(power * 10 ** (-snr_db / 10))
    rng = random_stream(seed, "noise" if kind == "white" else kind, float(snr_db), *purpose)
    return signal + scale * unit_noise(signal.shape, rng, kind, sample_rate)


def unit_noise(
    shape: tuple[int, ...],
    rng: np.random.Generator,
    kind: NoiseKind = "white",
    sample_rate: float = 0.0,
) -> Float[np.ndarray, "..."]:
    """Noise of a kind of `add_noise` along the last axis, with an expected variance of 1.

    Raises
    ------
    InputError
        Hum, and no sample rate is stated.
    """
    if kind == "hum":
        return _hum(shape, sample_rate, rng)
    white = rng.standard_normal(shape)
    return white if kind == "white" else _pink(white)


def _pink(white: Float[np.ndarray, "*axes time"]) -> Float[np.ndarray, "*axes time"]:
    spectrum = transform(white)
    weight = np.zeros(spectrum.shape[-1])
    weight[1:] = np.arange(1, len(weight)) ** -0.5
    sides = np.full(len(weight), 2.0)  # lines of both signs, but for that at half the rate
    sides[-1] -= white.shape[-1] % 2 == 0
    variance = float((sides * weight**2).sum()) / white.shape[-1]
    return inverse_transform(spectrum * (weight / np.sqrt(variance)), white.shape[-1])


def _hum(
    shape: tuple[int, ...], sample_rate: float, rng: np.random.Generator
) -> Float[np.ndarray, "..."]:
    """Harmonics of the mains, at a variance of 1 over whole periods."""
    mains = MAINS + MAINS_TOLERANCE * rng.uniform(-1, 1)
    harmonics = np.arange(1, HARMONICS + 1)
    harmonics = harmonics[harmonics * (MAINS + MAINS_TOLERANCE) < sample_rate / 2]
    if not sample_rate > 0:
        raise InputError(f"hum of {MAINS:g} Hz needs the sample rate; state sample_rate in Hz.")
    if not len(harmonics):
        return np.zeros(shape)
    phase = rng.uniform(0, 2 * np.pi, (*shape[:-1], len(harmonics)))
    turning = np.exp(2j * np.pi * mains / sample_rate * np.arange(shape[-1]))
    powers = np.multiply.accumulate(np.tile(turning, (len(harmonics), 1)), axis=0)
    starts = np.exp(1j * phase) * (np.sqrt(2 / (1 / harmonics**2).sum()) / harmonics)
    return starts.real @ powers.imag + starts.imag @ powers.real


def band_limited(
    signal: Float[np.ndarray, "channel time"], sample_rate: float, low: float, high: float
) -> Float[np.ndarray, "channel time"]:
    """Signal between `low` and `high` [Hz], zero-phase Butterworth of order 4 in each direction.

    Raises
    ------
    InputError
        No band: `low` must be positive, below `high`, and below half the sample rate.
    """
    nyquist = sample_rate / 2
    if not 0 < low < min(high, nyquist):
        raise InputError(
            f"a band of {low:g}...{high:g} Hz is none at {sample_rate:g} Hz; it needs 0 < low < high."
        )
    sos = _butterworth(low / nyquist, None if high >= 0.98 * nyquist else high / nyquist)
    return scipy.signal.sosfiltfilt(sos, signal, axis=-1)


@lru_cache(maxsize=256)
def _butterworth(low: float, high: float | None) -> Float[np.ndarray, "section 6"]:
    """Sections of order 4 between shares of half the sample rate; None has no upper edge."""
    edges, kind = (low, "highpass") if high is None else ([low, high], "bandpass")
    return scipy.signal.butter(4, edges, kind, output="sos")
