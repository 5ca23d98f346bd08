"""From windows to a fitted classifier: `fit`, its settings, and checkpoints that continue bit for bit."""

from swashtwin.training.classifier import FittedClassifier
from swashtwin.training.confidence import Confidence, require_enough, softened
from swashtwin.training.known import KnownRecordings, known_recordings
from swashtwin.training.loop import fit
from swashtwin.training.normalization import Normalization
from swashtwin.training.settings import PAPER_TRAINING, RECOMMENDED_TRAINING, Epoch, TrainingSettings

__all__ = [
    "PAPER_TRAINING",
    "RECOMMENDED_TRAINING",
    "Confidence",
    "Epoch",
    "FittedClassifier",
    "KnownRecordings",
    "Normalization",
    "TrainingSettings",
    "fit",
    "known_recordings",
    "require_enough",
    "softened",
]
