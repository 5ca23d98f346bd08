"""The training loop."""

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from swashtwin.foundation import DataError, InputError, TorchStream, derive_seed, one_thread, stream
from swashtwin.learning.features import level_features
from swashtwin.learning.networks.network import Network, batches
from swashtwin.learning.training.checkpoint import load_checkpoint, save_checkpoint
from swashtwin.learning.training.classifier import FittedClassifier
from swashtwin.learning.training.normalization import Normalization
from swashtwin.learning.training.settings import PAPER_TRAINING, Epoch, TrainingSettings
from swashtwin.learning.training.train_transforms import transform_windows
from swashtwin.learning.training.training_reference import build_reference
from swashtwin.learning.windows.splitting import check_disjoint
from swashtwin.learning.windows.window_set import WindowSet, distinct_values
from swashtwin.recordings import Manifest, join_manifests

_BATCH = 32
"""Windows that pass the network together where nothing is learned: they stay in the processor's cache."""
_LARGEST = 1e16
"""Magnitude of a sample from which the power of a window is no finite number in single precision."""


def fit(
    network: Network,
    windows: WindowSet,
    *,
    settings: TrainingSettings = PAPER_TRAINING,
    seed: int = 0,
    validation: WindowSet | None = None,
    manifest: Manifest | Iterable[str] = (),
    checkpoint: Path | None = None,
    resume: bool = False,
    progress: Callable[[Epoch], None] | None = None,
    device: str = "cpu",
) -> FittedClassifier:
    """Classifier trained on `windows`, as it stands after the last epoch.

    `network` gives the architecture only and stays as it is: a network of the same settings with weights drawn from
    `seed` is trained. Same seed, windows, settings and machine: same bits. On the CPU it runs on one thread.

    Parameters
    ----------
    network : untrained network, such as ``BiTCN(train.n_channels, len(train.classes))``.
    windows : training windows with labels, measured and synthetic.
    settings : epochs, batch, learning rate, normalization; the paper's by default.
    seed : seed of weights, order and dropout.
    validation : windows whose loss and accuracy are noted after each epoch; they change nothing else.
    manifest : further recordings, as a manifest or by their ids, that had a part in the training windows, such as those
        a twin was calibrated on. They join the training and validation recordings in the classifier's manifest, which
        no test set may meet.
    checkpoint : file that the run is saved to after each epoch.
    resume : continue from `checkpoint` if it exists; the result has the same bits as a run without interruption.
    progress : called after each epoch.
    device : ``"cpu"`` or a GPU such as ``"cuda"``; the classifier comes back on the CPU.

    Raises
    ------
    DataError
        A class has no window, or a window has no label.
    LeakError
        Training and validation share a recording.
    InputError
        Network and windows do not fit, the loss ran away, or the checkpoint is of another run.
    """
    _require_fitting(network, windows, validation)
    _require_device(device)
    used = join_manifests([windows.sources, manifest, () if validation is None else validation.sources])
    run = _description(network, windows, settings, seed, validation, used, device)
    normalization = Normalization.fit(settings.normalization, windows)
    kernels = _deterministic_kernels(device, settings.deterministic)
    with kernels, one_thread():
        trained = network.fresh(derive_seed(seed, "weights")).to(device)
        optimizer = torch.optim.Adam(
            trained.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay
        )
        history = _start(checkpoint, resume, run, trained, optimizer)
        with TorchStream(derive_seed(seed, "pretraining")):
            clean = _tensors(trained, windows, normalization, device)
            validation_tensors = None if validation is None else _tensors(trained, validation, normalization, device)
            epoch_data = partial(_epoch_tensors, trained, windows, clean, normalization, settings, seed)
            if trained.closed_form:
                data = _solution_tensors(trained, windows, clean, normalization, settings, seed)
                trained.solve(*data, derive_seed(seed, "weights"))
                history = (Epoch(1, *_scores(trained, clean), *_validation_scores(trained, validation_tensors)),)
            elif not history:
                trained.pretrain(epoch_data(0)[0], derive_seed(seed, "pretraining"))
        weights = _class_weights(windows, device) if settings.class_weights else None
        for number in () if trained.closed_form else range(len(history) + 1, settings.epochs + 1):
            for group in optimizer.param_groups:
                group["lr"] = settings.learning_rate_in(number)
            random = TorchStream(derive_seed(seed, "dropout", number))
            with random:
                data = epoch_data(number)
            loss, accuracy = _train_epoch(trained, optimizer, data, weights, settings, seed, number, random)
            with random:
                scores = _validation_scores(trained, validation_tensors)
            history += (Epoch(number, loss, accuracy, *scores),)
            if checkpoint is not None:
                save_checkpoint(Path(checkpoint), run, trained, optimizer, history)
            if progress is not None:
                progress(history[-1])
    return FittedClassifier(
        network=trained.cpu().eval(),
        classes=windows.classes,
        layout=windows.layout,
        normalization=normalization,
        settings=settings,
        seed=seed,
        history=history,
        manifest=used,
        pressures=distinct_values(windows.cell_pressure),
        speeds=distinct_values(windows.speed),
        training_reference=build_reference(windows, level_features(windows)),
    )


def _require_device(device: str) -> None:
    kind = device.partition(":")[0]
    if kind not in ("cpu", "cuda") or (kind == "cuda" and not torch.cuda.is_available()):
        usable = "cpu or cuda" if torch.cuda.is_available() else "cpu (this machine has no usable GPU)"
        raise InputError(f"device {device!r} cannot be used here; choose {usable}.")


def require_trainable(windows: WindowSet) -> None:
    """Raise a `DataError` where there is no window, one without a label, one class, a class without a window, or a
    sample that is far too large."""
    if len(windows) == 0:
        raise DataError("no window to train on.")
    windows.require_labels("training")
    windows.require_two_classes()
    counts = np.bincount(windows.target, minlength=len(windows.classes))
    if not counts.all():
        raise DataError(
            f"class {windows.classes[int(counts.argmin())]} has no training window; add measured or synthetic ones, or "
            "cut the windows without this class."
        )
    peak = np.maximum(windows.signal.max(axis=(1, 2)), -windows.signal.min(axis=(1, 2)))
    if not (peak < _LARGEST).all():
        index = int((~(peak < _LARGEST)).argmax())
        raise DataError(
            f"{windows.recording_id[index]}: samples reach {peak[index]:.3g} {windows.unit}, far too large to train "
            "on; cut them out or repair the file."
        )


def _require_fitting(network: Network, windows: WindowSet, validation: WindowSet | None) -> None:
    require_trainable(windows)
    if network.n_channels != windows.n_channels or network.n_classes != len(windows.classes):
        raise InputError(
            f"the network takes {network.n_channels} channel(s) and {network.n_classes} classes, the windows have "
            f"{windows.n_channels} and {len(windows.classes)}; build it for these windows."
        )
    length = network.settings.get("length", windows.length)
    if length != windows.length:
        raise InputError(f"the network is built for windows of {length} samples, these have {windows.length}.")
    if validation is None:
        return
    validation.require_labels("validation")
    if validation.classes != windows.classes:
        raise InputError("training and validation windows have other classes; cut the second like the first.")
    if difference := windows.layout.difference(validation.layout):
        raise InputError(f"training and validation windows differ: {difference}.")
    check_disjoint(windows, validation)


def _description(
    network: Network,
    windows: WindowSet,
    settings: TrainingSettings,
    seed: int,
    validation: WindowSet | None,
    manifest: Manifest,
    device: str,
) -> dict[str, Any]:
    """What makes a run this run and no other, in words and numbers that JSON can hold."""
    return {
        "network": network.name,
        **{f"network's {name}": value for name, value in network.settings.items()},
        **settings.to_dict(),
        "seed": seed,
        "device": device,
        "training data (SHA-256)": windows.fingerprint(),
        "validation data (SHA-256)": None if validation is None else validation.fingerprint(),
        "manifest": manifest,
    }


@contextmanager
def _deterministic_kernels(device: str, wanted: bool) -> Iterator[None]:
    """On a GPU kernels are chosen for the whole process; a CPU has no choice, and nothing is touched."""
    cudnn = torch.backends.cudnn
    before = cudnn.deterministic, cudnn.benchmark
    if wanted and device != "cpu":
        cudnn.deterministic, cudnn.benchmark = True, False
    try:
        yield
    finally:
        if wanted and device != "cpu":
            cudnn.deterministic, cudnn.benchmark = before


def _start(
    checkpoint: Path | None, resume: bool, run: dict[str, Any], network: Network, optimizer: torch.optim.Optimizer
) -> tuple[Epoch, ...]:
    if checkpoint is None:
        if resume:
            raise InputError("to resume needs a checkpoint, the file to continue from.", field="checkpoint")
        return ()
    if not Path(checkpoint).exists():
        return ()
    if not resume:
        raise InputError(f"{checkpoint} exists; resume it, or delete it to start again.", field="resume")
    return load_checkpoint(Path(checkpoint), run, network, optimizer)


def _epoch_tensors(
    network: Network,
    windows: WindowSet,
    clean: tuple[Tensor, Tensor],
    normalization: Normalization,
    settings: TrainingSettings,
    seed: int,
    number: int,
) -> tuple[Tensor, Tensor]:
    """What an epoch trains on: the windows as they are, or some of them changed, drawn by `seed` and `number`."""
    represented, target = clean
    which, changed = transform_windows(windows, settings, seed, number)
    if not len(which):
        return clean
    again, _ = _tensors(network, changed, normalization, str(represented.device))
    return represented.index_copy(0, torch.from_numpy(which).to(represented.device), again), target


def _solution_tensors(
    network: Network,
    windows: WindowSet,
    clean: tuple[Tensor, Tensor],
    normalization: Normalization,
    settings: TrainingSettings,
    seed: int,
) -> tuple[Tensor, Tensor]:
    """What a network is solved for on: the windows as they are, and those that each epoch would change."""
    passes = [clean]
    for number in range(1, settings.epochs + 1):
        which, changed = transform_windows(windows, settings, seed, number)
        if len(which):
            passes.append(_tensors(network, changed, normalization, str(clean[0].device)))
    represented, target = zip(*passes, strict=True)
    return torch.cat(represented), torch.cat(target)


def _tensors(network: Network, windows: WindowSet, normalization: Normalization, device: str) -> tuple[Tensor, Tensor]:
    """(windows as the network represents them, their classes)."""
    signal = torch.from_numpy(normalization.apply(windows))
    with torch.no_grad():
        turns = torch.from_numpy(windows.turns_per_sample)
        represented = torch.cat(
            [
                network.represent_at(batch.to(device), part.to(device))
                for batch, part in zip(signal.split(_BATCH), turns.split(_BATCH), strict=True)
            ]
        )
    return represented, torch.from_numpy(windows.target).to(device)


def _class_weights(windows: WindowSet, device: str) -> Tensor:
    counts = np.bincount(windows.target, minlength=len(windows.classes))
    return torch.tensor(len(windows) / (len(windows.classes) * counts), dtype=torch.float32, device=device)


def _train_epoch(
    network: Network,
    optimizer: torch.optim.Optimizer,
    data: tuple[Tensor, Tensor],
    weights: Tensor | None,
    settings: TrainingSettings,
    seed: int,
    number: int,
    random: TorchStream,
) -> tuple[float, float]:
    """(mean loss, accuracy) of one pass, in an order and with a dropout that only `seed` and `number` decide.

    Only the forward pass draws random numbers. The rest runs outside `random`, which costs time in each operation.
    """
    signal, target = data
    order = torch.from_numpy(stream(seed, "order", number).permutation(len(target))).to(signal.device)
    network.train()
    total, right = torch.zeros((), device=signal.device), torch.zeros((), device=signal.device)
    for batch in batches(order, settings.batch_size):
        classes = target[batch]
        short = settings.precision == "bfloat16"
        with random, torch.autocast(signal.device.type, torch.bfloat16, enabled=short):
            scores = network.head(network.encode(signal[batch]))
        loss = functional.cross_entropy(scores.float() if short else scores, classes, weight=weights)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        total += loss.detach() * len(batch)
        right += (scores.argmax(dim=1) == classes).sum()
    mean = float(total) / len(target)
    if not math.isfinite(mean):
        raise InputError(f"the loss is {mean} in epoch {number}; the learning rate is too high, or a sample too large.")
    return mean, float(right) / len(target)


def _validation_scores(network: Network, tensors: tuple[Tensor, Tensor] | None) -> tuple[float, float] | tuple[()]:
    """(mean loss, accuracy) on the validation windows, or nothing where there are none."""
    return () if tensors is None else _scores(network, tensors)


def _scores(network: Network, tensors: tuple[Tensor, Tensor]) -> tuple[float, float]:
    """(mean loss, accuracy) on windows."""
    network.eval()
    with torch.no_grad():
        scores = torch.cat([network.head(network.encode(batch)) for batch in tensors[0].split(_BATCH)])
    loss = functional.cross_entropy(scores, tensors[1])
    return float(loss), float((scores.argmax(dim=1) == tensors[1]).float().mean())
