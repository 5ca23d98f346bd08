"""What a split keeps whole: a recording, a machine, an operating condition, or whatever else was written down."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches

import numpy as np
from jaxtyping import Float, Shaped

from swashtwin.foundation import DataError, InputError, LeakError, UnitError, parse
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.pump import PRESSURE_TOLERANCE, merge_close_values
from swashtwin.recordings import Recording, StoredRecording, stated_speed

GROUPS = ("recording", "specimen", "condition")
"""What every set can be grouped by: each is a level of generalization (L2, L4, L3)."""
_SPEED_TOLERANCE = 0.03
"""Relative difference of speeds of the same condition: more than elsewhere, since conditions that are joined wrongly
make a test harder, and conditions that are separated wrongly make it leak."""


def require_measured(windows: WindowSet) -> None:
    """Raise a `LeakError` that names a synthetic window, if there is one: no split may deal these out."""
    if windows.synthetic.any():
        name = windows.recording_id[windows.synthetic][0]
        raise LeakError(f"{name} is synthetic; split the measured windows first, then add synthetic ones to training.")


def recording_groups(recordings: Iterable[Recording | StoredRecording], group: str) -> dict[str, str]:
    """Group of each recording by its id, for the ``group=`` of `split_by_recording` and `group_folds`.

    Parameters
    ----------
    group : ``"recording"``, ``"specimen"``, ``"condition"`` (speed and discharge pressure, as far as they are stated),
        or the name of an attribute, such as ``"pump_run"``.

    Raises
    ------
    InputError
        No recording has such an attribute.
    DataError
        Some recordings have it and some have not.

    Examples
    --------
    >>> day = {"a": "Monday", "b": "Friday"}
    >>> rows = [Recording(np.ones((1, 4)), 10.0, name, attributes={"day": day[name]}) for name in day]
    >>> recording_groups(rows, "day")
    {'a': 'Monday', 'b': 'Friday'}
    """
    recordings = list(recordings)
    ids = [recording.recording_id for recording in recordings]
    if group == "recording":
        return dict(zip(ids, ids, strict=True))
    if group == "condition":
        speed = np.array([(stated_speed(one) or math.nan) * 2 * math.pi for one in recordings], dtype=np.float64)
        pressure = np.array([stated_pressure(one) for one in recordings], dtype=np.float64)
        return dict(zip(ids, condition_names(ids, speed, pressure), strict=True))
    if group == "specimen":
        names = [recording.specimen or "" for recording in recordings]
    else:
        names = [str(recording.attributes.get(group, "")) for recording in recordings]
        if not any(names):
            raise InputError(_unknown_group(recordings, group))
    missing = [name for name, value in zip(ids, names, strict=True) if not value]
    if missing:
        raise DataError(_no_group(missing, len(ids), group))
    return dict(zip(ids, names, strict=True))


def window_groups(windows: WindowSet, group: str | Mapping[str, str]) -> Shaped[np.ndarray, " window"]:
    """Name of each window's group: by one of `GROUPS`, or by its recording's id as `recording_groups` gives it."""
    if isinstance(group, Mapping):
        missing = [name for name in np.unique(windows.recording_id).tolist() if name not in group]
        if missing:
            raise DataError(_no_group(missing, np.unique(windows.recording_id).size, "group"))
        return np.array([str(group[name]) for name in windows.recording_id.tolist()], dtype=np.str_)
    if group == "recording":
        return windows.recording_id
    if group == "condition":
        ids = windows.recording_id.tolist()
        return np.array(condition_names(ids, windows.speed, windows.discharge_pressure), dtype=np.str_)
    if group != "specimen":
        raise InputError(
            f"group {group!r} is none of {', '.join(GROUPS)}; an attribute of the recordings is given as "
            f'recording_groups(recordings, "{group}").'
        )
    if (windows.specimen == "").any():
        missing = sorted(set(windows.recording_id[windows.specimen == ""].tolist()))
        raise DataError(_no_group(missing, np.unique(windows.recording_id).size, group))
    return windows.specimen


def group_name(group: str | Mapping[str, str]) -> str:
    """What to call one group in a message."""
    return group if isinstance(group, str) else "group"


def stated_pressure(recording: Recording | StoredRecording) -> float:
    """Discharge pressure [Pa] that the condition or the attribute ``discharge_pressure`` states, or NaN."""
    if recording.condition is not None:
        return recording.condition.discharge_pressure
    try:
        return parse(str(recording.attributes["discharge_pressure"]), "Pa")
    except (KeyError, UnitError):
        return math.nan


def condition_names(ids: Sequence[str], speed: Float[np.ndarray, " n"], pressure: Float[np.ndarray, " n"]) -> list[str]:
    """Name of each condition; speeds, and pressures, that follow each other closely are the same.

    Parameters
    ----------
    ids : recordings, for messages.
    speed : angular speed [rad/s], NaN where not stated.
    pressure : discharge pressure [Pa], NaN where not stated.
    """
    parts = []
    for fact, values, tolerance, scale, unit in (
        ("speed", speed, _SPEED_TOLERANCE, 30 / math.pi, "rev/min"),
        ("pressure", pressure, PRESSURE_TOLERANCE, 1e-6, "MPa"),
    ):
        unknown = np.isnan(values)
        if unknown.all():
            continue
        if unknown.any():
            raise DataError(
                f"{ids[int(np.flatnonzero(unknown)[0])]} states no {fact} and {ids[int(np.flatnonzero(~unknown)[0])]} "
                f"does, so nobody can say whether their conditions are one; complete the index."
            )
        parts.append([f"{level * scale:.4g} {unit}" for level in merge_close_values(values, tolerance)])
    if not parts:
        raise DataError(
            f"{ids[0]} has no condition written down (no speed, no discharge_pressure), nor has any other, so they "
            "cannot be split by it; add speed to the index."
        )
    return [", ".join(part) for part in zip(*parts, strict=True)]


def _unknown_group(recordings: Sequence[Recording | StoredRecording], group: str) -> str:
    counts = Counter(name for recording in recordings for name in recording.attributes)
    shared = sorted(name for name, count in counts.items() if count == len(recordings))
    near = get_close_matches(group, [*GROUPS, *shared], n=1)
    known = f"did you mean {near[0]!r}?" if near else f"there are {', '.join([*GROUPS, *shared])}."
    return f"no recording has the attribute {group!r}; {known}"


def _no_group(missing: Sequence[str], count: int, group: str) -> str:
    more = f" and {len(missing) - 1} more of {count}" if len(missing) > 1 else ""
    have = "has" if len(missing) == 1 else "have"
    return f"{missing[0]}{more} {have} no {group} written down, so nothing can be split by it; complete the index."
