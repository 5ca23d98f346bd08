"""A training run on disk: one file after each epoch, from which the run continues bit for bit.

Weights, Adam's moments and the history are in one file. Random states are not saved: each epoch draws its order and its
dropout from a stream that the seed and the epoch's number give.
"""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from torch import nn

from swashtwin.foundation import (
    add_prefix,
    optimizer_tensors,
    read_run,
    refuse_misfits,
    restore_optimizer,
    select_prefix,
    write_run,
)
from swashtwin.learning.training.settings import Epoch

_KIND, _VERSION = "training checkpoint", 3


def save_checkpoint(
    path: Path,
    run: dict[str, Any],
    network: nn.Module,
    optimizer: torch.optim.Optimizer,
    history: tuple[Epoch, ...],
) -> None:
    """Write the run's state after the last epoch of `history`; a crash leaves the file of the epoch before."""
    tensors = add_prefix("network", network.state_dict()) | add_prefix("optimizer", optimizer_tensors(optimizer))
    arrays = {name: tensor.cpu() for name, tensor in tensors.items()}
    write_run(path, _KIND, _VERSION, run, arrays, [asdict(epoch) for epoch in history])


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
    arrays, history = read_run(path, _KIND, _VERSION, run)
    tensors = {name: torch.as_tensor(array) for name, array in arrays.items()}
    with refuse_misfits(path, _KIND):
        network.load_state_dict(select_prefix("network", tensors))
        restore_optimizer(optimizer, select_prefix("optimizer", tensors))
        return tuple(Epoch(**epoch) for epoch in history)
