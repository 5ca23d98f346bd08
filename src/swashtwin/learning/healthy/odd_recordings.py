"""Odd recordings among healthy ones: which stand apart, and how much less a detector hears with them."""

import numpy as np
from jaxtyping import Bool, Float, Float64, Int

from swashtwin.learning.healthy.healthy_levels import RIDGE, nonconformity_scores, point_residuals, robust_spread

MOST_ODD = 0.2
"""Share of the recordings that is left out at most: more of them are no exception but another state of the machine."""
_SPREADS, _LEAST_SPREAD = 6.0, 0.1
"""A recording is odd where the cube root of its score is so many standard deviations above the median of the usual
ones; the deviation is at least so much of the median. Cube roots of chi-squares are nearly normal (Wilson and Hilferty
1931)."""


def usual_recordings(
    levels: Float[np.ndarray, "recording level"], point: Int[np.ndarray, " recording"]
) -> Bool[np.ndarray, " recording"]:
    """Which recordings, two or more of each point, are alike; the others are odd.

    From the half of each point that is nearest to the point's median the usual ones grow and shrink (as in Rousseeuw
    and Van Driessen 1999, DOI 10.1080/00401706.1999.10485670) until each has a score below the limit against the
    other usual ones, and no other recording has. So odd recordings cannot hide one another. A point of which one
    recording would be left is odd as a whole.
    """
    usual = _central_half(levels, point)
    for _ in range(len(levels)):
        scores = scores_against(levels, point, usual)
        root = np.cbrt(scores)
        middle = np.median(root[usual])
        deviation = max(1.4826 * np.median(np.abs(root[usual] - middle)), _LEAST_SPREAD * middle)
        near = root <= middle + _SPREADS * deviation
        near &= np.bincount(point[near], minlength=point.max() + 1)[point] > 1
        if np.array_equal(near, usual) or not near.any():
            break
        usual = near
    return usual


def scores_against(
    levels: Float[np.ndarray, "recording level"],
    point: Int[np.ndarray, " recording"],
    usual: Bool[np.ndarray, " recording"],
) -> Float64[np.ndarray, " recording"]:
    """Nonconformity score of each recording against the usual ones without it; infinite where its point has none."""
    scores = np.full(len(levels), np.inf)
    scores[usual] = nonconformity_scores(levels[usual], point[usual])
    count = np.bincount(point[usual], minlength=point.max() + 1)[point]
    other = ~usual & (count > 0)
    means = np.stack([levels[usual & (point == own)].mean(axis=0) for own in point[other]] or [levels[0]])
    change = (levels[other] - means[: other.sum()]) * np.sqrt(count / (count + 1))[other, None]
    scores[other] = _distance(levels[usual], point[usual], change)
    return scores


def least_rise(
    levels: Float[np.ndarray, "recording level"], point: Int[np.ndarray, " recording"], error_rate: float
) -> float:
    """Rise of a single level [dB] that lifts a usual recording to an alarm, in the median of the levels.

    The score is quadratic in the change: x² w = s - m, with w the score of a rise by 1 dB, s the score that an alarm
    takes at the false-alarm rate, and m the median score of the recordings.
    """
    scores = np.sort(nonconformity_scores(levels, point))
    needed = scores[-max(1, int(error_rate * (len(levels) + 1) + 1e-9))]
    rise = _distance(levels, point, np.eye(levels.shape[1]))
    return float(np.median(np.sqrt((needed - np.median(scores)) / rise)))


def _distance(
    levels: Float[np.ndarray, "recording level"],
    point: Int[np.ndarray, " recording"],
    change: Float[np.ndarray, "other level"],
) -> Float64[np.ndarray, " other"]:
    """Squared Mahalanobis distance of changes [dB], each of the variance of one recording: `nonconformity_scores`."""
    spread, ridge = robust_spread(levels, point), (len(levels) + 1) * RIDGE
    residual, scaled = point_residuals(levels, point)[0] / spread, change / spread
    along = residual @ scaled.T
    inner = np.linalg.solve(residual @ residual.T + ridge * np.eye(len(residual)), along)
    return np.asarray(((scaled**2).sum(axis=1) - (along * inner).sum(axis=0)) / ridge)


def _central_half(
    levels: Float[np.ndarray, "recording level"], point: Int[np.ndarray, " recording"]
) -> Bool[np.ndarray, " recording"]:
    """The recordings of each point that are nearest to its median in all levels together: more than half."""
    change = levels - np.stack([np.median(levels[point == own], axis=0) for own in point])
    spread = np.sqrt(np.median(np.abs(change), axis=0) ** 2 + 1)
    distance = ((change / spread) ** 2).sum(axis=1)
    central = np.zeros(len(levels), dtype=bool)
    for own in np.unique(point):
        members = np.flatnonzero(point == own)
        central[members[np.argsort(distance[members])][: len(members) // 2 + 1]] = True
    return central
