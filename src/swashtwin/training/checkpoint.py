"""A training run on disk: one file after each epoch, from which the run continues bit for bit.

Tensors (weights, Adam's moments) and a JSON text (what the run is, its history) stand in one safetensors file, so no
interrupt separates them, and reading it runs no code. Random states need no place: each epoch draws its order and its
dropout from a stream that the seed and the epoch's number name.
"""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from swashtwin.errors import ArtifactError, InputError
from swashtwin.files import replacing
from swashtwin.training.settings import Epoch

FORMAT = "swashtwin-checkpoint-1"


def save_checkpoint(
    path: Path,
    run: dict[str, Any],
    network: nn.Module,
    optimizer: torch.optim.Optimizer,
    history: tuple[Epoch, ...],
) -> None:
    """Write the run's state after the last epoch of `history`; a crash leaves the file of the epoch before."""
    tensors = {f"network.{name}": tensor for name, tensor in network.state_dict().items()}
    for index, state in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{index}.{name}": value for name, value in state.items()}
    text = json.dumps({"run": run, "history": [asdict(epoch) for epoch in history]})
    held = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    with replacing(path) as temporary:
        save_file(held, temporary, metadata={"format": FORMAT, "run": text})


def load_checkpoint(
    path: Path, run: dict[str, Any], network: nn.Module, optimizer: torch.optim.Optimizer
) -> tuple[Epoch, ...]:
    """History up to the checkpoint, after network and optimizer were set to its state.

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
    if metadata.get("format") != FORMAT:
        raise ArtifactError(
            f"{path} has the format {metadata.get('format')!r}, this version reads {FORMAT!r}; delete it to start anew."
        )
    try:
        saved = json.loads(metadata["run"])
        _require_same_run(path, saved["run"], json.loads(json.dumps(run)))
        network.load_state_dict(_under("network.", tensors))
        optimizer.load_state_dict({**optimizer.state_dict(), "state": _moments(_under("optimizer.", tensors))})
        return tuple(Epoch(**epoch) for epoch in saved["history"])
    except (KeyError, TypeError, AttributeError, RuntimeError, json.JSONDecodeError) as cause:
        raise ArtifactError(f"{path} is damaged ({type(cause).__name__}); delete it to start again.") from cause


def _under(prefix: str, tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): tensor for name, tensor in tensors.items() if name.startswith(prefix)}


def _moments(tensors: dict[str, Tensor]) -> dict[int, dict[str, Tensor]]:
    states: dict[int, dict[str, Tensor]] = {}
    for name, tensor in tensors.items():
        index, word = name.split(".", 1)
        states.setdefault(int(index), {})[word] = tensor
    return states


def _require_same_run(path: Path, saved: dict[str, Any], asked: dict[str, Any]) -> None:
    for name in asked:
        if saved.get(name) != asked[name]:
            raise InputError(
                f"{path} is of another run: its {name} is {_short(saved.get(name))}, this run's is "
                f"{_short(asked[name])}; name another checkpoint, or train as it did."
            )


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
