"""Profile likelihood: how much worse the best fit becomes when one coordinate is fixed at other
values.

A linearized interval sees only the neighborhood of the optimum; a profile follows the valley,
however bent, and shows where it never rises: there the value is not identified (Raue et al. 2009,
doi:10.1093/bioinformatics/btp358).
"""

from abc import ABC, abstractmethod

import numpy as np
import scipy.stats
from jaxtyping import Float

from swashtwin.calibration.posterior import COVERAGE
from swashtwin.foundation import SwashTwinError

THRESHOLD = float(scipy.stats.chi2.ppf(COVERAGE, 1))
"""Rise of the sum of squares at which an interval ends (Wilks)."""
_MOST_POINTS, _MOST_STEPS = 30, 12


class ProfileProblem(ABC):
    """Least squares within bounds; each point is simulated with its derivatives."""

    lower: Float[np.ndarray, " unknown"]
    """Least coordinates."""
    upper: Float[np.ndarray, " unknown"]
    """Greatest coordinates."""

    @abstractmethod
    def at(
        self, point: Float[np.ndarray, " unknown"]
    ) -> tuple[Float[np.ndarray, " residual"], Float[np.ndarray, "residual unknown"]]:
        """Residuals of unit variance at `point`, and their derivatives."""

    def descend(self, point: np.ndarray, fixed: int | None) -> tuple[np.ndarray, float]:
        """The lowest point reached from `point` with coordinate `fixed` unchanged, and its sum of
        squares.
        """
        residual, slope = self.at(point)
        damping = 1e-6
        for _ in range(_MOST_STEPS):
            step = self.step(point, residual, slope, fixed, damping)
            if 2 * -(residual @ slope @ step) - np.square(slope @ step).sum() < 0.01:
                break
            trial = point + step
            try:
                ahead, ahead_slope = self.at(trial)
            except (
                SwashTwinError
            ):  # no pump runs like that, such as one that leaks all it displaces
                damping = max(10 * damping, 1e-3)
                continue
            if ahead @ ahead < residual @ residual:
                point, residual, slope, damping = trial, ahead, ahead_slope, max(damping / 10, 1e-6)
            else:
                damping = max(10 * damping, 1e-3)
        return point, float(residual @ residual)

    def step(
        self,
        point: np.ndarray,
        residual: np.ndarray,
        slope: np.ndarray,
        fixed: int | None,
        damping: float,
    ) -> np.ndarray:
        """A damped Gauss-Newton step within the bounds; a coordinate on a bound that would leave it
        stays.
        """
        downhill = -slope.T @ residual
        free = ~((point <= self.lower) & (downhill < 0) | (point >= self.upper) & (downhill > 0))
        if fixed is not None:
            free[fixed] = False
        step = np.zeros_like(point)
        part = slope[:, free]
        square = part.T @ part
        step[free] = np.linalg.solve(square + damping * np.diag(np.diag(square)), downhill[free])
        return np.clip(point + step, self.lower, self.upper) - point

    def along(self, slope: np.ndarray, fixed: int) -> np.ndarray:
        """Direction along the valley, per unit of the fixed coordinate."""
        others = np.arange(slope.shape[1]) != fixed
        direction = np.ones(slope.shape[1])
        direction[others] = -np.linalg.lstsq(slope[:, others], slope[:, fixed], rcond=None)[0]
        return direction


def profile_likelihood(
    problem: ProfileProblem, best: Float[np.ndarray, " unknown"], least: float, fixed: int
) -> tuple[Float[np.ndarray, " point"], Float[np.ndarray, " point"]]:
    """Values of coordinate `fixed`, rising, and how far the least sum of squares over all others
    rises there.

    The walk goes from `best`, where the sum is `least`, to both sides, until the rise is clear or a
    bound is met.
    """
    points = [(float(best[fixed]), least)]
    for side in (-1.0, 1.0):
        points += _side(problem, best, least, fixed, side)
    coordinate, height = np.array(sorted(points)).T
    return coordinate, height - height.min()


def interval_of(
    coordinate: Float[np.ndarray, " point"], rise: Float[np.ndarray, " point"]
) -> tuple[float | None, float | None]:
    """Where the rise passes `THRESHOLD` below and above its least; None where it does not."""
    bottom = int(np.argmin(rise))
    return (
        _crossing(coordinate[bottom::-1], rise[bottom::-1]),
        _crossing(coordinate[bottom:], rise[bottom:]),
    )


def _side(
    problem: ProfileProblem, best: np.ndarray, least: float, fixed: int, side: float
) -> list[tuple[float, float]]:
    """Points of one side, from the best on outwards."""
    reach = problem.upper[fixed] - problem.lower[fixed]
    end = problem.upper[fixed] if side > 0 else problem.lower[fixed]
    _, slope = problem.at(best)
    direction = problem.along(slope, fixed)
    stride = float(np.clip(0.8 / np.linalg.norm(slope @ direction), 1e-4 * reach, reach / 8))
    points: list[tuple[float, float]] = []
    point, height = best, least
    while (
        len(points) < _MOST_POINTS
        and abs(point[fixed] - end) > 1e-9
        and height < least + 1.3 * THRESHOLD
    ):
        advance = side * min(stride, abs(end - point[fixed]))
        ahead = np.clip(point + advance * direction, problem.lower, problem.upper)
        last, behind = height, point
        try:
            point, height = problem.descend(ahead, fixed)
        except SwashTwinError:  # no pump runs beyond
            break
        direction = (point - behind) / advance
        points.append((float(point[fixed]), height))
        if height - last < 0.3:
            stride = min(1.7 * stride, reach / 8)
        if abs(height - last) > 1.5:
            stride /= 1.5
    return points


def _crossing(coordinate: np.ndarray, rise: np.ndarray) -> float | None:
    """Where the root of the rise passes the threshold's, between two points."""
    beyond = np.flatnonzero(rise > THRESHOLD)
    if not len(beyond):
        return None
    last = int(beyond[0])
    roots = np.sqrt(rise[[last - 1, last]])
    share = (np.sqrt(THRESHOLD) - roots[0]) / (roots[1] - roots[0])
    return float(coordinate[last - 1] + share * (coordinate[last] - coordinate[last - 1]))
