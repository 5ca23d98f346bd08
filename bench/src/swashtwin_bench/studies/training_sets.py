"""Training sets by name: the measured windows, and what fills the scarce cells."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from types import MappingProxyType
from typing import Any

import numpy as np

from swashtwin.calibration import FaultLaw, Posterior
from swashtwin.foundation import InputError, derive_seed
from swashtwin.learning import WindowSet
from swashtwin.physics import Twin
from swashtwin.pump import Fault
from swashtwin.synthesis import DEFAULT_VARIATION, Variation, discriminative_score, simulate_windows
from swashtwin_bench.fillers.available_fillers import FILLERS
from swashtwin_bench.studies.dataset import StudyDataset

CALIBRATED_TWINS = ("calibrated", "posterior", "law")
"""Sources of calibrated twins: as calibrated, drawn from the posterior, with calibrated law."""

RIG_VARIATION = Variation(severity=0.2, angle=math.radians(0.5))
"""Spread of severities and positions as on version 1 of the rig.

This assumes knowledge of many of its pumps.
"""


@dataclass(frozen=True)
class TrainingSet:
    """Additions to the measured windows, and the weights of classes."""

    source: str | None = None
    """Source of synthetic windows: ``"nominal"``, a name in `CALIBRATED_TWINS` or in `FILLERS`, or
    None for no synthetic windows.
    """
    every_class: bool = False
    """Fill all classes at the pressure of the scarce cells, not only the scarce ones.

    This controls for the fingerprint trap: "synthetic" then does not reveal the class.
    """
    class_weights: bool = False
    """Give all classes, instead of all windows, the same weight in the loss of a network."""
    default_prior: bool = False
    """Spread severities and positions as `synthesize` does, not by `RIG_VARIATION`."""

    def __post_init__(self) -> None:
        sources = ("nominal", *CALIBRATED_TWINS, *FILLERS)
        if self.source is not None and self.source not in sources:
            raise InputError(
                f"Unknown source {self.source!r} of synthetic windows: must be one of "
                f"{', '.join(sources)}."
            )

    @property
    def variation(self) -> Variation:
        """Variation between the windows that twins simulate."""
        return DEFAULT_VARIATION if self.default_prior else RIG_VARIATION

    def describe(self, faults: Mapping[str, Sequence[Fault]]) -> dict[str, Any]:
        """Return the settings, including those of the source, as JSON can hold them.

        Parameters
        ----------
        faults : faults that twins simulate, by class.
        """
        filler = None
        if self.source is not None:
            filler = repr(FILLERS.get(self.source, self.variation))

        table = {**asdict(self), "filler": filler}
        del table["default_prior"]  # the variation in "filler" shows it
        if self.every_class:
            # Otherwise only the scarce classes are simulated, and the scenario has their faults.
            table["faults"] = {name: list(map(repr, faults[name])) for name in sorted(faults)}
        return table


PAPER_TRAINING_SETS: Mapping[str, TrainingSet] = MappingProxyType(
    {
        "measured": TrainingSet(),
        "nominal": TrainingSet("nominal"),
        "calibrated": TrainingSet("calibrated"),
    }
)
"""The three training sets of the paper."""

FAIR_TRAINING_SETS: Mapping[str, TrainingSet] = MappingProxyType(
    {**PAPER_TRAINING_SETS, "law": TrainingSet("law")}
)
"""Those of the paper, and calibrated twins with the identified law of the recess."""

TWIN_TRAINING_SETS: Mapping[str, TrainingSet] = MappingProxyType(
    {
        "nominal": TrainingSet("nominal"),
        "calibrated": TrainingSet("calibrated"),
        "posterior": TrainingSet("posterior"),
        "default_prior": TrainingSet("posterior", default_prior=True),
        "every_class": TrainingSet("calibrated", every_class=True),
    }
)
"""Training sets that twins fill.

Twins are nominal, calibrated, drawn from the posterior of the calibrations, drawn with the default
severities of `synthesize`, or calibrated and used for every class.
"""


def fill_cells(
    dataset: StudyDataset, training_set: TrainingSet
) -> tuple[WindowSet, dict[str, float]]:
    """Return the synthetic windows that a training set adds, and metrics of them."""
    synthetic = synthesize_for(dataset, training_set)
    if len(synthetic) == 0:
        return synthetic, {}

    auroc = synthetic_auroc(dataset, synthetic)
    if math.isnan(auroc):
        return synthetic, {}
    return synthetic, {"discriminator": auroc}


def synthetic_auroc(dataset: StudyDataset, synthetic: WindowSet) -> float:
    """Return the AUROC of trees that separate measured from synthetic windows of the filled cells.

    It measures the fingerprint trap: 0.5 means indistinguishable, 1 perfectly separable; NaN means
    too few windows or recordings. The measured windows are those of the test on known pumps, which
    no filler was fitted on; nothing is selected by the result.
    """
    test = dataset.tests[dataset.scenario.splits[0]]
    scarce = dataset.scenario.scarce
    measured = test.subset(np.isin(test.label, scarce))
    synthetic = synthetic.subset(np.isin(synthetic.label, scarce))

    # Windows of one recording would be recognized by that recording (`discriminative_score`).
    if len(set(measured.recording_id.tolist())) < 2 or len(synthetic) < 2:
        return math.nan
    return discriminative_score(measured, synthetic, seed=dataset.seed)


def synthesize_for(dataset: StudyDataset, training_set: TrainingSet) -> WindowSet:
    """Return the synthetic windows that a training set adds; none if it has no source."""
    measured = dataset.measured
    scenario = dataset.scenario
    synthetic = measured.subset(np.zeros(len(measured), dtype=bool))
    if training_set.source is None or scenario.synthetic == 0:
        return synthetic

    filler = FILLERS.get(training_set.source)
    for label in measured.classes if training_set.every_class else scenario.scarce:
        # The seeds of the libraries are below 2^31.
        seed = derive_seed(dataset.seed, "filling", label) % 2**31
        if filler is not None:
            windows = filler(
                measured,
                label=label,
                pressure=scenario.pressure,
                count=scenario.synthetic,
                seed=seed,
            )
        else:
            twins, posteriors, laws = build_twins(dataset, training_set.source, label)
            windows = simulate_windows(
                twins,
                count=scenario.synthetic,
                like=measured,
                seed=seed,
                variation=training_set.variation,
                posterior=posteriors,
                law=laws,
            )
        synthetic = synthetic + windows

    return synthetic


def build_twins(
    dataset: StudyDataset, source: str, label: str
) -> tuple[list[Twin], list[Posterior] | None, list[FaultLaw | None] | None]:
    """Return the twins of a class at the pressure of the scarce cells.

    There is one for each kind of fault, speed and training specimen. Their posteriors are returned
    if the source draws from them, and their laws if it uses them; else None.
    """
    scenario = dataset.scenario
    conditions = dataset.conditions()
    faults: Sequence[Fault | None] = (None,)
    if label != "normal":
        faults = scenario.faults[label]

    if source == "nominal":
        twins = [
            Twin(scenario.pump, condition, fault)
            for fault, condition in product(faults, conditions)
        ]
        return twins, None, None

    twins = []
    posteriors = []
    laws = []
    for fault, condition, calibration in product(
        faults, conditions, dataset.calibrations_for(label)
    ):
        twins.append(calibration.twin.at(condition).with_fault(fault))
        posteriors.append(calibration.posterior)
        laws.append(calibration.law)

    return (
        twins,
        posteriors if source == "posterior" else None,
        laws if source == "law" else None,
    )
