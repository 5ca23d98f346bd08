"""MATLAB files, versions 4 to 7.3."""

from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.recordings.formats.raw import Options, RawFile, load_extra
from swashtwin.recordings.formats.variables import sorted_variables
from swashtwin.recordings.recording import Recording


def read(path: Path, options: Options) -> RawFile:
    """Vectors of a MATLAB file as columns, its single numbers and texts as attributes."""
    content = load_extra("pymatreader").read_mat(path)
    return sorted_variables(_flattened(content))


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
