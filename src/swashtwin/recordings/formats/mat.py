"""MATLAB files, versions 4 to 7.3."""

import struct
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError, require_memory
from swashtwin.recordings.formats.raw import Options, RawFile, load_extra
from swashtwin.recordings.formats.tables import timed_variables
from swashtwin.recordings.formats.variables import sorted_variables
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
    return timed_variables(path, raw, options)


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
