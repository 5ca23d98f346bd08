"""A window set as an artifact."""

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from swashtwin.foundation import from_table, read_artifact, refuse_misfits, to_table, write_artifact
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.recordings import Manifest

_KIND, _VERSION = "window set", 3
_ARRAYS = ("signal", "target", "discharge_pressure", "speed", "start", "synthetic")
_MAY_BE_NAN = ("discharge_pressure", "speed")


@dataclass(frozen=True)
class _Card:
    """What of a `WindowSet` is no array."""

    classes: tuple[str, ...]
    recording_id: list[str]
    specimen: list[str]
    sample_rate: float
    channels: tuple[str, ...]
    unit: str
    manifest: Manifest
    content: Manifest


def save_windows(windows: WindowSet, path: Path | str) -> Path:
    """`path`, after the windows, their manifest included, were written to it whole.

    Raises
    ------
    ArtifactError
        A sample is NaN or infinite.
    """
    card = {item.name: getattr(windows, item.name) for item in fields(_Card)}
    arrays = {name: getattr(windows, name) for name in _ARRAYS}
    return write_artifact(path, _KIND, _VERSION, to_table(card), arrays, may_be_nan=_MAY_BE_NAN)


def load_windows(path: Path | str) -> WindowSet:
    """The windows that `save_windows` wrote.

    Raises
    ------
    MissingFileError
        No such file.
    ArtifactError
        It is damaged, edited, no window file, or of another version.
    """
    advice = "swashtwin synthesize, or save_windows, writes windows"
    card, arrays = read_artifact(path, _KIND, _VERSION, advice=advice, may_be_nan=_MAY_BE_NAN)
    with refuse_misfits(path, _KIND):
        facts = vars(from_table(card, _Card))
        texts = {name: np.array(facts[name], dtype=np.str_) for name in ("recording_id", "specimen")}
        return WindowSet(**{**arrays, **facts, **texts})
