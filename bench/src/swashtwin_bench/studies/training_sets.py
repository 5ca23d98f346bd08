"""Training sets by name: what was measured, and what fills the scarce cells beside it."""

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
"""What twins that need a calibration fill with: as calibrated, as drawn from what the calibrations
leave open, as calibrated with the law of the recess.
"""

RIG_VARIATION = Variation(severity=0.2, angle=math.radians(0.5))
"""Severities and places spread as on version 1 of the rig: what somebody knows who has seen many of
its pumps.
"""


@dataclass(frozen=True)
class TrainingSet:
    """What a training set holds besides the measured windows."""

    source: str | None = None
    """``"nominal"``, a name in `CALIBRATED_TWINS` or in `FILLERS`, or None for nothing."""
    every_class: bool = False
    """Fill every class at the scarce cells' pressure and not the scarce ones alone: the control of
    the fingerprint trap, for then "synthetic" tells no class.
    """
    class_weights: bool = False
    """Let every class count the same in a network's loss, in place of windows."""
    default_prior: bool = False
    """Spread severities and places as `synthesize` does, and not by `RIG_VARIATION`."""

    def __post_init__(self) -> None:
        filling = ("nominal", *CALIBRATED_TWINS, *FILLERS)
        if self.source is not None and self.source not in filling:
            raise InputError(f"nothing fills by {self.source!r}; there are {', '.join(filling)}.")

    @property
    def variation(self) -> Variation:
        """What differs from one window of twins to the next."""
        return DEFAULT_VARIATION if self.default_prior else RIG_VARIATION

    def describe(self, faults: Mapping[str, Sequence[Fault]]) -> dict[str, Any]:
        """Settings as JSON can hold them, those of whatever fills among them.

        Parameters
        ----------
        faults : what twins simulate of each class, where they fill all of them.
        """
        filler = None
        if self.source is not None:
            filler = repr(FILLERS.get(self.source, self.variation))
        table = {**asdict(self), "filler": filler}
        del table["default_prior"]  # the filler's spreads tell it
        if self.every_class:
            table["faults"] = {
                name: [repr(fault) for fault in faults[name]] for name in sorted(faults)
            }
        return table


PAPER_TRAINING_SETS: Mapping[str, TrainingSet] = MappingProxyType(
    {
        "measured": TrainingSet(),
        "nominal": TrainingSet("nominal"),
        "calibrated": TrainingSet("calibrated"),
    }
)
"""The paper's three training sets."""

FAIR_TRAINING_SETS: Mapping[str, TrainingSet] = MappingProxyType(
    {**PAPER_TRAINING_SETS, "law": TrainingSet("law")}
)
"""The paper's three, and calibrated twins whose recess acts by the law that was identified."""

TWIN_TRAINING_SETS: Mapping[str, TrainingSet] = MappingProxyType(
    {
        "nominal": TrainingSet("nominal"),
        "calibrated": TrainingSet("calibrated"),
        "posterior": TrainingSet("posterior"),
        "default_prior": TrainingSet("posterior", default_prior=True),
        "every_class": TrainingSet("calibrated", every_class=True),
    }
)
"""What twins fill with: as drawn; calibrated; drawn from what the calibrations leave open; drawn so
with severities of a stated prior, as `synthesize` does by default; calibrated, for every class
alike.
"""


def fill_cells(
    dataset: StudyDataset, training_set: TrainingSet
) -> tuple[WindowSet, dict[str, float]]:
    """(synthetic windows that a training set adds, figures of them)."""
    synthetic = synthesize_for(dataset, training_set)
    value = synthetic_auroc(dataset, synthetic) if len(synthetic) else math.nan
    values = {} if math.isnan(value) else {"discriminator": value}
    return synthetic, values


def synthetic_auroc(dataset: StudyDataset, synthetic: WindowSet) -> float:
    """AUROC of trees that tell measured windows of the filled cells from synthetic ones: the
    fingerprint trap.

    0.5 is not at all, 1 always; NaN where there are too few windows or recordings. The measured
    windows are those of the nearer test, which no filler saw; nothing is chosen by it.
    """
    test, scarce = dataset.tests[dataset.scenario.splits[0]], dataset.scenario.scarce
    measured, synthetic = (
        test.subset(np.isin(test.label, scarce)),
        synthetic.subset(np.isin(synthetic.label, scarce)),
    )
    if len(set(measured.recording_id.tolist())) < 2 or len(synthetic) < 2:
        return math.nan
    return discriminative_score(measured, synthetic, seed=dataset.seed)


def synthesize_for(dataset: StudyDataset, training_set: TrainingSet) -> WindowSet:
    """The synthetic windows that a training set adds; none where nothing fills."""
    measured = dataset.measured
    synthetic = measured.subset(np.zeros(len(measured), dtype=bool))
    count = dataset.scenario.synthetic
    if training_set.source is None or count == 0:
        return synthetic
    for label in measured.classes if training_set.every_class else dataset.scenario.scarce:
        seed = derive_seed(dataset.seed, "filling", label) % 2**31
        if (filler := FILLERS.get(training_set.source)) is not None:
            made = filler(
                measured, label=label, pressure=dataset.scenario.pressure, count=count, seed=seed
            )
        else:
            twins, posteriors, laws = build_twins(dataset, training_set.source, label)
            made = simulate_windows(
                twins, count=count, like=measured, seed=seed, variation=training_set.variation, posterior=posteriors,
                law=laws,
            )  # fmt: skip
        synthetic = synthetic + made
    return synthetic


def build_twins(
    dataset: StudyDataset, by: str, label: str
) -> tuple[list[Twin], list[Posterior] | None, list[FaultLaw | None] | None]:
    """Twins of a class at the scarce cells' pressure, one of each kind of fault for each speed and
    training specimen; what their calibrations leave open, where it is to be drawn from; and the law
    of each, where it is to be used.
    """
    scenario, conditions = dataset.scenario, dataset.conditions()
    faults = scenario.faults[label] if label != "normal" else (None,)
    if by == "nominal":
        return (
            [Twin(scenario.pump, condition, fault) for fault in faults for condition in conditions],
            None,
            None,
        )
    simulated = list(product(faults, conditions, dataset.calibrations_for(label)))
    twins = [
        calibration.twin.at(condition).with_fault(fault)
        for fault, condition, calibration in simulated
    ]
    posteriors = (
        [calibration.posterior for _, _, calibration in simulated] if by == "posterior" else None
    )
    laws = [calibration.law for _, _, calibration in simulated] if by == "law" else None
    return twins, posteriors, laws
