"""MATLAB files, versions 4 to 7.3."""

import re
from dataclasses import replace
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError, load_extra, require_memory
from swashtwin.recordings.formats.clock import extract_time
from swashtwin.recordings.formats.named_arrays import sort_variables
from swashtwin.recordings.formats.raw_file import RawFile, ReadOptions
from swashtwin.recordings.recording import Recording

_KINDS = ("double", "single", "logical", "char", "cell", "struct", "sparse", "unknown", *(
    f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)
))  # fmt: skip
"""Kinds of variables that are no objects."""
_TESTLAB = re.compile(r"quantity\.label$")
"""What Testlab calls the unit; the step of the time is in its structure ``x_values``."""


def read(path: Path, options: ReadOptions) -> RawFile:
    """Vectors of a MATLAB file as columns, its single numbers and texts as attributes.

    Objects, such as a table or a datetime, are named and left out. A file of LabChart has one
    vector, and where each channel begins and ends in it.
    """
    import h5py

    pymatreader = load_extra("pymatreader", "readers", "a MATLAB file")
    if h5py.is_hdf5(path):
        import h5py

        from swashtwin.recordings.formats.hdf5_access import require_local_data, require_local_links

        with h5py.File(path, "r", locking=False) as file:
            require_local_links(path, file)
            file.visititems(
                lambda _, item: (
                    require_local_data(path, item) if isinstance(item, h5py.Dataset) else None
                )
            )
    variables = pymatreader.whosmat(path)
    require_memory(path, sum(8 * prod(shape) for _, shape, _ in variables))
    objects = {name: kind for name, _, kind in variables if kind not in _KINDS and name[:1] != "#"}
    content = pymatreader.read_mat(path)
    content = {
        name: value
        for name, value in content.items()
        if name not in objects and name[:1] not in ("#", "_")
    }
    raw = sort_variables(path, _labchart(content) or _flattened(content), options)
    if objects and not raw.columns:
        name, kind = next(iter(objects.items()))
        kind = "object" if kind == "opaque" else kind
        raise DataError(
            f"{path}: {name} is a MATLAB {kind}, which cannot be read; save its columns as vectors."
        )
    if objects:
        raw = replace(raw, attributes={**raw.attributes, "objects": ", ".join(objects)})
    return extract_time(path, raw, options)


def _labchart(content: dict[str, Any]) -> list[tuple[str, Any]]:
    """The channels of a file of LabChart: one vector, and where each channel begins and ends in it;
    else nothing.
    """
    if not {"data", "datastart", "dataend", "titles"} <= content.keys():
        return []
    data, titles = (
        np.ravel(content["data"]),
        [str(title).strip() for title in np.ravel(content["titles"])],
    )
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


def write(recording: Recording, path: Path) -> None:
    """Write ``signal`` (time by channel), ``sample_rate``, ``unit`` and ``channels`` as a version 5
    file.
    """
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
    elements = [
        {key: value[number] for key, value in fields.items()} for number in range(counts.pop())
    ]
    names = [
        str(next((each[key] for key in each if key.lower() in ("name", "label", "title")), ""))
        for each in elements
    ]
    if len(set(names)) < len(names) or not all(names):
        names = [str(number) for number in range(1, len(elements) + 1)]
    return [
        (f".{name.replace('.', '_')}", each) for name, each in zip(names, elements, strict=True)
    ]


def _flattened(content: dict[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    pairs = []
    for name, value in content.items():
        if isinstance(value, dict):
            for part, fields in _elements(value):
                pairs += _flattened(fields, f"{prefix}{name}{part}.")
        elif isinstance(value, list) and any(
            isinstance(item, (np.ndarray, dict)) for item in value
        ):
            pairs += _flattened(
                {f"{name}({number})": item for number, item in enumerate(value, 1)}, prefix
            )
        else:
            pairs.append((_TESTLAB.sub("unit", f"{prefix}{name}").replace("x_values.", ""), value))
    return pairs
