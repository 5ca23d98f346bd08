"""Parquet tables."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError, load_extra
from swashtwin.recordings.columns import Column, LazyColumn
from swashtwin.recordings.formats.clock import extract_time
from swashtwin.recordings.formats.headings import split_unit
from swashtwin.recordings.formats.raw_file import RawFile, ReadOptions, require_plausible_size
from swashtwin.recordings.recording import Recording

polars: Any = load_extra("polars", "readers", "a Parquet table")


def read(path: Path, options: ReadOptions) -> RawFile:
    """Return the columns of numbers; headings such as ``x [g]`` name the unit.

    A missing number is NaN. A column of time stamps counts as the time [s] since its first.
    """
    table = polars.scan_parquet(path)
    schema = table.collect_schema()
    row_count = table.select(polars.len()).collect().item()
    require_plausible_size(path, 8 * row_count * len(schema), f"{row_count} rows")

    lists = [heading for heading, kind in schema.items() if kind.is_nested()]
    if lists and options.channels is None:
        raise DataError(
            f"{path}: each cell of {', '.join(lists)} holds several numbers, such as a window, and "
            "a recording has one in each cell.",
            field="channels",
            remedy="Save the samples of each recording as one column, or select columns with "
            "{channels}.",
        )

    columns: dict[str, Column] = {}
    units: dict[str, str] = {}
    for heading, kind in schema.items():
        is_time = kind in (polars.Datetime, polars.Duration)
        if not (kind.is_numeric() or kind == polars.Boolean or is_time):
            continue

        name, unit = split_unit(heading)
        if name in columns:
            name = heading
        read_column = partial(_read_samples, table.select(heading))
        columns[name] = LazyColumn(read_column, row_count, np.dtype(np.float64))
        if is_time:
            units[name] = "s"
        elif unit:
            units[name] = unit
    return extract_time(path, RawFile(columns, None, units), options)


def write(recording: Recording, path: Path) -> None:
    """Write time and channels as columns of doubles, the unit in their headings."""
    table = {"time [s]": recording.time}
    for name, samples in zip(recording.channels, recording.signal, strict=True):
        table[f"{name} [{recording.unit}]"] = samples
    with path.open("wb") as file:
        polars.DataFrame(table).write_parquet(file)


def _read_samples(table: Any, start: int, stop: int) -> np.ndarray:
    """Return some rows of a table of one column as numbers, times in seconds since its first."""
    series = table.slice(start, stop - start).collect().to_series()
    if series.dtype.is_temporal():
        first_time = _nanoseconds(table.head(1).collect().to_series())[0]
        # Subtracted as integers: a double does not resolve nanoseconds since 1970.
        series = (_nanoseconds(series) - first_time).cast(polars.Float64) * 1e-9

    numbers = series.cast(polars.Float64).fill_null(np.nan)
    return np.asarray(numbers.to_numpy(), dtype=np.float64)


def _nanoseconds(series: Any) -> Any:
    kind = type(series.dtype)
    return series.cast(kind("ns")).cast(polars.Int64)
