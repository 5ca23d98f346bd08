"""Envelope spectra: which rhythm a band of high frequencies is struck in."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import InputError
from swashtwin.signals.filtering import band_limited
from swashtwin.signals.indicators.kurtogram import kurtograms
from swashtwin.signals.spectra import amplitude_spectrum, signal_envelope


@dataclass(frozen=True, eq=False)
class EnvelopeSpectrum:
    """Spectrum of each channel's envelope."""

    frequency: Float[np.ndarray, " frequency"]
    """Frequencies [Hz]."""
    amplitude: Float[np.ndarray, "channel frequency"]
    """One-sided peak amplitude in the signal's unit: A (1 + m cos) in the band reads A m."""
    low: Float[np.ndarray, " channel"]
    """Lower edge of each channel's band [Hz]."""
    high: Float[np.ndarray, " channel"]
    """Upper edge of each channel's band [Hz]."""


def envelopes(
    signal: Float[np.ndarray, "channel time"], sample_rate: float, bands: Float[np.ndarray, "channel 2"]
) -> Float[np.ndarray, "channel time"]:
    """Envelope of each channel in its band [Hz]: the magnitude of the analytic signal after `signals.band_limited`."""
    limited = [
        band_limited(row[None], sample_rate, max(low, 1e-3 * sample_rate), high)
        for row, (low, high) in zip(signal, bands, strict=True)
    ]
    return signal_envelope(np.concatenate(limited))


def automatic_bands(
    signal: Float[np.ndarray, "channel time"], sample_rate: float, *, least_bandwidth: float = 0.0
) -> Float[np.ndarray, "channel 2"]:
    """Edges [Hz] of each channel's most impulsive band (`kurtogram`)."""
    return np.array([gram.band for gram in kurtograms(signal, sample_rate, least_bandwidth=least_bandwidth)])


def envelope_spectrum(
    signal: Float[np.ndarray, "channel time"],
    sample_rate: float,
    band: tuple[float, float] | None = None,
    *,
    resolution: float | None = None,
) -> EnvelopeSpectrum:
    """Amplitudes of the envelope, its mean removed, Hann taper corrected.

    Parameters
    ----------
    band : edges [Hz] of the band whose envelope is taken; None lets the kurtogram choose one for each channel.
    resolution : spacing of the lines [Hz]; None takes one segment over the whole signal.

    Raises
    ------
    InputError
        No such band at this sample rate.

    Examples
    --------
    >>> time = np.arange(20000) / 10000
    >>> struck = (1 + 0.5 * np.cos(2 * np.pi * 30 * time)) * np.sin(2 * np.pi * 2000 * time)
    >>> found = envelope_spectrum(struck[None], 10000.0, (1500, 2500))
    >>> print(f"{found.frequency[60]:.0f} Hz: {found.amplitude[0, 60]:.2f}")
    30 Hz: 0.50
    """
    if band is not None and not 0 <= band[0] < band[1] <= sample_rate / 2:
        raise InputError(
            f"a band of {band[0]:g}...{band[1]:g} Hz is none at {sample_rate:g} Hz; "
            f"it lies between 0 and half the sample rate ({sample_rate / 2:g} Hz)."
        )
    bands = automatic_bands(signal, sample_rate) if band is None else np.array([band] * len(signal), dtype=float)
    envelope = envelopes(signal, sample_rate, bands)
    frequency, amplitude = amplitude_spectrum(envelope, sample_rate, resolution)
    return EnvelopeSpectrum(frequency, amplitude, bands[:, 0], bands[:, 1])
