"""Points (machine and operating point) of recordings, and the point that a recording matches."""

import math
from collections.abc import Sequence

from swashtwin.foundation import DataError
from swashtwin.pump import PRESSURE_TOLERANCE, SPEED_TOLERANCE, values_match
from swashtwin.recordings import Recording, specified_pressure, specified_shaft_frequency

Point = tuple[str | float | None, ...]
"""Specimen, speed [rad/s] and pressure [Pa]; None for what is not specified."""

# Facts of a point, and the relative difference up to which two are the same.
_FACTS = (("specimen", 0.0), ("speed", SPEED_TOLERANCE), ("pressure", PRESSURE_TOLERANCE))

# Index of the speed among the facts.
_SPEED = 1

MAX_LISTED = 6
"""Points that a message lists."""


def specified_point(recording: Recording) -> tuple[float, float]:
    """Return the speed [rad/s] and pressure [Pa] that a recording specifies, else NaN."""
    shaft = specified_shaft_frequency(recording) or math.nan
    # A condition may hold numbers of single precision, which are not instances of float.
    return float(2 * math.pi * shaft), float(specified_pressure(recording))


def point_key(specimen: str, speed: float, pressure: float) -> Point:
    """Return the point of a specimen (empty if not specified), speed and pressure (else NaN)."""
    return (
        specimen or None,
        None if math.isnan(speed) else speed,
        None if math.isnan(pressure) else pressure,
    )


def match_point(recording: Recording, points: Sequence[Point]) -> tuple[int, tuple[str, ...]]:
    """Return the index of a recording's point, and notes on what the recording does not specify.

    If no point has the recording's value of a fact, a point that does not specify the fact matches;
    a fact that the recording does not specify matches every point.

    Raises
    ------
    DataError
        No point matches, or several do.
    """
    recorded = point_key(recording.specimen or "", *specified_point(recording))
    candidates = list(range(len(points)))
    missing_facts = []
    for fact, (noun, tolerance) in enumerate(_FACTS):
        value = recorded[fact]
        matches = [
            index for index in candidates if _values_agree(points[index][fact], value, tolerance)
        ]
        if not matches:
            matches = [
                index for index in candidates if value is None or points[index][fact] is None
            ]
        if not matches:
            raise _no_match(fact, value, [points[index] for index in candidates])
        candidates = matches
        if value is None and any(points[index][fact] is not None for index in candidates):
            missing_facts.append(noun)

    missing_text = " and ".join(missing_facts)
    if len(candidates) > 1:
        listed = "; ".join(describe_point(points[index]) for index in candidates[:MAX_LISTED])
        raise DataError(
            f"Healthy recordings are of {len(candidates)} machines and operating points "
            f"({listed}), and {recording.recording_id} does not specify its {missing_text}.",
            remedy=f"Specify the {missing_text} of the recording, in the index or for the file.",
        )
    if not missing_facts:
        return candidates[0], ()
    assumed = describe_point(points[candidates[0]])
    return candidates[0], (f"It does not specify its {missing_text}; {assumed} was assumed.",)


def describe_point(point: Point) -> str:
    """Return a label such as ``A, 1200 rev/min, 10 MPa``."""
    facts = [_format_fact(fact, value) for fact, value in enumerate(point) if value is not None]
    return ", ".join(facts) or "no operating point specified"


def _values_agree(first: str | float | None, second: str | float | None, tolerance: float) -> bool:
    if isinstance(first, float) and isinstance(second, float):
        return bool(values_match(first, second, tolerance))
    return first == second


def _no_match(fact: int, value: str | float | None, points: Sequence[Point]) -> DataError:
    """Return the error that no healthy recording has the value of a fact."""
    preposition = "of" if fact == 0 else "at the"
    recorded = dict.fromkeys(_format_fact(fact, point[fact]) for point in points)
    return DataError(
        f"No healthy recording is {preposition} {_FACTS[fact][0]} {_format_fact(fact, value)} "
        f"(recorded: {', '.join(recorded)}), so this one cannot be compared."
    )


def _format_fact(fact: int, value: str | float | None) -> str:
    if value is None or isinstance(value, str):
        return value or ""
    if fact == _SPEED:
        return f"{value * 30 / math.pi:.4g} rev/min"
    return f"{value / 1e6:.3g} MPa"
