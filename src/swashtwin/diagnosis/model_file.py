"""Saved models of every kind."""

from pathlib import Path

from swashtwin.diagnosis.anomaly_detector import AnomalyDetector
from swashtwin.diagnosis.fault_classifier import FaultClassifier
from swashtwin.diagnosis.prior_classifier import PriorClassifier
from swashtwin.foundation import artifact_kind


def load_model(path: Path | str) -> FaultClassifier | AnomalyDetector | PriorClassifier:
    """The model in a file, or the shipped prior of a design, such as ``"25scy14-1b"``.

    Raises
    ------
    MissingFileError
        There is no such file.
    InputError
        No prior of this design is shipped.
    ArtifactError
        The file is damaged, edited, no model, of another version, or its network is not registered.
    """
    kind = artifact_kind(path)
    if kind == AnomalyDetector.KIND:
        return AnomalyDetector.load(path)
    if kind == PriorClassifier.KIND or not Path(path).suffix:
        return PriorClassifier.load(path)
    return FaultClassifier.load(path)
