"""What a classifier must offer to be evaluated and to diagnose, and which recordings may test it."""

from collections.abc import Callable, Iterable, Sequence
from typing import Protocol, TypeVar, runtime_checkable

import numpy as np

from swashtwin.foundation import DataError, LeakError
from swashtwin.learning.training.confidence import Confidence
from swashtwin.learning.training.training_reference import TrainingReference
from swashtwin.learning.windows.window_set import WindowLayout, WindowSet
from swashtwin.recordings import Manifest, Recording, manifest_of, say_seen, seen_recordings

_Self = TypeVar("_Self", bound="DiagnosingClassifier")


@runtime_checkable
class Classifier(Protocol):
    """What can be evaluated: a fitted network, a fitted baseline, or anything that answers like one."""

    @property
    def classes(self) -> tuple[str, ...]:
        """Class names, in the order of the probabilities."""

    @property
    def manifest(self) -> Manifest | tuple[str, ...]:
        """Every recording that had a part in it: by id with the hashes of its content, or ids alone."""

    def predict_proba(self, windows: WindowSet) -> np.ndarray:
        """Probability of each class for each window."""


@runtime_checkable
class SureClassifier(Classifier, Protocol):
    """A classifier whose confidence can be calibrated: a fitted network, or fitted trees."""

    @property
    def training_reference(self) -> TrainingReference | None:
        """The recordings it was trained on."""

    @property
    def confidence(self) -> Confidence | None:
        """Its calibrated confidence; None where it was not calibrated."""

    def answer(self, windows: WindowSet) -> tuple[np.ndarray, np.ndarray]:
        """Probability of each class, and features, of each window."""


@runtime_checkable
class DiagnosingClassifier(SureClassifier, Protocol):
    """A classifier that can say of a recording whether it fits, and answer its windows in parts."""

    @property
    def layout(self) -> WindowLayout:
        """Sample rate, channels, unit and length that windows must have."""

    @property
    def pressures(self) -> tuple[float, ...]:
        """Discharge pressures it was trained at [Pa]."""

    @property
    def speeds(self) -> tuple[float, ...]:
        """Shaft speeds it was trained at [rad/s]."""

    def scaled_for(self: _Self, parts: Callable[[], Iterable[WindowSet]]) -> _Self:
        """The same classifier with the scaling of one recording."""


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
