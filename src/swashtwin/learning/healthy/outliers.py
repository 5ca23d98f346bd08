"""Recordings among healthy ones that differ from the others."""

import numpy as np
from jaxtyping import Bool, Float, Float64, Int

from swashtwin.learning.healthy.nonconformity import (
    nonconformity_scores,
    squared_distances,
)
from swashtwin.signals import MAD_TO_STANDARD_DEVIATION

MAX_OUTLIER_SHARE = 0.2
"""Largest share of the recordings that is excluded: more of them are no exception but another state
of the machine.
"""
MAX_DEVIATIONS = 6.0
"""Standard deviations above the median of the inliers beyond which the cube root of a score is an
outlier's. Cube roots of chi-squares are nearly normal (Wilson and Hilferty 1931).
"""
MIN_RELATIVE_DEVIATION = 0.1
"""Minimum of that standard deviation, relative to the median."""


def find_inliers(
    band_powers: Float[np.ndarray, "recording band"], point: Int[np.ndarray, " recording"]
) -> Bool[np.ndarray, " recording"]:
    """Return which recordings, two or more of each point, are alike; the others are outliers.

    The first inliers are the half of each point nearest to the point's median. They grow and shrink
    (as in Rousseeuw and Van Driessen 1999, DOI 10.1080/00401706.1999.10485670) until every inlier
    has a score below the limit against the other inliers, and no other recording has. So outliers
    cannot hide one another. If a single recording of a point would remain, the whole point is an
    outlier.
    """
    is_inlier = _central_half(band_powers, point)
    for _ in range(len(band_powers)):
        roots = np.cbrt(scores_against(band_powers, point, is_inlier))
        median = np.median(roots[is_inlier])
        deviation = MAD_TO_STANDARD_DEVIATION * np.median(np.abs(roots[is_inlier] - median))
        deviation = max(deviation, MIN_RELATIVE_DEVIATION * median)

        is_near = roots <= median + MAX_DEVIATIONS * deviation
        is_near &= _count_at_point(point, is_near) > 1
        if np.array_equal(is_near, is_inlier) or not is_near.any():
            break
        is_inlier = is_near
    return is_inlier


def scores_against(
    band_powers: Float[np.ndarray, "recording band"],
    point: Int[np.ndarray, " recording"],
    is_inlier: Bool[np.ndarray, " recording"],
) -> Float64[np.ndarray, " recording"]:
    """Return the nonconformity score of each recording against the inliers without it.

    It is infinite if the recording's point has no inlier.
    """
    inliers = band_powers[is_inlier]
    scores = np.full(len(band_powers), np.inf)
    scores[is_inlier] = nonconformity_scores(inliers, point[is_inlier])

    count = _count_at_point(point, is_inlier)
    rows = np.flatnonzero(~is_inlier & (count > 0))
    if len(rows):
        means = np.stack(
            [band_powers[is_inlier & (point == point[row])].mean(axis=0) for row in rows]
        )
        # Scaled to the variance of one recording: the mean of m recordings scatters by 1 / m.
        scale = np.sqrt(count / (count + 1))[rows, None]
        change = (band_powers[rows] - means) * scale
        scores[rows] = squared_distances(inliers, point[is_inlier], change)
    return scores


def _count_at_point(
    point: Int[np.ndarray, " recording"], mask: Bool[np.ndarray, " recording"]
) -> Int[np.ndarray, " recording"]:
    """Return for each recording how many of a mask are of its point."""
    return np.bincount(point[mask], minlength=point.max() + 1)[point]


def _central_half(
    band_powers: Float[np.ndarray, "recording band"], point: Int[np.ndarray, " recording"]
) -> Bool[np.ndarray, " recording"]:
    """Return the recordings nearest to the median of their point: more than half of each point."""
    medians = np.stack([np.median(band_powers[point == index], axis=0) for index in point])
    change = band_powers - medians
    spread = np.sqrt(np.median(np.abs(change), axis=0) ** 2 + 1)
    distance = ((change / spread) ** 2).sum(axis=1)

    is_central = np.zeros(len(band_powers), dtype=bool)
    for index in np.unique(point):
        members = np.flatnonzero(point == index)
        nearest = members[np.argsort(distance[members])]
        is_central[nearest[: len(members) // 2 + 1]] = True
    return is_central
