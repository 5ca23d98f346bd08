"""Parquet tables."""

from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.readers.raw import Options, RawFile, load_extra
from swashtwin.readers.tables import split_unit, timed_columns
from swashtwin.recording import Recording


def read(path: Path, options: Options) -> RawFile:
    """Columns of numbers, a missing one as NaN; headings such as ``x [g]`` name the unit, and a time column the rate.

    A column of time stamps counts as the time [s] since its first.
    """
    polars = load_extra("polars")
    with path.open("rb") as file:
        frame = polars.read_parquet(file)
    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    for series in frame:
        name, unit = split_unit(series.name)
        name = name if name not in columns else series.name
        numbers = _numbers(series)
        if numbers is None:
            continue
        columns[name] = numbers
        if unit and not series.dtype.is_temporal():
            units[name] = unit
    return timed_columns(path, columns, units, {}, options)


def write(recording: Recording, path: Path) -> None:
    """Write time and channels as columns of doubles, the unit in their headings."""
    polars = load_extra("polars")
    table = {"time [s]": recording.time}
    table |= {f"{name} [{recording.unit}]": row for name, row in zip(recording.channels, recording.signal, strict=True)}
    with path.open("wb") as file:
        polars.DataFrame(table).write_parquet(file)


def _numbers(series: Any) -> np.ndarray | None:
    """The readings of a column, or None where it holds no numbers."""
    polars = load_extra("polars")
    if series.dtype in (polars.Datetime, polars.Duration):
        nanoseconds = series.cast(series.dtype.__class__("ns")).cast(polars.Int64)
        series = (nanoseconds - nanoseconds[0]).cast(polars.Float64) * 1e-9
    elif not (series.dtype.is_numeric() or series.dtype == polars.Boolean):
        return None
    return np.asarray(series.cast(polars.Float64).fill_null(np.nan).to_numpy(), dtype=np.float64)
