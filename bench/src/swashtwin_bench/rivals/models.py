"""Classifiers of the studies by name: kind, settings and training."""

import difflib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from swashtwin.foundation import InputError
from swashtwin.learning import (
    CANDIDATES,
    DISTURBED_TRAINING,
    NETWORKS,
    RECOMMENDED_TRAINING,
    Epoch,
    FittedClassifier,
    TrainingSettings,
    WindowSet,
    build_network,
    fit,
    fit_best_candidate,
)
from swashtwin_bench.rivals.baselines import ON_FEATURES, UNSCALED


@dataclass(frozen=True)
class Model:
    """An untrained classifier."""

    kind: str
    """Name in `NETWORKS`, or `BEST_CANDIDATE`."""
    network: Mapping[str, Any] = field(default_factory=dict)
    """Settings of a network that differ from its defaults."""
    training: TrainingSettings = field(default_factory=TrainingSettings)
    """Training settings of a network."""

    @property
    def is_network(self) -> bool:
        """Whether it is trained in epochs: then it has a loss curve, and features to embed."""
        return self.kind in NETWORKS and self.kind not in ON_FEATURES

    def describe(self) -> dict[str, Any]:
        """Return all settings, including defaults of the network, as JSON can hold them."""
        if self.kind == BEST_CANDIDATE:
            return {
                "kind": self.kind,
                "candidates": [repr(candidate) for candidate in CANDIDATES],
                "training": DISTURBED_TRAINING.to_dict(),
            }

        # The numbers of channels and classes are those of the data; here any will do.
        settings = build_network(self.kind, 1, 2, **self.network).settings
        network = {
            name: value
            for name, value in settings.items()
            if name not in ("n_channels", "n_classes")
        }
        return {"kind": self.kind, "network": network, "training": self.training.to_dict()}

    def with_training(self, **changes: Any) -> "Model":
        """Return the model with other training settings."""
        return replace(self, training=replace(self.training, **changes))


BEST_CANDIDATE = "chosen"
"""Name of the default training, which selects among candidates (`fit_best_candidate`)."""

OWN_NETWORK = "spectral_bitcn"
"""Our network, which studies train unless they compare networks."""

BITCN: Mapping[str, Any] = {"stride": 16, "channels": (32,) * 6}
"""Settings of the paper's BiTCN in every size: patches of 16 samples, units of 32 features.

At the full rate one training of the paper takes 8 hours of CPU time (docs/explanation/networks.md).
"""

TRAINING: Mapping[str, TrainingSettings] = {
    "quick": replace(RECOMMENDED_TRAINING, epochs=12),
    "medium": RECOMMENDED_TRAINING,
    "paper": RECOMMENDED_TRAINING,
}
"""Training of all networks by size.

Windows are scaled by the standard deviation of the training set, so that their amplitude, which
depends on the operating point, is kept.
"""

NOISY = "spectral_noise"
"""Our network trained with noise on half the windows, down to 0 dB and new in each epoch.

It has twice as many epochs.
"""


def _build_models(size: str) -> dict[str, Model]:
    training = TRAINING[size]
    noisy_training = replace(training, noise_snr=0.0, epochs=2 * training.epochs)

    models = {}
    for name in NETWORKS:
        if name not in ON_FEATURES:
            models[name] = Model(name, BITCN if name == "bitcn" else {}, training)
    models[NOISY] = Model(OWN_NETWORK, {}, noisy_training)
    models[BEST_CANDIDATE] = Model(BEST_CANDIDATE)
    for name in ON_FEATURES:
        models[name] = Model(name, {}, UNSCALED)

    return models


MODELS: dict[str, dict[str, Model]] = {size: _build_models(size) for size in TRAINING}
"""Models by size and name: all networks, ours with noise, and the default training ``chosen``."""


def select_models(size: str, names: Iterable[str]) -> dict[str, Model]:
    """Return models of a size by name.

    Raises
    ------
    InputError
        A name does not exist.
    """
    models = MODELS[size]

    selected = {}
    for name in names:
        if name not in models:
            suggestions = difflib.get_close_matches(name.lower(), models, n=1, cutoff=0.3)
            hint = f"Did you mean {suggestions[0]!r}? " if suggestions else ""
            raise InputError(
                f"Unknown classifier {name!r}. {hint}Must be one of {', '.join(models)}."
            )
        selected[name] = models[name]

    return selected


def train_model(
    model: Model,
    train: WindowSet,
    *,
    seed: int,
    manifest: Iterable[str] = (),
    device: str = "cpu",
    checkpoint: Path | None = None,
    progress: Callable[[Epoch], None] | None = None,
) -> FittedClassifier:
    """Train a model.

    Parameters
    ----------
    train : training windows, measured and synthetic.
    seed : seed of weights, order and trees.
    manifest : further recordings that contributed to the training windows.
    device : device of a network; models on features use the CPU.
    checkpoint : file to which a network is saved after each epoch, and from which an interrupted
        training continues; it is deleted at the end.
    progress : called after each epoch of a network.
    """
    if model.kind == BEST_CANDIDATE:
        return fit_best_candidate(train, manifest=manifest, seed=seed)

    network = build_network(model.kind, train.n_channels, len(train.classes), **model.network)
    classifier = fit(
        network,
        train,
        settings=model.training,
        seed=seed,
        manifest=manifest,
        device=device if model.is_network else "cpu",
        checkpoint=checkpoint,
        resume=checkpoint is not None,
        progress=progress,
    )
    if checkpoint is not None:
        checkpoint.unlink(missing_ok=True)
    return classifier
