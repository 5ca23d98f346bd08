"""Groups of recordings that a split keeps whole."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import DataError, InputError, closest_name
from swashtwin.pump import PRESSURE_TOLERANCE, merge_close_values
from swashtwin.recordings.recording import Recording
from swashtwin.recordings.recording_facts import specified_pressure, specified_speed

GROUPS = ("recording", "specimen", "condition")
"""Groups of every data set: each gives one split (L2, L4, L3)."""
GROUP_SPEED_TOLERANCE = 0.03
"""Relative difference of speeds of the same operating point.

It is larger than elsewhere: operating points that are joined wrongly make a test harder, and
operating points that are separated wrongly make it leak.
"""


def recording_groups(recordings: Iterable[Recording], group: str) -> dict[str, str]:
    """Return the group of each recording by its id.

    It is the ``group=`` of `split_by_recording` and `group_folds`.

    Parameters
    ----------
    group : ``"recording"``, ``"specimen"``, ``"condition"`` (speed and discharge pressure, if
        specified), or the name of an attribute, such as ``"pump_run"``.

    Raises
    ------
    InputError
        No recording has such an attribute.
    DataError
        Only some recordings have it.

    Examples
    --------
    >>> day = {"a": "Monday", "b": "Friday"}
    >>> signal = np.ones((1, 4))
    >>> recordings = [Recording(signal, 10.0, name, attributes={"day": day[name]}) for name in day]
    >>> recording_groups(recordings, "day")
    {'a': 'Monday', 'b': 'Friday'}
    """
    recordings = list(recordings)
    ids = [recording.recording_id for recording in recordings]

    if group == "recording":
        names = ids
    elif group == "condition":
        speed = np.array([specified_speed(recording) for recording in recordings])
        pressure = np.array([specified_pressure(recording) for recording in recordings])
        names = name_conditions(ids, speed, pressure)
    elif group == "specimen":
        names = [recording.specimen or "" for recording in recordings]
    else:
        names = [str(recording.attributes.get(group, "")) for recording in recordings]
        if not any(names):
            raise unknown_attribute_error(recordings, group, GROUPS)

    ids_without_group = [name for name, value in zip(ids, names, strict=True) if not value]
    if ids_without_group:
        raise DataError(missing_group_message(ids_without_group, len(ids), group))
    return dict(zip(ids, names, strict=True))


def name_conditions(
    ids: Sequence[str], speed: Float[np.ndarray, " n"], pressure: Float[np.ndarray, " n"]
) -> list[str]:
    """Return the name of each recording's operating point.

    Speeds, and pressures, that follow each other closely are the same.

    Parameters
    ----------
    ids : recordings, for messages.
    speed : angular speed [rad/s], NaN if not specified.
    pressure : discharge pressure [Pa], NaN if not specified.
    """
    facts = (
        ("speed", speed, GROUP_SPEED_TOLERANCE, 30 / math.pi, "rev/min"),
        ("pressure", pressure, PRESSURE_TOLERANCE, 1e-6, "MPa"),
    )
    columns = []
    for name, values, tolerance, scale, unit in facts:
        is_missing = np.isnan(values)
        if is_missing.all():
            continue
        if is_missing.any():
            without = ids[int(np.flatnonzero(is_missing)[0])]
            with_value = ids[int(np.flatnonzero(~is_missing)[0])]
            raise DataError(
                f"{without} specifies no {name} and {with_value} does, so their operating points "
                "cannot be compared; complete the index."
            )
        merged = merge_close_values(values, tolerance)
        columns.append([f"{value * scale:.4g} {unit}" for value in merged])

    if not columns:
        raise DataError(
            f"{ids[0]} specifies no operating point (no speed, no discharge_pressure), nor does "
            "any other recording, so they cannot be split by it; add speed to the index."
        )
    return [", ".join(parts) for parts in zip(*columns, strict=True)]


def describe_conditions(
    ids: Sequence[str], speed: Sequence[float], pressure: Sequence[float]
) -> list[str]:
    """Return the names of `name_conditions` for recordings that may specify different facts.

    A recording that specifies neither speed nor pressure gets a dash.
    """
    facts = np.array([speed, pressure], dtype=np.float64)
    is_known = ~np.isnan(facts)
    names = ["-"] * len(ids)

    # Recordings with the same facts are compared among each other only.
    for pattern in ((True, True), (True, False), (False, True)):
        rows = np.flatnonzero((is_known == np.array(pattern)[:, None]).all(axis=0)).tolist()
        if not rows:
            continue
        group_names = name_conditions([ids[row] for row in rows], *facts[:, rows])
        for row, name in zip(rows, group_names, strict=True):
            names[row] = name
    return names


def missing_group_message(missing_ids: Sequence[str], count: int, group: str) -> str:
    """Return the message that some of `count` recordings do not specify a group."""
    first, *remaining = missing_ids
    subject = f"{first} specifies"
    if remaining:
        subject = f"{first} and {len(remaining)} more of {count} specify"
    return f"{subject} no {group}, so recordings cannot be split by it; complete the index."


def unknown_attribute_error(
    recordings: Sequence[Recording], name: str, further_names: Sequence[str]
) -> InputError:
    """Return the error that no recording has an attribute, with the nearest name.

    Parameters
    ----------
    further_names : names that are allowed besides the attributes that differ.
    """
    names = list(further_names)
    for key in dict.fromkeys(key for recording in recordings for key in recording.attributes):
        values = {recording.attributes.get(key) for recording in recordings}
        if len(values) > 1 and key not in ("file", "sha256"):  # these differ for all recordings
            names.append(key)

    suggestion = closest_name(name, names)
    hint = f"did you mean {suggestion!r}?" if suggestion else f"use one of {', '.join(names)}."
    return InputError(f"No recording has the attribute {name!r}; {hint}")
