"""One entry of an index: the facts of one file."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from difflib import get_close_matches
from typing import Any

from swashtwin.foundation import DataError, UnitError

QUANTITIES = {
    "sample_rate": "Hz",
    "resample": "Hz",
    "speed": "rad/s",
    "discharge_pressure": "Pa",
    "suction_pressure": "Pa",
    "case_pressure": "Pa",
    "oil_temperature": "K",
}
"""Keys of an entry that are written with a unit, and the SI unit each is kept in."""


@dataclass(frozen=True)
class Entry:
    """Facts of one file in an index; quantities are text with their unit."""

    file: str
    """Path of the file, relative to the index (or to its ``root``)."""
    id: str | None = None
    """Unique name of the recording; the file's stem where None."""
    label: str | None = None
    """Class."""
    specimen: str | None = None
    """Machine, bearing or part that was measured."""
    speed: str | None = None
    """Speed of the shaft, such as ``"860 rpm"``; without `discharge_pressure` it is kept as an attribute."""
    discharge_pressure: str | None = None
    """Absolute pressure at the outlet, such as ``"15 MPa"``."""
    suction_pressure: str | None = None
    """Absolute pressure at the inlet."""
    case_pressure: str | None = None
    """Absolute pressure in the housing."""
    oil_temperature: str | None = None
    """Oil temperature, such as ``"45 degC"``."""
    channels: tuple[str | int, ...] | None = None
    """Columns or variables to read: names, patterns such as ``"*_DE_time"``, or numbers from 0; all where None."""
    names: tuple[str, ...] | None = None
    """What to call the channels; as in the file where None."""
    unit: str | None = None
    """Unit of the samples; ``"1"`` where the scale is unknown."""
    sample_rate: str | None = None
    """Samples per second, such as ``"25.6 kHz"``, where the file does not say it."""
    calibration_factor: str | tuple[str, ...] | None = None
    """Quantity that one unit of integers without a scale stands for, such as ``"0.1 g"`` (full scale of an integer
    WAV), or one each channel. Other samples have their `unit`."""
    resample: str | None = None
    """Rate to resample to with `scipy.signal.resample_poly`, such as ``"12 kHz"``."""
    separator: str | None = None
    """Character between the columns of a text file."""
    decimal: str | None = None
    """Decimal mark of a text file."""
    header_lines: int | None = None
    """Lines before the first sample of a text file."""
    time_column: str | int | None = None
    """Column of a text file with the time [s]."""
    sha256: str | None = None
    """Checksum the file must have."""
    synthetic: bool = False
    """Whether a model made the recording."""
    attributes: Mapping[str, str] = field(default_factory=dict)
    """Further facts."""

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any], where: str) -> "Entry":
        """Entry of one table of an index, refused with `where` in the message where a key or a value cannot be."""
        keys = {field.name for field in fields(cls)}
        for key in values:
            if key not in keys:
                near = get_close_matches(key, keys, n=1)
                hint = f"did you mean {near[0]!r}?" if near else f"the keys are {', '.join(sorted(keys))}."
                raise DataError(f"{where}: unknown key {key!r}; {hint}")
        cleaned = {key: tuple(value) if isinstance(value, list) else value for key, value in values.items()}
        texts = ("file", "id", "label", "specimen", "unit", "separator", "decimal", "sha256")
        expected: dict[str, Any] = dict.fromkeys(texts, str)
        expected |= {"channels": tuple, "names": tuple, "header_lines": int, "synthetic": bool, "attributes": Mapping}
        for key, kind in expected.items():
            if cleaned.get(key) is not None and not isinstance(cleaned[key], kind):
                raise DataError(f"{where}: {key} = {cleaned[key]!r} must be {_KINDS[kind]}.")
        for key, unit in QUANTITIES.items():
            value = cleaned.get(key)
            if value is not None and not isinstance(value, str):
                raise UnitError(
                    f'{where}: {key} is the bare number {value!r}; write it with its unit: "{value} {unit}".'
                )
        if not all(isinstance(item, str) for item in cleaned.get("names") or ()):
            raise DataError(f"{where}: names = {values['names']!r} must be a list of texts.")
        if not all(isinstance(item, (str, int)) for item in cleaned.get("channels") or ()):
            raise DataError(f"{where}: channels = {values['channels']!r} must be a list of texts or whole numbers.")
        if not cleaned.get("file"):
            raise DataError(f'{where}: an entry needs file = "...".')
        return cls(**dict[str, Any](cleaned))


_KINDS: dict[Any, str] = {
    str: 'text, such as "normal"',
    tuple: 'a list, such as ["a", "b"]',
    int: "a whole number",
    bool: "true or false",
    Mapping: "a table of texts",
}
