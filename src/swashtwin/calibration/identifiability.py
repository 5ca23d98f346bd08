"""How well a measurement determines each value: Fisher information from exact derivatives."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.stats
import torch
from jaxtyping import Float

from swashtwin.calibration.objective import Objective
from swashtwin.pump import LETTERS, PARAMETERS

Verdict = Literal["identified", "weak", "not identified", "at bound"]

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
    """Range that holds the value with a probability of 90 %, within the bounds."""
    bounds: tuple[float, float]
    """Where it was searched."""
    verdict: Verdict
    """``identified``; ``weak``: uncertain by more than a factor of 1.5; ``not identified``: the measurement hardly
    says more than the bounds; ``at bound``: a bound stopped the search, often because a constant is wrong."""
    traded_with: str | None = None
    """Letter of the value that can be changed along with it at almost the same spectrum (correlation above 0.9)."""


def posterior_covariance(
    objective: Objective, point: Float[np.ndarray, " unknown"]
) -> Float[np.ndarray, "unknown unknown"]:
    """Covariance of the coordinates at a solution, all constants that were not searched being taken as right.

    Inverse of the Fisher information J' W J plus the priors: for the six values the width of their bounds, for
    nuisances their own. Where the twin misses the lines by more than expected (`Comparison.sigma`), the information is
    divided by as much as the mean square exceeds 1.
    """
    amplitude, slope = objective.sensitivity(torch.as_tensor(point))
    misfit = float(((amplitude - objective.measured) / objective.sigma).square().mean())
    jacobian = (slope / objective.sigma[:, None]).numpy() / math.sqrt(max(1.0, misfit))
    prior = objective.unknowns.deviation
    scaled = jacobian * prior  # in units of the prior: well conditioned however flat a direction is
    covariance = np.linalg.inv(scaled.T @ scaled + np.eye(len(prior)))
    return covariance * np.outer(prior, prior)


def estimates_of(
    objective: Objective, point: Float[np.ndarray, " unknown"], covariance: Float[np.ndarray, "unknown unknown"]
) -> tuple[Estimate, ...]:
    """Each of the six values with its interval and verdict."""
    space = objective.space
    values, covariance = np.exp(point[:6]), covariance[:6, :6]
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
                verdict=_verdict(float(np.log(values[i])), float(std[i]), float(space.prior_std[i]), low, high),
                traded_with=LETTERS[PARAMETERS[partner]] if correlation[i, partner] > 0.9 else None,
            )
        )
    return tuple(found)


def _interval(center: float, std: float, low: float, high: float) -> tuple[float, float]:
    """90 % of a normal density of ln value that the bounds cut."""
    cut = scipy.stats.truncnorm((low - center) / std, (high - center) / std, loc=center, scale=std)
    return math.exp(cut.ppf(0.05)), math.exp(cut.ppf(0.95))


def _verdict(center: float, std: float, prior_std: float, low: float, high: float) -> Verdict:
    if min(center - low, high - center) < BOUND_MARGIN * (high - low):
        return "at bound"
    if std > UNIDENTIFIED_SHARE * prior_std:
        return "not identified"
    return "identified" if std <= IDENTIFIED_STD else "weak"
