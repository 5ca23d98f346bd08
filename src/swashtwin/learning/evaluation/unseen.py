"""Which recordings may test a classifier."""

from collections.abc import Sequence

from swashtwin.foundation import DataError
from swashtwin.learning.evaluation.protocols import Classifier
from swashtwin.recordings import Recording


def unseen_recordings(classifier: Classifier, recordings: Sequence[Recording]) -> list[Recording]:
    """Measured recordings that had no part in the classifier, in their order.

    Raises
    ------
    DataError
        Every recording had a part in it.
    """
    seen = set(classifier.manifest)
    unseen = [recording for recording in recordings if recording.recording_id not in seen and not recording.synthetic]
    if not unseen:
        raise DataError(
            f"all {len(recordings)} recordings had a part in the classifier (its manifest); test on others, or train "
            "with a share held out."
        )
    return unseen
