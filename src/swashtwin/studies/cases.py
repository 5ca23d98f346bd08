"""The paper's two cases: a cell with few measured windows, and one with none.

A classifier must tell five classes apart at 15 MPa, but of the swash plate fault only one recording was taken there
(Case I), or none (Case II). Three training sets: what was measured; the same with the scarce cell filled from the
nominal twin; the same with it filled from calibrated twins. The test sets are always measured, never simulated, and
share no recording with training or calibration:

- L2: other recordings of the pumps that were trained on;
- L4: pumps that were never seen.

Our reading, where the paper is silent: the test is at the pressure of the scarce cell, all classes alike; the windows
of the scarce cell come from one recording of one pump; the twins are calibrated, one for each training pump, on that
pump's training recordings of the same fault at the pressure nearest to the scarce one.
"""

from dataclasses import replace

from swashtwin.studies.models import models_of
from swashtwin.studies.plan import Plan
from swashtwin.studies.scenario import Scenario

SCENARIOS: dict[str, Scenario] = {
    "quick": Scenario(),
    "paper": Scenario(windows=18, scarce_windows=50, synthetic=150),
}
"""``quick`` is the demo's. ``paper`` takes the paper's counts on the paper-sized rig: 648 windows a class, 50 in the
scarce cell, 150 synthetic ones."""

FILLED = {"quick": 96, "paper": 200}
"""Synthetic windows that fill the cell where nothing was measured: as many as Case I has of both kinds."""


def case_one(size: str) -> Plan:
    """Case I, few samples."""
    return Plan(
        study="case1",
        title="Case I, few samples: measured, nominal and calibrated training sets",
        scenario=SCENARIOS[size],
        models=models_of(size, ("bitcn", "extra_trees")),
        size=size,
        rivals=("extra_trees",),
        compared={"training_set": "calibrated"},
        embeds=True,
    )


def case_two(size: str) -> Plan:
    """Case II, a condition that was never measured with the fault."""
    return replace(
        case_one(size),
        study="case2",
        title="Case II, missing condition: no measured window in the cell that twins fill",
        scenario=replace(SCENARIOS[size], scarce_windows=0, synthetic=FILLED[size], test_windows=50),
        notes=(
            "The filled cell itself is level L5 at every test: no measured window of this class was trained on at this "
            "pressure.",
        ),
    )
