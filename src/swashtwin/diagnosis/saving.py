"""A fitted classifier as one safetensors file: tensors, and a JSON card that holds everything else.

Reading it runs no code. A SHA-256 over tensors and card tells a damaged or edited file; it is no signature, since
whoever edits the file on purpose can write a new sum.
"""

import hashlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, from_numpy

from swashtwin.foundation import ArtifactError, InputError, MissingFileError, replacing
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
)

FORMAT = "swashtwin-classifier"
VERSION = "1"
"""Version of the file's form; another one is refused."""


def save_classifier(classifier: FittedClassifier, path: Path | str) -> Path:
    """`path`, after the classifier was written to it whole.

    Raises
    ------
    ArtifactError
        The network is not in the registry, so that nobody could build it again from the file.
    """
    if NETWORKS.get(classifier.network.name) is not type(classifier.network):
        raise ArtifactError(
            f"{type(classifier.network).__name__} is not in swashtwin.learning.networks.NETWORKS; register it."
        )
    tensors = {f"network.{name}": tensor for name, tensor in classifier.network.state_dict().items()}
    tensors["normalization.mean"] = from_numpy(classifier.normalization.mean)
    tensors["normalization.deviation"] = from_numpy(classifier.normalization.deviation)
    if classifier.training_reference is not None:
        tensors["known.features"] = from_numpy(classifier.training_reference.features)
    if classifier.confidence is not None:
        tensors["confidence.nonconformity_score"] = from_numpy(classifier.confidence.nonconformity_score)
        tensors["confidence.ood_score"] = from_numpy(classifier.confidence.ood_score)
    tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    card = _card(classifier)
    note = {"version": VERSION, "card": card, "sha256": _checksum(tensors, card)}
    with replacing(Path(path)) as temporary:  # one key, since safetensors writes several in an order of its own
        save_file(tensors, temporary, metadata={FORMAT: json.dumps(note, sort_keys=True)})
    return Path(path)


def load_classifier(path: Path | str) -> FittedClassifier:
    """The classifier that `save_classifier` wrote, on the CPU; its predictions are those of the one saved.

    Raises
    ------
    MissingFileError
        There is no such file.
    ArtifactError
        The file is damaged, edited, no classifier, or of another version.
    """
    if not Path(path).is_file():
        raise MissingFileError(f"{path} does not exist; a classifier is saved with save_classifier(classifier, path).")
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as cause:
        raise ArtifactError(f"{path} is damaged or no saved classifier ({cause}).") from cause
    if FORMAT not in metadata:
        raise ArtifactError(f"{path} holds no swashtwin classifier; save one with save_classifier(classifier, path).")
    try:
        note = json.loads(metadata[FORMAT])
        version, card, checksum = note["version"], note["card"], note["sha256"]
    except (ValueError, KeyError, TypeError) as cause:
        raise ArtifactError(f"{path} is damaged: its card cannot be read.") from cause
    if version != VERSION:
        raise ArtifactError(f"{path} has the version {version}, this swashtwin reads version {VERSION}; save it again.")
    if checksum != _checksum(tensors, card):
        raise ArtifactError(f"{path} was changed after it was saved (its SHA-256 does not fit); fetch it again.")
    try:
        return _classifier(tensors, card)
    except (InputError, KeyError, TypeError, RuntimeError) as cause:
        reason = str(cause).splitlines()[0]
        raise ArtifactError(f"{path} does not fit this swashtwin ({reason}); was it saved by a newer one?") from cause


def _card(classifier: FittedClassifier) -> dict[str, Any]:
    known, confidence = classifier.training_reference, classifier.confidence
    extra: dict[str, Any] = (
        {} if known is None else {"known": {"recording_id": known.recording_id, "label": known.label}}
    )
    if confidence is not None:
        extra["confidence"] = {"temperature": confidence.temperature, "error_rate": confidence.error_rate}
    return {
        **extra,
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
    }


def _classifier(tensors: dict[str, Tensor], card: dict[str, Any]) -> FittedClassifier:
    network = build_network(card["network"]["name"], **card["network"]["settings"])
    weights = {name.removeprefix("network."): tensor for name, tensor in tensors.items() if name.startswith("network.")}
    network.load_state_dict(weights)
    return FittedClassifier(
        network=network.eval(),
        classes=tuple(card["classes"]),
        layout=WindowLayout(**{**card["layout"], "channels": tuple(card["layout"]["channels"])}),
        normalization=Normalization(
            card["normalization"], tensors["normalization.mean"].numpy(), tensors["normalization.deviation"].numpy()
        ),
        settings=TrainingSettings(**card["settings"]),
        seed=card["seed"],
        history=tuple(Epoch(**epoch) for epoch in card["history"]),
        manifest=tuple(card["manifest"]),
        pressures=tuple(card["pressures"]),
        speeds=tuple(card["speeds"]),
        training_reference=_known(tensors, card),
        confidence=_confidence(tensors, card),
    )


def _known(tensors: dict[str, Tensor], card: dict[str, Any]) -> TrainingReference | None:
    """None for a file from before recordings were kept, and where all windows were synthetic."""
    if "known" not in card:
        return None
    names = card["known"]
    return TrainingReference(tuple(names["recording_id"]), tuple(names["label"]), tensors["known.features"].numpy())


def _confidence(tensors: dict[str, Tensor], card: dict[str, Any]) -> Confidence | None:
    """None where nobody asked for it, and for a file from before it was kept or whose unknown was told otherwise."""
    if "confidence" not in card or "confidence.ood_score" not in tensors:
        return None
    nonconformity_score, ood_score = (
        tensors[f"confidence.{name}"].numpy() for name in ("nonconformity_score", "ood_score")
    )
    return Confidence(nonconformity_score=nonconformity_score, ood_score=ood_score, **card["confidence"])


def _checksum(tensors: dict[str, Tensor], card: dict[str, Any]) -> str:
    digest = hashlib.sha256(f"{FORMAT} {VERSION}\n{json.dumps(card, sort_keys=True)}\n".encode())
    for name in sorted(tensors):
        array = np.ascontiguousarray(tensors[name].numpy())
        digest.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()
