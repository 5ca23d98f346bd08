"""What a study found, and the JSON it is told in.

The schema is stable: ``{"study", "size", "seeds", "rows", "rivals", "wall_s", "device", "version", "command",
"origin", "settings", "cells", "splits", "fingerprints", "calibrations"}``. Each row holds the factors that name it
(such as ``training_set`` and ``level``) and, under ``accuracy``, ``recall``, ``f1``, ``g_mean``,
``recording_accuracy`` and ``scarce_recall``, ``{"mean", "std", "values"}`` over the seeds.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float, Shaped

from swashtwin.calibration import Calibration
from swashtwin.evaluation import Scores
from swashtwin.training import Epoch


@dataclass(frozen=True, eq=False)
class Outcome:
    """One classifier, trained on one training set, scored at one level."""

    classifier: str
    """Kind of classifier: ``"bitcn"``, or a rival such as ``"extra_trees"``."""
    training_set: str
    """``"measured"``, ``"nominal"`` or ``"calibrated"``."""
    level: str
    """Level of generalization of the test set."""
    seed: int
    """Seed of split, weights and synthesis."""
    scores: Scores
    """What it scored."""
    scarce_recall: float
    """Recall of the measured windows of the cell that was filled."""


@dataclass(frozen=True, eq=False)
class TrainingCurve:
    """How one training went."""

    training_set: str
    """Which training set."""
    seed: int
    """Seed."""
    epochs: tuple[Epoch, ...]
    """One entry an epoch."""


@dataclass(frozen=True, eq=False)
class Embedding:
    """Last features of the test windows, for t-SNE."""

    training_set: str
    """Training set of the network that made them."""
    features: Float[np.ndarray, "window feature"]
    """Features before the last layer."""
    label: Shaped[np.ndarray, " window"]
    """True class of each window."""
    level: Shaped[np.ndarray, " window"]
    """Level of generalization of each window."""


@dataclass(frozen=True, eq=False)
class StudyResult:
    """All that a study's report and its JSON are made from."""

    study: str
    """Name, such as ``"case1"``."""
    size: str
    """Name of the settings, such as ``"quick"``."""
    seeds: tuple[int, ...]
    """Seeds that were run."""
    outcomes: tuple[Outcome, ...]
    """Every score of the study's own network."""
    rivals: tuple[Outcome, ...]
    """Every score of its rivals."""
    curves: tuple[TrainingCurve, ...]
    """Every training."""
    embeddings: tuple[Embedding, ...]
    """Features under the first seed, one per training set."""
    calibrations: tuple[Calibration, ...]
    """Calibrations under the first seed."""
    cells: dict[str, dict[str, int]]
    """Windows by class and pressure (``"swash_plate @ 15 MPa"``) in each training set and test set, first seed."""
    settings: dict[str, Any]
    """Settings, as JSON can hold them."""
    origin: str
    """Where the recordings come from, in words; the virtual rig says that it is none of a machine's."""
    wall_s: float
    """How long it took [s]."""
    device: str
    """What it ran on."""
    version: str
    """Version of swashtwin."""
    command: str
    """Command that repeats it."""
    splits: dict[str, dict[str, list[str]]] = field(default_factory=dict)
    """Recording ids by role (``train``, ``calibration``, ``L2``, ``L4``) under each seed."""
    fingerprints: dict[str, dict[str, str]] = field(default_factory=dict)
    """SHA-256 of every training and test set under each seed."""

    def rows(self, outcomes: Sequence[Outcome] | None = None) -> list[dict[str, Any]]:
        """One row for each (classifier,) training set and level, in the order they were run."""
        outcomes = self.outcomes if outcomes is None else outcomes
        keys = dict.fromkeys((one.classifier, one.training_set, one.level) for one in outcomes)
        table = []
        for classifier, training_set, level in keys:
            key = (classifier, training_set, level)
            of_key = [one for one in outcomes if (one.classifier, one.training_set, one.level) == key]
            row: dict[str, Any] = {"classifier": classifier, "training_set": training_set, "level": level}
            for name, value in _METRICS.items():
                row[name] = spread([value(one) for one in of_key])
            table.append(row)
        return table

    def to_dict(self) -> dict[str, Any]:
        """The study's JSON."""
        return {
            "study": self.study,
            "size": self.size,
            "seeds": list(self.seeds),
            "rows": self.rows(),
            "rivals": self.rows(self.rivals),
            "wall_s": round(self.wall_s, 2),
            "device": self.device,
            "version": self.version,
            "command": self.command,
            "origin": self.origin,
            "settings": self.settings,
            "cells": self.cells,
            "splits": self.splits,
            "fingerprints": self.fingerprints,
            "calibrations": [_calibration_row(one) for one in self.calibrations],
        }


def _calibration_row(calibration: Calibration) -> dict[str, Any]:
    return {
        "pump": calibration.twin.pump.name,
        "recording_ids": list(calibration.recording_ids),
        "fit_before": asdict(calibration.fit_before),
        "fit_after": asdict(calibration.fit_after),
        "estimates": [asdict(estimate) for estimate in calibration.estimates],
    }


_METRICS = {
    "accuracy": lambda one: one.scores.accuracy,
    "recall": lambda one: one.scores.macro_recall,
    "f1": lambda one: one.scores.macro_f1,
    "g_mean": lambda one: one.scores.g_mean,
    "recording_accuracy": lambda one: one.scores.recording_accuracy,
    "scarce_recall": lambda one: one.scarce_recall,
}


def spread(values: Sequence[float]) -> dict[str, Any]:
    """Mean, standard deviation (of the sample; None for one value) and the values themselves."""
    finite = [value for value in values if math.isfinite(value)]
    return {
        "mean": float(np.mean(finite)) if finite else None,
        "std": float(np.std(finite, ddof=1)) if len(finite) > 1 else None,
        "values": [value if math.isfinite(value) else None for value in values],
    }
