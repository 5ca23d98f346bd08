"""Levenberg-Marquardt on logarithms: for one measurement and six values, the quickest way there."""

from dataclasses import dataclass, replace

import numpy as np
import scipy.optimize
import torch
from jaxtyping import Float

from swashtwin.calibration.methods.search import EXACT, History, Progress, Search
from swashtwin.calibration.objective.spectrum_objective import Objective
from swashtwin.foundation import InputError, one_thread, stream
from swashtwin.physics import SteadySolver

EXPECTED = 1.0
"""Loss that noise, model error and priors make expected: no other valley is looked for below it."""


@dataclass(frozen=True)
class GaussNewton:
    """Least squares with exact derivatives, from several starts, within bounds.

    Minimized is the sum of squares of (simulated - measured) / sigma over all lines, plus that of (coordinate - mean of
    its prior) / prior standard deviation: a value that the measurement does not determine stays in the middle of its
    bounds instead of drifting to one. Amplitudes are compared as they are, for on a decibel scale the lines near the
    noise rule."""

    starts: int = 4
    """At most so many: first the nominal values, then others drawn evenly over the logarithms within the bounds. The
    first that misses the lines by no more than is `EXPECTED`, priors counted, is the last."""
    most_iterations: int = 50
    """At most so many steps from each start."""
    solver: SteadySolver = EXACT
    """What solves the equations."""

    def __post_init__(self) -> None:
        if self.starts < 1 or self.most_iterations < 1:
            raise InputError(f"starts ({self.starts}) and most_iterations ({self.most_iterations}) must be at least 1.")

    def search(self, objective: Objective, *, seed: int, progress: Progress | None = None) -> Search:
        """Values of the best start; see `Calibrator`."""
        unknowns, generator = objective.unknowns, stream(seed, "gauss_newton", "starts")
        runs: list[Search] = []
        with one_thread():
            for number in range(self.starts):
                problem = LeastSquares(objective, self.solver)
                scipy.optimize.least_squares(
                    problem.residuals,
                    unknowns.start if number == 0 else generator.uniform(unknowns.lower, unknowns.upper),
                    problem.jacobian,
                    bounds=(unknowns.lower, unknowns.upper),
                    max_nfev=self.most_iterations,
                    xtol=1e-10,
                )
                runs.append(problem.search())
                least = min(run.history.least_loss for run in runs)
                is_found = least <= EXPECTED
                if progress is not None:
                    progress(self.starts if is_found else number + 1, self.starts, least)
                if is_found:
                    break
        best = min(runs, key=lambda run: run.history.least_loss)
        return replace(best, simulations=sum(run.simulations for run in runs))


class LeastSquares:
    """Residuals and their derivatives with respect to the coordinates searched; each point is simulated once."""

    def __init__(self, objective: Objective, solver: SteadySolver) -> None:
        self.objective, self.solver = objective, solver
        self._points: list[np.ndarray] = []
        self._losses: list[tuple[float, float, float]] = []
        self._last: tuple[bytes, np.ndarray, np.ndarray] = (b"", np.empty(0), np.empty((0, 0)))

    def search(self) -> Search:
        """The step of least penalized loss, and all steps so far.

        That loss is the root of (sum of squares of all residuals / number of lines): of the lines alone it is
        `Objective.weighted_loss`, and the negative logarithm of the posterior density is its square times half the
        number of lines.
        """
        weighted, penalized, gradient = np.array(self._losses).T
        points, best = np.array(self._points), int(np.argmin(penalized))
        history = History(weighted, np.zeros_like(weighted), points, best, penalized - weighted, gradient)
        return Search(points[best], history, len(points))

    def residuals(self, point: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " residual"]:
        """(simulated - measured) / sigma of each line, then (coordinate - center) / prior deviation."""
        return self._simulated(point)[0]

    def jacobian(self, point: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, "residual unknown"]:
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
            self._losses.append((float(np.sqrt(np.mean(lines**2))), penalized, float(np.linalg.norm(gradient))))
        return self._last[1], self._last[2]
