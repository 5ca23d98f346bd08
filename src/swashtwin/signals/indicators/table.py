"""A table of indicators: one row per recording and channel."""

import csv
import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64

from swashtwin.foundation import DataError, InputError
from swashtwin.recordings import Recording, refuse_unfit, stated_speed
from swashtwin.signals.indicators.registry import BANDS, FAMILIES, Band, Indicator, Measured
from swashtwin.signals.orders.shaft_angle import ShaftAngle

KEYS = ("recording", "channel", "class", "specimen", "date", "speed [rad/s]", "pressure [Pa]")
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


@dataclass(frozen=True, eq=False)
class IndicatorTable:
    """Indicators of recordings and channels."""

    rows: tuple[Row, ...]
    """What each row is about."""
    columns: tuple[Indicator, ...]
    """What each column is."""
    values: Float64[np.ndarray, "row indicator"]
    """The indicators; NaN where the recording is too short or slow for one, or lacks what it needs."""

    def column(self, name: str) -> tuple[Indicator, Float64[np.ndarray, " row"]]:
        """The indicator of that name and its value in each row.

        Raises
        ------
        InputError
            The table has no such indicator, or has it in several units.
        """
        places = [place for place, one in enumerate(self.columns) if one.name == name]
        if not places:
            raise InputError(f"no indicator {name!r}; there are {', '.join(one.name for one in self.columns)}.")
        if len(places) > 1:
            units = ", ".join(self.columns[place].unit for place in places)
            raise InputError(f"{name} is there in several units ({units}); pick recordings of one.")
        return self.columns[places[0]], self.values[:, places[0]]

    @property
    def csv(self) -> str:
        """The table as text, units in the header, every number with all its digits, NaN as an empty cell."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        units = [f"{one.name} [{one.unit}]" if one.unit else one.name for one in self.columns]
        writer.writerow([*KEYS, *units])
        for row, values in zip(self.rows, self.values.tolist(), strict=True):
            known = [row.recording_id, row.channel, row.label, row.specimen, row.date, row.speed, row.pressure]
            writer.writerow(["" if value is None or value != value else value for value in [*known, *values]])
        return text.getvalue()

    def to_dict(self) -> dict[str, Any]:
        """The table as JSON can hold it: columns with unit and meaning, rows with a value by name."""
        columns = [{"name": one.name, "unit": one.unit, "meaning": one.meaning} for one in self.columns]
        names = [one.name for one in self.columns]
        rows = [
            {
                "recording": row.recording_id,
                "channel": row.channel,
                "class": row.label,
                "specimen": row.specimen,
                "date": row.date,
                "speed_rad_s": row.speed,
                "pressure_pa": row.pressure,
                "values": dict(zip(names, values, strict=True)),
            }
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
    channels: Sequence[str] | None = None,
) -> IndicatorTable:
    """Indicators of each channel of a recording.

    What a recording is too short, too slow or not known well enough for is NaN, or has no column: orders need a speed
    (an `angle`, or one that somebody stated), phases an `angle`.

    Parameters
    ----------
    angle : shaft angle from a tachometer or a followed line.
    pistons : number of pistons z: lines at 1, 2, z and 2 z times the shaft are described, without it at 1 and 2.
    bands : bands whose levels are wanted, in Hz or in shaft orders; those above half the sample rate are NaN.
    families : names among `FAMILIES`.
    channels : channels to describe; all by default. A tachometer's own channel has no vibration to describe.

    Raises
    ------
    InputError
        An unknown family or channel, no piston, or an angle of another recording.
    DataError
        The recording is unfit: missing readings, a constant channel, gaps.
    """
    wanted = list(families)
    unknown = [name for name in wanted if name not in FAMILIES]
    if unknown:
        raise InputError(f"no family of indicators {unknown[0]!r}; there are {', '.join(FAMILIES)}.")
    if pistons is not None and pistons < 1:
        raise InputError(f"pistons ({pistons}) must be 1 or more.")
    picked = recording if channels is None else recording.picked(channels)
    refuse_unfit(picked)
    if angle is not None:
        angle.require_fits(recording)
        shaft: float | None = angle.mean_speed / (2 * math.pi)
    else:
        shaft = stated_speed(recording)
    orders = (1, 2) if pistons is None else tuple(sorted({1, 2, pistons, 2 * pistons}))
    measured = Measured(picked, shaft, angle, orders, tuple(bands))
    found = [pair for name in wanted for pair in FAMILIES[name][1](measured)]
    pressure = math.nan if recording.condition is None else recording.condition.discharge_pressure
    date = recording.attributes.get("date")
    known = (recording.label, recording.specimen, None if date is None else str(date))
    speed = math.nan if shaft is None else 2 * math.pi * shaft
    rows = tuple(Row(recording.recording_id, channel, *known, speed, pressure) for channel in picked.channels)
    values = np.stack([value for _, value in found], axis=1) if found else np.empty((len(rows), 0))
    return IndicatorTable(rows, tuple(indicator for indicator, _ in found), values)


def stacked(tables: Sequence[IndicatorTable]) -> IndicatorTable:
    """One table of several; a column that one of them lacks is NaN there.

    Raises
    ------
    DataError
        There is none.
    """
    if not tables:
        raise DataError("no recording to make a table of; check the folder or the selection.")
    meanings = {(one.name, one.unit): one for table in tables for one in table.columns}
    place = {key: number for number, key in enumerate(meanings)}
    values = []
    for table in tables:
        block = np.full((len(table.rows), len(place)), math.nan)
        block[:, [place[one.name, one.unit] for one in table.columns]] = table.values
        values.append(block)
    rows = tuple(row for table in tables for row in table.rows)
    return IndicatorTable(rows, tuple(meanings.values()), np.concatenate(values))
