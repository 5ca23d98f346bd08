"""What a classifier must offer to be evaluated, and which recordings may test it."""

from collections.abc import Iterable, Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from swashtwin.foundation import DataError, LeakError
from swashtwin.learning.windows.window_set import WindowSet
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


def unseen_recordings(manifest: Manifest | Iterable[str], recordings: Sequence[Recording]) -> list[Recording]:
    """Measured recordings that had no part in a model, in their order; each is read once for its content.

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
    return unseen


def refuse_seen(classifier: Classifier, recordings: Manifest) -> None:
    """Raise a `LeakError` that names a recording that had a part in the classifier, if there is one."""
    if seen := seen_recordings(classifier.manifest, recordings):
        raise LeakError(f"{say_seen(seen)} had a part in the classifier (its manifest); test on others.")
