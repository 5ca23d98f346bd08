"""HDF5 files of one recording or of many (a store); `hdf5_vectors` reads those of other programs.

A file of one recording holds ``signal`` (channel by time) and, if it was measured, ``speed``
[rad/s]; its attributes are ``sample_rate`` [Hz], ``unit``, ``channels``, ``factor``,
``recording_id``, ``label``, ``specimen``, ``synthetic``, ``condition.*`` (SI) and ``attributes``,
which holds all else as JSON. A store holds the same in each of the groups ``000000``, ``000001``,
...
"""

import json
from collections.abc import Callable, Iterator
from itertools import chain
from math import prod
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from swashtwin.foundation import ArtifactError, DataError, memory_limit
from swashtwin.recordings.columns import BLOCK_SAMPLES, matrix_columns
from swashtwin.recordings.formats.hdf5_access import (
    ErrorKeepingFile,
    create_file,
    open_file,
    require_local_data,
)
from swashtwin.recordings.formats.hdf5_vectors import decode_text, read_vectors
from swashtwin.recordings.formats.raw_file import STORE_KIND, RawFile, ReadOptions
from swashtwin.recordings.recording import Recording, require_same_facts

KIND = "swashtwin recording "
"""Format name, before its version, of a file of one recording."""
FORMAT = f"{KIND}3"
STORE_FORMAT = f"{STORE_KIND}2"
CONDITION = ("speed", "discharge_pressure", "suction_pressure", "case_pressure", "oil_temperature")

# Names of the data sets and attributes of a recording.
_REQUIRED_FACTS = {
    *("signal", "format", "sample_rate", "unit", "channels", "recording_id"),
    *("synthetic", "attributes"),
}
_CONDITION_FACTS = {f"condition.{name}" for name in CONDITION}
_OPTIONAL_FACTS = {"speed", "label", "specimen", "hashes"}
_FACTOR = "factor"

# Unpacked chunks of a file that are kept: those of a slice of all channels.
_CACHE_BYTES = 1 << 24

# Samples of one chunk of the file, which has one checksum.
_CHUNK_SAMPLES = 16384


def read(path: Path, options: ReadOptions) -> RawFile:
    """Return a recording of our own format, or the numeric vectors of another HDF5 file."""
    file = open_file(path, _CACHE_BYTES)

    largest_chunk = _largest_chunk(file)
    if largest_chunk > _CACHE_BYTES:
        # A chunk that does not fit in the cache would be unpacked again for each slice.
        file.close()
        file = open_file(path, 2 * min(largest_chunk, memory_limit() // 4))

    format_name = decode_text(file.attrs.get("format")) or ""
    if format_name.startswith(STORE_KIND):
        raise DataError(
            f"{path} is a store of {len(file)} recordings; name a file of one recording."
        )
    has_our_facts = _REQUIRED_FACTS - {"format"} <= {*file, *file.attrs}
    if not (format_name.startswith(KIND) or has_our_facts):
        return read_vectors(path, file, options)

    _require_format(path, file, FORMAT)
    _require_known_facts(path, file, _REQUIRED_FACTS)
    return _read_recording(path, file)


def read_store(path: Path, options: ReadOptions) -> dict[str, RawFile]:
    """Return the recordings of a store by the names of their groups."""
    file = open_file(path, 0)  # slices are whole chunks: none is read twice
    _require_format(path, file, STORE_FORMAT)
    for group in file.values():
        _require_known_facts(path, group, _REQUIRED_FACTS | {_FACTOR})
    return {name: _read_recording(path, file[name]) for name in sorted(file)}


def _largest_chunk(file: h5py.File) -> int:
    """Return the size of the largest chunk of all data sets [byte]."""
    sizes = [0]

    def add_size(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.chunks:
            sizes.append(prod(item.chunks) * item.dtype.itemsize)

    file.visititems(add_size)
    return max(sizes)


def _require_format(path: Path, file: h5py.File, current: str) -> None:
    """Refuse a file of another version of swashtwin, whose format name is not `current`."""
    name = decode_text(file.attrs.get("format")) or ""
    if name == current:
        return

    kind, _, current_version = current.rpartition(" ")
    version = name.removeprefix(f"{kind} ")
    is_newer = version.isdecimal() and int(version) > int(current_version)
    advice = "make it again from its source with this swashtwin"
    if is_newer:
        advice = "read it with a newer swashtwin"
    raise ArtifactError(
        f"{path} has the format {name[:40]!r}, this swashtwin reads {current!r}; {advice}."
    )


def _read_recording(path: Path, group: h5py.Group) -> RawFile:
    """Return the recording of a group of our own format."""
    signal = group["signal"]
    speed = group.get("speed")
    require_local_data(path, signal)
    if speed is not None:
        require_local_data(path, speed)

    stored = group.attrs
    channels = json.loads(stored["channels"])
    attributes = json.loads(stored["attributes"])
    hashes = json.loads(stored["hashes"]) if "hashes" in stored else []
    factors = [float(factor) for factor in stored.get(_FACTOR, np.ones(len(channels)))]
    _require_consistent_facts(path, signal, channels, attributes, hashes, factors)

    facts: dict[str, Any] = {
        "recording_id": str(decode_text(stored["recording_id"])),
        "channels": channels,
        "unit": str(decode_text(stored["unit"])),
        "label": decode_text(stored.get("label")),
        "specimen": decode_text(stored.get("specimen")),
        "synthetic": bool(stored["synthetic"]),
        "factors": factors,
        "hashes": hashes,
    }
    if "condition.speed" in stored:
        facts["condition"] = {name: float(stored[f"condition.{name}"]) for name in CONDITION}

    columns = matrix_columns(lambda start, stop: signal[:, start:stop], signal.shape, signal.dtype)
    names = channels
    if len(set(channels)) < len(channels):
        names = [f"{number} {name}" for number, name in enumerate(channels)]
    named_columns = dict(zip(names, columns, strict=True))
    units = dict.fromkeys(named_columns, facts["unit"])
    return RawFile(named_columns, float(stored["sample_rate"]), units, attributes, facts, speed)


def _require_known_facts(path: Path, group: h5py.Group, required: set[str]) -> None:
    """Refuse a recording that lacks a required fact, or has one that is not known."""
    present = {*group, *group.attrs}
    if present & _CONDITION_FACTS:
        required = required | _CONDITION_FACTS
    missing = sorted(required - present)
    unknown = sorted(present - required - _OPTIONAL_FACTS - {_FACTOR})
    if not (missing or unknown):
        return
    difference = f"{missing[0]} is missing" if missing else f"{unknown[0]!r} is unknown"
    raise ArtifactError(
        f"{path} does not fit this swashtwin, though it has the format {FORMAT!r} ({difference}); "
        "another version wrote it, or it was edited: make it again from its source."
    )


def _require_consistent_facts(
    path: Path,
    signal: h5py.Dataset,
    channels: Any,
    attributes: Any,
    hashes: Any,
    factors: list[float],
) -> None:
    """Refuse facts of other types or lengths than were written."""
    if not np.isfinite(factors).all():
        raise ArtifactError(
            f"{path} is damaged: a factor of its channels is not a finite number ({factors})."
        )

    is_sound = (
        isinstance(channels, list) and isinstance(attributes, dict) and isinstance(hashes, list)
    )
    if is_sound:
        texts = (*channels, *hashes, *attributes.values())
        lengths = {len(channels), len(factors), len(hashes or channels), *signal.shape[:1]}
        is_sound = all(isinstance(text, str) for text in texts)
        is_sound = is_sound and signal.ndim == 2 and len(lengths) == 1
    if not is_sound:
        raise ArtifactError(
            f"{path} is damaged: its channels, factors or attributes are not what they should be."
        )


def write(recording: Recording, path: Path) -> None:
    """Write a recording: its samples in its unit, which other readers understand, and its facts."""
    create_file(
        path, lambda file, target: _write_recording(file, recording, target, keeps_factors=False)
    )


def write_many(recordings: list[Recording], path: Path, on_written: Callable[[int], None]) -> None:
    """Write a store; `on_written` is called with the bytes of each block."""

    def fill(file: h5py.File, target: ErrorKeepingFile) -> None:
        file.attrs["format"] = np.bytes_(STORE_FORMAT.encode())
        for number, recording in enumerate(recordings):
            group = file.create_group(f"{number:06d}")
            _write_recording(group, recording, target, on_written, keeps_factors=True)

    create_file(path, fill)


def _write_recording(
    group: h5py.Group,
    recording: Recording,
    target: ErrorKeepingFile,
    on_written: Callable[[int], None] = lambda count: None,
    *,
    keeps_factors: bool,
) -> None:
    """Write samples and facts of a recording block by block.

    Parameters
    ----------
    keeps_factors : samples are written in the number type of their file, and the factors that give
        them their unit as an attribute.
    """
    samples = recording.samples
    sample_count = recording.n_samples
    chunk_length = min(_CHUNK_SAMPLES, sample_count)

    is_raw = keeps_factors or set(samples.factors) == {1.0}
    signal = group.create_dataset(
        "signal",
        (recording.n_channels, sample_count),
        samples.dtype if is_raw else np.float64,
        chunks=(recording.n_channels, chunk_length),
        fletcher32=True,
    )
    speed = None
    if recording.has_speed:
        speed = group.create_dataset(
            "speed", (sample_count,), np.float64, chunks=(chunk_length,), fletcher32=True
        )

    read_part = samples.raw if is_raw else samples.signal_part
    for start in range(0, sample_count, BLOCK_SAMPLES):
        stop = start + BLOCK_SAMPLES
        block = read_part(start, stop)
        signal[:, start:stop] = block
        if speed is not None:
            speed[start:stop] = samples.speed_part(start, stop)
        target.raise_error()
        on_written(block.nbytes)

    _write_facts(group, recording)
    if keeps_factors:
        group.attrs[_FACTOR] = np.array(samples.factors)
        hashes = samples.original_hashes()
        if hashes:
            group.attrs["hashes"] = np.bytes_(json.dumps(hashes).encode())


def write_stream(blocks: Iterator[Recording], path: Path) -> None:
    """Write blocks as one recording in double precision, with one block in memory at a time."""
    first = next(blocks, None)
    if first is None:
        raise DataError("no block to make a recording of.")

    def fill(file: h5py.File, target: ErrorKeepingFile) -> None:
        for name, values in _vectors(first).items():
            leading = values.shape[:-1]
            file.create_dataset(
                name,
                (*leading, 0),
                np.float64,
                chunks=(*leading, _CHUNK_SAMPLES),
                maxshape=(*leading, None),
                fletcher32=True,
            )

        for block in chain([first], blocks):
            require_same_facts(first, block)
            for name, values in _vectors(block).items():
                dataset = file[name]
                length = dataset.shape[-1]
                dataset.resize(length + values.shape[-1], axis=values.ndim - 1)
                dataset[..., length:] = values
            target.raise_error()

        _write_facts(file, first)

    create_file(path, fill)


def _vectors(recording: Recording) -> dict[str, np.ndarray]:
    vectors = {"signal": recording.signal}
    if recording.speed is not None:
        vectors["speed"] = recording.speed
    return vectors


def _write_facts(group: h5py.Group, recording: Recording) -> None:
    facts: dict[str, Any] = {
        "format": FORMAT,
        "sample_rate": float(recording.sample_rate),
        "unit": recording.unit,
        "channels": json.dumps(recording.channels),
        "recording_id": recording.recording_id,
        "synthetic": bool(recording.synthetic),
        "attributes": json.dumps(dict(recording.attributes)),
    }
    if recording.label is not None:
        facts["label"] = recording.label
    if recording.specimen is not None:
        facts["specimen"] = recording.specimen
    if recording.condition is not None:
        for name in CONDITION:
            facts[f"condition.{name}"] = float(getattr(recording.condition, name))

    for name, value in facts.items():
        # Texts of fixed length: the library has no checksums for those of variable length.
        group.attrs[name] = np.bytes_(value.encode()) if isinstance(value, str) else value
