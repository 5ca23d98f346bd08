"""Profile likelihood: how much worse the best fit becomes when one coordinate is fixed at other
values.

A linearized interval sees only the neighborhood of the optimum; a profile follows the valley,
however bent, and shows if it never rises: then the value is not identified (Raue et al. 2009,
doi:10.1093/bioinformatics/btp358).
"""

import math
from abc import ABC, abstractmethod

import numpy as np
import scipy.stats
from jaxtyping import Float

from swashtwin.calibration.posterior import COVERAGE
from swashtwin.foundation import SwashTwinError

THRESHOLD = float(scipy.stats.chi2.ppf(COVERAGE, 1))
"""Rise of the sum of squares at which an interval ends (Wilks)."""

# Maximum number of points of one side of a profile.
_MAX_POINTS = 30

# Maximum number of steps of a descent.
_MAX_STEPS = 12

_MIN_DAMPING = 1e-6
_MIN_RAISED_DAMPING = 1e-3

# Expected fall of the sum of squares below which a descent has converged.
_NEGLIGIBLE_FALL = 0.01


class ProfileProblem(ABC):
    """Least squares within bounds; each point is simulated with its derivatives."""

    lower: Float[np.ndarray, " unknown"]
    """Lower bounds of the coordinates."""
    upper: Float[np.ndarray, " unknown"]
    """Upper bounds of the coordinates."""

    @abstractmethod
    def residuals_at(
        self, point: Float[np.ndarray, " unknown"]
    ) -> tuple[Float[np.ndarray, " residual"], Float[np.ndarray, "residual unknown"]]:
        """Return the residuals of unit variance at `point`, and their derivatives."""

    def descend(self, point: np.ndarray, fixed: int | None) -> tuple[np.ndarray, float]:
        """Return the lowest point reached from `point` with coordinate `fixed` unchanged, and its
        sum of squares.
        """
        residual, slope = self.residuals_at(point)
        damping = _MIN_DAMPING
        for _ in range(_MAX_STEPS):
            step = self._step(point, residual, slope, fixed, damping)
            expected_fall = 2 * -(residual @ slope @ step) - np.square(slope @ step).sum()
            if expected_fall < _NEGLIGIBLE_FALL:
                break

            trial = point + step
            try:
                trial_residual, trial_slope = self.residuals_at(trial)
            except SwashTwinError:
                # no pump runs like that, such as one that leaks all it displaces
                damping = max(10 * damping, _MIN_RAISED_DAMPING)
                continue

            if trial_residual @ trial_residual < residual @ residual:
                point = trial
                residual = trial_residual
                slope = trial_slope
                damping = max(damping / 10, _MIN_DAMPING)
            else:
                damping = max(10 * damping, _MIN_RAISED_DAMPING)
        return point, float(residual @ residual)

    def _step(
        self,
        point: np.ndarray,
        residual: np.ndarray,
        slope: np.ndarray,
        fixed: int | None,
        damping: float,
    ) -> np.ndarray:
        """Return a damped Gauss-Newton step within the bounds.

        A coordinate on a bound that the step would leave stays there.
        """
        downhill = -slope.T @ residual
        leaves_below = (point <= self.lower) & (downhill < 0)
        leaves_above = (point >= self.upper) & (downhill > 0)
        free = ~(leaves_below | leaves_above)
        if fixed is not None:
            free[fixed] = False

        free_slope = slope[:, free]
        square = free_slope.T @ free_slope
        step = np.zeros_like(point)
        step[free] = np.linalg.solve(square + damping * np.diag(np.diag(square)), downhill[free])
        return np.clip(point + step, self.lower, self.upper) - point


def profile_likelihood(
    problem: ProfileProblem, best: Float[np.ndarray, " unknown"], minimum: float, fixed: int
) -> tuple[Float[np.ndarray, " point"], Float[np.ndarray, " point"]]:
    """Return values of coordinate `fixed`, rising, and how far the minimum sum of squares over all
    other coordinates rises there.

    The walk goes from `best`, where the sum is `minimum`, to both sides, until the rise is clear or
    a bound is met.
    """
    points = [(float(best[fixed]), minimum)]
    for direction in (-1.0, 1.0):
        points += _walk(problem, best, minimum, fixed, direction)
    coordinate, height = np.array(sorted(points)).T
    return coordinate, height - height.min()


def find_interval(
    coordinate: Float[np.ndarray, " point"], rise: Float[np.ndarray, " point"]
) -> tuple[float, float]:
    """Return where the rise passes `THRESHOLD` below and above its minimum; infinite if it does
    not.
    """
    bottom = int(np.argmin(rise))
    below = _find_crossing(coordinate[bottom::-1], rise[bottom::-1])
    above = _find_crossing(coordinate[bottom:], rise[bottom:])
    return (
        -math.inf if below is None else below,
        math.inf if above is None else above,
    )


def _valley_direction(slope: np.ndarray, fixed: int) -> np.ndarray:
    """Return the direction along the valley, per unit of the fixed coordinate."""
    # a step of the fixed coordinate, and the steps of the others that undo it best
    is_other = np.arange(slope.shape[1]) != fixed
    direction = np.ones(slope.shape[1])
    direction[is_other] = -np.linalg.lstsq(slope[:, is_other], slope[:, fixed], rcond=None)[0]
    return direction


def _walk(
    problem: ProfileProblem, best: np.ndarray, minimum: float, fixed: int, side: float
) -> list[tuple[float, float]]:
    """Return the points of one side, from the best one outwards."""
    reach = problem.upper[fixed] - problem.lower[fixed]
    end = problem.upper[fixed]
    if side < 0:
        end = problem.lower[fixed]
    _, slope = problem.residuals_at(best)
    direction = _valley_direction(slope, fixed)
    stride = float(np.clip(0.8 / np.linalg.norm(slope @ direction), 1e-4 * reach, reach / 8))

    points: list[tuple[float, float]] = []
    point = best
    height = minimum
    while (
        len(points) < _MAX_POINTS
        and abs(point[fixed] - end) > 1e-9
        and height < minimum + 1.3 * THRESHOLD
    ):
        previous_point = point
        previous_height = height
        advance = side * min(stride, abs(end - point[fixed]))
        ahead = np.clip(point + advance * direction, problem.lower, problem.upper)
        try:
            point, height = problem.descend(ahead, fixed)
        except SwashTwinError:
            break  # no pump runs beyond
        direction = (point - previous_point) / advance
        points.append((float(point[fixed]), height))

        # strides that raise the sum by about 0.3 to 1.5 resolve the crossing of the threshold
        if height - previous_height < 0.3:
            stride = min(1.7 * stride, reach / 8)
        if abs(height - previous_height) > 1.5:
            stride /= 1.5
    return points


def _find_crossing(coordinate: np.ndarray, rise: np.ndarray) -> float | None:
    """Return where the root of the rise passes that of the threshold, between two points."""
    beyond = np.flatnonzero(rise > THRESHOLD)
    if not len(beyond):
        return None
    index = int(beyond[0])
    # near its minimum the rise is a parabola, so its root is a straight line
    roots = np.sqrt(rise[[index - 1, index]])
    share = (np.sqrt(THRESHOLD) - roots[0]) / (roots[1] - roots[0])
    return float(coordinate[index - 1] + share * (coordinate[index] - coordinate[index - 1]))
