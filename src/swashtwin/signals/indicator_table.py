"""A table of indicators: one row for each recording and channel."""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64

from swashtwin.foundation import DataError, InputError, csv_text, data_frame, short_repr
from swashtwin.recordings import Recording, require_usable, specified_shaft_frequency
from swashtwin.signals.indicators import BANDS, FAMILIES, Band, Indicator, IndicatorInput
from swashtwin.signals.shaft_angle import ShaftAngle
from swashtwin.signals.waveform_statistics import recording_statistics

KEYS = ("recording", "channel", "class", "specimen", "date", "speed [rpm]", "pressure [MPa]")
"""Columns that identify a row."""


@dataclass(frozen=True)
class Row:
    """Recording and channel that a row of the table describes."""

    recording_id: str
    """Name of the recording."""
    channel: str
    """Name of the channel."""
    label: str | None = None
    """Class; None if it is not known."""
    specimen: str | None = None
    """Machine; None if it is not known."""
    date: str | None = None
    """Date of the measurement, the recording's attribute ``date``; None if it is not known."""
    speed: float = math.nan
    """Angular speed of the shaft [rad/s]; NaN if it is not known."""
    pressure: float = math.nan
    """Absolute discharge pressure [Pa]; NaN if it is not known."""

    @property
    def facts(self) -> dict[str, Any]:
        """The row without its channel, for JSON."""
        return {
            "recording_id": self.recording_id,
            "label": self.label,
            "specimen": self.specimen,
            "date": self.date,
            "speed": self.speed,
            "discharge_pressure": self.pressure,
        }

    @property
    def point(self) -> tuple[float, float]:
        """Speed [rev/min] and pressure [MPa], rounded to 12 digits for tables."""
        # 12 digits hide the rounding of the change of unit: 1500 instead of 1499.9999999999998.
        return float(f"{self.speed * 30 / math.pi:.12g}"), float(f"{self.pressure * 1e-6:.12g}")


@dataclass(frozen=True, eq=False)
class IndicatorTable:
    """Indicators of recordings and channels."""

    rows: tuple[Row, ...]
    """What each row describes."""
    columns: tuple[Indicator, ...]
    """What each column is."""
    values: Float64[np.ndarray, "row indicator"]
    """The indicators; NaN if the recording is too short or too slow for one, or lacks a fact that
    it needs.
    """

    __repr__ = short_repr

    def column(self, name: str) -> tuple[Indicator, Float64[np.ndarray, " row"]]:
        """Return the indicator of that name and its value in each row.

        Raises
        ------
        InputError
            The table has no such column, or has it in several units.
        """
        indices = [index for index, column in enumerate(self.columns) if column.name == name]
        if not indices:
            names = ", ".join(column.name for column in self.columns)
            raise InputError(f"no indicator {name!r}; there are {names}.")
        if len(indices) > 1:
            units = ", ".join(self.columns[index].unit for index in indices)
            raise InputError(
                f"Indicator {name} has several units ({units}): choose recordings of one unit."
            )
        return self.columns[indices[0]], self.values[:, indices[0]]

    @property
    def csv(self) -> str:
        """The table as CSV: units in the header, all digits, an empty cell for NaN."""
        header = list(KEYS)
        for column in self.columns:
            header.append(f"{column.name} [{column.unit}]" if column.unit else column.name)

        rows = []
        for row, values in zip(self.rows, self.values.tolist(), strict=True):
            facts = [row.recording_id, row.channel, row.label, row.specimen, row.date, *row.point]
            rows.append([_csv_cell(value) for value in [*facts, *values]])
        return csv_text(header, rows)

    def to_pandas(self) -> Any:
        """Return the table as a ``pandas.DataFrame`` in SI units, one row a recording and channel.

        ``attrs["units"]`` of the frame holds the unit of each indicator. The name of one that has
        several units ends with its unit.

        Raises
        ------
        MissingExtraError
            pandas is not installed.
        """
        counts = Counter(column.name for column in self.columns)
        units = {}
        for column in self.columns:
            name = column.name if counts[column.name] == 1 else f"{column.name} [{column.unit}]"
            units[name] = column.unit

        rows = []
        for row, values in zip(self.rows, self.values.tolist(), strict=True):
            indicators = dict(zip(units, values, strict=True))
            rows.append({**row.facts, "channel": row.channel, **indicators})
        frame = data_frame(rows)
        frame.attrs["units"] = units
        return frame

    def to_dict(self) -> dict[str, Any]:
        """Return the table for JSON: columns with unit and meaning, rows with values by name."""
        names = [column.name for column in self.columns]
        columns = [
            {"name": column.name, "unit": column.unit, "meaning": column.meaning}
            for column in self.columns
        ]
        rows = []
        for row, values in zip(self.rows, self.values.tolist(), strict=True):
            named_values = dict(zip(names, values, strict=True))
            rows.append({**row.facts, "channel": row.channel, "values": named_values})
        return {"columns": columns, "rows": rows}


def _csv_cell(value: Any) -> Any:
    """Return an empty cell for None and NaN."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    return value


def indicators_of(
    recording: Recording,
    *,
    angle: ShaftAngle | None = None,
    pistons: int | None = None,
    bands: Sequence[Band] = BANDS,
    families: Iterable[str] = tuple(FAMILIES),
) -> IndicatorTable:
    """Return the indicators of each channel of a recording.

    An indicator for which the recording is too short, too slow or not known well enough is NaN, or
    has no column: orders need a speed (an `angle`, or a specified one).

    Parameters
    ----------
    angle : shaft angle from a tachometer or a followed line.
    pistons : number of pistons z: lines at 1, 2, z and 2 z times the shaft are described; by
        default those at 1 and 2.
    bands : bands of `band_rms`, in Hz or in shaft orders; those above half the sample rate are NaN.
    families : names among `FAMILIES`.

    Raises
    ------
    InputError
        An unknown family, no piston, or an angle of another recording.
    DataError
        The recording is unfit: missing samples, a constant channel, gaps.
    """
    families = list(families)
    unknown = [name for name in families if name not in FAMILIES]
    if unknown:
        raise InputError(
            f"no family of indicators {unknown[0]!r}; there are {', '.join(FAMILIES)}."
        )
    if pistons is not None and pistons < 1:
        raise InputError(f"pistons ({pistons}) must be 1 or more.")
    require_usable(recording.replace(signal=recording.signal))  # reads a file once, not twice

    shaft: float | None
    if angle is None:
        shaft = specified_shaft_frequency(recording)
    else:
        angle.require_fits(recording)
        shaft = angle.mean_speed / (2 * math.pi)
    orders: tuple[int, ...] = (1, 2)
    if pistons is not None:
        orders = tuple(sorted({1, 2, pistons, 2 * pistons}))

    source = IndicatorInput(recording, shaft, angle, orders, tuple(bands))
    columns = []
    values = []
    for name in families:
        for indicator, channel_values in FAMILIES[name](source):
            columns.append(indicator)
            values.append(channel_values)

    rows = _describe_rows(recording, shaft)
    table = np.stack(values, axis=1) if values else np.empty((len(rows), 0))
    return IndicatorTable(rows, tuple(columns), table)


def _describe_rows(recording: Recording, shaft: float | None) -> tuple[Row, ...]:
    """Return a row for each channel."""
    pressure = math.nan
    if recording.condition is not None:
        pressure = recording.condition.discharge_pressure
    date = recording.attributes.get("date")

    return tuple(
        Row(
            recording_id=recording.recording_id,
            channel=channel,
            label=recording.label,
            specimen=recording.specimen,
            date=None if date is None else str(date),
            speed=math.nan if shaft is None else 2 * math.pi * shaft,
            pressure=pressure,
        )
        for channel in recording.channels
    )


def stack_tables(tables: Sequence[IndicatorTable]) -> IndicatorTable:
    """Return several tables as one; a column that one of them lacks is NaN there.

    Raises
    ------
    DataError
        There is no table.
    """
    if not tables:
        raise DataError("No recording to describe: check the folder or the selection.")

    indicators: dict[tuple[str, str], Indicator] = {}
    for table in tables:
        for column in table.columns:
            indicators[column.name, column.unit] = column
    position = {key: number for number, key in enumerate(indicators)}

    blocks = []
    for table in tables:
        block = np.full((len(table.rows), len(position)), math.nan)
        block[:, [position[column.name, column.unit] for column in table.columns]] = table.values
        blocks.append(block)
    rows = tuple(row for table in tables for row in table.rows)
    return IndicatorTable(rows, tuple(indicators.values()), np.concatenate(blocks))


MAX_SAMPLES = 1 << 23
"""Samples of all channels up to which a recording is described as a whole."""
N_STRETCHES = 16
"""Stretches from which a longer recording is described."""
STRETCH_SAMPLES = 1 << 20
"""Samples of all channels in each stretch."""

# Indicators whose squares are averaged, because they are roots of powers.
_POWER_INDICATORS = ("velocity_rms", "band_rms", "order_amplitude", "envelope_amplitude")


def summarize_long_recording(
    recording: Recording, describe: Callable[[Recording], IndicatorTable]
) -> IndicatorTable:
    """Return what `describe` gives of a recording, from stretches if it exceeds `MAX_SAMPLES`.

    A long recording is read in blocks. Its rms, peak, crest factor, kurtosis and skewness are those
    of all samples. The others come from 16 stretches that are spread evenly over it: root mean
    squares and amplitudes are the root mean square over the stretches, everything else is the
    median.

    Raises
    ------
    DataError
        The recording is unfit.
    """
    if recording.n_samples * recording.n_channels <= MAX_SAMPLES:
        return describe(recording)

    require_usable(recording)
    length = STRETCH_SAMPLES // recording.n_channels
    starts = np.linspace(0, recording.n_samples - length, N_STRETCHES).astype(int).tolist()
    tables = [describe(recording.slice(start, start + length)) for start in starts]

    # A stretch may lack a column, for instance if it is too short for an order.
    shared_columns = set(tables[0].columns).intersection(*(table.columns for table in tables))
    columns = [column for column in tables[0].columns if column in shared_columns]
    stretch_values = []
    for table in tables:
        indices = [table.columns.index(column) for column in columns]
        stretch_values.append(table.values[:, indices])
    values = np.stack(stretch_values)
    summary = np.median(values, axis=0)

    statistics: dict[str, np.ndarray] = {}
    if any(column.name == "rms" for column in columns):
        channels = [row.channel for row in tables[0].rows]
        statistics = recording_statistics(recording.select_channels(channels))
    for index, column in enumerate(columns):
        if column.name.startswith(_POWER_INDICATORS):
            summary[:, index] = np.sqrt(np.mean(values[:, :, index] ** 2, axis=0))
        elif column.name in statistics:
            summary[:, index] = statistics[column.name]
    return IndicatorTable(tables[0].rows, tuple(columns), summary)
