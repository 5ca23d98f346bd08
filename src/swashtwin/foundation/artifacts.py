"""Artifacts on disk: arrays and a JSON card in one safetensors file, with a version and a checksum.

Trained classifiers, window sets and checkpoints are all such files. Reading one runs no code. A SHA-256 over
kind, version, card and arrays tells a damaged or edited file; it is no signature, since whoever edits a file on
purpose can write a new checksum. A crash while writing leaves the file as it was.
"""

import hashlib
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from swashtwin.foundation.cards import from_table, parse_json, to_table
from swashtwin.foundation.errors import ArtifactError, InputError, MissingFileError
from swashtwin.foundation.files import replacing

T = TypeVar("T")

_LONGEST_REASON = 300
_ARRAY = "array"
"""The one entry of what stands for an array in a card."""
_KEY = "swashtwin"
"""The one entry of a file's metadata; safetensors would write several in an order of its own."""


def save_artifact(
    path: Path | str, kind: str, version: int, thing: Any, *, may_be_nan: Sequence[str] | None = ()
) -> Path:
    """`path`, after a dataclass was written to it whole; its arrays, at any depth, become tensors of the file,
    those of texts lists of the card.

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
    """A card whose arrays are named by where they stand in it; `names` is given the number of each."""
    if isinstance(card, dict):
        if [*card] == [_ARRAY]:
            names[name] = card[_ARRAY]
            return {_ARRAY: name}
        return {key: _with_names(value, f"{name}.{key}" if name else str(key), names) for key, value in card.items()}
    if isinstance(card, (list, tuple)):
        return [_with_names(value, f"{name}.{index}", names) for index, value in enumerate(card)]
    return card


def load_artifact(
    path: Path | str, form: type[T], kind: str, version: int, *, advice: str, may_be_nan: Sequence[str] | None = ()
) -> T:
    """What `save_artifact` wrote. An array must have the type and the number of axes that `form` says.

    Parameters
    ----------
    form : the dataclass; it refuses what contradicts itself (``__post_init__``) with a `ValueError`.
    kind, version, may_be_nan : as in `save_artifact`; another kind or version is refused.
    advice : how to come by a good file, such as ``"save it again"``; ends each message.

    Raises
    ------
    MissingFileError
        There is no such file.
    ArtifactError
        The file is damaged, edited, something else, of another version, or holds what `form` refuses.
    """
    card, arrays = read_artifact(path, kind, version, advice=advice, may_be_nan=may_be_nan)
    with refuse_misfits(path, kind):
        return from_table(
            card,
            form,
            to_array=lambda _, entry: np.array(entry, str) if isinstance(entry, list) else arrays[entry[_ARRAY]],
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
    note = {"kind": kind, "version": version, "card": card, "sha256": _checksum(kind, version, card, saved)}
    with replacing(Path(path)) as temporary:
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
        The file is damaged, edited, something else, of another version, or an array holds NaN or infinity.
    """
    if not Path(path).is_file():
        raise MissingFileError(f"{path} does not exist; {advice}.")
    try:
        with safe_open(path, framework="np") as file:
            metadata = file.metadata() or {}
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as cause:
        reason = str(cause).splitlines()[0]
        raise ArtifactError(f"{path} is damaged or no saved {kind} ({reason}); {advice}.") from cause
    if _KEY not in metadata:
        former = re.search(r"swashtwin-[a-z]+(-[a-z]+)*(-\d+)?", " ".join([*metadata, *metadata.values()]))
        what = f"has the former format {former[0]}" if former else "was not written by swashtwin"
        raise ArtifactError(f"{path} {what}; this swashtwin reads version {version} of a {kind}: {advice}.")
    try:
        note = parse_json(metadata[_KEY])
        identity, card, checksum = (str(note["kind"]), note["version"]), note["card"], note["sha256"]
    except (ValueError, KeyError, TypeError, RecursionError) as cause:
        raise ArtifactError(f"{path} is damaged: its card cannot be read; {advice}.") from cause
    if identity[0] != kind:
        raise ArtifactError(f"{path} holds a {identity[0][:40]!r}, not a {kind}; {advice}.")
    if identity[1] != version:
        raise ArtifactError(
            f"{path} has version {str(identity[1])[:40]} of a {kind}, this swashtwin reads version {version}; {advice}."
        )
    if checksum != _checksum(kind, version, card, arrays):
        raise ArtifactError(f"{path} was changed after it was saved (its SHA-256 does not match); {advice}.")
    _require_finite(str(path), arrays, may_be_nan)
    return card, arrays


def artifact_kind(path: Path | str) -> str:
    """Kind of the artifact in a file, empty where it is none; nothing else of it is read or checked."""
    try:
        with safe_open(path, framework="np") as file:
            note = parse_json((file.metadata() or {}).get(_KEY, "{}"))
    except (SafetensorError, OSError, ValueError, RecursionError):
        return ""
    return str(note.get("kind", "")) if isinstance(note, dict) else ""


@contextmanager
def refuse_misfits(path: Path | str, kind: str) -> Iterator[None]:
    """Within it, building an object from a card turns every misfit into an `ArtifactError` of one line."""
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


def _require_finite(where: str, arrays: Mapping[str, np.ndarray], may_be_nan: Sequence[str] | None) -> None:
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
