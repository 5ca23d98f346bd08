"""What stands above the rows of a text table: rates, units and facts, as lines of a name and a value."""

import re
from collections.abc import Sequence

from swashtwin.foundation import UnitError, parse
from swashtwin.recordings.formats.raw import known_unit, plain_unit
from swashtwin.recordings.formats.tables import split_unit

_RATE = re.compile(r"fs|(?:sampl\w*[ _-]?)?(?:rate|freq\w*)|abtast(?:rate|frequenz)", re.IGNORECASE)
_STEP = re.compile(
    r"delta[ _]?[tx]|dt|(?:sampl\w*|time)[ _-]?(?:interval|period|step|increment)|increment", re.IGNORECASE
)
_UNITS = re.compile(r"y[ _]unit[ _]label|(?:channel[ _])?units?|einheit(?:en)?", re.IGNORECASE)
_NUMBER = re.compile(r"([+-]?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?)\s*(.*)")


def header_pairs(header: str) -> list[tuple[str, str]]:
    """Name and value of each line of a header that is ``name: value``, ``name = value``, or two columns."""
    pairs = []
    for line in header.splitlines():
        parts = re.split(r"[;\t]|:\s|\s*=\s*", line.strip("%#; \t"), maxsplit=1)
        if len(parts) == 2:
            pairs.append((parts[0].strip().rstrip(":"), parts[1].strip()))
    return pairs


def header_rate(header: str) -> float | None:
    """Sample rate [Hz] that a header states as a rate or as the time between two samples, the same for all; or None."""
    rates = set()
    for name, text in header_pairs(header):
        heading, unit = split_unit(name)
        for pattern, base in ((_RATE, "Hz"), (_STEP, "s")):
            if not pattern.fullmatch(heading.strip()):
                continue
            for part in filter(None, map(str.strip, re.split(r"[;\t]", text))):
                match = _NUMBER.fullmatch(part)
                if match is None:
                    continue
                try:
                    value = parse(f"{match[1].replace(',', '.')} {plain_unit(match[2] or unit or base)}", base)
                except UnitError:
                    continue
                if value > 0:
                    rates.add(float(f"{value if base == 'Hz' else 1 / value:.9g}"))
    return rates.pop() if len(rates) == 1 else None


def header_units(header: str, count: int) -> Sequence[str | None]:
    """Unit of each of `count` channels, where a line of a header names one for each, or one for all."""
    for name, text in header_pairs(header):
        units = [known_unit(part) for part in re.split(r"[;\t,]", text) if part.strip()]
        if _UNITS.fullmatch(name) and units and len(units) in (1, count):
            return units * count if len(units) == 1 else units
    return [None] * count
