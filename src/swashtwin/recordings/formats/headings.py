"""What headings, header lines and attributes say of numbers: names, units, the rate, scales,
sensitivities.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from swashtwin.foundation import DataError, UnitError, parse_quantity
from swashtwin.recordings.formats.columns import Column, LazyColumn
from swashtwin.recordings.formats.raw_file import ReadOptions
from swashtwin.recordings.formats.sample_units import SAMPLE_UNITS, normalize_unit, recognize_unit

_BRACKET = re.compile(r"^(.*\S)\s*[\[(]\s*([^\])]+?)\s*[\])]$")
_AFTER_WORD = re.compile(
    r"^(.*?[^\s/])(?:\s+/\s+|/|\s+in\s+|\s+-\s+)\(?([^\s()]+(?:\([^()]*\))?)\)?$"
)
TRADE_UNITS = {
    *SAMPLE_UNITS,
    "s",
    "ms",
    "us",
    "ns",
    "min",
    "h",
    "uV",
    "Nm",
    "kHz",
    "m3/h",
    "l/min",
} - {"1"}
"""Units that a heading or a second line of headings names without square brackets, as `normalize_unit`
writes them.
"""


def split_unit(text: str) -> tuple[str, str | None]:
    """Name and unit of a column heading such as ``acceleration [g]`` or ``Zeit in s``."""
    match = _BRACKET.match(text)
    is_index = match is not None and match[2].isdecimal() and " [" not in text  # Y[1] beside Y[0]
    if (
        match
        and not is_index
        and (
            normalize_unit(match[2]) in TRADE_UNITS
            or (text[-1] == "]" and recognize_unit(match[2]))
        )
    ):
        return match[1].rstrip(" /"), normalize_unit(match[2])
    match = _AFTER_WORD.match(text)
    if match and normalize_unit(match[2]) in TRADE_UNITS:
        return match[1], normalize_unit(match[2])
    return text, None


_RATE_NAME = re.compile(
    r"fs|odr|(?:(?:sampl\w*|acquisition|data)[ _-]?)?(?:rate|freq\w*)|abtast(?:rate|frequenz)"
    r"|samples[ _]?(?:per|/)[ _]?s(?:ec(?:ond)?)?",
    re.IGNORECASE,
)
BARE_RATE = re.compile(r"rate|freq\w*", re.IGNORECASE)
_LEASTBARE_RATE = 200.0
"""What is called a frequency only is that of the mains, a filter or the shaft up to this [Hz]."""
_STEP_NAME = re.compile(
    r"(?:delta|[\u03b4\u2206])[ _]?[tx]|dt|ts|(?:t|(?:sampl\w*|time)[ _-]?)(?:interval|period|step|increment|time)"
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
_LISTED = re.compile(r"[;\t]|(?<=[^\d\s]),|,(?!\d{1,3}(?!\d))")
"""What is between two quantities: a comma before one to three digits may be a decimal one."""
_PER_VOLT = re.compile(r"([mu]?V)\s*/\s*\(?([^()]+?)\)?")


def parse_header(header: str) -> list[tuple[str, str]]:
    """Name and value of each line of a header that is ``name: value``, ``name = value``, or two
    columns.

    A line of words above one with numbers, as scopes write them, pairs each word with the field
    below it.
    """
    pairs, above = [], [""]
    for line in header.splitlines():
        line = line.strip('%#; \t"')
        for separator in (r"[;\t]|:(?!\d\d(?:\D|$))\s*|\s*=\s*", r'"?,"?', r"\s+(?=[+-]?\d)"):
            parts = re.split(separator, line, maxsplit=1)
            if len(parts) == 2:
                pairs.append((parts[0].strip().rstrip(":"), parts[1].strip(' ",;')))
                break
        fields = re.split(r"[;\t,]", line)
        if min(len(fields), len(above)) > 2:
            pairs += [
                (name, text)
                for name, text in zip(above, fields, strict=False)
                if _QUANTITY.fullmatch(text)
            ]
        above = fields
    return pairs


def shows_decimal_comma(pairs: Iterable[tuple[str, str]]) -> bool:
    """Whether a quantity is written with a decimal comma that marks no thousands."""
    matches = [(name, _QUANTITY.fullmatch(text)) for name, text in pairs if "," in text]
    return any(
        match is not None
        and "," in match[1]
        and not GROUPED.fullmatch(match[1])
        and recognize_unit(match[2] or split_unit(name)[1] or "") is not None
        for name, match in matches
    )


def header_rate(pairs: Iterable[tuple[str, str]]) -> float | None:
    """Sample rate [Hz] that names and values state, or its inverse; None where none or two do."""
    rates, pairs = set(), list(pairs)
    is_decimal = shows_decimal_comma(pairs)
    for name, text in pairs:
        heading, unit = split_unit(name)
        if suffix := re.search(r"[_ ](k?hz|[mu]?s)$", heading, re.IGNORECASE):
            heading, unit = heading[: suffix.start()], unit or suffix[1]
        for pattern, base in ((_RATE_NAME, "Hz"), (_STEP_NAME, "s")):
            if not pattern.fullmatch(heading.strip()):
                continue
            for part in filter(None, map(str.strip, _LISTED.split(text))):
                match = _QUANTITY.fullmatch(part)
                if match is None:
                    continue
                if (
                    GROUPED.fullmatch(match[1])
                    and not is_decimal
                    and normalize_unit(match[2]) in ("", "Hz")
                ):
                    continue
                try:
                    value = parse_quantity(
                        f"{match[1].replace(',', '.')} {normalize_unit(match[2] or unit or base)}",
                        base,
                    )
                except UnitError:
                    continue
                if value > (_LEASTBARE_RATE if BARE_RATE.fullmatch(heading.strip()) else 0.0):
                    rates.add(float(f"{value if base == 'Hz' else 1 / value:.9g}"))
    return rates.pop() if len(rates) == 1 else None


def header_units(pairs: Iterable[tuple[str, str]], count: int) -> Sequence[str | None]:
    """Unit of each of `count` channels, where a line of a header names one for each, or one for
    all.
    """
    for name, text in pairs:
        units = [recognize_unit(part) for part in re.split(r"[;\t,]", text) if part.strip()]
        if _UNITS_NAME.fullmatch(name) and units and len(units) in (1, count):
            return units * count if len(units) == 1 else units
    return [None] * count


def read_sensitivities(pairs: Iterable[tuple[str, str]]) -> list[str]:
    """Sensitivities in volts that names and values state, one or several; numbers where no unit is
    beside them.
    """
    pairs = list(pairs)
    beside = [
        text
        for name, text in pairs
        if _SENSITIVITY_NAME.fullmatch(name) and _PER_VOLT.fullmatch(text.strip())
    ]
    for name, text in pairs:
        heading, unit = split_unit(name)
        if not _SENSITIVITY_NAME.fullmatch(heading):
            continue
        match = re.match(r".*[\[(](.*/.*?)[\])]$", name)
        unit = match[1] if match else unit or next(iter(beside), "")
        matches = [
            _QUANTITY.fullmatch(part) for part in map(str.strip, _LISTED.split(text)) if part
        ]
        unit = unit or next((part[2] for part in reversed(matches) if part and part[2]), "")
        if matches and not unit and all(matches):
            return [q[1].replace(",", ".") for q in matches if q]
        units = [
            _PER_VOLT.fullmatch(normalize_unit(part[2] or unit)) if part else None
            for part in matches
        ]
        if units and all(each and recognize_unit(each[2]) for each in units):
            return [
                f"{q[1].replace(',', '.')} {u[1]}/{normalize_unit(u[2])}"
                for q, u in zip(matches, units, strict=True)
                if q and u
            ]
    return []


_UNKNOWN_SCALES = {
    **dict.fromkeys(
        ("scale", "scaling", "slope", "gain", "multiplier", "factor", "conversion", "scalefactor"),
        1.0,
    ),
    **dict.fromkeys(("calibration", "calibration_factor"), 1.0),
    **dict.fromkeys(("offset", "bias", "intercept"), 0.0),
}
"""What files call a scale that may be applied already or not, and the value that makes no
difference.
"""
SCALES = (
    "scale_factor",
    "add_offset",
    "_fillvalue",
    "fill_value",
    "missing_value",
    "valid_range",
    "valid_min",
    "valid_max",
)
"""What the CF conventions call scales, missing values, and bounds beyond which a value is
missing.
"""
LISTS = (
    ("names", "channels", "channel_names", "channelnames", "labels", "titles"),
    ("unit", "units", "unit_string"),
)
"""What a list of names, and one of units, is called that has a text for each vector of a matrix."""
_DATE = re.compile(r"\d{4}-\d\d|\d[./]\d{1,2}[./]\d{2}")
"""When something was calibrated is no scale."""
SCALE_NAMES = (*SCALES, *_UNKNOWN_SCALES)


def unknown_scale(facts: Mapping[str, Any]) -> str:
    """What the facts beside a column state of a scale that may be applied already or not; empty
    where nothing.
    """
    for name, neutral in _UNKNOWN_SCALES.items():
        value = facts.get(name)
        text = value.decode(errors="replace") if isinstance(value, bytes) else str(value)
        numbers = _numbers(value)
        if (numbers != neutral).any():
            return f"{name} = {numbers[0]:g}"
        if (
            value is not None
            and not numbers.size
            and re.search(r"\d", text)
            and not _DATE.search(text)
        ):
            return f"{name} = {text}"
    return ""


def apply_scales(
    where: str,
    column: Column,
    facts: Mapping[str, Any],
    options: ReadOptions,
    number: int = 0,
    count: int = 1,
) -> Column:
    """A column with the scale, the offset and the missing values that the facts beside it state.

    Parameters
    ----------
    facts : by their names in small letters.
    number, count : which of how many columns it is, where the facts state a scale for each.
    """
    if options.sensitivity is None and (scale := unknown_scale(facts)):
        quantity = re.search(r"\d[\d.eE+-]*", scale.partition("=")[2])
        raise DataError(
            f"{where} states {scale}, and not whether it is applied; say what one of its numbers stands for, such as "
            f'sensitivity = "{quantity[0] if quantity else 1} g", or "1 g" where it is applied.'
        )
    numbers = {name: values for name in SCALES if (values := _numbers(facts.get(name))).size}
    if not numbers:
        return column
    for name, sizes in (
        ("scale_factor", {1, count}),
        ("add_offset", {1, count}),
        ("valid_range", {2}),
    ):
        if name in numbers and numbers[name].size not in sizes:
            raise DataError(
                f"{where} states {numbers[name].size} numbers as {name}, and not "
                f"{' or '.join(map(str, sorted(sizes)))}; correct the file."
            )
    factor, offset = (
        float(values[number if values.size > 1 else 0])
        for values in (
            numbers.get("scale_factor", np.ones(1)),
            numbers.get("add_offset", np.zeros(1)),
        )
    )
    missing = np.concatenate(
        [numbers.get(name, np.empty(0)) for name in ("_fillvalue", "fill_value", "missing_value")]
    )
    low, high = numbers.get("valid_range", np.array([-np.inf, np.inf]))
    low, high = (
        max([low, *numbers.get("valid_min", [])]),
        min([high, *numbers.get("valid_max", [])]),
    )

    def samples(start: int, stop: int) -> np.ndarray:
        raw = np.asarray(column[start:stop])
        values = raw.astype(np.float64)
        is_missing = np.isin(raw, missing if raw.dtype.kind in "iu" else missing.astype(raw.dtype))
        is_missing |= (values < low) | (values > high)
        return np.where(is_missing, np.nan, values * factor + offset)

    return LazyColumn(samples, len(column), np.dtype(np.float64))


def _numbers(value: Any) -> np.ndarray:
    try:
        return np.atleast_1d(
            np.asarray(value if value is not None else [], dtype=np.float64)
        ).ravel()
    except (TypeError, ValueError):
        return np.empty(0)
