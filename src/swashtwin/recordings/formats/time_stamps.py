"""Time stamps in text: ISO 8601, European and American dates, times of day."""

import re
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import DataError, load_extra

polars: Any = load_extra("polars", "readers", "a time stamp")

_DATE_PATTERN = r"(?:\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[-/.]\d{1,2}[-/.](?:\d{4}|\d{2}))"
_CLOCK_PATTERN = r"\d{1,2}:\d{2}(?::\d{2}(?:[.,]\d{1,9})?)?(?:\s?[AaPp][Mm])?"
_ZONE_PATTERN = r"(?:\s?(?:Z|UTC|GMT)|[+-]\d{2}(?::?\d{2})?)?"
_STAMP = re.compile(
    rf"(?:{_DATE_PATTERN}(?:\s+|[Tt]))?{_CLOCK_PATTERN}(?:\s+{_DATE_PATTERN})?{_ZONE_PATTERN}"
)
_DATE = re.compile(_DATE_PATTERN)
_CLOCK_FIELDS = (
    r"(?P<hour>\d+):(?P<minute>\d+)(?::(?P<second>\d+(?:[.,]\d+)?))?\s?(?:(?P<half>[AaPp])[Mm])?"
    r"(?:(?P<offset>[+-]\d{2})(?::?(?P<offset_minute>\d{2}))?$)?"
)

# Orders of day, month and year, the European one first.
_DATE_ORDERS = ("%d-%m-%Y", "%m-%d-%Y", "%Y-%m-%d", "%d-%m-%y", "%m-%d-%y")

_DAY_S = 86_400.0


def is_stamp(text: str) -> bool:
    """Return whether `text` is a time of day, with or without a date."""
    return _STAMP.fullmatch(text.strip()) is not None


def is_date(text: str) -> bool:
    """Return whether `text` is a date without a time of day."""
    return _DATE.fullmatch(text.strip()) is not None


def stamp_seconds(path: Path, texts: Any) -> tuple[Float[np.ndarray, " time"], str | None]:
    """Return the seconds since the first time stamp, and that stamp in ISO 8601.

    Parameters
    ----------
    texts : series of polars.

    Returns
    -------
    Seconds, NaN for a text that is not a time stamp; and the first stamp, None without dates.

    Raises
    ------
    DataError
        The dates have no common order of day, month and year.
    """
    time_of_day = _time_of_day(texts)
    dates = texts.str.extract(f"({_DATE_PATTERN})").str.replace_all("[/.]", "-")

    first_date = None
    if dates.null_count() == len(dates):
        # A clock that falls by half a day or more has passed midnight.
        is_midnight = np.diff(time_of_day, prepend=time_of_day[:1]) < -_DAY_S / 2
        seconds = time_of_day + _DAY_S * np.cumsum(is_midnight)
    else:
        known_dates = dates.drop_nulls()
        moments = _parse_dates(path, known_dates.unique().to_list())
        first_date = moments[known_dates[0]]
        days = {date: float((moment - first_date).days) for date, moment in moments.items()}
        day_of_stamp = dates.replace_strict(days, default=None, return_dtype=polars.Float64)
        seconds = day_of_stamp.to_numpy() * _DAY_S + time_of_day

    finite_seconds = seconds[np.isfinite(seconds)]
    first_second = float(finite_seconds[0]) if finite_seconds.size else 0.0
    start = None
    if finite_seconds.size and first_date is not None:
        first_us = np.timedelta64(round(first_second * 1e6), "us")
        start = str(np.datetime64(first_date, "us") + first_us)
    return np.round(seconds - first_second, 9), start


def _time_of_day(texts: Any) -> Float[np.ndarray, " time"]:
    """Return the seconds since midnight, in UTC if the stamps state their offset from it."""
    fields = texts.str.extract_groups(_CLOCK_FIELDS).struct.unnest()

    def number(name: str, default: float) -> np.ndarray:
        column = fields[name].str.replace(",", ".").cast(polars.Float64)
        values: np.ndarray = column.fill_null(default).to_numpy()
        return values

    hour = number("hour", np.nan)
    minute = number("minute", 0)
    second = number("second", 0)
    offset_hour = number("offset", 0)
    offset_minute = np.copysign(number("offset_minute", 0), offset_hour)

    half = fields["half"].str.to_lowercase().to_numpy()
    is_pm = half == "p"
    hour = np.where((half == "a") | is_pm, hour % 12 + 12.0 * is_pm, hour)
    return 3600.0 * (hour - offset_hour) + 60.0 * (minute - offset_minute) + second


def _parse_dates(path: Path, dates: list[str]) -> dict[str, datetime]:
    """Return each date as a moment, in the order of day and month that fits all.

    Of several orders, the one with the shortest span holds: a wrong one spreads the days of a
    measurement over months.
    """
    fitting_orders: list[dict[str, datetime]] = []
    for order in _DATE_ORDERS:
        with suppress(ValueError):
            fitting_orders.append({date: datetime.strptime(date, order) for date in dates})

    if not fitting_orders:
        raise DataError(
            f"{path}: its dates have no one order of day, month and year, "
            f"as {dates[0]} and {dates[-1]}."
        )
    return min(fitting_orders, key=lambda moments: max(moments.values()) - min(moments.values()))
