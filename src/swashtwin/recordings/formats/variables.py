"""The variables of a workspace file (MATLAB, NPZ) as columns and facts."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from swashtwin.recordings.formats.raw import RATE_NAMES, RawFile, known_unit


def sorted_variables(variables: Iterable[tuple[str, Any]]) -> RawFile:
    """Vectors as columns; single numbers and texts as attributes, of which some name the rate and the unit.

    A matrix yields one column for each of its longer side's vectors, called ``H(:,1)`` as MATLAB writes it.
    """
    columns: dict[str, np.ndarray] = {}
    facts: dict[str, str] = {}
    for name, value in variables:
        _sort_in(name, value, columns, facts)
    rates = [float(text) for name, text in facts.items() if name.rsplit(".")[-1].lower() in RATE_NAMES]
    unit = known_unit(facts.pop("unit", ""))
    units = dict.fromkeys(columns, unit) if unit else {}
    return RawFile(columns, rates[0] if rates else None, units, facts)


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
