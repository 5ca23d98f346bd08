"""A window set as an artifact: its arrays, and a card that holds everything else."""

from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor, from_numpy

from swashtwin.foundation import read_artifact, refuse_misfits, write_artifact
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.recordings import join_manifests

_KIND, _VERSION = "window set", 3
_ARRAYS = ("signal", "target", "discharge_pressure", "speed", "start", "synthetic")
_TEXTS = ("recording_id", "specimen")
_MAY_BE_NAN = ("discharge_pressure", "speed")


def save_windows(windows: WindowSet, path: Path | str) -> Path:
    """`path`, after the windows, their manifest included, were written to it whole.

    Raises
    ------
    ArtifactError
        A sample is NaN or infinite.
    """
    card = {
        "classes": windows.classes,
        "sample_rate": windows.sample_rate,
        "channels": windows.channels,
        "unit": windows.unit,
        "manifest": windows.manifest,
        "content": windows.content,
        **{name: getattr(windows, name).tolist() for name in _TEXTS},
    }
    tensors = {name: from_numpy(np.ascontiguousarray(getattr(windows, name))) for name in _ARRAYS}
    return write_artifact(path, _KIND, _VERSION, card, tensors, may_be_nan=_MAY_BE_NAN)


def load_windows(path: Path | str) -> WindowSet:
    """The windows that `save_windows` wrote.

    Raises
    ------
    MissingFileError
        No such file.
    ArtifactError
        It is damaged, edited, no window file, or of another version.
    """
    advice = "windows are saved with save_windows(windows, path), or by swashtwin synthesize"
    card, tensors = read_artifact(path, _KIND, _VERSION, advice=advice, may_be_nan=_MAY_BE_NAN)
    with refuse_misfits(path, _KIND):
        return _windows(card, tensors)


def _windows(card: dict[str, Any], tensors: dict[str, Tensor]) -> WindowSet:
    texts: dict[str, Any] = {name: np.array(card[name], dtype=np.str_) for name in _TEXTS}
    arrays: dict[str, Any] = {name: tensors[name].numpy() for name in _ARRAYS}
    return WindowSet(
        **arrays,
        **texts,
        classes=tuple(card["classes"]),
        sample_rate=float(card["sample_rate"]),
        channels=tuple(card["channels"]),
        unit=str(card["unit"]),
        manifest=card["manifest"],
        content=join_manifests([card["content"]]),
    )
