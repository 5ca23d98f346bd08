"""HDF5: our own lossless format, and anybody else's vectors."""

import json
from collections.abc import Callable, Iterator
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO

import h5py
import numpy as np

from swashtwin.foundation import ArtifactError, DataError
from swashtwin.pump import OperatingCondition
from swashtwin.recordings.formats.raw import RATE_NAMES, Options, RawFile, known_unit
from swashtwin.recordings.formats.subprocess_reader import require_sound
from swashtwin.recordings.recording import Recording, require_same_facts
from swashtwin.recordings.samples import Column, Columns, Samples, SideBySide, file_stamp, require_unchanged

_KIND = "swashtwin recording "
_FORMAT = f"{_KIND}3"
"""What a file of one recording calls itself."""
LAYOUT = ("v110", "v110")
"""A layout with checksums: a damaged file of an older one can send the HDF5 library into an endless loop."""
STORE_KIND = "swashtwin store "
STORE_FORMAT = f"{STORE_KIND}2"
"""What a file of many recordings calls itself."""
_CACHE = 1 << 24
"""Bytes of a file's chunks that are kept: those of a slice of all channels."""
CHUNK = 16384
"""Samples of one block of the file, which has one checksum."""
_CONDITION = ("speed", "discharge_pressure", "suction_pressure", "case_pressure", "oil_temperature")


def read(path: Path, options: Options) -> RawFile:
    """A recording that `write` wrote, or every numeric vector of another HDF5 file."""
    require_sound(path, "hdf5", options)
    return read_here(path, options)


def read_here(path: Path, options: Options) -> RawFile:
    """As `read`, for a file that the library survives."""
    stamp = file_stamp(path)
    file = h5py.File(path, "r", rdcc_nbytes=_CACHE)
    name = _text(file.attrs.get("format")) or ""
    if name.startswith(STORE_KIND):
        raise DataError(f"{path} is a store of {len(file)} recordings; load it with load_recordings.")
    if not name.startswith(_KIND):
        return _foreign(file)
    require_format(path, file, _FORMAT)
    columns = columns_in(file)
    recording = recording_in(file, columns, partial(_reopen, path.absolute(), stamp))
    named = dict(zip(recording.channels, columns.channels, strict=True))
    units = dict.fromkeys(recording.channels, recording.unit)
    return RawFile(named, recording.sample_rate, units, recording.attributes, recording, columns.speed)


def read_header(path: Path) -> Recording:
    """Recording that `write` or `write_stream` wrote; its file is closed again."""
    stamp = file_stamp(path)
    with h5py.File(path, "r") as file:
        require_format(path, file, _FORMAT)
        return recording_in(file, columns_in(file), partial(_reopen, path.absolute(), stamp)).unloaded()


def require_format(path: Path, file: h5py.File, current: str) -> None:
    """Refuse a file that calls itself by another name than `current`, such as ``"swashtwin store 2"``.

    Raises
    ------
    ArtifactError
        An earlier or a newer version of swashtwin wrote it.
    """
    name = _text(file.attrs.get("format")) or ""
    if name == current:
        return
    kind, _, number = current.rpartition(" ")
    stated = name.removeprefix(f"{kind} ")
    newer = stated.isdecimal() and int(stated) > int(number)
    advice = "read it with a newer swashtwin" if newer else "make it again from its source with this swashtwin"
    raise ArtifactError(f"{path} has the format {name[:40]!r}, this swashtwin reads {current!r}; {advice}.")


def _reopen(path: Path, stamp: tuple[int, int, int]) -> Columns:
    require_unchanged(path, stamp)
    return columns_in(h5py.File(path, "r", rdcc_nbytes=_CACHE))


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
        "format": _FORMAT,
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


def columns_in(group: h5py.Group) -> Columns:
    """The columns of the recording in a file or a group of it."""
    signal, speed = group["signal"], group.get("speed")
    factors = tuple(float(factor) for factor in group.attrs.get("factor", np.ones(signal.shape[0])))
    channels = SideBySide(lambda start, stop: signal[:, start:stop], signal.shape).columns()
    return Columns(tuple(channels), factors, speed)


def recording_in(group: h5py.Group, columns: Columns, reopen: Callable[[], Columns]) -> Recording:
    """The recording in a file or a group of it; its samples are read when they are asked for."""
    facts = group.attrs
    condition = None
    if "condition.speed" in facts:
        condition = OperatingCondition(**{name: float(facts[f"condition.{name}"]) for name in _CONDITION})
    name = str(_text(facts["recording_id"]))
    return Recording(
        samples=Samples.from_columns(name, columns, reopen),
        sample_rate=float(facts["sample_rate"]),
        recording_id=name,
        channels=tuple(json.loads(facts["channels"])),
        unit=str(_text(facts["unit"])),
        label=_text(facts.get("label")),
        condition=condition,
        specimen=_text(facts.get("specimen")),
        synthetic=bool(facts["synthetic"]),
        attributes=json.loads(facts["attributes"]),
    )


def _text(value: Any) -> str | None:
    return value.decode() if isinstance(value, bytes) else value if isinstance(value, str) else None


def _foreign(file: h5py.File) -> RawFile:
    columns: dict[str, Column] = {}
    units: dict[str, str] = {}
    rates = _rates(file)

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or item.dtype.kind not in "fiu" or item.size < 2:
            return
        rates.extend(_rates(item))
        vectors = _vectors_in(item)
        unit = known_unit(_text(item.attrs.get("unit", file.attrs.get("unit"))))
        for number, column in enumerate(vectors):
            key = name if len(vectors) == 1 else f"{name}/{number}"
            columns[key] = column
            if unit:
                units[key] = unit

    file.visititems(visit)
    return RawFile(columns, rates[0] if rates else None, units)


def _rates(item: h5py.Group | h5py.Dataset) -> list[float]:
    """Sample rates [Hz] among the attributes, the usual names first."""
    stated = {name.lower(): value for name, value in item.attrs.items()}
    return [float(stated[name]) for name in RATE_NAMES if name in stated]


def _vectors_in(item: h5py.Dataset) -> list[Column]:
    """Vectors along the longer side of a data set of one or two sides; none of another."""
    sides = [axis for axis, length in enumerate(item.shape) if length > 1]
    if len(sides) == 1:
        along, across = sides[0], None
    elif len(sides) == 2:
        across, along = sides if item.shape[sides[0]] <= item.shape[sides[1]] else sides[::-1]
    else:
        return []

    def vectors(start: int, stop: int) -> np.ndarray:
        index: list[Any] = [0] * item.ndim
        index[along] = slice(start, stop)
        if across is not None:
            index[across] = slice(None)
        block = item[tuple(index)]
        if across is None:
            return block[None]
        return block if across < along else block.T

    count = 1 if across is None else item.shape[across]
    return list(SideBySide(vectors, (count, item.shape[along])).columns())
