"""The fillers that studies compare, by name."""

from collections.abc import Mapping
from types import MappingProxyType

from swashtwin_bench.fillers.duplicates import Duplicate, NoisyDuplicate
from swashtwin_bench.fillers.filler import Filler
from swashtwin_bench.fillers.generative import CVAE, WGANGP
from swashtwin_bench.fillers.interpolation import ADASYN, SMOTE

FILLERS: Mapping[str, Filler] = MappingProxyType(
    {
        "duplicate": Duplicate(),
        "noisy_duplicate": NoisyDuplicate(),
        "smote": SMOTE(),
        "adasyn": ADASYN(),
        "cvae": CVAE(),
        "wgan_gp": WGANGP(),
    }
)
"""Fillers by name."""
