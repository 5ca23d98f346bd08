"""Dataclasses as tables of JSON or TOML, and messages about entries that do not fit them.

msgspec converts and checks every entry; its messages are reworded for people who write such files.
"""

import json
import math
import re
import reprlib
from collections.abc import Callable, Iterable
from dataclasses import fields, is_dataclass
from functools import cache
from types import MappingProxyType, NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import msgspec
import numpy as np

from swashtwin.foundation.errors import InputError
from swashtwin.foundation.misspellings import closest_name

T = TypeVar("T")

# Digits of a number in JSON. Python takes quadratic time to parse a long integer.
_MAX_DIGITS = 40

_TYPE_NAMES = {
    "str": "text",
    "int": "a whole number",
    "float": "a number",
    "bool": "true or false",
    "array": "a list",
    "object": "a table",
    "null": "nothing",
}
_ARRAY_KINDS = ("float", "int", "bool")
_UNKNOWN_FIELD = re.compile(r"Object contains unknown field `(.+)`")
_MISSING_FIELD = re.compile(r"Object missing required field `(.+)`")
_INVALID_CHOICE = "Invalid enum value "
_PATH_STEP = re.compile(r"\[(\d+)\]|([^.\[\]]+)")


def to_table(thing: Any, *, of_array: Callable[[Any], Any] = lambda array: array.tolist()) -> Any:
    """Return a dataclass, or a container of dataclasses, as JSON or TOML can hold it.

    Parameters
    ----------
    of_array : returns what stands for an array; by default its values as lists.

    Examples
    --------
    >>> to_table({"rate": np.float64(2), "powers": np.arange(3)})
    {'rate': 2.0, 'powers': [0, 1, 2]}
    """

    def encode(value: Any) -> Any:
        if isinstance(value, np.generic):
            return value.item()
        if isinstance(value, MappingProxyType):
            return dict(value)
        return of_array(value)

    return msgspec.to_builtins(thing, enc_hook=encode)


def from_table(
    table: Any,
    form: Callable[..., T],
    location: str = "",
    *,
    to_array: Callable[[type, Any], Any] | None = None,
    complete: bool = False,
) -> T:
    """Return the object that `to_table` made a table of.

    Parameters
    ----------
    table : of JSON or TOML.
    form : type of the result, such as a dataclass. A `msgspec.Struct` can refuse unknown entries
        (``forbid_unknown_fields``).
    location : file, and section of it, with which an error message begins.
    to_array : returns an array from its type and its entry in the table; by default from lists.
    complete : whether the table must have every entry that `to_table` writes, and no other. A table
        that swashtwin saved has them; in one that a person wrote, an entry may be left out.

    Raises
    ------
    InputError
        An entry has another type than `form` requires, is missing or unknown, or `form` itself
        refuses it.

    Examples
    --------
    >>> from_table(["a", 1], list[str], "card.json")
    Traceback (most recent call last):
    swashtwin.foundation.errors.InputError: card.json: [1]: expected text, got a whole number: 1.
    """
    misfit = _different_entry(table, form) if complete else ""
    if not misfit:
        try:
            value: T = msgspec.convert(
                table, form, dec_hook=to_array or _array_from_lists, str_keys=True
            )
            return value
        except msgspec.ValidationError as cause:
            misfit = _describe_misfit(str(cause), form, table)
            raise InputError(_locate(misfit, location)) from cause
    raise InputError(_locate(misfit, location))


def _locate(misfit: str, location: str) -> str:
    sentence = misfit if misfit.endswith("?") else f"{misfit}."
    return f"{location}: {sentence}" if location else sentence


def _different_entry(table: Any, form: Any, path: str = "") -> str:
    """Describe the first entry that a table lacks, or that `form` lacks; empty if there is none."""
    prefix = f"{path}." if path else ""
    forms = [argument for argument in get_args(form) if argument not in (NoneType, Ellipsis)]
    parts: list[tuple[Any, Any, str]] = []

    if get_origin(form) in (Union, UnionType):
        # Which of several types an entry has is not known before it is converted.
        return _different_entry(table, forms[0], path) if len(forms) == 1 else ""
    if isinstance(table, dict) and isinstance(form, type) and is_dataclass(form):
        types = _field_types(form)
        for name in sorted(types.keys() - table.keys()):
            return f"{prefix}{name} is missing"
        for name in sorted(table.keys() - types.keys()):
            return f"{prefix}{name} is unknown"
        parts = [(table[name], types[name], f"{prefix}{name}") for name in types]
    elif isinstance(table, dict) and len(forms) == 2:
        parts = [(entry, forms[1], f"{prefix}{name}") for name, entry in table.items()]
    elif isinstance(table, (list, tuple)) and len(forms) == 1:
        parts = [(entry, forms[0], f"{path}[{index}]") for index, entry in enumerate(table)]
    return next(filter(None, (_different_entry(*part) for part in parts)), "")


@cache
def _field_types(form: Any) -> dict[str, Any]:
    types = get_type_hints(form)
    return {field.name: types[field.name] for field in fields(form)}


def _array_from_lists(array_type: type, values: Any) -> Any:
    """Return lists as an array whose kind of number is that of a jaxtyping annotation."""
    dtype_names = [str(name) for name in getattr(array_type, "dtypes", ())]
    dtype = None
    for kind in _ARRAY_KINDS:
        if dtype_names and all(name.startswith(kind) for name in dtype_names):
            dtype = kind

    array = np.asarray(values, dtype=dtype)
    return array_type(array) if array_type in (dict, tuple, list) else array


def _describe_misfit(message: str, form: Any, table: Any) -> str:
    """Reword a message of msgspec, such as "Expected `int`, got `str` - at `$.rate`"."""
    text, _, path = message.partition(" - at `$")
    path = path.rstrip("`").lstrip(".")

    unknown_field = _UNKNOWN_FIELD.fullmatch(text)
    missing_field = _MISSING_FIELD.fullmatch(text)
    if unknown_field:
        text = _describe_unknown_entry(unknown_field[1], _entry_types_at(path, form))
    elif missing_field:
        text = f"the entry {missing_field[1]!r} is missing"
    elif text.startswith(_INVALID_CHOICE):
        text = _describe_invalid_choice(text.removeprefix(_INVALID_CHOICE), form, path)
    elif text.startswith("Expected"):
        text = _describe_wrong_type(text, path, table)
    else:
        text = text[:1].lower() + text[1:].rstrip(".")
    return f"{path}: {text}" if path else text


def _describe_unknown_entry(name: str, names: Iterable[str]) -> str:
    suggestion = closest_name(name, names)
    # "pressure" rather means "discharge_pressure" than "pressure_unit".
    longer_names = [candidate for candidate in names if candidate.endswith(f"_{name}")]
    if len(longer_names) == 1:
        suggestion = longer_names[0]
    hint = f"; did you mean {suggestion!r}?" if suggestion else ""
    return f"there is no entry {name!r}{hint}"


def _describe_invalid_choice(value: str, form: Any, path: str) -> str:
    annotation = get_type_hints(form).get(path) if is_dataclass(form) else None
    choices: list[str] = []
    for option in (annotation, *get_args(annotation)):
        if get_origin(option) is Literal:
            choices += map(repr, get_args(option))

    if not choices:
        return f"invalid value {value}"
    return f"{value} is invalid; choose one of {', '.join(choices)}"


def _describe_wrong_type(text: str, path: str, table: Any) -> str:
    text = re.sub("`([^`]*)`", _name_types, f"e{text[1:]}")
    if not path or "[...]" in path:
        return text

    value = table
    for index, name in _PATH_STEP.findall(path):
        value = value[int(index) if index else name]

    # A list or a table is not shown, since it may hold a password.
    if isinstance(value, str | int | float | None):
        separator = ":" if ", got " in text else ", got"
        text += f"{separator} {reprlib.repr(value)}"
    return text


def _name_types(types: re.Match[str]) -> str:
    names = types[1].removesuffix(" | null").split(" | ")
    return " or ".join(_TYPE_NAMES.get(name, name) for name in names)


def _entry_types_at(path: str, form: Any) -> dict[str, Any]:
    """Return the types of the entries of a table, such as ``machine[0]`` of a configuration."""
    types = _entry_types(form)
    for name in re.findall(r"[A-Za-z_]\w*", path):
        types = _entry_types(types.get(name))
    return types


def _entry_types(form: Any) -> dict[str, Any]:
    """Return the types of the entries of a type, or of the types that it lists."""
    if is_dataclass(form):
        return {field.name: field.type for field in fields(form)}
    if isinstance(form, type) and issubclass(form, msgspec.Struct):
        return {field.encode_name: field.type for field in msgspec.structs.fields(form)}
    types: dict[str, Any] = {}
    for argument in getattr(form, "__args__", ()):
        types |= _entry_types(argument)
    return types


def parse_json(text: str) -> Any:
    """Return what a JSON text holds; every number must be finite and of at most 40 digits.

    Raises
    ------
    ValueError
        The text is not JSON, or a number is NaN, infinite or too long.
    """
    return json.loads(
        text,
        parse_constant=_parse_finite_float,
        parse_int=_parse_short_int,
        parse_float=_parse_finite_float,
    )


def _parse_short_int(text: str) -> int:
    if len(text) > _MAX_DIGITS:
        raise ValueError(f"a number has {len(text)} digits")
    return int(text)


def _parse_finite_float(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text[:_MAX_DIGITS]} is not a finite number")
    return number
