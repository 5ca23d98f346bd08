"""Fit an untrained network to windows."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Int

from swashtwin.foundation import DataError, InputError, one_thread
from swashtwin.learning.features import reference_features
from swashtwin.learning.networks.registry import AnyNetwork
from swashtwin.learning.networks.solved_network import SolvedNetwork
from swashtwin.learning.training.classifier import FittedClassifier, Normalization
from swashtwin.learning.training.training_reference import build_reference
from swashtwin.learning.training.training_settings import (
    PAPER_TRAINING,
    Epoch,
    TrainingSettings,
    transform_windows,
)
from swashtwin.learning.windows.window_set import WindowSet, distinct_values
from swashtwin.recordings import Manifest, join_manifests


@dataclass(frozen=True, eq=False)
class RepresentedWindows:
    """Windows as a solved network sees them: first the originals, then those of each epoch."""

    values: Float32[np.ndarray, "row value"]
    rows: Int[np.ndarray, " row"]
    """Index of the window behind each row of `values`."""


# Magnitude of a sample from which the power of a window is not finite in single precision.
_MAX_SAMPLE = 1e16


def fit(
    network: AnyNetwork,
    windows: WindowSet,
    *,
    settings: TrainingSettings = PAPER_TRAINING,
    seed: int = 0,
    manifest: Manifest | Iterable[str] = (),
    checkpoint: Path | None = None,
    resume: bool = False,
    progress: Callable[[Epoch], None] | None = None,
    device: str = "cpu",
    represented: RepresentedWindows | None = None,
) -> FittedClassifier:
    """Train a network on `windows`; the classifier is the state after the last epoch.

    `network` gives the architecture only and is not changed: a network of the same settings is
    trained, or solved for on the windows and those that each epoch would change. The same seed,
    windows, settings and machine give the same bits. On the CPU it runs on one thread.

    Parameters
    ----------
    network : untrained network, such as ``BiTCN(train.n_channels, len(train.classes))``.
    windows : training windows with labels, measured and synthetic.
    settings : epochs, batch, learning rate, normalization; the paper's by default.
    seed : seed of weights, order and dropout.
    manifest : further recordings, as a manifest or by their ids, that had a part in the training
        windows, such as those a twin was calibrated on. They join the training recordings in the
        classifier's manifest, which no test set may meet.
    checkpoint : file that the run is saved to after each epoch, if there are epochs.
    resume : continue from `checkpoint` if it exists; the result has the same bits as a run without
        interruption.
    progress : called after each epoch.
    device : ``"cpu"`` or a GPU such as ``"cuda"``; the classifier comes back on the CPU.
    represented : the windows as a solved network sees them under these settings, if known.

    Raises
    ------
    DataError
        A class has no window, or a window has no label.
    InputError
        Network and windows do not fit, the loss diverged, or the checkpoint is of another run.
    """
    _require_fitting(network, windows)
    full_manifest = join_manifests([windows.sources, manifest])
    normalization = Normalization.fit(settings.normalization, windows)
    trained: AnyNetwork
    if isinstance(network, SolvedNetwork):
        if device != "cpu":
            raise InputError(
                f"The network {network.name!r} is solved for on the CPU, not on {device!r}.",
                field="device",
                remedy="Set {device='cpu'}.",
            )
        with one_thread():
            if represented is None:
                represented = _represent(network, windows, normalization, settings, seed)
            trained, history = _solve(network, windows, represented, seed)
    else:
        # torch takes long to import, and solved networks do not need it.
        from swashtwin.learning.training.loop import TrainingRun, train_epochs

        run = TrainingRun(network, windows, normalization, settings, seed, full_manifest, device)
        trained, history = train_epochs(
            run, checkpoint=checkpoint, resume=resume, progress=progress
        )

    return FittedClassifier(
        network=trained,
        classes=windows.classes,
        layout=windows.layout,
        normalization=normalization,
        settings=settings,
        seed=seed,
        history=history,
        manifest=full_manifest,
        pressures=distinct_values(windows.cell_pressure),
        speeds=distinct_values(windows.speed),
        training_reference=build_reference(windows, reference_features(windows)),
        choice=None,
        fault_of={},
        confidence=None,
        recordings=None,
        baseline_confidence=None,
    )


def _represent(
    network: SolvedNetwork,
    windows: WindowSet,
    normalization: Normalization,
    settings: TrainingSettings,
    seed: int,
) -> RepresentedWindows:
    """Return the windows, and those that each epoch changes, as a network sees them."""
    values: list[np.ndarray] = []
    rows = [np.arange(len(windows))]

    def append_values(part: WindowSet) -> None:
        values.extend(network.represent_at(*block) for block in normalization.blocks(part))

    append_values(windows)
    for number in range(settings.epochs):
        epoch_rows, changed = transform_windows(windows, settings, seed, number + 1)
        append_values(changed)
        rows.append(epoch_rows)
    return RepresentedWindows(np.concatenate(values), np.concatenate(rows))


def _solve(
    network: SolvedNetwork, windows: WindowSet, represented: RepresentedWindows, seed: int
) -> tuple[SolvedNetwork, tuple[Epoch, ...]]:
    """Return the solved network, and its loss and accuracy on the original windows."""
    solved = type(network)(**network.settings)
    solved.solve(represented.values, windows.target[represented.rows], seed)

    scores = solved.scores(represented.values[: len(windows)])
    loss = -scores[np.arange(len(scores)), windows.target].mean()
    accuracy = (scores.argmax(axis=1) == windows.target).mean()
    return solved, (Epoch(1, float(loss), float(accuracy)),)


def require_trainable(windows: WindowSet) -> None:
    """Require windows that a classifier can be trained on.

    Raises
    ------
    DataError
        There is no window, one without a label, only one class, a class without a window, or a
        sample that is far too large.
    """
    windows.require_any("to train on")
    windows.require_labels("training")
    windows.require_two_classes()
    counts = np.bincount(windows.target, minlength=len(windows.classes))
    if not counts.all():
        raise DataError(
            f"The class {windows.classes[int(counts.argmin())]} has no training window. Add "
            "measured or synthetic ones, or cut the windows without this class."
        )

    peak = np.maximum(windows.signal.max(axis=(1, 2)), -windows.signal.min(axis=(1, 2)))
    is_too_large = ~(peak < _MAX_SAMPLE)  # written so that NaN is too large
    if is_too_large.any():
        row = int(is_too_large.argmax())
        raise DataError(
            f"{windows.recording_id[row]}: samples reach {peak[row]:.3g} {windows.unit}, which is "
            "far too large to train on. Cut them out or repair the file."
        )


def _require_fitting(network: AnyNetwork, windows: WindowSet) -> None:
    """Require windows that can be trained on and fit the network."""
    require_trainable(windows)
    n_classes = len(windows.classes)
    if network.n_channels != windows.n_channels or network.n_classes != n_classes:
        raise InputError(
            f"The network takes {network.n_channels} channel(s) and {network.n_classes} classes, "
            f"the windows have {windows.n_channels} and {n_classes}. Build it for these windows."
        )
    length = network.settings.get("length", windows.length)
    if length != windows.length:
        raise InputError(
            f"The network is built for windows of {length} samples, these have {windows.length}."
        )
