"""How a severity goes on: a straight line through the estimates of a trend, with a band.

The depth that sliding wears off is proportional to the way that was slid (Archard 1953, doi:10.1063/1.1721448), so that
a severity grows in proportion to running hours while speed and load stay alike. What is common to all estimates of a
pump, such as the error of the fault's law, scales the whole line; what differs from recording to recording moves its
points.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.stats
from jaxtyping import Float

from swashtwin.calibration.uncertainty.posterior import COVERAGE, QUANTILE
from swashtwin.foundation import InputError

LEAST_ESTIMATES = 3
"""Estimates that a line needs: with two, nothing shows how far they scatter."""
_FINENESS = 1000


@dataclass(frozen=True, eq=False)
class SeverityForecast:
    """Severity at later times, with a band of 90 %."""

    times: Float[np.ndarray, " time"]
    """When, in the unit of the trend's times."""
    value: Float[np.ndarray, " time"]
    """Severity [SI]."""
    low: Float[np.ndarray, " time"]
    """Lower end of the band [SI]."""
    high: Float[np.ndarray, " time"]
    """Upper end of the band [SI]."""
    rate: float
    """Growth of the severity [SI per unit of time]."""
    limit: float | None = None
    """Severity [SI] that was asked for."""
    reached: tuple[float | None, float | None, float | None] = (None, None, None)
    """When the upper end of the band, the severity, and the lower end of the band reach the limit; None where they do
    not by the last of `times`."""

    def to_dict(self) -> dict[str, Any]:
        """All of it as JSON can hold it, in SI."""
        arrays = {name: getattr(self, name).tolist() for name in ("times", "value", "low", "high")}
        return {**arrays, "rate": self.rate, "limit": self.limit, "reached": list(self.reached)}

    def __repr__(self) -> str:
        last = f"{self.value[-1]:.3g} ({self.low[-1]:.3g} ... {self.high[-1]:.3g}) at {self.times[-1]:g}"
        return f"<SeverityForecast: {last}>"


@dataclass(frozen=True)
class _Line:
    """Straight line through estimates."""

    center: float
    level: float
    rate: float
    covariance: Float[np.ndarray, "2 2"]
    common: float
    """Standard deviation of the logarithm of what scales all estimates alike."""
    quantile: float

    def band(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Severity and the ends of its band."""
        rows = np.column_stack([np.ones_like(times), times - self.center])
        value = np.maximum(rows @ [self.level, self.rate], 0.0)
        reach = self.quantile * np.sqrt(np.einsum("ij,jk,ik->i", rows, self.covariance, rows))
        base = np.maximum(value, 1e-300)
        above = np.log((base + reach) / base)
        high = base * np.exp(np.hypot(above, QUANTILE * self.common))
        share = np.maximum(1 - reach / base, 1e-300)
        low = np.where(value > reach, base * np.exp(-np.hypot(np.log(share), QUANTILE * self.common)), 0.0)
        return value, low, np.where(value > 0, high, reach * math.exp(QUANTILE * self.common))


def forecast_line(
    values: Sequence[float],
    deviations: Sequence[float],
    common: float,
    times: Sequence[float],
    ahead: Sequence[float],
    limit: float | None,
) -> SeverityForecast:
    """Straight line through `values` at `times`, weighed by their deviations; see `SeverityTrend.forecast`.

    Parameters
    ----------
    common : standard deviation of the logarithm of what scales all values alike.
    """
    instants, later = np.asarray(times, dtype=float), np.sort(np.atleast_1d(np.asarray(ahead, dtype=float)))
    if len(instants) != len(values):
        raise InputError(f"{len(instants)} times for {len(values)} estimates; give one for each, in their order.")
    if not (np.isfinite(instants).all() and np.isfinite(later).all() and len(later)):
        raise InputError("times and ahead must be finite numbers, such as running hours, and ahead hold one at least.")
    if len(np.unique(instants)) < LEAST_ESTIMATES:
        count = len(np.unique(instants))
        raise InputError(f"a forecast needs recordings at {LEAST_ESTIMATES} different times, not at {count}.")
    if limit is not None and not limit > 0:
        raise InputError(f"limit ({limit:g}) must be a severity above 0 in SI units: mm(0.1) is 0.1 mm.")
    line = _line(np.asarray(values), np.asarray(deviations), common, instants)
    value, low, high = line.band(later)
    reached: tuple[float | None, float | None, float | None] = (None, None, None)
    if limit is not None:
        fine = np.linspace(instants.max(), max(later[-1], instants.max()), _FINENESS)
        middle, below, above = line.band(fine)
        reached = (_first(fine, above, limit), _first(fine, middle, limit), _first(fine, below, limit))
    return SeverityForecast(later, value, low, high, line.rate, limit, reached)


def _line(values: np.ndarray, deviations: np.ndarray, common: float, times: np.ndarray) -> _Line:
    center = float(np.average(times, weights=deviations**-2))
    rows = np.column_stack([np.ones_like(times), times - center]) / deviations[:, None]
    covariance = np.linalg.inv(rows.T @ rows)
    level, rate = covariance @ rows.T @ (values / deviations)
    residual = values / deviations - rows @ [level, rate]
    freedom = len(times) - 2
    scatter = max(1.0, float(residual @ residual) / freedom)
    quantile = float(scipy.stats.t.ppf((1 + COVERAGE) / 2, freedom))
    return _Line(center, float(level), float(rate), covariance * scatter, common, quantile)


def _first(times: np.ndarray, severity: np.ndarray, limit: float) -> float | None:
    beyond = np.flatnonzero(severity >= limit)
    return float(times[beyond[0]]) if len(beyond) else None
