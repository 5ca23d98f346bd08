"""Time stamps in text: ISO 8601, European and American dates, times of the day."""

import re
from collections.abc import Iterable
from datetime import datetime
from typing import Any

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import load_extra

polars: Any = load_extra("polars", "readers", "a time stamp")

_DATE = r"(?:\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[-/.]\d{1,2}[-/.](?:\d{4}|\d{2}))"
_CLOCK = r"\d{1,2}:\d{2}(?::\d{2}(?:[.,]\d{1,9})?)?(?:\s?[AaPp][Mm])?"
_STAMP = re.compile(rf"(?:{_DATE}(?:\s+|[Tt]))?{_CLOCK}(?:\s+{_DATE})?(?:\s?(?:Z|UTC|GMT)|[+-]\d{{2}}(?::?\d{{2}})?)?")
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


class StampReader:
    """Seconds of a column of time stamps that comes in blocks."""

    def __init__(self) -> None:
        self._order = ""
        self._first_day: datetime | None = None
        self._midnights = 0
        self._first: float | None = None
        self._last: float | None = None
        self.start: str | None = None
        """Date and time of the first stamp in ISO 8601; None where the stamps have no date."""

    def seconds(self, texts: Any) -> Float[np.ndarray, " time"]:
        """Seconds since the first stamp, NaN where a text of a polars series is no time stamp."""
        parts = texts.str.extract_groups(_FIELDS).struct.unnest()
        dates = texts.str.extract(f"({_DATE})").str.replace_all("[/.]", "-")
        half = parts["half"].str.to_lowercase().to_numpy()
        hour, minute, second, offset, offset_minute = (
            parts[name].str.replace(",", ".").cast(polars.Float64).fill_null(least).to_numpy()
            for name, least in (("hour", np.nan), ("minute", 0), ("second", 0), ("offset", 0), ("offset_minute", 0))
        )
        hour = np.where((half == "a") | (half == "p"), hour % 12 + 12.0 * (half == "p"), hour)
        clock = 3600.0 * (hour - offset) + 60.0 * (minute - np.copysign(offset_minute, offset)) + second
        if dates.null_count() == len(dates):
            return self._since_first(self._across_midnight(clock))
        stated = dates.drop_nulls()
        days = self._days(stated.unique().to_list(), stated[0])
        seconds = dates.replace_strict(days, default=None, return_dtype=polars.Float64).to_numpy() * _DAY + clock
        finite = seconds[np.isfinite(seconds)]
        if self.start is None and self._first_day is not None and finite.size:
            moment = np.datetime64(self._first_day, "us") + np.timedelta64(round(finite[0] * 1e6), "us")
            self.start = str(moment)
        return self._since_first(seconds)

    def _since_first(self, seconds: Float[np.ndarray, " time"]) -> Float[np.ndarray, " time"]:
        if self._first is None:
            finite = seconds[np.isfinite(seconds)]
            self._first = float(finite[0]) if finite.size else None
        if self._first is None:
            return seconds
        return np.round(seconds - self._first, 9)

    def is_in_order(self, text: str) -> bool:
        """Whether the date in `text`, if there is one, has the order of day, month and year of the first dates."""
        date = re.search(_DATE, text)
        return date is None or not self._order or bool(_moments([re.sub("[/.]", "-", date[0])], self._order))

    def _days(self, dates: list[str], first: str) -> dict[str, float]:
        """Days from the first date to each one, NaN for one of another order."""
        if not self._order:
            self._order = min(_ORDERS, key=lambda order: _span(_moments(dates, order)))
        moments = {date: moment for name in dates for date, moment in _moments([name], self._order).items()}
        if self._first_day is None:
            self._first_day = moments.get(first)
        days = {date: float((moment - (self._first_day or moment)).days) for date, moment in moments.items()}
        return dict.fromkeys(dates, np.nan) | days

    def _across_midnight(self, clock: Float[np.ndarray, " time"]) -> Float[np.ndarray, " time"]:
        """The times of the day, with a day added at each step back by more than half a day."""
        previous = np.concatenate([[clock[0] if self._last is None else self._last], clock[:-1]])
        midnights = self._midnights + np.cumsum(clock - previous < -_DAY / 2)
        self._last, self._midnights = float(clock[-1]), int(midnights[-1])
        return clock + _DAY * midnights


def _moments(dates: Iterable[str], order: str) -> dict[str, datetime]:
    try:
        return {date: datetime.strptime(date, order) for date in dates}
    except ValueError:
        return {}


def _span(moments: dict[str, datetime]) -> float:
    """Days between the first moment and the last: a wrong order of day and month spreads them over months."""
    return (max(moments.values()) - min(moments.values())).days if moments else np.inf
