"""Data of one seed, from which training sets and tests are made: window sets by role, and
calibrated twins.
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from swashtwin.calibration import Calibration, Calibrator, Nuisances, calibrate, load_calibration
from swashtwin.foundation import DataError, random_stream, safe_file_name
from swashtwin.learning import WindowSet, cut_windows
from swashtwin.physics import Twin
from swashtwin.pump import (
    SPEED_TOLERANCE,
    Fault,
    OperatingCondition,
    group_by_condition,
    merge_close_values,
)
from swashtwin.recordings import Recording
from swashtwin_bench.results.runs import FORMAT
from swashtwin_bench.studies.cells import cut_evenly, order_classes
from swashtwin_bench.studies.scenario import RANDOM_WINDOWS, Scenario, ScenarioSplit, split_scenario

RECESS = "swash_plate"
"""Class of the fault whose law has unknowns."""


@dataclass(frozen=True, eq=False)
class CalibrationTask:
    """One calibration, to be run, or to be read where a file of it exists."""

    specimen: str
    """Machine whose recordings it learns from."""
    label: str
    """Class of its recordings."""
    twins: tuple[Twin, ...]
    """Where it starts."""
    recordings: tuple[Recording, ...]
    """What it learns from; training recordings, all of them."""
    method: Calibrator
    nuisances: Nuisances
    seed: int
    law: Fault | None = None
    """Recess whose law is searched too."""

    @property
    def key(self) -> str:
        """Name of its folder: specimen and class to be read, and a hash of all that decides the
        result.
        """
        starts = [[repr(twin.pump), repr(twin.condition), repr(twin.fault)] for twin in self.twins]
        data = [
            (recording.recording_id, repr(recording.condition), recording.fingerprint())
            for recording in self.recordings
        ]
        law = () if self.law is None else (self.law,)
        text = repr((FORMAT, starts, data, self.method, self.nuisances, self.seed, *law))
        return f"{safe_file_name(f'{self.specimen}-{self.label}')}-{hashlib.sha256(text.encode()).hexdigest()[:16]}"


def run_calibration(task: CalibrationTask, out: Path | None) -> Calibration:
    """The calibration: read from ``OUT/calibrations/KEY`` where it lies there, else run and saved
    there.
    """
    if (finished := load_finished_calibration(out, task.key)) is not None:
        return finished
    calibration = calibrate(
        task.twins,
        task.recordings,
        method=task.method,
        nuisances=task.nuisances,
        phases=False,
        explain_misfit=False,
        law=task.law,
        seed=task.seed,
    )
    if out is not None:
        calibration.save(Path(out) / "calibrations" / task.key / "calibration.json")
    return calibration


def load_finished_calibration(out: Path | None, key: str) -> Calibration | None:
    """The calibration of that key in ``OUT/calibrations``, or None where there is no file of it."""
    path = None if out is None else Path(out) / "calibrations" / key / "calibration.json"
    return load_calibration(path) if path is not None and path.is_file() else None


@dataclass(frozen=True, eq=False)
class StudyDataset:
    """Windows and calibrated twins that one seed trains and tests on."""

    seed: int
    scenario: Scenario
    measured: WindowSet
    """Measured training windows, the few of the scarce cells among them."""
    tests: Mapping[str, WindowSet]
    """Measured test windows by split, every class alike."""
    test_recordings: Mapping[str, tuple[Recording, ...]]
    """Recordings of the tests, where noise is to be added to them; else empty."""
    calibrations: Mapping[tuple[str, str], Calibration]
    """By specimen and class; empty once no twin is needed any more."""
    calibrated_on: tuple[str, ...]
    """Recordings that twins were calibrated on."""
    split: ScenarioSplit

    @property
    def manifest(self) -> tuple[str, ...]:
        """Recordings that no test may hold besides those of the training set: calibration's, and
        the references.
        """
        return tuple(sorted({*self.calibrated_on, *self.split.references}))

    def roles(self) -> dict[str, list[str]]:
        """Recording ids by role."""
        tests = {name: set(windows.recording_id.tolist()) for name, windows in self.tests.items()}
        train = set(self.measured.recording_id.tolist())
        roles = {
            "train": train,
            **tests,
            "calibration": set(self.calibrated_on),
            "reference": self.split.references,
        }
        return {name: sorted(ids) for name, ids in roles.items()}

    def conditions(self) -> list[OperatingCondition]:
        """Operating conditions of the scarce cells: their pressure, at each speed of the training
        recordings.
        """
        speeds = self.measured.speed
        speed_group = merge_close_values(speeds, SPEED_TOLERANCE)
        means = [
            float(speeds[speed_group == speed].mean())
            for speed in np.unique(speed_group[~np.isnan(speed_group)])
        ]
        return [
            OperatingCondition(speed=speed, discharge_pressure=self.scenario.pressure)
            for speed in means
        ]

    def calibrations_for(self, label: str) -> list[Calibration]:
        """Calibrations that a class is simulated with, one for each training specimen."""
        scarce = self.scenario.scarce
        source = label if label in scarce else scarce[0]
        source = "normal" if self.scenario.calibrated_on == "law" else source
        return [self.calibrations[key] for key in sorted(self.calibrations) if key[1] == source]


def calibration_tasks(
    recordings: Sequence[Recording], scenario: Scenario, seed: int
) -> list[CalibrationTask]:
    """Calibrations that the twins of a scenario need: recordings that train, and no others."""
    split = split_scenario(recordings, scenario, seed)
    lender_ids = {
        name for ids in split.scarce.values() for name in _lenders(recordings, ids, scenario)
    }
    trained_on = [r for r in recordings if r.recording_id in split.train | lender_ids]
    has_law = scenario.calibrated_on == "law"
    tasks = []
    for label in ("normal",) if has_law else scenario.scarce:
        of_label = [r for r in trained_on if r.label == label or (has_law and r.label == RECESS)]
        for specimen in sorted({str(r.specimen) for r in of_label}):
            own = [r for r in of_label if r.specimen == specimen]
            tasks.append(_calibration_task(specimen, label, own, scenario, seed))
    return tasks


def prepare_dataset(
    recordings: Sequence[Recording],
    scenario: Scenario,
    seed: int,
    calibrations: Iterable[tuple[CalibrationTask, Calibration]],
    *,
    noisy_tests: bool = False,
) -> StudyDataset:
    """Windows of every role under `seed`.

    Parameters
    ----------
    calibrations : the tasks of `calibration_tasks`, each with its result.
    noisy_tests : keep the recordings of the tests, for noise to be added.
    """
    split = split_scenario(recordings, scenario, seed)
    lenders = [_lenders(recordings, ids, scenario) for ids in split.scarce.values()]
    by_id = {recording.recording_id: recording for recording in recordings}
    by_task = {(task.specimen, task.label): calibration for task, calibration in calibrations}

    train = [by_id[name] for name in sorted(split.train)]
    measured = cut_evenly(
        train, length=scenario.length, count=scenario.windows, classes=order_classes(recordings)
    )
    if scenario.class_windows is not None:
        measured = _counted(measured, scenario)
    for ids in lenders:
        measured = measured + _scarce_windows(
            [r for r in recordings if r.recording_id in ids], scenario, measured
        )
    tests = {
        name: cut_test([by_id[i] for i in sorted(ids)], scenario, measured)
        for name, ids in split.tests.items()
    }
    if RANDOM_WINDOWS in tests:
        measured, tests[RANDOM_WINDOWS] = deal_windows(measured, tests[RANDOM_WINDOWS], seed)
    return StudyDataset(
        seed=seed,
        scenario=scenario,
        measured=measured,
        tests=tests,
        test_recordings={
            test_name: tuple(by_id[name] for name in sorted(set(windows.recording_id.tolist())))
            for test_name, windows in tests.items()
            if noisy_tests
        },
        calibrations=by_task,
        calibrated_on=tuple(
            sorted({name for calibration in by_task.values() for name in calibration.recording_ids})
        ),
        split=split,
    )


def deal_windows(measured: WindowSet, test: WindowSet, seed: int) -> tuple[WindowSet, WindowSet]:
    """(training windows, test windows): the same windows, dealt anew in each class and pressure of
    the test.

    Split L0, as many papers do. Each cell keeps its numbers of training and of test windows;
    only which window is which is drawn. So the scores differ from those of the split by recording
    by the leak alone.

    Parameters
    ----------
    measured : measured training windows.
    test : test windows of other recordings, cut like them.
    """
    pool = measured + test
    label, pressure = pool.label, pool.cell_pressure
    in_training = np.arange(len(pool)) < len(measured)
    rng = random_stream(seed, "random windows")
    tested = zip(label[len(measured) :].tolist(), pressure[len(measured) :].tolist(), strict=True)
    for name, value in sorted(set(tested)):
        cell = np.flatnonzero((label == name) & (pressure == value))
        dealt = rng.permutation(cell)
        in_training[dealt] = np.arange(len(dealt)) < np.count_nonzero(in_training[cell])
    return pool.subset(in_training), pool.subset(~in_training)


def cut_test(recordings: Sequence[Recording], scenario: Scenario, like: WindowSet) -> WindowSet:
    """Test windows of recordings: as many of each class as the scenario says, evenly over the
    class's recordings.
    """
    windows = cut_evenly(recordings, length=scenario.length, count=scenario.windows, like=like)
    counts = {name: int((windows.label == name).sum()) for name in like.classes}
    present = [count for count in counts.values() if count]
    count = min(present) if scenario.test_windows is None else scenario.test_windows
    if min(present) < count:
        scarcest = min(counts, key=lambda name: counts[name] or len(windows))
        raise DataError(
            f"{count} test windows of each class are wanted, and {scarcest} has {counts[scarcest]}; record longer or "
            "more often, or ask for less."
        )
    by_class = [np.flatnonzero(windows.label == name) for name in like.classes if counts[name]]
    return windows.subset(
        np.sort(np.concatenate([of_class[_evenly(len(of_class), count)] for of_class in by_class]))
    )


def _counted(measured: WindowSet, scenario: Scenario) -> WindowSet:
    """As many training windows of each class as the scenario says, before those of the scarce cells
    come in.
    """
    chosen = []
    for name in measured.classes:
        of_class = np.flatnonzero(measured.label == name)
        in_cell = scenario.scarce_windows + scenario.synthetic if name in scenario.scarce else 0
        count = (scenario.class_windows or 0) - in_cell
        if not 0 <= count <= len(of_class):
            raise DataError(
                f"{count} training windows of {name} are wanted outside the scarce cell, and there are "
                f"{len(of_class)}; record longer or more often, or ask for less."
            )
        chosen.append(of_class[_evenly(len(of_class), count)])
    return measured.subset(np.sort(np.concatenate(chosen)))


def cut_again(recordings: Sequence[Recording], windows: WindowSet) -> WindowSet:
    """The same windows cut again, from other signals of the same recordings."""
    by_id = {recording.recording_id: recording.signal for recording in recordings}
    signal = [
        by_id[name][:, start : start + windows.length]
        for name, start in zip(windows.recording_id.tolist(), windows.start.tolist(), strict=True)
    ]
    return replace(windows, signal=np.array(signal, dtype=np.float32))


def count_cells(windows: WindowSet) -> dict[str, int]:
    """Windows by class and pressure in words; how many are synthetic, where any is."""
    named = {}
    for (label, pressure), count in windows.counts().items():
        words = "unknown pressure" if pressure is None else f"{pressure / 1e6:g} MPa"
        named[f"{label} @ {words}"] = count
    synthetic = int(windows.synthetic.sum())
    return {**named, "of them synthetic": synthetic} if synthetic else named


def _evenly(available: int, count: int) -> np.ndarray:
    return np.floor((np.arange(count) + 0.5) * available / max(count, 1)).astype(int)


def _lenders(recordings: Sequence[Recording], ids: Sequence[str], scenario: Scenario) -> list[str]:
    """The first recordings of a scarce cell that together hold as many windows as the scenario
    needs.
    """
    samples = {r.recording_id: r.signal.shape[1] for r in recordings}
    lenders, windows = [], 0
    for name in ids:
        if windows >= scenario.scarce_windows:
            break
        lenders.append(name)
        windows += samples[name] // scenario.length
    if windows < scenario.scarce_windows:
        raise DataError(
            f"{scenario.scarce_windows} measured windows of the scarce cell are wanted, and its training recordings "
            f"hold {windows}."
        )
    return lenders


def _scarce_windows(lenders: Sequence[Recording], scenario: Scenario, like: WindowSet) -> WindowSet:
    """The measured windows of a scarce cell."""
    if not lenders:
        return like.subset(np.zeros(len(like), dtype=bool))
    windows = cut_windows(lenders, length=like.length, classes=like.classes)
    return windows.subset(_evenly(len(windows), scenario.scarce_windows))


def _calibration_task(
    specimen: str, label: str, recordings: Sequence[Recording], scenario: Scenario, seed: int
) -> CalibrationTask:
    stated = [
        (recording.condition, recording.label)
        for recording in recordings
        if recording.condition is not None
    ]
    groups = group_by_condition([condition for condition, _ in stated])
    conditions = [
        stated[group[-1]][0] for group in groups if any(stated[i][1] == label for i in group)
    ]
    pump = replace(scenario.pump, name=f"{scenario.pump.name} ({specimen})")
    law = None
    if scenario.calibrated_on == "law":
        law = scenario.faults[RECESS][0]
        twins = tuple(Twin(pump, condition) for condition in conditions)
    else:
        nearest = min(conditions, key=lambda c: abs(c.discharge_pressure - scenario.pressure))
        twins = (Twin(pump, nearest, scenario.faults[label][0]),)
    return CalibrationTask(
        specimen, label, twins, tuple(recordings), scenario.method, scenario.nuisances, seed, law
    )
