"""Pumps from TOML files.

A bare number is refused, and so is one without a source: whoever edits the file cannot mistake
millimeters for meters, and whoever reads a result can judge what it rests on.
"""

import math
import re
import tomllib
from dataclasses import fields, is_dataclass
from importlib import resources
from pathlib import Path
from typing import Any, get_type_hints

from swashtwin.foundation import (
    DataError,
    InputError,
    MissingFileError,
    UnitError,
    as_path,
    closest_name,
    describe_toml_error,
    parse_quantity,
    read_text,
    safe_file_name,
    write_text,
)
from swashtwin.pump.geometry import require_sound_geometry
from swashtwin.pump.nameplate import Nameplate, scaled_pump
from swashtwin.pump.parameters import Bearings, Positions, Pump, Rated, Sensor, pump_text

FORMAT = 1
"""Version of the pump files that this version reads and writes."""

# Type of each table that every pump file has.
_SECTIONS: dict[str, type] = {
    name: kind
    for name, kind in get_type_hints(Pump).items()
    if isinstance(kind, type) and is_dataclass(kind)
}

MAY_BE_ZERO = ("piston_eccentricity", "air_fraction", "rotor_eccentricity")
"""Numbers for which zero is a possible pump; every other must be positive."""


def _require_names(table: dict[str, Any], names: tuple[str, ...], path: str) -> None:
    """Raise an error if a table has an entry that is not one of `names`."""
    for name in table:
        if name not in names:
            suggestion = closest_name(name, names)
            hint = f" Did you mean {suggestion!r}?" if suggestion else ""
            raise DataError(
                f"{path} has an unknown entry {name!r}; the entries are {', '.join(names)}.{hint}"
            )


def _section(kind: type, table: Any, path: str, sources: dict[str, str]) -> Any:
    """Return a part of a pump from its table, and add the sources of its numbers."""
    if not isinstance(table, dict):
        raise DataError(f"[{path}] is missing or not a table.")

    part_fields = {part_field.name: part_field for part_field in fields(kind)}
    _require_names(table, tuple(part_fields), f"[{path}]")
    values: dict[str, Any] = {}
    for name, part_field in part_fields.items():
        field_path = f"{path}.{name}"
        if is_dataclass(part_field.type):
            part_type: Any = part_field.type
            values[name] = _section(part_type, table.get(name), field_path, sources)
            continue

        unit = part_field.metadata["unit"]
        if name not in table:
            raise DataError(f"[{path}] lacks {name} (unit {unit}).")
        values[name] = _quantity(table[name], unit, field_path, part_field.type, sources)
        # Positions have a sign: the origin lies within the pump.
        is_position = (kind, name) == (Bearings, "positions") or kind is Positions
        if not is_position:
            _require_positive(values[name], name, field_path, unit)
    return kind(**values)


def _require_positive(value: Any, name: str, path: str, unit: str) -> None:
    """Raise an error if a number, or one of a list, is negative, or zero and must not be."""
    for number in value if isinstance(value, tuple) else (value,):
        if number < 0 or (number == 0 and name not in MAY_BE_ZERO):
            raise InputError(f"{path} ({number:g} {unit}) must be positive.")


def _quantity(entry: Any, unit: str, path: str, kind: Any, sources: dict[str, str]) -> Any:
    """Return the number, or list of numbers, of an entry, and add its source."""
    if not isinstance(entry, dict) or "value" not in entry:
        name = path.split(".")[-1]
        raise UnitError(
            f"{path} = {entry!r} is a bare value; "
            f'write {name} = {{ value = "... {unit}", source = "..." }}.'
        )
    if not str(entry.get("source", "")).strip():
        raise DataError(
            f'{path} has no source; add source = "..." so that others can judge the number.'
        )
    sources[path] = str(entry["source"])

    value = entry["value"]
    is_list = isinstance(value, list)
    if is_list and kind in (int, float):
        raise DataError(f"{path} = {value!r} must be one quantity.")
    if not is_list and kind not in (int, float):
        raise DataError(f'{path} = {value!r} must be a list of quantities, ["...", "..."].')
    if is_list:
        return tuple(
            parse_quantity(text, unit, name=f"{path}[{i}]") for i, text in enumerate(value)
        )

    number = parse_quantity(value, unit, name=path)
    if kind is int and number != int(number):
        raise InputError(f"{path} ({number:g}) must be a whole number.")
    return kind(number)


def _sensors(tables: Any, sources: dict[str, str]) -> tuple[Sensor, ...]:
    is_list = isinstance(tables, list) and all(isinstance(table, dict) for table in tables)
    if not tables or not is_list:
        raise DataError(
            "the pump has no [[sensors]]; give at least one with name, position and direction."
        )

    sensors: list[Sensor] = []
    for number, table in enumerate(tables):
        sensor = _sensor(table, f"sensors[{number}]", sources)
        if sensor.name in {previous.name for previous in sensors}:
            raise DataError(f"sensors[{number}]: another sensor is already named {sensor.name!r}.")
        sensors.append(sensor)
    return tuple(sensors)


def _sensor(table: dict[str, Any], path: str, sources: dict[str, str]) -> Sensor:
    for key in ("name", "position", "direction"):
        if key not in table:
            raise DataError(f"{path} lacks {key}.")

    position = _quantity(table["position"], "m", f"{path}.position", tuple, sources)
    direction = table["direction"]
    for vector in (position, direction):
        if not isinstance(vector, (tuple, list)) or len(vector) != 3:
            raise DataError(f"{path}: position and direction must be lists of three components.")
    if not all(isinstance(component, (int, float)) for component in direction):
        raise DataError(f"{path}.direction = {direction!r} must be bare numbers: it has no unit.")

    length = math.hypot(*direction)
    if not (math.isfinite(length) and length > 0):
        raise DataError(
            f"{path}.direction = {direction!r} must be finite, and not zero in all components."
        )
    x, y, z = (component / length for component in direction)
    return Sensor(str(table["name"]), position, (x, y, z))


def available_pumps() -> tuple[str, ...]:
    """Return the names of the pumps that come with swashtwin."""
    folder = resources.files("swashtwin.pump") / "pumps"
    names = [entry.name for entry in folder.iterdir() if entry.name.endswith(".toml")]
    return tuple(sorted(name.removesuffix(".toml") for name in names))


def _read_text(name: str | Path) -> tuple[str, str]:
    """Return the text of a pump file, or of a pump that comes with swashtwin, and its file name."""
    path = as_path(name)
    if path.suffix == ".toml":
        if not path.is_file():
            raise MissingFileError(f"{path}: no such pump file.")
        return read_text(path), str(path)

    if str(name) not in available_pumps():
        raise MissingFileError(
            f"Unknown pump {str(name)!r}: must be one of {', '.join(available_pumps())}, "
            "or a .toml file."
        )
    resource = resources.files("swashtwin.pump") / "pumps" / f"{name}.toml"
    return resource.read_text(encoding="utf-8"), f"{name}.toml"


def _read_tables(text: str) -> dict[str, Any]:
    """Return the tables of a pump file, completed by those of the pump that it is ``like``."""
    tables = tomllib.loads(text)
    if tables.get("format") != FORMAT:
        raise DataError(
            f"format is {tables.get('format')!r}; this version reads format = {FORMAT}. Read it "
            "with the swashtwin that wrote it, or copy a pump of this version."
        )
    if "like" not in tables:
        return tables

    like = tables.pop("like")
    if like not in available_pumps():
        raise DataError(f"like = {like!r} must be one of {', '.join(available_pumps())}.")
    original = _read_tables(_read_text(like)[0])
    # A file without a name gets that of the file, never that of the original.
    del original["name"]
    return {**original, **tables}


def load_pump(name: str | Path) -> Pump:
    """Return a pump that comes with swashtwin, by its name, or the pump of a ``.toml`` file.

    A file with ``like = "25scy14-1b"`` takes the tables that it lacks from that pump.

    Raises
    ------
    MissingFileError, DataError, UnitError, InputError
        No such pump; damaged TOML; a bare number or a wrong unit; impossible geometry. The message
        names the entry.

    Examples
    --------
    >>> pump = load_pump("25scy14-1b")
    >>> round(pump.rotating_group.displacement * 1e6, 2)
    24.94
    """
    text, origin = _read_text(name)
    try:
        pump = _build_pump(_read_tables(text), Path(origin).stem)
        require_sound_geometry(pump)
        return pump
    except tomllib.TOMLDecodeError as cause:
        raise DataError(f"{origin}: not valid TOML: {describe_toml_error(cause)}.") from cause
    except (DataError, UnitError, InputError) as cause:
        raise cause.with_context(f"{origin}: ") from cause


def _build_pump(tables: dict[str, Any], default_name: str) -> Pump:
    """Return the pump of the tables of a file, with the source of each number."""
    _require_names(tables, ("format", "name", *_SECTIONS, "sensors", "rated"), "the pump")
    sources: dict[str, str] = {}
    sections = {
        key: _section(kind, tables.get(key), key, sources) for key, kind in _SECTIONS.items()
    }
    sensors = _sensors(tables.get("sensors"), sources)
    rated = None
    if "rated" in tables:
        rated = _section(Rated, tables["rated"], "rated", sources)
    return Pump(
        name=str(tables.get("name", default_name)),
        sensors=sensors,
        rated=rated,
        sources=sources,
        **sections,
    )


def new_pump(
    name: str,
    *,
    like: str | Path = "25scy14-1b",
    nameplate: Nameplate | None = None,
    folder: Path = Path(),
) -> Path:
    """Write a new pump file to be edited, and return its path.

    It is a commented copy of pump `like`, or that pump scaled to a nameplate.

    Parameters
    ----------
    nameplate : displacement, number of pistons, rated speed and pressure. The new pump is similar
        to `like` (`scaled_pump`), and the source of each number states whether it is from the
        nameplate, scaled, or a guess.

    Raises
    ------
    InputError
        The file exists (nothing is overwritten), the name is not a file name, or the parts of the
        scaled pump do not fit each other.
    DataError, UnitError
        Pump `like` is damaged.
    """
    if not re.fullmatch(r"\w[\w.-]*", name) or safe_file_name(name) != name:
        raise InputError(f"Invalid pump name {name!r}: use letters, digits, '-', '_' and '.'.")
    original = load_pump(like)
    target = Path(folder) / f"{name}.toml"
    if target.exists():
        raise InputError(f"{target} already exists; choose another name or remove it.")

    if nameplate is not None:
        comment = (
            f"Scaled from {original.name} to a nameplate, by similarity "
            "(docs/how-to/recordings.md, another pump).\n"
            "Each source begins with nameplate, scaled (with its law) or guess. "
            "Replace guesses by what you know."
        )
        return write_text(target, pump_text(scaled_pump(original, nameplate, name), comment))

    # The text is copied, not written anew from the numbers, so that its comments stay.
    text, origin = _read_text(like)
    head, mark, tables = text.partition("\n[")
    head = re.sub(r"(?m)^name\s*=.*\n?", "", head)
    comment = f"# Copied from {origin}; edit the values and their sources.\n"
    return write_text(target, f'{comment}{head.rstrip()}\nname = "{name}"\n{mark}{tables}')
