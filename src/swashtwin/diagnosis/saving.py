"""A fitted classifier as an artifact: its weights, and a card that holds everything else."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from torch import Tensor, from_numpy

from swashtwin.foundation import (
    ArtifactError,
    add_prefix,
    read_artifact,
    refuse_misfits,
    select_prefix,
    write_artifact,
)
from swashtwin.learning import (
    NETWORKS,
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

_KIND, _VERSION = "classifier", 3


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
        name = str(card["network"]["name"])
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
        tensors["training_reference.features"] = from_numpy(classifier.training_reference.features)
    if classifier.confidence is not None:
        tensors["confidence.nonconformity_score"] = from_numpy(classifier.confidence.nonconformity_score)
        tensors["confidence.ood_score"] = from_numpy(classifier.confidence.ood_score)
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
        "training_reference": None
        if reference is None
        else {"recording_id": reference.recording_id, "label": reference.label},
        "confidence": None
        if confidence is None
        else {"temperature": confidence.temperature, "error_rate": confidence.error_rate},
    }


def _classifier(card: dict[str, Any], tensors: dict[str, Tensor]) -> FittedClassifier:
    network = build_network(card["network"]["name"], **card["network"]["settings"])
    network.load_state_dict(select_prefix("network", tensors))
    scaling = select_prefix("normalization", tensors)
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
        training_reference=_reference(card["training_reference"], tensors),
        confidence=_confidence(card["confidence"], tensors),
    )


def _reference(names: dict[str, Any] | None, tensors: dict[str, Tensor]) -> TrainingReference | None:
    """None where all training windows were synthetic."""
    if names is None:
        return None
    features = tensors["training_reference.features"].numpy()
    return TrainingReference(tuple(names["recording_id"]), tuple(names["label"]), features)


def _confidence(values: dict[str, Any] | None, tensors: dict[str, Tensor]) -> Confidence | None:
    """None where the confidence was not calibrated."""
    if values is None:
        return None
    scores: dict[str, Any] = {name: tensor.numpy() for name, tensor in select_prefix("confidence", tensors).items()}
    return Confidence(**scores, **values)
