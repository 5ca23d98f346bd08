"""Statistics of time signals: level, peaks and the shape of their distribution."""

import numpy as np
from jaxtyping import Float, Float64

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


def time_statistics(signal: Float[np.ndarray, "window time"]) -> Float64[np.ndarray, "window statistic"]:
    """The `TIME_STATISTICS` of each window; a ratio with a zero below it is 0."""
    mean = signal.mean(axis=1)
    deviation = signal.std(axis=1)
    magnitude = np.abs(signal)
    rms, peak, mean_absolute = np.sqrt((signal**2).mean(axis=1)), magnitude.max(axis=1), magnitude.mean(axis=1)
    standard = (signal - mean[:, None]) / np.where(deviation > 0, deviation, 1.0)[:, None]
    square = standard * standard  # a power of floats takes ten times as long as its products
    columns = (
        mean,
        deviation,
        rms,
        peak,
        np.ptp(signal, axis=1),
        mean_absolute,
        (square * standard).mean(axis=1),
        (square * square).mean(axis=1),
        _ratio(peak, rms),
        _ratio(rms, mean_absolute),
        _ratio(peak, mean_absolute),
        _ratio(peak, np.sqrt(magnitude).mean(axis=1) ** 2),
    )
    return np.stack(columns, axis=1)


def _ratio(
    above: Float64[np.ndarray, " window"], below: Float64[np.ndarray, " window"]
) -> Float64[np.ndarray, " window"]:
    return np.where(below > 0, above / np.where(below > 0, below, 1.0), 0.0)


def power_sums(centered: Float[np.ndarray, "channel time"]) -> Float64[np.ndarray, "4 channel"]:
    """Sums of the second, third and fourth powers of each channel's samples, and their largest square."""
    square = centered * centered
    third, fourth = np.einsum("ct,ct->c", square, centered), np.einsum("ct,ct->c", square, square)
    return np.stack([square.sum(axis=1), third, fourth, square.max(axis=1)])


def shape_statistics(sums: Float64[np.ndarray, "4 channel"], count: int) -> dict[str, Float64[np.ndarray, " channel"]]:
    """Level, peaks and shape of `count` samples without a mean, as of `TIME_STATISTICS`, by name.

    Parameters
    ----------
    sums : `power_sums` of the samples.
    """
    second, third, fourth = sums[:3] / count
    rms, peak = np.sqrt(second), np.sqrt(sums[3])
    return {
        "rms": rms, "peak": peak, "crest_factor": _ratio(peak, rms), "kurtosis": _ratio(fourth, second**2),
        "skewness": _ratio(third, rms**3),
    }  # fmt: skip
