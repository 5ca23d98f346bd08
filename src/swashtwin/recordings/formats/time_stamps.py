"""Time stamps in text: ISO 8601, European and American dates, times of the day."""

import re
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import DataError, load_extra

polars: Any = load_extra("polars", "readers", "a time stamp")

_DATE = r"(?:\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[-/.]\d{1,2}[-/.](?:\d{4}|\d{2}))"
_CLOCK = r"\d{1,2}:\d{2}(?::\d{2}(?:[.,]\d{1,9})?)?(?:\s?[AaPp][Mm])?"
_STAMP = re.compile(
    rf"(?:{_DATE}(?:\s+|[Tt]))?{_CLOCK}(?:\s+{_DATE})?(?:\s?(?:Z|UTC|GMT)|[+-]\d{{2}}(?::?\d{{2}})?)?"
)
_FIELDS = (
    r"(?P<hour>\d+):(?P<minute>\d+)(?::(?P<second>\d+(?:[.,]\d+)?))?\s?(?:(?P<half>[AaPp])[Mm])?"
    r"(?:(?P<offset>[+-]\d{2})(?::?(?P<offset_minute>\d{2}))?$)?"
)
_DATE_ALONE = re.compile(_DATE)
_ORDERS = ("%d-%m-%Y", "%m-%d-%Y", "%Y-%m-%d", "%d-%m-%y", "%m-%d-%y")
"""Orders of day, month and year, the European one first."""
_DAY = 86_400.0


def is_stamp(text: str) -> bool:
    """Whether `text` is a time of the day, with or without a date."""
    return _STAMP.fullmatch(text.strip()) is not None


def is_date(text: str) -> bool:
    """Whether `text` is a date without a time of the day."""
    return _DATE_ALONE.fullmatch(text.strip()) is not None


def stamp_seconds(path: Path, texts: Any) -> tuple[Float[np.ndarray, " time"], str | None]:
    """Seconds since the first stamp of a polars series, NaN where a text is none, and the date and
    time of the first.

    These are in ISO 8601, and None where the stamps have no date.
    """
    parts = texts.str.extract_groups(_FIELDS).struct.unnest()
    dates = texts.str.extract(f"({_DATE})").str.replace_all("[/.]", "-")
    half = parts["half"].str.to_lowercase().to_numpy()
    hour, minute, second, offset, offset_minute = (
        parts[name].str.replace(",", ".").cast(polars.Float64).fill_null(least).to_numpy()
        for name, least in (
            ("hour", np.nan),
            ("minute", 0),
            ("second", 0),
            ("offset", 0),
            ("offset_minute", 0),
        )
    )
    hour = np.where((half == "a") | (half == "p"), hour % 12 + 12.0 * (half == "p"), hour)
    clock = 3600.0 * (hour - offset) + 60.0 * (minute - np.copysign(offset_minute, offset)) + second
    start = None
    if dates.null_count() == len(dates):
        seconds = clock + _DAY * np.cumsum(
            np.diff(clock, prepend=clock[:1]) < -_DAY / 2
        )  # over midnight
    else:
        stated = dates.drop_nulls()
        moments = _moments(path, stated.unique().to_list())
        days = {date: float((moment - moments[stated[0]]).days) for date, moment in moments.items()}
        seconds = (
            dates.replace_strict(days, default=None, return_dtype=polars.Float64).to_numpy() * _DAY
            + clock
        )
    finite = seconds[np.isfinite(seconds)]
    first = float(finite[0]) if finite.size else 0.0
    if finite.size and dates.null_count() < len(dates):
        start = str(
            np.datetime64(moments[stated[0]], "us") + np.timedelta64(round(first * 1e6), "us")
        )
    return np.round(seconds - first, 9), start


def _moments(path: Path, dates: list[str]) -> dict[str, datetime]:
    """Each date as a moment: a wrong order of day and month spreads them over months, or is none of
    theirs.
    """
    found: list[dict[str, datetime]] = []
    for order in _ORDERS:
        with suppress(ValueError):
            found.append({date: datetime.strptime(date, order) for date in dates})
    if not found:
        raise DataError(
            f"{path}: its dates have no one order of day, month and year, as {dates[0]} and {dates[-1]}."
        )
    return min(found, key=lambda moments: max(moments.values()) - min(moments.values()))
