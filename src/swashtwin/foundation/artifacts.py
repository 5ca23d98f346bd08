"""Artifacts on disk: tensors and a JSON card in one safetensors file, with a version and a checksum.

Trained classifiers, window sets and runs that can go on are all such files. Reading one runs no code. A SHA-256 over
kind, version, card and tensors tells a damaged or edited file; it is no signature, since whoever edits a file on
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
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

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
    """`path`, after a dataclass was written to it whole; its arrays and tensors, at any depth, become tensors.

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

    def take(array: Any) -> dict[str, int]:
        arrays.append(array)
        return {_ARRAY: len(arrays) - 1}

    names: dict[str, int] = {}
    card = _with_names(to_table(thing, of_array=take), "", names)
    tensors = {name: torch.as_tensor(arrays[index]) for name, index in names.items()}
    return write_artifact(path, kind, version, card, tensors, may_be_nan=may_be_nan)


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
    card, tensors = read_artifact(path, kind, version, advice=advice, may_be_nan=may_be_nan)

    def give(of: Any, entry: Any) -> Any:
        tensor = tensors[entry[_ARRAY]]
        return tensor if of is Tensor or getattr(of, "array_type", None) is Tensor else tensor.numpy()

    with refuse_misfits(path, kind):
        return from_table(card, form, to_array=give)


def write_artifact(
    path: Path | str,
    kind: str,
    version: int,
    card: Mapping[str, Any],
    tensors: Mapping[str, Tensor],
    *,
    may_be_nan: Sequence[str] | None = (),
) -> Path:
    """`path`, after the artifact was written to it whole.

    Parameters
    ----------
    kind : what it is, such as ``"classifier"``.
    version : version of the kind's card and tensors.
    card : everything that is no tensor, as JSON can hold it.
    tensors : by name.
    may_be_nan : names of the tensors that may hold NaN or infinity; None for all.

    Raises
    ------
    ArtifactError
        A tensor holds NaN or infinity.
    """
    saved = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    _require_finite(f"the {kind} is not saved to {path}", saved, may_be_nan)
    card = json.loads(json.dumps(dict(card)))
    note = {"kind": kind, "version": version, "card": card, "sha256": _checksum(kind, version, card, saved)}
    with replacing(Path(path)) as temporary:
        save_file(saved, temporary, metadata={_KEY: json.dumps(note, sort_keys=True)})
    return Path(path)


def read_artifact(
    path: Path | str, kind: str, version: int, *, advice: str, may_be_nan: Sequence[str] | None = ()
) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """(card, tensors) that `write_artifact` wrote.

    Parameters
    ----------
    kind, version, may_be_nan : as in `write_artifact`; another kind or version is refused.
    advice : how to come by a good file, such as ``"save it again"``; ends each message.

    Raises
    ------
    MissingFileError
        There is no such file.
    ArtifactError
        The file is damaged, edited, something else, of another version, or a tensor holds NaN or infinity.
    """
    if not Path(path).is_file():
        raise MissingFileError(f"{path} does not exist; {advice}.")
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
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
    if checksum != _checksum(kind, version, card, tensors):
        raise ArtifactError(f"{path} was changed after it was saved (its SHA-256 does not match); {advice}.")
    _require_finite(str(path), tensors, may_be_nan)
    return card, tensors


def artifact_kind(path: Path | str) -> str:
    """Kind of the artifact in a file, empty where it is none; nothing else of it is read or checked."""
    try:
        with safe_open(path, framework="pt") as file:
            note = parse_json((file.metadata() or {}).get(_KEY, "{}"))
    except (SafetensorError, OSError, ValueError, RecursionError):
        return ""
    return str(note.get("kind", "")) if isinstance(note, dict) else ""


def require_form(value: Any, form: Any, where: str) -> None:
    """Refuse a value of a card that has another form.

    Parameters
    ----------
    form : a type; ``[form]`` for a list of such; ``{"name": form}`` for an object with these entries and no other, or
        ``{str: form}`` for one with any names; or ``(form, None)`` for what may be null. An int is a float too.
    where : what messages call it.

    Raises
    ------
    ValueError
        It has another form; the message names the first entry that differs.

    Examples
    --------
    >>> require_form({"rate": 1, "names": ["a", 2]}, {"rate": float, "names": [str]}, "card")
    Traceback (most recent call last):
    ValueError: card.names[1] is 2, no str
    """
    if isinstance(form, tuple):
        if value is not None or None not in form:
            require_form(value, next(kind for kind in form if kind is not None), where)
    elif isinstance(form, type):
        kinds = (int, float) if form is float else form
        if not isinstance(value, kinds) or (isinstance(value, bool) and form is not bool):
            raise ValueError(f"{where} is {_short(value)}, no {form.__name__}")
    elif isinstance(form, list):
        if not isinstance(value, list):
            raise ValueError(f"{where} is {_short(value)}, no list")
        for number, item in enumerate(value):
            require_form(item, form[0], f"{where}[{number}]")
    else:
        _require_object(value, form, where)


def _require_object(value: Any, form: Mapping[Any, Any], where: str) -> None:
    if not isinstance(value, dict):
        raise ValueError(f"{where} is {_short(value)}, no object")
    names = form if str not in form else dict.fromkeys(value, form[str])
    for name in [*names, *value]:
        if name not in value or name not in names:
            raise ValueError(f"{where} has {'no' if name not in value else 'an unknown'} entry {_short(name)!r}")
    for name, kind in names.items():
        require_form(value[name], kind, f"{where}.{_short(name)}")


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


def write_run(
    path: Path, kind: str, version: int, run: Mapping[str, Any], tensors: Mapping[str, Tensor], state: object
) -> None:
    """Put a run's state into `path`.

    Parameters
    ----------
    kind, version : of the file.
    run : what the run is, as JSON can hold it; `read_run` refuses the file to any other.
    tensors : by name; they may hold infinity.
    state : what else it needs to go on, as JSON can hold it.
    """
    write_artifact(path, kind, version, {"run": dict(run), "state": state}, tensors, may_be_nan=None)


def read_run(path: Path, kind: str, version: int, run: Mapping[str, Any]) -> tuple[dict[str, Tensor], Any]:
    """Tensors and state that `write_run` put into `path` for the same run.

    Raises
    ------
    ArtifactError
        The file is damaged or of another format.
    InputError
        The file is of another run: the first thing that differs is named with both values.
    """
    card, tensors = read_artifact(path, kind, version, advice="delete it to start again", may_be_nan=None)
    with refuse_misfits(path, kind):
        saved, state = dict(card["run"]), card["state"]
    _require_same_run(path, saved, json.loads(json.dumps(dict(run))))
    return tensors, state


def add_prefix(prefix: str, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The same under names that begin with `prefix` and a point."""
    return {f"{prefix}.{name}": tensor for name, tensor in tensors.items()}


def select_prefix(prefix: str, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Those that `add_prefix` put under `prefix`, by their own names."""
    start = f"{prefix}."
    return {name.removeprefix(start): tensor for name, tensor in tensors.items() if name.startswith(start)}


def optimizer_tensors(optimizer: torch.optim.Optimizer) -> dict[str, Tensor]:
    """An optimizer's moments by name."""
    states = optimizer.state_dict()["state"]
    return {f"{index}.{name}": value for index, state in states.items() for name, value in state.items()}


def restore_optimizer(optimizer: torch.optim.Optimizer, tensors: Mapping[str, Tensor]) -> None:
    """Set `optimizer` to moments that `optimizer_tensors` gave."""
    states: dict[int, dict[str, Tensor]] = {}
    for name, tensor in tensors.items():
        index, word = name.split(".", 1)
        states.setdefault(int(index), {})[word] = tensor
    optimizer.load_state_dict({**optimizer.state_dict(), "state": states})


def _require_finite(where: str, tensors: Mapping[str, Tensor], may_be_nan: Sequence[str] | None) -> None:
    for name, tensor in tensors.items():
        if may_be_nan is None or name in may_be_nan or not tensor.is_floating_point():
            continue
        if not bool(torch.isfinite(tensor).all()):
            raise ArtifactError(f"{where}: {name} holds NaN or infinity.")


def _checksum(kind: str, version: int, card: Any, tensors: Mapping[str, Tensor]) -> str:
    digest = hashlib.sha256(f"{kind} {version}\n{json.dumps(card, sort_keys=True)}\n".encode())
    for name in sorted(tensors):
        array = np.ascontiguousarray(tensors[name].numpy())
        digest.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def _require_same_run(path: Path, saved: dict[str, Any], run: dict[str, Any]) -> None:
    for name in {**run, **saved}:
        if saved.get(name) != run.get(name):
            raise InputError(
                f"{path} is of another run: its {name} is {_short(saved.get(name))}, this run's is "
                f"{_short(run.get(name))}; name another checkpoint, or repeat the settings it was written with."
            )


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
