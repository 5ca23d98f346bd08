"""`fit`: from an untrained network and windows to a classifier."""

from collections.abc import Callable, Iterable
from itertools import chain
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Int

from swashtwin.foundation import DataError, InputError, one_thread
from swashtwin.learning.features import reference_features
from swashtwin.learning.networks.registry import AnyNetwork
from swashtwin.learning.networks.solved_network import SolvedNetwork
from swashtwin.learning.training.classifier import FittedClassifier, Normalization
from swashtwin.learning.training.settings import (
    PAPER_TRAINING,
    Epoch,
    TrainingSettings,
    transform_windows,
)
from swashtwin.learning.training.training_reference import build_reference
from swashtwin.learning.windows.window_set import WindowSet, distinct_values
from swashtwin.recordings import Manifest, join_manifests

RepresentedWindows = tuple[Float32[np.ndarray, "row value"], Int[np.ndarray, " row"]]
"""What a network sees of windows as they are and as each epoch changes them, and the window behind
each row.
"""
_LARGEST = 1e16
"""Magnitude of a sample from which the power of a window is no finite number in single
precision.
"""


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
    seen: RepresentedWindows | None = None,
) -> FittedClassifier:
    """Classifier trained on `windows`, as it stands after the last epoch.

    `network` gives the architecture only and stays as it is: a network of the same settings is
    trained, or solved for on the windows and those that each epoch would change. Same seed,
    windows, settings and machine: same bits. On the CPU it runs on one thread.

    Parameters
    ----------
    network : untrained network, such as ``BiTCN(train.n_channels, len(train.classes))``.
    windows : training windows with labels, measured and synthetic.
    settings : epochs, batch, learning rate, normalization; the paper's by default.
    seed : seed of weights, order and dropout.
    manifest : further recordings, as a manifest or by their ids, that had a part in the training
        windows, such as those a twin was calibrated on. They join the training recordings in the
        classifier's manifest, which no test set may meet.
    checkpoint : file that the run is saved to after each epoch, where there are epochs.
    resume : continue from `checkpoint` if it exists; the result has the same bits as a run without
        interruption.
    progress : called after each epoch.
    device : ``"cpu"`` or a GPU such as ``"cuda"``; the classifier comes back on the CPU.
    seen : what a network that is solved for sees of these windows and settings, where it is at
        hand.

    Raises
    ------
    DataError
        A class has no window, or a window has no label.
    InputError
        Network and windows do not fit, the loss ran away, or the checkpoint is of another run.
    """
    _require_fitting(network, windows)
    used = join_manifests([windows.sources, manifest])
    normalization = Normalization.fit(settings.normalization, windows)
    trained: AnyNetwork
    if isinstance(network, SolvedNetwork):
        if device != "cpu":
            raise InputError(
                f"device {device!r}: the network {network.name!r} is solved for on the cpu."
            )
        with one_thread():
            seen = seen or _seen(network, windows, normalization, settings, seed)
            trained, history = _solved(network, windows, seen, seed)
    else:
        from swashtwin.learning.training.loop import train_epochs

        run = {
            "network": network.name,
            **{f"network's {name}": value for name, value in network.settings.items()},
            **settings.to_dict(),
            "seed": seed,
            "device": device,
            "training data (SHA-256)": windows.fingerprint(),
            "manifest": used,
        }
        trained, history = train_epochs(
            network,
            windows,
            normalization,
            settings,
            seed,
            run,
            checkpoint,
            resume,
            progress,
            device,
        )
    return FittedClassifier(
        network=trained,
        classes=windows.classes,
        layout=windows.layout,
        normalization=normalization,
        settings=settings,
        seed=seed,
        history=history,
        manifest=used,
        pressures=distinct_values(windows.cell_pressure),
        speeds=distinct_values(windows.speed),
        training_reference=build_reference(windows, reference_features(windows)),
    )


def _seen(
    network: SolvedNetwork,
    windows: WindowSet,
    normalization: Normalization,
    settings: TrainingSettings,
    seed: int,
) -> RepresentedWindows:
    values, rows, clean = list[np.ndarray](), list[np.ndarray](), (np.arange(len(windows)), windows)
    changed = (
        transform_windows(windows, settings, seed, number + 1) for number in range(settings.epochs)
    )
    for which, part in chain([clean], changed):
        values += [network.represent_at(*block) for block in normalization.blocks(part)]
        rows.append(which)
    return np.concatenate(values), np.concatenate(rows)


def _solved(
    network: SolvedNetwork, windows: WindowSet, seen: RepresentedWindows, seed: int
) -> tuple[SolvedNetwork, tuple[Epoch, ...]]:
    """(the network with weights from what it sees of the windows, how it fares)."""
    solved = type(network)(**network.settings)
    solved.solve(seen[0], windows.target[seen[1]], seed)
    scores = solved.scores(seen[0][: len(windows)])
    loss = -scores[np.arange(len(scores)), windows.target].mean()
    accuracy = (scores.argmax(axis=1) == windows.target).mean()
    return solved, (Epoch(1, float(loss), float(accuracy)),)


def require_trainable(windows: WindowSet) -> None:
    """Raise a `DataError` where there is no window, one without a label, one class, a class without
    a window, or a sample that is far too large.
    """
    windows.require_any("to train on")
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


def _require_fitting(network: AnyNetwork, windows: WindowSet) -> None:
    require_trainable(windows)
    if network.n_channels != windows.n_channels or network.n_classes != len(windows.classes):
        raise InputError(
            f"the network takes {network.n_channels} channel(s) and {network.n_classes} classes, the windows have "
            f"{windows.n_channels} and {len(windows.classes)}; build it for these windows."
        )
    length = network.settings.get("length", windows.length)
    if length != windows.length:
        raise InputError(
            f"the network is built for windows of {length} samples, these have {windows.length}."
        )
