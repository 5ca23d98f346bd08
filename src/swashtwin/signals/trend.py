"""An indicator over recordings, against the machine's own healthy baseline at the same operating point.

No zone limits of a standard are applied. No part of ISO 20816 or ISO 10816 is made for axial piston pumps (10816-7 is
for rotodynamic ones), and their vibration depends on speed, pressure and mounting.
"""

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

LEAST_HEALTHY = 5
"""Other healthy recordings that a baseline takes at least: of three, 20 % of healthy recordings lie 5 spreads off."""

_LEAST_SPREAD = 0.01
"""Spread of a baseline relative to its median, of phases in rad, at least: equal samples do not make any difference a
fault."""

Status = Literal["within", "above", "below", "no baseline"]


@dataclass(frozen=True)
class TrendPoint:
    """One recording in a trend."""

    row: Row
    """Which recording, channel and operating point."""
    value: float
    """The indicator."""
    healthy: bool
    """Whether somebody stated that the machine was healthy."""
    median: float
    """Median of the other healthy recordings at the operating point, of a phase the turn that is nearest to the value;
    NaN where there are too few."""
    spread: float
    """1.4826 times their median absolute deviation, at least 1 % of the median or 0.01 rad; NaN as above."""
    count: int
    """How many healthy recordings the baseline has."""
    status: Status
    """Whether the value lies more than k spreads off."""


@dataclass(frozen=True, eq=False)
class Trend:
    """An indicator over recordings."""

    indicator: Indicator
    """Which indicator."""
    channel: str
    """Of which channel."""
    k: float
    """Spreads from the median at which a value is flagged."""
    by: Literal["time", "name"]
    """What the recordings are ordered by."""
    points: tuple[TrendPoint, ...]
    """The recordings, in that order."""

    @property
    def flagged(self) -> tuple[TrendPoint, ...]:
        """Points above or below their baseline."""
        return tuple(point for point in self.points if point.status in ("above", "below"))

    def to_dict(self) -> dict[str, Any]:
        """The trend as JSON can hold it."""
        names = {"median": "baseline_median", "spread": "baseline_spread", "count": "baseline_count"}
        points = [
            point.row.facts | {names.get(name, name): value for name, value in vars(point).items() if name != "row"}
            for point in self.points
        ]
        table = {"indicator": self.indicator.name, "unit": self.indicator.unit, "channel": self.channel, "k": self.k}
        return {**table, "by": self.by, "points": points, "flagged": [point.row.recording_id for point in self.flagged]}


def trend_of(
    table: IndicatorTable,
    indicator: str,
    *,
    channel: str | None = None,
    by: Literal["time", "name"] = "name",
    k: float = 5.0,
    healthy: Sequence[str] = ("normal",),
) -> Trend:
    """Each recording's indicator against the median and the MAD of the healthy ones of the same machine and point.

    The same machine is the same `specimen`; the same operating point is a speed within 2 % and a pressure within 6 %. A
    healthy recording is compared with the *other* healthy ones, never with itself. Phases [rad] are compared around the
    circle: 179 and -179 degrees are 2 apart. Few recordings make a poor baseline:
    docs/how-to/indicators.md says how often a healthy one is flagged.

    Parameters
    ----------
    indicator : name of a column of `table`.
    channel : channel to follow; the first by default.
    by : order of the recordings: by their attribute ``date``, or by their name.
    k : spreads (1.4826 MAD, the standard deviation of Gaussian scatter) at which a value is flagged.
    healthy : classes, or patterns of recording ids such as ``"2024-01-*"``, that somebody states to be healthy.

    Raises
    ------
    InputError
        No such indicator or channel, or a k that is not positive.
    DataError
        No recording is stated to be healthy, or `by` is ``"time"`` and one has no date.
    """
    if not (math.isfinite(k) and k > 0):
        raise InputError(f"k ({k:g}) must be positive; 5 flags few healthy recordings.")
    column, values = table.column(indicator)
    channel = table.rows[0].channel if channel is None else channel
    picked = [(row, float(value)) for row, value in zip(table.rows, values, strict=True) if row.channel == channel]
    if not picked:
        names = ", ".join(dict.fromkeys(row.channel for row in table.rows))
        raise InputError(f"no channel {channel!r}; there are {names}.")
    good = [
        any(is_same_class(row.label, pattern) or fnmatch(row.recording_id, pattern) for pattern in healthy)
        for row, _ in picked
    ]
    if not any(good):
        raise DataError(
            f"no recording is stated to be healthy (class or id like {', '.join(healthy)}); name some with --healthy."
        )
    points = [_point(index, picked, good, k, column.unit == "rad") for index in range(len(picked))]
    return Trend(column, channel, k, by, tuple(sorted(points, key=lambda point: _order(point.row, by))))


def _order(row: Row, by: Literal["time", "name"]) -> tuple[str, str]:
    if by == "name":
        return "", row.recording_id
    if row.date is None:
        raise DataError(
            f"{row.recording_id}: nobody wrote down when it was measured; give attributes = "
            '{date = "2024-05-31"} in the index, or order by name.'
        )
    return row.date, row.recording_id


def _point(
    index: int, picked: Sequence[tuple[Row, float]], good: Sequence[bool], k: float, is_phase: bool
) -> TrendPoint:
    row, value = picked[index]
    others = [
        other
        for number, (candidate, other) in enumerate(picked)
        if number != index
        and good[number]
        and math.isfinite(other)
        and candidate.specimen == row.specimen
        and values_match(candidate.speed, row.speed, SPEED_TOLERANCE)
        and values_match(candidate.pressure, row.pressure, PRESSURE_TOLERANCE)
    ]
    if len(others) < LEAST_HEALTHY or not math.isfinite(value):
        return TrendPoint(row, value, good[index], math.nan, math.nan, len(others), "no baseline")
    if is_phase:  # each taken at the turn nearest to their mean direction
        middle = float(np.angle(np.exp(1j * np.array(others)).sum()))
        others = [middle + math.remainder(other - middle, 2 * math.pi) for other in others]
    median = float(np.median(others))
    mad = float(np.median(np.abs(np.array(others) - median)))
    spread = max(1.4826 * mad, _LEAST_SPREAD * (1.0 if is_phase else abs(median)))
    if is_phase:
        median = value - math.remainder(value - median, 2 * math.pi)
    status: Status = "within"
    if abs(value - median) > k * spread:
        status = "above" if value > median else "below"
    return TrendPoint(row, value, good[index], median, spread, len(others), status)
