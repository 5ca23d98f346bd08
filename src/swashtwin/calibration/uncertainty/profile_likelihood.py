"""A sum of squares, and how to walk along its valley: one coordinate held, the others where they fit best."""

from abc import ABC, abstractmethod

import numpy as np
import scipy.stats
from jaxtyping import Float

from swashtwin.calibration.uncertainty.identifiability_report import COVERAGE

THRESHOLD = float(scipy.stats.chi2.ppf(COVERAGE, 1))
"""Rise of the sum of squares at which an interval ends (Wilks)."""
_MOST_POINTS, _MOST_STEPS = 30, 12


class Valley(ABC):
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

    def descend(self, point: np.ndarray, held: int | None) -> tuple[np.ndarray, float]:
        """The lowest point reached from `point` with coordinate `held` kept, and its sum of squares."""
        residual, slope = self.at(point)
        damping = 1e-6
        for _ in range(_MOST_STEPS):
            step = self.step(point, residual, slope, held, damping)
            if 2 * -(residual @ slope @ step) - np.square(slope @ step).sum() < 0.01:
                break
            trial = point + step
            ahead, ahead_slope = self.at(trial)
            if ahead @ ahead < residual @ residual:
                point, residual, slope, damping = trial, ahead, ahead_slope, max(damping / 10, 1e-6)
            else:
                damping = max(10 * damping, 1e-3)
        return point, float(residual @ residual)

    def step(
        self, point: np.ndarray, residual: np.ndarray, slope: np.ndarray, held: int | None, damping: float
    ) -> np.ndarray:
        """A damped Gauss-Newton step that ends within the bounds; what stands on one and wants beyond stays."""
        downhill = -slope.T @ residual
        free = ~((point <= self.lower) & (downhill < 0) | (point >= self.upper) & (downhill > 0))
        if held is not None:
            free[held] = False
        step = np.zeros_like(point)
        part = slope[:, free]
        square = part.T @ part
        step[free] = np.linalg.solve(square + damping * np.diag(np.diag(square)), downhill[free])
        return np.clip(point + step, self.lower, self.upper) - point

    def along(self, slope: np.ndarray, held: int) -> np.ndarray:
        """How all coordinates go along the valley per unit of the held one."""
        others = np.arange(slope.shape[1]) != held
        direction = np.ones(slope.shape[1])
        direction[others] = -np.linalg.lstsq(slope[:, others], slope[:, held], rcond=None)[0]
        return direction


def walk(
    valley: Valley, best: Float[np.ndarray, " unknown"], least: float, held: int
) -> tuple[Float[np.ndarray, " point"], Float[np.ndarray, " point"]]:
    """Values of coordinate `held`, rising, and how far the least sum of squares over all others rises there.

    Parameters
    ----------
    best : where the sum of squares is `least`; the walk goes from there to both sides, until the rise is clear or a
        bound is met.
    """
    points = [(float(best[held]), least)]
    for side in (-1.0, 1.0):
        points += _side(valley, best, least, held, side)
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


def _side(valley: Valley, best: np.ndarray, least: float, held: int, side: float) -> list[tuple[float, float]]:
    """Points of one side, from the best on outwards."""
    reach = valley.upper[held] - valley.lower[held]
    end = valley.upper[held] if side > 0 else valley.lower[held]
    _, slope = valley.at(best)
    direction = valley.along(slope, held)
    stride = float(np.clip(0.8 / np.linalg.norm(slope @ direction), 1e-4 * reach, reach / 8))
    found: list[tuple[float, float]] = []
    point, height = best, least
    while len(found) < _MOST_POINTS and abs(point[held] - end) > 1e-9 and height < least + 1.3 * THRESHOLD:
        go = side * min(stride, abs(end - point[held]))
        ahead = np.clip(point + go * direction, valley.lower, valley.upper)
        last, behind = height, point
        point, height = valley.descend(ahead, held)
        direction = (point - behind) / go
        found.append((float(point[held]), height))
        if height - last < 0.3:
            stride = min(1.7 * stride, reach / 8)
        if abs(height - last) > 1.5:
            stride /= 1.5
    return found


def _crossing(coordinate: np.ndarray, rise: np.ndarray) -> float | None:
    """Where the root of the rise passes the threshold's, between two points."""
    beyond = np.flatnonzero(rise > THRESHOLD)
    if not len(beyond):
        return None
    last = int(beyond[0])
    roots = np.sqrt(rise[[last - 1, last]])
    share = (np.sqrt(THRESHOLD) - roots[0]) / (roots[1] - roots[0])
    return float(coordinate[last - 1] + share * (coordinate[last] - coordinate[last - 1]))
