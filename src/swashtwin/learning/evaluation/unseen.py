"""Which recordings may test a classifier."""

from collections.abc import Sequence

from swashtwin.foundation import DataError, LeakError
from swashtwin.learning.evaluation.protocols import Classifier
from swashtwin.recordings import Manifest, Recording, manifest_of, say_seen, seen_recordings


def unseen_recordings(classifier: Classifier, recordings: Sequence[Recording]) -> list[Recording]:
    """Measured recordings that had no part in the classifier, in their order; each is read once for its content.

    Raises
    ------
    DataError
        Every recording had a part in it.
    """
    measured = [recording for recording in recordings if not recording.synthetic]
    seen = seen_recordings(classifier.manifest, manifest_of(measured))
    unseen = [recording for recording in measured if recording.recording_id not in seen]
    if not unseen:
        raise DataError(
            f"all {len(recordings)} recordings had a part in the classifier (its manifest); test on others, or train "
            "with a share held out."
        )
    return unseen


def refuse_seen(classifier: Classifier, recordings: Manifest) -> None:
    """Raise a `LeakError` that names a recording that had a part in the classifier, if there is one."""
    if seen := seen_recordings(classifier.manifest, recordings):
        raise LeakError(f"{say_seen(seen)} had a part in the classifier (its manifest); test on others.")
