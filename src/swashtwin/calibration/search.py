"""Searches: what methods share, Levenberg-Marquardt on logarithms, and bounds that grow where an
optimum is at one.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
import scipy.optimize
import torch
from jaxtyping import Float

from swashtwin.calibration.spectrum_objective import Objective
from swashtwin.calibration.unknowns import DEFAULT_FACTOR, VALUES, SearchSpace, touched
from swashtwin.foundation import InputError, one_thread, random_stream
from swashtwin.physics import HarmonicBalance, SteadySolver
from swashtwin.pump import PARAMETER_SYMBOLS, PARAMETERS

EXACT: SteadySolver = HarmonicBalance()
"""The solver of every method's default."""
Progress = Callable[[int, int, float], None]
"""Called with (steps done, steps in all, loss)."""


@dataclass(frozen=True, eq=False)
class History:
    """History of a search, one entry a step."""

    spectrum_loss: Float[np.ndarray, " step"]
    """Distance of the spectra, as the method measures it."""
    boundary_loss: Float[np.ndarray, " step"]
    """Penalty for leaving the bounds; zero for methods that cannot leave them."""
    points: Float[np.ndarray, "step unknown"]
    """Coordinates, in the order of `Unknowns.names`: first the logarithms of the six values."""
    best: int
    """Step of least loss."""
    prior_loss: Float[np.ndarray, " step"]
    """What the priors add to the loss."""
    gradient_norm: Float[np.ndarray, " step"]
    """Norm of the gradient of the loss with respect to what the method moves: weights, or
    coordinates in units of their priors' deviations.
    """

    @property
    def loss(self) -> Float[np.ndarray, " step"]:
        """What the method minimized."""
        return self.spectrum_loss + self.boundary_loss + self.prior_loss

    @property
    def min_loss(self) -> float:
        """The least loss."""
        return float(self.loss[self.best])

    @property
    def values(self) -> Float[np.ndarray, "step 6"]:
        """Interface values, in the order of `pump.PARAMETERS`."""
        return np.exp(self.points[:, VALUES])


@dataclass(frozen=True, eq=False)
class Search:
    """Result of a method."""

    point: Float[np.ndarray, " unknown"]
    """Coordinates, in the order of `Unknowns.names`."""
    history: History
    """Course of the search."""
    simulations: int
    """How many parameter sets were simulated, with or without their gradient."""
    notes: tuple[str, ...] = ()
    """What the user should look at, in words."""


@runtime_checkable
class Calibrator(Protocol):
    """A method that searches the values with which a twin comes nearest to a measurement."""

    def search(
        self, objective: Objective, *, seed: int, progress: Progress | None = None
    ) -> Search:
        """Result of the search. The same seed on the same machine gives the same bits."""
        ...


EXPECTED = 1.0
"""Loss that noise, model error and priors make expected: no other valley is looked for below it."""


@dataclass(frozen=True)
class GaussNewton:
    """Least squares with exact derivatives, from several starts, within bounds.

    Minimized is the sum of squares of (simulated - measured) / sigma over all lines, plus that of
    (coordinate - mean of its prior) / prior standard deviation: a value that the measurement does
    not determine stays in the middle of its bounds instead of drifting to one. Amplitudes are
    compared as they are, for on a decibel scale the lines near the noise rule."""

    starts: int = 4
    """At most so many: first the nominal values, then others drawn evenly over the logarithms
    within the bounds. The first that misses the lines by no more than is `EXPECTED`, priors
    counted, is the last.
    """
    max_iterations: int = 50
    """At most so many steps from each start."""
    solver: SteadySolver = EXACT
    """What solves the equations."""

    def __post_init__(self) -> None:
        if self.starts < 1 or self.max_iterations < 1:
            raise InputError(
                f"starts ({self.starts}) and max_iterations ({self.max_iterations}) must be at least 1."
            )

    def search(
        self, objective: Objective, *, seed: int, progress: Progress | None = None
    ) -> Search:
        """Values of the best start; see `Calibrator`."""
        unknowns, generator = objective.unknowns, random_stream(seed, "gauss_newton", "starts")
        runs: list[Search] = []
        with one_thread():
            for number in range(self.starts):
                problem = LeastSquares(objective, self.solver)
                scipy.optimize.least_squares(
                    problem.residuals,
                    unknowns.start
                    if number == 0
                    else generator.uniform(unknowns.lower, unknowns.upper),
                    problem.jacobian,
                    bounds=(unknowns.lower, unknowns.upper),
                    max_nfev=self.max_iterations,
                    xtol=1e-10,
                )
                runs.append(problem.search())
                least = min(run.history.min_loss for run in runs)
                is_found = least <= EXPECTED
                if progress is not None:
                    progress(self.starts if is_found else number + 1, self.starts, least)
                if is_found:
                    break
        best = min(runs, key=lambda run: run.history.min_loss)
        return replace(best, simulations=sum(run.simulations for run in runs))


class LeastSquares:
    """Residuals and their derivatives with respect to the coordinates searched; each point is
    simulated once.
    """

    def __init__(self, objective: Objective, solver: SteadySolver) -> None:
        self.objective, self.solver = objective, solver
        self._points: list[np.ndarray] = []
        self._losses: list[tuple[float, float, float]] = []
        self._last: tuple[bytes, np.ndarray, np.ndarray] = (b"", np.empty(0), np.empty((0, 0)))

    def search(self) -> Search:
        """The step of least penalized loss, and all steps so far.

        That loss is the root of (sum of squares of all residuals / number of lines): of the lines
        alone it is `Objective.weighted_loss`, and the negative logarithm of the posterior density
        is its square times half the number of lines.
        """
        weighted, penalized, gradient = np.array(self._losses).T
        points, best = np.array(self._points), int(np.argmin(penalized))
        history = History(
            weighted, np.zeros_like(weighted), points, best, penalized - weighted, gradient
        )
        return Search(points[best], history, len(points))

    def residuals(self, point: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " residual"]:
        """(simulated - measured) / sigma of each line, then (coordinate - center) / prior
        deviation.
        """
        return self._simulated(point)[0]

    def jacobian(
        self, point: Float[np.ndarray, " unknown"]
    ) -> Float[np.ndarray, "residual unknown"]:
        """Derivatives of `residuals`."""
        return self._simulated(point)[1]

    def _simulated(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if self._last[0] != point.tobytes():
            objective, unknowns = self.objective, self.objective.unknowns
            observables, slope = objective.sensitivity(torch.as_tensor(point), solver=self.solver)
            lines = ((observables - objective.measured) / objective.sigma).numpy()
            slopes = (slope / objective.sigma[:, None]).numpy()
            prior = (point - unknowns.center) / unknowns.deviation
            jacobian = np.concatenate([slopes, np.diag(1 / unknowns.deviation)])
            residuals = np.concatenate([lines, prior])
            self._last = (point.tobytes(), residuals, jacobian)
            penalized = float(np.sqrt(np.sum(residuals**2) / len(lines)))
            gradient = (jacobian.T @ residuals) * unknowns.deviation / (len(lines) * penalized)
            self._points.append(point.copy())
            self._losses.append(
                (float(np.sqrt(np.mean(lines**2))), penalized, float(np.linalg.norm(gradient)))
            )
        return self._last[1], self._last[2]


GREATEST_FACTOR = 1000.0
"""Bounds are widened up to this factor from the nominal value."""
WIDENED = "the bounds were widened beyond a factor of 10, as the optimum touched one."
"""How a note about widened bounds ends."""


def widening_search(
    objective: Objective,
    method: Calibrator,
    names: Collection[str],
    *,
    seed: int,
    progress: Progress | None = None,
) -> tuple[Objective, Search]:
    """Search, repeated within bounds tenfold wider for each of `names` that ends at one, and the
    objective it ended in.

    The prior of a value is as wide as its bounds, so it widens with them. Each further search
    starts from the optimum before. It ends where no such value touches a bound, or all that do are
    at `GREATEST_FACTOR`.
    """
    search = method.search(objective, seed=seed, progress=progress)
    simulations, widened = search.simulations, set[str]()
    while letters := _to_widen(objective, search, names):
        widened |= letters
        space = objective.unknowns.space
        factor = np.array(
            [DEFAULT_FACTOR if letter in letters else 1.0 for letter in PARAMETER_SYMBOLS.values()]
        )
        wider = SearchSpace(space.nominal, space.lower / factor, space.upper * factor)
        objective = replace(
            objective, unknowns=replace(objective.unknowns, space=wider, begun=None)
        )
        begun = replace(objective, unknowns=replace(objective.unknowns, begun=search.point))
        search = method.search(begun, seed=seed, progress=progress)
        simulations += search.simulations
    if widened:
        note = f"{', '.join(letter for letter in PARAMETER_SYMBOLS.values() if letter in widened)}: {WIDENED}"
        search = replace(search, simulations=simulations, notes=(*search.notes, note))
    return objective, search


def _to_widen(objective: Objective, search: Search, names: Collection[str]) -> set[str]:
    """Letters of values that touch a bound which may still be widened."""
    space = objective.unknowns.space
    may_grow = space.upper / space.nominal < GREATEST_FACTOR * (1 - 1e-9)
    at_bound = touched(search.point, objective.unknowns)[VALUES]
    letters = [PARAMETER_SYMBOLS[name] for name in PARAMETERS]
    return {
        letter for letter, grow, at in zip(letters, may_grow, at_bound, strict=True) if grow and at
    } & set(names)
