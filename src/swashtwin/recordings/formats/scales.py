"""Scales, offsets and missing values that files state for a column, and their application."""

import re
from collections.abc import Mapping, Sequence, Set
from typing import Any

import numpy as np
from jaxtyping import Float64

from swashtwin.foundation import DataError
from swashtwin.recordings.columns import Column, LazyColumn
from swashtwin.recordings.formats.column_names import Quantity, meaning_of_name
from swashtwin.recordings.formats.headings import BARE_RATE, header_rate
from swashtwin.recordings.formats.raw_file import ReadOptions

# Names of scales that may be applied already or not, and the value that makes no difference.
_UNKNOWN_SCALES = {
    **dict.fromkeys(
        ("scale", "scaling", "slope", "gain", "multiplier", "factor", "conversion", "scalefactor"),
        1.0,
    ),
    **dict.fromkeys(("calibration", "calibration_factor"), 1.0),
    **dict.fromkeys(("offset", "bias", "intercept"), 0.0),
}

_MISSING_NAMES = ("_fillvalue", "fill_value", "missing_value")

# Scales, missing values, and bounds of valid values by the CF conventions (cfconventions.org).
_CF_SCALES = (
    "scale_factor",
    "add_offset",
    *_MISSING_NAMES,
    "valid_range",
    "valid_min",
    "valid_max",
)

SCALE_NAMES = (*_CF_SCALES, *_UNKNOWN_SCALES)

# The date of a calibration, which is not a scale.
_DATE = re.compile(r"\d{4}-\d\d|\d[./]\d{1,2}[./]\d{2}")


# Names of numbers that identify or count something.
_IDENTIFIER = re.compile(
    r"(?:^|_)(?:id|number|no|nr|index|version|revision|serial|date|year|channels?|length|size|"
    r"samples?|label|class|duration|load)$|^n_|^num_"
)
_OTHER_QUANTITIES = (Quantity.other, Quantity.time, Quantity.label)
_NEUTRAL_FACTS = ("start_time", "starttime", "wf_start_time", "wf_start_offset", "t0", "start")

# A number with or without a unit.
_QUANTITY = re.compile(r"[±+-]?\s*\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?\s*[^\W\d][^\d:]{0,15}")


def unknown_scale(facts: Mapping[str, Any]) -> str:
    """Return the scale, as text, that may be applied already or not; empty if there is none.

    Parameters
    ----------
    facts : facts of a column by their names in small letters.
    """
    for name, neutral_value in _UNKNOWN_SCALES.items():
        value = facts.get(name)
        numbers = _as_numbers(value)
        if (numbers != neutral_value).any():
            return f"{name} = {numbers[0]:g}"

        text = value.decode(errors="replace") if isinstance(value, bytes) else str(value)
        is_text = value is not None and not numbers.size
        if is_text and re.search(r"\d", text) and not _DATE.search(text):
            return f"{name} = {text}"
    return ""


def apply_scales(
    location: str,
    column: Column,
    facts: Mapping[str, Any],
    options: ReadOptions,
    number: int = 0,
    count: int = 1,
) -> Column:
    """Return a column with the scale, offset and missing values that its facts state.

    Parameters
    ----------
    location : file and column, for messages.
    facts : facts of the column by their names in small letters.
    number, count : which of how many columns it is, if the facts state a scale for each.

    Raises
    ------
    DataError
        A scale may be applied already or not, or there are more scales than columns.
    """
    scale = unknown_scale(facts)
    if options.sensitivity is None and scale:
        raise _unknown_scale_error(location, scale)

    numbers = {name: _as_numbers(facts.get(name)) for name in _CF_SCALES}
    numbers = {name: values for name, values in numbers.items() if values.size}
    if not numbers:
        return column
    _require_sizes(location, numbers, count)

    factor = _value_of_column(numbers, "scale_factor", 1.0, number)
    offset = _value_of_column(numbers, "add_offset", 0.0, number)
    missing = np.concatenate([numbers.get(name, np.empty(0)) for name in _MISSING_NAMES])
    low, high = numbers.get("valid_range", np.array([-np.inf, np.inf]))
    low = max([low, *numbers.get("valid_min", [])])
    high = min([high, *numbers.get("valid_max", [])])

    def read(start: int, stop: int) -> np.ndarray:
        stored = np.asarray(column[start:stop])
        values = stored.astype(np.float64)
        # Single precision rounds a missing value such as 1e20: it is compared as it is stored.
        is_integer = stored.dtype.kind in "iu"
        is_missing = np.isin(stored, missing if is_integer else missing.astype(stored.dtype))
        is_missing |= (values < low) | (values > high)
        return np.where(is_missing, np.nan, values * factor + offset)

    return LazyColumn(read, len(column), np.dtype(np.float64))


def require_known_scale(
    location: str,
    scopes: Sequence[Mapping[str, Any]],
    shape: Set[int],
    options: ReadOptions,
) -> None:
    """Refuse integers beside which stands a number that may be their scale.

    The user specifies a sensitivity, or that the unit is unknown ("1"), to read them.

    Parameters
    ----------
    location : file and column, for messages.
    scopes : facts of the column and of the structures around, the nearest first.
    shape : numbers that count samples and columns, which are no scales.

    Raises
    ------
    DataError
        A number stands there that states no rate, speed, start or count.
    """
    if options.sensitivity is not None or options.unit == "1":
        return
    if any(name in _CF_SCALES for facts in scopes for name in facts):
        return

    for facts in scopes:
        for name, value in facts.items():
            quantity = _quantity_of(value)
            if quantity and not _is_understood(name, quantity, shape):
                raise _unknown_scale_error(location, f"{name} = {quantity} beside integers")


def _quantity_of(value: Any) -> str:
    """Return a number, with or without a unit, as text; empty if the value is something else."""
    numbers = _as_numbers(value)
    if numbers.size:
        return f"{numbers[0]:g}" if np.isfinite(numbers).all() else ""
    text = value.decode(errors="replace") if isinstance(value, bytes) else value
    return text if isinstance(text, str) and _QUANTITY.fullmatch(text.strip()) else ""


def _is_understood(name: str, quantity: str, shape: Set[int]) -> bool:
    """Return whether a number has a meaning other than a scale."""
    if name.startswith("_") or _IDENTIFIER.search(name) or name in _NEUTRAL_FACTS:
        return True
    if BARE_RATE.fullmatch(name) or header_rate([(name, quantity)]) or header_rate([(name, "1")]):
        return True
    if quantity in {"0", "1", *(str(count) for count in shape)}:
        return True
    meaning = meaning_of_name(name)
    return meaning is not None and meaning.quantity in _OTHER_QUANTITIES


def _unknown_scale_error(location: str, scale: str) -> DataError:
    quantity = re.search(r"\d[\d.eE+-]*", scale.partition("=")[2])
    proposal = quantity[0] if quantity else "1"
    return DataError(
        f"{location} states {scale}, and not whether it is applied.",
        field="sensitivity",
        remedy=f"Set the value of one of its numbers, such as {{sensitivity='{proposal} g'}}, "
        "or '1 g' if the scale is applied.",
    )


def _require_sizes(location: str, numbers: Mapping[str, np.ndarray], count: int) -> None:
    """Refuse a scale or offset that is neither one for all columns nor one for each."""
    allowed_sizes = {"scale_factor": {1, count}, "add_offset": {1, count}, "valid_range": {2}}
    for name, sizes in allowed_sizes.items():
        if name in numbers and numbers[name].size not in sizes:
            allowed = " or ".join(str(size) for size in sorted(sizes))
            raise DataError(
                f"{location} states {numbers[name].size} numbers as {name}, and not {allowed}; "
                "correct the file."
            )


def _value_of_column(
    numbers: Mapping[str, np.ndarray], name: str, neutral_value: float, number: int
) -> float:
    values = numbers.get(name)
    if values is None:
        return neutral_value
    return float(values[number if values.size > 1 else 0])


def _as_numbers(value: Any) -> Float64[np.ndarray, " number"]:
    """Return a number, or a list of them, as a vector; empty if it is something else."""
    if value is None:
        return np.empty(0)
    try:
        return np.atleast_1d(np.asarray(value, dtype=np.float64)).ravel()
    except (TypeError, ValueError):
        return np.empty(0)
