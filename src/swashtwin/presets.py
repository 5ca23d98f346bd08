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

from swashtwin.learning import PAPER_TRAINING, RECOMMENDED_TRAINING, TrainingSettings


@dataclass(frozen=True)
class Preset:
    """One recipe."""

    name: str
    """``"paper"`` or ``"recommended"``, as the command line calls it."""
    training: TrainingSettings
    """Settings of the training of a network."""
    classifier: Mapping[str, Any]
    """Arguments of `FaultClassifier`."""

    @property
    def calibration(self) -> Mapping[str, Any]:
        """Arguments of `calibrate`."""
        if self is not paper:
            return {}
        from swashtwin.calibration import (
            PAPER_CALIBRATION,
        )  # needs torch, which a training by default does without

        return PAPER_CALIBRATION

    def __repr__(self) -> str:
        return f"<Preset: {self.name}>"


_NAMES = ("epochs", "batch_size", "learning_rate", "decay", "normalization")

paper = Preset(
    "paper",
    PAPER_TRAINING,
    MappingProxyType(
        {"network": "bitcn", **{name: getattr(PAPER_TRAINING, name) for name in _NAMES}}
    ),
)
"""The recipe of the paper (DOI 10.1177/00202940261419020)."""

recommended = Preset("recommended", RECOMMENDED_TRAINING, MappingProxyType({}))
"""Ours (docs/explanation/networks.md): the defaults of `calibrate` and `FaultClassifier`, which
chooses by trials; a network that is named is trained by `training`.
"""
