"""Our own form of HDF5 written: one recording, a stream of blocks, or a store of many."""

import json
from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO

import h5py
import numpy as np

from swashtwin.foundation import DataError
from swashtwin.recordings.formats.hdf5 import CONDITION, FORMAT, STORE_FORMAT
from swashtwin.recordings.formats.raw import BLOCK
from swashtwin.recordings.recording import Recording, require_same_facts

_LAYOUT = ("v110", "v110")
"""A layout with checksums: a damaged file of an older one can send the HDF5 library into an endless loop."""
_CHUNK = 16384
"""Samples of one block of the file, which has one checksum."""


def write(recording: Recording, path: Path) -> None:
    """Write the whole recording: samples in single precision where that loses nothing, the facts as attributes."""

    def fill(file: h5py.File, target: _PatientFile) -> None:
        for name, values in _vectors(recording).items():
            single = values.astype(np.float32)
            lossless = np.array_equal(single, values, equal_nan=True)
            file.create_dataset(name, data=single if lossless else values, fletcher32=True)
        _write_facts(file, recording)

    _fill(path, fill)


def write_stream(blocks: Iterator[Recording], path: Path) -> None:
    """Write blocks as one recording, in double precision; only one block is in memory at a time."""
    first = next(blocks, None)
    if first is None:
        raise DataError("no block to make a recording of.")

    def fill(file: h5py.File, target: _PatientFile) -> None:
        for name, values in _vectors(first).items():
            shape = (*values.shape[:-1], _CHUNK)
            empty, limit = (*values.shape[:-1], 0), (*values.shape[:-1], None)
            file.create_dataset(name, empty, np.float64, chunks=shape, maxshape=limit, fletcher32=True)
        for block in chain([first], blocks):
            require_same_facts(first, block)
            for name, values in _vectors(block).items():
                end = file[name].shape[-1]
                file[name].resize(end + values.shape[-1], axis=values.ndim - 1)
                file[name][..., end:] = values
            target.raise_error()
        _write_facts(file, first)

    _fill(path, fill)


def write_many(recordings: list[Recording], path: Path, written: Callable[[int], None]) -> None:
    """Write a store: samples in the number type of their file, with the factors beside them, block by block.

    Parameters
    ----------
    written : called with the bytes of each block.
    """

    def fill(file: h5py.File, target: _PatientFile) -> None:
        file.attrs["format"] = np.bytes_(STORE_FORMAT.encode())
        for number, recording in enumerate(recordings):
            group, count = file.create_group(f"{number:06d}"), recording.n_samples
            shape, chunk = (recording.n_channels, count), (recording.n_channels, min(_CHUNK, count))
            signal = group.create_dataset("signal", shape, recording.samples.dtype, chunks=chunk, fletcher32=True)
            speed = None
            if recording.has_speed:
                speed = group.create_dataset("speed", (count,), np.float64, chunks=(chunk[1],), fletcher32=True)
            for start in range(0, count, BLOCK):
                block = recording.samples.raw(start, start + BLOCK)
                signal[:, start : start + BLOCK] = block
                if speed is not None:
                    speed[start : start + BLOCK] = recording.samples.speed_part(start, start + BLOCK)
                target.raise_error()
                written(block.nbytes)
            _write_facts(group, recording)
            group.attrs["factor"] = np.array(recording.samples.factors)
            if hashes := recording.samples.original_hashes():
                group.attrs["hashes"] = np.bytes_(json.dumps(hashes).encode())

    _fill(path, fill)


class _PatientFile:
    """File that keeps its first error and then lets all else be written nowhere.

    On a full disk the HDF5 library would leave its file open and complain past any handler; so it never learns.
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
        """Raise the first error, where there was one."""
        if self.error is not None:
            raise self.error


def _fill(path: Path, fill: Callable[[h5py.File, _PatientFile], None]) -> None:
    with path.open("wb+", buffering=0) as stream:
        target = _PatientFile(stream)
        with h5py.File(target, "w", libver=_LAYOUT) as file:
            fill(file, target)
        target.raise_error()


def _vectors(recording: Recording) -> dict[str, np.ndarray]:
    return {"signal": recording.signal} | ({} if recording.speed is None else {"speed": recording.speed})


def _write_facts(file: h5py.Group, recording: Recording) -> None:
    """Write the facts of a recording as attributes of a file or a group of it."""
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
        facts |= {f"condition.{name}": float(getattr(recording.condition, name)) for name in CONDITION}
    for name, value in facts.items():  # texts of fixed length: the library checks no others
        file.attrs[name] = np.bytes_(value.encode()) if isinstance(value, str) else value
