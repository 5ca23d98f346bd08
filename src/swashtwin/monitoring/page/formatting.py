"""Format numbers, times and names for the pages."""

import math
import re
from datetime import UTC, datetime, timedelta

from swashtwin.foundation import plural

NO_VALUE = "—"
"""Shown for a value that is missing or not finite."""

_MIN_PLAIN = 1e-3

# Magnitudes between which a number is written without an exponent.
_MAX_PLAIN = 1e5

# Units of a duration, the largest first [s].
_DURATION_UNITS = ((86400, "day"), (3600, "hour"), (60, "minute"))
_FREQUENCY = re.compile(r" \([^()]* Hz\)$")


def number(value: float | None, digits: int = 3) -> str:
    """Return a number with a count of significant digits.

    Examples
    --------
    >>> number(0.01234), number(123456.0), number(None)
    ('0.0123', '1.23e+05', '—')
    """
    if value is None or not math.isfinite(value):
        return NO_VALUE
    if value == 0:
        return f"{value:.{digits - 1}f}"
    if not _MIN_PLAIN <= abs(value) < _MAX_PLAIN:
        return f"{value:.{digits - 1}e}"

    decimals = digits - 1 - math.floor(math.log10(abs(value)))
    return f"{value:.{max(0, decimals)}f}"


def percent(share: float | None) -> str:
    """Return a share in percent, never rounded up to 100 % or down to 0 %."""
    if share is None or not math.isfinite(share):
        return NO_VALUE
    if 0.995 < share < 1:
        return "> 99 %"
    if 0 < share < 0.005:
        return "< 1 %"
    return f"{100 * share:.0f} %"


def signed(value: float) -> str:
    """Return a change with its sign and one decimal."""
    return f"{value:+.1f}".replace("-", "−")


def format_time(time: datetime | None) -> str:
    """Return a time in UTC to the second; the page's script shows it in the reader's zone."""
    if time is None:
        return NO_VALUE
    return time.astimezone(UTC).strftime("%Y-%m-%d %H:%M:%S UTC")


def stored_time(text: str) -> datetime:
    """Return a time that the history keeps as text, in ISO 8601."""
    return datetime.fromisoformat(text)


def format_duration(duration: timedelta) -> str:
    """Return a duration in its largest unit.

    Examples
    --------
    >>> format_duration(timedelta(hours=30)), format_duration(timedelta(hours=5))
    ('1 day', '5 hours')
    """
    seconds = duration.total_seconds()
    for unit_s, unit in _DURATION_UNITS:
        if seconds >= unit_s:
            return plural(int(seconds // unit_s), unit)
    return "less than a minute"


def format_age(time: datetime, now: datetime) -> str:
    """Return how long before `now` a time was, in its largest unit."""
    return f"{format_duration(now - time)} ago"


def format_label(label: str | None) -> str:
    """Return a class for a reader, such as ``Swash plate``."""
    if label is None:
        return NO_VALUE
    return label.replace("_", " ").capitalize()


def indicator_name(described_name: str) -> str:
    """Return the name under which the history stores an indicator.

    An indicator that changed is described with the frequency of its order; the stored name has no
    frequency, since that depends on the speed.

    Examples
    --------
    >>> indicator_name("shaft order 9 of the envelope (129 Hz)")
    'shaft order 9 of the envelope'
    """
    return _FREQUENCY.sub("", described_name)
