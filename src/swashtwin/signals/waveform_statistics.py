"""Statistics of time signals: moments, peaks and the factors formed from them."""

import numpy as np
from jaxtyping import Float, Float64

from swashtwin.recordings import Recording

MAD_TO_STANDARD_DEVIATION = 1.4826
"""Standard deviation of Gaussian scatter over its median absolute deviation."""

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
"""Of x: mean, √(mean (x-m)²), √(mean x²), max|x|, max - min, mean|x|, third and fourth standardized
moment, peak / rms, rms / mean|x|, peak / mean|x|, peak / (mean √|x|)². The first six in the
signal's unit, the others without one.
"""


def time_statistics(
    signal: Float[np.ndarray, "window time"],
) -> Float64[np.ndarray, "window statistic"]:
    """Return the `TIME_STATISTICS` of each window; a ratio with a zero denominator is 0."""
    mean = signal.mean(axis=1)
    deviation = signal.std(axis=1)
    magnitude = np.abs(signal)
    rms = np.sqrt((signal**2).mean(axis=1))
    peak = magnitude.max(axis=1)
    mean_absolute = magnitude.mean(axis=1)

    standardized = (signal - mean[:, None]) / np.where(deviation > 0, deviation, 1.0)[:, None]
    # Products, because a power of an array takes ten times as long.
    square = standardized * standardized

    columns = (
        mean,
        deviation,
        rms,
        peak,
        np.ptp(signal, axis=1),
        mean_absolute,
        (square * standardized).mean(axis=1),
        (square * square).mean(axis=1),
        _safe_ratio(peak, rms),
        _safe_ratio(rms, mean_absolute),
        _safe_ratio(peak, mean_absolute),
        _safe_ratio(peak, np.sqrt(magnitude).mean(axis=1) ** 2),
    )
    return np.stack(columns, axis=1)


def recording_statistics(recording: Recording) -> dict[str, Float64[np.ndarray, " channel"]]:
    """Return rms, peak and the shape of each channel without its mean, by name.

    The names are those of `TIME_STATISTICS`. The recording is read in blocks, twice: the moments
    are about the mean of the whole.
    """
    mean = sum(block.signal.sum(axis=1) for block in recording.blocks()) / recording.n_samples

    power_sums = np.zeros((3, recording.n_channels))
    max_square = np.zeros(recording.n_channels)
    for block in recording.blocks():
        centered = block.signal - mean[:, None]
        square = centered * centered
        third_powers = np.einsum("ct,ct->c", square, centered)
        fourth_powers = np.einsum("ct,ct->c", square, square)
        power_sums += [square.sum(axis=1), third_powers, fourth_powers]
        max_square = np.maximum(max_square, square.max(axis=1))

    second, third, fourth = power_sums / recording.n_samples
    rms = np.sqrt(second)
    peak = np.sqrt(max_square)
    return {
        "rms": rms,
        "peak": peak,
        "crest_factor": _safe_ratio(peak, rms),
        "kurtosis": _safe_ratio(fourth, second**2),
        "skewness": _safe_ratio(third, rms**3),
    }


def _safe_ratio(
    numerator: Float64[np.ndarray, " entry"], denominator: Float64[np.ndarray, " entry"]
) -> Float64[np.ndarray, " entry"]:
    return np.where(denominator > 0, numerator / np.where(denominator > 0, denominator, 1.0), 0.0)
