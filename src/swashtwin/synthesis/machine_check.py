"""Whether a twin and recordings are of the same kind of pump at the same operating point."""

import math
from collections.abc import Sequence

import numpy as np

from swashtwin.calibration import detect_speed
from swashtwin.foundation import InputError
from swashtwin.learning import WindowSet, require_matching_values
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, is_healthy
from swashtwin.recordings import Recording, specified_pressure, specified_shaft_frequency

_EXAMINED = 3
"""Recordings whose lines are looked at, healthy ones first."""
_LEAST_TURNS = 12
"""Turns of the shaft that a recording needs for its lines to be told apart."""
_WHOLE = 0.03
"""How far a count of pistons may lie from a whole number."""


def require_same_machine(
    twin: Twin,
    conditions: Sequence[OperatingCondition],
    like: WindowSet | Sequence[Recording],
    *,
    speed: bool = True,
    pressure: bool = True,
) -> tuple[str, ...]:
    """What cannot be known about whether a twin is of the pump that was measured, in sentences.

    Speeds and pressures of the `conditions` of use are compared where recordings state them, unless
    `speed` or `pressure` is False; the number of pistons where they have the attribute ``pistons``,
    and else as their lines show it. Windows are too short to show it.

    Raises
    ------
    InputError
        The twin has another number of pistons, another speed or another pressure than every
        recording.
    """
    if isinstance(like, WindowSet):
        measured = ~like.synthetic
        speeds, pressures = like.speed[measured], like.discharge_pressure[measured]
        notes: list[str] = []
    else:
        speeds = np.array(
            [(specified_shaft_frequency(recording) or math.nan) * 2 * math.pi for recording in like]
        )
        pressures = np.array([specified_pressure(recording) for recording in like])
        notes = _refuse_other_pistons(twin, conditions[0], like)
    for quantity, is_checked, simulated, stated in (
        ("speed", speed, [condition.speed for condition in conditions], speeds),
        (
            "pressure",
            pressure,
            [condition.discharge_pressure for condition in conditions],
            pressures,
        ),
    ):
        if is_checked:
            remedy = f"calibrate a twin on these recordings, or name the {quantity} that you want windows at"
            require_matching_values(
                np.array(simulated), stated, quantity=quantity, who="the twin runs", remedy=remedy
            )
            if np.isnan(stated).all():
                notes.append(
                    f"the recordings state no {quantity}; that it is the twin's cannot be known"
                )
    return tuple(notes)


def _refuse_other_pistons(
    twin: Twin, condition: OperatingCondition, recordings: Sequence[Recording]
) -> list[str]:
    """What cannot be known of the number of pistons; an error where it is another than the
    twin's.
    """
    count, pump = twin.pump.rotating_group.piston_count, twin.pump.name
    remedy = "calibrate a twin of that pump, or give recordings of this one"
    for recording in recordings:
        stated = str(recording.attributes.get("pistons", ""))
        if stated.isdecimal() and int(stated) != count:
            raise InputError(
                f"{recording.recording_id} is of a pump with {stated} pistons, the twin ({pump}) has {count}; {remedy}."
            )
    if all(str(recording.attributes.get("pistons", "")).isdecimal() for recording in recordings):
        return []
    contradiction = ""
    for recording in sorted(recordings, key=lambda item: not is_healthy(item.label))[:_EXAMINED]:
        shaft = specified_shaft_frequency(recording) or condition.shaft_frequency
        if recording.duration * shaft < _LEAST_TURNS:
            continue
        shown = detect_speed(recording, shaft, count)
        if shown.is_clear and not shown.contradicts:
            return []
        if shown.contradicts and not contradiction:
            spacing, pistons = shown.shown * count, shown.shown * count / shaft
            lines = (
                f"{recording.recording_id} has piston-pass lines at multiples of {spacing:.4g} Hz"
            )
            if (
                specified_shaft_frequency(recording)
                and abs(pistons - round(pistons)) <= _WHOLE * pistons
            ):
                lines += f", those of {round(pistons)} pistons at {60 * shaft:.4g} rev/min"
            contradiction = f"{lines}, and the twin ({pump}) with its {count} at multiples of {count * shaft:.4g} Hz"
    if contradiction:
        raise InputError(f"{contradiction}; {remedy}.")
    return [
        f"the recordings' lines do not show how many pistons the pump has; that it has {count} cannot be known"
    ]
