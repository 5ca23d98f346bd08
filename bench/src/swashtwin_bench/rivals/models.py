"""Classifiers of the studies by name: which network, with which settings, trained how.

What BiTCN is by default stands here and nowhere else.
"""

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
    """A classifier before it was trained."""

    kind: str
    """Name in `NETWORKS`, or `BEST_CANDIDATE`."""
    network: Mapping[str, Any] = field(default_factory=dict)
    """Settings of a network that differ from its own defaults."""
    training: TrainingSettings = field(default_factory=TrainingSettings)
    """How a network is trained."""

    @property
    def is_network(self) -> bool:
        """Whether it is trained in epochs; a single training has a loss curve, and features to
        embed.
        """
        return self.kind in NETWORKS and self.kind not in ON_FEATURES

    def describe(self) -> dict[str, Any]:
        """Settings as JSON can hold them, a network's own defaults among them."""
        if self.kind == BEST_CANDIDATE:
            return {"kind": self.kind, "candidates": [repr(candidate) for candidate in CANDIDATES],
                    "training": DISTURBED_TRAINING.to_dict()}  # fmt: skip
        settings = build_network(self.kind, 1, 2, **self.network).settings
        network = {
            name: value
            for name, value in settings.items()
            if name not in ("n_channels", "n_classes")
        }
        return {"kind": self.kind, "network": network, "training": self.training.to_dict()}

    def with_training(self, **changes: Any) -> "Model":
        """The same with other training settings."""
        return replace(self, training=replace(self.training, **changes))


BEST_CANDIDATE = "chosen"
"""What training chooses where nothing is set (`fit_best_candidate`)."""

DEFAULT = "spectral_bitcn"
"""The network that studies train where they do not compare networks: ours."""

BITCN: Mapping[str, Any] = {"stride": 16, "channels": (32,) * 6}
"""Settings of the paper's BiTCN and its ablations in every size: an entry that takes patches of 16
samples, units of 32 features. At full rate one training of the paper costs 8 hours of CPU
(docs/explanation/networks.md).
"""

TRAINING: Mapping[str, TrainingSettings] = {
    "quick": replace(RECOMMENDED_TRAINING, epochs=12),
    "medium": RECOMMENDED_TRAINING,
    "paper": RECOMMENDED_TRAINING,
}
"""How every network is trained, by size. Both scale by the training set's deviation, so that the
level, which a condition changes, is kept.
"""


NOISY = "spectral_noise"
"""Our network trained in twice the epochs with noise down to 0 dB, new in each epoch, on half the
windows.
"""


def _models(size: str) -> dict[str, Model]:
    names = [name for name in NETWORKS if name not in ON_FEATURES]
    return {
        **{name: Model(name, BITCN if name == "bitcn" else {}, TRAINING[size]) for name in names},
        NOISY: Model(
            DEFAULT, {}, replace(TRAINING[size], noise_snr=0.0, epochs=2 * TRAINING[size].epochs)
        ),
        BEST_CANDIDATE: Model(BEST_CANDIDATE),
        **{name: Model(name, {}, UNSCALED) for name in ON_FEATURES},
    }


MODELS: dict[str, dict[str, Model]] = {size: _models(size) for size in TRAINING}
"""Models by size and name: every network, ours with noise, and ``chosen``, what a user gets who
sets nothing.
"""


def select_models(size: str, names: Iterable[str]) -> dict[str, Model]:
    """Models of a size by name.

    Raises
    ------
    InputError
        There is none of that name.
    """
    models = MODELS[size]
    for name in names:
        if name not in models:
            near = difflib.get_close_matches(name.lower(), models, n=1, cutoff=0.3)
            hint = f"did you mean {near[0]!r}? There" if near else "there"
            raise InputError(f"no model is called {name!r}; {hint} are {', '.join(models)}.")
    return {name: models[name] for name in names}


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
    """The model, trained.

    Parameters
    ----------
    train : training windows, measured and synthetic.
    seed : seed of weights, order and trees.
    manifest : recordings that had a part without standing in `train`.
    device : where a network is trained; those on features take the CPU.
    checkpoint : file that a network saves to after each epoch and goes on from; deleted at the end.
    progress : called after each epoch of a network.
    """
    if model.kind == BEST_CANDIDATE:
        return fit_best_candidate(train, manifest=manifest, seed=seed)
    classifier = fit(
        build_network(model.kind, train.n_channels, len(train.classes), **model.network),
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
