"""Healthy recordings of machines that a classifier has not heard, made known to it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from swashtwin.diagnosis.diagnosing import recording_probability, require_layout
from swashtwin.diagnosis.reasons import called_faulty
from swashtwin.foundation import DataError, InputError
from swashtwin.learning import FittedClassifier, cut_windows
from swashtwin.pump import is_healthy
from swashtwin.recordings import Recording

_SEVERAL = 0.25
"""Share of a machine's healthy recordings called faulty from which a note says so."""


def make_known(classifier: FittedClassifier, healthy: Sequence[Recording]) -> tuple[FittedClassifier, tuple[str, ...]]:
    """(the classifier that compares with these healthy recordings too, notes on machines that it takes for faulty).

    Raises
    ------
    InputError
        The model compares with no healthy recordings, or one states no machine or is labeled faulty.
    DataError
        A machine has a single one; or they have another sample rate, other channels or another unit, or are unfit.
    """
    if classifier.recordings is None or classifier.recordings.on_changes is None:
        raise InputError(
            "the model compares with no healthy recordings: its network was named, its recordings were short, or a "
            "machine of its training has not two healthy ones; train it again, or leave the healthy recordings out.",
            field="healthy",
        )
    for recording in healthy:
        require_layout(classifier.layout, recording)
        if not recording.specimen:
            raise InputError(
                f"{recording.recording_id} states no machine, so nothing can be compared with it; state it (specimen) "
                "in the index.",
                field="healthy",
            )
        if recording.label is not None and not is_healthy(recording.label):
            raise InputError(
                f"{recording.recording_id} is labeled {recording.label} and is no healthy recording; leave it out.",
                field="healthy",
            )
    sound = [recording.relabeled(None) for recording in healthy]
    windows = cut_windows(sound, length=classifier.length, classes=classifier.classes, allow_partial_revolution=True)
    informed = classifier.with_healthy(windows)
    notes = []
    for name in dict.fromkeys(str(recording.specimen) for recording in sound):
        of_machine = [recording for recording in sound if recording.specimen == name]
        if informed.recordings is None or not informed.recordings.knows(name):
            raise DataError(
                f"{of_machine[0].recording_id} is the only healthy recording of {name}; two are needed at least to "
                "compare with."
            )
        alone = replace(classifier, recordings=replace(classifier.recordings, on_changes=None))
        labels = [
            classifier.classes[int(np.argmax(recording_probability(alone, recording)))] for recording in of_machine
        ]
        faulty = sum(not is_healthy(label) for label in labels)
        if faulty > _SEVERAL * len(labels):
            notes.append(called_faulty(name, faulty, len(labels)))
    return informed, tuple(notes)
