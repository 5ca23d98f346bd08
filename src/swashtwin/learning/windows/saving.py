"""A window set as one safetensors file: the arrays, and a JSON card with everything else."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from swashtwin.foundation import ArtifactError, DataError, InputError, MissingFileError, replacing
from swashtwin.learning.windows.window_set import WindowSet

FORMAT = "swashtwin-windows-1"

_ARRAYS = ("signal", "target", "discharge_pressure", "speed", "start", "synthetic")
_TEXTS = ("recording_id", "specimen")


def save_windows(windows: WindowSet, path: Path | str, *, manifest: Iterable[str] = ()) -> Path:
    """`path`, after the windows were written to it whole.

    Parameters
    ----------
    manifest : ids of recordings that had a part in the windows without standing in them, such as those that a twin was
        calibrated on and that lent their noise. They come back from `load_windows`, for ``fit(..., manifest=...)``.
    """
    card = {
        "format": FORMAT,
        "classes": windows.classes,
        "sample_rate": windows.sample_rate,
        "channels": windows.channels,
        "unit": windows.unit,
        **{name: getattr(windows, name).tolist() for name in _TEXTS},
        "manifest": sorted({str(name) for name in manifest}),
        "fingerprint": windows.fingerprint(),
    }
    arrays = {name: np.ascontiguousarray(getattr(windows, name)) for name in _ARRAYS}
    with replacing(Path(path)) as temporary:
        save_file(arrays, temporary, metadata={"card": json.dumps(card, ensure_ascii=False)})
    return Path(path)


def load_windows(path: Path | str) -> tuple[WindowSet, tuple[str, ...]]:
    """(windows, manifest) that `save_windows` wrote.

    Raises
    ------
    MissingFileError
        No such file.
    ArtifactError
        It is damaged, edited, no window file, or of another version.
    """
    if not Path(path).is_file():
        raise MissingFileError(f"{path} does not exist; windows are saved with save_windows(windows, path).")
    try:
        with safe_open(path, framework="np") as file:
            metadata = file.metadata() or {}
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as cause:
        raise ArtifactError(f"{path} is damaged or no file of windows ({cause}).") from cause
    try:
        card = json.loads(metadata["card"])
        if card["format"] != FORMAT:
            raise ArtifactError(f"{path} has the format {card['format']!r}, this swashtwin reads {FORMAT!r}.")
        windows = _windows(arrays, card)
    except (KeyError, TypeError, AttributeError, json.JSONDecodeError, DataError, InputError) as cause:
        if isinstance(cause, ArtifactError):
            raise
        raise ArtifactError(f"{path} holds no windows that this swashtwin can read ({cause}).") from cause
    if windows.fingerprint() != card["fingerprint"]:
        raise ArtifactError(f"{path} was changed after it was saved (its SHA-256 does not fit); make it again.")
    return windows, tuple(card["manifest"])


def _windows(arrays: dict[str, Any], card: dict[str, Any]) -> WindowSet:
    texts: dict[str, Any] = {name: np.array(card[name], dtype=np.str_) for name in _TEXTS}
    return WindowSet(
        **{name: arrays[name] for name in _ARRAYS},
        **texts,
        classes=tuple(card["classes"]),
        sample_rate=float(card["sample_rate"]),
        channels=tuple(card["channels"]),
        unit=str(card["unit"]),
    )
