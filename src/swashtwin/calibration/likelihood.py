"""What a measurement says of the coordinates without any prior, the twin's discrepancy counted.

Lines are weighed by the covariance of `discrepancy`, which is larger than `Comparison.sigma` and shared by lines
wherever the twin misses them: only then does a measurement weigh against a prior of substance, such as that of a
population, as it deserves.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.optimize
from jaxtyping import Float

from swashtwin.calibration.discrepancy import discrepancy_of, linearized, noise_covariance
from swashtwin.calibration.objective import Objective
from swashtwin.calibration.population import Evidence

_MARGIN = 1e-6


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Density of what was measured, given the coordinates: normal with one covariance, whatever they are."""

    root: Float[np.ndarray, "reading reading"]
    """Lower triangular root of the covariance of measured minus simulated readings [m/s^2]."""

    @classmethod
    def around(cls, objective: Objective, point: Float[np.ndarray, " unknown"]) -> "Likelihood":
        """That with the discrepancy which the lines show at `point`."""
        around = linearized(objective, point)
        return cls(np.linalg.cholesky(noise_covariance(around, discrepancy_of(around))))

    def _whitened(self, objective: Objective, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals of unit variance, measured minus simulated, and derivatives of the simulated."""
        around = linearized(objective, point)
        both = scipy.linalg.solve_triangular(self.root, np.column_stack([around.residual, around.slope]), lower=True)
        return both[:, 0], both[:, 1:]

    def evidence(self, objective: Objective, point: Float[np.ndarray, " unknown"]) -> Evidence:
        """It as a quadratic function of the coordinates, around `point`."""
        residual, slope = self._whitened(objective, point)
        return Evidence(slope.T @ slope, slope.T @ (residual + slope @ point))

    def covariance(
        self, objective: Objective, point: Float[np.ndarray, " unknown"]
    ) -> Float[np.ndarray, "unknown unknown"]:
        """Covariance of the coordinates around `point` under the objective's priors."""
        deviation = objective.unknowns.deviation
        scaled = self.evidence(objective, point).information * np.outer(deviation, deviation)
        covariance: np.ndarray = np.linalg.inv(scaled + np.eye(len(deviation))) * np.outer(deviation, deviation)
        return (covariance + covariance.T) / 2

    def summit(
        self, objective: Objective, point: Float[np.ndarray, " unknown"], most_iterations: int = 20
    ) -> Float[np.ndarray, " unknown"]:
        """Where the posterior under the objective's priors is highest, within the bounds; sought from `point`."""
        unknowns = objective.unknowns
        kept: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

        def both(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            if at.tobytes() not in kept:
                kept.clear()
                residual, slope = self._whitened(objective, at)
                prior = (at - unknowns.center) / unknowns.deviation
                kept[at.tobytes()] = (
                    np.concatenate([-residual, prior]),
                    np.concatenate([slope, np.diag(1 / unknowns.deviation)]),
                )
            return kept[at.tobytes()]

        margin = _MARGIN * (unknowns.upper - unknowns.lower)
        found = scipy.optimize.least_squares(
            lambda at: both(at)[0],
            np.clip(point, unknowns.lower + margin, unknowns.upper - margin),
            lambda at: both(at)[1],
            bounds=(unknowns.lower, unknowns.upper),
            max_nfev=most_iterations,
            xtol=1e-6,
        )
        at: np.ndarray = found.x
        return at
