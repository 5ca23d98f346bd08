"""What is known after a calibration: the posterior, and an estimate of each value with interval and
verdict.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy.optimize
import torch
from jaxtyping import Float
from scipy.special import ndtr, ndtri

from swashtwin.calibration.discrepancy import (
    Linearization,
    estimate_discrepancy,
    linearize,
    noise_covariance,
)
from swashtwin.calibration.spectrum_objective import Objective
from swashtwin.calibration.unknowns import BOUND_MARGIN, CONSTANTS, VALUES, Unknowns, touched
from swashtwin.foundation import InputError, random_stream
from swashtwin.physics import Twin
from swashtwin.pump import PARAMETER_SYMBOLS, PARAMETERS, Interfaces

Verdict = Literal["identified", "weak", "not identified", "at bound"]

COVERAGE = 0.9
"""Probability with which an interval holds its value."""
QUANTILE = float(ndtri((1 + COVERAGE) / 2))
"""Standard deviations within which a normal density holds `COVERAGE`."""
IDENTIFIED_STD = 0.25
"""Standard deviation of ln value up to which a value is identified: 90 % within a factor of 1.5."""
UNIDENTIFIED_SHARE = 0.7
"""A posterior wider than this share of the prior has learned next to nothing from the
measurement.
"""


STRAINED = 2.5
"""Standard deviations of its prior by which a constant that is right is hardly ever off: the search
ends at 4.
"""
LARGE = 1.0
"""RMS of the missed lines, in what noise and the model error of `Comparison.sigma` make expected,
above which mistakes are sought that would explain it, and what rests on the twin is not called
identified.
"""
MISFIT = 2.0
"""The same from which the twin lacks something, so that its own values are not."""


@dataclass(frozen=True)
class Estimate:
    """One interface value, and how far to trust it."""

    name: str
    """Name as in `pump.PARAMETERS`."""
    symbol: str
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
    """The most probable range that holds the value with a probability of 90 %, within the bounds;
    it holds the value found, and ends at a bound where the measurement sets no limit on that side
    (`open_sides`).
    """
    bounds: tuple[float, float]
    """Where it was searched."""
    verdict: Verdict
    """``identified``; ``weak``: uncertain by more than a factor of 1.5, or the fit is in doubt
    (`is_in_doubt`); ``not
    identified``: the measurement hardly says more than the prior (the bounds, or the population of
    its type); ``at
    bound``: a bound stopped the search, often because a constant is wrong."""
    correlated_with: str | None = None
    """Letter of the value that can be changed along with it at almost the same spectrum
    (correlation above 0.9).
    """

    @property
    def is_constrained(self) -> bool:
        """Whether the measurement says more of the value than was known before."""
        return self.verdict in ("identified", "weak")

    @property
    def open_sides(self) -> tuple[bool, bool]:
        """Whether the interval is limited by nothing but the bound, below and above."""
        below, above = (
            math.isclose(end, bound, rel_tol=1e-9)
            for end, bound in zip(self.interval, self.bounds, strict=True)
        )
        return below, above


def posterior_covariance(
    objective: Objective, point: Float[np.ndarray, " unknown"]
) -> Float[np.ndarray, "unknown unknown"]:
    """Covariance of the coordinates found, about the truth.

    A search weighs every line by its own `Comparison.sigma`, as if errors were independent: with W
    those weights, J the sensitivities and P the priors' covariance it finds the truth plus H^-1 (J'
    W e + P^-1 d), H = J' W J + P^-1, where e is what the twin misses and d how far the truth is
    from the priors' means. Errors of a real machine are larger and shared by many lines, so e is
    given the covariance V of `discrepancy`, estimated from the residuals:

        H^-1 (J' W V W J + P^-1) H^-1

    (the sandwich of Huber 1967 and White 1982, doi:10.2307/1912526, with Kennedy and O'Hagan's
    discrepancy between). It is the Fisher information's inverse where the twin meets the lines as
    expected; no coordinate is less certain than its prior.
    """
    around = linearize(objective, point)
    return sandwich(around, noise_covariance(around, estimate_discrepancy(around)))


def sandwich(
    around: Linearization, noise: Float[np.ndarray, "observable observable"]
) -> Float[np.ndarray, "unknown unknown"]:
    """The same where the covariance of measured minus simulated amplitudes is known."""
    prior = around.objective.unknowns.deviation
    scaled = (
        around.slope / around.sigma[:, None] * prior
    )  # in units of the priors: well conditioned if one is flat
    weights = np.linalg.solve(
        scaled.T @ scaled + np.eye(len(prior)), np.hstack([scaled.T, np.eye(len(prior))])
    )
    errors, shift = weights[:, : len(scaled)], weights[:, len(scaled) :]
    covariance = (
        errors @ (noise / np.outer(around.sigma, around.sigma)) @ errors.T + shift @ shift.T
    )
    excess = prior / np.maximum(1.0, np.sqrt(np.diag(covariance)))
    return covariance * np.outer(excess, excess)


def build_estimates(
    objective: Objective,
    point: Float[np.ndarray, " unknown"],
    covariance: Float[np.ndarray, "unknown unknown"],
) -> tuple[Estimate, ...]:
    """Each of the six values with its interval and verdict."""
    space, in_doubt = (
        objective.unknowns.space,
        is_in_doubt(objective.unknowns, point, compute_misfit(objective, point)),
    )
    values, covariance, prior_std = (
        np.exp(point[VALUES]),
        covariance[VALUES, VALUES],
        objective.unknowns.deviation,
    )
    std = np.sqrt(np.diag(covariance))
    correlation = np.abs(covariance / np.outer(std, std)) - np.eye(len(PARAMETERS))
    partners = np.argmax(correlation, axis=1)
    return tuple(
        estimated(
            name,
            PARAMETER_SYMBOLS[name],
            "N*s/m" if name.endswith("damping") else "N/m",
            nominal=float(space.nominal[i]),
            value=float(values[i]),
            log_std=float(std[i]),
            prior_std=float(prior_std[i]),
            bounds=(float(space.lower[i]), float(space.upper[i])),
            in_doubt=in_doubt,
            correlated_with=PARAMETER_SYMBOLS[PARAMETERS[partners[i]]]
            if correlation[i, partners[i]] > 0.9
            else None,
        )
        for i, name in enumerate(PARAMETERS)
    )


def estimated(
    name: str,
    letter: str,
    unit: str,
    *,
    nominal: float,
    value: float,
    log_std: float,
    prior_std: float,
    bounds: tuple[float, float],
    in_doubt: bool,
    correlated_with: str | None = None,
) -> Estimate:
    """Estimate of a value whose logarithm had `prior_std` before, with its interval and verdict."""
    low, high = np.log(bounds)
    verdict: Verdict = "identified" if log_std <= IDENTIFIED_STD and not in_doubt else "weak"
    if min(math.log(value) - low, high - math.log(value)) < BOUND_MARGIN * (high - low):
        verdict = "at bound"
    elif log_std > UNIDENTIFIED_SHARE * prior_std:
        verdict = "not identified"
    interval = interval_around(value, log_std, bounds)
    return Estimate(
        name, letter, unit, nominal, value, log_std, interval, bounds, verdict, correlated_with
    )


def interval_around(
    value: float, log_std: float, bounds: tuple[float, float]
) -> tuple[float, float]:
    """The most probable 90 % of a normal density of ln value that the bounds cut: its middle is
    always within.
    """
    center, low, high = (float(np.log(each)) for each in (value, *bounds))
    below, above = (low - center) / log_std, (high - center) / log_std
    wanted = COVERAGE * (ndtr(above) - ndtr(below))

    def surplus(half: float) -> float:
        return float(ndtr(min(above, half)) - ndtr(max(below, -half)) - wanted)

    half = log_std * scipy.optimize.brentq(surplus, 0.0, max(above, -below))
    return math.exp(max(low, center - half)), math.exp(min(high, center + half))


def is_in_doubt(unknowns: Unknowns, point: Float[np.ndarray, " unknown"], misfit: float) -> bool:
    """Whether no value may be called identified: one lies on a bound, a constant is strained, or
    the misfit is large.

    See `strained_constants` and `MISFIT`.
    """
    at_bound = touched(point, unknowns)[VALUES].any()
    return bool(at_bound or strained_constants(unknowns, point)) or misfit > MISFIT


def strained_constants(unknowns: Unknowns, point: Float[np.ndarray, " unknown"]) -> tuple[str, ...]:
    """Constants that lie on a bound or farther than `STRAINED` from what was stated, by name, the
    farthest first.
    """
    away = np.abs(point - unknowns.center) / unknowns.deviation
    strained = (away > STRAINED) | touched(point, unknowns)
    order = [int(i) for i in np.argsort(-away) if strained[i] and i >= CONSTANTS.start]
    return tuple(unknowns.names[i] for i in order)


def compute_misfit(objective: Objective, point: Float[np.ndarray, " unknown"]) -> float:
    """RMS of the missed lines, in what was expected of them."""
    with torch.no_grad():
        return float(objective.weighted_loss(torch.as_tensor(point)))


_TRIES = 200
"""Number of draws beyond the bounds after which the last one is put on the bound."""


@dataclass(frozen=True, eq=False)
class Posterior:
    """Density of all coordinates searched: normal (Laplace's approximation), and cut at their
    bounds.
    """

    unknowns: Unknowns
    """What was searched."""
    point: Float[np.ndarray, " unknown"]
    """Coordinates found."""
    covariance: Float[np.ndarray, "unknown unknown"]
    """Their covariance; its first six rows are the logarithms of the six values."""

    def __repr__(self) -> str:
        return f"<Posterior: normal density of {', '.join(self.unknowns.names)}>"

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that were measured."""
        return self.unknowns.channels

    def twin_at(self, twin: Twin, point: Float[np.ndarray, " unknown"]) -> Twin:
        """`twin` with the values, scales and sensor path of `point`."""
        values = Interfaces.from_values(np.exp(point[VALUES]))
        path = self.unknowns.path_at(point, twin.pump.channels)
        moved = twin.with_interfaces(values, self.unknowns.scales_at(point))
        return moved if path is None else replace(moved, path=path)

    def draws(self, count: int, seed: int) -> Float[np.ndarray, "draw unknown"]:
        """Points drawn from the density; the same seed gives the same ones, whatever the count."""
        if count < 1:
            raise InputError(f"count ({count}) must be at least 1.")
        root, lower, upper = (
            np.linalg.cholesky(self.covariance),
            self.unknowns.lower,
            self.unknowns.upper,
        )
        points = []
        for index in range(count):
            rng = random_stream(seed, "posterior", index)
            for _ in range(_TRIES):
                point = self.point + root @ rng.standard_normal(len(self.point))
                if ((point >= lower) & (point <= upper)).all():
                    break
            points.append(np.clip(point, lower, upper))
        return np.stack(points)

    def twins(self, twin: Twin, count: int, seed: int) -> list[Twin]:
        """`twin` with the coordinates of each of `count` draws."""
        return [self.twin_at(twin, point) for point in self.draws(count, seed)]
