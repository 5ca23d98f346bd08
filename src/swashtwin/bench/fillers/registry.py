"""The generative fillers, registered beside those of `synthesis`."""

from swashtwin.bench.fillers.cvae import CVAE
from swashtwin.bench.fillers.diffusion import Diffusion
from swashtwin.bench.fillers.wgan_gp import WGANGP
from swashtwin.synthesis import FILLERS, register_filler

__all__ = ["FILLERS"]

register_filler("cvae", CVAE())
register_filler("wgan_gp", WGANGP())
register_filler("diffusion", Diffusion())
