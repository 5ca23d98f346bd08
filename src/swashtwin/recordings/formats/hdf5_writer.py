"""Our own HDF5 format, written: every fact and every sample, with checksums."""

import json
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO

import h5py
import numpy as np

from swashtwin.foundation import DataError
from swashtwin.recordings.formats.hdf5_kinds import CONDITION, FORMAT
from swashtwin.recordings.recording import Recording, require_same_facts

LAYOUT = ("v110", "v110")
"""A layout with checksums: a damaged file of an older one can send the HDF5 library into an endless loop."""
CHUNK = 16384
"""Samples of one block of the file, which has one checksum."""


def write(recording: Recording, path: Path) -> None:
    """Write the whole recording: samples in single precision where that loses nothing, the facts as attributes."""
    # Made in memory: on a full disk the HDF5 library itself would leave its file open and complain past any handler.
    with h5py.File(path, "w", libver=LAYOUT, driver="core", backing_store=False) as file:
        for name, values in _vectors(recording).items():
            single = values.astype(np.float32)
            lossless = np.array_equal(single, values, equal_nan=True)
            file.create_dataset(name, data=single if lossless else values, fletcher32=True)
        write_facts(file, recording)
        file.flush()
        image = file.id.get_file_image()
    path.write_bytes(image)


def write_stream(blocks: Iterator[Recording], path: Path) -> None:
    """Write blocks as one recording, in double precision; only one block is in memory at a time."""
    first = next(blocks, None)
    if first is None:
        raise DataError("no block to make a recording of.")
    with path.open("wb+", buffering=0) as stream:
        target = PatientFile(stream)
        with h5py.File(target, "w", libver=LAYOUT) as file:
            for name, values in _vectors(first).items():
                empty, shape = (*values.shape[:-1], 0), (*values.shape[:-1], CHUNK)
                limit = (*values.shape[:-1], None)
                file.create_dataset(name, empty, np.float64, chunks=shape, maxshape=limit, fletcher32=True)
            for block in chain([first], blocks):
                require_same_facts(first, block)
                for name, values in _vectors(block).items():
                    _append(file[name], values)
                if target.error is not None:
                    break
            write_facts(file, first)
        if target.error is not None:
            raise target.error


class PatientFile:
    """File that keeps its first error and then lets all else be written nowhere.

    On a full disk the HDF5 library would leave its file open and complain past any handler; so it never learns.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.error: OSError | None = None

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

    def seek(self, offset: int, whence: int = 0) -> int:
        """Offset [byte] from which the next bytes are read or written."""
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        """Offset [byte] in the file."""
        return self._file.tell()

    def read(self, size: int) -> bytes:
        """The next bytes, at most `size`."""
        return self._file.read(size)

    def flush(self) -> None:
        """Nothing: no byte waits."""


def _append(dataset: h5py.Dataset, values: np.ndarray) -> None:
    end = dataset.shape[-1]
    dataset.resize(end + values.shape[-1], axis=values.ndim - 1)
    dataset[..., end:] = values


def _vectors(recording: Recording) -> dict[str, np.ndarray]:
    return {"signal": recording.signal} | ({} if recording.speed is None else {"speed": recording.speed})


def write_facts(file: h5py.Group, recording: Recording) -> None:
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
