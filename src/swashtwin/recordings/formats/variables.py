"""The variables of a workspace file (MATLAB, NPZ) as columns and facts."""

import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError, UnitError, parse
from swashtwin.recordings.formats.raw import RATE_NAMES, RawFile, known_unit

STEP_NAMES = ("dt", "delta_t", "deltat", "sampling_interval", "sample_interval", "x_values.increment")
"""What files call the time between two samples [s], the last as Testlab does."""
_UNIT_NAMES = ("unit", "units")
_PARTS = re.compile(r"[./]")
_INDEX = re.compile(r"\(.*\)$")


def sorted_variables(path: Path, variables: Iterable[tuple[str, Any]]) -> RawFile:
    """Vectors as columns; single numbers and texts as attributes, of which some name the rate and the unit.

    A matrix yields one column for each of its longer side's vectors, called ``H(:,1)`` as MATLAB writes it. A rate or a
    unit holds for the vectors of its structure (``a.fs`` for ``a.x``) and of those within; one with the name of a
    vector (``x_fs``, ``fs_x``) for that vector only. The only
    rate in a file holds for all its vectors where none has one of its own.

    Raises
    ------
    DataError
        Two different rates or units are stated for the same vectors.
    """
    columns: dict[str, np.ndarray] = {}
    facts: dict[str, str] = {}
    for name, value in variables:
        _sort_in(name, value, columns, facts)
    stated_rates = {name: rate for name, text in facts.items() if (rate := _rate(name, text)) is not None}
    stated_rates |= {name: 1 / step for name, text in facts.items() if (step := _step(name, text)) is not None}
    stated_units = {name: unit for name, text in facts.items() if (unit := _unit(name, text)) is not None}
    rates: dict[str, float] = {}
    units: dict[str, str] = {}
    for name in columns:
        if (rate := _stated_for(path, name, stated_rates, (*RATE_NAMES, *STEP_NAMES), "sample rates")) is not None:
            rates[name] = rate
        if (unit := _stated_for(path, name, stated_units, _UNIT_NAMES, "units")) is not None:
            units[name] = unit
    facts.pop("unit", None)
    general = {rate for name, rate in stated_rates.items() if _PARTS.split(name.lower())[-1] in RATE_NAMES}
    if len(general) == 1 and not rates:
        rates = dict.fromkeys(columns, general.pop())
    return RawFile(columns, None, units, facts, rates=rates)


def _rate(name: str, text: str) -> float | None:
    if not any(key in name.lower() for key in RATE_NAMES):
        return None
    try:
        return float(text)
    except ValueError:
        pass
    try:
        return parse(text, "Hz")
    except UnitError:
        return None


def _step(name: str, text: str) -> float | None:
    """Time between two samples [s] that a variable states by its name."""
    if _PARTS.split(name.lower())[-1] not in STEP_NAMES and not name.lower().endswith("x_values.increment"):
        return None
    try:
        return float(text) if float(text) > 0 else None
    except ValueError:
        return None


def _unit(name: str, text: str) -> str | None:
    return known_unit(text) if any(key in name.lower() for key in _UNIT_NAMES) else None


def _stated_for(path: Path, column: str, stated: Mapping[str, Any], keys: tuple[str, ...], what: str) -> Any:
    """The value that holds for a column: of the names that fit it, those of the nearest structure."""
    for names in _names_for(column, keys):
        values = {name: value for name, value in stated.items() if name.lower() in names}
        if len(set(values.values())) > 1:
            listed = ", ".join(f"{name} = {value}" for name, value in values.items())
            raise DataError(f"{path} states two {what} for {column} ({listed}); remove the wrong one from the file.")
        if values:
            return next(iter(values.values()))
    return None


def _names_for(column: str, keys: tuple[str, ...]) -> Iterator[set[str]]:
    """Names in small letters under which a value for a column may stand, the nearest first."""
    name = _INDEX.sub("", column).lower()
    *_, last = _PARTS.split(name)
    scope = name[: len(name) - len(last)]
    yield {f"{scope}{text}" for key in keys for text in (f"{last}_{key}", f"{key}_{last}")}
    yield {scope + key for key in keys}
    while scope:
        *_, last = _PARTS.split(scope[:-1])
        scope = scope[: len(scope) - 1 - len(last)]
        yield {scope + key for key in keys}


def _sort_in(name: str, value: Any, columns: dict[str, np.ndarray], facts: dict[str, str]) -> None:
    """Put a variable among the columns or the facts, or nowhere where it is neither."""
    if isinstance(value, str):
        facts[name] = value
        return
    try:
        array = np.asarray(value)
    except ValueError:
        return  # a ragged cell array
    if array.dtype.kind == "U" and array.ndim == 0:
        facts[name] = str(array.item())
    if array.dtype.kind not in "fiub":
        return
    array = np.squeeze(array)
    if array.ndim == 0 and array.size == 1:
        facts[name] = f"{array.item():.12g}"
    elif array.ndim == 1 and array.size > 1:
        columns[name] = array.astype(np.float64)
    elif array.ndim == 2 and array.size:
        tall = array.shape[0] >= array.shape[1]
        for number, vector in enumerate(array.T if tall else array, 1):
            key = f"{name}(:,{number})" if tall else f"{name}({number},:)"
            columns[key] = vector.astype(np.float64)
