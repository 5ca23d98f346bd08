"""Parquet tables."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import load_extra
from swashtwin.recordings.formats.clock import extract_time
from swashtwin.recordings.formats.columns import Column, LazyColumn
from swashtwin.recordings.formats.headings import split_unit
from swashtwin.recordings.formats.raw_file import RawFile, ReadOptions, require_plausible_size
from swashtwin.recordings.recording import Recording

polars: Any = load_extra("polars", "readers", "a Parquet table")


def read(path: Path, options: ReadOptions) -> RawFile:
    """Columns of numbers, a missing one as NaN; headings such as ``x [g]`` name the unit, and a
    time column the rate.

    A column of time stamps counts as the time [s] since its first.
    """
    table = polars.scan_parquet(path)
    height = table.select(polars.len()).collect().item()
    require_plausible_size(path, 8 * height * len(table.collect_schema()), f"{height} rows")
    columns: dict[str, Column] = {}
    units: dict[str, str] = {}
    for heading, kind in table.collect_schema().items():
        if not (kind.is_numeric() or kind in (polars.Boolean, polars.Datetime, polars.Duration)):
            continue
        name, unit = split_unit(heading)
        name = name if name not in columns else heading
        columns[name] = LazyColumn(
            partial(_samples, table.select(heading)), height, np.dtype(np.float64)
        )
        if unit or kind.is_temporal():
            units[name] = "s" if kind.is_temporal() else str(unit)
    return extract_time(path, RawFile(columns, None, units), options)


def write(recording: Recording, path: Path) -> None:
    """Write time and channels as columns of doubles, the unit in their headings."""
    table = {"time [s]": recording.time}
    table |= {
        f"{name} [{recording.unit}]": row
        for name, row in zip(recording.channels, recording.signal, strict=True)
    }
    with path.open("wb") as file:
        polars.DataFrame(table).write_parquet(file)


def _samples(table: Any, start: int, stop: int) -> np.ndarray:
    series = table.slice(start, stop - start).collect().to_series()
    if series.dtype.is_temporal():
        nanoseconds = series.cast(type(series.dtype)("ns")).cast(polars.Int64)
        origin = (
            table.head(1).collect().to_series().cast(type(series.dtype)("ns")).cast(polars.Int64)[0]
        )
        series = (nanoseconds - origin).cast(polars.Float64) * 1e-9
    return np.asarray(series.cast(polars.Float64).fill_null(np.nan).to_numpy(), dtype=np.float64)
