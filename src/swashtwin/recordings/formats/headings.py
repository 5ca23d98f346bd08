"""Names, units, rates and sensitivities that headings, header lines and attributes state."""

import re
from collections.abc import Iterable, Sequence

from swashtwin.foundation import UnitError, parse_quantity
from swashtwin.recordings.formats.sample_units import (
    SAMPLE_UNITS,
    normalize_unit,
    recognize_unit,
)

_UNIT_IN_BRACKETS = re.compile(r"^(.*\S)\s*[\[(]\s*([^\])]+?)\s*[\])]$")
_UNIT_AFTER_WORD = re.compile(
    r"^(.*?[^\s/])(?:\s+/\s+|/|\s+in\s+|\s+-\s+)\(?([^\s()]+(?:\([^()]*\))?)\)?$"
)
_OTHER_TRADE_UNITS = {"s", "ms", "us", "ns", "min", "h", "uV", "Nm", "kHz", "m3/h", "l/min"}
TRADE_UNITS = {*SAMPLE_UNITS, *_OTHER_TRADE_UNITS} - {"1"}
"""Units, as `normalize_unit` writes them, that a heading may name without square brackets.

Other words that are units, such as a name "A/B", are not taken for one.
"""
_RATE_NAME = re.compile(
    r"fs|odr|(?:(?:sampl\w*|acquisition|data)[ _-]?)?(?:rate|freq\w*)|abtast(?:rate|frequenz)"
    r"|samples[ _]?(?:per|/)[ _]?s(?:ec(?:ond)?)?",
    re.IGNORECASE,
)
BARE_RATE = re.compile(r"rate|freq\w*", re.IGNORECASE)
"""Names that may be a sample rate, or the frequency of something else."""

# Up to this, what is called a frequency only is that of the mains, a filter or the shaft.
_MIN_BARE_RATE_HZ = 200.0

_STEP_NAME = re.compile(
    r"(?:delta|[\u03b4\u2206])[ _]?[tx]|dt|ts"
    r"|(?:t|(?:sampl\w*|time)[ _-]?)(?:interval|period|step|increment|time)"
    r"|(?:wf_)?increment|h[ _-]?resolution",
    re.IGNORECASE,
)
_UNITS_NAME = re.compile(
    r"[yv][ _]?units?(?:[ _]label)?|(?:channel[ _]|vertical[ _])?units?|einheit(?:en)?", re.I
)
_SENSITIVITY_NAME = re.compile(
    r"(?:.*[ _.])?(?:sensitivit(?:y|ies)|empfindlichkeit(?:en)?)(?:[ _.].*)?", re.IGNORECASE
)
_QUANTITY = re.compile(
    r"([+-]?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?)[\s,\"]*([^,\"#]*?)\s*(?:[,\"#].*)?"
)
GROUPED = re.compile(r"[1-9]\d{0,2}(?:,\d{3})+")
"""A number that may be one above a thousand, or one with three decimals."""

# Separator of two quantities: a comma before one to three digits may be a decimal one.
_LIST_SEPARATOR = re.compile(r"[;\t]|(?<=[^\d\s]),|,(?!\d{1,3}(?!\d))")

_PER_VOLT = re.compile(r"([mu]?V)\s*/\s*\(?([^()]+?)\)?")


def split_unit(text: str) -> tuple[str, str | None]:
    """Return name and unit of a column heading.

    Examples
    --------
    >>> split_unit("acceleration [g]"), split_unit("Zeit in s"), split_unit("Y[1]")
    (('acceleration', 'g'), ('Zeit', 's'), ('Y[1]', None))
    >>> split_unit("Gyroscope x (rad/s)")
    ('Gyroscope x (rad/s)', None)
    """
    match = _UNIT_IN_BRACKETS.match(text)
    if match:
        is_index = match[2].isdecimal() and " [" not in text
        is_unit = normalize_unit(match[2]) in TRADE_UNITS
        is_unit = is_unit or (text[-1] == "]" and recognize_unit(match[2]) is not None)
        if is_unit and not is_index:
            return match[1].rstrip(" /"), normalize_unit(match[2])

    match = _UNIT_AFTER_WORD.match(text)
    # A slash within brackets belongs to their unit: "(rad/s)" is not "(rad" in seconds.
    is_within_brackets = match is not None and re.search(r"[\[(][^\])]*$", match[1]) is not None
    # "mm/s" is a velocity, not millimeters of a time in seconds.
    is_velocity = match is not None and re.search(r"(?:^|[\s_])[muµμ]?m$", match[1]) is not None
    is_part = is_within_brackets or (is_velocity and "/" in text)
    if match and not is_part and normalize_unit(match[2]) in TRADE_UNITS:
        return match[1], normalize_unit(match[2])
    return text, None


def parse_header(header: str) -> list[tuple[str, str]]:
    """Return name and value of each header line that is a pair.

    A pair is ``name: value``, ``name = value``, or two columns. A line of words above one with
    numbers, as oscilloscopes write them, pairs each word with the field below it.
    """
    pairs: list[tuple[str, str]] = []
    previous_fields = [""]
    for line in header.splitlines():
        line = line.strip('%#; \t"')
        for separator in (r"[;\t]|:(?!\d\d(?:\D|$))\s*|\s*=\s*", r'"?,"?', r"\s+(?=[+-]?\d)"):
            parts = re.split(separator, line, maxsplit=1)
            if len(parts) == 2:
                pairs.append((parts[0].strip().rstrip(":"), parts[1].strip(' ",;')))
                break

        fields = re.split(r"[;\t,]", line)
        if min(len(fields), len(previous_fields)) > 2:
            columns = zip(previous_fields, fields, strict=False)
            pairs += [(name, text) for name, text in columns if _QUANTITY.fullmatch(text)]
        previous_fields = fields
    return pairs


def shows_decimal_comma(pairs: Iterable[tuple[str, str]]) -> bool:
    """Return whether a quantity has a decimal comma that cannot be a mark for thousands."""
    for name, text in pairs:
        match = _QUANTITY.fullmatch(text)
        if match is None or "," not in match[1] or GROUPED.fullmatch(match[1]):
            continue
        if recognize_unit(match[2] or split_unit(name)[1] or "") is not None:
            return True
    return False


def header_rate(pairs: Iterable[tuple[str, str]]) -> float | None:
    """Return the sample rate [Hz] that names and values state, directly or as a time step.

    None if no pair states one, or if two pairs state different ones.
    """
    pairs = list(pairs)
    is_decimal_comma = shows_decimal_comma(pairs)
    rates: set[float] = set()
    for name, text in pairs:
        heading, unit = split_unit(name)
        suffix = re.search(r"[_ ](k?hz|[mu]?s)$", heading, re.IGNORECASE)
        if suffix:
            heading = heading[: suffix.start()]
            unit = unit or suffix[1]
        heading = heading.strip()

        if _RATE_NAME.fullmatch(heading):
            minimum = _MIN_BARE_RATE_HZ if BARE_RATE.fullmatch(heading) else 0.0
            values = _header_values(text, unit or "Hz", "Hz", is_decimal_comma)
            rates |= {float(f"{value:.9g}") for value in values if value > minimum}
        if _STEP_NAME.fullmatch(heading):
            values = _header_values(text, unit or "s", "s", is_decimal_comma)
            rates |= {float(f"{1 / value:.9g}") for value in values if value > 0}

    return rates.pop() if len(rates) == 1 else None


def _header_values(text: str, unit: str, si_unit: str, is_decimal_comma: bool) -> list[float]:
    """Return the quantities of a text in `si_unit`; without a unit they are in `unit`."""
    values: list[float] = []
    for part in _LIST_SEPARATOR.split(text):
        match = _QUANTITY.fullmatch(part.strip())
        if match is None:
            continue

        may_be_thousands = GROUPED.fullmatch(match[1]) and normalize_unit(match[2]) in ("", "Hz")
        if may_be_thousands and not is_decimal_comma:
            continue

        quantity = f"{match[1].replace(',', '.')} {normalize_unit(match[2] or unit)}"
        try:
            values.append(parse_quantity(quantity, si_unit))
        except UnitError:
            continue
    return values


def header_units(pairs: Iterable[tuple[str, str]], count: int) -> Sequence[str | None]:
    """Return the unit of each of `count` channels by a header line with one for each, or for
    all.
    """
    for name, text in pairs:
        units = [recognize_unit(part) for part in re.split(r"[;\t,]", text) if part.strip()]
        if _UNITS_NAME.fullmatch(name) and units and len(units) in (1, count):
            return units * count if len(units) == 1 else units
    return [None] * count


def read_sensitivities(pairs: Iterable[tuple[str, str]]) -> list[str]:
    """Return the sensitivities in volts that names and values state, one or several.

    A sensitivity without a unit is returned as a number.
    """
    pairs = list(pairs)
    units_alone = [
        text
        for name, text in pairs
        if _SENSITIVITY_NAME.fullmatch(name) and _PER_VOLT.fullmatch(text.strip())
    ]
    for name, text in pairs:
        heading, heading_unit = split_unit(name)
        if not _SENSITIVITY_NAME.fullmatch(heading):
            continue

        parts = [part.strip() for part in _LIST_SEPARATOR.split(text)]
        quantities = [_QUANTITY.fullmatch(part) for part in parts if part]
        unit = _sensitivity_unit(name, heading_unit, units_alone, quantities)
        if quantities and all(quantities) and not unit:
            return [match[1].replace(",", ".") for match in quantities if match]

        sensitivities = [_sensitivity(match, unit) for match in quantities]
        if sensitivities and all(sensitivities):
            return [sensitivity for sensitivity in sensitivities if sensitivity]
    return []


def _sensitivity_unit(
    name: str,
    heading_unit: str | None,
    units_alone: Sequence[str],
    quantities: Sequence[re.Match[str] | None],
) -> str:
    """Return the unit of sensitivities: of the heading, of another line, or of the last of them."""
    bracketed = re.match(r".*[\[(](.*/.*?)[\])]$", name)
    if bracketed:
        return bracketed[1]
    if heading_unit:
        return heading_unit
    if units_alone:
        return units_alone[0]
    return next((match[2] for match in reversed(quantities) if match and match[2]), "")


def _sensitivity(quantity: re.Match[str] | None, unit: str) -> str | None:
    """Return a quantity as a sensitivity such as ``"99.7 mV/g"``, or None if it is not one."""
    if quantity is None:
        return None
    per_volt = _PER_VOLT.fullmatch(normalize_unit(quantity[2] or unit))
    if per_volt is None or not recognize_unit(per_volt[2]):
        return None
    return f"{quantity[1].replace(',', '.')} {per_volt[1]}/{normalize_unit(per_volt[2])}"
