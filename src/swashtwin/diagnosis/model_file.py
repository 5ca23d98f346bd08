"""A saved model of either kind: a classifier, or a detector that learned from healthy recordings alone."""

from pathlib import Path

from swashtwin.diagnosis.anomaly_detector import AnomalyDetector
from swashtwin.diagnosis.detector_file import KIND
from swashtwin.diagnosis.saving import load_classifier
from swashtwin.foundation import artifact_kind
from swashtwin.learning import FittedClassifier


def load_model(path: Path | str) -> FittedClassifier | AnomalyDetector:
    """The classifier or the detector in a file.

    Raises
    ------
    MissingFileError
        There is no such file.
    ArtifactError
        The file is damaged, edited, neither, of another version, or its network is not registered.
    """
    return AnomalyDetector.load(path) if artifact_kind(path) == KIND else load_classifier(path)
