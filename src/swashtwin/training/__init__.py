"""From windows to a fitted classifier: `fit`, its settings, and checkpoints that continue bit for bit."""

from swashtwin.training.classifier import FittedClassifier
from swashtwin.training.loop import fit
from swashtwin.training.normalization import Normalization
from swashtwin.training.settings import PAPER_TRAINING, Epoch, TrainingSettings

__all__ = ["PAPER_TRAINING", "Epoch", "FittedClassifier", "Normalization", "TrainingSettings", "fit"]
