"""From windows to the recording they are of."""

from collections.abc import Sequence

import numpy as np
import scipy
from jaxtyping import Float, Float64, Int64

from swashtwin.learning.training.confidence import Confidence, pooled_temperature

_TEMPERATURES = (0.05, 100.0)
"""Bounds of the temperature."""
_STARTS = (1.0, 0.1)
"""Dependences that the search starts from; where no recording has two windows it stays at the first."""


def pooled_probabilities(
    probability: Float[np.ndarray, "window class"], confidence: Confidence | None = None
) -> Float[np.ndarray, " class"]:
    """Probability of each class for a whole recording, from the mean log-probability of its windows.

    With a confidence, the mean is scaled to as many independent windows as they are worth and to its temperature;
    without, the recording counts as a single window. The likeliest class is the same. NaN for each class where a window
    has no finite answer.
    """
    logarithm = np.log(np.maximum(probability, 1e-12)).mean(axis=0)
    share = np.exp(logarithm - logarithm.max())
    pooled = share / share.sum()
    return pooled if confidence is None else confidence.temperature_scaled(pooled, len(probability))


def window_counts(n_windows: int) -> tuple[int, ...]:
    """Powers of two below `n_windows`, and `n_windows`: what recordings are cut to.

    Examples
    --------
    >>> window_counts(12)
    (1, 2, 4, 8, 12)
    """
    return *(1 << power for power in range((n_windows - 1).bit_length())), n_windows


def fit_pooling(
    probability: Sequence[Float[np.ndarray, "window class"]], target: Int64[np.ndarray, " recording"]
) -> tuple[float, float]:
    """(temperature T, dependence ρ) of the least cross-entropy on recordings listened to for several times.

    Each recording is cut into consecutive blocks of 1, 2, 4, ... and all windows, and each of these times, then each
    recording, has the same weight. The targets are (n + 1)/(n + C) for the true class of n recordings and 1/(n + C) for
    each other. These are Laplace's shares: n recordings that are all told right are no proof of certainty (the
    multiclass form of Platt's targets, 1999). Without them T would fall to nothing there.

    Parameters
    ----------
    probability : of the windows of each recording, in order of time.
    target : index of the true class of each recording.
    """
    n, n_classes = len(probability), probability[0].shape[1]
    goal = np.full((n, n_classes), 1 / (n + n_classes))
    goal[np.arange(n), target] = (n + 1) / (n + n_classes)
    blocks = [_blocks(np.log(np.maximum(part, 1e-12))) for part in probability]
    mean, count, weight = (np.concatenate(part) for part in zip(*blocks, strict=True))
    goals = np.repeat(goal, [len(block[1]) for block in blocks], axis=0)

    def loss(parameters: Float64[np.ndarray, " 2"]) -> tuple[float, Float64[np.ndarray, " 2"]]:
        logarithm, dependence = parameters
        inverse = 1 / pooled_temperature(float(np.exp(logarithm)), float(dependence), count)
        log_share = scipy.special.log_softmax(inverse[:, None] * mean, axis=1)
        slope = weight * ((np.exp(log_share) - goals) * mean).sum(axis=1) * -inverse
        relative = (1 - 1 / count) / (dependence + (1 - dependence) / count)
        return float(-(weight @ (goals * log_share).sum(axis=1)) / n), np.array(
            [slope.sum() / n, (slope * relative).sum() / n]
        )

    low, high = np.log(_TEMPERATURES)
    fits = [
        scipy.optimize.minimize(loss, (0.0, start), jac=True, method="L-BFGS-B", bounds=((low, high), (0.0, 1.0)))
        for start in _STARTS
    ]
    best = min(fits, key=lambda fit: float(fit.fun))
    return float(np.exp(best.x[0])), float(best.x[1])


def _blocks(
    logarithm: Float64[np.ndarray, "window class"],
) -> tuple[Float64[np.ndarray, "block class"], Int64[np.ndarray, " block"], Float64[np.ndarray, " block"]]:
    """(mean log-probability, windows, weight) of each block of consecutive windows of one recording."""
    counts = window_counts(len(logarithm))
    starts = [np.arange(0, len(logarithm) - count + 1, count) for count in counts]
    means = [
        np.stack([logarithm[start : start + count].mean(axis=0) for start in first])
        for count, first in zip(counts, starts, strict=True)
    ]
    sizes = [len(first) for first in starts]
    weights = np.repeat([1 / (size * len(counts)) for size in sizes], sizes)
    return np.concatenate(means), np.repeat(counts, sizes).astype(np.int64), weights


def likeliest_class(probability: Float[np.ndarray, "*window class"]) -> Int64[np.ndarray, "*window"]:
    """Index of the likeliest class; -1 where a probability is no finite number, so that there is no verdict.

    Examples
    --------
    >>> likeliest_class(np.array([[0.2, 0.8], [np.nan, np.nan]])).tolist()
    [1, -1]
    """
    return np.where(np.isfinite(probability).all(axis=-1), probability.argmax(axis=-1), -1)
