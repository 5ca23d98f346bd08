"""An anomaly detector as an artifact: the levels of its healthy recordings, and a card that holds everything else."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from torch import from_numpy

from swashtwin.foundation import read_artifact, refuse_misfits, require_form, write_artifact
from swashtwin.learning import HealthyLevels, LevelLayout
from swashtwin.recordings import join_manifests

KIND, VERSION = "anomaly detector", 1
_FACTS = ("speed", "pressure")
_FORM: dict[str, Any] = {
    "layout": {"sample_rate": float, "channels": [str], "unit": str, "length": int, "n_orders": int},
    "specimen": [str],
    "shortest": int,
    "manifest": {str: [str]},
    "error_rate": float,
    "notes": [str],
}
"""Form of a card (`require_form`)."""


def write_detector(path: Path | str, healthy: HealthyLevels, error_rate: float, notes: tuple[str, ...]) -> Path:
    """`path`, after a detector was written to it whole."""
    card = {
        "layout": asdict(healthy.layout),
        "specimen": healthy.specimen,
        "shortest": healthy.shortest,
        "manifest": healthy.manifest,
        "error_rate": error_rate,
        "notes": notes,
    }
    arrays = {"levels": healthy.levels, "speed": healthy.speed, "pressure": healthy.pressure}
    tensors = {name: from_numpy(array) for name, array in arrays.items()}
    return write_artifact(path, KIND, VERSION, card, tensors, may_be_nan=_FACTS)


def read_detector(path: Path | str) -> tuple[HealthyLevels, float, tuple[str, ...]]:
    """(levels of the healthy recordings, false-alarm rate, notes) that `write_detector` wrote.

    Raises
    ------
    MissingFileError
        There is no such file.
    ArtifactError
        The file is damaged, edited, no detector, or of another version.
    """
    advice = "a detector is saved with detector.save(path), or by swashtwin train"
    card, tensors = read_artifact(path, KIND, VERSION, advice=advice, may_be_nan=_FACTS)
    with refuse_misfits(path, KIND):
        require_form(card, _FORM, "card")
        layout = LevelLayout(**{**card["layout"], "channels": tuple(card["layout"]["channels"])})
        _require_consistent(layout, card, {name: tuple(tensor.shape) for name, tensor in tensors.items()})
        arrays = {name: tensor.double().numpy() for name, tensor in tensors.items()}
        healthy = HealthyLevels(
            layout=layout,
            specimen=tuple(card["specimen"]),
            shortest=card["shortest"],
            manifest=join_manifests([card["manifest"]]),
            **arrays,
        )
        if np.bincount(healthy.point_index).min() < 2:
            raise ValueError("it holds a single recording of an operating point")
        return healthy, card["error_rate"], tuple(card["notes"])


def _require_consistent(layout: LevelLayout, card: dict[str, Any], shapes: dict[str, tuple[int, ...]]) -> None:
    """Refuse a card whose parts contradict each other or the tensors."""
    if layout.length > card["shortest"] or 2 * layout.n_orders > layout.sample_rate:
        raise ValueError("its segments are longer than its recordings, or its shaft orders beyond the sample rate")
    count = len(card["specimen"])
    if count < 2 or len(card["manifest"]) != count:
        raise ValueError("its recordings are fewer than two, or its manifest has not one entry for each")
    if not (1 - 1e-9) / (count + 1) <= card["error_rate"] < 1:
        raise ValueError(f"its false-alarm rate {card['error_rate']:g} is none that {count} recordings can state")
    needed = {"levels": (count, len(layout.levels)), **dict.fromkeys(_FACTS, (count,))}
    if shapes != needed:
        raise ValueError(f"its arrays have the shapes {shapes}, not {needed}")
