"""The fillers that need measured windows alone, by name."""

from swashtwin.augmentation.cvae import CVAE
from swashtwin.augmentation.diffusion import Diffusion
from swashtwin.augmentation.distortion import Jitter
from swashtwin.augmentation.duplicates import Duplicate, NoisyDuplicate
from swashtwin.augmentation.filler import Filler
from swashtwin.augmentation.interpolation import ADASYN, SMOTE
from swashtwin.augmentation.wgan_gp import WGANGP

FILLERS: dict[str, Filler] = {
    "duplicate": Duplicate(),
    "noisy_duplicate": NoisyDuplicate(),
    "jitter": Jitter(),
    "smote": SMOTE(),
    "smote_spectrum": SMOTE(space="spectrum"),
    "adasyn": ADASYN(),
    "adasyn_spectrum": ADASYN(space="spectrum"),
    "cvae": CVAE(),
    "wgan_gp": WGANGP(),
    "diffusion": Diffusion(),
}
"""Fillers with their default settings. Those with a twin are made with one: `TwinFiller`."""
