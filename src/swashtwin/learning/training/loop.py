"""The training loop of networks of torch."""

import json
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from swashtwin.foundation import (
    InputError,
    TorchStream,
    derive_seed,
    first_difference,
    load_artifact,
    one_thread,
    random_stream,
    save_artifact,
    translate_load_errors,
)
from swashtwin.learning.networks.network import Network
from swashtwin.learning.training.classifier import TOGETHER, Normalization
from swashtwin.learning.training.settings import Epoch, TrainingSettings, transform_windows
from swashtwin.learning.training.steps import Steps, adam, is_replayed
from swashtwin.learning.windows.window_set import WindowSet

_KIND, _VERSION = "training checkpoint", 4


@dataclass(frozen=True, eq=False)
class _Checkpoint:
    """State of a run after an epoch."""

    run: dict[str, Any]
    weights: dict[str, np.ndarray]
    moments: dict[str, np.ndarray]
    """Of the optimizer."""
    history: tuple[Epoch, ...]


def train_epochs(
    network: Network,
    windows: WindowSet,
    normalization: Normalization,
    settings: TrainingSettings,
    seed: int,
    run: dict[str, Any],
    checkpoint: Path | None,
    resume: bool,
    progress: Callable[[Epoch], None] | None,
    device: str,
) -> tuple[Network, tuple[Epoch, ...]]:
    """(network of the same settings, trained, in evaluation mode on the CPU; loss and accuracy of
    each epoch).

    Parameters are those of `fit`; by `run`, what makes the run this one and no other, its
    checkpoint is known.
    """
    kind = device.partition(":")[0]
    if kind not in ("cpu", "cuda") or (kind == "cuda" and not torch.cuda.is_available()):
        usable = (
            "cpu or cuda" if torch.cuda.is_available() else "cpu (this machine has no usable GPU)"
        )
        raise InputError(f"device {device!r} cannot be used here; choose {usable}.")
    with _deterministic_kernels(device), one_thread():
        trained = network.fresh(derive_seed(seed, "weights")).to(device)
        replayed = is_replayed(trained, device)
        optimizer = adam(trained, settings.learning_rate, replayed)
        history = _start(checkpoint, resume, run, trained, optimizer)
        with TorchStream(derive_seed(seed, "pretraining")):
            clean = _tensors(trained, windows, normalization, device)

            def epoch_signal(number: int) -> Tensor:
                which, changed = transform_windows(windows, settings, seed, number)
                if not len(which):
                    return clean[0]
                again, _ = _tensors(trained, changed, normalization, device)
                return clean[0].index_copy(0, torch.from_numpy(which).to(device), again)

            if not history:
                trained.pretrain(epoch_signal(0), derive_seed(seed, "pretraining"))
        weights = _class_weights(windows, device) if settings.class_weights else None
        random = TorchStream(derive_seed(seed, "dropout"))
        steps = Steps(trained, optimizer, settings, clean, weights, random, replayed)
        for number in range(len(history) + 1, settings.epochs + 1):
            _set_rate(optimizer, settings.learning_rate_in(number))
            random.restart(derive_seed(seed, "dropout", number))
            with random:
                signal = epoch_signal(number)
            order = torch.from_numpy(
                random_stream(seed, "order", number).permutation(len(windows))
            ).to(device)
            loss, accuracy = steps.epoch(signal, order)
            if not math.isfinite(loss):
                raise InputError(
                    f"the loss is {loss} in epoch {number}; the learning rate is too high, or a sample too large."
                )
            history += (Epoch(number, loss, accuracy),)
            if checkpoint is not None:
                save_checkpoint(Path(checkpoint), run, trained, optimizer, history)
            if progress is not None:
                progress(history[-1])
    return trained.cpu().eval(), history


def _class_weights(windows: WindowSet, device: str) -> Tensor:
    counts = np.bincount(windows.target, minlength=len(windows.classes))
    return torch.tensor(
        len(windows) / (len(windows.classes) * counts), dtype=torch.float32, device=device
    )


@contextmanager
def _deterministic_kernels(device: str) -> Iterator[None]:
    """Kernels of a GPU that give the same bits each time, chosen for the whole process; a CPU has
    no others.
    """
    cudnn = torch.backends.cudnn
    before = cudnn.deterministic, cudnn.benchmark
    if device != "cpu":
        cudnn.deterministic, cudnn.benchmark = True, False
    try:
        yield
    finally:
        cudnn.deterministic, cudnn.benchmark = before


def _start(
    checkpoint: Path | None,
    resume: bool,
    run: dict[str, Any],
    network: Network,
    optimizer: torch.optim.Optimizer,
) -> tuple[Epoch, ...]:
    if checkpoint is None:
        if resume:
            raise InputError(
                "to resume needs a checkpoint, the file to continue from.", field="checkpoint"
            )
        return ()
    if not Path(checkpoint).exists():
        return ()
    if not resume:
        raise InputError(
            f"{checkpoint} exists; resume it, or delete it to start again.", field="resume"
        )
    return load_checkpoint(Path(checkpoint), run, network, optimizer)


def _tensors(
    network: Network, windows: WindowSet, normalization: Normalization, device: str
) -> tuple[Tensor, Tensor]:
    """(windows as the network represents them, their classes)."""
    signal = torch.from_numpy(normalization.apply(windows))
    with torch.no_grad():
        turns = torch.from_numpy(windows.turns_per_sample)
        represented = torch.cat(
            [
                network.represent_at(batch.to(device), part.to(device))
                for batch, part in zip(signal.split(TOGETHER), turns.split(TOGETHER), strict=True)
            ]
        )
    return represented, torch.from_numpy(windows.target).to(device)


def _set_rate(optimizer: torch.optim.Optimizer, rate: float) -> None:
    for group in optimizer.param_groups:
        if isinstance(group["lr"], Tensor):
            group["lr"].fill_(rate)
        else:
            group["lr"] = rate


def save_checkpoint(
    path: Path,
    run: dict[str, Any],
    network: Network,
    optimizer: torch.optim.Optimizer,
    history: tuple[Epoch, ...],
) -> None:
    """Write the run's state after the last epoch of `history`; a crash leaves the file of the epoch
    before.
    """
    moments = {
        f"{index}.{name}": value.cpu().numpy()
        for index, state in optimizer.state_dict()["state"].items()
        for name, value in state.items()
    }
    save_artifact(
        path, _KIND, _VERSION, _Checkpoint(run, network.weights, moments, history), may_be_nan=None
    )


def load_checkpoint(
    path: Path, run: dict[str, Any], network: Network, optimizer: torch.optim.Optimizer
) -> tuple[Epoch, ...]:
    """History up to the checkpoint, after network and optimizer were set to its state.

    Raises
    ------
    ArtifactError
        The file is damaged or of another format.
    InputError
        The file is of another run: the first thing that differs is named with both values.
    """
    saved = load_artifact(
        path, _Checkpoint, _KIND, _VERSION, advice="delete it to start again", may_be_nan=None
    )
    if difference := first_difference(saved.run, json.loads(json.dumps(run))):
        raise InputError(
            f"{path} is of another run: {difference}; name another checkpoint, or repeat the settings it was written "
            "with."
        )
    states: dict[int, dict[str, Tensor]] = {}
    for name, moment in saved.moments.items():
        index, word = name.split(".", 1)
        states.setdefault(int(index), {})[word] = torch.as_tensor(moment)
    with translate_load_errors(path, _KIND):
        network.load_state_dict(
            {name: torch.as_tensor(weight) for name, weight in saved.weights.items()}
        )
        optimizer.load_state_dict({**optimizer.state_dict(), "state": states})
    return saved.history
