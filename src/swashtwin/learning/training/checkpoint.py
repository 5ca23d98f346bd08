"""A training run on disk: one file after each epoch, from which the run continues bit for bit.

Weights, Adam's moments and the history stand in one file (`run_files`). Random states need no place: each epoch draws
its order and its dropout from a stream that the seed and the epoch's number name.
"""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from torch import nn

from swashtwin.foundation import damaged, named, optimizer_tensors, read_run, restore_optimizer, under, write_run
from swashtwin.learning.training.settings import Epoch

FORMAT = "swashtwin-checkpoint-2"


def save_checkpoint(
    path: Path,
    run: dict[str, Any],
    network: nn.Module,
    optimizer: torch.optim.Optimizer,
    history: tuple[Epoch, ...],
) -> None:
    """Write the run's state after the last epoch of `history`; a crash leaves the file of the epoch before."""
    tensors = named("network", network.state_dict()) | named("optimizer", optimizer_tensors(optimizer))
    write_run(path, FORMAT, run, tensors, [asdict(epoch) for epoch in history])


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
    tensors, history = read_run(path, FORMAT, run)
    try:
        network.load_state_dict(under("network", tensors))
        restore_optimizer(optimizer, under("optimizer", tensors))
        return tuple(Epoch(**epoch) for epoch in history)
    except (KeyError, TypeError, ValueError, RuntimeError) as cause:
        raise damaged(path, cause) from cause
