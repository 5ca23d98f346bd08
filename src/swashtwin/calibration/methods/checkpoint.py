"""A search on disk while it goes on, so that an interrupted one ends at the same bits as one that was left alone.

Searches in epochs (`IPINN`, `DirectAdam`) write one. The others take a second: begun again with the same seed they end
at the same bits too.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from swashtwin.calibration.methods.search import Calibrator, Progress, Search
from swashtwin.calibration.objective.spectrum_objective import Objective
from swashtwin.foundation import (
    InputError,
    add_prefix,
    optimizer_tensors,
    read_run,
    refuse_misfits,
    restore_optimizer,
    select_prefix,
    write_run,
)

_KIND, _VERSION = "calibration checkpoint", 2


@dataclass(frozen=True)
class Checkpoint:
    """File of a search's state, and how often it is written."""

    path: Path
    """The file; one of the same job is continued."""
    every: int = 25
    """Epochs from one writing to the next."""
    job: Mapping[str, Any] = field(default_factory=dict)
    """What is searched and how, as JSON can hold it; a file of another job is refused. `calibrate` fills it in."""

    def __post_init__(self) -> None:
        if self.every < 1:
            raise InputError(f"every ({self.every}) must be at least 1.")

    def is_due(self, epochs: int) -> bool:
        """Whether the file is written after so many epochs."""
        return epochs % self.every == 0

    def save(
        self,
        weights: Mapping[str, Tensor],
        optimizer: torch.optim.Optimizer,
        schedule: torch.optim.lr_scheduler.LRScheduler,
        records: Mapping[str, Float[np.ndarray, "..."]],
    ) -> None:
        """Write weights, Adam's moments, the step size and the records so far to the file."""
        arrays = {name: torch.as_tensor(array) for name, array in records.items()}
        tensors = add_prefix("weights", weights) | add_prefix("records", arrays)
        tensors |= add_prefix("optimizer", optimizer_tensors(optimizer))
        state = {"schedule": schedule.state_dict(), "rates": [group["lr"] for group in optimizer.param_groups]}
        write_run(self.path, _KIND, _VERSION, self.job, tensors, state)

    def load(
        self, optimizer: torch.optim.Optimizer, schedule: torch.optim.lr_scheduler.LRScheduler
    ) -> tuple[dict[str, Tensor], dict[str, Float[np.ndarray, "..."]]]:
        """Weights and records of the file, after optimizer and schedule were set to its state; nothing without one.

        Raises
        ------
        ArtifactError
            The file is damaged or of another format.
        InputError
            The file is of another job: the first thing that differs is named with both values.
        """
        if not Path(self.path).exists():
            return {}, {}
        tensors, state = read_run(self.path, _KIND, _VERSION, self.job)
        with refuse_misfits(self.path, _KIND):
            restore_optimizer(optimizer, select_prefix("optimizer", tensors))
            schedule.load_state_dict(state["schedule"])
            for group, rate in zip(optimizer.param_groups, state["rates"], strict=True):
                group["lr"] = rate
        records = {name: tensor.numpy() for name, tensor in select_prefix("records", tensors).items()}
        return select_prefix("weights", tensors), records


@runtime_checkable
class ResumableCalibrator(Calibrator, Protocol):
    """A method whose search can be interrupted and go on."""

    is_resumable: ClassVar[bool]
    """True."""

    def search(
        self,
        objective: Objective,
        *,
        seed: int,
        progress: Progress | None = None,
        checkpoint: Checkpoint | None = None,
    ) -> Search:
        """Result of the search, continued from `checkpoint` if that file exists."""
        ...
