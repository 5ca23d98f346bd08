"""A fitted classifier as a file: an artifact whose card names the network and holds its weights."""

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
    NETWORKS,
    FittedClassifier,
    TrainedState,
    network_class,
    rebuild_network,
)

KIND = "classifier"
"""Kind of the artifact."""
VERSION = 12
VERSION_WITHOUT_MACHINES = 11
"""Version whose confidences rest on recordings of one machine, if machines were held out."""
_MAY_BE_NAN = (
    "training_reference.condition",
    "recordings.healthy.condition",
    "resemblance.prior.band_powers",
    "resemblance.prior.point_speed",
    "resemblance.prior.point_pressure",
)

# Values that a network's setting may always have, whatever the size of its weights.
_MIN_SETTING_LIMIT = 1 << 16

# Entries of a list among a network's settings, such as one for each layer.
_MAX_LIST_ENTRIES = 256

# Length of text from the file in a message.
_MAX_NAME_CHARACTERS = 60


@dataclass(frozen=True)
class _Network:
    """Name, settings and weights from which a network is built again."""

    name: str
    settings: dict[str, Any]
    weights: dict[str, np.ndarray]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Card(TrainedState):
    """A `FittedClassifier` with its network by name, and what a `FaultClassifier` adds."""

    network: _Network
    resemblance: Resemblance | None
    group: str | dict[str, str]


def _fields_but_network(state: TrainedState) -> dict[str, Any]:
    """Return what a `FittedClassifier` and its card have in common, by name."""
    return {
        field.name: getattr(state, field.name)
        for field in fields(TrainedState)
        if field.name != "network"
    }


def save_classifier(
    classifier: FittedClassifier,
    path: Path | str,
    resemblance: Resemblance | None = None,
    group: str | Mapping[str, str] = "recording",
) -> Path:
    """Write a classifier to `path` as a complete file and return the path.

    Parameters
    ----------
    resemblance : the pump prior for faults that the classifier was not trained on.
    group : what its splits kept whole (`FaultClassifier`).

    Raises
    ------
    ArtifactError
        The network is not registered, so that it could not be built again from the file; or a
        weight is not finite.
    """
    network = classifier.network
    if network.name not in NETWORKS or network_class(network.name) is not type(network):
        raise ArtifactError(
            f"The network {type(network).__name__} is not registered, so its file could not be "
            "loaded; register it first."
        )

    card = _Card(
        network=_Network(network.name, network.settings, network.weights),
        resemblance=resemblance,
        group=_saved_group(group),
        **_fields_but_network(classifier),
    )
    return save_artifact(path, KIND, VERSION, card, may_be_nan=_MAY_BE_NAN)


def _saved_group(group: str | Mapping[str, str]) -> str | dict[str, str]:
    """Return what splits keep whole, as text or as texts by recording id."""
    if isinstance(group, str):
        return group
    return {str(recording_id): str(name) for recording_id, name in group.items()}


def load_classifier(path: Path | str) -> FittedClassifier:
    """Return the classifier that `save_classifier` wrote, on the CPU, with the same predictions.

    Errors: see `load_model`.
    """
    return load_classifier_parts(path)[0]


def load_classifier_parts(
    path: Path | str,
) -> tuple[FittedClassifier, Resemblance | None, str | dict[str, str]]:
    """Return the classifier, the pump prior and the group that `save_classifier` wrote.

    Errors: see `load_model`.
    """
    advice = "swashtwin train, or its method save, writes a classifier"
    card = load_artifact(
        path,
        _Card,
        KIND,
        VERSION,
        advice=advice,
        may_be_nan=_MAY_BE_NAN,
        extensions={VERSION_WITHOUT_MACHINES: _add_machines},
    )
    name = card.network.name[:_MAX_NAME_CHARACTERS]

    with translate_load_errors(path, KIND, advice):
        try:
            network_class(name)
        except InputError as cause:
            raise ArtifactError(
                f"{path} has the network {name!r}, which is not registered here; register the same "
                "network before loading."
            ) from cause
        _require_plausible_settings(card.network, card.layout.length)
        network = rebuild_network(name, card.network.settings, card.network.weights)
        classifier = FittedClassifier(network=network, **_fields_but_network(card))
        return classifier, card.resemblance, card.group


def _add_machines(card: dict[str, Any]) -> dict[str, Any]:
    """Return a card of the version before with the entries that this one added."""
    extended = dict(card)
    for name in ("confidence", "baseline_confidence"):
        if isinstance(card.get(name), dict):
            extended[name] = {**card[name], "n_machines": 0}
    return extended


def _require_plausible_settings(network: _Network, window_length: int) -> None:
    """Raise a `ValueError` if settings require more weights than the file holds.

    An edited file could otherwise make the network take all memory before its weights are compared.
    """
    n_weights = sum(array.size for array in network.weights.values())
    limit = max(_MIN_SETTING_LIMIT, window_length, n_weights)

    for full_name, value in network.settings.items():
        name = full_name[:_MAX_NAME_CHARACTERS]
        entries = value if isinstance(value, list) else [value]
        if len(entries) > _MAX_LIST_ENTRIES:
            raise ValueError(f"the network's {name} has {len(entries)} entries")

        for entry in entries:
            if not isinstance(entry, (int, float, str)) and entry is not None:
                raise ValueError(f"the network's {name} is neither a number nor text")
            if isinstance(entry, (int, float)) and abs(entry) > limit:
                raise ValueError(
                    f"the network's {name} is {entry:.6g}, and the file holds up to {limit} values"
                )
