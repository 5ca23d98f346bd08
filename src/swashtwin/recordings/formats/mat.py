"""MATLAB files, versions 4 to 7.3."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError, UnitError, load_extra, parse, require_memory
from swashtwin.recordings.formats.clock import timed
from swashtwin.recordings.formats.raw import Column, Options, RawFile, known_unit, plain_unit
from swashtwin.recordings.formats.tables import LISTS, SCALE_NAMES, obeyed, stated_sensitivities, unknown_scale
from swashtwin.recordings.recording import Recording

_KINDS = ("double", "single", "logical", "char", "cell", "struct", "sparse", "unknown", *(
    f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)
))  # fmt: skip
"""Kinds of variables that are no objects."""
_REFERENCE = 0xDD000000
"""First number of a field that stands for an object elsewhere in the file."""


def read(path: Path, options: Options) -> RawFile:
    """Vectors of a MATLAB file as columns, its single numbers and texts as attributes.

    Objects, such as a table or a datetime, are named and left out. A file of LabChart has one vector, and where each
    channel begins and ends in it.
    """
    import h5py

    pymatreader = load_extra("pymatreader", "readers", "a MATLAB file")
    if h5py.is_hdf5(path):
        _require_data_within(path)
    variables = pymatreader.whosmat(path)
    require_memory(path, sum(8 * prod(shape) for _, shape, _ in variables))
    objects = {name: kind for name, _, kind in variables if kind not in _KINDS and name[:1] != "#"}
    content = pymatreader.read_mat(path)
    content = {name: value for name, value in content.items() if name not in objects and name[:1] not in ("#", "_")}
    raw = sorted_variables(path, _labchart(content) or _flattened(content), options)
    if objects and not raw.columns:
        name, kind = next(iter(objects.items()))
        kind = "object" if kind == "opaque" else kind
        raise DataError(f"{path}: {name} is a MATLAB {kind}, which cannot be read; save its columns as vectors.")
    if objects:
        raw = replace(raw, attributes={**raw.attributes, "objects": ", ".join(objects)})
    return timed(path, raw, options)


def _labchart(content: dict[str, Any]) -> list[tuple[str, Any]]:
    """The channels of a file of LabChart: one vector, and where each channel begins and ends in it; else nothing."""
    if not {"data", "datastart", "dataend", "titles"} <= content.keys():
        return []
    data, titles = np.ravel(content["data"]), [str(title).strip() for title in np.ravel(content["titles"])]
    starts, ends, rates = (
        np.asarray(content[key], dtype=np.float64).reshape(len(titles), -1)
        for key in ("datastart", "dataend", "samplerate")
    )
    scales, offsets = (
        np.broadcast_to(np.asarray(content.get(key, neutral), dtype=np.float64), starts.shape)
        for key, neutral in (("scaleunits", 1.0), ("scaleoffset", 0.0))
    )
    units = np.ravel(content.get("unittext", []))
    chosen = np.asarray(content.get("unittextmap", np.ones_like(starts))).reshape(len(titles), -1)
    pairs: list[tuple[str, Any]] = []
    for row, title in enumerate(titles):
        for block in range(starts.shape[1]):
            if starts[row, block] < 1:
                continue  # this channel was not recorded then
            name = title if starts.shape[1] == 1 else f"{title} block {block + 1}"
            samples = data[int(starts[row, block]) - 1 : int(ends[row, block])]
            samples = (samples + offsets[row, block]) * scales[row, block]
            pairs.append((name, samples))
            pairs.append((f"{name}_fs", float(rates[row, min(block, rates.shape[1] - 1)])))
            number = int(chosen[row, min(block, chosen.shape[1] - 1)])
            if 1 <= number <= len(units):
                pairs.append((f"{name}_unit", str(units[number - 1]).strip()))
    return pairs


def _require_data_within(path: Path) -> None:
    """Refuse a version 7.3 file whose data sets are not all in it."""
    import h5py

    from swashtwin.recordings.formats.hdf5 import require_data_within, require_links_within

    with h5py.File(path, "r", locking=False) as file:
        require_links_within(path, file)
        file.visititems(lambda _, item: require_data_within(path, item) if isinstance(item, h5py.Dataset) else None)


def write(recording: Recording, path: Path) -> None:
    """Write ``signal`` (time by channel), ``sample_rate``, ``unit`` and ``channels`` as a version 5 file."""
    from scipy.io import savemat

    content = {
        "signal": recording.signal.T,
        "sample_rate": recording.sample_rate,
        "unit": recording.unit,
        "channels": np.array(recording.channels, dtype=object),
    }
    with path.open("wb") as file:
        savemat(file, content, do_compression=True)


def _elements(fields: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """The structures of an array of them, each by its name or number; a single one by none."""
    counts = {len(value) if isinstance(value, list) else -1 for value in fields.values()}
    if len(counts) != 1 or min(counts) < 1:
        return [("", fields)]
    elements = [{key: value[number] for key, value in fields.items()} for number in range(counts.pop())]
    names = [
        str(next((each[key] for key in each if key.lower() in ("name", "label", "title")), "")) for each in elements
    ]
    if len(set(names)) < len(names) or not all(names):
        names = [str(number) for number in range(1, len(elements) + 1)]
    return [(f".{name.replace('.', '_')}", each) for name, each in zip(names, elements, strict=True)]


def _flattened(content: dict[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    pairs = []
    for name, value in content.items():
        if isinstance(value, dict):
            for part, fields in _elements(value):
                pairs += _flattened(fields, f"{prefix}{name}{part}.")
        elif isinstance(value, list) and any(isinstance(item, (np.ndarray, dict)) for item in value):
            pairs += _flattened({f"{name}({number})": item for number, item in enumerate(value, 1)}, prefix)
        else:
            pairs.append((prefix + name, value))
    return pairs


_RATE_NAMES = ("sample_rate", "fs", "samplerate", "sampling_rate", "samplingrate", "sampling_frequency")
"""What files call their sample rate [Hz], in any case of letters."""
_STEP_NAMES = (
    "dt", "delta_t", "deltat", "ts", "sampling_interval", "sample_interval", "sampling_period", "sample_period",
    "samplingperiod", "sampleperiod", "time_step", "timestep", "wf_increment", "tinterval", "x_values.increment",
)  # fmt: skip
"""What files call the time between two samples [s], the last two as PicoScope and Testlab do."""
_WITH_UNIT = re.compile(r"(.*(?:fs|rate|frequency|dt|interval|period|step))_(k?hz|[mu]?s)", re.IGNORECASE)
"""A number whose name ends with its unit, such as ``fs_kHz``."""
_SENSITIVITY_NAMES = ("sensitivity", "sensitivities")
_PARTS = re.compile(r"[./]")
_CELL = re.compile(r"(.*)\((\d+)\)")
_INDEX = re.compile(r"\(.*\)$")


def sorted_variables(path: Path, variables: Iterable[tuple[str, Any]], options: Options) -> RawFile:
    """Vectors as columns; single numbers and texts as attributes, of which some name rate, unit, scale and sensitivity.

    A matrix yields one column for each of its longer side's vectors, called as a list of as many names says, or
    ``H(:,1)`` as MATLAB writes it. A rate or a unit holds for the vectors of its structure (``a.fs`` for ``a.x``) and
    of those within; one with the name of a vector (``x_fs``, ``fs_x``) for that vector only. The only rate in a file
    holds for all its vectors where none has one of its own.

    Raises
    ------
    DataError
        Two different rates, units or scales are stated for the same vectors, or a scale that is not known.
    """
    sorted_ = _Variables(variables)
    columns, facts = sorted_.columns, sorted_.facts

    def stated(values: Mapping[str, Any], keys: tuple[str, ...], what: str) -> dict[str, Any]:
        found = {name: _stated_for(path, name, values, keys, what) for name in columns}
        return {name: value for name, value in found.items() if value is not None}

    in_file = {name: rate for name, text in facts.items() if (rate := _rate(name, text)) is not None}
    rates = stated(in_file, (*_RATE_NAMES, *_STEP_NAMES), "sample rates")
    in_units = {name: known_unit(text) for name, text in facts.items() if any(key in name.lower() for key in LISTS[1])}
    units = stated({name: unit for name, unit in in_units.items() if unit}, LISTS[1], "units")
    sensed = {name: texts[0] for name in facts if (texts := _sensitivity(name, facts))}
    sensitivities = stated(sensed, _SENSITIVITY_NAMES, "sensitivities")
    for name, column in columns.items():
        scales = {key: _stated_for(path, name, facts, (key,), key) for key in SCALE_NAMES}
        columns[name] = obeyed(f"{path}: {name}", column, scales, options)[:]
        if unknown_scale(scales):
            units.pop(name, None)  # it is that of the scaled numbers
    facts.pop("unit", None)
    general = {rate for name, rate in in_file.items() if _PARTS.split(name.lower())[-1] in _RATE_NAMES}
    if len(general) == 1 and not rates:
        rates = dict.fromkeys(columns, general.pop())
    facts |= {"left_out": ", ".join(sorted_.left_out)} if sorted_.left_out else {}
    return RawFile(columns, None, units | sorted_.units, facts, rates=rates, sensitivities=sensitivities)


def _texts(value: Any) -> list[str]:
    """Texts of a cell array or an array of them; none where it holds anything else."""
    if isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "UO":
        value = value.tolist()
    return value if isinstance(value, list) and value and all(isinstance(each, str) for each in value) else []


def _rate(name: str, text: str) -> float | None:
    """Sample rate [Hz] that a variable states by its name, or by that of the time between two samples."""
    last = _PARTS.split(name.lower())[-1]
    try:
        if last in _STEP_NAMES or name.lower().endswith("x_values.increment"):
            return 1 / parse(text if re.search(r"[a-z]$", text) else f"{text} s", "s")
        if any(key in name.lower() for key in _RATE_NAMES):
            return parse(text if re.search(r"[a-zA-Z]$", text) else f"{text} Hz", "Hz")
    except (UnitError, ZeroDivisionError):
        pass
    return None


def _sensitivity(name: str, facts: Mapping[str, str]) -> list[str]:
    """Sensitivity that a variable states, with the unit beside it."""
    beside = [(_PARTS.split(each)[-1], text) for each, text in facts.items() if each.startswith(name)]
    return stated_sensitivities(beside) if "sensitivit" in name.lower() else []


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


class _Variables:
    """Variables of a workspace, sorted into columns, facts, and what is neither."""

    def __init__(self, variables: Iterable[tuple[str, Any]]) -> None:
        self.columns: dict[str, Column] = {}
        self.units: dict[str, str] = {}
        self.facts: dict[str, str] = {}
        self.left_out: list[str] = []
        variables = list(variables)
        self._cells = Counter(cell[1] for name, _ in variables if (cell := _CELL.fullmatch(name)))
        self._lists = {name.lower(): texts for name, value in variables if (texts := _texts(value))}
        for name, value in variables:
            if isinstance(value, str):
                self.facts[name] = value
            elif name.lower() not in self._lists:
                self._sort(name, value)

    def _sort(self, name: str, value: Any) -> None:
        try:
            array = np.squeeze(np.asarray(value.toarray() if hasattr(value, "toarray") else value))
        except ValueError:
            return  # a ragged cell array
        kind = array.dtype.kind
        is_reference = array.dtype == np.uint32 and array.size > 5 and array.flat[0] == _REFERENCE
        if kind == "c" or is_reference:
            self.left_out.append(f"{name} ({'a MATLAB object' if is_reference else 'complex numbers'})")
        elif array.dtype.names:
            for field in array.dtype.names:
                self._sort(f"{name}.{field}", array[field])
        elif kind in "mM" and array.ndim == 1:
            self.columns[name], self.units[name] = array.astype(f"{kind}8[ns]").astype(np.int64), "ns"
        elif array.ndim == 0 and kind in "fiubU":
            text = str(array.item()) if kind == "U" else f"{array.item():.12g}"
            parts = _WITH_UNIT.fullmatch(name)
            self.facts[parts[1] if parts else name] = f"{text} {plain_unit(parts[2])}" if parts else text
        elif array.ndim == 1 and array.size > 1 and kind in "fiub":
            cell = _CELL.fullmatch(name)
            of = cell[1] if cell else name
            self._add(of, name, int(cell[2]) - 1 if cell else 0, self._cells[of], array.astype(np.float64))
        elif array.ndim == 2 and array.size and kind in "fiub":
            self._sort_matrix(name, array.astype(np.float64))

    def _sort_matrix(self, name: str, matrix: np.ndarray) -> None:
        """The vectors along the longer side of a matrix."""
        tall = matrix.shape[0] >= matrix.shape[1]
        vectors = matrix.T if tall else matrix
        for number, vector in enumerate(vectors):
            key = f"{name}(:,{number + 1})" if tall else f"{name}({number + 1},:)"
            self._add(name, key, number, len(vectors), vector)

    def _add(self, name: str, key: str, number: int, count: int, vector: np.ndarray) -> None:
        """One of `count` vectors, with the name and the unit that lists beside them of as many texts say."""
        scope = name[: len(name) - len(_PARTS.split(name)[-1])]
        names, units = (
            next((texts for each in keys if (texts := self._lists.get((scope + each).lower()))), []) for keys in LISTS
        )
        key = scope + names[number] if names and len(set(names)) == count else key
        if units and len(units) == count and (unit := known_unit(units[number])):
            self.units[key] = unit
        self.columns[key] = vector
