"""How far band powers of a recording are from those of healthy ones, and how rare that is.

Band powers are compared within a *point*: a machine at an operating point, given as an index for
each recording.
"""

import numpy as np
from jaxtyping import Float, Float64, Int

from swashtwin.signals import MAD_TO_STANDARD_DEVIATION

MIN_SPREAD_DB = 1.0
"""Minimum standard deviation [dB] of every band power: mounting and temperature change it by this
much, however little the recordings scatter.
"""
RIDGE = 1.0
"""Added to the variance of each band power, in units of it, in all directions: there are more band
powers than recordings.
"""


def point_residuals(
    band_powers: Float[np.ndarray, "recording band"], point: Int[np.ndarray, " recording"]
) -> tuple[Float64[np.ndarray, "recording band"], Float64[np.ndarray, " recording"]]:
    """Return band powers less the mean of their point, and a factor for each recording.

    For a point of m recordings the factor is sqrt(m / (m - 1)): a residual times its factor has the
    variance of one recording, at every point.
    """
    count = np.bincount(point)[point]
    sums = np.zeros((int(point.max()) + 1, band_powers.shape[1]))
    np.add.at(sums, point, band_powers)
    return band_powers - sums[point] / count[:, None], np.sqrt(count / (count - 1))


def robust_spread(
    band_powers: Float[np.ndarray, "recording band"], point: Int[np.ndarray, " recording"]
) -> Float64[np.ndarray, " band"]:
    """Return the standard deviation [dB] of each band power within the points.

    It is 1.4826 times the median magnitude, and `MIN_SPREAD_DB`, added as variances. Every point
    has two recordings or more.
    """
    residual, factor = point_residuals(band_powers, point)
    magnitude = np.median(np.abs(residual * factor[:, None]), axis=0)
    return np.asarray(np.sqrt((MAD_TO_STANDARD_DEVIATION * magnitude) ** 2 + MIN_SPREAD_DB**2))


def nonconformity_scores(
    band_powers: Float[np.ndarray, "recording band"], point: Int[np.ndarray, " recording"]
) -> Float64[np.ndarray, " recording"]:
    """Return the squared Mahalanobis distance of each recording from all others of the set.

    d_i = n u_i' (R_i' R_i + n ρ I)^-1 u_i with u_i the recording's difference from the mean of the
    others at its point, over the spread of such a difference, R_i the residuals of the n others
    about their points' means, both in units of `robust_spread`, and ρ = 1. Leaving one out is done
    in closed form: with all residuals R of N = n + 1 recordings and h the diagonal of f² R R' (R R'
    + N ρ I)^-1, d is h / (1 - h) up to a factor. No order of the recordings matters, so the scores
    of exchangeable recordings are exchangeable.
    """
    residual, factor = point_residuals(band_powers, point)
    scaled = residual / robust_spread(band_powers, point)
    gram = scaled @ scaled.T
    projection = np.linalg.solve(gram + len(gram) * RIDGE * np.eye(len(gram)), gram)
    leverage = factor**2 * np.diag(projection)
    return np.asarray(leverage / (1 - leverage))


def squared_distances(
    band_powers: Float[np.ndarray, "recording band"],
    point: Int[np.ndarray, " recording"],
    change: Float[np.ndarray, "other band"],
) -> Float64[np.ndarray, " other"]:
    """Return the squared Mahalanobis distance of changes [dB] from 0, as `nonconformity_scores`.

    Each change has the variance of one recording.
    """
    spread = robust_spread(band_powers, point)
    ridge = (len(band_powers) + 1) * RIDGE
    residual = point_residuals(band_powers, point)[0] / spread
    scaled = change / spread

    # Woodbury's identity: a matrix of recordings is solved for, which are fewer than band powers.
    products = residual @ scaled.T
    inner = np.linalg.solve(residual @ residual.T + ridge * np.eye(len(residual)), products)
    return np.asarray(((scaled**2).sum(axis=1) - (products * inner).sum(axis=0)) / ridge)


def conformal_p_value(scores: Float[np.ndarray, " recording"]) -> float:
    """Return the share of the scores that are at least as high as the last, the last counted.

    Full conformal prediction (Vovk, Gammerman and Shafer 2005, DOI 10.1007/b106715): if the last
    recording is exchangeable with the others, it is at most e with a chance of at most e, for each
    e.
    """
    # The tolerance counts equal scores as equal, up to rounding.
    return float(np.mean(scores >= scores[-1] * (1 - 1e-9)))


def detectable_rise(
    band_powers: Float[np.ndarray, "recording band"],
    point: Int[np.ndarray, " recording"],
    error_rate: float,
) -> float:
    """Return the rise of a single band power [dB] that raises an alarm, in the median of the bands.

    The score is quadratic in the change: x² w = s - m, with w the score of a rise by 1 dB, s the
    score that an alarm takes at the false-alarm rate, and m the median score of the recordings.
    """
    scores = np.sort(nonconformity_scores(band_powers, point))
    alarm_score = scores[-max(1, int(error_rate * (len(band_powers) + 1) + 1e-9))]
    score_per_rise = squared_distances(band_powers, point, np.eye(band_powers.shape[1]))
    return float(np.median(np.sqrt((alarm_score - np.median(scores)) / score_per_rise)))
