"""A trained `AmortizedIPINN` as one safetensors file: weights, and a JSON card that says what it was trained for.

Reading it runs no code. A SHA-256 over tensors and card tells a damaged or edited file.
"""

import hashlib
import json
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from swashtwin.calibration.methods.amortized import AmortizedIPINN
from swashtwin.calibration.methods.amortized_training import AmortizedNetwork, AmortizedTraining, Trained, Usual
from swashtwin.foundation import ArtifactError, InputError, MissingFileError, replacing

FORMAT = "swashtwin-amortized-1"


def save_amortized(method: AmortizedIPINN, path: Path | str) -> Path:
    """`path`, after the trained network was written to it whole."""
    found = method.trained
    tensors = {f"network.{name}": tensor for name, tensor in found.network.state_dict().items()}
    tensors |= {f"usual.{name}": tensor for name, tensor in vars(found.usual).items()}
    tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    card = {
        "network": found.network.sizes,
        "losses": list(found.losses),
        "held_out_loss": found.held_out_loss,
        "purpose": method.purpose,
        "training": asdict(method.training),
        "seed": method.seed,
        "refine": method.refine,
        "most_iterations": method.most_iterations,
    }
    note = {"card": card, "sha256": _checksum(tensors, card)}
    with replacing(Path(path)) as temporary:
        save_file(tensors, temporary, metadata={FORMAT: json.dumps(note, sort_keys=True)})
    return Path(path)


def load_amortized(path: Path | str) -> AmortizedIPINN:
    """The method that `save_amortized` wrote; it says the same of every measurement.

    Raises
    ------
    MissingFileError
        There is no such file.
    ArtifactError
        The file is damaged, edited, something else, or of another version.
    """
    if not Path(path).is_file():
        raise MissingFileError(f"{path} does not exist; a network is saved with save_amortized(method, path).")
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as cause:
        raise ArtifactError(f"{path} is damaged or no saved network ({cause}); train it again.") from cause
    if FORMAT not in metadata:
        raise ArtifactError(f"{path} holds no amortized network, or one of another version; train it again.")
    try:
        note = json.loads(metadata[FORMAT])
        if note["sha256"] != _checksum(tensors, note["card"]):
            raise ArtifactError(f"{path} was changed after it was saved (its SHA-256 does not fit); train it again.")
        return _method(tensors, note["card"])
    except (InputError, KeyError, TypeError, ValueError, RuntimeError) as cause:
        if isinstance(cause, ArtifactError):
            raise
        reason = str(cause).splitlines()[0]
        raise ArtifactError(f"{path} does not fit this swashtwin ({reason}); was it saved by a newer one?") from cause


def _method(tensors: dict[str, Tensor], card: dict[str, Any]) -> AmortizedIPINN:
    training = AmortizedTraining(**card["training"])
    with torch.random.fork_rng(devices=[]):
        network = AmortizedNetwork(training.read, **card["network"])
    weights = {name.removeprefix("network."): tensor for name, tensor in tensors.items() if name.startswith("network.")}
    network.load_state_dict(weights)
    usual = Usual(**{item.name: tensors[f"usual.{item.name}"] for item in fields(Usual)})
    found = Trained(network.eval(), usual, tuple(card["losses"]), card["held_out_loss"])
    going_on = {name: card[name] for name in ("refine", "most_iterations")}
    return AmortizedIPINN(found, card["purpose"], training, card["seed"], **going_on)


def _checksum(tensors: dict[str, Tensor], card: dict[str, Any]) -> str:
    digest = hashlib.sha256(f"{FORMAT}\n{json.dumps(card, sort_keys=True)}\n".encode())
    for name in sorted(tensors):
        array = np.ascontiguousarray(tensors[name].numpy())
        digest.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()
