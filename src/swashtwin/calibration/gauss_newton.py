"""Levenberg-Marquardt on logarithms: for one measurement and six values, the quickest way there."""

from dataclasses import dataclass

import numpy as np
import scipy.optimize
import torch
from jaxtyping import Float

from swashtwin.calibration.objective import Objective
from swashtwin.calibration.search import (
    EXACT,
    NUISANCE_PRIOR,
    NUISANCES,
    History,
    Progress,
    Search,
    free_logarithms,
    one_thread,
)
from swashtwin.errors import InputError
from swashtwin.integrators import SteadySolver
from swashtwin.seeding import stream
from swashtwin.twin import Scales


@dataclass(frozen=True)
class GaussNewton:
    """Least squares with exact derivatives, from several starts, within bounds.

    Minimized is the sum of squares of (simulated - measured) / sigma over all lines, plus that of (ln value - ln middle
    of its bounds) / prior standard deviation: a value of which the measurement says nothing stays in the middle instead
    of drifting to a bound. Amplitudes are compared as they are, for on a decibel scale the lines near the noise rule.
    """

    starts: int = 4
    """First the nominal values, then others drawn evenly over the logarithms within the bounds."""
    most_iterations: int = 50
    """At most so many steps from each start."""
    nuisances: tuple[str, ...] = ()
    """Constants searched as well, of ``mount``, ``bearing``, ``excitation``, ``sensor``: factors on the twin's."""
    solver: SteadySolver = EXACT
    """What solves the equations."""

    def __post_init__(self) -> None:
        if self.starts < 1 or self.most_iterations < 1:
            raise InputError(f"starts ({self.starts}) and most_iterations ({self.most_iterations}) must be at least 1.")
        for name in self.nuisances:
            if name not in NUISANCES:
                raise InputError(f"{name!r} is no nuisance; choose among {', '.join(NUISANCES)}.")

    def search(self, objective: Objective, *, seed: int, progress: Progress | None = None) -> Search:
        """Values of the best start; see `Calibrator`."""
        problem = LeastSquares(objective, self.nuisances, self.solver)
        generator = stream(seed, "gauss_newton", "starts")
        runs = []
        with one_thread():
            for number in range(self.starts):
                start = problem.start if number == 0 else generator.uniform(problem.lower, problem.upper)
                result = scipy.optimize.least_squares(
                    problem.residuals,
                    start,
                    problem.jacobian,
                    bounds=(problem.lower, problem.upper),
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
            values=np.exp([point[:6] for _, point in trace]),
            best=int(np.argmin(losses)),
        )
        return Search(
            values=np.exp(found[:6]),
            history=history,
            simulations=sum(len(steps) for _, _, steps in runs),
            scales=problem.scales(found),
            nuisances=self.nuisances,
        )


class LeastSquares:
    """Residuals and their derivatives with respect to the free logarithms; each point is simulated once."""

    def __init__(self, objective: Objective, nuisances: tuple[str, ...], solver: SteadySolver) -> None:
        self.objective, self.solver, self.nuisances = objective, solver, nuisances
        self.free = free_logarithms(nuisances)
        space = objective.space
        own = np.log(objective.twin.scales.values())
        self.own_scales = own
        free_scales = own[[index - 6 for index in self.free[6:]]]
        spread = np.array([NUISANCE_PRIOR[NUISANCES[index - 6]] for index in self.free[6:]])
        self.start = np.concatenate([np.log(space.nominal), free_scales])
        self.center = np.concatenate([space.log_center, free_scales])
        self.prior_std = np.concatenate([space.prior_std, spread])
        self.lower = np.concatenate([np.log(space.lower), free_scales - 4 * spread])
        self.upper = np.concatenate([np.log(space.upper), free_scales + 4 * spread])
        self._trace: list[tuple[float, np.ndarray]] = []
        self._last: tuple[bytes, np.ndarray, np.ndarray] = (b"", np.empty(0), np.empty((0, 0)))

    def taken_trace(self) -> list[tuple[float, np.ndarray]]:
        """(weighted loss, point) of each simulation since the last call."""
        trace, self._trace = self._trace, []
        return trace

    def scales(self, point: Float[np.ndarray, " free"]) -> Scales:
        """Factors on the constants at a point."""
        return Scales(*(float(value) for value in np.exp(self._log_scales(point))))

    def residuals(self, point: Float[np.ndarray, " free"]) -> Float[np.ndarray, " residual"]:
        """(simulated - measured) / sigma of each line, then (logarithm - center) / prior deviation."""
        return self._simulated(point)[0]

    def jacobian(self, point: Float[np.ndarray, " free"]) -> Float[np.ndarray, "residual free"]:
        """Derivatives of `residuals`."""
        return self._simulated(point)[1]

    def _log_scales(self, point: np.ndarray) -> np.ndarray:
        logs = self.own_scales.copy()
        logs[[index - 6 for index in self.free[6:]]] = point[6:]
        return logs

    def _simulated(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if self._last[0] != point.tobytes():
            objective = self.objective
            amplitude, slope = objective.sensitivity(
                torch.as_tensor(point[:6]), torch.as_tensor(self._log_scales(point)), self.free, solver=self.solver
            )
            lines = ((amplitude - objective.measured) / objective.sigma).reshape(-1).numpy()
            slopes = (slope / objective.sigma[..., None]).reshape(-1, len(self.free)).numpy()
            prior = (point - self.center) / self.prior_std
            self._trace.append((float(np.sqrt(np.mean(lines**2))), point.copy()))
            jacobian = np.concatenate([slopes, np.diag(1 / self.prior_std)])
            self._last = (point.tobytes(), np.concatenate([lines, prior]), jacobian)
        return self._last[1], self._last[2]
