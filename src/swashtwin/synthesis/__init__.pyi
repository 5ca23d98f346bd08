"""Names that other rooms import, and where each lives."""

from .background import Background as Background
from .distortion import Jitter as Jitter
from .duplicates import Duplicate as Duplicate
from .duplicates import NoisyDuplicate as NoisyDuplicate
from .duplicates import drawn_from as drawn_from
from .fidelity import copied_share as copied_share
from .fidelity import discriminative_score as discriminative_score
from .fidelity import spectral_distance as spectral_distance
from .filler import Filler as Filler
from .filler import filled_cell as filled_cell
from .filler import in_cell as in_cell
from .filler import require_count as require_count
from .filler import sources_of as sources_of
from .interpolation import ADASYN as ADASYN
from .interpolation import SMOTE as SMOTE
from .interpolation import NoNeighborsError as NoNeighborsError
from .interpolation import oversampler as oversampler
from .log_spectra import SpectralForm as SpectralForm
from .periodic_extension import ring_length as ring_length
from .periodic_extension import rings_of as rings_of
from .periodic_extension import windows_of as windows_of
from .twin_filler import TwinFiller as TwinFiller
from .twin_windows import synthesize as synthesize
from .variation import DEFAULT_VARIATION as DEFAULT_VARIATION
from .variation import Variation as Variation
from .variation import drawn as drawn

__all__ = [
    "ADASYN",
    "DEFAULT_VARIATION",
    "SMOTE",
    "Background",
    "Duplicate",
    "Filler",
    "Jitter",
    "NoNeighborsError",
    "NoisyDuplicate",
    "SpectralForm",
    "TwinFiller",
    "Variation",
    "copied_share",
    "discriminative_score",
    "drawn",
    "drawn_from",
    "filled_cell",
    "in_cell",
    "oversampler",
    "require_count",
    "ring_length",
    "rings_of",
    "sources_of",
    "spectral_distance",
    "synthesize",
    "windows_of",
]
