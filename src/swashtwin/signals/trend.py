"""Trends: an indicator over recordings, against the healthy ones of the same machine."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from typing import Any, Literal

import numpy as np

from swashtwin.foundation import DataError, InputError
from swashtwin.pump import PRESSURE_TOLERANCE, SPEED_TOLERANCE, is_same_class, values_match
from swashtwin.signals.indicator_table import IndicatorTable, Row
from swashtwin.signals.indicators import Indicator
from swashtwin.signals.waveform_statistics import MAD_TO_STANDARD_DEVIATION

MIN_BASELINE = 5
"""Other healthy recordings that a baseline needs: of three, 20 % of healthy recordings lie 5
spreads off.
"""
MIN_RELATIVE_SPREAD = 0.01
"""Minimum spread of a baseline relative to its median: equal samples do not make every difference
a fault.
"""

Status = Literal["within", "above", "below", "no baseline"]
Order = Literal["time", "name"]


@dataclass(frozen=True)
class TrendPoint:
    """One recording in a trend."""

    row: Row
    """Recording, channel and operating point."""
    value: float
    """The indicator."""
    healthy: bool
    """Whether the recording was specified as healthy."""
    median: float
    """Median of the other healthy recordings at the operating point; NaN if they are too few."""
    spread: float
    """1.4826 times their median absolute deviation, at least 1 % of the median; NaN as above."""
    count: int
    """Healthy recordings in the baseline."""
    status: Status
    """Whether the value lies more than k spreads off."""

    def to_dict(self) -> dict[str, Any]:
        """Return the point for JSON."""
        return {
            **self.row.facts,
            "value": self.value,
            "healthy": self.healthy,
            "baseline_median": self.median,
            "baseline_spread": self.spread,
            "baseline_count": self.count,
            "status": self.status,
        }


@dataclass(frozen=True, eq=False)
class Trend:
    """An indicator over recordings."""

    indicator: Indicator
    """The indicator."""
    channel: str
    """Channel that it is of."""
    k: float
    """Spreads from the median at which a value is flagged."""
    by: Order
    """What the recordings are ordered by."""
    points: tuple[TrendPoint, ...]
    """The recordings, in that order."""

    @property
    def flagged(self) -> tuple[TrendPoint, ...]:
        """Points above or below their baseline."""
        return tuple(point for point in self.points if point.status in ("above", "below"))

    def to_dict(self) -> dict[str, Any]:
        """Return the trend for JSON."""
        return {
            "indicator": self.indicator.name,
            "unit": self.indicator.unit,
            "channel": self.channel,
            "k": self.k,
            "by": self.by,
            "points": [point.to_dict() for point in self.points],
            "flagged": [point.row.recording_id for point in self.flagged],
        }


def trend_of(
    table: IndicatorTable,
    indicator: str,
    *,
    channel: str | None = None,
    by: Order = "name",
    k: float = 5.0,
    healthy: Sequence[str] = ("normal",),
) -> Trend:
    """Return each recording's indicator against the healthy recordings of its machine.

    The baseline is the median and the median absolute deviation of the healthy recordings of the
    same machine (`specimen`) at the same operating point: a speed within 2 % and a pressure within
    6 %. A healthy recording is compared with the *other* healthy ones, never with itself. Few
    recordings make a poor baseline: docs/how-to/indicators.md states how often a healthy one is
    flagged.

    Parameters
    ----------
    indicator : name of a column of `table`.
    channel : channel to follow; the first by default.
    by : order of the recordings: by their attribute ``date``, or by their name.
    k : spreads (1.4826 MAD, the standard deviation of Gaussian scatter) at which a value is
        flagged.
    healthy : classes, or patterns of recording ids such as ``"2024-01-*"``, that are healthy.

    Raises
    ------
    InputError
        No such indicator or channel, or a k that is not positive.
    DataError
        No recording is healthy, or `by` is ``"time"`` and one has no date.
    """
    if not (math.isfinite(k) and k > 0):
        raise InputError(f"k ({k:g}) must be positive; 5 flags few healthy recordings.")
    column, values = table.column(indicator)
    if channel is None:
        channel = table.rows[0].channel

    series = [
        (row, float(value))
        for row, value in zip(table.rows, values, strict=True)
        if row.channel == channel
    ]
    if not series:
        names = ", ".join(dict.fromkeys(row.channel for row in table.rows))
        raise InputError(f"no channel {channel!r}; there are {names}.")
    is_healthy = [_matches_any(row, healthy) for row, _ in series]
    if not any(is_healthy):
        raise DataError(
            f"No recording is healthy (class or id like {', '.join(healthy)}): "
            "specify the classes or ids of healthy recordings."
        )

    points = [_compare_with_baseline(index, series, is_healthy, k) for index in range(len(series))]
    points.sort(key=lambda point: _sort_key(point.row, by))
    return Trend(column, channel, k, by, tuple(points))


def _matches_any(row: Row, patterns: Sequence[str]) -> bool:
    """Return whether the class or the id of a row matches one of the patterns."""
    return any(
        is_same_class(row.label, pattern) or fnmatch(row.recording_id, pattern)
        for pattern in patterns
    )


def _sort_key(row: Row, by: Order) -> tuple[str, str]:
    if by == "name":
        return "", row.recording_id
    if row.date is None:
        raise DataError(
            f"{row.recording_id} has no date: give attributes = "
            '{date = "2024-05-31"} in the index, or order by name.'
        )
    return row.date, row.recording_id


def _compare_with_baseline(
    index: int, series: Sequence[tuple[Row, float]], is_healthy: Sequence[bool], k: float
) -> TrendPoint:
    """Return one recording against the healthy others at its operating point."""
    row, value = series[index]
    baseline = [
        candidate_value
        for number, (candidate, candidate_value) in enumerate(series)
        if number != index
        and is_healthy[number]
        and math.isfinite(candidate_value)
        and candidate.specimen == row.specimen
        and values_match(candidate.speed, row.speed, SPEED_TOLERANCE)
        and values_match(candidate.pressure, row.pressure, PRESSURE_TOLERANCE)
    ]
    count = len(baseline)
    if count < MIN_BASELINE or not math.isfinite(value):
        return TrendPoint(row, value, is_healthy[index], math.nan, math.nan, count, "no baseline")

    median = float(np.median(baseline))
    absolute_deviation = float(np.median(np.abs(np.array(baseline) - median)))
    spread = max(MAD_TO_STANDARD_DEVIATION * absolute_deviation, MIN_RELATIVE_SPREAD * abs(median))
    status: Status = "within"
    if abs(value - median) > k * spread:
        status = "above" if value > median else "below"
    return TrendPoint(row, value, is_healthy[index], median, spread, count, status)
