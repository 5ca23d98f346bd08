"""A table of indicators: one row per recording and channel."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from typing import Any, Literal

import numpy as np
from jaxtyping import Float64

from swashtwin.foundation import DataError, InputError, csv_text
from swashtwin.pump import PRESSURE_TOLERANCE, SPEED_TOLERANCE, is_same_class, values_match
from swashtwin.recordings import Recording, require_usable, specified_shaft_frequency
from swashtwin.signals.indicators import BANDS, FAMILIES, Band, Indicator, Measured
from swashtwin.signals.levels import shape_statistics
from swashtwin.signals.shaft_angle import ShaftAngle

KEYS = ("recording", "channel", "class", "specimen", "date", "speed [rpm]", "pressure [MPa]")
"""Columns that say which row is which."""


@dataclass(frozen=True)
class Row:
    """Which recording and channel a row of the table is about."""

    recording_id: str
    """Name of the recording."""
    channel: str
    """Name of the channel."""
    label: str | None = None
    """Class, or None where nobody knows."""
    specimen: str | None = None
    """Which machine, or None where nobody wrote it down."""
    date: str | None = None
    """When it was measured, as the recording's attribute ``date`` says, or None."""
    speed: float = math.nan
    """Angular speed of the shaft [rad/s]; NaN where nobody knows."""
    pressure: float = math.nan
    """Absolute discharge pressure [Pa]; NaN where nobody knows."""

    @property
    def facts(self) -> dict[str, Any]:
        """What the row is about, but for its channel, as JSON has it."""
        return {
            "recording": self.recording_id,
            "class": self.label,
            "specimen": self.specimen,
            "date": self.date,
            "speed_rad_s": self.speed,
            "pressure_pa": self.pressure,
        }

    @property
    def point(self) -> tuple[float, float]:
        """Speed [rev/min] and pressure [MPa], as tables for people state them."""
        return float(f"{self.speed * 30 / math.pi:.12g}"), float(f"{self.pressure * 1e-6:.12g}")


@dataclass(frozen=True, eq=False)
class IndicatorTable:
    """Indicators of recordings and channels."""

    rows: tuple[Row, ...]
    """What each row is about."""
    columns: tuple[Indicator, ...]
    """What each column is."""
    values: Float64[np.ndarray, "row indicator"]
    """The indicators; NaN where the recording is too short or slow for one, or lacks what it
    needs.
    """

    def column(self, name: str) -> tuple[Indicator, Float64[np.ndarray, " row"]]:
        """The indicator of that name and its value in each row.

        Raises
        ------
        InputError
            The table has no such column, or has it in several units.
        """
        indices = [index for index, column in enumerate(self.columns) if column.name == name]
        if not indices:
            raise InputError(
                f"no indicator {name!r}; there are {', '.join(column.name for column in self.columns)}."
            )
        if len(indices) > 1:
            units = ", ".join(self.columns[index].unit for index in indices)
            raise InputError(f"{name} is there in several units ({units}); pick recordings of one.")
        return self.columns[indices[0]], self.values[:, indices[0]]

    @property
    def csv(self) -> str:
        """The table as text, units in the header, every number with all its digits, NaN as an empty
        cell.
        """
        units = [
            f"{column.name} [{column.unit}]" if column.unit else column.name
            for column in self.columns
        ]
        rows = []
        for row, values in zip(self.rows, self.values.tolist(), strict=True):
            facts = [row.recording_id, row.channel, row.label, row.specimen, row.date, *row.point]
            rows.append(
                ["" if value is None or value != value else value for value in [*facts, *values]]
            )
        return csv_text([*KEYS, *units], rows)

    def to_dict(self) -> dict[str, Any]:
        """The table as JSON can hold it: columns with unit and meaning, rows with a value by
        name.
        """
        columns = [
            {"name": column.name, "unit": column.unit, "meaning": column.meaning}
            for column in self.columns
        ]
        names = [column.name for column in self.columns]
        rows = [
            {**row.facts, "channel": row.channel, "values": dict(zip(names, values, strict=True))}
            for row, values in zip(self.rows, self.values.tolist(), strict=True)
        ]
        return {"columns": columns, "rows": rows}


def indicators_of(
    recording: Recording,
    *,
    angle: ShaftAngle | None = None,
    pistons: int | None = None,
    bands: Sequence[Band] = BANDS,
    families: Iterable[str] = tuple(FAMILIES),
) -> IndicatorTable:
    """Indicators of each channel of a recording.

    What a recording is too short, too slow or not known well enough for is NaN, or has no column:
    orders need a speed (an `angle`, or one that somebody stated).

    Parameters
    ----------
    angle : shaft angle from a tachometer or a followed line.
    pistons : number of pistons z: lines at 1, 2, z and 2 z times the shaft are described, without
        it at 1 and 2.
    bands : bands whose levels are wanted, in Hz or in shaft orders; those above half the sample
        rate are NaN.
    families : names among `FAMILIES`.

    Raises
    ------
    InputError
        An unknown family, no piston, or an angle of another recording.
    DataError
        The recording is unfit: missing samples, a constant channel, gaps.
    """
    wanted = list(families)
    unknown = [name for name in wanted if name not in FAMILIES]
    if unknown:
        raise InputError(
            f"no family of indicators {unknown[0]!r}; there are {', '.join(FAMILIES)}."
        )
    if pistons is not None and pistons < 1:
        raise InputError(f"pistons ({pistons}) must be 1 or more.")
    require_usable(recording.replace(signal=recording.signal))  # a file is read once
    if angle is not None:
        angle.require_fits(recording)
        shaft: float | None = angle.mean_speed / (2 * math.pi)
    else:
        shaft = specified_shaft_frequency(recording)
    orders = (1, 2) if pistons is None else tuple(sorted({1, 2, pistons, 2 * pistons}))
    measured = Measured(recording, shaft, angle, orders, tuple(bands))
    pairs = [pair for name in wanted for pair in FAMILIES[name](measured)]
    pressure = math.nan if recording.condition is None else recording.condition.discharge_pressure
    date = recording.attributes.get("date")
    facts = (recording.label, recording.specimen, None if date is None else str(date))
    speed = math.nan if shaft is None else 2 * math.pi * shaft
    rows = tuple(
        Row(recording.recording_id, channel, *facts, speed, pressure)
        for channel in recording.channels
    )
    values = np.stack([value for _, value in pairs], axis=1) if pairs else np.empty((len(rows), 0))
    return IndicatorTable(rows, tuple(column for column, _ in pairs), values)


def stacked(tables: Sequence[IndicatorTable]) -> IndicatorTable:
    """One table of several; a column that one of them lacks is NaN there.

    Raises
    ------
    DataError
        There is none.
    """
    if not tables:
        raise DataError("no recording to make a table of; check the folder or the selection.")
    meanings = {(column.name, column.unit): column for table in tables for column in table.columns}
    column_of = {key: number for number, key in enumerate(meanings)}
    values = []
    for table in tables:
        block = np.full((len(table.rows), len(column_of)), math.nan)
        block[:, [column_of[column.name, column.unit] for column in table.columns]] = table.values
        values.append(block)
    rows = tuple(row for table in tables for row in table.rows)
    return IndicatorTable(rows, tuple(meanings.values()), np.concatenate(values))


LONGEST = 1 << 23
"""Samples of all channels up to which a recording is described as a whole."""
_STRETCHES, _STRETCH = 16, 1 << 20
"""Number of stretches of a longer one, and the samples of all channels in each."""
_LEVELS = ("velocity_rms", "band_rms", "order_amplitude", "envelope_amplitude")


def long_indicators(
    recording: Recording, describe: Callable[[Recording], IndicatorTable]
) -> IndicatorTable:
    """What `describe` gives of a recording, or a table of its stretches where it is longer than
    `LONGEST`.

    A long recording is read in blocks. Its rms, peak, crest factor, kurtosis and skewness are those
    of all samples. The others come from 16 stretches that are spread evenly over it: levels and
    amplitudes are the root mean square over the stretches, everything else is their median.

    Raises
    ------
    DataError
        The recording is unfit.
    """
    if recording.n_samples * recording.n_channels <= LONGEST:
        return describe(recording)
    require_usable(recording)
    length = _STRETCH // recording.n_channels
    starts = np.linspace(0, recording.n_samples - length, _STRETCHES).astype(int).tolist()
    tables = [describe(recording.slice(start, start + length)) for start in starts]
    shared = [
        column for column in tables[0].columns if all(column in table.columns for table in tables)
    ]
    values = np.stack(
        [table.values[:, [table.columns.index(column) for column in shared]] for table in tables]
    )
    joined = np.median(values, axis=0)
    picked = recording.select_channels([row.channel for row in tables[0].rows])
    statistics = shape_statistics(picked) if any(column.name == "rms" for column in shared) else {}
    for index, column in enumerate(shared):
        if column.name.startswith(_LEVELS):
            joined[:, index] = np.sqrt(np.mean(values[:, :, index] ** 2, axis=0))
        elif column.name in statistics:
            joined[:, index] = statistics[column.name]
    return IndicatorTable(tables[0].rows, tuple(shared), joined)


MIN_HEALTHY_RECORDINGS = 5
"""Other healthy recordings that a baseline takes at least: of three, 20 % of healthy recordings lie
5 spreads off.
"""

_LEAST_SPREAD = 0.01
"""Spread of a baseline relative to its median, at least: equal samples do not make any difference a
fault.
"""

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
    """Median of the other healthy recordings at the operating point; NaN where there are too
    few.
    """
    spread: float
    """1.4826 times their median absolute deviation, at least 1 % of the median; NaN as above."""
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
        names = {
            "median": "baseline_median",
            "spread": "baseline_spread",
            "count": "baseline_count",
        }
        points = [
            point.row.facts
            | {names.get(name, name): value for name, value in vars(point).items() if name != "row"}
            for point in self.points
        ]
        table = {
            "indicator": self.indicator.name,
            "unit": self.indicator.unit,
            "channel": self.channel,
            "k": self.k,
        }
        return {
            **table,
            "by": self.by,
            "points": points,
            "flagged": [point.row.recording_id for point in self.flagged],
        }


def trend_of(
    table: IndicatorTable,
    indicator: str,
    *,
    channel: str | None = None,
    by: Literal["time", "name"] = "name",
    k: float = 5.0,
    healthy: Sequence[str] = ("normal",),
) -> Trend:
    """Each recording's indicator against the median and the MAD of the healthy ones of the same
    machine and point.

    The same machine is the same `specimen`; the same operating point is a speed within 2 % and a
    pressure within 6 %. A healthy recording is compared with the *other* healthy ones, never with
    itself. Few recordings make a poor baseline: docs/how-to/indicators.md says how often a healthy
    one is flagged.

    Parameters
    ----------
    indicator : name of a column of `table`.
    channel : channel to follow; the first by default.
    by : order of the recordings: by their attribute ``date``, or by their name.
    k : spreads (1.4826 MAD, the standard deviation of Gaussian scatter) at which a value is
        flagged.
    healthy : classes, or patterns of recording ids such as ``"2024-01-*"``, that somebody states to
        be healthy.

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
    picked = [
        (row, float(value))
        for row, value in zip(table.rows, values, strict=True)
        if row.channel == channel
    ]
    if not picked:
        names = ", ".join(dict.fromkeys(row.channel for row in table.rows))
        raise InputError(f"no channel {channel!r}; there are {names}.")
    good = [
        any(
            is_same_class(row.label, pattern) or fnmatch(row.recording_id, pattern)
            for pattern in healthy
        )
        for row, _ in picked
    ]
    if not any(good):
        raise DataError(
            f"no recording is stated to be healthy (class or id like {', '.join(healthy)}); name some with --healthy."
        )
    points = [_point(index, picked, good, k) for index in range(len(picked))]
    return Trend(
        column, channel, k, by, tuple(sorted(points, key=lambda point: _order(point.row, by)))
    )


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
    index: int, picked: Sequence[tuple[Row, float]], good: Sequence[bool], k: float
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
    if len(others) < MIN_HEALTHY_RECORDINGS or not math.isfinite(value):
        return TrendPoint(row, value, good[index], math.nan, math.nan, len(others), "no baseline")
    median = float(np.median(others))
    mad = float(np.median(np.abs(np.array(others) - median)))
    spread = max(1.4826 * mad, _LEAST_SPREAD * abs(median))
    status: Status = "within"
    if abs(value - median) > k * spread:
        status = "above" if value > median else "below"
    return TrendPoint(row, value, good[index], median, spread, len(others), status)
