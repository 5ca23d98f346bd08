"""One entry of an index: the facts of one file."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from datetime import date, time
from difflib import get_close_matches
from typing import Any

from swashtwin.foundation import DataError, UnitError
from swashtwin.recordings.formats.raw import Options

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
class Entry(Options):
    """Facts of one file in an index; quantities are text with their unit."""

    file: str
    """Path of the file, relative to the index (or to its ``root``)."""
    id: str | None = None
    """Unique name of the recording; the file's stem where None."""
    label: str | None = None
    """Class."""
    specimen: str | None = None
    """Machine, bearing or part that was measured."""
    suction_pressure: str | None = None
    """Absolute pressure at the inlet."""
    case_pressure: str | None = None
    """Absolute pressure in the housing."""
    oil_temperature: str | None = None
    """Oil temperature, such as ``"45 degC"``."""
    resample: str | None = None
    """Rate to resample to with `scipy.signal.resample_poly`, such as ``"12 kHz"``."""
    sha256: str | None = None
    """Checksum the file must have."""
    synthetic: bool = False
    """Whether a model made the recording."""
    attributes: Mapping[str, str] = field(default_factory=dict)
    """Further facts."""

    @property
    def options(self) -> Options:
        """How the file is read."""
        return Options(**{field.name: getattr(self, field.name) for field in fields(Options)})

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any], where: str) -> "Entry":
        """Entry of one table of an index, refused with `where` in the message where a key or a value cannot be."""
        keys = {field.name for field in fields(cls)}
        values = {"pressure" if key == "discharge_pressure" else key: value for key, value in values.items()}
        for key, value in values.items():
            if key not in keys:
                near = get_close_matches(key, keys, n=1)
                hint = f"did you mean {near[0]!r}?" if near else f"the keys are {', '.join(sorted(keys))}."
                raise DataError(f"{where}: unknown key {_short(key)}; {hint}")
            if key in QUANTITIES:
                if value is not None and not isinstance(value, str):
                    raise UnitError(
                        f"{where}: {key} is the bare number {_short(value)}; write it with its unit: "
                        f'"{_short(value)} {QUANTITIES[key]}".'
                    )
                continue
            is_valid, words = _RULES[key]
            if value is not None and not is_valid(value):
                raise DataError(f"{where}: {key} = {_short(value)} must be {words}.")
        if not values.get("file"):
            raise DataError(f'{where}: an entry needs file = "...".')
        cleaned = {key: tuple(value) if isinstance(value, list) else value for key, value in values.items()}
        cleaned["attributes"] = {name: str(value) for name, value in (values.get("attributes") or {}).items()}
        return cls(**dict[str, Any](cleaned))


def _short(value: object) -> str:
    """A value as messages show it."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:60]}..."


def _is_text(value: object) -> bool:
    return isinstance(value, str) and bool(value)


def _is_count(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 1 << 31


def _all(value: object, *tests: Callable[[object], bool]) -> bool:
    """Whether `value` is a list with something in it, and one of the tests passes for each item."""
    return isinstance(value, (list, tuple)) and bool(value) and all(any(test(item) for test in tests) for item in value)


_TEXT = (_is_text, 'text, such as "normal"')
_RULES: dict[str, tuple[Callable[[Any], bool], str]] = {
    **dict.fromkeys(("file", "id", "label", "specimen", "unit", "sha256", "time_unit"), _TEXT),
    "channels": (lambda value: _all(value, _is_text, _is_count), "a list of texts or whole numbers from 0, not empty"),
    "names": (lambda value: _all(value, _is_text), "a list of texts, not empty"),
    "sensitivity": (lambda value: _is_text(value) or _all(value, _is_text), 'text such as "99.7 mV/g", or a list'),
    "separator": (lambda value: isinstance(value, str) and len(value) == 1, "one character"),
    "decimal": (lambda value: value in (".", ","), '"." or ","'),
    "header_lines": (_is_count, "a whole number from 0"),
    "time_column": (lambda value: _is_text(value) or _is_count(value), "a name or a whole number from 0"),
    "synthetic": (lambda value: isinstance(value, bool), "true or false"),
    "attributes": (
        lambda value: (
            isinstance(value, Mapping)
            and all(isinstance(item, (str, int, float, date, time)) for item in value.values())
        ),
        "a table of texts",
    ),
}
"""For each key that is no quantity what its value may be, and that in words."""
