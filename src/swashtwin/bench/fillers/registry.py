"""The fillers that need measured windows alone, by name."""

from swashtwin.bench.fillers.cvae import CVAE
from swashtwin.bench.fillers.diffusion import Diffusion
from swashtwin.bench.fillers.wgan_gp import WGANGP
from swashtwin.synthesis import ADASYN, SMOTE, Duplicate, Filler, Jitter, NoisyDuplicate

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
