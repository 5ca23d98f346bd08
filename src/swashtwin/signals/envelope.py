"""Envelopes of a band and their spectra.

A flaw in a rolling bearing rings the housing at multiples of its `defect_orders`, which the
spectrum of the envelope shows.
"""

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import InputError
from swashtwin.signals.filtering import band_limited
from swashtwin.signals.kurtogram import kurtograms
from swashtwin.signals.spectra import amplitude_spectrum, signal_envelope

MIN_EDGE_SHARE = 1e-3
"""Lowest lower edge of a filter, in sample rates: a Butterworth filter at 0 Hz does not exist."""


def envelopes(
    signal: Float[np.ndarray, "channel time"],
    sample_rate: float,
    bands: Float[np.ndarray, "channel 2"],
) -> Float[np.ndarray, "channel time"]:
    """Return the envelope of each channel in its band [Hz].

    It is the magnitude of the analytic signal after `signals.band_limited`.
    """
    limited = []
    for row, (low, high) in zip(signal, bands, strict=True):
        low = max(low, MIN_EDGE_SHARE * sample_rate)
        limited.append(band_limited(row[None], sample_rate, low, high))
    return signal_envelope(np.concatenate(limited))


def envelope_spectrum(
    signal: Float[np.ndarray, "channel time"],
    sample_rate: float,
    band: tuple[float, float] | None = None,
) -> tuple[
    Float[np.ndarray, " frequency"],
    Float[np.ndarray, "channel frequency"],
    Float[np.ndarray, "channel 2"],
]:
    """Return frequencies [Hz], peak amplitudes of the envelope, and the band of each channel.

    A (1 + m cos) in the band reads A m.

    Parameters
    ----------
    band : edges [Hz] of the band whose envelope is taken; None takes the best band of each
        channel's kurtogram.

    Examples
    --------
    >>> time = np.arange(20000) / 10000
    >>> struck = (1 + 0.5 * np.cos(2 * np.pi * 30 * time)) * np.sin(2 * np.pi * 2000 * time)
    >>> frequency, amplitude, _ = envelope_spectrum(struck[None], 10000.0, (1500, 2500))
    >>> print(f"{frequency[60]:.0f} Hz: {amplitude[0, 60]:.2f}")
    30 Hz: 0.50
    """
    if band is None:
        bands = np.array([gram.band for gram in kurtograms(signal, sample_rate)], dtype=float)
    elif 0 <= band[0] < band[1] <= sample_rate / 2:
        bands = np.array([band] * len(signal), dtype=float)
    else:
        raise InputError(
            f"Band {band[0]:g} to {band[1]:g} Hz lies outside 0 to {sample_rate / 2:g} Hz "
            "(half the sample rate)."
        )

    frequency, amplitude = amplitude_spectrum(envelopes(signal, sample_rate, bands), sample_rate)
    return frequency, amplitude, bands
