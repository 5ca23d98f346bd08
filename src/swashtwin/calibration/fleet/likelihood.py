"""Likelihood of the coordinates without any prior, the twin's discrepancy counted.

A search weighs every line by its own `Comparison.sigma` (W), and so reads of a measurement no more than the scores
S = J' W e, one for each coordinate, where e is measured minus simulated and J the sensitivities at the point found. The
scores' covariance is J' W V W J with the covariance V of `discrepancy`, which is larger than sigma and shared by lines
wherever the twin misses them. With the scores as data a measurement weighs against a prior of substance, such as that
of a population, as it deserves (information of Godambe 1960, doi:10.1214/aoms/1177705693), and without one the point
is that of the search. Weighing the lines themselves by V was tried and left a spectrum error on the virtual rig a third
to twice as large: what the rig lacks is not as V has it, and lines that few others share then rule.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.optimize
from jaxtyping import Float

from swashtwin.calibration.fleet.population import Evidence
from swashtwin.calibration.objective.spectrum_objective import Objective
from swashtwin.calibration.uncertainty.discrepancy import estimate_discrepancy, linearize, noise_covariance

_MARGIN = 1e-6
_LEAST_VARIANCE = 1e-3
"""Added to a score's variance, for coordinates that no line depends on."""


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Density of what was measured, given the coordinates: normal, of scores whose weights stay as they are."""

    weights: Float[np.ndarray, "score observable"]
    """Weight [1/(m/s^2)] of each observable in each score, which has unit variance and depends on no other."""

    @classmethod
    def around(
        cls, objective: Objective, point: Float[np.ndarray, " unknown"], *, with_discrepancy: bool = True
    ) -> "Likelihood":
        """That of the scores at `point`.

        Parameters
        ----------
        with_discrepancy : count the discrepancy which the lines show there, beside the noise.
        """
        around = linearize(objective, point)
        noise = noise_covariance(around, estimate_discrepancy(around)) if with_discrepancy else np.diag(around.sigma**2)
        weights = (around.slope * objective.unknowns.deviation).T / around.sigma**2
        covariance = weights @ noise @ weights.T + _LEAST_VARIANCE * np.eye(len(weights))
        return cls(scipy.linalg.solve_triangular(np.linalg.cholesky(covariance), weights, lower=True))

    def _whitened(self, objective: Objective, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Scores, measured minus simulated, and derivatives of the simulated."""
        around = linearize(objective, point)
        return self.weights @ around.residual, self.weights @ around.slope

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

    def maximum(
        self, objective: Objective, point: Float[np.ndarray, " unknown"], most_iterations: int = 20
    ) -> Float[np.ndarray, " unknown"]:
        """Where the posterior under the objective's priors is highest, within the bounds; sought from `point`."""
        unknowns = objective.unknowns
        cache: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

        def residual_and_slope(position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            if position.tobytes() not in cache:
                cache.clear()
                residual, slope = self._whitened(objective, position)
                prior = (position - unknowns.center) / unknowns.deviation
                cache[position.tobytes()] = (
                    np.concatenate([-residual, prior]),
                    np.concatenate([slope, np.diag(1 / unknowns.deviation)]),
                )
            return cache[position.tobytes()]

        margin = _MARGIN * (unknowns.upper - unknowns.lower)
        result = scipy.optimize.least_squares(
            lambda position: residual_and_slope(position)[0],
            np.clip(point, unknowns.lower + margin, unknowns.upper - margin),
            lambda position: residual_and_slope(position)[1],
            bounds=(unknowns.lower, unknowns.upper),
            max_nfev=most_iterations,
            xtol=1e-6,
        )
        position: np.ndarray = result.x
        return position
