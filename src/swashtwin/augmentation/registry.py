"""The fillers that need measured windows alone, by name."""

from swashtwin.augmentation.distortion import Jitter
from swashtwin.augmentation.duplicates import Duplicate, NoisyDuplicate
from swashtwin.augmentation.filler import Filler
from swashtwin.augmentation.interpolation import ADASYN, SMOTE

FILLERS: dict[str, Filler] = {
    "duplicate": Duplicate(),
    "noisy_duplicate": NoisyDuplicate(),
    "jitter": Jitter(),
    "smote": SMOTE(),
    "smote_spectrum": SMOTE(space="spectrum"),
    "adasyn": ADASYN(),
    "adasyn_spectrum": ADASYN(space="spectrum"),
}
"""Fillers with their default settings. Those with a twin are made with one: `TwinFiller`."""
