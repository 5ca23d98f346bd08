"""How well a measurement determines each value: Fisher information from exact derivatives."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.optimize
from jaxtyping import Float
from scipy.special import ndtr, ndtri

from swashtwin.calibration.objective.spectrum_objective import Objective
from swashtwin.calibration.uncertainty.discrepancy import Linearized, discrepancy_of, linearized, noise_covariance
from swashtwin.pump import LETTERS, PARAMETERS

Verdict = Literal["identified", "weak", "not identified", "at bound"]

COVERAGE = 0.9
"""Probability with which an interval holds its value."""
QUANTILE = float(ndtri((1 + COVERAGE) / 2))
"""Standard deviations within which a normal density holds `COVERAGE`."""
IDENTIFIED_STD = 0.25
"""Standard deviation of ln value up to which a value is identified: 90 % within a factor of 1.5."""
UNIDENTIFIED_SHARE = 0.7
"""A posterior wider than this share of the prior has learnt next to nothing from the measurement."""
BOUND_MARGIN = 1e-3
"""A value within this share of the bounds' logarithmic width from a bound lies on it."""


@dataclass(frozen=True)
class Estimate:
    """One interface value, and how far to trust it."""

    name: str
    """Name as in `pump.PARAMETERS`."""
    letter: str
    """The paper's letter."""
    unit: str
    """Unit of the values."""
    nominal: float
    """Value before."""
    value: float
    """Value found."""
    log_std: float
    """Standard deviation of ln value: 0.1 is 10 %."""
    interval: tuple[float, float]
    """The most probable range that holds the value with a probability of 90 %, within the bounds; it holds the value
    found, and ends at a bound where the measurement sets no limit on that side (`open_sides`)."""
    bounds: tuple[float, float]
    """Where it was searched."""
    verdict: Verdict
    """``identified``; ``weak``: uncertain by more than a factor of 1.5; ``not identified``: the measurement hardly
    says more than the prior (the bounds, or what is known of pumps of its type); ``at bound``: a bound stopped the
    search, often because a constant is wrong."""
    traded_with: str | None = None
    """Letter of the value that can be changed along with it at almost the same spectrum (correlation above 0.9)."""

    @property
    def open_sides(self) -> tuple[bool, bool]:
        """Whether the interval is limited by nothing but the bound, below and above."""
        below, above = (
            math.isclose(end, bound, rel_tol=1e-9) for end, bound in zip(self.interval, self.bounds, strict=True)
        )
        return below, above


def posterior_covariance(
    objective: Objective, point: Float[np.ndarray, " unknown"]
) -> Float[np.ndarray, "unknown unknown"]:
    """Covariance of the coordinates found, about the truth.

    A search weighs every line by its own `Comparison.sigma`, as if errors were independent: with W those weights,
    J the sensitivities and P the priors' covariance it finds the truth plus H^-1 (J' W e + P^-1 d), H = J' W J + P^-1,
    where e is what the twin misses and d how far the truth is from the priors' means. Errors of a real machine are
    larger and shared by many lines, so e is given the covariance V of `discrepancy`, estimated from the residuals:

        H^-1 (J' W V W J + P^-1) H^-1

    (the sandwich of Huber 1967 and White 1982, doi:10.2307/1912526, with Kennedy and O'Hagan's discrepancy between). It
    is the Fisher information's inverse where the twin meets the lines as expected; no coordinate is less certain than
    its prior.
    """
    around = linearized(objective, point)
    return sandwich(around, noise_covariance(around, discrepancy_of(around)))


def sandwich(around: Linearized, noise: Float[np.ndarray, "reading reading"]) -> Float[np.ndarray, "unknown unknown"]:
    """The same where the covariance of measured minus simulated amplitudes is known."""
    prior = around.objective.unknowns.deviation
    scaled = around.slope / around.sigma[:, None] * prior  # in units of the priors: well conditioned if one is flat
    weights = np.linalg.solve(scaled.T @ scaled + np.eye(len(prior)), np.hstack([scaled.T, np.eye(len(prior))]))
    errors, shift = weights[:, : len(scaled)], weights[:, len(scaled) :]
    covariance = errors @ (noise / np.outer(around.sigma, around.sigma)) @ errors.T + shift @ shift.T
    excess = prior / np.maximum(1.0, np.sqrt(np.diag(covariance)))
    return covariance * np.outer(excess, excess)


def estimates_of(
    objective: Objective, point: Float[np.ndarray, " unknown"], covariance: Float[np.ndarray, "unknown unknown"]
) -> tuple[Estimate, ...]:
    """Each of the six values with its interval and verdict."""
    space = objective.space
    values, covariance, prior_std = np.exp(point[:6]), covariance[:6, :6], objective.unknowns.deviation
    std = np.sqrt(np.diag(covariance))
    correlation = np.abs(covariance / np.outer(std, std)) - np.eye(6)
    found = []
    for i, name in enumerate(PARAMETERS):
        partner = int(np.argmax(correlation[i]))
        low, high = float(np.log(space.lower[i])), float(np.log(space.upper[i]))
        found.append(
            Estimate(
                name=name,
                letter=LETTERS[name],
                unit="N*s/m" if name.endswith("damping") else "N/m",
                nominal=float(space.nominal[i]),
                value=float(values[i]),
                log_std=float(std[i]),
                interval=_interval(float(np.log(values[i])), float(std[i]), low, high),
                bounds=(float(space.lower[i]), float(space.upper[i])),
                verdict=_verdict(float(np.log(values[i])), float(std[i]), float(prior_std[i]), low, high),
                traded_with=LETTERS[PARAMETERS[partner]] if correlation[i, partner] > 0.9 else None,
            )
        )
    return tuple(found)


def _interval(center: float, std: float, low: float, high: float) -> tuple[float, float]:
    """The most probable 90 % of a normal density of ln value that the bounds cut: its middle is always within."""
    below, above = (low - center) / std, (high - center) / std
    wanted = COVERAGE * (ndtr(above) - ndtr(below))

    def surplus(half: float) -> float:
        return float(ndtr(min(above, half)) - ndtr(max(below, -half)) - wanted)

    half = std * scipy.optimize.brentq(surplus, 0.0, max(above, -below))
    return math.exp(max(low, center - half)), math.exp(min(high, center + half))


def _verdict(center: float, std: float, prior_std: float, low: float, high: float) -> Verdict:
    if min(center - low, high - center) < BOUND_MARGIN * (high - low):
        return "at bound"
    if std > UNIDENTIFIED_SHARE * prior_std:
        return "not identified"
    return "identified" if std <= IDENTIFIED_STD else "weak"
