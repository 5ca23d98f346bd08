"""Names that other rooms import, and where each lives."""

from .background import DEFAULT_VARIATION as DEFAULT_VARIATION
from .background import Variation as Variation
from .background import draw_twin as draw_twin
from .fidelity import Fidelity as Fidelity
from .fidelity import discriminative_score as discriminative_score
from .fidelity import measure_fidelity as measure_fidelity
from .fidelity import spectral_distance as spectral_distance
from .filling import Filling as Filling
from .filling import FillingPlan as FillingPlan
from .filling_plan import DEFAULT_FILL as DEFAULT_FILL
from .filling_plan import FILLS as FILLS
from .filling_plan import WINDOWS_PER_CELL as WINDOWS_PER_CELL
from .filling_plan import Fill as Fill
from .filling_plan import PlannedCell as PlannedCell
from .machine_check import require_same_machine as require_same_machine
from .order_changes import OrderChanges as OrderChanges
from .order_changes import simulate_changes as simulate_changes
from .pump_prior import PumpPrior as PumpPrior
from .pump_prior import operating_range as operating_range
from .twin_windows import build_windows as build_windows
from .twin_windows import machine_of as machine_of
from .twin_windows import require_count as require_count
from .twin_windows import simulate_windows as simulate_windows
from .twin_windows import synthesize as synthesize
