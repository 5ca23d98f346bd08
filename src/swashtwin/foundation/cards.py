"""Dataclasses as tables of a file, and back: the dataclass is the form of what is saved, and nothing else is written.

msgspec converts and checks every entry. Arrays become lists, or, in an artifact, tensors beside the card.
"""

import difflib
import json
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from types import MappingProxyType
from typing import Any, TypeVar

import msgspec
import numpy as np

from swashtwin.foundation.errors import InputError

T = TypeVar("T")

_MOST_DIGITS = 40
_UNKNOWN = re.compile(r"Object contains unknown field `(.+)`")


def to_table(thing: Any, *, of_array: Callable[[Any], Any] = lambda array: array.tolist()) -> Any:
    """A dataclass, or what is made of such, as JSON or TOML can hold it.

    Parameters
    ----------
    of_array : what stands for an array; its values as lists.

    Examples
    --------
    >>> to_table({"rate": np.float64(2), "levels": np.arange(3)})
    {'rate': 2.0, 'levels': [0, 1, 2]}
    """

    def encode(value: Any) -> Any:
        if isinstance(value, np.generic):
            return value.item()
        if isinstance(value, MappingProxyType):
            return dict(value)
        return of_array(value)

    return msgspec.to_builtins(thing, enc_hook=encode)


def from_table(
    table: Any, form: Callable[..., T], where: str = "", *, to_array: Callable[[type, Any], Any] | None = None
) -> T:
    """What `to_table` made a table of.

    Parameters
    ----------
    table : of JSON or TOML.
    form : type of the result, such as a dataclass. A `msgspec.Struct` can refuse unknown entries
        (``forbid_unknown_fields``).
    where : file, and section of it, that the message begins with.
    to_array : array of a type and of what stands for it in the table; takes lists if not given.

    Raises
    ------
    InputError
        An entry has another type than the form says, is missing or unknown, or the form itself refuses it.

    Examples
    --------
    >>> from_table(["a", 1], list[str], "card.json")
    Traceback (most recent call last):
    swashtwin.foundation.errors.InputError: card.json: [1]: expected `str`, got `int`.
    """
    try:
        return msgspec.convert(table, form, dec_hook=to_array or _array_of_list, str_keys=True)
    except msgspec.ValidationError as cause:
        raise InputError(
            f"{where}: {_misfit(str(cause), form)}." if where else f"{_misfit(str(cause), form)}."
        ) from cause


def _array_of_list(kind: type, values: Any) -> Any:
    names = [str(name) for name in getattr(kind, "dtypes", ())]
    is_of = {word: bool(names) and all(name.startswith(word) for name in names) for word in ("float", "int", "bool")}
    array = np.asarray(values, dtype=next((word for word, holds in is_of.items() if holds), None))
    return kind(array) if kind in (dict, tuple, list) else array


def _misfit(message: str, form: Any) -> str:
    text, _, path = message.partition(" - at `$")
    path = path.rstrip("`").lstrip(".")
    if match := _UNKNOWN.fullmatch(text):
        near = difflib.get_close_matches(match[1], _names(form), 1)
        text = f"there is no entry {match[1]!r}{f'; did you mean {near[0]!r}?' if near else ''}"
    else:
        text = text[:1].lower() + text[1:].rstrip(".")
    return f"{path}: {text}" if path else text


def _names(form: Any) -> set[str]:
    """Names of all entries of a form and of the forms in it."""
    if is_dataclass(form):
        kinds = {field.name: field.type for field in fields(form)}
    elif isinstance(form, type) and issubclass(form, msgspec.Struct):
        kinds = {field.encode_name: field.type for field in msgspec.structs.fields(form)}
    else:
        return {name for part in getattr(form, "__args__", ()) for name in _names(part)}
    return {*kinds}.union(*map(_names, kinds.values()))


def parse_json(text: str) -> Any:
    """What a JSON text holds; a `ValueError` where a number is NaN, infinite, or longer than a number can be."""
    return json.loads(text, parse_constant=_refuse_constant, parse_int=_parse_int, parse_float=_parse_float)


def _refuse_constant(text: str) -> float:
    raise ValueError(f"{text} is no finite number")


def _parse_int(text: str) -> int:
    if len(text) > _MOST_DIGITS:
        raise ValueError(f"a number has {len(text)} digits")
    return int(text)


def _parse_float(text: str) -> float:
    if not math.isfinite(number := float(text)):
        raise ValueError(f"{text[:_MOST_DIGITS]} is no finite number")
    return number


def first_difference(before: Any, now: Any, name: str = "") -> str:
    """First entry in which two tables differ, with both values, in words; empty where there is none."""
    if isinstance(before, Mapping) and isinstance(now, Mapping):
        differences = (
            first_difference(before.get(key), now.get(key), f"{name}.{key}" if name else key)
            for key in sorted({*before, *now})
        )
        return next(filter(None, differences), "")
    return "" if before == now else f"{name} was {json.dumps(before)[:60]}, now {json.dumps(now)[:60]}"
