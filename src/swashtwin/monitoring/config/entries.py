"""Entries of a TOML table, read into the fields of a dataclass with errors that name the entry."""

import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields
from difflib import get_close_matches
from ipaddress import ip_address
from pathlib import Path
from typing import Annotated, Any, get_origin, get_type_hints

from swashtwin.foundation import DataError, InputError, MissingFileError, parse
from swashtwin.monitoring.config.secret import Secret, fill_variables, names_variable, plain_password


@dataclass(frozen=True)
class Surroundings:
    """What an entry refers to."""

    folder: Path
    """Folder of the configuration; relative paths start there."""
    environment: Mapping[str, str]
    """Environment variables, for ``${NAME}`` in secrets."""


Reader = Callable[[Any, str, Surroundings], Any]
"""Value of an entry, from what TOML holds, the name of the entry for errors, and the surroundings."""


def read_table(kind: type, table: Any, name: str, surroundings: Surroundings) -> dict[str, Any]:
    """Values by field of the dataclass `kind`, whose fields are annotated with their readers, from a table of TOML.

    Raises
    ------
    DataError
        An entry is unknown (the nearest is offered), missing, or the table is none.
    InputError, UnitError
        A value cannot be. The message names the entry.
    """
    if not isinstance(table, dict):
        raise DataError(f"{name} must be a table.")
    hints = get_type_hints(kind, include_extras=True)
    readers = {key: hint.__metadata__[0] for key, hint in hints.items() if get_origin(hint) is Annotated}
    refuse_unknown(table, tuple(readers), name)
    for item in fields(kind):
        if item.name in readers and item.default is MISSING and item.name not in table:
            raise DataError(f"{name} lacks {item.name}.")
    return {key: readers[key](value, f"{name}: {key}", surroundings) for key, value in table.items()}


def refuse_unknown(table: Mapping[str, Any], names: tuple[str, ...], name: str) -> None:
    """Raise where a table has an entry of another name.

    Raises
    ------
    DataError
        The message offers the nearest name.
    """
    for key in table:
        if key not in names:
            near = get_close_matches(key, names, n=1)
            hint = f"did you mean {near[0]}?" if near else f"the entries are {', '.join(names)}."
            raise DataError(f"{name} has an unknown entry {key!r}; {hint}")


def text(value: Any, name: str, _: Surroundings) -> str:
    """A text that is not empty."""
    if not isinstance(value, str) or not value.strip():
        raise InputError(f"{name} = {value!r} must be a text in quotes.")
    return value.strip()


def address(value: Any, name: str, _: Surroundings) -> str:
    """Address of a computer as numbers."""
    try:
        return str(ip_address(value if isinstance(value, str) else ""))
    except ValueError:
        raise InputError(f'{name} = {value!r} must be an IP address, such as "127.0.0.1".') from None


def texts(value: Any, name: str, surroundings: Surroundings) -> tuple[str, ...]:
    """A list of texts, none twice."""
    if not isinstance(value, list) or not value:
        raise InputError(f'{name} = {value!r} must be a list of texts, such as ["x", "y"].')
    items = tuple(text(item, name, surroundings) for item in value)
    if len(set(items)) != len(items):
        raise InputError(f"{name} = {value!r} names something twice.")
    return items


def path(value: Any, name: str, surroundings: Surroundings) -> Path:
    """A path; a relative one starts at the folder of the configuration."""
    return surroundings.folder / Path(text(value, name, surroundings)).expanduser()


def file(value: Any, name: str, surroundings: Surroundings) -> Path:
    """Path of a file that exists."""
    result = path(value, name, surroundings)
    if not result.is_file():
        raise MissingFileError(f"{name} = {value!r}: {result} is no file.")
    return result


def pump(value: Any, name: str, surroundings: Surroundings) -> str:
    """Name of a pump of the catalog, or path of a pump file."""
    result = text(value, name, surroundings)
    return str(path(result, name, surroundings)) if result.endswith(".toml") else result


def switch(value: Any, name: str, _: Surroundings) -> bool:
    """True or false."""
    if not isinstance(value, bool):
        raise InputError(f"{name} = {value!r} must be true or false.")
    return value


def choice(*names: str) -> Reader:
    """Reader of one of some words."""

    def read(value: Any, name: str, _: Surroundings) -> str:
        if value not in names:
            raise InputError(f"{name} = {value!r} must be one of {', '.join(map(repr, names))}.")
        return str(value)

    return read


def whole(least: int, most: int) -> Reader:
    """Reader of a whole number between two bounds."""

    def read(value: Any, name: str, _: Surroundings) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
            raise InputError(f"{name} = {value!r} must be a whole number from {least} to {most}.")
        return value

    return read


def whole_or_all(least: int, most: int) -> Reader:
    """Reader of a whole number, or of ``"all"``, which is None."""
    number = whole(least, most)

    def read(value: Any, name: str, surroundings: Surroundings) -> int | None:
        if isinstance(value, str) and value != "all":
            raise InputError(f'{name} = {value!r} must be "all" or a whole number from {least} to {most}.')
        return None if value == "all" else number(value, name, surroundings)

    return read


def fraction(most: float) -> Reader:
    """Reader of a number above 0 and at most `most`."""

    def read(value: Any, name: str, _: Surroundings) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value <= most:
            raise InputError(f"{name} = {value!r} must be a number above 0 and at most {most:g}.")
        return float(value)

    return read


def quantity(unit: str, least: float = 0.0) -> Reader:
    """Reader of a quantity in `unit`, above `least`."""

    def read(value: Any, name: str, _: Surroundings) -> float:
        number = parse(value, unit, name=name)
        if not (math.isfinite(number) and number > least):
            raise InputError(f"{name} = {value!r} must be above {least:g} {unit}.")
        return number

    return read


def password(value: Any, name: str, surroundings: Surroundings) -> Secret:
    """A secret that the file names as ``${NAME}`` and the environment holds."""
    if not isinstance(value, str) or not names_variable(value):
        raise InputError(
            f"{name} is written out; write {name.rpartition(' ')[2]} = "
            '"${NAME}" and set the environment variable NAME.'
        )
    return Secret(fill_variables(value, name, surroundings.environment))


def secret_url(value: Any, name: str, surroundings: Surroundings) -> Secret:
    """A URL, shown nowhere because it may hold a secret; one with a password takes it from the environment."""
    if not isinstance(value, str) or "://" not in value:
        raise InputError(f"{name} must be a URL, such as scheme://host/name.")
    if plain_password(value):
        raise InputError(f"{name} has a password written out; write scheme://user:${{NAME}}@host and set NAME.")
    return Secret(fill_variables(value, name, surroundings.environment, in_url=True))
