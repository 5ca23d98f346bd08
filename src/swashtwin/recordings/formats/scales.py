"""Scales, offsets and missing values that files state for a column, and their application."""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float64

from swashtwin.foundation import DataError
from swashtwin.recordings.columns import Column, LazyColumn
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
        quantity = re.search(r"\d[\d.eE+-]*", scale.partition("=")[2])
        proposal = quantity[0] if quantity else "1"
        raise DataError(
            f"{location} states {scale}, and not whether it is applied.",
            field="sensitivity",
            remedy=f"Set the value of one of its numbers, such as {{sensitivity='{proposal} g'}}, "
            "or '1 g' if the scale is applied.",
        )

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
