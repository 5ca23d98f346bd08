"""Windows that nobody measured: made with a twin, or from measured windows alone."""

from swashtwin.augmentation.background import Background
from swashtwin.augmentation.distortion import Jitter
from swashtwin.augmentation.duplicates import Duplicate, NoisyDuplicate
from swashtwin.augmentation.filler import Filler
from swashtwin.augmentation.interpolation import ADASYN, SMOTE, NoNeighborsError
from swashtwin.augmentation.registry import FILLERS
from swashtwin.augmentation.synthesis import synthesize
from swashtwin.augmentation.twin_filler import TwinFiller
from swashtwin.augmentation.variation import DEFAULT_VARIATION, Variation, drawn

__all__ = [
    "ADASYN",
    "DEFAULT_VARIATION",
    "FILLERS",
    "SMOTE",
    "Background",
    "Duplicate",
    "Filler",
    "Jitter",
    "NoNeighborsError",
    "NoisyDuplicate",
    "TwinFiller",
    "Variation",
    "drawn",
    "synthesize",
]
