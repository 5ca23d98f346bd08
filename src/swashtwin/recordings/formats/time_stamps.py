"""Time stamps in text: ISO 8601, European and American dates, times of day."""

import re
from collections.abc import Collection
from contextlib import suppress
from datetime import datetime
from pathlib import Path

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import DataError

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

# Forms of texts for a missing stamp. With more the column is damaged, and parsing stops.
_MAX_OTHER_LAYOUTS = 32

_ZERO = np.uint8(ord("0"))
_HYPHEN = np.uint8(ord("-"))
_DATE_MARKS = np.frombuffer(b"/.", dtype=np.uint8)


def is_stamp(text: str) -> bool:
    """Return whether `text` is a time of day, with or without a date."""
    return _STAMP.fullmatch(text.strip()) is not None


def is_date(text: str) -> bool:
    """Return whether `text` is a date without a time of day."""
    return _DATE.fullmatch(text.strip()) is not None


class StampReader:
    """Time stamps of a column, which are read block by block."""

    def __init__(self) -> None:
        self.n_missing = 0
        """Texts for a missing stamp."""
        self.n_stamps = 0
        """All texts."""
        self._times_of_day: list[np.ndarray] = []
        self._run_dates: list[np.ndarray] = []
        """Dates, each of one stamp or of several in a row: most have the date of the one before."""
        self._run_lengths: list[np.ndarray] = []

    def append(self, texts: np.ndarray, missing_texts: Collection[bytes]) -> None:
        """Parse the texts of further rows.

        Parameters
        ----------
        texts : array of bytes, which hold UTF-8. If many different ones are not time stamps,
            further ones are not parsed.
        missing_texts : texts for a missing stamp.
        """
        time_of_day, dates = _parse_stamps(texts)
        others = texts[np.isnan(time_of_day)].tolist()
        self.n_missing += sum(text in missing_texts for text in others)
        self.n_stamps += len(texts)

        starts = np.flatnonzero(np.append(True, dates[1:] != dates[:-1]))
        self._times_of_day.append(time_of_day)
        self._run_dates.append(dates[starts])
        self._run_lengths.append(np.diff(starts, append=len(dates)))

    def seconds(self, path: Path) -> tuple[Float[np.ndarray, " time"], str | None]:
        """Return the seconds since the first time stamp, and that stamp in ISO 8601.

        Returns
        -------
        Seconds, NaN for a text that is not a time stamp; and the first stamp, None without dates.

        Raises
        ------
        DataError
            The dates have no common order of day, month and year.
        """
        time_of_day = np.concatenate(self._times_of_day)
        run_dates = np.concatenate(self._run_dates)

        first_date = None
        if not run_dates.any():
            # A clock that falls by half a day or more has passed midnight.
            is_midnight = np.diff(time_of_day, prepend=time_of_day[:1]) < -_DAY_S / 2
            seconds = time_of_day + _DAY_S * np.cumsum(is_midnight)
        else:
            distinct_dates, date_of_run = np.unique(run_dates, return_inverse=True)
            known_dates = [date.decode() for date in distinct_dates.tolist() if date]
            moments = _parse_dates(path, known_dates)

            first_date = moments[run_dates[run_dates != b""][0].decode()]
            days = {date.encode(): (moment - first_date).days for date, moment in moments.items()}
            distinct_days = np.array([days.get(date, np.nan) for date in distinct_dates.tolist()])
            run_days = distinct_days[date_of_run]
            day_of_stamp = np.repeat(run_days, np.concatenate(self._run_lengths))
            seconds = day_of_stamp * _DAY_S + time_of_day

        finite_seconds = seconds[np.isfinite(seconds)]
        first_second = float(finite_seconds[0]) if finite_seconds.size else 0.0
        start = None
        if finite_seconds.size and first_date is not None:
            first_us = np.timedelta64(round(first_second * 1e6), "us")
            start = str(np.datetime64(first_date, "us") + first_us)
        return np.round(seconds - first_second, 9), start


def _parse_stamps(texts: np.ndarray) -> tuple[Float[np.ndarray, " time"], np.ndarray]:
    """Return the seconds since midnight, NaN if a text is not a stamp, and the dates as bytes.

    Texts that differ in their digits alone are parsed together, each field from its place.
    """
    characters = np.ascontiguousarray(texts).view(np.uint8).reshape(len(texts), -1)
    is_digit = (characters >= _ZERO) & (characters <= _ZERO + 9)
    layouts = np.where(is_digit, _ZERO, characters).view(texts.dtype)[:, 0]

    time_of_day = np.full(len(texts), np.nan)
    dates = np.zeros(len(texts), dtype="S10")
    n_others = 0
    rest = np.arange(len(texts))
    while rest.size:
        is_alike = layouts[rest] == layouts[rest[0]]
        rows, rest = rest[is_alike], rest[~is_alike]
        layout = layouts[rows[0]].decode(errors="replace")
        if is_stamp(layout):
            alike = _AlikeStamps(layout, characters[rows])
            time_of_day[rows] = alike.time_of_day()
            dates[rows] = alike.dates()
        else:
            n_others += 1
            if n_others > _MAX_OTHER_LAYOUTS:
                break
    return time_of_day, dates


class _AlikeStamps:
    """Time stamps that differ in their digits alone.

    Parameters
    ----------
    layout : a stamp with a zero for each digit.
    characters : bytes of the stamps (stamp by byte).
    """

    def __init__(self, layout: str, characters: np.ndarray) -> None:
        self._layout = layout
        self._characters = characters

    def time_of_day(self) -> Float[np.ndarray, " time"]:
        """Return the seconds since midnight, in UTC if the stamps state their offset from it."""
        match = re.search(_CLOCK_FIELDS, self._layout)
        assert match is not None  # the layout is that of a stamp

        def number(name: str) -> np.ndarray | float:
            text = match[name]
            return self._number(*match.span(name)) if text else 0.0

        hour = number("hour")
        half = (match["half"] or "").lower()
        if half:
            hour = hour % 12 + 12.0 * (half == "p")

        sign = -1.0 if (match["offset"] or "").startswith("-") else 1.0
        offset_hour = sign * number("offset")
        offset_minute = sign * number("offset_minute")
        seconds = 3600.0 * (hour - offset_hour) + 60.0 * (number("minute") - offset_minute)
        return np.asarray(seconds + number("second"))

    def dates(self) -> np.ndarray:
        """Return the dates with hyphens, as bytes; empty without dates."""
        match = re.search(_DATE_PATTERN, self._layout)
        if match is None:
            return np.zeros(len(self._characters), dtype="S1")

        date = self._columns(*match.span())
        date = np.where(np.isin(date, _DATE_MARKS), _HYPHEN, date)
        return date.view(f"S{date.shape[1]}")[:, 0]

    def _number(self, first: int, stop: int) -> Float[np.ndarray, " time"]:
        """Return the number without its sign that stands at some places of the layout."""
        text = self._layout[first:stop].replace(",", ".")
        digits = self._columns(first, stop)
        value = np.zeros(len(digits))
        for column, character in enumerate(text):
            if character == "0":
                value = 10.0 * value + (digits[:, column] - _ZERO)
        # Both are integers that a double holds, so the quotient is the double next to the decimal.
        return value / 10.0 ** len(text.partition(".")[2])

    def _columns(self, first: int, stop: int) -> np.ndarray:
        """Return the bytes at some places of the layout."""
        first_byte = len(self._layout[:first].encode())
        n_bytes = len(self._layout[first:stop].encode())
        return self._characters[:, first_byte : first_byte + n_bytes]


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
