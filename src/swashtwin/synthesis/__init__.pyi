"""Names that other rooms import, and where each lives."""

from .background import Background as Background
from .distortion import Jitter as Jitter
from .duplicates import Duplicate as Duplicate
from .duplicates import NoisyDuplicate as NoisyDuplicate
from .duplicates import draw_indices as draw_indices
from .fidelity import Fidelity as Fidelity
from .fidelity import TellingFeature as TellingFeature
from .fidelity import copied_share as copied_share
from .fidelity import discriminative_score as discriminative_score
from .fidelity import measure_fidelity as measure_fidelity
from .fidelity import spectral_distance as spectral_distance
from .filler import Filler as Filler
from .filler import fill_cell as fill_cell
from .filler import in_cell as in_cell
from .filler import require_count as require_count
from .filler import sources_of as sources_of
from .interpolation import ADASYN as ADASYN
from .interpolation import SMOTE as SMOTE
from .interpolation import NoNeighborsError as NoNeighborsError
from .interpolation import oversampler as oversampler
from .log_spectra import SpectralForm as SpectralForm
from .machine_check import require_same_machine as require_same_machine
from .periodic_extension import cut_extensions as cut_extensions
from .periodic_extension import extension_length as extension_length
from .periodic_extension import periodic_extensions as periodic_extensions
from .pump_prior import OrderChanges as OrderChanges
from .pump_prior import PumpPrior as PumpPrior
from .pump_prior import plausible_fault as plausible_fault
from .pump_prior import simulate_changes as simulate_changes
from .registry import FILLERS as FILLERS
from .registry import has_filler as has_filler
from .registry import register_filler as register_filler
from .synthetic_windows import SyntheticWindows as SyntheticWindows
from .synthetic_windows import comparable_windows as comparable_windows
from .twin_filler import TwinFiller as TwinFiller
from .twin_windows import simulate_windows as simulate_windows
from .twin_windows import specimen_among as specimen_among
from .twin_windows import synthesize as synthesize
from .variation import DEFAULT_VARIATION as DEFAULT_VARIATION
from .variation import Variation as Variation
from .variation import draw_twin as draw_twin

__all__ = [
    "ADASYN",
    "DEFAULT_VARIATION",
    "FILLERS",
    "SMOTE",
    "Background",
    "Duplicate",
    "Fidelity",
    "Filler",
    "Jitter",
    "NoNeighborsError",
    "NoisyDuplicate",
    "OrderChanges",
    "PumpPrior",
    "SpectralForm",
    "SyntheticWindows",
    "TellingFeature",
    "TwinFiller",
    "Variation",
    "comparable_windows",
    "copied_share",
    "cut_extensions",
    "discriminative_score",
    "draw_indices",
    "draw_twin",
    "extension_length",
    "fill_cell",
    "has_filler",
    "in_cell",
    "measure_fidelity",
    "oversampler",
    "periodic_extensions",
    "plausible_fault",
    "register_filler",
    "require_count",
    "require_same_machine",
    "simulate_changes",
    "simulate_windows",
    "sources_of",
    "specimen_among",
    "spectral_distance",
    "synthesize",
]
