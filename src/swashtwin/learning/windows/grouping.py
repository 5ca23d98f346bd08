"""What a split keeps whole: a recording, a machine, an operating condition, or whatever else was written down."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Shaped

from swashtwin.foundation import DataError, InputError, LeakError
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.recordings import GROUPS, condition_names, no_group


def require_measured(windows: WindowSet) -> None:
    """Raise a `LeakError` that names a synthetic window, if there is one: no split may deal these out."""
    if windows.synthetic.any():
        name = windows.recording_id[windows.synthetic][0]
        raise LeakError(f"{name} is synthetic; split the measured windows first, then add synthetic ones to training.")


def window_groups(windows: WindowSet, group: str | Mapping[str, str]) -> Shaped[np.ndarray, " window"]:
    """Name of each window's group: by one of `GROUPS`, or by its recording's id as `recording_groups` gives it."""
    if isinstance(group, Mapping):
        missing = [name for name in np.unique(windows.recording_id).tolist() if name not in group]
        if missing:
            raise DataError(no_group(missing, np.unique(windows.recording_id).size, "group"))
        return np.array([str(group[name]) for name in windows.recording_id.tolist()], dtype=np.str_)
    if group == "recording":
        return windows.recording_id
    if group == "condition":
        ids = windows.recording_id.tolist()
        return np.array(condition_names(ids, windows.speed, windows.discharge_pressure), dtype=np.str_)
    if group != "specimen":
        raise InputError(
            f"group {group!r} is none of {', '.join(GROUPS)}; an attribute of the recordings gives groups of its own."
        )
    if (windows.specimen == "").any():
        missing = sorted(set(windows.recording_id[windows.specimen == ""].tolist()))
        raise DataError(no_group(missing, np.unique(windows.recording_id).size, group))
    return windows.specimen


def group_name(group: str | Mapping[str, str]) -> str:
    """What to call one group in a message."""
    return group if isinstance(group, str) else "group"
