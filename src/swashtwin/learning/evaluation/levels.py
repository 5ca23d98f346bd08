"""How far the test data lie from the training data: stated beside every score."""

from collections.abc import Iterable

from swashtwin.learning.training.training_reference import TrainingReference
from swashtwin.pump import PRESSURE_TOLERANCE, SPEED_TOLERANCE, values_match
from swashtwin.recordings import Recording

LEVELS = {
    "L0": "random windows of known recordings: a diagnosis of the leak, never a headline",
    "L1": "later time of the same recording, behind a guard gap: optimistic",
    "L2": "another recording of the same specimen and condition",
    "L3": "another condition: a pressure or speed that was held out",
    "L4": "another specimen: a pump, bearing or actuator that was held out",
    "L5": "synthetic to measured: no measured window of that class (and condition) in training",
}
"""Meaning of each level of generalization, nearest first."""


def level_between(reference: TrainingReference, recordings: Iterable[Recording]) -> str | None:
    """Level of whole recordings that had no part in the training: ``"L2"``, ``"L3"`` or ``"L4"``.

    None where they are of several levels, or the machine of a recording is not stated.
    """
    levels = set()
    for recording in recordings:
        if recording.specimen is None or not any(reference.specimen):
            return None
        same = [number for number, name in enumerate(reference.specimen) if name == recording.specimen]
        condition = recording.condition
        if not same:
            levels.add("L4")
        elif condition is None:
            levels.add("L2")
        else:
            speed, pressure = reference.condition[same].T
            is_trained = values_match(speed, condition.speed, SPEED_TOLERANCE) & values_match(
                pressure, condition.discharge_pressure, PRESSURE_TOLERANCE
            )
            levels.add("L2" if is_trained.any() else "L3")
    return levels.pop() if len(levels) == 1 else None
