"""Studies of scarcity as plans: what fills a cell, from how many real windows, at an unseen pressure or pump."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from swashtwin.calibration import GaussNewton, Nuisances
from swashtwin_bench.fillers.registry import FILLERS
from swashtwin_bench.studies.cases import SCENARIOS, case_one
from swashtwin_bench.studies.plan import Plan
from swashtwin_bench.studies.training_sets import PAPER_TRAINING_SETS, TWIN_TRAINING_SETS, TrainingSet

BUDGETS = {"quick": ("0", "72", "200"), "paper": ("0", "50", "150", "200", "500")}
"""Synthetic windows of each filling."""

REAL_WINDOWS = ("0", "5", "10", "20", "50", "100", "200")
"""Measured windows of the scarce cell on the few-shot curve."""

_ALL_FREE: Mapping[str, Any] = {"method": GaussNewton(starts=1), "nuisances": Nuisances.housing()}

CALIBRATORS: Mapping[str, Mapping[str, Any]] = {
    "none": {},
    "ipinn": {},
    "gauss_newton": _ALL_FREE,
    "healthy": {**_ALL_FREE, "calibrated_on": "normal"},
}
"""Ways to calibrate the twins, as they differ from the paper's; none is for what needs no twin."""


def augmentation(size: str) -> Plan:
    """Whatever can fill the scarce cell of Case I, with the same number of windows each."""
    data_alone = {name: TrainingSet(name) for name in FILLERS}
    return replace(
        case_one(size),
        study="augmentation",
        title="Augmentation: what fills the scarce cell, by the number of synthetic windows",
        training_sets={
            "measured": TrainingSet(),
            "class_weights": TrainingSet(class_weights=True),
            **data_alone,
            **TWIN_TRAINING_SETS,
        },
        varied="synthetic",
        variants={budget: {"synthetic": int(budget)} for budget in BUDGETS[size]},
        bare="0",
        rivals=(),
        notes=(
            "AUROC measured/synthetic: how well trees on vibration features tell the measured windows of the filled "
            "cell from the synthetic ones; 0.5 is not at all. Where it is near 1 and only this cell is filled, a "
            "classifier can learn 'synthetic' for the class: then the recall in the scarce cell, which is of measured "
            "windows, falls behind. The row every class fills all classes at this pressure alike.",
            "Class weights change the training of networks only.",
        ),
    )


def calibrators(size: str) -> Plan:
    """The paper's way to calibrate the twins of Case I, against Gauss-Newton with the housing's constants free, on
    recordings of the fault and on healthy ones."""
    twin_sets = ("calibrated", "every_class")
    return replace(
        case_one(size),
        study="calibrators",
        title="Calibrators: how the way in which twins are calibrated changes the scores",
        training_sets={"measured": TrainingSet(), **{name: TWIN_TRAINING_SETS[name] for name in twin_sets}},
        varied="calibrator",
        variants=CALIBRATORS,
        bare="none",
        compared={
            "calibrator": {"gauss_newton": ("ipinn",), "healthy": ("ipinn", "gauss_newton")},
            "training_set": dict.fromkeys(twin_sets, ("measured",)),
        },
        rivals=(),
        notes=(
            "ipinn: the paper's network. gauss_newton: Gauss-Newton from one start, with the constants of housing and "
            "mounting free beside the six values; it errs less on recordings held out "
            "(docs/explanation/calibration.md).",
            "Both on each pump's recordings of the fault at the pressure nearest to the scarce one, as in Case I.",
            "healthy: gauss_newton on the pump's healthy recordings of every pressure, the fault put in as machined.",
        ),
    )


def few_shot(size: str) -> Plan:
    """From no measured window of the scarce cell to many, with and without twins."""
    return replace(
        case_one(size),
        study="few-shot",
        title="Few shots: how many measured windows of the cell make a twin needless",
        varied="real_windows",
        variants={count: {"scarce_windows": int(count)} for count in REAL_WINDOWS},
        rivals=(),
        notes=(
            "Windows come from as few recordings as hold them; on the rig up to 50 are of one recording of one pump.",
            "A pump that lends windows is calibrated on the whole recordings that they are of, and where none is lent "
            "on the same fault at another pressure: the twins see more of the cell than the measured windows show.",
        ),
    )


def unseen_pressure(size: str) -> Plan:
    """No fault was ever measured at the test's pressure; healthy pumps were."""
    faults = ("swash_plate", "cylinder_block", "piston", "valve_plate")
    scenario = replace(
        SCENARIOS[size],
        scarce=faults,
        scarce_windows=0,
        levels=("L3", "L4"),
        method=GaussNewton(starts=1),
        nuisances=Nuisances.housing(),
        calibrated_on="normal",
    )
    return replace(
        case_one(size),
        study="unseen-pressure",
        title="Unseen pressure: every fault known at other pressures only",
        scenario=scenario,
        training_sets={
            **PAPER_TRAINING_SETS,
            "posterior": TrainingSet("posterior"),
            "every_class": TWIN_TRAINING_SETS["every_class"],
        },
        notes=(
            "Twins are calibrated on healthy training recordings of every pressure, by Gauss-Newton with the housing's "
            "constants, and simulate the faults as machined: on the rig, as it typically draws them.",
            "Measured normals of the pressure are trained on. Where only faults are synthetic, a classifier can take "
            "'synthetic' for 'faulty'; in the row every class, normals are synthetic too.",
        ),
    )


def unseen_specimen(size: str) -> Plan:
    """How many pumps one has to know to tell the faults of another."""
    return replace(
        case_one(size),
        study="unseen-specimen",
        title="Unseen specimen: how many pumps one has to know to tell another's faults",
        varied="pumps",
        variants={count: {"specimens": int(count)} for count in ("1", "2", "3", "4")},
        training_sets={name: PAPER_TRAINING_SETS[name] for name in ("measured", "calibrated")},
        rivals=(),
        notes=("The same pumps are held out whatever the number; L2 is of the pumps that are trained on.",),
    )
