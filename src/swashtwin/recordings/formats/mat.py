"""MATLAB files, versions 4 to 7.3."""

import re
import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError, UnitError, parse, require_memory
from swashtwin.recordings.formats.clock import timed
from swashtwin.recordings.formats.raw import RATE_NAMES, Options, RawFile, known_unit, load_extra
from swashtwin.recordings.recording import Recording

_HEADER = 128
"""Bytes before the first variable of a version 5 file."""
_COMPRESSED = 15
"""Kind of a variable that is compressed."""


def read(path: Path, options: Options) -> RawFile:
    """Vectors of a MATLAB file as columns, its single numbers and texts as attributes.

    A vector called ``time`` or ``t`` that is as long as the others [s] gives the rate, or must agree with it.
    """
    import h5py

    if h5py.is_hdf5(path):
        _require_data_within(path)
    else:
        require_memory(path, _unpacked_size(path))
    content = load_extra("pymatreader").read_mat(path)
    objects = _objects(path)
    content = {name: value for name, value in content.items() if name not in objects and name[:1] not in ("#", "_")}
    pairs = _labchart(content) or _flattened(content)
    raw = sorted_variables(path, pairs)
    if objects and not raw.columns:
        name, kind = next(iter(objects.items()))
        raise DataError(f"{path}: {name} is a MATLAB {kind}, which cannot be read; save its columns as vectors.")
    if objects:
        raw = replace(raw, attributes={**raw.attributes, "objects": ", ".join(objects)})
    return timed(path, raw, options)


def _objects(path: Path) -> dict[str, str]:
    """Kind of each variable that is an object, such as a table or a datetime, by its name."""
    import h5py
    from scipy.io import whosmat

    if not h5py.is_hdf5(path):
        return {name: "object" for name, _, kind in whosmat(path) if kind in ("opaque", "object", "function")}
    with h5py.File(path, "r", locking=False) as file:
        return {
            name: item.attrs["MATLAB_class"].decode()
            for name, item in file.items()
            if "MATLAB_object_decode" in item.attrs and "MATLAB_class" in item.attrs
        }


def _labchart(content: dict[str, Any]) -> list[tuple[str, Any]]:
    """The channels of a file of LabChart: one vector, and where each channel begins and ends in it; else nothing."""
    if not {"data", "datastart", "dataend", "titles"} <= content.keys():
        return []
    data, titles = np.ravel(content["data"]), [str(title).strip() for title in np.ravel(content["titles"])]
    starts, ends, rates = (
        np.asarray(content[key], dtype=np.float64).reshape(len(titles), -1)
        for key in ("datastart", "dataend", "samplerate")
    )
    units = np.ravel(content.get("unittext", []))
    chosen = np.asarray(content.get("unittextmap", np.ones_like(starts))).reshape(len(titles), -1)
    pairs: list[tuple[str, Any]] = []
    for row, title in enumerate(titles):
        for block in range(starts.shape[1]):
            if starts[row, block] < 1:
                continue  # this channel was not recorded then
            name = title if starts.shape[1] == 1 else f"{title} block {block + 1}"
            pairs.append((name, data[int(starts[row, block]) - 1 : int(ends[row, block])]))
            pairs.append((f"{name}_fs", float(rates[row, min(block, rates.shape[1] - 1)])))
            number = int(chosen[row, min(block, chosen.shape[1] - 1)])
            if 1 <= number <= len(units):
                pairs.append((f"{name}_unit", str(units[number - 1]).strip()))
    return pairs


def _require_data_within(path: Path) -> None:
    """Refuse a version 7.3 file whose data sets are not all in it, or take too much memory."""
    import h5py

    from swashtwin.recordings.formats.hdf5 import require_data_within, require_links_within

    size = 0

    def visit(name: str, item: Any) -> None:
        nonlocal size
        if isinstance(item, h5py.Dataset):
            require_data_within(path, item)
            size += item.nbytes if item.size else 0

    with h5py.File(path, "r", locking=False) as file:
        require_links_within(path, file)
        file.visititems(visit)
    require_memory(path, size)


def _unpacked_size(path: Path) -> int:
    """Bytes that the variables of a version 5 file take, as they state themselves; 0 for an earlier version."""
    size = 0
    with path.open("rb") as file:
        head = file.read(_HEADER)
        order = {b"IM": "<", b"MI": ">"}.get(head[-2:])
        if len(head) < _HEADER or order is None:
            return 0
        while len(tag := file.read(8)) == 8:
            kind, length = struct.unpack(f"{order}II", tag)
            end = file.tell() + length
            if kind == _COMPRESSED:
                tag = zlib.decompressobj().decompress(file.read(min(length, 1024)), 8)
                size += struct.unpack(f"{order}II", tag)[1] if len(tag) == 8 else 0
            else:
                size += length
            file.seek(end)
    return size


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
