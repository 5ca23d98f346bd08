"""Classifiers of the studies by name: which network or baseline, with which settings, trained how.

What BiTCN is by default stands here and nowhere else.
"""

import difflib
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError, InputError, derive_seed
from swashtwin.learning import (
    BASELINES,
    BUDGET,
    CANDIDATES,
    NETWORKS,
    PAPER_TRAINING,
    RECOMMENDED_TRAINING,
    Classifier,
    Epoch,
    FeatureTable,
    TrainingSettings,
    WindowSet,
    build_network,
    extract_features,
    fit,
    fit_baseline,
    fit_chosen,
)
from swashtwin_bench.rivals.ablations import ABLATIONS
from swashtwin_bench.rivals.composed import Ensemble, NetworkOnView, first_sensors
from swashtwin_bench.rivals.graphs import GRAPHS
from swashtwin_bench.rivals.order_threshold import rising_orders, threshold_orders


@dataclass(frozen=True)
class Model:
    """A classifier before it was trained."""

    kind: str
    """Name in `NETWORKS` or `BASELINES`, `CHOSEN`, or `THRESHOLD`."""
    network: Mapping[str, Any] = field(default_factory=dict)
    """Settings of a network that differ from its own defaults."""
    training: TrainingSettings = field(default_factory=TrainingSettings)
    """How a network is trained."""
    trainings: int = 1
    """Trainings of a network, by seeds of their own, whose probabilities are averaged."""
    sensors: int | None = None
    """How many of the recordings' sensors a network is given, the first ones; all by default."""

    @property
    def is_network(self) -> bool:
        """Whether it is trained in epochs; a single training has a loss curve, and features to embed."""
        return self.kind in NETWORKS

    def describe(self) -> dict[str, Any]:
        """Settings as JSON can hold them, a network's own defaults among them. One training on all sensors is the
        default and is left out, so that finished runs of earlier versions keep their keys."""
        if self.kind == THRESHOLD:
            return {"kind": self.kind, "bands": _BANDS, "quantile": _HEALTHY}
        if self.kind == CHOSEN:
            return {"kind": self.kind, "candidates": [repr(candidate) for candidate in CANDIDATES], "budget": BUDGET}
        if not self.is_network:
            estimator = re.sub(r"\s+", " ", repr(BASELINES[self.kind].estimator(0)))
            return {"kind": self.kind, "estimator": re.sub(r" at 0x[0-9a-f]+", "", estimator)}
        settings = build_network(self.kind, 1, 2, **self.network).settings
        network = {name: value for name, value in settings.items() if name not in ("n_channels", "n_classes")}
        composed = {"trainings": self.trainings} if self.trainings > 1 else {}
        composed |= {"sensors": self.sensors} if self.sensors is not None else {}
        return {"kind": self.kind, "network": network, "training": self.training.to_dict(), **composed}

    def with_training(self, **changes: Any) -> "Model":
        """The same with other training settings."""
        return replace(self, training=replace(self.training, **changes))


THRESHOLD = "envelope_threshold"
"""The rule that learns no more than which bands of the envelope's spectrum rise, and how far healthy ones do. It stands
for a threshold at known orders, which windows of one revolution do not resolve."""

CHOSEN = "chosen"
"""What training chooses where nothing is set (`fit_chosen`)."""

_BANDS, _HEALTHY = 6, 0.99  # that rise with a class; share of the healthy windows that stay below

DEFAULT = "spectral_bitcn"
"""The network that studies train where they do not compare networks: ours."""

BITCN: Mapping[str, Any] = {"stride": 16, "channels": (32,) * 6}
"""Settings of the paper's BiTCN and its ablations in every size: an entry that takes patches of 16 samples, units of
32 features. At full rate one training of the paper costs 8 hours of CPU (docs/explanation/networks.md)."""

TRAINING: Mapping[str, TrainingSettings] = {
    "quick": replace(RECOMMENDED_TRAINING, epochs=12),
    "paper": RECOMMENDED_TRAINING,
}
"""How every network is trained, by size. Both scale by the training set's deviation, so that the level, which a
condition changes, is kept."""

ABLATED: Mapping[str, Mapping[str, Any]] = {
    "spectral_ordinary": {"causal": False},
    "spectral_no_attention": {"attention": False},
    "spectral_forward": {"bidirectional": False},
    "spectral_no_frames": {"parts": ("lines", "envelope")},
    "spectral_no_lines": {"parts": ("frames", "envelope")},
    "spectral_no_envelope": {"parts": ("frames", "lines")},
    "spectral_frames_only": {"parts": ("frames",)},
    "spectral_no_noise": {"noise": 0.0},
}
"""Our network without one of its parts: first the paper's three ablations, then those of what it is given."""

RETRAINED: Mapping[str, Callable[[TrainingSettings], TrainingSettings]] = {
    "spectral_window": lambda training: replace(training, normalization="window"),
    "spectral_recording": lambda training: replace(training, normalization="recording"),
    "spectral_longer": lambda training: replace(training, epochs=2 * training.epochs),
    "spectral_gain": lambda training: replace(training, gain=3.0),
    "spectral_stretch": lambda training: replace(training, stretch=0.02),
    "spectral_noise": lambda training: replace(training, noise_snr=0.0, epochs=2 * training.epochs),
}
"""Our network trained otherwise: every window, or every recording, scaled by itself; in twice the epochs; with other
gains, other speeds, new in each epoch, on half the windows; and in twice the epochs with noise down to 0 dB."""

COMPOSED: Mapping[str, Mapping[str, Any]] = {
    "spectral_ensemble": {"trainings": 3},
    "spectral_one_sensor": {"sensors": 1},
}
"""Our network trained three times over, and given the first sensor alone."""

VARIED = (*ABLATED, *RETRAINED, *COMPOSED)
"""Every way in which our network is another in the ablation."""

PAPERS_OWN = Model("bitcn", {}, PAPER_TRAINING)
"""The paper's own recipe: full rate, 200 epochs, every window scaled by itself; hours of CPU."""


def _models(size: str) -> dict[str, Model]:
    names = dict.fromkeys([*NETWORKS, *(rival.name for rival in (*ABLATIONS, *GRAPHS))])
    networks = {name: Model(name, BITCN if name.startswith("bitcn") else {}, TRAINING[size]) for name in names}
    ablated = {name: Model(DEFAULT, settings, TRAINING[size]) for name, settings in ABLATED.items()}
    retrained = {name: Model(DEFAULT, {}, change(TRAINING[size])) for name, change in RETRAINED.items()}
    composed = {name: Model(DEFAULT, {}, TRAINING[size], **settings) for name, settings in COMPOSED.items()}
    baselines = {name: Model(name) for name in BASELINES}
    return {
        **networks,
        **ablated,
        **retrained,
        **composed,
        "bitcn_paper": PAPERS_OWN,
        CHOSEN: Model(CHOSEN),
        **baselines,
        THRESHOLD: Model(THRESHOLD),
    }


MODELS: dict[str, dict[str, Model]] = {size: _models(size) for size in TRAINING}
"""Models by size and name: every network and every baseline, our network without one of its parts or trained
otherwise, ``bitcn_paper``, the paper's own recipe, ``chosen``, what a user gets who sets nothing, and the
threshold."""


def models_of(size: str, names: Iterable[str]) -> dict[str, Model]:
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
            usual = [name for name in models if name not in VARIED]
            raise InputError(
                f"no model is called {name!r}; {hint} are {', '.join(usual)}, and of the ablation {', '.join(VARIED)}."
            )
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
) -> Classifier:
    """The model, trained.

    Parameters
    ----------
    train : training windows, measured and synthetic.
    seed : seed of weights, order and trees.
    manifest : recordings that had a part without standing in `train`.
    device : where a network is trained; baselines take the CPU.
    checkpoint : file that a network trained once saves to after each epoch and goes on from; deleted at the end.
    progress : called after each epoch of a network.
    """
    if model.kind == THRESHOLD:
        return _threshold(train, manifest)
    if model.kind == CHOSEN:
        return fit_chosen(train, manifest=manifest, seed=seed)
    if not model.is_network:
        return fit_baseline(model.kind, train, seed=seed, manifest=manifest)
    view = None if model.sensors is None else partial(first_sensors, count=model.sensors)
    heard = train if view is None else view(train)
    network = build_network(model.kind, heard.n_channels, len(heard.classes), **model.network)
    seeds = (seed, *(derive_seed(seed, "training", number) for number in range(1, model.trainings)))
    used, path = tuple(manifest), checkpoint if model.trainings == 1 else None
    fitted = [
        fit(
            network,
            heard,
            settings=model.training,
            seed=seed,
            manifest=used,
            device=device,
            checkpoint=path,
            resume=path is not None,
            progress=progress,
        )
        for seed in seeds
    ]
    if path is not None:
        path.unlink(missing_ok=True)
    members = fitted if view is None else [NetworkOnView(classifier, view) for classifier in fitted]
    return members[0] if model.trainings == 1 else Ensemble(tuple(members))


def _threshold(train: WindowSet, manifest: Iterable[str]) -> Classifier:
    """Threshold on the bands of the envelope's spectrum.

    Which bands rise with a class is read off the training windows, how far they may off the healthy measured ones.
    Bands and no orders, for a window of a little more than one revolution does not tell orders apart.
    """
    if not np.any((train.label == "normal") & ~train.synthetic):
        raise DataError("a threshold needs measured windows of normal; there are none to train on.")
    rule = rising_orders(_envelope_bands(train), train, columns=_BANDS)
    used = (*train.recording_id.tolist(), *manifest)
    return threshold_orders(train, _envelope_bands, rule, quantile=_HEALTHY, manifest=used)


def _envelope_bands(windows: WindowSet) -> FeatureTable:
    table = extract_features(windows)
    columns = [index for index, name in enumerate(table.names) if " envelope spectrum " in name]
    return FeatureTable(table.values[:, columns], tuple(table.names[index] for index in columns))
