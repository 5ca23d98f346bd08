"""Levenberg-Marquardt on logarithms: for one measurement and six values, the quickest way there."""

from dataclasses import dataclass

import numpy as np
import scipy.optimize
import torch
from jaxtyping import Float

from swashtwin.calibration.objective import Objective
from swashtwin.calibration.search import EXACT, History, Progress, Search, one_thread
from swashtwin.errors import InputError
from swashtwin.integrators import SteadySolver
from swashtwin.seeding import stream


@dataclass(frozen=True)
class GaussNewton:
    """Least squares with exact derivatives, from several starts, within bounds.

    Minimized is the sum of squares of (simulated - measured) / sigma over all lines, plus that of (coordinate - mean of
    its prior) / prior standard deviation: a value of which the measurement says nothing stays in the middle of its
    bounds instead of drifting to one. Amplitudes are compared as they are, for on a decibel scale the lines near the
    noise rule.
    """

    starts: int = 4
    """First the nominal values, then others drawn evenly over the logarithms within the bounds."""
    most_iterations: int = 50
    """At most so many steps from each start."""
    solver: SteadySolver = EXACT
    """What solves the equations."""

    def __post_init__(self) -> None:
        if self.starts < 1 or self.most_iterations < 1:
            raise InputError(f"starts ({self.starts}) and most_iterations ({self.most_iterations}) must be at least 1.")

    def search(self, objective: Objective, *, seed: int, progress: Progress | None = None) -> Search:
        """Values of the best start; see `Calibrator`."""
        problem, unknowns = LeastSquares(objective, self.solver), objective.unknowns
        generator = stream(seed, "gauss_newton", "starts")
        runs = []
        with one_thread():
            for number in range(self.starts):
                start = unknowns.start if number == 0 else generator.uniform(unknowns.lower, unknowns.upper)
                result = scipy.optimize.least_squares(
                    problem.residuals,
                    start,
                    problem.jacobian,
                    bounds=(unknowns.lower, unknowns.upper),
                    max_nfev=self.most_iterations,
                    xtol=1e-10,
                )
                runs.append((float(result.cost), result.x, problem.taken_trace()))
                if progress is not None:
                    progress(number + 1, self.starts, min(cost for cost, _, _ in runs))
        _, found, trace = min(runs, key=lambda run: run[0])
        losses = np.array([loss for loss, _ in trace])
        history = History(
            spectrum_loss=losses,
            boundary_loss=np.zeros_like(losses),
            points=np.array([point for _, point in trace]),
            best=int(np.argmin(losses)),
        )
        return Search(point=found, history=history, simulations=sum(len(steps) for _, _, steps in runs))


class LeastSquares:
    """Residuals and their derivatives with respect to the coordinates searched; each point is simulated once."""

    def __init__(self, objective: Objective, solver: SteadySolver) -> None:
        self.objective, self.solver = objective, solver
        self._trace: list[tuple[float, np.ndarray]] = []
        self._last: tuple[bytes, np.ndarray, np.ndarray] = (b"", np.empty(0), np.empty((0, 0)))

    def taken_trace(self) -> list[tuple[float, np.ndarray]]:
        """(weighted loss, point) of each simulation since the last call."""
        trace, self._trace = self._trace, []
        return trace

    def residuals(self, point: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " residual"]:
        """(simulated - measured) / sigma of each line, then (coordinate - center) / prior deviation."""
        return self._simulated(point)[0]

    def jacobian(self, point: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, "residual unknown"]:
        """Derivatives of `residuals`."""
        return self._simulated(point)[1]

    def _simulated(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if self._last[0] != point.tobytes():
            objective, unknowns = self.objective, self.objective.unknowns
            amplitude, slope = objective.sensitivity(torch.as_tensor(point), solver=self.solver)
            lines = ((amplitude - objective.measured) / objective.sigma).numpy()
            slopes = (slope / objective.sigma[:, None]).numpy()
            prior = (point - unknowns.center) / unknowns.deviation
            self._trace.append((float(np.sqrt(np.mean(lines**2))), point.copy()))
            jacobian = np.concatenate([slopes, np.diag(1 / unknowns.deviation)])
            self._last = (point.tobytes(), np.concatenate([lines, prior]), jacobian)
        return self._last[1], self._last[2]
