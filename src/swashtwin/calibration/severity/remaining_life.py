"""The time until a growing fault reaches a severity at which the machine must be stopped."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from swashtwin.calibration.posterior import COVERAGE
from swashtwin.calibration.severity.severity_result import (
    SeverityTrend,
    SeverityVerdict,
    interval_log_std,
)
from swashtwin.foundation import InputError, plural

MIN_SEVERITIES = 4
"""Severities that a growth needs: its speed, its law and its scatter are unknown."""

MAX_EXTRAPOLATION = 10.0
"""Maximum remaining time over the time observed. The growth in a month says little about the next
year, so a longer time is not stated.
"""

GROWTH_EXPONENTS = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Exponents p of the growth dx/dt = r x^p, with equal prior probabilities: 0 is linear, 1
exponential.
"""

RATE_STD = 0.2
"""Standard deviation of the logarithm of the rate of wear in the remaining time, over the rate that
the severities show: load and oil change [our choice].
"""

_SECONDS_PER_DAY = 86_400.0

# Verdicts of severities that are used: the others may be zero, or have no upper limit.
_USED_VERDICTS = ("identified", "weak")

# Minimum standard deviation of ln severity from recording to recording.
_MIN_SCATTER = 0.02

# Number of recordings that the stated scatter counts as, beside the scatter about the growth.
_SCATTER_WEIGHT = 4.0

# Grid of the remaining time: its ends over the time observed, and its number of values.
_SHORTEST_LIFE = 1e-3
_LONGEST_LIFE = 1e2
_N_LIVES = 160

# Number of values in the grid of the present severity.
_N_PRESENT = 41

# Fall of ln likelihood beyond which a present severity is not searched more finely.
_NEGLIGIBLE = 12.0

# Nodes and weights of the error that all severities have in common: that of the law of the fault.
_ERROR_NODES, _ERROR_WEIGHTS = np.polynomial.hermite_e.hermegauss(5)


@dataclass(frozen=True)
class SeverityPoint:
    """Severity of a growing fault at one time."""

    date: datetime
    """Date of the recording."""
    value: float
    """Severity [SI]."""
    interval: tuple[float, float]
    """Range that contains it with a probability of 90 % [SI], with the error of the fault's law."""
    verdict: SeverityVerdict
    """How well it is known."""
    repeatability: float
    """Standard deviation of its logarithm from recording to recording."""


@dataclass(frozen=True)
class RemainingLife:
    """Time from the last recording until a fault reaches a limit."""

    limit: float
    """Severity [SI] at which the life ends."""
    as_of: datetime | None
    """Date of the last severity that was used; `None` if there was none."""
    severities: int
    """Severities that were used."""
    observed_days: float
    """Time from the first to the last of them [day]."""
    days: float | None
    """Median of the remaining time [day]; 0 if the limit is exceeded, `None` if it is not known."""
    interval: tuple[float, float] | None
    """Range that contains the remaining time with a probability of 90 % [day]."""
    reason: str
    """Why the time is not known; empty if it is."""

    @property
    def text(self) -> str:
        """The remaining time and its interval, or why it is not known, as a sentence part."""
        if self.days is None:
            return f"not yet known: {self.reason}"
        if self.interval is None:
            return "reached"
        low, high = self.interval
        middle = _format_days(self.days)
        return f"{middle} days (90 %: {_format_days(low)} ... {_format_days(high)})"

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON values; the limit in SI."""
        return {
            "limit": self.limit,
            "as_of": None if self.as_of is None else self.as_of.isoformat(),
            "severities": self.severities,
            "observed_days": self.observed_days,
            "days": self.days,
            "interval": None if self.interval is None else list(self.interval),
            "reason": self.reason,
            "confidence": COVERAGE,
        }


def estimate_remaining_life(
    trend: SeverityTrend, dates: Sequence[datetime], limit: float
) -> RemainingLife:
    """Return the time until the severity of a fault reaches a limit, with a 90 % interval.

    The severity x is assumed to grow by dx/dt = r x^p, with p between 0 (linear growth) and 1
    (exponential growth). Neither r nor p is known: each p of `GROWTH_EXPONENTS`, and each order of
    magnitude of the remaining time, has the same prior probability. The severities scatter about
    this growth by their `repeatability`, or by more if the recordings show more; the error of the
    law of the fault is common to all of them. The posterior is summed over a grid [our derivation].

    Parameters
    ----------
    trend : severities of one pump. Those that are neither ``identified`` nor ``weak`` are not used;
        if the newest has another verdict, the time is not known, unless it exceeds the limit.
    dates : date of each estimate of the trend, all with a time zone or all without.
    limit : severity at which the life ends [SI], chosen by the user.

    Raises
    ------
    InputError
        The limit is not a positive number, or the number of dates is not that of the severities.
    """
    if len(dates) != len(trend.estimates):
        raise InputError(
            f"{plural(len(dates), 'date')} for {len(trend.estimates)} severities: give one each."
        )

    points = [
        SeverityPoint(
            date,
            estimate.severity.value,
            estimate.severity.interval,
            estimate.severity.verdict,
            estimate.repeatability,
        )
        for date, estimate in zip(dates, trend.estimates, strict=True)
    ]
    return extrapolate_severities(points, limit)


def extrapolate_severities(points: Sequence[SeverityPoint], limit: float) -> RemainingLife:
    """Return the time until the severity of a fault reaches a limit; see
    `estimate_remaining_life`.

    Raises
    ------
    InputError
        The limit is not a positive number.
    """
    if not (math.isfinite(limit) and limit > 0):
        raise InputError(f"the limit of the severity ({limit:g}) must be a positive number.")
    if len({point.date.tzinfo is None for point in points}) > 1:
        raise InputError("some dates have a time zone and others have none; give all one or none.")

    ordered = sorted(points, key=lambda point: point.date)
    used = [point for point in ordered if point.verdict in _USED_VERDICTS]
    observed_days = 0.0
    if used:
        observed_days = (used[-1].date - used[0].date).total_seconds() / _SECONDS_PER_DAY

    if ordered and _exceeds(ordered[-1], limit):
        as_of = ordered[-1].date
        return RemainingLife(limit, as_of, len(used), observed_days, 0.0, None, "")
    if not used:
        return _unknown(limit, None, 0, 0.0, "no severity is identified")

    newest = ordered[-1]
    last_date = used[-1].date
    if newest is not used[-1]:
        reason = f"the newest severity is {newest.verdict}"
        return _unknown(limit, last_date, len(used), observed_days, reason)
    if len(used) < MIN_SEVERITIES or observed_days <= 0:
        reason = (
            f"{MIN_SEVERITIES} severities at different times are needed, and there are "
            f"{len(used)}, of {_format_days(observed_days)} days"
        )
        return _unknown(limit, last_date, len(used), observed_days, reason)

    seconds = np.array([(point.date - last_date).total_seconds() for point in used])
    days = seconds / _SECONDS_PER_DAY
    values = np.array([point.value for point in used])
    scatter = np.array([max(point.repeatability, _MIN_SCATTER) for point in used])
    total = np.array([interval_log_std(*point.interval) for point in used])
    common = float(np.sqrt(np.median(np.maximum(total**2 - scatter**2, 0.0))))
    low, median, high = life_quantiles(days, values, scatter, common, limit)
    if high > MAX_EXTRAPOLATION * observed_days:
        reason = (
            f"the growth in {_format_days(observed_days)} days does not exclude a remaining time "
            f"of more than {MAX_EXTRAPOLATION:g} times as long"
        )
        return _unknown(limit, last_date, len(used), observed_days, reason)
    return RemainingLife(limit, last_date, len(used), observed_days, median, (low, high), "")


def _exceeds(point: SeverityPoint, limit: float) -> bool:
    """Return whether the whole interval of a severity lies above a limit."""
    # a severity beyond the search exceeds the lower end of its interval
    has_lower_end = point.verdict in (*_USED_VERDICTS, "at bound")
    return has_lower_end and bool(point.interval[0] >= limit)


def _unknown(
    limit: float, as_of: datetime | None, severities: int, observed_days: float, reason: str
) -> RemainingLife:
    return RemainingLife(limit, as_of, severities, observed_days, None, None, reason)


def life_quantiles(
    days: Float[np.ndarray, " recording"],
    values: Float[np.ndarray, " recording"],
    scatter: Float[np.ndarray, " recording"],
    common: float,
    limit: float,
) -> tuple[float, float, float]:
    """Return the 5 %, 50 % and 95 % quantiles of the remaining time [day].

    Parameters
    ----------
    days : times of the severities from the last one, ascending to 0 [day].
    values : severities.
    scatter : standard deviation of the logarithm of each severity alone.
    common : standard deviation of the logarithm of the error that all severities have in common.
    limit : severity at which the life ends, in the unit of `values`.
    """
    lives = -days[0] * np.geomspace(_SHORTEST_LIFE, _LONGEST_LIFE, _N_LIVES)
    density = np.zeros(_N_LIVES)
    for node, weight in zip(_ERROR_NODES, _ERROR_WEIGHTS, strict=True):
        # all severities are too low by a factor, so that the limit is this much nearer
        measured_limit = limit * math.exp(-common * node)
        posterior = _life_posterior(days, values, scatter, measured_limit, lives)
        density += weight * posterior

    step = math.log(lives[1] / lives[0])
    # reflected at the ends, so that no probability is lost or counted twice
    density = gaussian_filter1d(density, RATE_STD / step, mode="reflect")

    cumulative = np.cumsum(density) / density.sum()
    quantiles = np.interp([0.05, 0.5, 0.95], cumulative, np.log(lives))
    low, median, high = (float(value) for value in np.exp(quantiles))
    return low, median, high


def _life_posterior(
    days: Float[np.ndarray, " recording"],
    values: Float[np.ndarray, " recording"],
    scatter: Float[np.ndarray, " recording"],
    limit: float,
    lives: Float[np.ndarray, " life"],
) -> Float[np.ndarray, " life"]:
    """Return the probability of each remaining time, whose logarithms are equally likely before."""
    if values[-1] >= limit:
        # the limit is exceeded: the shortest time of the grid
        return np.asarray(lives == lives[0], dtype=float)

    low = math.log(values.min()) - 1.0
    high = math.log(limit) - 1e-6
    for _ in range(2):
        present = np.exp(np.linspace(low, high, _N_PRESENT))
        likelihood = _log_likelihood(days, values, scatter, limit, lives, present)
        best_of_present = likelihood.max(axis=(0, 2))
        likely = np.flatnonzero(best_of_present > best_of_present.max() - _NEGLIGIBLE)
        low = math.log(present[max(likely[0] - 1, 0)])
        high = math.log(present[min(likely[-1] + 1, _N_PRESENT - 1)])

    posterior = np.exp(likelihood - likelihood.max()).sum(axis=(0, 1))
    return np.asarray(posterior / posterior.sum())


def _log_likelihood(
    days: Float[np.ndarray, " recording"],
    values: Float[np.ndarray, " recording"],
    scatter: Float[np.ndarray, " recording"],
    limit: float,
    lives: Float[np.ndarray, " life"],
    present: Float[np.ndarray, " present"],
) -> Float[np.ndarray, "exponent present life"]:
    """Return ln likelihood of the severities for each law, present severity and remaining time.

    Between two points of its course, the growth dx/dt = r x^p is a straight line in
    (x^(1-p) - 1) / (1 - p), which becomes ln x for p = 1: the points are the present severity and
    the limit. The common factor on the scatter is integrated out, so that the likelihood is
    Student's.
    """
    likelihood = np.empty((len(GROWTH_EXPONENTS), len(present), len(lives)))
    elapsed = days / lives[:, None]
    for number, exponent in enumerate(GROWTH_EXPONENTS):
        power = 1.0 - exponent
        start = _transform(present, power)[:, None, None]
        end = _transform(np.array(limit), power)
        straight = start + (end - start) * elapsed
        logarithm = _log_of_transformed(straight, power)

        deviation = (np.log(values) - logarithm) / scatter
        chi_square = (deviation**2).sum(axis=-1)
        degrees = _SCATTER_WEIGHT + len(days)
        likelihood[number] = -0.5 * degrees * np.log1p(chi_square / _SCATTER_WEIGHT)
    return likelihood


def _transform(values: Float[np.ndarray, "..."], power: float) -> Float[np.ndarray, "..."]:
    if power == 0:
        return np.asarray(np.log(values))
    return np.asarray((values**power - 1) / power)


def _log_of_transformed(values: Float[np.ndarray, "..."], power: float) -> Float[np.ndarray, "..."]:
    """Return ln x of transformed severities; very low before the fault began."""
    if power == 0:
        return values
    before_onset = 1e-9
    return np.asarray(np.log(np.maximum(1 + power * values, before_onset)) / power)


def _format_days(days: float) -> str:
    """Return a number of days with two digits: nothing is known better."""
    if days >= 100:
        return f"{days:.0f}"
    return f"{days:.2g}"
