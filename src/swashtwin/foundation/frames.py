"""Results as data frames of pandas, which is an optional package."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from swashtwin.foundation.packages import load_extra


def data_frame(rows: Iterable[Mapping[str, Any]]) -> Any:
    """Return a ``pandas.DataFrame`` of JSON values, with one row for each mapping.

    The columns are the keys. A key within another is joined to it by a dot, as by
    ``pandas.json_normalize``, and so are ``low`` and ``high`` of a range. A list of texts is one
    text; other lists are left out.

    Raises
    ------
    MissingExtraError
        pandas is not installed.
    """
    pandas = load_extra("pandas", "frames", "a data frame")
    flat_rows = []
    for row in rows:
        cells: dict[str, Any] = {}
        for name, value in row.items():
            cells |= _flatten(name, value)
        flat_rows.append(cells)
    return pandas.DataFrame(flat_rows)


def _flatten(name: str, value: Any) -> dict[str, Any]:
    """Return the cells of one key by column."""
    if isinstance(value, Mapping):
        cells: dict[str, Any] = {}
        for key, part in value.items():
            cells |= _flatten(f"{name}.{key}", part)
        return cells
    if not isinstance(value, list | tuple):
        return {name: value}
    if all(isinstance(part, str) for part in value):
        return {name: "; ".join(value)}
    if _is_range(value):
        return {f"{name}.low": value[0], f"{name}.high": value[1]}
    return {}


def _is_range(value: Sequence[Any]) -> bool:
    return len(value) == 2 and all(isinstance(end, int | float) for end in value)
