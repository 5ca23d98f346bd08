"""What the zero-shot study learns from and what it tests on: recordings in roles, calibrated twins, window sets."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from swashtwin.calibration import Calibration, Calibrator, GaussNewton, Nuisances, calibrate
from swashtwin.foundation import DataError, derive_seed, stream
from swashtwin.learning import TrainingSettings, WindowSet
from swashtwin.physics import Twin
from swashtwin.pump import CLASSES, OperatingCondition, Pump, group_by_condition, load_pump
from swashtwin.recordings import Recording
from swashtwin_bench.studies.cells import cut_evenly, recordings_by_cell
from swashtwin_bench.studies.priors import (
    Draw,
    any_fault,
    posterior_twins,
    prior_twins,
    rig_fault,
    synthetic_windows,
    wide_fault,
)

NOMINAL, PRIOR, CALIBRATED, POSTERIOR = "nominal", "prior draws", "calibrated", "posterior draws"
"""The twins: of the drawing, drawn from the priors, calibrated, drawn from the calibrations' posteriors."""

RIG_SEVERITIES, ANY_KIND = "posterior draws, the rig's severities", "posterior draws, any kind of fault"
BOTH_NORMALS, MEASURED_NORMALS = "posterior draws, measured normals too", "posterior draws, measured normals only"
HEALTHY_ONLY, ORACLE = "healthy only, no learning", "measured faults (oracle)"

SAME, UNSEEN = "same pump", "unseen pump"
"""The tests: other recordings of the pumps with twins, and pumps without."""


@dataclass(frozen=True)
class ZeroShotSettings:
    """What is compared, and how much of it."""

    pump: Pump = field(default_factory=lambda: load_pump("25scy14-1b"))
    """Parameter set of the twins."""
    length: int = 8192
    """Readings per window; at 25.6 kHz 320 ms, 4.6 revolutions at 860 rev/min, which tell shaft orders apart."""
    windows: int = 4
    """Windows taken from each recording, evenly spaced."""
    held_out: int = 2
    """Pumps without twins."""
    draws: int = 2
    """Twins drawn for each pump from prior and posterior."""
    synthetic: int = 4
    """Windows of each of these twins, pressure and class."""
    calibrated: bool = True
    """Whether twins are calibrated; without, the nominal twin is the only one, and there are no strangers."""
    method: Calibrator = field(default_factory=lambda: GaussNewton(starts=1))
    """How the twins are calibrated."""
    nuisances: Nuisances = field(default_factory=Nuisances.housing)
    """Constants found beside the six values."""
    trees: int = 300
    """Trees of each forest; a discriminator takes a third of them."""
    orders: int = 210
    """Shaft orders that the network on orders reads."""
    training: TrainingSettings = field(default_factory=TrainingSettings)
    """How the networks are trained."""
    network: dict[str, Any] = field(default_factory=dict)
    """Settings of the BiTCN on samples that differ from the paper's."""
    order_network: dict[str, Any] = field(default_factory=dict)
    """The same of the one on orders."""


@dataclass(frozen=True, eq=False)
class ZeroShotSplit:
    """Recording ids by role."""

    pumps: tuple[str, ...]
    """Specimens with twins."""
    healthy: frozenset[str]
    """Healthy recordings, of every specimen, that nothing is tested on."""
    faulty: frozenset[str]
    """Faulty recordings of the specimens with twins for the oracle alone."""
    tests: Mapping[str, frozenset[str]]
    """Recordings of each test."""


def split_zero_shot(recordings: Sequence[Recording], held_out: int, seed: int) -> ZeroShotSplit:
    """Recordings for training, for reference and for tests, under `seed`.

    Of each specimen, class and pressure a third of the recordings test (at least one); of specimens without twins all
    the faulty ones do. A single faulty recording of a cell tests.

    Raises
    ------
    DataError
        Too few specimens, a class that no twin simulates, or a single healthy recording of a specimen at a pressure.
    """
    foreign = sorted({str(r.label) for r in recordings} - set(CLASSES))
    if foreign:
        raise DataError(f"the study simulates {', '.join(CLASSES)}, and no {foreign[0]!r}; leave those recordings out.")
    cells = recordings_by_cell(recordings, "the zero-shot study")
    specimens = sorted({str(r.specimen) for r in recordings})
    if len(specimens) <= held_out:
        raise DataError(
            f"the zero-shot study needs at least {held_out + 1} specimens, {held_out} of them without a twin; the "
            f"recordings name {len(specimens)} ({', '.join(specimens)})."
        )
    rng = stream(seed, "zero-shot", "split")
    unseen = set(rng.permutation(specimens)[:held_out].tolist())
    healthy: set[str] = set()
    faulty: set[str] = set()
    tests: dict[str, set[str]] = {SAME: set(), UNSEEN: set()}
    for cell in cells:
        order = [cell[i].recording_id for i in rng.permutation(len(cell))]
        where, label = tests[UNSEEN if cell[0].specimen in unseen else SAME], cell[0].label
        if label == "normal" and len(order) < 2:
            raise DataError(
                f"{order[0]} is the only healthy recording of {cell[0].specimen} at its pressure; the study needs one "
                "to learn from and one to test."
            )
        trained_on = order[max(1, len(order) // 3) :] if label == "normal" or cell[0].specimen not in unseen else []
        where |= set(order) - set(trained_on)
        (healthy if label == "normal" else faulty).update(trained_on)
    return ZeroShotSplit(
        tuple(name for name in specimens if name not in unseen),
        frozenset(healthy),
        frozenset(faulty),
        {name: frozenset(ids) for name, ids in tests.items()},
    )


@dataclass(frozen=True, eq=False)
class ZeroShotData:
    """Windows for training and for tests under one seed."""

    seed: int
    split: ZeroShotSplit
    healthy: WindowSet
    """Measured windows without a fault, of every specimen."""
    sets: Mapping[str, WindowSet]
    """Training sets by name."""
    strangers: WindowSet | None
    """Synthetic windows of other twins drawn from the priors: what a training set is judged on beforehand."""
    tests: Mapping[str, WindowSet]
    """Measured test windows."""
    calibrations: Mapping[str, Calibration]
    """Of each specimen with a twin."""

    def manifest_of(self, training_set: str) -> tuple[str, ...]:
        """Recordings that had a part in a training set, or are what features are compared with."""
        return tuple(sorted(self.split.healthy | (self.split.faulty if training_set == ORACLE else frozenset())))


def prepare_zero_shot(recordings: Sequence[Recording], settings: ZeroShotSettings, seed: int) -> ZeroShotData:
    """Split, calibrations on healthy recordings alone, synthesis, test windows."""
    split = split_zero_shot(recordings, settings.held_out, seed)

    def cut(ids: Iterable[str], like: WindowSet | None = None) -> WindowSet:
        names = set(ids)
        selected = [r for r in recordings if r.recording_id in names]
        return cut_evenly(selected, length=settings.length, count=settings.windows, like=like)

    healthy = cut(split.healthy)
    of_twins = [r for r in recordings if r.recording_id in split.healthy and r.specimen in split.pumps]
    conditions = _conditions(of_twins)
    calibrations = (
        {}
        if not settings.calibrated
        else {
            pump: _calibrate(pump, [r for r in of_twins if r.specimen == pump], conditions, settings, seed)
            for pump in split.pumps
        }
    )
    sets = _synthetic_sets(calibrations, split.pumps, conditions, healthy, settings, seed)
    of_pumps = healthy.subset(np.isin(healthy.specimen, split.pumps))
    if POSTERIOR in sets:
        posterior_windows = sets[POSTERIOR]
        sets[BOTH_NORMALS] = posterior_windows + of_pumps
        sets[MEASURED_NORMALS] = posterior_windows.subset(posterior_windows.label != "normal") + of_pumps
    if split.faulty:
        sets[ORACLE] = of_pumps + cut(split.faulty, like=healthy)
    return ZeroShotData(
        seed=seed,
        split=split,
        healthy=healthy,
        sets=sets,
        strangers=_synthesis(calibrations, split.pumps, conditions, healthy, settings, seed, "stranger", wide_fault)
        if calibrations
        else None,
        tests={name: cut(ids, like=healthy) for name, ids in split.tests.items() if ids},
        calibrations=calibrations,
    )


def _conditions(recordings: Sequence[Recording]) -> list[OperatingCondition]:
    """Speed and discharge pressure of each operating point."""
    stated = [recording.condition for recording in recordings if recording.condition is not None]
    conditions = [stated[group[-1]] for group in group_by_condition(stated)]
    return [OperatingCondition(condition.speed, condition.discharge_pressure) for condition in conditions]


def _calibrate(
    pump: str,
    healthy: Sequence[Recording],
    conditions: Sequence[OperatingCondition],
    settings: ZeroShotSettings,
    seed: int,
) -> Calibration:
    named = replace(settings.pump, name=f"{settings.pump.name} ({pump})")
    twins = [Twin(named, condition) for condition in conditions]
    return calibrate(
        twins,
        healthy,
        method=settings.method,
        nuisances=settings.nuisances,
        phases=False,
        explain_misfit=False,
        seed=seed,
    )


def _twins(kind: str, calibration: Calibration, count: int, seed: int) -> list[Twin]:
    """Twins of one calibrated pump. One twin several times over makes a set of the same size as several."""
    if kind == CALIBRATED:
        return [calibration.twin] * count
    return (posterior_twins if kind == POSTERIOR else prior_twins)(calibration, count, seed)


def _synthesis(
    calibrations: Mapping[str, Calibration],
    pumps: Sequence[str],
    conditions: Sequence[OperatingCondition],
    healthy: WindowSet,
    settings: ZeroShotSettings,
    seed: int,
    kind: str,
    fault: Draw,
) -> WindowSet:
    if kind == NOMINAL:
        twins = {pump: [Twin(settings.pump, conditions[0])] * settings.draws for pump in pumps}
    else:
        twins = {
            pump: _twins(kind, calibrations[pump], settings.draws, derive_seed(seed, "zero-shot twins", kind, pump))
            for pump in pumps
        }
    return synthetic_windows(twins, conditions, healthy, fault, kind=kind, count=settings.synthetic, seed=seed)


def _synthetic_sets(
    calibrations: Mapping[str, Calibration],
    pumps: Sequence[str],
    conditions: Sequence[OperatingCondition],
    healthy: WindowSet,
    settings: ZeroShotSettings,
    seed: int,
) -> dict[str, WindowSet]:
    plan = {NOMINAL: (NOMINAL, wide_fault)}
    if calibrations:
        plan |= {kind: (kind, wide_fault) for kind in (PRIOR, CALIBRATED, POSTERIOR)}
        plan |= {RIG_SEVERITIES: (POSTERIOR, rig_fault), ANY_KIND: (POSTERIOR, any_fault)}
    return {
        name: _synthesis(calibrations, pumps, conditions, healthy, settings, seed, kind, fault)
        for name, (kind, fault) in plan.items()
    }
