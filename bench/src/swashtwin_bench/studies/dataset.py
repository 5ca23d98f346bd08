"""Data of one seed: windows by role, and calibrated twins."""

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
from swashtwin_bench.rigs.writing import RIG_VERSION
from swashtwin_bench.studies.cells import cut_evenly, order_classes
from swashtwin_bench.studies.healthy_reference import relative_to_healthy
from swashtwin_bench.studies.scenario import (
    RANDOM_WINDOWS,
    Scenario,
    ScenarioSplit,
    describe_pump,
    split_scenario,
)

RECESS = "swash_plate"
"""Class of the fault whose law is calibrated."""


@dataclass(frozen=True, eq=False)
class CalibrationTask:
    """A calibration that is run, or read if its file exists."""

    specimen: str
    """Machine of its recordings."""
    label: str
    """Class of its recordings."""
    twins: tuple[Twin, ...]
    """Twins from which it starts."""
    recordings: tuple[Recording, ...]
    """Recordings it is calibrated on, all of them training recordings."""
    method: Calibrator
    nuisances: Nuisances
    seed: int
    law: Fault | None = None
    """Recess whose law is calibrated too."""

    @property
    def key(self) -> str:
        """Name of its folder: specimen and class for the reader, and a hash that identifies it."""
        starts = [
            [describe_pump(twin.pump), repr(twin.condition), repr(twin.fault)]
            for twin in self.twins
        ]
        data = [
            (recording.recording_id, repr(recording.condition), recording.fingerprint())
            for recording in self.recordings
        ]
        law = () if self.law is None else (self.law,)
        contents = repr((FORMAT, starts, data, self.method, self.nuisances, self.seed, *law))
        digest = hashlib.sha256(contents.encode()).hexdigest()[:16]

        return f"{safe_file_name(f'{self.specimen}-{self.label}')}-{digest}"


def run_calibration(task: CalibrationTask, out: Path | None) -> Calibration:
    """Return the calibration, which is read from ``OUT/calibrations/KEY`` if it is finished."""
    finished = load_finished_calibration(out, task.key)
    if finished is not None:
        return finished

    # Neither phases nor an explanation of the misfit is used by a study.
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
        calibration.save(_calibration_file(out, task.key))

    return calibration


def load_finished_calibration(out: Path | None, key: str) -> Calibration | None:
    """Return the calibration of that key in ``OUT/calibrations``, or None if it has no file."""
    if out is None or not _calibration_file(out, key).is_file():
        return None
    return load_calibration(_calibration_file(out, key))


def _calibration_file(out: Path, key: str) -> Path:
    return Path(out) / "calibrations" / key / "calibration.json"


@dataclass(frozen=True, eq=False)
class StudyDataset:
    """Windows and calibrated twins that one seed is trained and tested on."""

    seed: int
    scenario: Scenario
    measured: WindowSet
    """Measured training windows, including the few of the scarce cells."""
    tests: Mapping[str, WindowSet]
    """Measured test windows by split, equally many of all classes."""
    test_recordings: Mapping[str, tuple[Recording, ...]]
    """Recordings of the tests by split, if they are to be perturbed; else empty."""
    calibrations: Mapping[tuple[str, str], Calibration]
    """Calibrations by specimen and class; empty after the cells are filled."""
    calibrated_on: tuple[str, ...]
    """Recordings that twins were calibrated on."""
    split: ScenarioSplit
    references: WindowSet
    """Windows of the reference recordings; none unless the scenario compares with them."""
    rig: str = RIG_VERSION
    """Version of the virtual rig, if ceilings need its truth."""

    def for_training(self) -> "StudyDataset":
        """Return what a training gets: no calibrations, and windows as classifiers see them.

        If the scenario has a reference, they are relative to the healthy windows of their specimen.
        """
        dataset = replace(self, calibrations={})
        if not self.scenario.with_reference:
            return dataset

        measured = relative_to_healthy(self.measured, self.references)
        tests = {
            name: relative_to_healthy(windows, self.references)
            for name, windows in self.tests.items()
        }
        return replace(dataset, measured=measured, tests=tests)

    @property
    def manifest(self) -> tuple[str, ...]:
        """Recordings that no test may contain, besides those of the training windows.

        They are those of the calibrations and the references.
        """
        return tuple(sorted({*self.calibrated_on, *self.split.references}))

    def roles(self) -> dict[str, list[str]]:
        """Return the recording ids by role."""
        ids_by_role: dict[str, Iterable[str]] = {"train": set(self.measured.recording_id.tolist())}
        for split, windows in self.tests.items():
            ids_by_role[split] = set(windows.recording_id.tolist())
        ids_by_role["calibration"] = set(self.calibrated_on)
        ids_by_role["reference"] = self.split.references

        return {role: sorted(ids) for role, ids in ids_by_role.items()}

    def conditions(self, pressure: float) -> list[OperatingCondition]:
        """Return the operating points at a pressure [Pa]: one for each speed of the training."""
        speeds = self.measured.speed
        # Speeds scatter from recording to recording: close ones are averaged.
        groups = merge_close_values(speeds, SPEED_TOLERANCE)

        conditions = []
        for group in np.unique(groups[~np.isnan(groups)]):
            speed = float(speeds[groups == group].mean())
            conditions.append(OperatingCondition(speed=speed, discharge_pressure=pressure))

        return conditions

    def calibrations_for(self, label: str) -> list[Calibration]:
        """Return the calibrations that simulate a class, one for each training specimen."""
        if self.scenario.calibrated_on == "law":
            source = "normal"
        elif label in self.scenario.scarce:
            source = label
        else:
            # A class that is not scarce has no calibration; the pump is the same.
            source = self.scenario.scarce[0]

        return [self.calibrations[key] for key in sorted(self.calibrations) if key[1] == source]


def calibration_tasks(
    recordings: Sequence[Recording], scenario: Scenario, seed: int
) -> list[CalibrationTask]:
    """Return the calibrations that the twins of a scenario need, on training recordings only."""
    split = split_scenario(recordings, scenario, seed)
    training_ids = set(split.train)
    for ids in split.scarce.values():
        training_ids.update(_select_lenders(recordings, ids, scenario))
    training = [r for r in recordings if r.recording_id in training_ids]

    has_law = scenario.calibrated_on == "law"
    tasks = []
    for label in ("normal",) if has_law else scenario.scarce:
        labels = (label, RECESS) if has_law else (label,)
        of_label = [recording for recording in training if recording.label in labels]
        for specimen in sorted({str(recording.specimen) for recording in of_label}):
            of_specimen = [recording for recording in of_label if recording.specimen == specimen]
            tasks.append(_build_calibration_task(specimen, label, of_specimen, scenario, seed))

    return tasks


def prepare_dataset(
    recordings: Sequence[Recording],
    scenario: Scenario,
    seed: int,
    calibrations: Iterable[tuple[CalibrationTask, Calibration]],
    *,
    noisy_tests: bool = False,
    rig: str = RIG_VERSION,
) -> StudyDataset:
    """Return the windows of all roles under `seed`.

    Parameters
    ----------
    calibrations : the tasks of `calibration_tasks`, each with its result.
    noisy_tests : keep the recordings of the tests, to perturb them.
    rig : version of the virtual rig, if ceilings need its truth.
    """
    split = split_scenario(recordings, scenario, seed)
    by_id = {recording.recording_id: recording for recording in recordings}
    lenders = [_select_lenders(recordings, ids, scenario) for ids in split.scarce.values()]

    measured = cut_evenly(
        # The order of a set of texts differs from process to process.
        [by_id[name] for name in sorted(split.train)],
        length=scenario.length,
        count=scenario.windows,
        classes=order_classes(recordings),
    )
    if scenario.class_windows is not None:
        measured = _limit_class_windows(measured, scenario, scenario.class_windows)
    for ids in lenders:
        in_cell = [recording for recording in recordings if recording.recording_id in ids]
        measured = measured + _cut_scarce_windows(in_cell, scenario, measured)

    tests = {}
    for name, test_ids in split.tests.items():
        in_test = [by_id[test_id] for test_id in sorted(test_ids)]
        tests[name] = cut_test(in_test, scenario, measured)
    if RANDOM_WINDOWS in tests:
        measured, tests[RANDOM_WINDOWS] = deal_windows(measured, tests[RANDOM_WINDOWS], seed)

    references = measured.subset(np.zeros(len(measured), dtype=bool))
    if scenario.with_reference:
        healthy = [by_id[name] for name in sorted(split.references)]
        references = cut_evenly(
            healthy, length=scenario.length, count=scenario.windows, like=measured
        )

    test_recordings = {}
    # They are sent to the processes, so those without a window of the test are left out.
    if noisy_tests:
        for name, windows in tests.items():
            used_ids = sorted(set(windows.recording_id.tolist()))
            test_recordings[name] = tuple(by_id[used_id] for used_id in used_ids)

    by_task = {(task.specimen, task.label): calibration for task, calibration in calibrations}
    calibrated_on: set[str] = set()
    for calibration in by_task.values():
        calibrated_on.update(calibration.recording_ids)

    return StudyDataset(
        seed=seed,
        scenario=scenario,
        measured=measured,
        tests=tests,
        test_recordings=test_recordings,
        calibrations=by_task,
        calibrated_on=tuple(sorted(calibrated_on)),
        split=split,
        references=references,
        rig=rig,
    )


def deal_windows(measured: WindowSet, test: WindowSet, seed: int) -> tuple[WindowSet, WindowSet]:
    """Return the same training and test windows, dealt again at random.

    This is split L0, as in many papers. Each class and pressure of the test keeps its numbers of
    training and of test windows; only which window is which is drawn. The scores differ from those
    of the split by recording by the leak alone.

    Parameters
    ----------
    measured : measured training windows.
    test : test windows of other recordings, cut like them.

    Returns
    -------
    Training windows and test windows.
    """
    pool = measured + test
    labels = pool.label
    pressures = pool.cell_pressure
    is_training = np.arange(len(pool)) < len(measured)
    tested_cells = set(
        zip(labels[~is_training].tolist(), pressures[~is_training].tolist(), strict=True)
    )

    rng = random_stream(seed, "random windows")
    # In a fixed order, because all cells draw from one stream.
    for label, pressure in sorted(tested_cells):
        cell = np.flatnonzero((labels == label) & (pressures == pressure))
        n_training = np.count_nonzero(is_training[cell])
        dealt = rng.permutation(cell)
        is_training[dealt] = np.arange(len(dealt)) < n_training

    return pool.subset(is_training), pool.subset(~is_training)


def cut_test(recordings: Sequence[Recording], scenario: Scenario, like: WindowSet) -> WindowSet:
    """Cut test windows: equally many of each class, evenly over the recordings of the class."""
    windows = cut_evenly(recordings, length=scenario.length, count=scenario.windows, like=like)
    counts = {name: int((windows.label == name).sum()) for name in like.classes}
    # A class that was not recorded for the test is no part of it.
    counts = {name: count for name, count in counts.items() if count}

    smallest_class = min(counts, key=lambda name: counts[name])
    count = scenario.test_windows
    if count is None:
        count = counts[smallest_class]
    if counts[smallest_class] < count:
        raise DataError(
            f"The scenario needs {count} test windows of each class, and {smallest_class} has "
            f"{counts[smallest_class]}. Record longer or more often, or reduce test_windows."
        )

    selected = []
    for name in counts:
        of_class = np.flatnonzero(windows.label == name)
        selected.append(of_class[_spread_evenly(len(of_class), count)])

    return windows.subset(np.sort(np.concatenate(selected)))


def _limit_class_windows(measured: WindowSet, scenario: Scenario, class_windows: int) -> WindowSet:
    """Return `class_windows` windows of each class, less those that its scarce cell will get."""
    selected = []
    for name in measured.classes:
        of_class = np.flatnonzero(measured.label == name)
        count = class_windows
        if name in scenario.scarce:
            count -= scenario.scarce_windows + scenario.synthetic
        if not 0 <= count <= len(of_class):
            raise DataError(
                f"The scenario needs {count} training windows of {name} outside the scarce cell, "
                f"and there are {len(of_class)}. Record longer or more often, or reduce "
                "class_windows."
            )
        selected.append(of_class[_spread_evenly(len(of_class), count)])

    return measured.subset(np.sort(np.concatenate(selected)))


def cut_again(recordings: Sequence[Recording], windows: WindowSet) -> WindowSet:
    """Return the same windows, cut from other signals of the same recordings."""
    signal_by_id = {recording.recording_id: recording.signal for recording in recordings}
    signal = [
        signal_by_id[name][:, start : start + windows.length]
        for name, start in zip(windows.recording_id.tolist(), windows.start.tolist(), strict=True)
    ]
    return replace(windows, signal=np.array(signal, dtype=np.float32))


def count_cells(windows: WindowSet) -> dict[str, int]:
    """Return the number of windows by class and pressure, and of synthetic ones if any."""
    counts = {}
    for (label, pressure), count in windows.counts().items():
        text = "unknown pressure" if pressure is None else f"{pressure / 1e6:g} MPa"
        counts[f"{label} @ {text}"] = count

    n_synthetic = int(windows.synthetic.sum())
    if n_synthetic:
        counts["of them synthetic"] = n_synthetic

    return counts


def _spread_evenly(available: int, count: int) -> np.ndarray:
    """Return `count` of `available` indices, evenly spaced with half a step at both ends."""
    positions = (np.arange(count) + 0.5) * available / max(count, 1)
    return np.floor(positions).astype(int)


def _select_lenders(
    recordings: Sequence[Recording], ids: Sequence[str], scenario: Scenario
) -> list[str]:
    """Return the first recordings of a scarce cell that together have enough windows."""
    # Windows of a scarce cell do not overlap, so the samples limit their number.
    n_samples = {recording.recording_id: recording.signal.shape[1] for recording in recordings}

    lenders: list[str] = []
    n_windows = 0
    for name in ids:
        if n_windows >= scenario.scarce_windows:
            break
        lenders.append(name)
        n_windows += n_samples[name] // scenario.length

    if n_windows < scenario.scarce_windows:
        raise DataError(
            f"The scenario needs {scenario.scarce_windows} measured windows of the scarce cell, "
            f"and its training recordings have {n_windows}."
        )
    return lenders


def _cut_scarce_windows(
    lenders: Sequence[Recording], scenario: Scenario, like: WindowSet
) -> WindowSet:
    """Return the measured windows of a scarce cell."""
    if not lenders:
        return like.subset(np.zeros(len(like), dtype=bool))

    windows = cut_windows(lenders, length=like.length, classes=like.classes)
    return windows.subset(_spread_evenly(len(windows), scenario.scarce_windows))


def _build_calibration_task(
    specimen: str, label: str, recordings: Sequence[Recording], scenario: Scenario, seed: int
) -> CalibrationTask:
    known = [recording for recording in recordings if recording.condition is not None]
    all_conditions = [recording.condition for recording in known if recording.condition is not None]

    # One twin for each operating point at which the class was recorded.
    conditions = []
    for group in group_by_condition(all_conditions):
        if any(known[i].label == label for i in group):
            conditions.append(all_conditions[group[-1]])

    # Reports tell the calibrations of a study apart by the name of the pump.
    pump = replace(scenario.pump, name=f"{scenario.pump.name} ({specimen})")
    if scenario.calibrated_on == "law":
        law = scenario.faults[RECESS][0]
        twins = tuple(Twin(pump, condition) for condition in conditions)
    else:
        law = None
        nearest = min(
            conditions,
            key=lambda condition: abs(condition.discharge_pressure - scenario.pressure),
        )
        twins = (Twin(pump, nearest, scenario.faults[label][0]),)

    return CalibrationTask(
        specimen, label, twins, tuple(recordings), scenario.method, scenario.nuisances, seed, law
    )
