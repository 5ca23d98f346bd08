"""MATLAB files, versions 4 to 7.3."""

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import require_memory
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
    return timed_variables(path, sorted_variables(path, _flattened(content)), options)


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


def _flattened(content: dict[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    pairs = []
    for name, value in content.items():
        if not prefix and name.startswith("__"):
            continue
        if isinstance(value, dict):
            pairs += _flattened(value, f"{prefix}{name}.")
        else:
            pairs.append((prefix + name, value))
    return pairs
