"""Time zones as a configuration names them."""

import re
from datetime import UTC, timedelta, timezone, tzinfo
from zoneinfo import ZoneInfo

from swashtwin.foundation import InputError

_OFFSET = re.compile(r"([+-])(\d{2}):?(\d{2})")


def read_zone(text: str) -> tzinfo:
    """Return the time zone of a name such as ``Europe/Berlin`` or an offset such as ``+01:00``.

    Raises
    ------
    InputError
        There is no such zone.

    Examples
    --------
    >>> read_zone("+01:00").utcoffset(None)
    datetime.timedelta(seconds=3600)
    """
    if text.upper() in ("UTC", "Z", "GMT"):
        return UTC
    offset = _OFFSET.fullmatch(text)
    if offset is not None:
        sign = -1 if offset[1] == "-" else 1
        return timezone(sign * timedelta(hours=int(offset[2]), minutes=int(offset[3])))
    try:
        return ZoneInfo(text)
    except (OSError, ValueError, LookupError):
        raise InputError(
            f'Unknown time zone {text!r}: write a name such as "Europe/Berlin", an offset such as '
            '"+01:00", or "UTC".'
        ) from None
