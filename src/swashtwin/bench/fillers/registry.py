"""The fillers that the studies compare, by name."""

from swashtwin.bench.fillers.cvae import CVAE
from swashtwin.bench.fillers.diffusion import Diffusion
from swashtwin.bench.fillers.distortion import Jitter
from swashtwin.bench.fillers.duplicates import Duplicate, NoisyDuplicate
from swashtwin.bench.fillers.interpolation import ADASYN, SMOTE
from swashtwin.bench.fillers.wgan_gp import WGANGP
from swashtwin.synthesis import FILLERS, Filler, register_filler

__all__ = ["FILLERS"]

_fillers: dict[str, Filler] = {
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
for _name, _filler in _fillers.items():
    register_filler(_name, _filler)
