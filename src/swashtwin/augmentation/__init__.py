"""Windows that nobody measured: made with a twin, or from measured windows alone."""

from swashtwin.augmentation.background import Background
from swashtwin.augmentation.cvae import CVAE
from swashtwin.augmentation.diffusion import Diffusion
from swashtwin.augmentation.distortion import Jitter
from swashtwin.augmentation.duplicates import Duplicate, NoisyDuplicate
from swashtwin.augmentation.filler import Filler
from swashtwin.augmentation.interpolation import ADASYN, SMOTE, NoNeighborsError
from swashtwin.augmentation.likeness import (
    copied_share,
    discriminative_score,
    spectral_distance,
    train_synthetic_test_real,
)
from swashtwin.augmentation.registry import FILLERS
from swashtwin.augmentation.synthesis import synthesize
from swashtwin.augmentation.twin_filler import TwinFiller
from swashtwin.augmentation.variation import DEFAULT_VARIATION, Variation, drawn
from swashtwin.augmentation.wgan_gp import WGANGP

__all__ = [
    "ADASYN",
    "CVAE",
    "DEFAULT_VARIATION",
    "FILLERS",
    "SMOTE",
    "WGANGP",
    "Background",
    "Diffusion",
    "Duplicate",
    "Filler",
    "Jitter",
    "NoNeighborsError",
    "NoisyDuplicate",
    "TwinFiller",
    "Variation",
    "copied_share",
    "discriminative_score",
    "drawn",
    "spectral_distance",
    "synthesize",
    "train_synthetic_test_real",
]
