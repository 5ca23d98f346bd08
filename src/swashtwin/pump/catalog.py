"""Pumps from TOML files.

A bare number is refused, and so is one without a source: whoever edits the file cannot mistake
millimeters for meters, and whoever reads a result can judge what it rests on.
"""

import difflib
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
    parse_quantity,
    read_text,
    safe_file_name,
    write_text,
)
from swashtwin.pump.geometry import require_sound_geometry
from swashtwin.pump.nameplate import Nameplate, scaled_pump
from swashtwin.pump.parameters import Bearings, Positions, Pump, Rated, Sensor, pump_text

FORMAT = 1

# Tables that every pump file has, and what each holds.
_SECTIONS: dict[str, type] = {
    name: kind
    for name, kind in get_type_hints(Pump).items()
    if isinstance(kind, type) and is_dataclass(kind)
}

MAY_BE_ZERO = ("piston_eccentricity", "air_fraction", "rotor_eccentricity")


def _require_names(table: dict[str, Any], names: tuple[str, ...], where: str) -> None:
    for name in table:
        if name not in names:
            near = difflib.get_close_matches(name, names, 1)
            hint = f" Did you mean {near[0]!r}?" if near else ""
            raise DataError(
                f"{where} has an unknown entry {name!r}; the entries are {', '.join(names)}.{hint}"
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
            values[name] = _section(part_field.type, table.get(name), field_path, sources)  # type: ignore[arg-type]
            continue

        unit = part_field.metadata["unit"]
        if name not in table:
            raise DataError(f"[{path}] lacks {name} (unit {unit}).")
        values[name] = _quantity(table[name], unit, field_path, part_field.type, sources)
        is_position = (kind, name) == (Bearings, "positions") or kind is Positions
        if not is_position:
            _require_positive(values[name], name, field_path, unit)
    return kind(**values)


def _require_positive(value: Any, name: str, path: str, unit: str) -> None:
    """Refuse a number, or one of a list, that is negative, or zero and must not be."""
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
        if any(sensor.name == other.name for other in sensors):
            raise DataError(f"sensors[{number}]: another sensor is named {sensor.name!r} already.")
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
        raise DataError(f"{path}.direction = {direction!r} has no length that can be made 1.")
    x, y, z = (component / length for component in direction)
    return Sensor(str(table["name"]), position, (x, y, z))


def available_pumps() -> tuple[str, ...]:
    """Names of the pumps that come with swashtwin."""
    folder = resources.files("swashtwin.pump") / "pumps"
    return tuple(
        sorted(
            entry.name.removesuffix(".toml")
            for entry in folder.iterdir()
            if entry.name.endswith(".toml")
        )
    )


def _text_of(name: str | Path) -> tuple[str, str]:
    path = as_path(name)
    if path.suffix == ".toml":
        if not path.is_file():
            raise MissingFileError(f"{path}: no such pump file.")
        return read_text(path), str(path)
    if str(name) not in available_pumps():
        names = ", ".join(available_pumps())
        raise MissingFileError(
            f"no pump named {str(name)!r}; there are {names}, or give a .toml file."
        )
    return (resources.files("swashtwin.pump") / "pumps" / f"{name}.toml").read_text(
        encoding="utf-8"
    ), f"{name}.toml"


def _table_of(text: str) -> dict[str, Any]:
    """Tables of a pump file; those that it lacks are of the pump that it is ``like``."""
    table = tomllib.loads(text)
    if table.get("format") != FORMAT:
        raise DataError(f"format is {table.get('format')!r}; this version reads format = {FORMAT}.")
    if "like" not in table:
        return table
    if (like := table.pop("like")) not in available_pumps():
        raise DataError(
            f"like = {like!r} is none of swashtwin's pumps: {', '.join(available_pumps())}."
        )
    original = _table_of(_text_of(like)[0])
    del original["name"]
    return {**original, **table}


def load_pump(name: str | Path) -> Pump:
    """Pump of that name, or from that ``.toml`` file.

    A file with ``like = "25scy14-1b"`` takes from that pump every table that it does not have
    itself.

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
    text, origin = _text_of(name)
    sources: dict[str, str] = {}
    try:
        table = _table_of(text)
        _require_names(table, ("format", "name", *_SECTIONS, "sensors", "rated"), "the pump")
        parts = {
            key: _section(kind, table.get(key), key, sources) for key, kind in _SECTIONS.items()
        }
        pump = Pump(
            name=str(table.get("name", Path(origin).stem)),
            sensors=_sensors(table.get("sensors"), sources),
            rated=_section(Rated, table["rated"], "rated", sources) if "rated" in table else None,
            sources=sources,
            **parts,
        )
        require_sound_geometry(pump)
        return pump
    except tomllib.TOMLDecodeError as cause:
        raise DataError(f"{origin}: not valid TOML: {cause}.") from cause
    except (DataError, UnitError, InputError) as cause:
        raise cause.with_context(f"{origin}: ") from cause


def new_pump(
    name: str,
    *,
    like: str | Path = "25scy14-1b",
    nameplate: Nameplate | None = None,
    folder: Path = Path(),
) -> Path:
    """Path of a new pump file, to be edited: a commented copy of pump `like`, or that pump scaled
    to a nameplate.

    Parameters
    ----------
    nameplate : displacement, number of pistons, rated speed and pressure; the new pump is similar
        to `like` (`scaled_pump`), and the source of each number says whether it is the nameplate's,
        scaled, or a guess.

    Raises
    ------
    InputError
        The file exists already (nothing is overwritten), the name is none for a file, or the parts
        of the scaled pump do not fit each other.
    DataError, UnitError
        Pump `like` is damaged.
    """
    if not re.fullmatch(r"\w[\w.-]*", name) or safe_file_name(name) != name:
        raise InputError(f"{name!r} cannot name a pump; use letters, digits, '-', '_' and '.'.")
    original = load_pump(like)
    text, origin = _text_of(like)
    target = Path(folder) / f"{name}.toml"
    if target.exists():
        raise InputError(f"{target} exists already; choose another name or remove it.")
    if nameplate is not None:
        comment = (
            f"Scaled from {original.name} to a nameplate, by similarity (docs/how-to/recordings.md, another pump).\n"
            "Each source begins with nameplate, scaled (with its law) or guess. Replace guesses by what you know."
        )
        return write_text(target, pump_text(scaled_pump(original, nameplate, name), comment))
    head, mark, tables = text.partition("\n[")
    head = re.sub(r"(?m)^name\s*=.*\n?", "", head)
    comment = f"# Copied from {origin}; edit the values and their sources.\n"
    return write_text(target, f'{comment}{head.rstrip()}\nname = "{name}"\n{mark}{tables}')
