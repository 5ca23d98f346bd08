"""A window set as an artifact."""

from dataclasses import fields
from pathlib import Path

from swashtwin.foundation import load_artifact, save_artifact
from swashtwin.learning.windows.window_set import WindowSet

_KIND, _VERSION = "window set", 4
_MAY_BE_NAN = ("discharge_pressure", "speed")


def save_windows(windows: WindowSet, path: Path | str) -> Path:
    """`path`, after the windows, their manifest included, were written to it whole; what was compared with is not.

    Raises
    ------
    ArtifactError
        A sample is NaN or infinite.
    """
    alone = WindowSet(**{item.name: getattr(windows, item.name) for item in fields(WindowSet)})
    return save_artifact(path, _KIND, _VERSION, alone, may_be_nan=_MAY_BE_NAN)


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
    return load_artifact(path, WindowSet, _KIND, _VERSION, advice=advice, may_be_nan=_MAY_BE_NAN)
