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
from swashtwin.learning.training.classifier import WINDOWS_PER_BLOCK, Normalization
from swashtwin.learning.training.steps import Steps, adam, is_replayed
from swashtwin.learning.training.training_settings import Epoch, TrainingSettings, transform_windows
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.recordings import Manifest

_KIND = "training checkpoint"
_VERSION = 4


@dataclass(frozen=True, eq=False)
class _Checkpoint:
    """State of a run after an epoch."""

    run: dict[str, Any]
    weights: dict[str, np.ndarray]
    moments: dict[str, np.ndarray]
    """Moments of the optimizer."""
    history: tuple[Epoch, ...]


@dataclass(frozen=True, eq=False)
class TrainingRun:
    """Everything that determines the result of a training, as `fit` takes it."""

    network: Network
    """Architecture; its weights are not used."""
    windows: WindowSet
    normalization: Normalization
    settings: TrainingSettings
    seed: int
    manifest: Manifest
    device: str

    def identity(self) -> dict[str, Any]:
        """Return what distinguishes the run from all others, as JSON can hold it."""
        identity: dict[str, Any] = {"network": self.network.name}
        for name, value in self.network.settings.items():
            identity[f"network's {name}"] = value
        identity.update(self.settings.to_dict())
        identity["seed"] = self.seed
        identity["device"] = self.device
        identity["training data (SHA-256)"] = self.windows.fingerprint()
        identity["manifest"] = self.manifest
        return identity


def train_epochs(
    run: TrainingRun,
    *,
    checkpoint: Path | None,
    resume: bool,
    progress: Callable[[Epoch], None] | None,
) -> tuple[Network, tuple[Epoch, ...]]:
    """Return the trained network on the CPU in evaluation mode, and its history.

    Parameters
    ----------
    checkpoint, resume, progress : see `fit`.
    """
    _require_device(run.device)
    settings = run.settings
    with _deterministic_kernels(run.device), one_thread():
        trained = run.network.fresh(derive_seed(run.seed, "weights")).to(run.device)
        is_captured = is_replayed(trained, run.device)
        optimizer = adam(trained, settings.learning_rate, is_captured)
        identity = run.identity() if checkpoint is not None else {}
        history = _start(checkpoint, resume, identity, trained, optimizer)

        with TorchStream(derive_seed(run.seed, "pretraining")):
            signals = _EpochSignals(run, trained)
            if not history:
                trained.pretrain(signals.of_epoch(0), derive_seed(run.seed, "pretraining"))

        weights = None
        if settings.class_weights:
            weights = _class_weights(run.windows, run.device)
        dropout = TorchStream(derive_seed(run.seed, "dropout"))
        data = (signals.clean, signals.target)
        steps = Steps(trained, optimizer, settings, data, weights, dropout, is_captured)

        for number in range(len(history) + 1, settings.epochs + 1):
            _set_rate(optimizer, settings.learning_rate_in(number))
            dropout.restart(derive_seed(run.seed, "dropout", number))
            with dropout:
                signal = signals.of_epoch(number)
            order_rng = random_stream(run.seed, "order", number)
            order = torch.from_numpy(order_rng.permutation(len(run.windows))).to(run.device)
            loss, accuracy = steps.epoch(signal, order)
            if not math.isfinite(loss):
                raise InputError(
                    f"The loss is {loss} in epoch {number}: the learning rate is too high, or a "
                    "sample too large.",
                    field="learning_rate",
                    remedy="Reduce {learning_rate}, or check the samples.",
                )

            history += (Epoch(number, loss, accuracy),)
            if checkpoint is not None:
                save_checkpoint(Path(checkpoint), identity, trained, optimizer, history)
            if progress is not None:
                progress(history[-1])
    return trained.cpu().eval(), history


def _require_device(device: str) -> None:
    has_gpu = torch.cuda.is_available()
    kind = device.partition(":")[0]
    if kind == "cpu" or (kind == "cuda" and has_gpu):
        return
    usable = "cpu or cuda" if has_gpu else "cpu (this machine has no usable GPU)"
    raise InputError(f"The device {device!r} cannot be used here; choose {usable}.", field="device")


class _EpochSignals:
    """Training windows as the network represents them, with the changes of each epoch."""

    def __init__(self, run: TrainingRun, network: Network) -> None:
        self._run = run
        self._network = network
        self.clean = self._represent(run.windows)
        self.target = torch.from_numpy(run.windows.target).to(run.device)

    def of_epoch(self, number: int) -> Tensor:
        """Return all windows, with those that the epoch disturbs."""
        run = self._run
        rows, changed = transform_windows(run.windows, run.settings, run.seed, number)
        if not len(rows):
            return self.clean
        row_tensor = torch.from_numpy(rows).to(run.device)
        return self.clean.index_copy(0, row_tensor, self._represent(changed))

    def _represent(self, windows: WindowSet) -> Tensor:
        device = self._run.device
        signal = torch.from_numpy(self._run.normalization.apply(windows))
        turns = torch.from_numpy(windows.turns_per_sample)
        with torch.no_grad():
            return torch.cat(
                [
                    self._network.represent_at(batch.to(device), batch_turns.to(device))
                    for batch, batch_turns in zip(
                        signal.split(WINDOWS_PER_BLOCK), turns.split(WINDOWS_PER_BLOCK), strict=True
                    )
                ]
            )


def _class_weights(windows: WindowSet, device: str) -> Tensor:
    n_classes = len(windows.classes)
    counts = np.bincount(windows.target, minlength=n_classes)
    weights = len(windows) / (n_classes * counts)
    return torch.tensor(weights, dtype=torch.float32, device=device)


@contextmanager
def _deterministic_kernels(device: str) -> Iterator[None]:
    """Let a GPU use kernels that give the same bits each time; a CPU has no others.

    The setting is that of the whole process, and is restored afterwards.
    """
    cudnn = torch.backends.cudnn
    original = (cudnn.deterministic, cudnn.benchmark)
    if device != "cpu":
        cudnn.deterministic = True
        cudnn.benchmark = False
    try:
        yield
    finally:
        cudnn.deterministic, cudnn.benchmark = original


def _start(
    checkpoint: Path | None,
    resume: bool,
    identity: dict[str, Any],
    network: Network,
    optimizer: torch.optim.Optimizer,
) -> tuple[Epoch, ...]:
    """Return the history to continue from, after network and optimizer were set to its state."""
    if checkpoint is None:
        if resume:
            raise InputError(
                "Resuming needs a checkpoint, the file to continue from.",
                field="checkpoint",
                remedy="Set {checkpoint}.",
            )
        return ()
    if not Path(checkpoint).exists():
        return ()
    if not resume:
        raise InputError(
            f"{checkpoint} exists.",
            field="resume",
            remedy="Set {resume=True} to continue from it, or delete it to start again.",
        )
    return load_checkpoint(Path(checkpoint), identity, network, optimizer)


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
    """Write the run's state after the last epoch of `history`.

    A crash leaves the file of the previous epoch.
    """
    moments = {}
    for index, state in optimizer.state_dict()["state"].items():
        for name, value in state.items():
            moments[f"{index}.{name}"] = value.cpu().numpy()
    checkpoint = _Checkpoint(run, network.weights, moments, history)
    save_artifact(path, _KIND, _VERSION, checkpoint, may_be_nan=None)


def load_checkpoint(
    path: Path, run: dict[str, Any], network: Network, optimizer: torch.optim.Optimizer
) -> tuple[Epoch, ...]:
    """Return the history up to the checkpoint, after network and optimizer were set to its state.

    Raises
    ------
    ArtifactError
        The file is damaged or of another format.
    InputError
        The file is of another run: the first difference is named with both values.
    """
    advice = "delete it to start again"
    saved = load_artifact(path, _Checkpoint, _KIND, _VERSION, advice=advice, may_be_nan=None)
    # As JSON holds it, such as tuples as lists.
    difference = first_difference(saved.run, json.loads(json.dumps(run)))
    if difference:
        raise InputError(
            f"{path} is of another run: {difference}. Use another checkpoint, or repeat the "
            "settings it was written with."
        )

    states: dict[int, dict[str, Tensor]] = {}
    for key, moment in saved.moments.items():
        index, name = key.split(".", 1)
        states.setdefault(int(index), {})[name] = torch.as_tensor(moment)
    weights = {name: torch.as_tensor(weight) for name, weight in saved.weights.items()}
    optimizer_state = optimizer.state_dict()
    optimizer_state["state"] = states
    with translate_load_errors(path, _KIND, advice):
        network.load_state_dict(weights)
        optimizer.load_state_dict(optimizer_state)
    return saved.history
