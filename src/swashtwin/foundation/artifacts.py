"""Artifacts: a dataclass in one safetensors file, as a JSON card and its arrays.

Trained classifiers, window sets and checkpoints are artifacts. The dataclass alone defines what is
saved. Reading an artifact runs no code from the file. A SHA-256 over kind, version, card and arrays
detects a damaged or edited file; it is not a signature.
"""

import hashlib
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from swashtwin.foundation.atomic_files import atomic_write
from swashtwin.foundation.dataclass_tables import from_table, parse_json, to_table
from swashtwin.foundation.errors import ArtifactError, InputError, MissingFileError

T = TypeVar("T")

Extensions = Mapping[int, Callable[[dict[str, Any]], dict[str, Any]]]
"""Functions that return the card of an earlier version as one of the current version."""

_NO_EXTENSIONS: Extensions = MappingProxyType({})

# The only key of the entry that stands for an array in a card.
_ARRAY_KEY = "array"

# The only key of a file's metadata. safetensors writes several keys in random order, so that equal
# objects would give different files.
_METADATA_KEY = "swashtwin"

_MAX_REASON_CHARACTERS = 300

# Length of text from a damaged file in a message.
_MAX_SHOWN_CHARACTERS = 40

# Names of formats before version numbers were kept apart from the kind.
_FORMER_FORMAT = re.compile(r"swashtwin-[a-z]+(-[a-z]+)*(-\d+)?")


def save_artifact(
    path: Path | str, kind: str, version: int, thing: Any, *, may_be_nan: Sequence[str] | None = ()
) -> Path:
    """Write a dataclass to `path` as a complete file and return the path.

    Its arrays, at any depth, become tensors of the file; arrays of text become lists of the card.

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

    def encode_array(array: Any) -> Any:
        if isinstance(array, np.ndarray) and array.dtype.kind == "U":
            return array.tolist()
        arrays.append(array)
        return {_ARRAY_KEY: len(arrays) - 1}

    index_of: dict[str, int] = {}
    card = _name_arrays(to_table(thing, of_array=encode_array), "", index_of)
    named_arrays = {name: arrays[index] for name, index in index_of.items()}
    return write_artifact(path, kind, version, card, named_arrays, may_be_nan=may_be_nan)


def _name_arrays(card: Any, name: str, index_of: dict[str, int]) -> Any:
    """Return a card in which arrays are named by their position; add their indices to `index_of`.

    The array of the card's entry ``{"reference": {"speed": ...}}`` is named ``reference.speed``.
    """
    if isinstance(card, dict):
        if [*card] == [_ARRAY_KEY]:
            index_of[name] = card[_ARRAY_KEY]
            return {_ARRAY_KEY: name}
        prefix = f"{name}." if name else ""
        return {key: _name_arrays(value, f"{prefix}{key}", index_of) for key, value in card.items()}
    if isinstance(card, (list, tuple)):
        return [
            _name_arrays(value, f"{name}.{index}", index_of) for index, value in enumerate(card)
        ]
    return card


def load_artifact(
    path: Path | str,
    form: type[T],
    kind: str,
    version: int,
    *,
    advice: str,
    may_be_nan: Sequence[str] | None = (),
    extensions: Extensions = _NO_EXTENSIONS,
) -> T:
    """Return the dataclass that `save_artifact` wrote.

    Parameters
    ----------
    form : the dataclass. An array must have the type and the number of axes of its annotation;
        ``__post_init__`` raises a `ValueError` if fields contradict each other.
    kind, version, may_be_nan : as in `save_artifact`; another kind or version is refused.
    advice : how to get a valid file, such as ``"save it again"``; ends each message.
    extensions : by earlier version that is read too.

    Raises
    ------
    MissingFileError
        The file does not exist.
    ArtifactError
        The file is damaged, edited, something else, of another version, or does not fit `form`.
    """
    card, arrays = read_artifact(
        path, kind, version, advice=advice, may_be_nan=may_be_nan, extensions=extensions
    )

    def decode_array(array_type: type, entry: Any) -> Any:
        if isinstance(entry, list):
            return np.array(entry, str)
        name = entry[_ARRAY_KEY]
        if name not in arrays:
            raise InputError(f"the array {name!r} is missing")
        return arrays[name]

    with translate_load_errors(path, kind, advice):
        return from_table(card, form, to_array=decode_array, complete=True)


def write_artifact(
    path: Path | str,
    kind: str,
    version: int,
    card: Mapping[str, Any],
    arrays: Mapping[str, Any],
    *,
    may_be_nan: Sequence[str] | None = (),
) -> Path:
    """Write a card and arrays to `path` as a complete file and return the path.

    Parameters
    ----------
    kind : what it is, such as ``"classifier"``.
    version : version of the kind's card and arrays.
    card : everything but the arrays, as JSON can hold it.
    arrays : by name; NumPy arrays, or tensors on the CPU.
    may_be_nan : names of the arrays that may hold NaN or infinity; None for all.

    Raises
    ------
    ArtifactError
        An array holds NaN or infinity.
    """
    arrays = {name: np.asarray(array, order="C") for name, array in arrays.items()}
    _require_finite(f"the {kind} is not saved to {path}", arrays, may_be_nan)

    card = json.loads(json.dumps(dict(card)))
    header = {
        "kind": kind,
        "version": version,
        "card": card,
        "sha256": _checksum(kind, version, card, arrays),
    }
    with atomic_write(Path(path)) as temporary:
        metadata = {_METADATA_KEY: json.dumps(header, sort_keys=True)}
        save_file(arrays, temporary, metadata=metadata)
    return Path(path)


def read_artifact(
    path: Path | str,
    kind: str,
    version: int,
    *,
    advice: str,
    may_be_nan: Sequence[str] | None = (),
    extensions: Extensions = _NO_EXTENSIONS,
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Return the card and the arrays that `write_artifact` wrote.

    Parameters
    ----------
    kind, version, may_be_nan : as in `write_artifact`; another kind or version is refused.
    advice : how to get a valid file, such as ``"save it again"``; ends each message.
    extensions : by earlier version that is read too.

    Raises
    ------
    MissingFileError
        The file does not exist.
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
            f"{path} is damaged or not a saved {kind} ({reason}); {advice}."
        ) from cause

    if _METADATA_KEY not in metadata:
        raise ArtifactError(
            f"{path} {_describe_origin(metadata)}; this swashtwin reads version {version} of a "
            f"{kind}: {advice}."
        )

    try:
        header = parse_json(metadata[_METADATA_KEY])
        saved_kind = str(header["kind"])
        saved_version = header["version"]
        card = header["card"]
        checksum = header["sha256"]
    except (ValueError, KeyError, TypeError, RecursionError) as cause:
        raise ArtifactError(f"{path} is damaged: its card cannot be read; {advice}.") from cause

    if saved_kind != kind:
        shown_kind = saved_kind[:_MAX_SHOWN_CHARACTERS]
        raise ArtifactError(f"{path} holds a {shown_kind!r}, not a {kind}; {advice}.")
    is_earlier = isinstance(saved_version, int) and saved_version in extensions
    if saved_version != version and not is_earlier:
        shown_version = str(saved_version)[:_MAX_SHOWN_CHARACTERS]
        raise ArtifactError(
            f"{path} has version {shown_version} of a {kind}, this swashtwin reads version "
            f"{version}; {advice}."
        )
    if checksum != _checksum(kind, saved_version, card, arrays):
        raise ArtifactError(
            f"{path} was changed after it was saved (its SHA-256 does not match); {advice}."
        )
    _require_finite(str(path), arrays, may_be_nan, f"; {advice}.")
    if is_earlier:
        with translate_load_errors(path, kind, advice):
            card = extensions[saved_version](card)
    return card, arrays


def _describe_origin(metadata: Mapping[str, str]) -> str:
    former_format = _FORMER_FORMAT.search(" ".join([*metadata, *metadata.values()]))
    if former_format:
        return f"has the former format {former_format[0]}"
    return "was not written by swashtwin"


def artifact_kind(path: Path | str) -> str:
    """Return the kind of the artifact in a file, without checking it; empty for other files."""
    try:
        with safe_open(path, framework="np") as file:
            header = parse_json((file.metadata() or {}).get(_METADATA_KEY, "{}"))
    except (SafetensorError, OSError, ValueError, RecursionError):
        return ""
    return str(header.get("kind", "")) if isinstance(header, dict) else ""


@contextmanager
def translate_load_errors(path: Path | str, kind: str, advice: str) -> Iterator[None]:
    """Raise an `ArtifactError` of one line for any error while an object is built from a card.

    A card whose checksum is right can still hold anything, since anybody can compute the checksum.

    Parameters
    ----------
    advice : how to get a valid file; ends the message.
    """
    try:
        yield
    except ArtifactError:
        raise
    except (
        InputError,
        LookupError,
        TypeError,
        ValueError,
        AttributeError,
        RuntimeError,
        ArithmeticError,
        MemoryError,
    ) as cause:
        lines = str(cause).splitlines() or [type(cause).__name__]
        reason = lines[0][:_MAX_REASON_CHARACTERS].rstrip(".")
        raise ArtifactError(
            f"{path} is a {kind} that does not fit this swashtwin ({reason}); it was written by "
            f"another version, or edited: {advice}."
        ) from cause


def _require_finite(
    subject: str,
    arrays: Mapping[str, np.ndarray],
    may_be_nan: Sequence[str] | None,
    ending: str = ".",
) -> None:
    if may_be_nan is None:
        return
    for name, array in arrays.items():
        is_checked = array.dtype.kind == "f" and name not in may_be_nan
        if is_checked and not np.isfinite(array).all():
            raise ArtifactError(f"{subject}: {name} holds NaN or infinity{ending}")


def _checksum(kind: str, version: int, card: Any, arrays: Mapping[str, np.ndarray]) -> str:
    digest = hashlib.sha256(f"{kind} {version}\n{json.dumps(card, sort_keys=True)}\n".encode())
    for name in sorted(arrays):
        array = np.asarray(arrays[name], order="C")
        digest.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()
