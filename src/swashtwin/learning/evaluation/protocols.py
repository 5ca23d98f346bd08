"""What can be evaluated, which recordings may test it, and how far these lie from the training."""

from collections.abc import Iterable, Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from swashtwin.foundation import DataError, LeakError
from swashtwin.learning.training.training_reference import TrainingReference
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.pump import PRESSURE_TOLERANCE, SPEED_TOLERANCE, values_match
from swashtwin.recordings import Manifest, Recording, manifest_of, say_seen, seen_recordings


@runtime_checkable
class Classifier(Protocol):
    """What can be evaluated: a fitted network, or anything that answers like one."""

    @property
    def classes(self) -> tuple[str, ...]:
        """Class names, in the order of the probabilities."""

    @property
    def manifest(self) -> Manifest | tuple[str, ...]:
        """Every recording that had a part in it: by id with the hashes of its content, or ids alone."""

    def predict_proba(self, windows: WindowSet) -> np.ndarray:
        """Probability of each class for each window."""


def unseen_recordings(
    manifest: Manifest | Iterable[str], recordings: Sequence[Recording]
) -> tuple[list[Recording], dict[str, str]]:
    """Measured recordings that had no part in a model, in their order, and those that had (`seen_recordings`).

    Each is read once for its content.

    Parameters
    ----------
    manifest : of the model.

    Raises
    ------
    DataError
        Every recording had a part in it.
    """
    measured = [recording for recording in recordings if not recording.synthetic]
    seen = seen_recordings(manifest, manifest_of(measured))
    unseen = [recording for recording in measured if recording.recording_id not in seen]
    if not unseen:
        raise DataError(
            f"all {len(recordings)} recordings had a part in the model (its manifest); test on others, or train "
            "with a share held out."
        )
    return unseen, seen


def refuse_seen(classifier: Classifier, recordings: Manifest) -> None:
    """Raise a `LeakError` that names a recording that had a part in the classifier, if there is one."""
    if seen := seen_recordings(classifier.manifest, recordings):
        raise LeakError(f"{say_seen(seen)} had a part in the classifier (its manifest); test on others.")


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
