"""Runs that take long, on disk: what a run is, how far it came and its tensors, whole in one safetensors file.

No interrupt separates what belongs together, and reading a file runs no code.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from swashtwin.foundation.errors import ArtifactError, InputError
from swashtwin.foundation.files import replacing


def write_run(path: Path, form: str, run: Mapping[str, Any], tensors: Mapping[str, Tensor], state: object) -> None:
    """Put a run's state into `path`; a crash leaves the file as it was.

    Parameters
    ----------
    form : name of the file's format.
    run : what the run is, as JSON can hold it; `read_run` refuses the file to any other.
    tensors : by name.
    state : what else it needs to go on, as JSON can hold it.
    """
    text = json.dumps({"run": dict(run), "state": state})
    held = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    with replacing(path) as temporary:
        save_file(held, temporary, metadata={"format": form, "run": text})


def read_run(path: Path, form: str, run: Mapping[str, Any]) -> tuple[dict[str, Tensor], Any]:
    """Tensors and state that `write_run` put into `path` for the same run.

    Raises
    ------
    ArtifactError
        The file is damaged or of another format.
    InputError
        The file is of another run: the first thing that differs is named with both values.
    """
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as cause:
        raise ArtifactError(f"{path} is damaged or no checkpoint ({cause}); delete it to start again.") from cause
    if metadata.get("format") != form:
        raise ArtifactError(
            f"{path} has the format {metadata.get('format')!r}, this version reads {form!r}; delete it to start anew."
        )
    try:
        saved = json.loads(metadata["run"])
        _require_same_run(path, saved["run"], json.loads(json.dumps(dict(run))))
        return tensors, saved["state"]
    except (KeyError, TypeError, AttributeError, json.JSONDecodeError) as cause:
        raise damaged(path, cause) from cause


def damaged(path: Path, cause: Exception) -> ArtifactError:
    """The error that says so of a checkpoint in which something is missing or of another form."""
    return ArtifactError(f"{path} is damaged ({type(cause).__name__}); delete it to start again.")


def named(prefix: str, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The same under names that begin with `prefix` and a point."""
    return {f"{prefix}.{name}": tensor for name, tensor in tensors.items()}


def under(prefix: str, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Those that `named` put under `prefix`, by their own names."""
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


def _require_same_run(path: Path, saved: dict[str, Any], asked: dict[str, Any]) -> None:
    for name in {**asked, **saved}:
        if saved.get(name) != asked.get(name):
            raise InputError(
                f"{path} is of another run: its {name} is {_short(saved.get(name))}, this run's is "
                f"{_short(asked.get(name))}; name another checkpoint, or repeat what it was made with."
            )


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
