"""MATLAB files, versions 4 to 7.3."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

from swashtwin.foundation import DataError, load_extra, require_memory
from swashtwin.recordings.formats.clock import extract_time
from swashtwin.recordings.formats.named_arrays import sort_variables
from swashtwin.recordings.formats.raw_file import RawFile, ReadOptions
from swashtwin.recordings.recording import Recording

# Kinds of variables that are not objects.
_PLAIN_KINDS = ("double", "single", "logical", "char", "cell", "struct", "sparse", "unknown", *(
    f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)
))  # fmt: skip

# Testlab's name of the unit; the step of the time is in its structure `x_values`.
_TESTLAB_UNIT = re.compile(r"quantity\.label$")


def read(path: Path, options: ReadOptions) -> RawFile:
    """Return the vectors of a MATLAB file as columns, its single numbers and texts as attributes.

    Objects, such as a table or a datetime, are named and excluded. A file of LabChart has one
    vector, and the indices at which each channel begins and ends in it.
    """
    import h5py

    pymatreader = load_extra("pymatreader", "readers", "a MATLAB file")
    if h5py.is_hdf5(path):
        _require_local_content(path)
    variables = pymatreader.whosmat(path)
    require_memory(path, sum(8 * prod(shape) for _, shape, _ in variables))

    # Names that begin with "#" or "_" are of the file format, not of the user.
    objects = {
        name: kind
        for name, _, kind in variables
        if kind not in _PLAIN_KINDS and not name.startswith("#")
    }
    content = {
        name: value
        for name, value in pymatreader.read_mat(path).items()
        if name not in objects and not name.startswith(("#", "_"))
    }

    arrays = _labchart_channels(content) if _is_labchart(content) else _flatten(content)
    raw = sort_variables(path, arrays, options)
    if objects and not raw.columns:
        name, kind = next(iter(objects.items()))
        raise DataError(
            f"{path}: {name} is a MATLAB {'object' if kind == 'opaque' else kind}, which cannot be "
            "read; save its columns as vectors."
        )
    if objects:
        raw = replace(raw, attributes={**raw.attributes, "objects": ", ".join(objects)})
    return extract_time(path, raw, options)


def _require_local_content(path: Path) -> None:
    """Refuse a file of version 7.3, which is HDF5, with samples elsewhere or never written."""
    import h5py

    from swashtwin.recordings.formats.hdf5_access import require_local_data, require_local_links

    def check(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            require_local_data(path, item)

    with h5py.File(path, "r", locking=False) as file:
        require_local_links(path, file)
        file.visititems(check)


def _is_labchart(content: Mapping[str, Any]) -> bool:
    return {"data", "datastart", "dataend", "titles"} <= content.keys()


def _labchart_channels(content: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """Return the channels of a file of LabChart, with their rates and units.

    Each channel was recorded in one or more blocks: rows of its tables are channels, columns are
    blocks.
    """
    data = np.ravel(content["data"])
    titles = [str(title).strip() for title in np.ravel(content["titles"])]

    def table(key: str) -> Float64[np.ndarray, "channel block"]:
        return np.asarray(content[key], dtype=np.float64).reshape(len(titles), -1)

    starts = table("datastart")
    ends = table("dataend")
    rates = table("samplerate")
    scales = np.broadcast_to(np.asarray(content.get("scaleunits", 1.0), float), starts.shape)
    offsets = np.broadcast_to(np.asarray(content.get("scaleoffset", 0.0), float), starts.shape)
    units = np.ravel(content.get("unittext", []))
    unit_numbers = np.asarray(content.get("unittextmap", np.ones_like(starts)))
    unit_numbers = unit_numbers.reshape(len(titles), -1)

    arrays: list[tuple[str, Any]] = []
    n_blocks = starts.shape[1]
    for channel, title in enumerate(titles):
        for block in range(n_blocks):
            if starts[channel, block] < 1:
                continue  # the channel was not recorded in this block

            name = title if n_blocks == 1 else f"{title} block {block + 1}"
            samples = data[int(starts[channel, block]) - 1 : int(ends[channel, block])]
            samples = (samples + offsets[channel, block]) * scales[channel, block]
            arrays.append((name, samples))

            rate = rates[channel, min(block, rates.shape[1] - 1)]
            arrays.append((f"{name}_fs", float(rate)))

            unit_number = int(unit_numbers[channel, min(block, unit_numbers.shape[1] - 1)])
            if 1 <= unit_number <= len(units):
                arrays.append((f"{name}_unit", str(units[unit_number - 1]).strip()))
    return arrays


def write(recording: Recording, path: Path) -> None:
    """Write ``signal`` (time by channel), ``sample_rate``, ``unit``, ``channels`` as version 5."""
    from scipy.io import savemat

    content = {
        "signal": recording.signal.T,
        "sample_rate": recording.sample_rate,
        "unit": recording.unit,
        "channels": np.array(recording.channels, dtype=object),
    }
    with path.open("wb") as file:
        savemat(file, content, do_compression=True)


def _flatten(content: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    """Return all variables by their paths, such as ``a.x`` for a field of a structure."""
    variables: list[tuple[str, Any]] = []
    for name, value in content.items():
        if isinstance(value, dict):
            for element, fields in _structures(value):
                variables += _flatten(fields, f"{prefix}{name}{element}.")
        elif isinstance(value, list) and any(
            isinstance(cell, (np.ndarray, dict)) for cell in value
        ):
            variables += _flatten(_cells(name, value), prefix)
        else:
            path = _TESTLAB_UNIT.sub("unit", f"{prefix}{name}").replace("x_values.", "")
            variables.append((path, value))
    return variables


def _structures(fields: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """Return the structures of an array of them by name or number; a single one has none."""
    lengths = {len(value) if isinstance(value, list) else -1 for value in fields.values()}
    if len(lengths) != 1 or min(lengths) < 1:
        return [("", fields)]

    structures = [
        {key: values[index] for key, values in fields.items()} for index in range(lengths.pop())
    ]
    names = _structure_names(structures)
    if names is None:
        names = [str(number) for number in range(1, len(structures) + 1)]
    return [(f".{name}", structure) for name, structure in zip(names, structures, strict=True)]


def _structure_names(structures: Sequence[Mapping[str, Any]]) -> list[str] | None:
    """Return the different names that structures state in a field, or None."""
    names: list[str] = []
    for structure in structures:
        name_keys = (key for key in structure if key.lower() in ("name", "label", "title"))
        name_key = next(name_keys, None)
        name = "" if name_key is None else structure[name_key]
        names.append(name.strip().replace(".", "_") if isinstance(name, str) else "")
    has_all = all(names) and len(set(names)) == len(names)
    return names if has_all else None


def _cells(name: str, cells: Sequence[Any]) -> dict[str, Any]:
    """Return the cells of a variable by their paths: by the names that all state, or by numbers."""
    are_structures = all(isinstance(cell, dict) for cell in cells)
    names = _structure_names(cells) if are_structures else None
    if names is not None:
        return {f"{name}.{cell_name}": cell for cell_name, cell in zip(names, cells, strict=True)}
    return {f"{name}({number})": cell for number, cell in enumerate(cells, 1)}
