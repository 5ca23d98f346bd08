"""How well virtual pumps separate two faults, and which further measurement would separate them."""

from collections.abc import Sequence
from dataclasses import dataclass

MIN_SENSOR_GAIN = 0.1
"""Gain in accuracy from which on a further sensor is named; three standard errors of the study."""
MIN_POINT_GAIN = 0.05
"""Gain over a repeated recording from which on another pressure or speed is named."""
MIN_SEPARATED = 0.9
"""Accuracy with a second recording from which on it separates two faults."""


@dataclass(frozen=True)
class FaultSeparation:
    """Share of recordings of two faults that virtual pumps name right of the two.

    Of 120 virtual pumps that no prior holds, half of them of random design (n = 240 for two faults,
    standard error 0.03): `benchmarks/fault_separation.py`, docs/bench/evidence.md.
    """

    cover_z: float
    """With this sensor alone."""
    body_y: float
    """With this sensor alone."""
    body_x: float
    """With this sensor alone."""
    all_sensors: float
    """With the three sensors."""
    repeated: float
    """With the three sensors and a second recording at the same operating point."""
    other_pressure: float
    """With the three sensors and a second recording at another pressure."""
    other_speed: float
    """With the three sensors and a second recording at another speed."""

    def accuracy(self, channels: Sequence[str]) -> float:
        """Return the accuracy with the sensors of a machine; two count as all three."""
        if len(channels) > 1:
            return self.all_sensors
        return float(getattr(self, channels[0]))


_SEPARATIONS = {
    ("swash_plate", "cylinder_block"): FaultSeparation(0.80, 0.79, 0.67, 0.83, 0.84, 0.84, 0.85),
    ("swash_plate", "piston"): FaultSeparation(0.82, 0.84, 0.68, 0.85, 0.87, 0.88, 0.88),
    ("swash_plate", "valve_plate"): FaultSeparation(0.89, 0.88, 0.67, 0.89, 0.90, 0.92, 0.90),
    ("cylinder_block", "piston"): FaultSeparation(0.70, 0.72, 0.56, 0.73, 0.77, 0.76, 0.75),
    ("cylinder_block", "valve_plate"): FaultSeparation(0.96, 0.90, 0.83, 0.93, 0.96, 0.96, 0.95),
    ("piston", "valve_plate"): FaultSeparation(0.95, 0.95, 0.79, 0.96, 0.97, 0.97, 0.95),
}
_SENSORS = ("cover_z", "body_y", "body_x")


def describe_separation(candidates: Sequence[str], channels: Sequence[str]) -> str:
    """Return which measurement would separate the two likeliest candidates of a pump prior.

    Empty unless both are faults that the study compares, at its sensors.

    Parameters
    ----------
    candidates : classes between which the choice is open, likeliest first.
    channels : sensors of the machine.
    """
    if len(candidates) < 2 or not channels or not set(channels) <= set(_SENSORS):
        return ""
    pair = (candidates[0], candidates[1])
    separation = _SEPARATIONS.get(pair) or _SEPARATIONS.get((pair[1], pair[0]))
    if separation is None:
        return ""

    first, second = (name.replace("_", " ") for name in pair)
    accuracy = separation.accuracy(channels)
    text = f"Virtual pumps separate {first} and {second} in {_percent(accuracy)} of recordings"
    best_sensor = max(_SENSORS, key=lambda name: separation.accuracy([name]))
    best_accuracy = separation.accuracy([best_sensor])
    if best_accuracy >= accuracy + MIN_SENSOR_GAIN:
        return f"{text}; a sensor at {best_sensor} separates them in {_percent(best_accuracy)}."

    repeated = separation.repeated
    by_point = {"pressure": separation.other_pressure, "speed": separation.other_speed}
    best_point = max(by_point, key=by_point.__getitem__)
    best_accuracy = by_point[best_point]
    if best_accuracy >= repeated + MIN_POINT_GAIN:
        return f"{text}; a second one at another {best_point} gives {_percent(best_accuracy)}."
    if repeated >= MIN_SEPARATED:
        return f"{text}; a second one at the same operating point gives {_percent(repeated)}."
    return (
        f"{text}. No further sensor and no other pressure or speed does better than a repeated "
        f"recording ({_percent(repeated)}): check both parts."
    )


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"
