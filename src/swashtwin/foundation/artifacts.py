"""Dataclasses as tables of a file, and artifacts: such a table and its arrays in one safetensors
file.

The dataclass is the form of what is saved, and nothing else is written; msgspec converts and checks
every entry. Trained classifiers, window sets and checkpoints are artifacts. Reading one runs no
code. A SHA-256 over kind, version, card and arrays tells a damaged or edited file; it is no
signature. A crash while writing leaves the file as it was.
"""

import difflib
import hashlib
import json
import math
import re
import reprlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import msgspec
import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from swashtwin.foundation.errors import ArtifactError, InputError, MissingFileError
from swashtwin.foundation.files import atomic_write

T = TypeVar("T")

_MOST_DIGITS = 40
_KINDS = {
    "str": "text", "int": "a whole number", "float": "a number", "bool": "true or false", "array": "a list",
    "object": "a table", "null": "nothing",
}  # fmt: skip
_UNKNOWN = re.compile(r"Object contains unknown field `(.+)`")
_STEP = re.compile(r"\[(\d+)\]|([^.\[\]]+)")


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
    table: Any,
    form: Callable[..., T],
    where: str = "",
    *,
    to_array: Callable[[type, Any], Any] | None = None,
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
        An entry has another type than the form says, is missing or unknown, or the form itself
        refuses it.

    Examples
    --------
    >>> from_table(["a", 1], list[str], "card.json")
    Traceback (most recent call last):
    swashtwin.foundation.errors.InputError: card.json: [1]: expected text, got a whole number: 1.
    """
    try:
        return msgspec.convert(table, form, dec_hook=to_array or _array_of_list, str_keys=True)
    except msgspec.ValidationError as cause:
        misfit = _misfit(str(cause), form, table)
        raise InputError(f"{where}: {misfit}." if where else f"{misfit}.") from cause


def _array_of_list(kind: type, values: Any) -> Any:
    names = [str(name) for name in getattr(kind, "dtypes", ())]
    is_of = {
        word: bool(names) and all(name.startswith(word) for name in names)
        for word in ("float", "int", "bool")
    }
    array = np.asarray(values, dtype=next((word for word, holds in is_of.items() if holds), None))
    return kind(array) if kind in (dict, tuple, list) else array


def _misfit(message: str, form: Any, table: Any) -> str:
    text, _, path = message.partition(" - at `$")
    path = path.rstrip("`").lstrip(".")
    if match := _UNKNOWN.fullmatch(text):
        near = difflib.get_close_matches(match[1], _names(form), 1)
        text = f"there is no entry {match[1]!r}{f'; did you mean {near[0]!r}?' if near else ''}"
    elif text.startswith("Invalid enum value"):
        kind = get_type_hints(form).get(path, None) if is_dataclass(form) else None
        allowed = [
            word
            for part in (kind, *get_args(kind))
            if get_origin(part) is Literal
            for word in get_args(part)
        ]
        text = (
            f"{text[13:]} is none of {', '.join(map(repr, allowed))}" if allowed else f"i{text[1:]}"
        )
    elif text.startswith("Expected"):
        text = re.sub("`([^`]*)`", _in_words, f"e{text[1:]}")
        if path and "[...]" not in path:
            for number, name in _STEP.findall(path):
                table = table[int(number) if number else name]
            if isinstance(table, str | int | float | None):  # a list or table may hold a password
                text += f"{':' if ', got ' in text else ', got'} {reprlib.repr(table)}"
    else:
        text = text[:1].lower() + text[1:].rstrip(".")
    return f"{path}: {text}" if path else text


def _in_words(kinds: re.Match[str]) -> str:
    names = kinds[1].removesuffix(" | null").split(" | ")
    return " or ".join(_KINDS.get(name, name) for name in names)


def _names(form: Any) -> set[str]:
    if is_dataclass(form):
        kinds = {field.name: field.type for field in fields(form)}
    elif isinstance(form, type) and issubclass(form, msgspec.Struct):
        kinds = {field.encode_name: field.type for field in msgspec.structs.fields(form)}
    else:
        return {name for part in getattr(form, "__args__", ()) for name in _names(part)}
    return {*kinds}.union(*map(_names, kinds.values()))


def parse_json(text: str) -> Any:
    """What a JSON text holds; a `ValueError` where a number is NaN, infinite, or longer than a
    number can be.
    """
    return json.loads(
        text, parse_constant=_parse_float, parse_int=_parse_int, parse_float=_parse_float
    )


def _parse_int(text: str) -> int:
    if len(text) > _MOST_DIGITS:
        raise ValueError(f"a number has {len(text)} digits")
    return int(text)


def _parse_float(text: str) -> float:
    if not math.isfinite(number := float(text)):
        raise ValueError(f"{text[:_MOST_DIGITS]} is no finite number")
    return number


_LONGEST_REASON = 300
_ARRAY = "array"
"""The one entry of what stands for an array in a card."""
_KEY = "swashtwin"
"""The one entry of a file's metadata; safetensors would write several in an order of its own."""


def save_artifact(
    path: Path | str, kind: str, version: int, thing: Any, *, may_be_nan: Sequence[str] | None = ()
) -> Path:
    """`path`, after a dataclass was written to it whole; its arrays, at any depth, become tensors
    of the file, those of texts lists of the card.

    Parameters
    ----------
    kind : what it is, such as ``"classifier"``.
    version : version of the dataclass.
    thing : the dataclass.
    may_be_nan : arrays that may hold NaN or infinity, such as ``"reference.speed"``; None for all.

    Raises
    ------
    ArtifactError
        Another array holds NaN or infinity.
    """
    arrays: list[Any] = []

    def take(array: Any) -> Any:
        if isinstance(array, np.ndarray) and array.dtype.kind == "U":
            return array.tolist()
        arrays.append(array)
        return {_ARRAY: len(arrays) - 1}

    names: dict[str, int] = {}
    card = _with_names(to_table(thing, of_array=take), "", names)
    named = {name: arrays[index] for name, index in names.items()}
    return write_artifact(path, kind, version, card, named, may_be_nan=may_be_nan)


def _with_names(card: Any, name: str, names: dict[str, int]) -> Any:
    """A card whose arrays are named by where they stand in it; `names` is given the number of
    each.
    """
    if isinstance(card, dict):
        if [*card] == [_ARRAY]:
            names[name] = card[_ARRAY]
            return {_ARRAY: name}
        return {
            key: _with_names(value, f"{name}.{key}" if name else str(key), names)
            for key, value in card.items()
        }
    if isinstance(card, (list, tuple)):
        return [_with_names(value, f"{name}.{index}", names) for index, value in enumerate(card)]
    return card


def load_artifact(
    path: Path | str,
    form: type[T],
    kind: str,
    version: int,
    *,
    advice: str,
    may_be_nan: Sequence[str] | None = (),
) -> T:
    """What `save_artifact` wrote. An array must have the type and the number of axes that `form`
    says.

    Parameters
    ----------
    form : the dataclass; it refuses what contradicts itself (``__post_init__``) with a
        `ValueError`.
    kind, version, may_be_nan : as in `save_artifact`; another kind or version is refused.
    advice : how to come by a good file, such as ``"save it again"``; ends each message.

    Raises
    ------
    MissingFileError
        There is no such file.
    ArtifactError
        The file is damaged, edited, something else, of another version, or holds what `form`
        refuses.
    """
    card, arrays = read_artifact(path, kind, version, advice=advice, may_be_nan=may_be_nan)
    with translate_load_errors(path, kind):
        return from_table(
            card,
            form,
            to_array=lambda _, entry: (
                np.array(entry, str) if isinstance(entry, list) else arrays[entry[_ARRAY]]
            ),
        )


def write_artifact(
    path: Path | str,
    kind: str,
    version: int,
    card: Mapping[str, Any],
    arrays: Mapping[str, Any],
    *,
    may_be_nan: Sequence[str] | None = (),
) -> Path:
    """`path`, after the artifact was written to it whole.

    Parameters
    ----------
    kind : what it is, such as ``"classifier"``.
    version : version of the kind's card and arrays.
    card : everything that is no array, as JSON can hold it.
    arrays : by name; tensors on the CPU are such too.
    may_be_nan : names of the arrays that may hold NaN or infinity; None for all.

    Raises
    ------
    ArtifactError
        An array holds NaN or infinity.
    """
    saved = {name: np.asarray(array, order="C") for name, array in arrays.items()}
    _require_finite(f"the {kind} is not saved to {path}", saved, may_be_nan)
    card = json.loads(json.dumps(dict(card)))
    note = {
        "kind": kind,
        "version": version,
        "card": card,
        "sha256": _checksum(kind, version, card, saved),
    }
    with atomic_write(Path(path)) as temporary:
        save_file(saved, temporary, metadata={_KEY: json.dumps(note, sort_keys=True)})
    return Path(path)


def read_artifact(
    path: Path | str, kind: str, version: int, *, advice: str, may_be_nan: Sequence[str] | None = ()
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """(card, arrays) that `write_artifact` wrote.

    Parameters
    ----------
    kind, version, may_be_nan : as in `write_artifact`; another kind or version is refused.
    advice : how to come by a good file, such as ``"save it again"``; ends each message.

    Raises
    ------
    MissingFileError
        There is no such file.
    ArtifactError
        The file is damaged, edited, something else, of another version, or an array holds NaN or
        infinity.
    """
    if not Path(path).is_file():
        raise MissingFileError(f"{path} does not exist; {advice}.")
    try:
        with safe_open(path, framework="np") as file:
            metadata = file.metadata() or {}
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as cause:
        reason = str(cause).splitlines()[0]
        raise ArtifactError(
            f"{path} is damaged or no saved {kind} ({reason}); {advice}."
        ) from cause
    if _KEY not in metadata:
        former = re.search(
            r"swashtwin-[a-z]+(-[a-z]+)*(-\d+)?", " ".join([*metadata, *metadata.values()])
        )
        what = f"has the former format {former[0]}" if former else "was not written by swashtwin"
        raise ArtifactError(
            f"{path} {what}; this swashtwin reads version {version} of a {kind}: {advice}."
        )
    try:
        note = parse_json(metadata[_KEY])
        identity, card, checksum = (
            (str(note["kind"]), note["version"]),
            note["card"],
            note["sha256"],
        )
    except (ValueError, KeyError, TypeError, RecursionError) as cause:
        raise ArtifactError(f"{path} is damaged: its card cannot be read; {advice}.") from cause
    if identity[0] != kind:
        raise ArtifactError(f"{path} holds a {identity[0][:40]!r}, not a {kind}; {advice}.")
    if identity[1] != version:
        raise ArtifactError(
            f"{path} has version {str(identity[1])[:40]} of a {kind}, this swashtwin reads version {version}; {advice}."
        )
    if checksum != _checksum(kind, version, card, arrays):
        raise ArtifactError(
            f"{path} was changed after it was saved (its SHA-256 does not match); {advice}."
        )
    _require_finite(str(path), arrays, may_be_nan)
    return card, arrays


def artifact_kind(path: Path | str) -> str:
    """Kind of the artifact in a file, empty where it is none; nothing else of it is read or
    checked.
    """
    try:
        with safe_open(path, framework="np") as file:
            note = parse_json((file.metadata() or {}).get(_KEY, "{}"))
    except (SafetensorError, OSError, ValueError, RecursionError):
        return ""
    return str(note.get("kind", "")) if isinstance(note, dict) else ""


@contextmanager
def translate_load_errors(path: Path | str, kind: str) -> Iterator[None]:
    """Within it, building an object from a card turns every misfit into an `ArtifactError` of one
    line.
    """
    try:
        yield
    except ArtifactError:
        raise
    except (
        InputError, LookupError, TypeError, ValueError, AttributeError, RuntimeError, ArithmeticError, MemoryError
    ) as cause:  # fmt: skip
        reason = (str(cause).splitlines() or [type(cause).__name__])[0][:_LONGEST_REASON]
        raise ArtifactError(
            f"{path} is a {kind} that does not fit this swashtwin ({reason}); was it saved by a newer one?"
        ) from cause


def _require_finite(
    where: str, arrays: Mapping[str, np.ndarray], may_be_nan: Sequence[str] | None
) -> None:
    for name, array in arrays.items():
        if may_be_nan is None or name in may_be_nan or array.dtype.kind != "f":
            continue
        if not np.isfinite(array).all():
            raise ArtifactError(f"{where}: {name} holds NaN or infinity.")


def _checksum(kind: str, version: int, card: Any, arrays: Mapping[str, np.ndarray]) -> str:
    digest = hashlib.sha256(f"{kind} {version}\n{json.dumps(card, sort_keys=True)}\n".encode())
    for name in sorted(arrays):
        array = np.asarray(arrays[name], order="C")
        digest.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()
