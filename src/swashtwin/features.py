"""Vibration features of windows: what an analyst would compute before any network.

Per channel, 82 numbers: 12 statistics of the time signal, the energies of 32 logarithmic frequency bands, 6 statistics
of the envelope, and the energies of 32 logarithmic bands of the envelope's spectrum.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64
from scipy.signal import hilbert

from swashtwin.windows import WindowSet

N_BANDS = 32
"""Logarithmic bands per spectrum."""

TIME_STATISTICS = (
    "mean",
    "deviation",
    "rms",
    "peak",
    "peak_to_peak",
    "mean_absolute",
    "skewness",
    "kurtosis",
    "crest_factor",
    "shape_factor",
    "impulse_factor",
    "clearance_factor",
)
"""Of x: mean, √(mean (x-m)²), √(mean x²), max|x|, max - min, mean|x|, third and fourth standardized moment, peak / rms,
rms / mean|x|, peak / mean|x|, peak / (mean √|x|)². The first six in the signal's unit, the others without one."""

ENVELOPE_STATISTICS = ("mean", "deviation", "rms", "skewness", "kurtosis", "crest_factor")
"""The same, of the envelope |x - m + i H(x - m)|, H being the Hilbert transform over the window."""


@dataclass(frozen=True, eq=False)
class FeatureTable:
    """Features of each window, and what each column is."""

    values: Float64[np.ndarray, "window feature"]
    """One row per window."""
    names: tuple[str, ...]
    """Name of each column: channel, part, feature."""


def extract_features(windows: WindowSet) -> FeatureTable:
    """The features of each window, channel after channel.

    Examples
    --------
    >>> from swashtwin.recording import Recording
    >>> from swashtwin.windows import cut_windows
    >>> noise = np.random.default_rng(0).normal(size=(1, 1024))
    >>> table = extract_features(cut_windows([Recording(noise, 1e4, "a")], length=512))
    >>> table.values.shape, table.names[2]
    ((2, 82), 'acceleration time rms')
    """
    parts, names = [], []
    for index, channel in enumerate(windows.channels):
        signal = windows.signal[:, index].astype(np.float64)
        envelope = np.abs(hilbert(signal - signal.mean(axis=1, keepdims=True), axis=1))
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


def time_statistics(signal: Float[np.ndarray, "window time"]) -> Float64[np.ndarray, "window statistic"]:
    """The `TIME_STATISTICS` of each window; a ratio with a zero below it is 0."""
    mean = signal.mean(axis=1)
    deviation = signal.std(axis=1)
    magnitude = np.abs(signal)
    rms, peak, mean_absolute = np.sqrt((signal**2).mean(axis=1)), magnitude.max(axis=1), magnitude.mean(axis=1)
    standard = (signal - mean[:, None]) / np.where(deviation > 0, deviation, 1.0)[:, None]
    columns = (
        mean,
        deviation,
        rms,
        peak,
        np.ptp(signal, axis=1),
        mean_absolute,
        (standard**3).mean(axis=1),
        (standard**4).mean(axis=1),
        _ratio(peak, rms),
        _ratio(rms, mean_absolute),
        _ratio(peak, mean_absolute),
        _ratio(peak, np.sqrt(magnitude).mean(axis=1) ** 2),
    )
    return np.stack(columns, axis=1)


def band_energies(
    signal: Float[np.ndarray, "window time"], n_bands: int = N_BANDS
) -> Float64[np.ndarray, "window band"]:
    """log10 of the mean square that falls into each of `n_bands` bands of equal ratio, mean removed, Hann taper.

    The bands reach from half the first spectral line to the last; a line that a band's edge cuts is shared in
    proportion, so that the lowest bands, narrower than a line, are never empty. Unit: log10 of the signal's, squared.
    """
    readings = signal.shape[1]
    taper = np.hanning(readings + 1)[:-1]
    spectrum = np.fft.rfft((signal - signal.mean(axis=1, keepdims=True)) * taper, axis=1)[:, 1:]
    power = 2 * np.abs(spectrum) ** 2 / (readings * np.sum(taper**2))
    line = np.arange(1, power.shape[1] + 1)
    edges = np.geomspace(0.5, line[-1] + 0.5, n_bands + 1)
    upper, lower = np.minimum(edges[1:, None], line + 0.5), np.maximum(edges[:-1, None], line - 0.5)
    return np.log10(np.maximum(power @ np.maximum(upper - lower, 0).T, 1e-30))


def _ratio(
    above: Float64[np.ndarray, " window"], below: Float64[np.ndarray, " window"]
) -> Float64[np.ndarray, " window"]:
    return np.where(below > 0, above / np.where(below > 0, below, 1.0), 0.0)
