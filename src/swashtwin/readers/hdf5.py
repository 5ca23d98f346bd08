"""HDF5: our own lossless format, and anybody else's vectors."""

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from swashtwin.condition import OperatingCondition
from swashtwin.readers.raw import Options, RawFile, known_unit
from swashtwin.recording import Recording

_FORMAT = "swashtwin recording 1"
_LAYOUT = ("v110", "v110")
"""A layout with checksums: a damaged file of an older one can send the HDF5 library into an endless loop."""
_RATE_NAMES = ("sample_rate", "fs", "sampling_rate", "sampling_frequency")
_CONDITION = ("speed", "discharge_pressure", "suction_pressure", "case_pressure", "oil_temperature")


def read(path: Path, options: Options) -> RawFile:
    """A recording that `write` wrote, whole; or every numeric vector of another HDF5 file."""
    with h5py.File(path, "r") as file:
        if _text(file.attrs.get("format")) == _FORMAT:
            recording = _recording(file)
            columns = dict(zip(recording.channels, recording.signal, strict=True))
            units = dict.fromkeys(recording.channels, recording.unit)
            return RawFile(columns, recording.sample_rate, units, recording.attributes, recording)
        return _foreign(file)


def write(recording: Recording, path: Path) -> None:
    """Write the whole recording: ``signal`` in single precision where that loses nothing, the rest as attributes."""
    single = recording.signal.astype(np.float32)
    lossless = np.array_equal(single, recording.signal, equal_nan=True)
    # Made in memory: on a full disk the HDF5 library itself would leave its file open and complain past any handler.
    with h5py.File(path, "w", libver=_LAYOUT, driver="core", backing_store=False) as file:
        file.create_dataset("signal", data=single if lossless else recording.signal, fletcher32=True)
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
        file.flush()
        image = file.id.get_file_image()
    path.write_bytes(image)


def _recording(file: h5py.File) -> Recording:
    facts = file.attrs
    condition = None
    if "condition.speed" in facts:
        condition = OperatingCondition(**{name: float(facts[f"condition.{name}"]) for name in _CONDITION})
    return Recording(
        signal=file["signal"][()].astype(np.float64),
        sample_rate=float(facts["sample_rate"]),
        recording_id=str(_text(facts["recording_id"])),
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
