"""How far one recording is from others, and how often a healthy one is as far: deviations and conformal p-values."""

import numpy as np
from jaxtyping import Float, Float64, Int

LEAST_SPREAD = 1.0
"""Standard deviation [dB] that every level has at least: mounting and temperature move it so much, whatever was
measured."""
_RIDGE = 1.0
"""Added to each level's variance, in units of it, in all directions: there are more levels than recordings."""


def point_residuals(
    levels: Float[np.ndarray, "recording level"], point: Int[np.ndarray, " recording"]
) -> tuple[Float64[np.ndarray, "recording level"], Float64[np.ndarray, " recording"]]:
    """(levels less the mean of their point, factor to the spread of a difference from the other recordings' mean).

    Of m recordings of a point the factor is sqrt(m / (m - 1)): residual times factor has the variance of one recording,
    at every point.
    """
    count = np.bincount(point)[point]
    sums = np.zeros((int(point.max()) + 1, levels.shape[1]))
    np.add.at(sums, point, levels)
    return levels - sums[point] / count[:, None], np.sqrt(count / (count - 1))


def robust_spread(
    levels: Float[np.ndarray, "recording level"], point: Int[np.ndarray, " recording"]
) -> Float64[np.ndarray, " level"]:
    """Standard deviation [dB] of each level within the points: 1.4826 times the median magnitude, and `LEAST_SPREAD`.

    Both are added as variances; every point has two recordings at least.
    """
    residual, factor = point_residuals(levels, point)
    magnitude = np.median(np.abs(residual * factor[:, None]), axis=0)
    return np.asarray(np.sqrt((1.4826 * magnitude) ** 2 + LEAST_SPREAD**2))


def nonconformity_scores(
    levels: Float[np.ndarray, "recording level"], point: Int[np.ndarray, " recording"]
) -> Float64[np.ndarray, " recording"]:
    """Nonconformity score of each recording: its squared Mahalanobis distance from all others of the set.

    d_i = n u_i' (R_i' R_i + n ρ I)^-1 u_i with u_i the recording's difference from the mean of the others at its point,
    over the spread of such a difference, R_i the residuals of the n others about their points' means, both in units of
    `robust_spread`, and ρ = 1. Leaving one out is done in closed form: with all residuals R of N = n + 1 recordings and
    h the diagonal of f² R R' (R R' + N ρ I)^-1, d is h / (1 - h) up to a factor. No order of the recordings matters, so
    the scores of exchangeable recordings are exchangeable.
    """
    residual, factor = point_residuals(levels, point)
    scaled = residual / robust_spread(levels, point)
    gram = scaled @ scaled.T
    share = np.linalg.solve(gram + len(gram) * _RIDGE * np.eye(len(gram)), gram)
    leverage = factor**2 * np.diag(share)
    return np.asarray(leverage / (1 - leverage))


def conformal_p_value(scores: Float[np.ndarray, " recording"]) -> float:
    """Share of the scores that are at least as high as the last, the last counted.

    Full conformal prediction (Vovk, Gammerman and Shafer 2005, DOI 10.1007/b106715): where the last recording is
    exchangeable with the others, it is at most e with a chance of at most e, for each e.

    Examples
    --------
    >>> conformal_p_value(np.array([0.1, 0.4, 0.2, 0.3]))
    0.5
    """
    return float(np.mean(scores >= scores[-1] * (1 - 1e-9)))
