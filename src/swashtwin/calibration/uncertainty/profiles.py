"""Profile likelihood: how much worse the best fit becomes when one coordinate is fixed at other values.

A linearized interval sees only the neighborhood of the optimum; a profile follows the valley, however bent, and shows
where it never rises: there the value is not identified (Raue et al. 2009, doi:10.1093/bioinformatics/btp358).
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.stats
import torch
from jaxtyping import Float

from swashtwin.calibration.objective.spectrum_objective import Objective
from swashtwin.calibration.objective.unknowns import VALUES
from swashtwin.calibration.uncertainty.discrepancy import estimate_discrepancy, linearize, noise_covariance
from swashtwin.calibration.uncertainty.posterior import COVERAGE
from swashtwin.foundation import one_thread
from swashtwin.pump import PARAMETERS

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
        """The lowest point reached from `point` with coordinate `fixed` unchanged, and its sum of squares."""
        residual, slope = self.at(point)
        damping = 1e-6
        for _ in range(_MOST_STEPS):
            step = self.step(point, residual, slope, fixed, damping)
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
        self, point: np.ndarray, residual: np.ndarray, slope: np.ndarray, fixed: int | None, damping: float
    ) -> np.ndarray:
        """A damped Gauss-Newton step within the bounds; a coordinate on a bound that would leave it stays."""
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
    """Values of coordinate `fixed`, rising, and how far the least sum of squares over all others rises there.

    Parameters
    ----------
    best : where the sum of squares is `least`; the walk goes from there to both sides, until the rise is clear or a
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
    while len(points) < _MOST_POINTS and abs(point[fixed] - end) > 1e-9 and height < least + 1.3 * THRESHOLD:
        advance = side * min(stride, abs(end - point[fixed]))
        ahead = np.clip(point + advance * direction, problem.lower, problem.upper)
        last, behind = height, point
        point, height = problem.descend(ahead, fixed)
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


_WIDER = 10.0
"""By how much the priors of the six values are widened: so wide, they only keep flat valleys in place."""


@dataclass(frozen=True, eq=False)
class Profile:
    """The least misfit over all other coordinates, for values of one."""

    name: str
    """Letter of the value, or name of the nuisance, as in `Unknowns.names`."""
    coordinate: Float[np.ndarray, " point"]
    """Values at which it was fixed, rising: the logarithm, but for the residue of a housing mode."""
    rise: Float[np.ndarray, " point"]
    """Rise of the sum of squares above the least [1]: 2.71 ends the interval of 90 %."""
    best: float
    """Coordinate of the least."""
    interval: tuple[float | None, float | None]
    """Coordinates at which the rise passes the threshold; None where it does not before the bound."""
    bounds: tuple[float, float]
    """Where it was searched."""
    simulations: int
    """How many parameter sets were simulated, each with its derivatives."""

    @property
    def is_identified(self) -> bool:
        """Whether the interval closes on both sides."""
        return None not in self.interval

    @property
    def words(self) -> str:
        """What it says."""
        below, above = self.interval
        if self.is_identified:
            return f"{self.name}: closed on both sides"
        if below is None and above is None:
            return f"{self.name}: not identified, open on both sides"
        return f"{self.name}: only {'an upper' if below is None else 'a lower'} limit"


def profiles(
    objective: Objective, point: Float[np.ndarray, " unknown"], names: tuple[str, ...] | None = None
) -> tuple[Profile, ...]:
    """Profiles of several coordinates, of the six values by default.

    Each is walked from `point` to both sides, until the rise is clear or a bound is met.

    Lines are weighed by the covariance of `discrepancy` at `point`, so the least may lie beside it. Nuisances keep
    their priors, the six values have none but their bounds.
    """
    names = objective.unknowns.names[VALUES] if names is None else names
    problem = _WhitenedProblem(objective, point)
    with one_thread():
        best, least = problem.descend(np.asarray(point, dtype=float), fixed=None)
        result = [_profile_of(problem, best, least, objective.unknowns.names.index(name)) for name in names]
    return tuple(result)


class _WhitenedProblem(ProfileProblem):
    """Whitened least squares of all coordinates but one."""

    def __init__(self, objective: Objective, point: np.ndarray) -> None:
        around, unknowns = linearize(objective, point), objective.unknowns
        self.objective, self.lower, self.upper = objective, unknowns.lower, unknowns.upper
        self.root = np.linalg.cholesky(noise_covariance(around, estimate_discrepancy(around)))
        wider = np.where(np.arange(len(unknowns)) < len(PARAMETERS), _WIDER, 1.0)
        self.center, self.precision = unknowns.center, 1 / (unknowns.deviation * wider)
        self.simulations = 1

    def at(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals and their derivatives."""
        self.simulations += 1
        observables, slope = self.objective.sensitivity(torch.as_tensor(point))
        lines = scipy.linalg.solve_triangular(
            self.root, np.column_stack([(observables - self.objective.measured).numpy(), slope.numpy()]), lower=True
        )
        residual = np.concatenate([lines[:, 0], self.precision * (point - self.center)])
        return residual, np.concatenate([lines[:, 1:], np.diag(self.precision)])


def _profile_of(problem: _WhitenedProblem, best: np.ndarray, least: float, fixed: int) -> Profile:
    before = problem.simulations
    coordinate, rise = profile_likelihood(problem, best, least, fixed)
    return Profile(
        name=problem.objective.unknowns.names[fixed],
        coordinate=coordinate,
        rise=rise,
        best=float(coordinate[np.argmin(rise)]),
        interval=interval_of(coordinate, rise),
        bounds=(float(problem.lower[fixed]), float(problem.upper[fixed])),
        simulations=problem.simulations - before,
    )
