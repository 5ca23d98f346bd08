"""Two recipes of arguments: the paper's, and ours, which are the defaults everywhere.

Examples
--------
>>> from swashtwin.diagnosis import FaultClassifier
>>> FaultClassifier(**paper.classifier).network
'bitcn'
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from swashtwin.calibration import PAPER_CALIBRATION
from swashtwin.learning import PAPER_TRAINING, RECOMMENDED_TRAINING, TrainingSettings


@dataclass(frozen=True)
class Preset:
    """One recipe."""

    name: str
    """``"paper"`` or ``"recommended"``, as the command line calls it."""
    calibration: Mapping[str, Any]
    """Arguments of `calibrate`."""
    training: TrainingSettings
    """Settings of the training of a network."""
    classifier: Mapping[str, Any]
    """Arguments of `FaultClassifier`."""

    def __repr__(self) -> str:
        return f"<Preset: {self.name}>"


def _classifier(network: str, training: TrainingSettings) -> Mapping[str, Any]:
    names = ("epochs", "batch_size", "learning_rate", "decay", "normalization")
    return MappingProxyType({"network": network, **{name: getattr(training, name) for name in names}})


paper = Preset("paper", PAPER_CALIBRATION, PAPER_TRAINING, _classifier("bitcn", PAPER_TRAINING))
"""The recipe of the paper (DOI 10.1177/00202940261419020)."""

recommended = Preset(
    "recommended", MappingProxyType({}), RECOMMENDED_TRAINING, _classifier("spectral_bitcn", RECOMMENDED_TRAINING)
)
"""Ours (docs/networks.md): the defaults of `calibrate` and `FaultClassifier`."""
