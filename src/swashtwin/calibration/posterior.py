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
from swashtwin.calibration.unknowns import (
    BOUND_MARGIN,
    CONSTANT_SLICE,
    VALUE_SLICE,
    Unknowns,
    is_at_bound,
)
from swashtwin.foundation import InputError, random_stream, shorten
from swashtwin.physics import Twin
from swashtwin.pump import PARAMETER_SYMBOLS, PARAMETERS, Interfaces

Verdict = Literal["identified", "weak", "not identified", "at bound"]

COVERAGE = 0.9
"""Probability with which an interval contains its value."""
NORMAL_QUANTILE = float(ndtri((1 + COVERAGE) / 2))
"""Standard deviations within which a normal density holds `COVERAGE`."""
IDENTIFIED_STD = 0.25
"""Standard deviation of ln value up to which a value is identified: 90 % within a factor of 1.5."""
UNIDENTIFIED_SHARE = 0.7
"""A posterior wider than this share of the prior has learned next to nothing from the
measurement.
"""
CORRELATED = 0.9
"""Correlation above which two values are reported as correlated."""
STRAINED_STDS = 2.5
"""Standard deviations of its prior by which a constant that is right is hardly ever off: the search
ends at 4.
"""
DOUBTFUL_MISFIT = 1.0
"""RMS of the missed lines, relative to what noise and the model error of `Comparison.sigma` make
expected, above which mistakes are searched that would explain it, and nothing that rests on the
twin is called identified.
"""
MAX_MISFIT = 2.0
"""The same above which the twin lacks something, so that its six values are not called identified
either.
"""


@dataclass(frozen=True)
class Estimate:
    """One interface value, and how far to trust it."""

    name: str
    """Name as in `pump.PARAMETERS`."""
    symbol: str
    """The paper's symbol."""
    unit: str
    """Unit of the values."""
    nominal: float
    """Nominal value, before calibration."""
    value: float
    """Calibrated value."""
    log_std: float
    """Standard deviation of ln value: 0.1 is 10 %."""
    interval: tuple[float, float]
    """The most probable range that contains the value with a probability of 90 %, within the
    bounds; it contains the calibrated value, and ends at a bound if the measurement sets no limit
    on that side (`open_sides`).
    """
    bounds: tuple[float, float]
    """Bounds of the search."""
    verdict: Verdict
    """``identified``; ``weak``: uncertain by more than a factor of 1.5, or the fit is in doubt
    (`is_in_doubt`, or a mistake is suspected); ``not identified``: the measurement hardly adds to
    the prior (the bounds, or the population of its type); ``at bound``: a bound stopped the search,
    often because a constant is wrong.
    """
    correlated_with: str | None = None
    """Symbol of the value that can change with this one at almost the same spectrum (correlation
    above 0.9).
    """

    def __repr__(self) -> str:
        low, high = self.interval
        return (
            f"<Estimate {self.symbol}: {self.value:.3g} {self.unit}, 90 % interval {low:.3g} to "
            f"{high:.3g}, {self.verdict}>"
        )

    @property
    def is_constrained(self) -> bool:
        """Whether the measurement adds to what was known of the value before."""
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
    """Return the covariance of the calibrated coordinates about the truth.

    A search weighs every line by its `Comparison.sigma`, as if errors were independent: with W
    those weights, J the sensitivities and P the priors' covariance it finds the truth plus H^-1 (J'
    W e + P^-1 d), H = J' W J + P^-1, where e is what the twin misses and d how far the truth is
    from the priors' means. Errors of a real machine are larger and shared by many lines, so e is
    given the covariance V of `discrepancy`, estimated from the residuals:

        H^-1 (J' W V W J + P^-1) H^-1

    (the sandwich of Huber 1967 and White 1982, doi:10.2307/1912526, with Kennedy and O'Hagan's
    discrepancy between). It is the Fisher information's inverse if the twin meets the lines as
    expected; no coordinate is less certain than its prior.
    """
    linearization = linearize(objective, point)
    discrepancy = estimate_discrepancy(linearization)
    return sandwich_covariance(linearization, noise_covariance(linearization, discrepancy))


def sandwich_covariance(
    linearization: Linearization, noise: Float[np.ndarray, "observable observable"]
) -> Float[np.ndarray, "unknown unknown"]:
    """Return what `posterior_covariance` does for a known covariance of the observables' errors."""
    prior = linearization.objective.unknowns.deviation
    sigma = linearization.sigma
    identity = np.eye(len(prior))

    # in units of the priors, the system is well conditioned even if one of them is flat
    scaled_slope = linearization.slope / sigma[:, None] * prior
    weights = np.linalg.solve(
        scaled_slope.T @ scaled_slope + identity, np.hstack([scaled_slope.T, identity])
    )
    error_weights = weights[:, : len(scaled_slope)]
    prior_weights = weights[:, len(scaled_slope) :]
    covariance = (
        error_weights @ (noise / np.outer(sigma, sigma)) @ error_weights.T
        + prior_weights @ prior_weights.T
    )

    # no coordinate is less certain than its prior
    scale = prior / np.maximum(1.0, np.sqrt(np.diag(covariance)))
    return covariance * np.outer(scale, scale)


def build_estimates(
    objective: Objective,
    point: Float[np.ndarray, " unknown"],
    covariance: Float[np.ndarray, "unknown unknown"],
    *,
    has_suspected_mistake: bool = False,
) -> tuple[Estimate, ...]:
    """Return each of the six values with its interval and verdict.

    Parameters
    ----------
    has_suspected_mistake : whether a mistake was found that would explain what the lines miss; no
        value is then called identified.
    """
    unknowns = objective.unknowns
    in_doubt = has_suspected_mistake or is_in_doubt(
        unknowns, point, compute_misfit(objective, point)
    )
    values = np.exp(point[VALUE_SLICE])
    value_covariance = covariance[VALUE_SLICE, VALUE_SLICE]
    std = np.sqrt(np.diag(value_covariance))
    correlation = np.abs(value_covariance / np.outer(std, std)) - np.eye(len(PARAMETERS))

    estimates = []
    for index, name in enumerate(PARAMETERS):
        partner = int(np.argmax(correlation[index]))
        correlated_with = None
        if correlation[index, partner] > CORRELATED:
            correlated_with = PARAMETER_SYMBOLS[PARAMETERS[partner]]

        estimates.append(
            build_estimate(
                name,
                PARAMETER_SYMBOLS[name],
                "N*s/m" if name.endswith("damping") else "N/m",
                nominal=float(unknowns.space.nominal[index]),
                value=float(values[index]),
                log_std=float(std[index]),
                prior_std=float(unknowns.deviation[index]),
                bounds=(float(unknowns.space.lower[index]), float(unknowns.space.upper[index])),
                in_doubt=in_doubt,
                correlated_with=correlated_with,
            )
        )
    return tuple(estimates)


def build_estimate(
    name: str,
    symbol: str,
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
    """Return the estimate of a value whose logarithm had `prior_std` before, with its interval and
    verdict.
    """
    low, high = np.log(bounds)
    bound_distance = min(math.log(value) - low, high - math.log(value))

    verdict: Verdict
    if bound_distance < BOUND_MARGIN * (high - low):
        verdict = "at bound"
    elif log_std > UNIDENTIFIED_SHARE * prior_std:
        verdict = "not identified"
    elif log_std <= IDENTIFIED_STD and not in_doubt:
        verdict = "identified"
    else:
        verdict = "weak"

    return Estimate(
        name=name,
        symbol=symbol,
        unit=unit,
        nominal=nominal,
        value=value,
        log_std=log_std,
        interval=compute_interval(value, log_std, bounds),
        bounds=bounds,
        verdict=verdict,
        correlated_with=correlated_with,
    )


def compute_interval(
    value: float, log_std: float, bounds: tuple[float, float]
) -> tuple[float, float]:
    """Return the most probable 90 % of a normal density of ln value that the bounds cut.

    Its middle always lies within.
    """
    center = float(np.log(value))
    low, high = (float(np.log(bound)) for bound in bounds)
    below = (low - center) / log_std
    above = (high - center) / log_std
    required = COVERAGE * (ndtr(above) - ndtr(below))

    def surplus(half_width: float) -> float:
        return float(ndtr(min(above, half_width)) - ndtr(max(below, -half_width)) - required)

    # in standard deviations a normal density is symmetric, so one half width is searched
    half_width = log_std * scipy.optimize.brentq(surplus, 0.0, max(above, -below))
    return math.exp(max(low, center - half_width)), math.exp(min(high, center + half_width))


def is_in_doubt(unknowns: Unknowns, point: Float[np.ndarray, " unknown"], misfit: float) -> bool:
    """Return whether no value may be called identified: a value lies on a bound, a constant is
    strained, or the misfit is large.

    See `find_strained_constants` and `MAX_MISFIT`.
    """
    has_value_at_bound = is_at_bound(point, unknowns)[VALUE_SLICE].any()
    is_strained = bool(has_value_at_bound or find_strained_constants(unknowns, point))
    return is_strained or misfit > MAX_MISFIT


def find_strained_constants(
    unknowns: Unknowns, point: Float[np.ndarray, " unknown"]
) -> tuple[str, ...]:
    """Return the names of constants on a bound or farther than `STRAINED_STDS` from their prior
    means, the farthest first.
    """
    distance = np.abs(point - unknowns.center) / unknowns.deviation
    is_strained = (distance > STRAINED_STDS) | is_at_bound(point, unknowns)
    indices = [
        int(index)
        for index in np.argsort(-distance)
        if is_strained[index] and index >= CONSTANT_SLICE.start
    ]
    return tuple(unknowns.names[index] for index in indices)


def compute_misfit(objective: Objective, point: Float[np.ndarray, " unknown"]) -> float:
    """Return the RMS of the missed lines, relative to what was expected of them."""
    with torch.no_grad():
        return float(objective.weighted_loss(torch.as_tensor(point)))


# Number of draws beyond the bounds after which the last one is put on the bound.
_MAX_DRAW_ATTEMPTS = 200


@dataclass(frozen=True, eq=False)
class Posterior:
    """Density of all coordinates searched: normal (Laplace's approximation), and cut at their
    bounds.
    """

    unknowns: Unknowns
    """What was searched."""
    point: Float[np.ndarray, " unknown"]
    """Calibrated coordinates."""
    covariance: Float[np.ndarray, "unknown unknown"]
    """Their covariance; its first six rows are the logarithms of the six values."""

    def __repr__(self) -> str:
        return shorten(f"<Posterior: normal density of {', '.join(self.unknowns.names)}>")

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that were measured."""
        return self.unknowns.channels

    def twin_at(self, twin: Twin, point: Float[np.ndarray, " unknown"]) -> Twin:
        """Return `twin` with the values, scales, angles of ports and sensor path of `point`."""
        values = Interfaces.from_values(np.exp(point[VALUE_SLICE]))
        path = self.unknowns.sensor_path_at(point, twin.pump.channels)
        calibrated = twin.with_interfaces(values, self.unknowns.scales_at(point))
        timing = self.unknowns.port_timing_at(point)
        if timing is not None:
            calibrated = replace(calibrated, port_timing=timing)
        if path is not None:
            calibrated = replace(calibrated, path=path)
        return calibrated

    def draws(self, count: int, seed: int) -> Float[np.ndarray, "draw unknown"]:
        """Return points drawn from the density.

        The same seed gives the same points, whatever the count.
        """
        if count < 1:
            raise InputError(f"count ({count}) must be at least 1.")

        root = np.linalg.cholesky(self.covariance)
        lower = self.unknowns.lower
        upper = self.unknowns.upper
        points = []
        for index in range(count):
            # a stream per draw, so that the first draws do not depend on the count
            rng = random_stream(seed, "posterior", index)
            for _ in range(_MAX_DRAW_ATTEMPTS):
                point = self.point + root @ rng.standard_normal(len(self.point))
                if ((point >= lower) & (point <= upper)).all():
                    break
            points.append(np.clip(point, lower, upper))
        return np.stack(points)

    def twins(self, twin: Twin, count: int, seed: int) -> list[Twin]:
        """Return `twin` with the coordinates of each of `count` draws."""
        return [self.twin_at(twin, point) for point in self.draws(count, seed)]
