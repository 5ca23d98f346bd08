"""MATLAB files, versions 4 to 7.3."""

from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.readers.raw import Options, RawFile, known_unit, load_extra
from swashtwin.recording import Recording

_RATE_NAMES = ("fs", "sample_rate", "samplerate", "sampling_rate", "samplingrate", "sampling_frequency")


def read(path: Path, options: Options) -> RawFile:
    """Vectors of a MATLAB file as columns, its single numbers and texts as attributes.

    A matrix yields one column for each of its longer side's vectors, called ``H(:,1)`` as MATLAB writes it.
    """
    content = load_extra("pymatreader").read_mat(path)
    columns: dict[str, np.ndarray] = {}
    facts: dict[str, str] = {}
    for name, value in _flattened(content):
        _sort_in(name, value, columns, facts)
    rates = [float(text) for name, text in facts.items() if name.rsplit(".")[-1].lower() in _RATE_NAMES]
    unit = known_unit(facts.pop("unit", ""))
    units = dict.fromkeys(columns, unit) if unit else {}
    return RawFile(columns, rates[0] if rates else None, units, facts)


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


def _sort_in(name: str, value: Any, columns: dict[str, np.ndarray], facts: dict[str, str]) -> None:
    """Put a variable among the columns or the facts, or nowhere where it is neither."""
    if isinstance(value, str):
        facts[name] = value
        return
    try:
        array = np.asarray(value)
    except ValueError:
        return  # a ragged cell array
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
