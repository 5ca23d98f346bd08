"""Check that a twin and recordings are of the same kind of pump at the same operating point."""

import math
from collections.abc import Sequence

import numpy as np

from swashtwin.calibration import detect_speed
from swashtwin.foundation import InputError
from swashtwin.learning import WindowSet, require_matching_values
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, is_healthy
from swashtwin.recordings import Recording, specified_pressure, specified_shaft_frequency

# Recordings whose lines are examined, healthy ones first.
_MAX_EXAMINED = 3

# Turns of the shaft that a recording needs for its lines to be separated.
_MIN_TURNS = 12

# Relative deviation of a piston count from a whole number.
_PISTON_COUNT_TOLERANCE = 0.03


def require_same_machine(
    twin: Twin,
    conditions: Sequence[OperatingCondition],
    like: WindowSet | Sequence[Recording],
    *,
    speed: bool = True,
    pressure: bool = True,
) -> tuple[str, ...]:
    """Require that a twin is of the pump that was measured; return what cannot be checked.

    Speeds and pressures of the `conditions` of use are compared with those that the recordings
    specify. The number of pistons is compared with the attribute ``pistons`` if all recordings have
    it, and else with their lines. Windows are too short for that.

    Parameters
    ----------
    conditions : operating points of the windows that are to be made.
    like : measured windows, or recordings.
    speed, pressure : whether to compare speeds and pressures.

    Returns
    -------
    notes : sentences.

    Raises
    ------
    InputError
        The twin has another number of pistons, another speed or another pressure than every
        recording.
    """
    notes: list[str] = []
    if isinstance(like, WindowSet):
        is_measured = ~like.synthetic
        speeds = like.speed[is_measured]
        pressures = like.discharge_pressure[is_measured]
    else:
        frequencies = [specified_shaft_frequency(recording) or math.nan for recording in like]
        speeds = np.array(frequencies) * 2 * math.pi
        pressures = np.array([specified_pressure(recording) for recording in like])
        notes = _check_pistons(twin, conditions[0], like)

    if speed:
        twin_speeds = np.array([condition.speed for condition in conditions])
        notes += _check_quantity("speed", twin_speeds, speeds)
    if pressure:
        twin_pressures = np.array([condition.discharge_pressure for condition in conditions])
        notes += _check_quantity("pressure", twin_pressures, pressures)
    return tuple(notes)


def _check_quantity(quantity: str, simulated: np.ndarray, measured: np.ndarray) -> list[str]:
    """Require a common speed or pressure; return a note if the recordings specify none."""
    require_matching_values(
        simulated,
        measured,
        quantity=quantity,
        subject="the twin runs",
        remedy=f"Calibrate a twin on these recordings, or set {{{quantity}}} to that of the "
        "windows you want.",
    )
    if np.isnan(measured).all():
        return [f"The recordings specify no {quantity}, so that of the twin cannot be checked."]
    return []


def _check_pistons(
    twin: Twin, condition: OperatingCondition, recordings: Sequence[Recording]
) -> list[str]:
    """Require the twin's number of pistons; return a note if the recordings do not show theirs."""
    count = twin.pump.rotating_group.piston_count
    specified_counts = [str(recording.attributes.get("pistons", "")) for recording in recordings]
    for recording, specified in zip(recordings, specified_counts, strict=True):
        if specified.isdecimal() and int(specified) != count:
            raise InputError(
                f"{recording.recording_id} is of a pump with {specified} pistons, the twin "
                f"({twin.pump.name}) has {count}. {_OTHER_PUMP_REMEDY}"
            )
    if all(specified.isdecimal() for specified in specified_counts):
        return []

    contradiction = ""
    healthy_first = sorted(recordings, key=lambda recording: not is_healthy(recording.label))
    for recording in healthy_first[:_MAX_EXAMINED]:
        shaft_frequency = specified_shaft_frequency(recording) or condition.shaft_frequency
        if recording.duration * shaft_frequency < _MIN_TURNS:
            continue

        detected = detect_speed(recording, shaft_frequency, count)
        if detected.is_clear and not detected.contradicts:
            return []
        if detected.contradicts and not contradiction:
            line_spacing = detected.detected * count
            contradiction = _describe_contradiction(recording, twin, line_spacing, shaft_frequency)

    if contradiction:
        raise InputError(f"{contradiction}. {_OTHER_PUMP_REMEDY}")
    return [
        "The lines of the recordings do not show the number of pistons, so that of the twin "
        f"({count}) cannot be checked."
    ]


_OTHER_PUMP_REMEDY = "Calibrate a twin of that pump, or give recordings of this one."


def _describe_contradiction(
    recording: Recording, twin: Twin, line_spacing: float, shaft_frequency: float
) -> str:
    """Describe the piston-pass lines [Hz] that a recording has and those that it should have."""
    count = twin.pump.rotating_group.piston_count
    text = f"{recording.recording_id} has piston-pass lines at multiples of {line_spacing:.4g} Hz"

    pistons = line_spacing / shaft_frequency
    is_whole = abs(pistons - round(pistons)) <= _PISTON_COUNT_TOLERANCE * pistons
    if specified_shaft_frequency(recording) and is_whole:
        text += f", those of {round(pistons)} pistons at {60 * shaft_frequency:.4g} rev/min"
    return (
        f"{text}, and the twin ({twin.pump.name}) with its {count} at multiples of "
        f"{count * shaft_frequency:.4g} Hz"
    )
