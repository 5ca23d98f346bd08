"""A fitted classifier as an artifact: its weights, and a card that holds everything else."""

from dataclasses import asdict, fields
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor, device, float32, float64, from_numpy, int64

from swashtwin.foundation import (
    ArtifactError,
    add_prefix,
    read_artifact,
    refuse_misfits,
    require_form,
    select_prefix,
    write_artifact,
)
from swashtwin.learning import (
    BUILT_IN,
    N_FACTS,
    NETWORKS,
    NORMALIZATIONS,
    Choice,
    Confidence,
    Epoch,
    FittedClassifier,
    Normalization,
    TrainingReference,
    TrainingSettings,
    WindowLayout,
    build_network,
    has_network,
)
from swashtwin.recordings import join_manifests

_KIND, _VERSION = "classifier", 4
_EPOCH = {
    "number": int, "loss": float, "accuracy": float,
    "validation_loss": (float, None), "validation_accuracy": (float, None),
}  # fmt: skip
_FORM: dict[str, Any] = {
    "network": {"name": str, "settings": dict},
    "classes": [str],
    "layout": {"sample_rate": float, "channels": [str], "unit": str, "length": int},
    "normalization": str,
    "settings": dict,
    "seed": int,
    "history": [_EPOCH],
    "manifest": {str: [str]},
    "pressures": [float],
    "speeds": [float],
    "choice": (
        {
            "chosen": str,
            "group": str,
            "n_folds": int,
            "n_windows": int,
            "reason": str,
            "trials": [
                {
                    "candidate": str,
                    "score": float,
                    "standard_error": float,
                    "clean": float,
                    "disturbed": float,
                    "is_tied": bool,
                }
            ],
        },
        None,
    ),
    "training_reference": (
        {"recording_id": [str], "label": [str], "specimen": [str], "distance_scales": [float]},
        None,
    ),
    "confidence": (
        {
            "temperature": float,
            "dependence": float,
            "listening_windows": [int],
            "error_rate": float,
            "cross_fitted": bool,
        },
        None,
    ),
}
"""Form of a card (`require_form`)."""
_REFERENCE_TENSORS = ("features", "facts", "condition")
"""Of a condition that is not stated the file holds 0."""
_CONFIDENCE_TENSORS = ("nonconformity_score", "target", "ood_score")
_USUAL_SIZE, _MOST_LAYERS = 1 << 16, 256
"""A setting of a network may be as large as this, or as its weights or the window are; and lists as long."""


def save_classifier(classifier: FittedClassifier, path: Path | str) -> Path:
    """`path`, after the classifier was written to it whole.

    Raises
    ------
    ArtifactError
        The network is not registered, so that nobody could build it again from the file; or a weight is not finite.
    """
    if NETWORKS.get(classifier.network.name) is not type(classifier.network):
        raise ArtifactError(
            f"the network {type(classifier.network).__name__} is not registered, so its file could not be loaded; use "
            "register_network first."
        )
    return write_artifact(path, _KIND, _VERSION, _card(classifier), _tensors(classifier))


def load_classifier(path: Path | str) -> FittedClassifier:
    """The classifier that `save_classifier` wrote, on the CPU; its predictions are those of the one saved.

    Raises
    ------
    MissingFileError
        There is no such file.
    ArtifactError
        The file is damaged, edited, no classifier, of another version, or its network is not registered.
    """
    advice = "a classifier is saved with save_classifier(classifier, path), or by swashtwin train"
    card, tensors = read_artifact(path, _KIND, _VERSION, advice=advice)
    with refuse_misfits(path, _KIND):
        require_form(card, _FORM, "card")
        name = card["network"]["name"][:60]
        if not has_network(name):
            raise ArtifactError(
                f"{path} has the network {name!r}, which is not registered here; call register_network({name!r}, ...) "
                "with the same network before loading."
            )
        return _classifier(card, tensors)


def _tensors(classifier: FittedClassifier) -> dict[str, Tensor]:
    tensors = add_prefix("network", classifier.network.state_dict())
    tensors["normalization.mean"] = from_numpy(classifier.normalization.mean)
    tensors["normalization.deviation"] = from_numpy(classifier.normalization.deviation)
    if classifier.training_reference is not None:
        for name in _REFERENCE_TENSORS:
            tensors[f"training_reference.{name}"] = from_numpy(
                np.nan_to_num(getattr(classifier.training_reference, name))
            )
    if classifier.confidence is not None:
        for name in _CONFIDENCE_TENSORS:
            tensors[f"confidence.{name}"] = from_numpy(getattr(classifier.confidence, name))
    return tensors


def _card(classifier: FittedClassifier) -> dict[str, Any]:
    reference, confidence = classifier.training_reference, classifier.confidence
    return {
        "network": {"name": classifier.network.name, "settings": classifier.network.settings},
        "classes": classifier.classes,
        "layout": asdict(classifier.layout),
        "normalization": classifier.normalization.kind,
        "settings": classifier.settings.to_dict(),
        "seed": classifier.seed,
        "history": [asdict(epoch) for epoch in classifier.history],
        "manifest": classifier.manifest,
        "pressures": classifier.pressures,
        "speeds": classifier.speeds,
        "choice": None if classifier.choice is None else classifier.choice.to_dict(),
        "training_reference": None
        if reference is None
        else {
            item.name: getattr(reference, item.name)
            for item in fields(reference)
            if item.name not in _REFERENCE_TENSORS
        },
        "confidence": None
        if confidence is None
        else {
            item.name: getattr(confidence, item.name)
            for item in fields(confidence)
            if item.name not in _CONFIDENCE_TENSORS
        },
    }


def _classifier(card: dict[str, Any], tensors: dict[str, Tensor]) -> FittedClassifier:
    weights, scaling = select_prefix("network", tensors), select_prefix("normalization", tensors)
    _require_consistent(card, tensors)
    _require_size(card["network"], card["layout"]["length"], weights)
    network = build_network(card["network"]["name"], **card["network"]["settings"])
    network.load_state_dict(weights)
    return FittedClassifier(
        network=network.eval(),
        classes=tuple(card["classes"]),
        layout=WindowLayout(**{**card["layout"], "channels": tuple(card["layout"]["channels"])}),
        normalization=Normalization(card["normalization"], scaling["mean"].numpy(), scaling["deviation"].numpy()),
        settings=TrainingSettings(**card["settings"]),
        seed=card["seed"],
        history=tuple(Epoch(**epoch) for epoch in card["history"]),
        manifest=join_manifests([card["manifest"]]),
        pressures=tuple(card["pressures"]),
        speeds=tuple(card["speeds"]),
        choice=None if card["choice"] is None else Choice.from_dict(card["choice"]),
        training_reference=_reference(card["training_reference"], tensors),
        confidence=_confidence(card["confidence"], tensors),
    )


def _require_consistent(card: dict[str, Any], tensors: dict[str, Tensor]) -> None:
    """Refuse a card whose parts contradict each other or the tensors."""
    layout, settings, classes = card["layout"], card["network"]["settings"], card["classes"]
    n_channels = len(layout["channels"])
    if not classes or len(set(classes)) < len(classes):
        raise ValueError("its classes are none, or one of them twice")
    if layout["length"] < 2 or not layout["sample_rate"] > 0 or not n_channels:
        raise ValueError("its windows have a length below 2, no positive sample rate, or no channel")
    sizes = settings.get("n_channels"), settings.get("n_classes")
    if sizes != (n_channels, len(classes)) or bool in map(type, sizes):
        raise ValueError(f"its network is not for {n_channels} channel(s) and {len(classes)} classes")
    if card["normalization"] not in NORMALIZATIONS:
        raise ValueError(f"its normalization {card['normalization'][:60]!r} is none of {', '.join(NORMALIZATIONS)}")
    _require_tensors(card, tensors, n_channels)


def _require_tensors(card: dict[str, Any], tensors: dict[str, Tensor], n_channels: int) -> None:
    for name in ("mean", "deviation"):
        if tensors[f"normalization.{name}"].shape != (n_channels,):
            raise ValueError(f"normalization.{name} has not one value for each of {n_channels} channel(s)")
    if not bool((tensors["normalization.deviation"] > 0).all()):
        raise ValueError("normalization.deviation is not positive")
    if (names := card["training_reference"]) is not None:
        _require_reference(names, n_channels, *(tensors[f"training_reference.{name}"] for name in _REFERENCE_TENSORS))
    if card["confidence"] is not None:
        _require_confidence(card, *(tensors[f"confidence.{name}"] for name in _CONFIDENCE_TENSORS))


def _require_reference(
    names: dict[str, Any], n_channels: int, features: Tensor, facts: Tensor, condition: Tensor
) -> None:
    count = len(names["recording_id"])
    if not count or not count == len(names["label"]) == len(names["specimen"]):
        raise ValueError("training_reference has not a label and a specimen for each recording, or none")
    shapes = (tuple(part.shape) for part in (facts, condition))
    if features.ndim != 2 or len(features) != count or tuple(shapes) != ((count, n_channels, N_FACTS), (count, 2)):
        raise ValueError("the tensors of training_reference have not a row for each recording")
    if features.dtype != float32 or not facts.dtype == condition.dtype == float64:
        raise ValueError("the tensors of training_reference are not of float32, float64 and float64")
    scales = names["distance_scales"]
    if len(scales) != 2 or not all(0 < scale < inf for scale in scales):
        raise ValueError("training_reference.distance_scales are not two positive numbers")


def _require_confidence(card: dict[str, Any], score: Tensor, target: Tensor, ood_score: Tensor) -> None:
    counts = card["confidence"]["listening_windows"]
    if counts[:1] != [1] or sorted(set(counts)) != counts:
        raise ValueError("confidence.listening_windows is not in ascending order from 1")
    if ood_score.ndim != 1 or target.shape != ood_score.shape or score.shape != (len(counts), len(ood_score)):
        raise ValueError("the tensors of the confidence have not a value for each recording")
    if not (score.dtype == ood_score.dtype == float64 and bool((ood_score.diff() >= 0).all())):
        raise ValueError("the scores of the confidence are not of float64, or confidence.ood_score does not ascend")
    if target.dtype != int64 or not bool(((target >= 0) & (target < len(card["classes"]))).all()):
        raise ValueError("confidence.target holds no indexes of the classes")


def _require_size(network: dict[str, Any], length: int, weights: dict[str, Tensor]) -> None:
    """Refuse settings that ask for other weights than the file holds, before memory is taken for them."""
    most = max(_USUAL_SIZE, length, sum(tensor.numel() for tensor in weights.values()))
    for name, value in network["settings"].items():
        entries = value if isinstance(value, list) else [value]
        if len(entries) > _MOST_LAYERS:
            raise ValueError(f"the network's {name[:60]} has {len(entries)} entries")
        for entry in entries:
            if not isinstance(entry, (int, float, str)) and entry is not None:
                raise ValueError(f"the network's {name[:60]} is neither a number nor a text")
            if isinstance(entry, (int, float)) and abs(entry) > most:
                raise ValueError(f"the network's {name[:60]} is {entry:.6g}, and the file holds {most} values at most")
    if network["name"] not in BUILT_IN:
        return
    with device("meta"):
        needed = build_network(network["name"], **network["settings"]).state_dict()
    for name in [*needed, *weights]:
        shapes = [tuple(side[name].shape) if name in side else None for side in (needed, weights)]
        if shapes[0] != shapes[1]:
            raise ValueError(f"weight {name} has the shape {shapes[1]}, its settings ask for {shapes[0]}")


def _reference(names: dict[str, Any] | None, tensors: dict[str, Tensor]) -> TrainingReference | None:
    """None where all training windows were synthetic."""
    if names is None:
        return None
    values: dict[str, Any] = {name: tuple(entries) for name, entries in names.items()}
    values |= {name: tensors[f"training_reference.{name}"].numpy() for name in _REFERENCE_TENSORS}
    stated = values["condition"] > 0
    return TrainingReference(**{**values, "condition": np.where(stated, values["condition"], np.nan)})


def _confidence(values: dict[str, Any] | None, tensors: dict[str, Tensor]) -> Confidence | None:
    """None where the confidence was not calibrated."""
    if values is None:
        return None
    arrays: dict[str, Any] = {name: tensor.numpy() for name, tensor in select_prefix("confidence", tensors).items()}
    return Confidence(**arrays, **{**values, "listening_windows": tuple(values["listening_windows"])})
