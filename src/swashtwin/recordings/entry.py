"""One entry of an index: the facts of one file."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from datetime import date, time
from difflib import get_close_matches
from typing import Any

from swashtwin.foundation import DataError, InputError, UnitError, from_table
from swashtwin.recordings.formats.raw_file import ReadOptions, Text

QUANTITIES = {
    "sample_rate": "Hz",
    "resample": "Hz",
    "speed": "rad/s",
    "pressure": "Pa",
    "suction_pressure": "Pa",
    "case_pressure": "Pa",
    "oil_temperature": "K",
}
"""Keys of an entry that are written with a unit, and the SI unit each is kept in."""


@dataclass(frozen=True, kw_only=True)
class Entry(ReadOptions):
    """Facts of one file in an index; quantities are text with their unit."""

    file: str
    """Path of the file, relative to the index (or to its ``root``)."""
    id: Text | None = None
    """Unique name of the recording; the file's stem where None."""
    label: Text | None = None
    """Class."""
    specimen: Text | None = None
    """Machine, bearing or part that was measured."""
    suction_pressure: str | None = None
    """Absolute pressure at the inlet."""
    case_pressure: str | None = None
    """Absolute pressure in the housing."""
    oil_temperature: str | None = None
    """Oil temperature, such as ``"45 degC"``."""
    resample: str | None = None
    """Rate to resample to with `scipy.signal.resample_poly`, such as ``"12 kHz"``."""
    sha256: Text | None = None
    """Checksum the file must have."""
    synthetic: bool = False
    """Whether a model made the recording."""
    attributes: Mapping[str, str] = field(default_factory=dict)
    """Further facts."""

    @property
    def options(self) -> ReadOptions:
        """How the file is read."""
        return ReadOptions(
            **{field.name: getattr(self, field.name) for field in fields(ReadOptions)}
        )

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any], where: str) -> "Entry":
        """Entry of one table of an index, refused with `where` in the message where a key or a
        value cannot be.
        """
        keys = {field.name for field in fields(cls)}
        stated = {
            "pressure" if key == "discharge_pressure" else key: value
            for key, value in values.items()
        }
        stated = {key: value for key, value in stated.items() if value is not None}
        for key, value in stated.items():
            if key not in keys:
                near = get_close_matches(key, keys, n=1)
                hint = (
                    f"did you mean {near[0]!r}?"
                    if near
                    else f"the keys are {', '.join(sorted(keys))}."
                )
                raise DataError(f"{where}: unknown key {key[:60]!r}; {hint}")
            if key in QUANTITIES and not isinstance(value, str):
                raise UnitError(
                    f"{where}: {key} is the bare number {value!r}; write it with its unit: "
                    f'"{value!r} {QUANTITIES[key]}".'
                )
        if not stated.get("file"):
            raise DataError(f'{where}: an entry needs file = "...".')
        if isinstance(attributes := stated.get("attributes"), Mapping):
            simple = (str, int, float, date, time)
            stated["attributes"] = {
                name: str(value) if isinstance(value, simple) else value
                for name, value in attributes.items()
            }
        try:
            return from_table(stated, cls, where)
        except InputError as cause:
            raise DataError(str(cause)) from cause
