"""HDF5: our own form of one recording or of many (a store), and anybody else's vectors.

A file of one recording holds ``signal`` (channel by time) and, where it was measured, ``speed``
[rad/s]; its attributes are ``sample_rate`` [Hz], ``unit``, ``channels``, ``factor``,
``recording_id``, ``label``, ``specimen``, ``synthetic``, ``condition.*`` (SI) and ``attributes``,
which holds all else as JSON. A store holds the same in each of the groups ``000000``, ``000001``,
...
"""

import json
from collections.abc import Callable, Iterator, Sequence
from itertools import chain
from math import prod
from pathlib import Path
from typing import Any, BinaryIO

import h5py
import numpy as np

from swashtwin.foundation import ArtifactError, DataError, memory_limit, require_memory
from swashtwin.recordings.formats.clock import extract_time
from swashtwin.recordings.formats.columns import BLOCK_SAMPLES, Column, matrix_columns
from swashtwin.recordings.formats.headings import LISTS
from swashtwin.recordings.formats.npz import attach_facts
from swashtwin.recordings.formats.raw_file import (
    STORE_KIND,
    RawFile,
    ReadOptions,
    require_plausible_size,
)
from swashtwin.recordings.formats.sample_units import recognize_unit
from swashtwin.recordings.recording import Recording, require_same_facts

KIND = "swashtwin recording "
"""What every version of a file of one recording begins its name with."""
FORMAT = f"{KIND}3"
STORE_FORMAT = f"{STORE_KIND}2"
CONDITION = ("speed", "discharge_pressure", "suction_pressure", "case_pressure", "oil_temperature")
_CACHE = 1 << 24
"""Bytes of a file's chunks that are kept: those of a slice of all channels."""
_COLUMNS = 10_000
"""Most vectors that a matrix has."""


def read(path: Path, options: ReadOptions) -> RawFile:
    """A recording of our own format, or every numeric vector of another HDF5 file."""
    file = _open(path, _CACHE)
    chunks = [0]

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.chunks:
            chunks.append(prod(item.chunks) * item.dtype.itemsize)

    file.visititems(visit)
    if (chunk := max(chunks)) > _CACHE:
        file.close()
        file = _open(
            path, 2 * min(chunk, memory_limit() // 4)
        )  # a chunk that is not kept is unpacked for each slice
    name = _text(file.attrs.get("format")) or ""
    if name.startswith(STORE_KIND):
        raise DataError(
            f"{path} is a store of {len(file)} recordings; name a file of one recording."
        )
    if not name.startswith(KIND):
        return extract_time(path, _foreign(path, file, options), options)
    _require_format(path, file, FORMAT)
    return _complete(path, file)


def read_store(path: Path, options: ReadOptions) -> dict[str, RawFile]:
    """Every recording of a store, by the name of its group."""
    file = _open(path, 0)  # slices are of whole chunks, and no chunk is read twice
    _require_format(path, file, STORE_FORMAT)
    return {name: _complete(path, file[name]) for name in sorted(file)}


def _open(path: Path, cache: int) -> h5py.File:
    file = h5py.File(
        path, "r", rdcc_nbytes=cache, locking=False
    )  # writers of this process are not kept out
    require_local_links(path, file)
    return file


def require_local_links(path: Path, file: h5py.File) -> None:
    """Refuse a file whose names lead to other files."""

    def outside(name: str, link: Any) -> str | None:
        return (
            f"{name!r} is a link to another file ({link.filename})"
            if isinstance(link, h5py.ExternalLink)
            else None
        )

    if words := file.visititems_links(outside):
        raise DataError(f"{path}: {words}; put its data into this file, for example with h5copy.")


def require_local_data(path: Path, dataset: h5py.Dataset) -> None:
    """Refuse a data set whose samples are not all in this file, or do not fit in memory block by
    block: a virtual or external one, one of which parts were never written, with chunks too large,
    or packed beyond what is plausible.
    """
    if not dataset.size:
        return
    name, size = dataset.name, prod(dataset.shape) * dataset.dtype.itemsize
    if dataset.is_virtual or dataset.external:
        kind = "virtual" if dataset.is_virtual else "external"
        raise DataError(
            f"{path}: the data set {name} is {kind}: its samples are in other files; copy them into this file."
        )
    require_plausible_size(path, size, f"{name}, {dataset.shape}")
    if dataset.chunks is None:
        stored, expected, parts = dataset.id.get_storage_size(), size, "bytes"
    else:
        chunk = 2 * prod(dataset.chunks) * dataset.dtype.itemsize  # as stored, and unpacked
        require_memory(path, chunk, reason=f"has chunks of {name} that take")
        grid = zip(dataset.shape, dataset.chunks, strict=True)
        stored, expected = (
            dataset.id.get_num_chunks(),
            prod(-(-length // chunk) for length, chunk in grid),
        )
        parts = "chunks"
    if stored < expected:
        raise DataError(
            f"{path}: of the data set {name} only {stored} of {expected} {parts} were written; the rest would be read "
            "as zeros that nobody measured."
        )


def _require_format(path: Path, file: h5py.File, current: str) -> None:
    """Refuse a file of another version of swashtwin, which calls itself by another name than
    `current`.
    """
    name = _text(file.attrs.get("format")) or ""
    if name == current:
        return
    kind, _, number = current.rpartition(" ")
    stated = name.removeprefix(f"{kind} ")
    newer = stated.isdecimal() and int(stated) > int(number)
    advice = (
        "read it with a newer swashtwin"
        if newer
        else "make it again from its source with this swashtwin"
    )
    raise ArtifactError(
        f"{path} has the format {name[:40]!r}, this swashtwin reads {current!r}; {advice}."
    )


def _complete(path: Path, group: h5py.Group) -> RawFile:
    signal, speed, stated = group["signal"], group.get("speed"), group.attrs
    for dataset in (signal,) if speed is None else (signal, speed):
        require_local_data(path, dataset)
    channels, attributes = json.loads(stated["channels"]), json.loads(stated["attributes"])
    factors = [float(factor) for factor in stated.get("factor", np.ones(len(channels)))]
    hashes = json.loads(stated["hashes"]) if "hashes" in stated else []
    lengths = {len(channels), len(factors), len(hashes or channels), *signal.shape[:1]}
    if not np.isfinite(factors).all():
        raise ArtifactError(
            f"{path} is damaged: a factor of its channels is no number ({factors})."
        )
    texts = isinstance(channels, list) and isinstance(attributes, dict) and isinstance(hashes, list)
    texts = texts and all(
        isinstance(text, str) for text in (*channels, *hashes, *attributes.values())
    )
    if not (texts and signal.ndim == 2 and len(lengths) == 1):
        raise ArtifactError(
            f"{path} is damaged: its channels, factors or attributes are not what they should be."
        )
    facts: dict[str, Any] = {
        "recording_id": str(_text(stated["recording_id"])),
        "channels": channels,
        "unit": str(_text(stated["unit"])),
        "label": _text(stated.get("label")),
        "specimen": _text(stated.get("specimen")),
        "synthetic": bool(stated["synthetic"]),
        "factors": factors,
        "hashes": hashes,
    }
    if "condition.speed" in stated:
        facts["condition"] = {name: float(stated[f"condition.{name}"]) for name in CONDITION}
    columns = matrix_columns(lambda start, stop: signal[:, start:stop], signal.shape, signal.dtype)
    named = dict(zip(channels, columns, strict=True))
    if len(named) < len(channels):  # the same name twice
        named = {
            f"{number} {name}": column
            for number, (name, column) in enumerate(zip(channels, columns, strict=True))
        }
    units = dict.fromkeys(named, facts["unit"])
    return RawFile(named, float(stated["sample_rate"]), units, attributes, facts, speed)


def _text(value: Any) -> str | None:
    return value.decode() if isinstance(value, bytes) else value if isinstance(value, str) else None


def _texts(value: Any) -> list[str]:
    return [str(_text(each)) for each in value.ravel()] if isinstance(value, np.ndarray) else []


def _foreign(path: Path, file: h5py.File, options: ReadOptions) -> RawFile:
    columns: dict[str, Column] = {}
    units: dict[str, str] = {}
    sources: dict[str, tuple[str, int, int]] = {}
    facts = {name.lower(): _fact(value) for name, value in file.attrs.items()}
    left_out: list[str] = []

    def visit(name: str, item: Any) -> None:
        own = {key.lower(): value for key, value in item.attrs.items()}
        facts.update({f"{name}/{key}": _fact(value) for key, value in own.items()})
        if not isinstance(item, h5py.Dataset) or not item.size:
            return
        if item.size == 1:
            facts[name.lower()] = _fact(item[()])
            return
        fields = item.dtype.names or ("",)
        kinds = {field: (item.dtype[field] if field else item.dtype).kind for field in fields}
        left_out.extend(f"{name} (complex numbers)" for kind in kinds.values() if kind == "c")
        if not set(kinds.values()) & set("fiu"):
            return
        require_local_data(path, item)
        for field in (field for field in fields if kinds[field] in "fiu"):
            vectors = _vectors_in(item, field)
            names, listed = (
                next(
                    (
                        texts
                        for each in keys
                        if len(texts := _texts(own.get(each))) == len(vectors) > 1
                    ),
                    [],
                )
                for keys in LISTS
            )
            names = names if len(set(names)) == len(names) else []
            for number, column in enumerate(vectors):
                part = (names[number] if names else str(number)) if len(vectors) > 1 else ""
                key = "/".join(filter(None, (name, field, part)))
                columns[key], sources[key] = column, (name, number, len(vectors))
                if listed and (unit := recognize_unit(listed[number])):
                    units[key] = unit

    file.visititems(visit)
    attributes = {
        name: fact
        for name, fact in facts.items()
        if "/" not in name and isinstance(fact, str) and len(fact) < _LONGEST_FACT
    }
    attributes |= {"left_out": ", ".join(left_out)} if left_out else {}
    return attach_facts(path, RawFile(columns, None, units, attributes), facts, options, sources)


_LONGEST_FACT = 200
"""Letters of a fact of the file that is kept; a longer one is another file within it."""


def _fact(value: Any) -> Any:
    array = np.asarray(value)
    return str(_text(array.item()) or array.item()) if array.size == 1 else array


def _vectors_in(item: h5py.Dataset, field: str) -> Sequence[Column]:
    """Vectors along the longer side of a data set of one or two sides, or of one of its fields;
    none of another.
    """
    sides = [axis for axis, length in enumerate(item.shape) if length > 1]
    if len(sides) == 1:
        along, across = sides[0], None
    elif len(sides) == 2:
        across, along = sides if item.shape[sides[0]] <= item.shape[sides[1]] else sides[::-1]
    else:
        return []
    count = 1 if across is None else item.shape[across]
    if count > _COLUMNS:
        return []  # an image, or a table of something else

    def vectors(start: int, stop: int) -> np.ndarray:
        index: list[Any] = [0] * item.ndim
        index[along] = slice(start, stop)
        if across is not None:
            index[across] = slice(None)
        block = item[field, *index] if field else item[tuple(index)]
        if across is None:
            return block[None]
        return block if across < along else block.T

    return matrix_columns(
        vectors, (count, item.shape[along]), item.dtype[field] if field else item.dtype
    )


_LAYOUT = ("v110", "v110")
"""A layout with checksums: a damaged file of an older one can send the HDF5 library into an endless
loop.
"""
_CHUNK = 16384
"""Samples of one block of the file, which has one checksum."""


def write(recording: Recording, path: Path) -> None:
    """Write the whole recording: samples in its unit, and facts as attributes; what reads one file
    knows no factors.
    """
    _fill(path, lambda file, target: _write_one(file, recording, target, has_factors=False))


def write_many(recordings: list[Recording], path: Path, written: Callable[[int], None]) -> None:
    """Write a store; `written` is called with the bytes of each block."""

    def fill(file: h5py.File, target: _PatientFile) -> None:
        file.attrs["format"] = np.bytes_(STORE_FORMAT.encode())
        for number, recording in enumerate(recordings):
            _write_one(
                file.create_group(f"{number:06d}"), recording, target, written, has_factors=True
            )

    _fill(path, fill)


def _write_one(
    group: h5py.Group,
    recording: Recording,
    target: "_PatientFile",
    written: Callable[[int], None] = lambda count: None,
    *,
    has_factors: bool,
) -> None:
    samples, count = recording.samples, recording.n_samples
    is_raw = has_factors or set(samples.factors) == {1.0}
    shape, chunk = (recording.n_channels, count), (recording.n_channels, min(_CHUNK, count))
    dtype = samples.dtype if is_raw else np.float64
    signal = group.create_dataset("signal", shape, dtype, chunks=chunk, fletcher32=True)
    speed = None
    if recording.has_speed:
        speed = group.create_dataset(
            "speed", (count,), np.float64, chunks=(chunk[1],), fletcher32=True
        )
    for start in range(0, count, BLOCK_SAMPLES):
        block = (samples.raw if is_raw else samples.signal_part)(start, start + BLOCK_SAMPLES)
        signal[:, start : start + BLOCK_SAMPLES] = block
        if speed is not None:
            speed[start : start + BLOCK_SAMPLES] = samples.speed_part(start, start + BLOCK_SAMPLES)
        target.raise_error()
        written(block.nbytes)
    _write_facts(group, recording)
    if not has_factors:
        return
    group.attrs["factor"] = np.array(samples.factors)
    if hashes := samples.original_hashes():
        group.attrs["hashes"] = np.bytes_(json.dumps(hashes).encode())


def write_stream(blocks: Iterator[Recording], path: Path) -> None:
    """Write blocks as one recording, in double precision; only one block is in memory at a time."""
    first = next(blocks, None)
    if first is None:
        raise DataError("no block to make a recording of.")

    def fill(file: h5py.File, target: _PatientFile) -> None:
        for name, values in _vectors(first).items():
            shape = (*values.shape[:-1], _CHUNK)
            empty, limit = (*values.shape[:-1], 0), (*values.shape[:-1], None)
            file.create_dataset(
                name, empty, np.float64, chunks=shape, maxshape=limit, fletcher32=True
            )
        for block in chain([first], blocks):
            require_same_facts(first, block)
            for name, values in _vectors(block).items():
                end = file[name].shape[-1]
                file[name].resize(end + values.shape[-1], axis=values.ndim - 1)
                file[name][..., end:] = values
            target.raise_error()
        _write_facts(file, first)

    _fill(path, fill)


class _PatientFile:
    """File that keeps its first error and then lets all else be written nowhere.

    On a full disk the HDF5 library would leave its file open and complain past any handler; so it
    never learns.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.error: OSError | None = None
        self.seek, self.tell, self.read = file.seek, file.tell, file.read

    def write(self, data: Any) -> int:
        """Number of bytes of `data` (a memoryview, or what is like one), written or not."""
        left = memoryview(data)
        try:
            while self.error is None and left.nbytes:
                left = left[self._file.write(left) :]
        except OSError as cause:
            self.error = cause
        return len(data)

    def truncate(self, size: int) -> int:
        """`size`, to which the file was cut or stretched."""
        try:
            if self.error is None:
                self._file.truncate(size)
        except OSError as cause:
            self.error = cause
        return size

    def flush(self) -> None:
        """Nothing: no byte waits."""

    def raise_error(self) -> None:
        if self.error is not None:
            raise self.error


def _fill(path: Path, fill: Callable[[h5py.File, _PatientFile], None]) -> None:
    with path.open("wb+", buffering=0) as stream:
        target = _PatientFile(stream)
        with h5py.File(target, "w", libver=_LAYOUT) as file:
            fill(file, target)
        target.raise_error()


def _vectors(recording: Recording) -> dict[str, np.ndarray]:
    return {"signal": recording.signal} | (
        {} if recording.speed is None else {"speed": recording.speed}
    )


def _write_facts(file: h5py.Group, recording: Recording) -> None:
    facts: dict[str, Any] = {
        "format": FORMAT,
        "sample_rate": float(recording.sample_rate),
        "unit": recording.unit,
        "channels": json.dumps(recording.channels),
        "recording_id": recording.recording_id,
        "synthetic": bool(recording.synthetic),
        "attributes": json.dumps(dict(recording.attributes)),
    }
    texts = {"label": recording.label, "specimen": recording.specimen}
    facts |= {name: text for name, text in texts.items() if text is not None}
    if recording.condition is not None:
        facts |= {
            f"condition.{name}": float(getattr(recording.condition, name)) for name in CONDITION
        }
    for name, value in facts.items():  # texts of fixed length: the library checks no others
        file.attrs[name] = np.bytes_(value.encode()) if isinstance(value, str) else value
