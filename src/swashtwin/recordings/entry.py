"""One entry of an index: the facts of one file."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from datetime import date, time
from typing import Any

from swashtwin.foundation import DataError, InputError, UnitError, closest_name, from_table
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
"""Keys of an entry that are written with a unit, and the SI unit of each."""
CONDITION_FIELDS = {
    "speed": "speed",
    "pressure": "discharge_pressure",
    "suction_pressure": "suction_pressure",
    "case_pressure": "case_pressure",
    "oil_temperature": "oil_temperature",
}
"""Keys of an entry, and the fields of an `OperatingCondition` that they specify."""

# Characters of an unknown key that a message repeats.
_MAX_KEY_LENGTH = 60

_TOML_SCALARS = (str, int, float, date, time)


@dataclass(frozen=True, kw_only=True)
class Entry(ReadOptions):
    """Facts of one file in an index; quantities are text with their unit."""

    file: str
    """Path of the file, relative to the index (or to its ``root``)."""
    id: Text | None = None
    """Unique name of the recording; None takes the file's stem."""
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
        """Options that the file is read with."""
        return ReadOptions(
            **{field.name: getattr(self, field.name) for field in fields(ReadOptions)}
        )

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any], source_name: str) -> "Entry":
        """Return the entry of one table of an index.

        Parameters
        ----------
        source_name : file and section of the table, for messages.

        Raises
        ------
        DataError
            A key is unknown, or a value is invalid.
        UnitError
            A quantity is a bare number.
        """
        facts: dict[str, Any] = {}
        for key, value in values.items():
            if value is None:
                continue
            name = "pressure" if key == "discharge_pressure" else key
            cls._require_key(name, value, source_name)
            facts[name] = value
        if not facts.get("file"):
            raise DataError(f'{source_name}: an entry needs file = "...".')

        attributes = facts.get("attributes")
        if isinstance(attributes, Mapping):
            facts["attributes"] = {
                name: str(value) if isinstance(value, _TOML_SCALARS) else value
                for name, value in attributes.items()
            }

        try:
            return from_table(facts, cls, source_name)
        except InputError as cause:
            raise DataError(str(cause)) from cause

    @classmethod
    def _require_key(cls, key: str, value: Any, source_name: str) -> None:
        keys = {field.name for field in fields(cls)}
        if key not in keys:
            suggestion = closest_name(key, keys)
            hint = f"the keys are {', '.join(sorted(keys))}."
            if suggestion:
                hint = f"did you mean {suggestion!r}?"
            raise DataError(f"{source_name}: unknown key {key[:_MAX_KEY_LENGTH]!r}; {hint}")

        if key in QUANTITIES and not isinstance(value, str):
            raise UnitError(
                f"{source_name}: {key} is the bare number {value!r}; write it with its unit: "
                f'"{value!r} {QUANTITIES[key]}".'
            )
