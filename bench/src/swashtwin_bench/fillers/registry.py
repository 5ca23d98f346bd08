"""The fillers that the studies compare, by name."""

from swashtwin_bench.fillers.cvae import CVAE
from swashtwin_bench.fillers.duplicates import Duplicate
from swashtwin_bench.fillers.filler import FILLERS, Filler, register_filler
from swashtwin_bench.fillers.interpolation import ADASYN, SMOTE
from swashtwin_bench.fillers.wgan_gp import WGANGP

__all__ = ["FILLERS"]

_fillers: dict[str, Filler] = {
    "duplicate": Duplicate(),
    "smote": SMOTE(),
    "adasyn": ADASYN(),
    "cvae": CVAE(),
    "wgan_gp": WGANGP(),
}
for _name, _filler in _fillers.items():
    register_filler(_name, _filler)
