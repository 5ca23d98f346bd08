"""HDF5: our own lossless format, and anybody else's vectors."""

import json
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO

import h5py
import numpy as np

from swashtwin.condition import OperatingCondition
from swashtwin.errors import DataError
from swashtwin.readers.raw import Options, RawFile, known_unit
from swashtwin.recording import Recording, require_same_facts

_FORMAT, _FORMAT_WITH_SPEED = "swashtwin recording 1", "swashtwin recording 2"
"""What a file calls itself; the second holds a speed too, which a reader of the first would not look for."""
_LAYOUT = ("v110", "v110")
"""A layout with checksums: a damaged file of an older one can send the HDF5 library into an endless loop."""
_CHUNK = 16384
"""Readings of one block of the file, which has one checksum."""
_RATE_NAMES = ("sample_rate", "fs", "sampling_rate", "sampling_frequency")
_CONDITION = ("speed", "discharge_pressure", "suction_pressure", "case_pressure", "oil_temperature")


def read(path: Path, options: Options) -> RawFile:
    """A recording that `write` wrote, whole; or every numeric vector of another HDF5 file."""
    with h5py.File(path, "r") as file:
        name = _text(file.attrs.get("format")) or ""
        if name in (_FORMAT, _FORMAT_WITH_SPEED):
            recording = _recording(file)
            columns = dict(zip(recording.channels, recording.signal, strict=True))
            units = dict.fromkeys(recording.channels, recording.unit)
            return RawFile(columns, recording.sample_rate, units, recording.attributes, recording)
        if name.startswith("swashtwin recording "):
            raise DataError(f"{path} is a {name!r}, which this version does not know; read it with a newer swashtwin.")
        return _foreign(file)


def read_facts(path: Path) -> Recording:
    """A recording that `write` or `write_stream` wrote, cut to its first reading: what is known of it."""
    with h5py.File(path, "r") as file:
        return _recording(file, 1)


def write(recording: Recording, path: Path) -> None:
    """Write the whole recording: readings in single precision where that loses nothing, the facts as attributes."""
    # Made in memory: on a full disk the HDF5 library itself would leave its file open and complain past any handler.
    with h5py.File(path, "w", libver=_LAYOUT, driver="core", backing_store=False) as file:
        for name, values in _vectors(recording).items():
            single = values.astype(np.float32)
            lossless = np.array_equal(single, values, equal_nan=True)
            file.create_dataset(name, data=single if lossless else values, fletcher32=True)
        _write_facts(file, recording)
        file.flush()
        image = file.id.get_file_image()
    path.write_bytes(image)


def write_stream(blocks: Iterator[Recording], path: Path) -> Recording:
    """First of `blocks`, cut to one reading, after all were written as one recording, in double precision.

    Only one block is in memory at a time.
    """
    first = next(blocks, None)
    if first is None:
        raise DataError("no block to make a recording of.")
    with path.open("wb+", buffering=0) as opened:
        target = _PatientFile(opened)
        with h5py.File(target, "w", libver=_LAYOUT) as file:
            for name, values in _vectors(first).items():
                empty, shape = (*values.shape[:-1], 0), (*values.shape[:-1], _CHUNK)
                limit = (*values.shape[:-1], None)
                file.create_dataset(name, empty, np.float64, chunks=shape, maxshape=limit, fletcher32=True)
            for block in chain([first], blocks):
                require_same_facts(first, block)
                for name, values in _vectors(block).items():
                    _append(file[name], values)
                if target.error is not None:
                    break
            _write_facts(file, first)
        if target.error is not None:
            raise target.error
    speed = None if first.speed is None else first.speed[:1]
    return replace(first, signal=first.signal[:, :1], speed=speed)


class _PatientFile:
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

    def seek(self, place: int, whence: int = 0) -> int:
        """Place [byte] from which the next bytes are read or written."""
        return self._file.seek(place, whence)

    def tell(self) -> int:
        """Place [byte] in the file."""
        return self._file.tell()

    def read(self, size: int) -> bytes:
        """The next bytes, at most `size`."""
        return self._file.read(size)

    def flush(self) -> None:
        """Nothing: no byte waits."""


def _append(dataset: h5py.Dataset, values: np.ndarray) -> None:
    done = dataset.shape[-1]
    dataset.resize(done + values.shape[-1], axis=values.ndim - 1)
    dataset[..., done:] = values


def _vectors(recording: Recording) -> dict[str, np.ndarray]:
    return {"signal": recording.signal} | ({} if recording.speed is None else {"speed": recording.speed})


def _write_facts(file: h5py.File, recording: Recording) -> None:
    facts: dict[str, Any] = {
        "format": _FORMAT if recording.speed is None else _FORMAT_WITH_SPEED,
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
        facts |= {f"condition.{name}": float(getattr(recording.condition, name)) for name in _CONDITION}
    for name, value in facts.items():  # texts of fixed length: the library checks no others
        file.attrs[name] = np.bytes_(value.encode()) if isinstance(value, str) else value


def _recording(file: h5py.File, readings: int | None = None) -> Recording:
    facts = file.attrs
    condition = None
    if "condition.speed" in facts:
        condition = OperatingCondition(**{name: float(facts[f"condition.{name}"]) for name in _CONDITION})
    return Recording(
        signal=file["signal"][:, :readings].astype(np.float64),
        sample_rate=float(facts["sample_rate"]),
        recording_id=str(_text(facts["recording_id"])),
        channels=tuple(json.loads(facts["channels"])),
        unit=str(_text(facts["unit"])),
        label=_text(facts.get("label")),
        condition=condition,
        speed=file["speed"][:readings].astype(np.float64) if "speed" in file else None,
        specimen=_text(facts.get("specimen")),
        synthetic=bool(facts["synthetic"]),
        attributes=json.loads(facts["attributes"]),
    )


def _text(value: Any) -> str | None:
    return value.decode() if isinstance(value, bytes) else value if isinstance(value, str) else None


def _foreign(file: h5py.File) -> RawFile:
    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    rates: list[float] = [float(file.attrs[name]) for name in _RATE_NAMES if name in file.attrs]

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or item.dtype.kind not in "fiu" or item.size < 2:
            return
        rates.extend(float(item.attrs[key]) for key in _RATE_NAMES if key in item.attrs)
        array = np.squeeze(item[()]).astype(np.float64)
        rows = array[None] if array.ndim == 1 else array if array.shape[0] <= array.shape[1] else array.T
        for number, row in enumerate(rows if array.ndim <= 2 else ()):
            key = name if array.ndim == 1 else f"{name}/{number}"
            columns[key] = row
            unit = known_unit(_text(item.attrs.get("unit", file.attrs.get("unit"))))
            if unit:
                units[key] = unit

    file.visititems(visit)
    return RawFile(columns, rates[0] if rates else None, units)
