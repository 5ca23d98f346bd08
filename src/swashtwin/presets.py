"""Presets of arguments: the paper's, and the recommended ones, which are the defaults.

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
    """One set of arguments."""

    name: str
    """``"paper"`` or ``"recommended"``, its name on the command line."""
    training: TrainingSettings
    """Settings of the training of a network."""
    classifier: Mapping[str, Any]
    """Arguments of `FaultClassifier`."""

    @property
    def calibration(self) -> Mapping[str, Any]:
        """Arguments of `calibrate`."""
        if self is not paper:
            return {}

        # It needs torch, which the default training does without.
        from swashtwin.calibration import PAPER_CALIBRATION

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
"""The preset of the paper (DOI 10.1177/00202940261419020)."""

recommended = Preset("recommended", RECOMMENDED_TRAINING, MappingProxyType({}))
"""The defaults of `calibrate` and `FaultClassifier` (docs/explanation/networks.md), which selects
by trials; a named network is trained by `training`.
"""
