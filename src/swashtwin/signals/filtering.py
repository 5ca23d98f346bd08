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

MAINS_HZ = 50.0
"""Frequency of the mains."""
MAINS_TOLERANCE_HZ = 0.1
"""Largest distance of hum from it."""

HARMONICS = 20
"""Harmonics of hum, 50 Hz to 1 kHz; fewer if half the sample rate is lower."""


def add_noise(
    signal: Float[np.ndarray, "channel time"],
    snr_db: float,
    seed: int,
    *purpose: object,
    kind: NoiseKind = "white",
    sample_rate: float = 0.0,
) -> Float[np.ndarray, "channel time"]:
    """Return a signal with noise of a given signal-to-noise ratio [dB] added.

    The signal's power is its variance over the whole of `signal`, per channel
    (docs/explanation/method.md, "Noise").

    - ``"white"``: Gaussian, the same density at all frequencies.
    - ``"pink"``: Gaussian, the density falls as 1/f from the first line of the signal to half the
      sample rate.
    - ``"hum"``: the first 20 harmonics of the mains with amplitudes 1/h, phases uniform and drawn
      for each channel, at 50 ± 0.1 Hz, drawn once for all channels; nothing if half the sample
      rate is lower.

    Parameters
    ----------
    purpose : names the random stream, usually the recording's id and the repeat.
    sample_rate : samples per second [Hz]; hum needs it.

    Raises
    ------
    InputError
        Hum without a sample rate.
    """
    power = signal.var(axis=-1, keepdims=True)
    scale = np.sqrt(power * 10 ** (-snr_db / 10))
    rng = random_stream(seed, "noise" if kind == "white" else kind, float(snr_db), *purpose)
    noise = unit_noise(signal.shape, rng, kind, sample_rate)
    noisy: np.ndarray = signal + scale * noise
    return noisy


def unit_noise(
    shape: tuple[int, ...],
    rng: np.random.Generator,
    kind: NoiseKind = "white",
    sample_rate: float = 0.0,
) -> Float[np.ndarray, "..."]:
    """Return noise of a kind of `add_noise` along the last axis, of expected variance 1.

    Raises
    ------
    InputError
        Hum without a sample rate.
    """
    if kind == "hum":
        return _hum(shape, sample_rate, rng)
    white = rng.standard_normal(shape)
    if kind == "white":
        return white
    return _color_pink(white)


def _color_pink(white: Float[np.ndarray, "*axes time"]) -> Float[np.ndarray, "*axes time"]:
    """Return white noise with a density that falls as 1/f, at a variance of 1."""
    n_samples = white.shape[-1]
    spectrum = transform(white)
    weight = np.zeros(spectrum.shape[-1])
    weight[1:] = np.arange(1, len(weight)) ** -0.5

    # Lines of both signs count; the line at half the rate, which even counts have, has one sign.
    sides = np.full(len(weight), 2.0)
    sides[-1] -= n_samples % 2 == 0
    variance = float((sides * weight**2).sum()) / n_samples
    return inverse_transform(spectrum * (weight / np.sqrt(variance)), n_samples)


def _hum(
    shape: tuple[int, ...], sample_rate: float, rng: np.random.Generator
) -> Float[np.ndarray, "..."]:
    """Return harmonics of the mains, at a variance of 1 over whole periods."""
    mains = MAINS_HZ + MAINS_TOLERANCE_HZ * rng.uniform(-1, 1)
    harmonics = np.arange(1, HARMONICS + 1)
    harmonics = harmonics[harmonics * (MAINS_HZ + MAINS_TOLERANCE_HZ) < sample_rate / 2]
    if not sample_rate > 0:
        raise InputError(
            f"Hum of {MAINS_HZ:g} Hz needs the sample rate.",
            field="sample_rate",
            remedy="Set {sample_rate} in Hz.",
        )
    if not len(harmonics):
        return np.zeros(shape)

    phase = rng.uniform(0, 2 * np.pi, (*shape[:-1], len(harmonics)))
    turning = np.exp(2j * np.pi * mains / sample_rate * np.arange(shape[-1]))
    # Harmonic h is the h-th power of the first: products are much faster than exponentials.
    powers = np.multiply.accumulate(np.tile(turning, (len(harmonics), 1)), axis=0)
    amplitudes = np.sqrt(2 / (1 / harmonics**2).sum()) / harmonics
    starts = np.exp(1j * phase) * amplitudes
    hum: np.ndarray = starts.real @ powers.imag + starts.imag @ powers.real
    return hum


MAX_UPPER_EDGE = 0.98
"""Upper edge, relative to half the sample rate, from which a filter is a high pass: a band pass
that ends so near to it is badly conditioned.
"""


def band_limited(
    signal: Float[np.ndarray, "channel time"], sample_rate: float, low: float, high: float
) -> Float[np.ndarray, "channel time"]:
    """Return the signal between `low` and `high` [Hz].

    The filter is a zero-phase Butterworth filter of order 4 in each direction.

    Raises
    ------
    InputError
        The band is invalid: `low` must be positive, below `high`, and below half the sample rate.
    """
    nyquist = sample_rate / 2
    if not 0 < low < min(high, nyquist):
        raise InputError(
            f"Band {low:g} to {high:g} Hz is invalid at {sample_rate:g} Hz: use 0 < low < high, "
            "and low below half the sample rate."
        )

    upper = None
    if high < MAX_UPPER_EDGE * nyquist:
        upper = high / nyquist
    sos = _butterworth(low / nyquist, upper)
    filtered: np.ndarray = scipy.signal.sosfiltfilt(sos, signal, axis=-1)
    return filtered


@lru_cache(maxsize=256)
def _butterworth(low: float, high: float | None) -> Float[np.ndarray, "section 6"]:
    """Return the sections of order 4 between shares of half the sample rate; None is no edge."""
    sections: np.ndarray
    if high is None:
        sections = scipy.signal.butter(4, low, "highpass", output="sos")
    else:
        sections = scipy.signal.butter(4, [low, high], "bandpass", output="sos")
    return sections
