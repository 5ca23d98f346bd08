"""Vibration features of windows: what an analyst would compute before any network.

Per channel, 82 numbers: 12 statistics of the time signal, the energies of 32 logarithmic frequency bands, 6 statistics
of the envelope, and the energies of 32 logarithmic bands of the envelope's spectrum.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64

from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.signals import (
    TIME_STATISTICS,
    band_shares,
    hann_taper,
    signal_envelope,
    tapered_transform,
    time_statistics,
)

N_BANDS = 32
"""Logarithmic bands per spectrum."""

ENVELOPE_STATISTICS = ("mean", "deviation", "rms", "skewness", "kurtosis", "crest_factor")
"""Those of the envelope |x - m + i H(x - m)|, H being the Hilbert transform over the window."""


@dataclass(frozen=True, eq=False)
class FeatureTable:
    """Features of each window, and what each column is."""

    values: Float[np.ndarray, "window feature"]
    """One row per window."""
    names: tuple[str, ...]
    """Name of each column: channel, part, feature."""


def extract_features(windows: WindowSet) -> FeatureTable:
    """The features of each window, channel after channel.

    Examples
    --------
    >>> from swashtwin.recordings.recording import Recording
    >>> from swashtwin.learning import cut_windows
    >>> noise = np.random.default_rng(0).normal(size=(1, 1024))
    >>> table = extract_features(cut_windows([Recording(noise, 1e4, "a")], length=512))
    >>> table.values.shape, table.names[2]
    ((2, 82), 'acceleration time rms')
    """
    parts, names = [], []
    for index, channel in enumerate(windows.channels):
        signal = windows.signal[:, index].astype(np.float64)
        envelope = signal_envelope(signal - signal.mean(axis=1, keepdims=True))
        parts += [
            time_statistics(signal),
            band_energies(signal),
            time_statistics(envelope)[:, [TIME_STATISTICS.index(name) for name in ENVELOPE_STATISTICS]],
            band_energies(envelope),
        ]
        names += [f"{channel} time {name}" for name in TIME_STATISTICS]
        names += [f"{channel} spectrum band {band}" for band in range(N_BANDS)]
        names += [f"{channel} envelope {name}" for name in ENVELOPE_STATISTICS]
        names += [f"{channel} envelope spectrum band {band}" for band in range(N_BANDS)]
    return FeatureTable(np.concatenate(parts, axis=1), tuple(names))


def band_energies(
    signal: Float[np.ndarray, "window time"], n_bands: int = N_BANDS
) -> Float64[np.ndarray, "window band"]:
    """log10 of the mean square that falls into each of `n_bands` bands of equal ratio, mean removed, Hann taper.

    The bands are those of `band_shares`. Unit: log10 of the signal's, squared.
    """
    length = signal.shape[1]
    spectrum = tapered_transform(signal)[:, 1:]
    power = 2 * np.abs(spectrum) ** 2 / (length * np.sum(hann_taper(length) ** 2))
    return np.log10(np.maximum(power @ band_shares(power.shape[1], n_bands), 1e-30))
