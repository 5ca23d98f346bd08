"""Loading of a saved model of any kind."""

from pathlib import Path
from typing import TYPE_CHECKING

from swashtwin.foundation import artifact_kind, as_path

if TYPE_CHECKING:
    from swashtwin.diagnosis.anomaly_detector import AnomalyDetector
    from swashtwin.diagnosis.fault_classifier import FaultClassifier
    from swashtwin.diagnosis.prior_classifier import PriorClassifier


def load_model(path: Path | str) -> "FaultClassifier | AnomalyDetector | PriorClassifier":
    """Return the model in a file, or the shipped prior of a design, such as ``"25scy14-1b"``.

    Raises
    ------
    MissingFileError
        The file does not exist.
    InputError
        No prior of this design is shipped.
    ArtifactError
        The file is damaged, edited, not a model, of another version, or its network is not
        registered.
    """
    kind = artifact_kind(as_path(path))

    # A kind of model is imported when one is loaded: they need different parts of the package.
    if kind == "anomaly detector":
        from swashtwin.diagnosis.anomaly_detector import AnomalyDetector

        return AnomalyDetector.load(path)

    if kind == "prior classifier" or not Path(path).suffix:
        from swashtwin.diagnosis.prior_classifier import PriorClassifier

        return PriorClassifier.load(path)

    from swashtwin.diagnosis.fault_classifier import FaultClassifier

    return FaultClassifier.load(path)
