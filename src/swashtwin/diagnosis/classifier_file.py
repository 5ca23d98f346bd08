"""Saved models of every kind, and a classifier as an artifact: a card of its dataclasses, with its
weights beside.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.diagnosis.resemblance import Resemblance
from swashtwin.foundation import (
    ArtifactError,
    InputError,
    load_artifact,
    save_artifact,
    translate_load_errors,
)
from swashtwin.learning import (
    N_FACTS,
    NETWORKS,
    Choice,
    Confidence,
    Epoch,
    FittedClassifier,
    Normalization,
    RecordingModel,
    TrainingReference,
    TrainingSettings,
    WindowLayout,
    network_class,
    rebuild_network,
)
from swashtwin.recordings import Manifest

KIND, _VERSION = "classifier", 9
_MAY_BE_NAN = (
    "training_reference.condition", "recordings.healthy.condition",
    *(f"resemblance.prior.{name}" for name in ("band_powers", "point_speed", "point_pressure")),
)  # fmt: skip
_USUAL_SIZE, _MOST_LAYERS = 1 << 16, 256
"""A setting of a network may be as large as this, or as its weights or the window are; and lists as
long.
"""


@dataclass(frozen=True)
class _Network:
    """What builds a network again."""

    name: str
    settings: dict[str, Any]
    weights: dict[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class _Card:
    """A `FittedClassifier`, its network by name."""

    network: _Network
    classes: tuple[str, ...]
    layout: WindowLayout
    normalization: Normalization
    settings: TrainingSettings
    seed: int
    history: tuple[Epoch, ...]
    manifest: Manifest
    pressures: tuple[float, ...]
    speeds: tuple[float, ...]
    training_reference: TrainingReference | None
    choice: Choice | None
    fault_of: Mapping[str, str]
    confidence: Confidence | None
    recordings: RecordingModel | None
    baseline_confidence: Confidence | None
    resemblance: Resemblance | None

    def __post_init__(self) -> None:
        n_channels, n_classes = len(self.layout.channels), len(self.classes)
        if not n_classes or len(set(self.classes)) < n_classes:
            raise ValueError("its classes are none, or one of them twice")
        if self.layout.length < 2 or not self.layout.sample_rate > 0 or not n_channels:
            raise ValueError(
                "its windows have a length below 2, no positive sample rate, or no channel"
            )
        sizes = self.network.settings.get("n_channels"), self.network.settings.get("n_classes")
        if sizes != (n_channels, n_classes) or bool in map(type, sizes):
            raise ValueError(
                f"its network is not for {n_channels} channel(s) and {n_classes} classes"
            )
        if not self.normalization.mean.shape == self.normalization.deviation.shape == (n_channels,):
            raise ValueError(
                f"its normalization has not one value for each of {n_channels} channel(s)"
            )
        if self.training_reference is not None and self.training_reference.facts.shape[1:] != (
            n_channels,
            N_FACTS,
        ):
            raise ValueError("its training reference has other channels or facts")
        for confidence in (self.confidence, self.baseline_confidence):
            if (
                confidence
                and not ((confidence.target >= 0) & (confidence.target < n_classes)).all()
            ):
                raise ValueError("confidence.target holds no indexes of the classes")
        if self.recordings is not None:
            self.recordings.require_sizes(n_channels, n_classes)


_SAME = tuple(item.name for item in fields(_Card) if item.name not in ("network", "resemblance"))


def save_classifier(
    classifier: FittedClassifier, path: Path | str, resemblance: Resemblance | None = None
) -> Path:
    """`path`, after the classifier was written to it whole, with what a prior says of faults it was
    not trained on.

    Raises
    ------
    ArtifactError
        The network is not registered, so that nobody could build it again from the file; or a
        weight is not finite.
    """
    network = classifier.network
    if network.name not in NETWORKS or network_class(network.name) is not type(network):
        raise ArtifactError(
            f"the network {type(network).__name__} is not registered, so its file could not be loaded; register it "
            "first."
        )
    named = _Network(network.name, network.settings, network.weights)
    card = _Card(
        named, **{name: getattr(classifier, name) for name in _SAME}, resemblance=resemblance
    )
    return save_artifact(path, KIND, _VERSION, card, may_be_nan=_MAY_BE_NAN)


def load_classifier(path: Path | str) -> FittedClassifier:
    """The classifier that `save_classifier` wrote, on the CPU; its predictions are those of the one
    saved.

    Errors: `load_model`.
    """
    return load_both(path)[0]


def load_both(path: Path | str) -> tuple[FittedClassifier, Resemblance | None]:
    """(the classifier, what a prior says of faults that it was not trained on); errors:
    `load_classifier`.
    """
    advice = "swashtwin train, or its method save, writes a classifier"
    card = load_artifact(path, _Card, KIND, _VERSION, advice=advice, may_be_nan=_MAY_BE_NAN)
    name = card.network.name[:60]
    with translate_load_errors(path, KIND):
        try:
            network_class(name)
        except InputError as cause:
            raise ArtifactError(
                f"{path} has the network {name!r}, which is not registered here; register the same "
                "network before loading."
            ) from cause
        _require_size(card.network, card.layout.length)
        network = rebuild_network(name, card.network.settings, card.network.weights)
        return FittedClassifier(
            network, **{name: getattr(card, name) for name in _SAME}
        ), card.resemblance


def _require_size(network: _Network, length: int) -> None:
    """Refuse settings that ask for other weights than the file holds, before memory is taken for
    them.
    """
    weights = network.weights
    most = max(_USUAL_SIZE, length, sum(array.size for array in weights.values()))
    for name, value in network.settings.items():
        entries = value if isinstance(value, list) else [value]
        if len(entries) > _MOST_LAYERS:
            raise ValueError(f"the network's {name[:60]} has {len(entries)} entries")
        for entry in entries:
            if not isinstance(entry, (int, float, str)) and entry is not None:
                raise ValueError(f"the network's {name[:60]} is neither a number nor a text")
            if isinstance(entry, (int, float)) and abs(entry) > most:
                raise ValueError(
                    f"the network's {name[:60]} is {entry:.6g}, and the file holds {most} values at most"
                )
