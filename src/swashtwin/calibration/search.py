"""Searches: what methods share, Levenberg-Marquardt on logarithms, and bounds that are widened if
an optimum lies at one.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
import scipy.optimize
import torch
from jaxtyping import Float

from swashtwin.calibration.spectrum_objective import Objective
from swashtwin.calibration.unknowns import (
    DEFAULT_BOUND_FACTOR,
    VALUE_SLICE,
    SearchSpace,
    is_at_bound,
)
from swashtwin.foundation import InputError, one_thread, random_stream, short_repr
from swashtwin.physics import HarmonicBalance, SteadySolver
from swashtwin.pump import PARAMETER_SYMBOLS

EXACT_SOLVER: SteadySolver = HarmonicBalance()
"""The default solver of every method."""
Progress = Callable[[int, int, float], None]
"""Called with (steps done, total steps, loss)."""


@dataclass(frozen=True, eq=False)
class History:
    """History of a search, one entry a step."""

    spectrum_loss: Float[np.ndarray, " step"]
    """Distance of the spectra, as the method measures it."""
    boundary_loss: Float[np.ndarray, " step"]
    """Penalty for leaving the bounds; zero for methods that cannot leave them."""
    points: Float[np.ndarray, "step unknown"]
    """Coordinates, in the order of `Unknowns.names`: first the logarithms of the six values."""
    best_step: int
    """Step of minimum loss."""
    prior_loss: Float[np.ndarray, " step"]
    """What the priors add to the loss."""
    gradient_norm: Float[np.ndarray, " step"]
    """Norm of the gradient of the loss with respect to what the method moves: weights, or
    coordinates in units of their priors' deviations.
    """

    __repr__ = short_repr

    @property
    def loss(self) -> Float[np.ndarray, " step"]:
        """What the method minimized."""
        return self.spectrum_loss + self.boundary_loss + self.prior_loss

    @property
    def min_loss(self) -> float:
        """The minimum loss."""
        return float(self.loss[self.best_step])

    @property
    def values(self) -> Float[np.ndarray, "step 6"]:
        """Interface values, in the order of `pump.PARAMETERS`."""
        return np.exp(self.points[:, VALUE_SLICE])


@dataclass(frozen=True, eq=False)
class SearchResult:
    """Result of a method."""

    point: Float[np.ndarray, " unknown"]
    """Coordinates, in the order of `Unknowns.names`."""
    history: History
    """Course of the search."""
    simulations: int
    """Number of parameter sets that were simulated, with or without their gradient."""
    notes: tuple[str, ...] = ()
    """Notes that the user should read."""


@runtime_checkable
class Calibrator(Protocol):
    """A method that searches the values with which a twin comes nearest to a measurement."""

    def search(
        self, objective: Objective, *, seed: int, progress: Progress | None = None
    ) -> SearchResult:
        """Return the result of the search.

        The same seed on the same machine gives the same bits.
        """
        ...


EXPECTED_LOSS = 0.5
"""Loss, priors included, up to which a minimum is taken without comparing it with another start:
half of what noise and model error make expected. A twin in a wrong valley rarely reaches it.
"""
SAME_LOSS = 0.01
"""Relative difference of loss within which two starts count as having ended at one minimum."""
SCREENED_POINTS = 1024
"""Number of points from which further starts are selected; they are simulated in one batch, which
costs as much as some ten steps.
"""


@dataclass(frozen=True)
class GaussNewton:
    """Least squares with exact derivatives, from several starts, within bounds.

    The method minimizes the sum of squares of (simulated - measured) / sigma over all lines, plus
    that of (coordinate - mean of its prior) / prior standard deviation: a value that the
    measurement does not determine stays in the middle of its bounds instead of drifting to one.
    Amplitudes are compared on a linear scale, because on a decibel scale the lines near the noise
    would dominate.
    """

    starts: int = 4
    """Maximum number of starts: the nominal values, then the best of `SCREENED_POINTS` points drawn
    from what is known before. The search ends as soon as a start misses the lines by no more than
    `EXPECTED_LOSS`, or two starts end at the same minimum, the smallest so far.
    """
    max_iterations: int = 50
    """Maximum number of steps from each start."""
    solver: SteadySolver = EXACT_SOLVER
    """Solver of the equations of motion."""

    def __post_init__(self) -> None:
        if self.starts < 1 or self.max_iterations < 1:
            raise InputError(
                f"starts ({self.starts}) and max_iterations ({self.max_iterations}) must be at "
                "least 1."
            )

    def search(
        self, objective: Objective, *, seed: int, progress: Progress | None = None
    ) -> SearchResult:
        """Return the result of the best start; see `Calibrator`."""
        runs: list[SearchResult] = []
        with one_thread():
            starts = [objective.unknowns.start]
            for start_index in range(self.starts):
                if start_index == 1:
                    starts += select_starts(objective, self.starts - 1, seed=seed)
                runs.append(self._descend(objective, starts[start_index]))

                has_converged = _has_converged(runs)
                steps_done = start_index + 1
                if has_converged:
                    steps_done = self.starts
                if progress is not None:
                    min_loss = min(run.history.min_loss for run in runs)
                    progress(steps_done, self.starts, min_loss)
                if has_converged:
                    break

        best = min(runs, key=lambda run: run.history.min_loss)
        return replace(best, simulations=sum(run.simulations for run in runs))

    def _descend(self, objective: Objective, start: np.ndarray) -> SearchResult:
        """Return the result of one start."""
        problem = LeastSquares(objective, self.solver)
        scipy.optimize.least_squares(
            problem.residuals,
            start,
            problem.jacobian,
            bounds=(objective.unknowns.lower, objective.unknowns.upper),
            max_nfev=self.max_iterations,
            xtol=1e-10,
        )
        return problem.result()


def _has_converged(runs: list[SearchResult]) -> bool:
    """Return whether no further start is needed; see `GaussNewton.starts`."""
    losses = sorted(run.history.min_loss for run in runs)
    if losses[0] <= EXPECTED_LOSS:
        return True
    return len(losses) > 1 and losses[1] <= (1 + SAME_LOSS) * losses[0]


def select_starts(
    objective: Objective, count: int, *, seed: int
) -> list[Float[np.ndarray, " unknown"]]:
    """Return the `count` best of `SCREENED_POINTS` points drawn from what is known before.

    The best are those of smallest loss, priors included. Modes of the mounting on the wrong side of
    a line make separate valleys: a descent from the nominal values does not leave them, but among
    many points some lie in the right one.
    """
    unknowns = objective.unknowns
    points = unknowns.draw_starts(SCREENED_POINTS, random_stream(seed, "gauss_newton", "starts"))
    with torch.no_grad():
        line_loss = objective.weighted_loss(torch.as_tensor(points)).numpy()

    prior_squares = (((points - unknowns.center) / unknowns.deviation) ** 2).sum(axis=1)
    squares = line_loss**2 + prior_squares / objective.measured.numel()
    return list(points[np.argsort(squares)[:count]])


class LeastSquares:
    """Residuals and their derivatives with respect to the coordinates searched; each point is
    simulated once.
    """

    def __init__(self, objective: Objective, solver: SteadySolver) -> None:
        self.objective = objective
        self.solver = solver
        self._points: list[np.ndarray] = []
        self._losses: list[tuple[float, float, float]] = []
        # scipy asks for residuals and derivatives of a point separately; they are simulated once
        self._cached_point = b""
        self._cached_residuals = np.empty(0)
        self._cached_jacobian = np.empty((0, 0))

    def result(self) -> SearchResult:
        """Return the step of minimum penalized loss, and all steps so far.

        That loss is the root of (sum of squares of all residuals / number of lines): of the lines
        alone it is `Objective.weighted_loss`, and the negative logarithm of the posterior density
        is its square times half the number of lines.
        """
        weighted, penalized, gradient = np.array(self._losses).T
        points = np.array(self._points)
        best_step = int(np.argmin(penalized))
        history = History(
            spectrum_loss=weighted,
            boundary_loss=np.zeros_like(weighted),
            points=points,
            best_step=best_step,
            prior_loss=penalized - weighted,
            gradient_norm=gradient,
        )
        return SearchResult(points[best_step], history, len(points))

    def residuals(self, point: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " residual"]:
        """Return (simulated - measured) / sigma of each line, then (coordinate - center) / prior
        deviation.
        """
        self._simulate(point)
        return self._cached_residuals

    def jacobian(
        self, point: Float[np.ndarray, " unknown"]
    ) -> Float[np.ndarray, "residual unknown"]:
        """Return the derivatives of `residuals`."""
        self._simulate(point)
        return self._cached_jacobian

    def _simulate(self, point: np.ndarray) -> None:
        """Compute residuals and derivatives at `point`, unless it is the last one."""
        if self._cached_point == point.tobytes():
            return

        objective = self.objective
        unknowns = objective.unknowns
        observables, slope = objective.sensitivity(torch.as_tensor(point), solver=self.solver)
        line_residuals = ((observables - objective.measured) / objective.sigma).numpy()
        line_slopes = (slope / objective.sigma[:, None]).numpy()
        prior_residuals = (point - unknowns.center) / unknowns.deviation
        residuals = np.concatenate([line_residuals, prior_residuals])
        jacobian = np.concatenate([line_slopes, np.diag(1 / unknowns.deviation)])

        n_lines = len(line_residuals)
        weighted = float(np.sqrt(np.mean(line_residuals**2)))
        penalized = float(np.sqrt(np.sum(residuals**2) / n_lines))
        gradient = (jacobian.T @ residuals) * unknowns.deviation / (n_lines * penalized)

        self._points.append(point.copy())
        self._losses.append((weighted, penalized, float(np.linalg.norm(gradient))))
        self._cached_point = point.tobytes()
        self._cached_residuals = residuals
        self._cached_jacobian = jacobian


MAX_BOUND_FACTOR = 1000.0
"""Bounds are widened up to this factor from the nominal value."""
WIDENED = "the bounds were widened beyond a factor of 10, because the optimum touched one."
"""End of a note about widened bounds."""


def widening_search(
    objective: Objective,
    method: Calibrator,
    symbols: Collection[str],
    *,
    seed: int,
    progress: Progress | None = None,
) -> tuple[Objective, SearchResult]:
    """Return the result of a search whose bounds are widened as needed, and the objective with
    these bounds.

    The search is repeated within bounds tenfold wider for each of `symbols` that ends at a bound.
    The prior of a value is as wide as its bounds, so it widens with them. Each further search
    starts from the previous optimum. It ends if no such value touches a bound, or if all that do
    are at `MAX_BOUND_FACTOR`.
    """
    result = method.search(objective, seed=seed, progress=progress)
    simulations = result.simulations
    all_widened = set[str]()

    while widened := _find_bounds_to_widen(objective, result) & set(symbols):
        all_widened |= widened
        space = objective.unknowns.space
        factor = np.array(
            [
                DEFAULT_BOUND_FACTOR if symbol in widened else 1.0
                for symbol in PARAMETER_SYMBOLS.values()
            ]
        )
        # the priors widen with the bounds, but the search goes on from the optimum
        wider = SearchSpace(space.nominal, space.lower / factor, space.upper * factor)
        unknowns = replace(objective.unknowns, space=wider, initial_point=None)
        objective = replace(objective, unknowns=unknowns)
        from_optimum = replace(objective, unknowns=replace(unknowns, initial_point=result.point))

        result = method.search(from_optimum, seed=seed, progress=progress)
        simulations += result.simulations

    if all_widened:
        ordered = [symbol for symbol in PARAMETER_SYMBOLS.values() if symbol in all_widened]
        note = f"{', '.join(ordered)}: {WIDENED}"
        result = replace(result, simulations=simulations, notes=(*result.notes, note))
    return objective, result


def _find_bounds_to_widen(objective: Objective, result: SearchResult) -> set[str]:
    """Return the symbols of values that touch a bound which may still be widened."""
    space = objective.unknowns.space
    may_widen = space.upper / space.nominal < MAX_BOUND_FACTOR * (1 - 1e-9)
    touches = is_at_bound(result.point, objective.unknowns)[VALUE_SLICE]
    symbols = PARAMETER_SYMBOLS.values()
    return {symbol for symbol, widen in zip(symbols, may_widen & touches, strict=True) if widen}
