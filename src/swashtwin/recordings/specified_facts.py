"""Speed and pressure that recordings specify, in their operating point or their attributes."""

import math

from swashtwin.foundation import DataError, UnitError, parse_quantity
from swashtwin.recordings.recording import Recording


def specified_shaft_frequency(recording: Recording) -> float | None:
    """Return the shaft frequency [Hz] of a recording, or None if it specifies none.

    It is that of the operating point or of the attribute ``speed``. For a recording along the
    shaft's angle it is the frequency at which the turns are played back.

    Raises
    ------
    DataError
        A recording along the shaft's angle does not specify its samples per turn.
    """
    if recording.attributes.get("domain") == "angle":
        return recording.sample_rate / _samples_per_turn(recording)
    if recording.condition is not None:
        return recording.condition.shaft_frequency

    try:
        return parse_quantity(recording.attributes["speed"], "rad/s") / (2 * math.pi)
    except (KeyError, UnitError):
        return None


def _samples_per_turn(recording: Recording) -> float:
    text = recording.attributes.get("samples_per_turn")
    try:
        samples_per_turn = float(text or 0)
    except ValueError:
        samples_per_turn = 0.0

    if not 0 < samples_per_turn < math.inf:
        raise DataError(
            f"{recording.recording_id} runs along the shaft's angle, but its samples_per_turn "
            f"({text!r}) is not a positive number; specify it in the index, such as "
            'attributes = { samples_per_turn = "512" }.'
        )
    return samples_per_turn


def specified_speed(recording: Recording) -> float:
    """Return the angular speed of the shaft [rad/s], NaN if a recording specifies none."""
    return (specified_shaft_frequency(recording) or math.nan) * 2 * math.pi


def specified_pressure(recording: Recording) -> float:
    """Return the discharge pressure [Pa], NaN if a recording specifies none.

    It is that of the operating point or of the attribute ``discharge_pressure``.
    """
    if recording.condition is not None:
        return recording.condition.discharge_pressure

    try:
        return parse_quantity(str(recording.attributes["discharge_pressure"]), "Pa")
    except (KeyError, UnitError):
        return math.nan
