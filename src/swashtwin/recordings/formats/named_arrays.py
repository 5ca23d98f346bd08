"""Facts that any file of named arrays states: rates, units, scales, starts, sensitivities."""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Set
from dataclasses import replace
from itertools import filterfalse
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError
from swashtwin.recordings.columns import Column
from swashtwin.recordings.formats.array_shapes import describe_shape, require_small_arrays
from swashtwin.recordings.formats.column_names import is_foreign_unit, parse_time_name
from swashtwin.recordings.formats.headings import BARE_RATE, header_rate, read_sensitivities
from swashtwin.recordings.formats.raw_file import RawFile, ReadOptions
from swashtwin.recordings.formats.sample_units import recognize_unit
from swashtwin.recordings.formats.scales import (
    SCALE_NAMES,
    apply_scales,
    require_known_scale,
    unknown_scale,
)

NAME_LISTS = ("names", "channels", "channel_names", "channelnames", "labels", "titles")
"""Names of a list that has a name for each vector of a matrix."""
UNIT_LISTS = ("unit", "units", "unit_string")
"""Names of a list that has a unit for each vector of a matrix."""
_START_NAMES = ("start_time", "starttime", "wf_start_time", "t0", "start")

# First number of a field of a MATLAB file that stands for an object elsewhere in the file.
_MATLAB_REFERENCE = 0xDD000000

_PATH_SEPARATOR = re.compile(r"[./]")
_CELL = re.compile(r"(.*)\((\d+)\)")
_INDEX = re.compile(r"\(.*\)$")
_NONPOSITIVE = re.compile(r"-\d+(\.\d+)?(e[+-]?\d+)?|0(\.0)?")


def sort_variables(
    path: Path, variables: Iterable[tuple[str, Any]], options: ReadOptions
) -> RawFile:
    """Return vectors as columns, and single numbers and texts as attributes.

    A matrix yields one column for each vector along its longer side. Their names are those of a
    list of as many names, or ``H(:,1)`` as MATLAB writes it.

    Parameters
    ----------
    variables : names, such as ``a.x`` for a field of a structure, and values.
    """
    workspace = _Workspace(variables)

    attributes = {name: text for name, text in workspace.facts.items() if name != "unit"}
    if workspace.excluded:
        attributes["left_out"] = ", ".join(workspace.excluded)
    require_small_arrays(path, workspace.shapes, workspace.columns, options)
    raw = RawFile(
        workspace.columns, None, workspace.units, attributes, foreign_units=workspace.foreign_units
    )
    return attach_facts(path, raw, workspace.facts, options, counts=workspace.counts)


def attach_facts(
    path: Path,
    raw: RawFile,
    facts: Mapping[str, Any],
    options: ReadOptions,
    sources: Mapping[str, tuple[str, int, int]] | None = None,
    counts: Set[str] = frozenset(),
) -> RawFile:
    """Return the columns with the rate, unit, scale, start and sensitivity that facts state.

    A fact holds for the vectors of its structure or group (``a.fs`` for ``a.x``) and of those
    within; one with the name of a vector (``x_fs``, ``fs_x``), or an attribute of a data set
    (``x/fs``), holds for that vector only. The only rate in a file holds for all its vectors if
    none has another.

    Parameters
    ----------
    facts : numbers, texts and lists of them by their paths, such as ``a.fs``.
    sources : (data set, number of the vector, number of its vectors) of each column; None if each
        column is a variable.
    counts : names of the columns of integers. A number that states their scale is not ignored.
    """
    facts_by_scope: dict[str, dict[str, Any]] = {}
    for name, value in facts.items():
        scope, fact_name = _split_path(name.lower())
        facts_by_scope.setdefault(scope, {})[fact_name] = value

    def rate_of(name: str, text: Any) -> float | None:
        if sources is None and BARE_RATE.fullmatch(name):
            return None
        return _read_rate(name, text)

    columns: dict[str, Column] = {}
    readings: dict[str, Any] = {
        "rates": {},
        "units": {},
        "starts": {},
        "sensitivities": {},
    }
    for key, column in raw.columns.items():
        source, number, count = (key, 0, 1) if sources is None else sources[key]
        scopes = list(_facts_around(source, facts_by_scope))
        scales = _scales_of(source, scopes)
        columns[key] = apply_scales(f"{path}: {source}", column, scales, options, number, count)
        if key in counts and not parse_time_name(source):
            shape = {len(column), count, len(raw.columns)}
            require_known_scale(f"{path}: {source}", scopes, shape, options)

        values = {
            "rates": _nearest_fact(path, source, scopes, rate_of, "sample rates"),
            "starts": _nearest_fact(path, source, scopes, _read_start, "starts"),
            "sensitivities": _nearest_sensitivity(scopes),
        }
        if not unknown_scale(scales):  # else the unit may be that of the scaled numbers
            values["units"] = _nearest_fact(path, source, scopes, _read_unit, "units")
        for quantity, value in values.items():
            if value is not None:
                readings[quantity][key] = value

    if not readings["rates"]:
        readings["rates"] = _only_rate(columns, facts, rate_of)
    # The nearest unit counts, even if nobody here knows it.
    foreign_units = dict(filter(_has_foreign_unit, readings["units"].items()))
    known_units = dict(filterfalse(_has_foreign_unit, readings["units"].items()))
    readings["units"] = {**known_units, **raw.units}
    readings["foreign_units"] = {**foreign_units, **raw.foreign_units}
    return replace(raw, columns=columns, **readings)


def _has_foreign_unit(item: tuple[str, str]) -> bool:
    return is_foreign_unit(item[1])


def _read_rate(name: str, text: Any) -> float | None:
    """Return the sample rate [Hz] that a fact states; an impossible one is refused later."""
    if not isinstance(text, str):
        return None
    if _NONPOSITIVE.fullmatch(text) and header_rate([(name, "1")]):
        return float(text)
    return header_rate([(name, text)])


def _read_unit(name: str, text: Any) -> str | None:
    """Return the unit that a fact states, which may be unknown; None if it states none."""
    if name not in UNIT_LISTS or not isinstance(text, str):
        return None
    return text.strip() if is_foreign_unit(text) else recognize_unit(text)


def _read_start(name: str, text: Any) -> Any:
    return text if name in _START_NAMES else None


def _split_path(name: str) -> tuple[str, str]:
    """Return a path as the scope, with its separator, and the name in it."""
    last_name = _PATH_SEPARATOR.split(name)[-1]
    return name[: len(name) - len(last_name)], last_name


def _facts_around(
    name: str, facts_by_scope: Mapping[str, Mapping[str, Any]]
) -> Iterator[Mapping[str, Any]]:
    """Yield the facts that may hold for a vector, the nearest scope first.

    Its attributes, the facts with its name, and those of each structure around it.
    """
    name = _INDEX.sub("", name).lower()
    scope, vector_name = _split_path(name)
    yield facts_by_scope.get(f"{name}/", {})

    neighbors = facts_by_scope.get(scope, {})
    prefix = f"{vector_name}_"
    suffix = f"_{vector_name}"
    yield {
        key.removeprefix(prefix).removesuffix(suffix): value
        for key, value in neighbors.items()
        if key.startswith(prefix) or key.endswith(suffix)
    }

    yield neighbors
    while scope:
        scope = _split_path(scope[:-1])[0]
        yield facts_by_scope.get(scope, {})


def _scales_of(source: str, scopes: list[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the scales that hold for a vector; the nearest scope wins.

    A scale of the structure around is one of the signals, not of their time.
    """
    if parse_time_name(source):
        scopes = scopes[:2]

    scales: dict[str, Any] = {}
    for facts in reversed(scopes):
        scales |= {name: value for name, value in facts.items() if name in SCALE_NAMES}
    return scales


def _nearest_fact(
    path: Path,
    name: str,
    scopes: Iterable[Mapping[str, Any]],
    read: Callable[[str, Any], Any],
    quantity: str,
) -> Any:
    """Return the value that `read` gives in the nearest scope that has one, or None.

    Raises
    ------
    DataError
        That scope states two values of the `quantity`.
    """
    for facts in scopes:
        values: dict[str, Any] = {}
        for key, text in facts.items():
            value = read(key, text)
            if value is not None:
                values[key] = value

        # A rate of zero says that there is none, and is refused only if no other is stated.
        positive_values = {
            key: value for key, value in values.items() if isinstance(value, str) or value > 0
        }
        values = positive_values or values
        if len(set(values.values())) > 1:
            listed = ", ".join(f"{key} = {value}" for key, value in values.items())
            raise DataError(
                f"{path} states two {quantity} for {name} ({listed}); "
                "remove the wrong one from the file."
            )
        if values:
            return next(iter(values.values()))
    return None


def _nearest_sensitivity(scopes: Iterable[Mapping[str, Any]]) -> str | None:
    """Return the sensitivity of the nearest scope; further ones must name it at the beginning."""
    for distance, facts in enumerate(scopes):
        pairs = [(name, text) for name, text in facts.items() if isinstance(text, str)]
        if distance:
            pairs = [pair for pair in pairs if pair[0].startswith("sensitivit")]
        texts = read_sensitivities(pairs)
        if texts:
            return texts[0]
    return None


def _only_rate(
    columns: Iterable[str],
    facts: Mapping[str, Any],
    rate_of: Callable[[str, Any], float | None],
) -> dict[str, float]:
    """Return the only rate that a file states, anywhere in it, for all columns."""
    file_rates: set[float] = set()
    for name, text in facts.items():
        fact_name = _split_path(name.lower())[1]
        rate = None if BARE_RATE.fullmatch(fact_name) else rate_of(fact_name, text)
        if rate is not None:
            file_rates.add(rate)
    return dict.fromkeys(columns, file_rates.pop()) if len(file_rates) == 1 else {}


def _list_of_texts(value: Any) -> list[str]:
    """Return the texts of a list or vector that holds nothing but texts, else an empty list."""
    if isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "UO":
        value = value.tolist()
    if isinstance(value, list) and all(isinstance(text, str) for text in value):
        return value
    return []


class _Workspace:
    """Variables of a workspace, sorted into columns, facts, and what is neither."""

    def __init__(self, variables: Iterable[tuple[str, Any]]) -> None:
        self.columns: dict[str, Column] = {}
        self.units: dict[str, str] = {}
        self.foreign_units: dict[str, str] = {}
        self.facts: dict[str, str] = {}
        self.excluded: list[str] = []
        self.shapes: dict[str, tuple[int, ...]] = {}
        """Shapes of arrays of more than two axes."""
        self.counts: set[str] = set()
        """Names of columns of integers."""

        variables = list(variables)
        cells = (_CELL.fullmatch(name) for name, _ in variables)
        self._cell_counts = Counter(cell[1] for cell in cells if cell)
        """Cells of each cell array."""
        text_lists = {name.lower(): _list_of_texts(value) for name, value in variables}
        self._text_lists = {name: texts for name, texts in text_lists.items() if texts}

        for name, value in variables:
            if isinstance(value, str):
                self.facts[name] = value
            elif name.lower() not in self._text_lists:
                self._sort(name, value)

    def _sort(self, name: str, value: Any) -> None:
        """Add a variable as a column, several columns, a fact, or as excluded."""
        dense = value.toarray() if hasattr(value, "toarray") else value
        try:
            array = np.squeeze(np.asarray(dense))
        except ValueError:
            return  # a ragged cell array

        kind = array.dtype.kind
        is_reference = (
            array.dtype == np.uint32 and array.size > 5 and array.flat[0] == _MATLAB_REFERENCE
        )
        if is_reference:
            self.excluded.append(f"{name} (a MATLAB object)")
        elif kind == "c":
            self.excluded.append(f"{name} (complex numbers)")
        elif array.dtype.names:
            for field in array.dtype.names:
                self._sort(f"{name}.{field}", array[field])
        elif kind in "mM" and array.ndim == 1:
            self.columns[name] = array.astype(f"{kind}8[ns]").astype(np.int64)
            self.units[name] = "ns"
        elif kind == "U" and array.ndim == 0:
            self.facts[name] = str(array.item())
        elif kind in "fiub":
            known_columns = set(self.columns)
            self._add_numbers(name, array)
            if kind in "iu":
                self.counts |= self.columns.keys() - known_columns

    def _add_numbers(self, name: str, array: np.ndarray) -> None:
        if array.ndim == 0:
            self.facts[name] = f"{array.item():.12g}"
        elif array.ndim == 1 and array.size > 1:
            self._add_vector(name, array.astype(np.float64))
        elif array.ndim == 2 and array.size:
            self._add_matrix(name, array.astype(np.float64))
        elif array.ndim > 2 and array.size:
            self.shapes[name] = array.shape
            self.excluded.append(describe_shape(name, array.shape))

    def _add_vector(self, name: str, vector: np.ndarray) -> None:
        cell = _CELL.fullmatch(name)
        if cell is None:
            self._add_column(name, name, 0, self._cell_counts[name], vector)
        else:
            count = self._cell_counts[cell[1]]
            self._add_column(cell[1], name, int(cell[2]) - 1, count, vector)

    def _add_matrix(self, name: str, matrix: np.ndarray) -> None:
        is_tall = matrix.shape[0] >= matrix.shape[1]
        vectors = matrix.T if is_tall else matrix
        for number, vector in enumerate(vectors):
            key = f"{name}(:,{number + 1})" if is_tall else f"{name}({number + 1},:)"
            self._add_column(name, key, number, len(vectors), vector)

    def _add_column(self, name: str, key: str, number: int, count: int, vector: np.ndarray) -> None:
        """Add one of `count` vectors, with the name and unit that lists in its structure state."""
        scope = _split_path(name)[0]

        names = self._first_list(scope, NAME_LISTS)
        if names and len(set(names)) == count:
            key = scope + names[number]

        units = self._first_list(scope, UNIT_LISTS)
        if units and len(units) == count:
            unit = recognize_unit(units[number])
            if unit:
                self.units[key] = unit
            elif is_foreign_unit(units[number]):
                self.foreign_units[key] = units[number]

        self.columns[key] = vector

    def _first_list(self, scope: str, names: Iterable[str]) -> list[str]:
        for name in names:
            texts = self._text_lists.get((scope + name).lower())
            if texts:
                return texts
        return []
