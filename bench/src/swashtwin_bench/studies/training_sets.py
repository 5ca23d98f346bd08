"""Training sets by name: the measured windows, and what fills the scarce cells."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from itertools import product
from types import MappingProxyType
from typing import Any

import numpy as np

from swashtwin.calibration import FaultLaw, Posterior
from swashtwin.foundation import InputError, derive_seed
from swashtwin.learning import WindowSet
from swashtwin.physics import Twin
from swashtwin.pump import PRESSURE_TOLERANCE, Fault, values_match
from swashtwin.synthesis import (
    DEFAULT_VARIATION,
    Variation,
    discriminative_score,
    draw_twin,
    simulate_windows,
)
from swashtwin_bench.fillers.available_fillers import FILLERS
from swashtwin_bench.studies.ceilings import (
    CEILINGS,
    PERFECT_MODEL,
    TRUE_VALUES,
    build_true_twins,
    record_perfect_windows,
    specimen_of,
    without_gain,
)
from swashtwin_bench.studies.dataset import StudyDataset
from swashtwin_bench.studies.healthy_reference import relative_to_healthy

CALIBRATED_TWINS = ("calibrated", "posterior", "law")
"""Sources of calibrated twins: as calibrated, drawn from the posterior, with calibrated law."""

NO_GAIN = "no_gain"
"""Source of nominal twins as the paper's: no gain is fitted to healthy windows."""

NOMINAL_TWINS = ("nominal", NO_GAIN)
"""Sources of nominal twins."""

RIG_VARIATION = Variation(severity=0.2, angle=math.radians(0.5))
"""Spread of severities and positions as on version 1 of the rig.

This assumes knowledge of many of its pumps.
"""


# Settings of a training set that stand in the key of a run only if they are not the default.
_LATER_SETTINGS = ("every_pressure", "assemblies", "as_many_as_measured", "own_noise")


@dataclass(frozen=True)
class TrainingSet:
    """Additions to the measured windows, and the weights of classes."""

    source: str | None = None
    """Source of synthetic windows: a name in `NOMINAL_TWINS`, `CALIBRATED_TWINS`, `CEILINGS` or
    `FILLERS`, or None for no synthetic windows.
    """
    every_class: bool = False
    """Fill all classes at the pressure of the scarce cells, not only the scarce ones.

    This controls for the fingerprint trap: "synthetic" then does not reveal the class.
    """
    class_weights: bool = False
    """Give all classes, instead of all windows, the same weight in the loss of a network."""
    default_prior: bool = False
    """Spread severities and positions as `synthesize` does, not by `RIG_VARIATION`."""
    every_pressure: bool = False
    """Fill the cells at all pressures of the measured windows, not only at that of the scarce
    cells.
    """
    assemblies: int | None = None
    """Assemblies, each with one severity, that the windows of a cell share; None draws one for each
    window.
    """
    as_many_as_measured: bool = False
    """Fill all cells together with as many windows as are measured, not with
    `Scenario.synthetic` each, so that both kinds weigh alike.
    """

    own_noise: bool = False
    """Lay windows of a calibrated twin or a ceiling over the noise of its own pump, with its gains,
    as `synthesize` does; not over those of all training pumps together.
    """

    def __post_init__(self) -> None:
        sources = (*NOMINAL_TWINS, *CALIBRATED_TWINS, *CEILINGS, *FILLERS)
        if self.source is not None and self.source not in sources:
            raise InputError(
                f"Unknown source {self.source!r} of synthetic windows: must be one of "
                f"{', '.join(sources)}."
            )
        drawn_once = (*NOMINAL_TWINS, *CEILINGS)
        if self.assemblies is not None and self.source not in drawn_once:
            raise InputError(
                f"Windows of {self.source} do not share assemblies: the source must be one of "
                f"{', '.join(drawn_once)}."
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
        if self.source is not None and self.source != PERFECT_MODEL:
            filler = repr(FILLERS.get(self.source, self.variation))

        table = {**asdict(self), "filler": filler}
        del table["default_prior"]  # the variation in "filler" shows it
        for entry in fields(self):
            # Runs from before these settings existed keep their key.
            if entry.name in _LATER_SETTINGS and table[entry.name] == entry.default:
                del table[entry.name]
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

DEMO_TRAINING_SETS: Mapping[str, TrainingSet] = MappingProxyType(
    {
        "measured": TrainingSet(),
        "nominal": TrainingSet("nominal", every_class=True),
        "calibrated": TrainingSet("law", every_class=True),
    }
)
"""Training sets of the demo: twins simulate every class at the pressure, as `Filling` does by
default, since a class that alone is simulated is more diverse than the others.
"""

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


def for_training(
    dataset: StudyDataset, training_set: TrainingSet, synthetic: WindowSet
) -> WindowSet:
    """Return synthetic windows as classifiers see them.

    If the scenario has a reference, they are relative to healthy windows of the same twin.
    """
    if not dataset.scenario.with_reference:
        return synthetic

    healthy = synthetic.subset(synthetic.label == "normal")
    if not len(healthy):
        healthy = synthesize_for(dataset, training_set, labels=("normal",))
    return relative_to_healthy(synthetic, healthy)


def synthetic_auroc(dataset: StudyDataset, synthetic: WindowSet) -> float:
    """Return the AUROC of trees that separate measured from synthetic windows of the filled cells.

    It measures the fingerprint trap: 0.5 means indistinguishable, 1 perfectly separable; NaN means
    too few windows or recordings. The measured windows are those of the test on known pumps, which
    no filler was fitted on; nothing is selected by the result.
    """
    test = dataset.tests[dataset.scenario.splits[0]]
    scarce = dataset.scenario.scarce
    measured = test.subset(np.isin(test.label, scarce))
    is_at_pressure = values_match(
        synthetic.discharge_pressure, dataset.scenario.pressure, PRESSURE_TOLERANCE
    )
    synthetic = synthetic.subset(np.isin(synthetic.label, scarce) & is_at_pressure)

    # Windows of one recording would be recognized by that recording (`discriminative_score`).
    if len(set(measured.recording_id.tolist())) < 2 or len(synthetic) < 2:
        return math.nan
    return discriminative_score(measured, synthetic, seed=dataset.seed)


def synthesize_for(
    dataset: StudyDataset, training_set: TrainingSet, labels: Sequence[str] | None = None
) -> WindowSet:
    """Return the synthetic windows that a training set adds; none if it has no source.

    Parameters
    ----------
    labels : classes to fill, by default those of the training set.
    """
    measured = dataset.measured
    scenario = dataset.scenario
    synthetic = measured.subset(np.zeros(len(measured), dtype=bool))
    if training_set.source is None or scenario.synthetic == 0:
        return synthetic

    cells = list(_filled_cells(dataset, training_set, labels))
    count = scenario.synthetic
    if training_set.as_many_as_measured:
        count = max(1, len(measured) // len(cells))

    for label, pressure in cells:
        # Windows at the pressure of the scarce cells are the same if other pressures are filled.
        address = () if pressure == scenario.pressure else (pressure,)
        # The seeds of the libraries are below 2^31.
        seed = derive_seed(dataset.seed, "filling", label, *address) % 2**31
        synthetic = synthetic + _fill_cell(dataset, training_set, label, pressure, count, seed)

    return synthetic


def _filled_cells(
    dataset: StudyDataset, training_set: TrainingSet, labels: Sequence[str] | None
) -> Iterator[tuple[str, float]]:
    """Yield class and pressure [Pa] of each cell that a training set fills."""
    scenario = dataset.scenario
    pressures = [scenario.pressure]
    if training_set.every_pressure:
        for pressure in np.unique(dataset.measured.cell_pressure).tolist():
            if not values_match(pressure, scenario.pressure, PRESSURE_TOLERANCE):
                pressures.append(pressure)

    if labels is None:
        labels = dataset.measured.classes if training_set.every_class else scenario.scarce
    yield from product(labels, pressures)


def _fill_cell(
    dataset: StudyDataset,
    training_set: TrainingSet,
    label: str,
    pressure: float,
    count: int,
    seed: int,
) -> WindowSet:
    """Return `count` synthetic windows of a class at a pressure [Pa]."""
    measured = dataset.measured
    source = str(training_set.source)
    if source in FILLERS:
        return FILLERS[source](measured, label=label, pressure=pressure, count=count, seed=seed)

    if source == PERFECT_MODEL:
        return record_perfect_windows(
            dataset,
            label,
            pressure,
            count=count,
            assemblies=training_set.assemblies or count,
            seed=seed,
            own_noise=training_set.own_noise,
        )

    twins, posteriors, laws = build_twins(dataset, source, label, pressure)
    specimens = None
    if training_set.own_noise:
        specimens = [specimen_of(twin) for twin in twins]
    variation = training_set.variation
    if training_set.assemblies is not None:
        # The operating point differs from window to window, the pump and its fault do not.
        between = replace(variation, speed=0.0, pressure=0.0)
        twins = [
            draw_twin(twins[number % len(twins)], between, seed, number)
            for number in range(training_set.assemblies)
        ]
        variation = replace(variation, severity=0.0, angle=0.0, interfaces=0.0)

    return simulate_windows(
        twins,
        count=count,
        like=without_gain(measured) if source == NO_GAIN else measured,
        seed=seed,
        variation=variation,
        posterior=posteriors,
        law=laws,
        specimens=specimens,
    )


def build_twins(
    dataset: StudyDataset, source: str, label: str, pressure: float
) -> tuple[list[Twin], list[Posterior] | None, list[FaultLaw | None] | None]:
    """Return the twins of a class at a pressure [Pa].

    There is one for each kind of fault, speed and training specimen. Their posteriors are returned
    if the source draws from them, and their laws if it uses them; else None.
    """
    scenario = dataset.scenario
    conditions = dataset.conditions(pressure)
    faults: Sequence[Fault | None] = (None,)
    if label != "normal":
        faults = scenario.faults[label]

    if source in NOMINAL_TWINS:
        twins = [
            Twin(scenario.pump, condition, fault)
            for fault, condition in product(faults, conditions)
        ]
        return twins, None, None

    if source == TRUE_VALUES:
        return build_true_twins(dataset, faults, conditions), None, None

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
