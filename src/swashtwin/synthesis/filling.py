"""Filling: twins simulate what was not recorded, so that every class is trained on alike.

If a classifier gets simulated windows of one class only, each of another assembly and severity,
that class becomes more diverse than the others, which have a few recordings each, and takes their
test recordings. A `Filling` therefore plans all cells together, and a `FillingPlan` states what it
adds before anything is simulated.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, asdict, dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from swashtwin.calibration import Calibration, FaultLaw, Posterior
from swashtwin.foundation import InputError, derive_seed, plural
from swashtwin.learning import WindowSet, cut_windows
from swashtwin.physics import Twin
from swashtwin.pump import (
    FAULT_KINDS,
    Fault,
    OperatingCondition,
    Pump,
    SwashPlateDefect,
    canonical_label,
    is_healthy,
    load_pump,
    read_fault,
)
from swashtwin.recordings import Recording, default_window, join_manifests, join_names
from swashtwin.synthesis.filling_plan import (
    DEFAULT_FILL,
    NO_OPERATING_POINT,
    WINDOWS_PER_CELL,
    Fill,
    PlannedCell,
    count_cells,
    plan_cells,
    require_fill,
)
from swashtwin.synthesis.machine_check import require_same_machine
from swashtwin.synthesis.twin_windows import (
    BANDWIDTH_OF_SAMPLE_RATE,
    describe_uncalibrated,
    machine_of,
    require_count,
    simulate_windows,
)

TwinSource = Calibration | Pump
"""What makes twins: a calibration, or a pump whose interface values are taken as they stand."""

Progress = Callable[[int, int], None]
"""Called with the number of finished windows, and of all."""

# The seeds of libraries that draw with them are below this.
_MAX_SEED = 2**31

_HEADER = ("class", "operating point", "recordings", "windows", "synthetic", "twins", "fault")


@dataclass(frozen=True, eq=False, repr=False)
class Filling:
    """Twins, and the rule by which they fill the cells of training data.

    `plan` shows what it adds to recordings, and `FaultClassifier.fit` takes it as ``synthetic``:
    the recordings that a twin was calibrated on then stay in training, and only training recordings
    decide which cells are short and lend noise and gain.

    Parameters
    ----------
    twins : calibrations and pumps, or names or files of pumps (`load_pump`), one or several. They
        take turns in every cell.
    fill : ``"cells"`` fills the short cells alone; ``"points"`` every class at the operating points
        that have a short cell; ``"all"`` every class at every operating point.
    count : synthetic windows of each filled cell.
    fault_of : fault that twins simulate for a class: a fault, the name of a typical one, or several
        that take turns. By default a calibration simulates the fault of the class that it
        identified itself; the other twins simulate those of all calibrations in turns, or the
        typical one that the name of the class suggests. Classes that no recording has are added.
    seed : seed of all draws.

    Examples
    --------
    ``Filling(calibration).plan(train)`` is the plan; ``.plan(train).simulate()`` its windows.
    """

    twins: TwinSource | str | Sequence[TwinSource | str]
    _: KW_ONLY
    fill: Fill = DEFAULT_FILL
    count: int = WINDOWS_PER_CELL
    fault_of: Mapping[str, Fault | str | Sequence[Fault | str]] = field(default_factory=dict)
    seed: int = 0

    def __post_init__(self) -> None:
        require_fill(self.fill)
        require_count(self.count)
        if not self.sources:
            raise InputError("There is no twin to fill with: give a calibration or a pump.")

    def __repr__(self) -> str:
        return (
            f"<Filling: {plural(len(self.sources), 'twin')}, fill={self.fill!r}, "
            f"{self.count} windows a cell>"
        )

    @cached_property
    def sources(self) -> tuple[TwinSource, ...]:
        """The calibrations and pumps."""
        twins = self.twins
        if isinstance(twins, Calibration | Pump | str):
            twins = [twins]

        sources = []
        for twin in twins:
            source = load_pump(twin) if isinstance(twin, str) else twin
            if not isinstance(source, Calibration | Pump):
                raise InputError(
                    f"twins holds a {type(source).__name__}; it takes calibrations, pumps and "
                    "names of pumps."
                )
            sources.append(source)
        return tuple(sources)

    @property
    def calibrations(self) -> list[Calibration]:
        """The calibrations among the sources."""
        return [source for source in self.sources if isinstance(source, Calibration)]

    @property
    def manifest(self) -> dict[str, tuple[str, ...]]:
        """Recordings that the twins were calibrated on; no test set may contain them."""
        return join_manifests([source.recording_hashes for source in self.calibrations])

    def check(self, recordings: Sequence[Recording]) -> tuple[str, ...]:
        """Require that the twins are of the pump that was recorded; return what cannot be checked.

        Raises
        ------
        InputError
            A twin has another number of pistons than the recordings.
        """
        conditions = [
            recording.condition for recording in recordings if recording.condition is not None
        ]
        if not conditions:
            raise InputError(NO_OPERATING_POINT)

        notes: list[str] = []
        for source in self.sources:
            twin = _build_twin(source, conditions[0], None)
            notes += require_same_machine(
                twin, conditions[:1], recordings, speed=False, pressure=False
            )
        return tuple(dict.fromkeys(notes))

    def fill_training(self, training: WindowSet) -> tuple[WindowSet, tuple[str, ...]]:
        """Return the synthetic windows that join these training windows, and notes on them."""
        plan = self.plan(training)
        return plan.simulate(), (f"{plan.title}.", *plan.notes)

    def plan(
        self, like: WindowSet | Iterable[Recording], *, window: int | None = None
    ) -> "FillingPlan":
        """Return which cells are filled, with how many windows of which twins.

        Parameters
        ----------
        like : training windows or recordings; they must not be test data.
        window : samples per window if `like` is recordings; by default as in `FaultClassifier`.

        Raises
        ------
        InputError
            A twin is of another pump than the recordings or lacks their channels, a fault is
            invalid, or no recording specifies its operating point.
        """
        notes: tuple[str, ...] = ()
        if isinstance(like, WindowSet):
            measured = like.subset(~like.synthetic)
        else:
            recordings = list(like)
            labels = sorted({recording.label for recording in recordings if recording.label})
            length = window or default_window(recordings)
            measured = cut_windows(recordings, length=length, classes=labels)
            notes = self.check(recordings)

        measured.require_any("to fill")
        labels = [*measured.classes]
        labels += [label for label in self.fault_of if label not in labels]
        measured = measured.with_classes(labels)
        faults = {label: self._faults_of(label) for label in labels}
        cells = plan_cells(count_cells(measured, labels), faults, fill=self.fill, count=self.count)
        plan = FillingPlan(self, measured, cells)
        return replace(plan, notes=(*_collect_notes(plan), *notes))

    def _faults_of(self, label: str) -> tuple[Fault | None, ...]:
        """Return the faults that twins simulate for a class; empty if there is none."""
        if label in self.fault_of:
            return _read_faults(label, self.fault_of[label])
        if is_healthy(label):
            return (None,)

        try:
            kind = canonical_label(label, tuple(FAULT_KINDS))
        except InputError:
            kind = ""

        calibrated = [_calibrated_fault(calibration) for calibration in self.calibrations]
        faults = [fault for fault in calibrated if fault and fault.label in (label, kind)]
        if faults:
            return tuple(dict.fromkeys(faults))
        return _read_faults(label, kind) if kind else ()


@dataclass(frozen=True, eq=False, repr=False)
class FillingPlan:
    """What a `Filling` adds to training windows; ``print(plan)`` shows it as a table."""

    filling: Filling
    like: WindowSet
    """Measured training windows, with all classes that are filled."""
    cells: tuple[PlannedCell, ...]
    """Each class at each operating point."""
    notes: tuple[str, ...] = ()
    """Classes that twins cannot simulate, and what limits the others, as sentences."""

    @property
    def filled(self) -> tuple[PlannedCell, ...]:
        """The cells that get synthetic windows."""
        return tuple(cell for cell in self.cells if cell.count)

    @property
    def count(self) -> int:
        """Number of all synthetic windows."""
        return sum(cell.count for cell in self.cells)

    @cached_property
    def twin_names(self) -> list[str]:
        """Name of each twin: its machine if it was calibrated on one, else its pump."""
        names = []
        for source, machine in zip(self.filling.sources, self.machines, strict=True):
            if isinstance(source, Calibration):
                names.append(machine or f"calibrated {source.nominal.pump.name}")
            else:
                names.append(f"nominal {source.name}")
        return names

    @cached_property
    def machines(self) -> list[str]:
        """Recorded machine that each twin was calibrated on; empty if it is not known."""
        return [
            machine_of(source, self.like) if isinstance(source, Calibration) else ""
            for source in self.filling.sources
        ]

    def turns_of(self, cell: PlannedCell) -> list[tuple[int, Fault | None]]:
        """Return whose turn it is in a cell: the index of each source, and what it simulates.

        All sources have equally many turns.
        """
        faults = [self._faults_of(source, cell) for source in self.filling.sources]
        n_rounds = math.lcm(*map(len, faults))
        turns: list[tuple[int, Fault | None]] = []
        for number in range(n_rounds):
            for index, faults_of_source in enumerate(faults):
                turns.append((index, faults_of_source[number % len(faults_of_source)]))
        return turns

    def _faults_of(self, source: TwinSource, cell: PlannedCell) -> tuple[Fault | None, ...]:
        """Return the faults that a source simulates in a cell.

        A calibration simulates its own fault if it is of the class: vibration identifies the depth
        of a recess only as a product with the coefficients of the slippers' film (K_sw, C_sw), so
        that the depth of one calibration does not fit the values of another.
        """
        is_specified = cell.label in self.filling.fault_of
        if isinstance(source, Calibration) and not is_specified:
            calibrated = _calibrated_fault(source)
            if calibrated in cell.faults:
                return (calibrated,)
        return cell.faults

    def twins_of(self, cell: PlannedCell) -> dict[str, int]:
        """Return the number of windows of a cell by the name of their twin."""
        names = [self.twin_names[index] for index, _ in self.turns_of(cell)]
        return dict(Counter(names[index % len(names)] for index in range(cell.count)))

    @property
    def header(self) -> tuple[str, ...]:
        """Names of the columns of `rows`."""
        return _HEADER

    @property
    def rows(self) -> list[tuple[object, ...]]:
        """The plan as a table: one row for each cell."""
        rows: list[tuple[object, ...]] = []
        for cell in self.cells:
            twins = ", ".join(f"{name} ({count})" for name, count in self.twins_of(cell).items())
            recordings = f"{cell.n_recordings} (short)" if cell.is_short else cell.n_recordings
            fault = cell.fault_text if cell.count else ""
            rows.append(
                (cell.label, cell.point_text, recordings, cell.n_windows, cell.count, twins, fault)
            )
        return rows

    @property
    def title(self) -> str:
        """What the plan adds, in a sentence."""
        if not self.count:
            return f"Filling ({self.filling.fill}): no cell gets synthetic windows"
        return (
            f"Filling ({self.filling.fill}): {plural(self.count, 'synthetic window')} in "
            f"{plural(len(self.filled), 'cell')}"
        )

    def __repr__(self) -> str:
        return f"<FillingPlan: {self.title}>"

    def __str__(self) -> str:
        table = [self.header, *([str(value) for value in row] for row in self.rows)]
        widths = [max(map(len, column)) for column in zip(*table, strict=True)]
        lines = [
            "  ".join(value.ljust(width) for value, width in zip(row, widths, strict=True)).rstrip()
            for row in table
        ]
        return "\n".join([self.title, *lines, *self.notes])

    def to_dict(self) -> dict[str, Any]:
        """Return the plan as JSON values."""
        cells = []
        for cell in self.cells:
            values = asdict(cell)
            del values["faults"]
            cells.append({**values, "fault": cell.fault_text, "twins": self.twins_of(cell)})
        return {
            "fill": self.filling.fill,
            "count": self.count,
            "cells": cells,
            "notes": self.notes,
        }

    def require_windows(self) -> None:
        """Raise an `InputError` with the reason if no cell gets windows."""
        if not self.count:
            raise _explain_empty_plan(self).with_context("There is nothing to simulate. ")

    def simulate(self, progress: Progress | None = None) -> WindowSet:
        """Return the synthetic windows of all filled cells.

        The windows of a cell do not depend on which other cells are filled.
        """
        windows = self.like.subset(np.zeros(len(self.like), dtype=bool))
        windows = replace(windows, manifest=self._manifest)
        for cell in self.filled:
            windows = windows + self._simulate_cell(cell)
            if progress is not None:
                progress(len(windows), self.count)
        return windows

    @property
    def _manifest(self) -> dict[str, tuple[str, ...]]:
        return join_manifests([self.like.manifest, self.filling.manifest])

    def _simulate_cell(self, cell: PlannedCell) -> WindowSet:
        twins: list[Twin] = []
        posteriors: list[Posterior | None] = []
        laws: list[FaultLaw | None] = []
        machines: list[str] = []
        for index, fault in self.turns_of(cell):
            source = self.filling.sources[index]
            twin = _build_twin(source, cell.condition, fault)
            twins.append(_limit_bandwidth(twin, self.like.sample_rate))
            calibration = source if isinstance(source, Calibration) else None
            posteriors.append(None if calibration is None else calibration.posterior)
            laws.append(None if calibration is None else calibration.law)
            machines.append(self.machines[index])

        # Twins name their class by the part, recordings may name it otherwise.
        names = [*self.like.classes]
        names += [name for name in {twin.label for twin in twins} if name not in names]
        windows = simulate_windows(
            twins,
            count=cell.count,
            like=self.like.with_classes(names),
            seed=derive_seed(self.filling.seed, "filling", cell.label, *cell.point) % _MAX_SEED,
            posterior=posteriors,
            law=laws,
            specimens=machines,
        )
        target = np.full(cell.count, self.like.classes.index(cell.label), dtype=np.int64)
        return replace(windows, classes=self.like.classes, target=target)


def _read_faults(label: str, entries: Fault | str | Sequence[Fault | str]) -> tuple[Fault, ...]:
    """Return the faults of a class, of which all have effects on one part.

    A recess that is named without its dimensions has the contact law that suits its depth.
    """
    faults: list[Fault] = []
    for entry in [entries] if isinstance(entries, Fault | str) else entries:
        if isinstance(entry, str) and is_healthy(entry):
            raise InputError(
                f"The class {label!r} stands for {entry!r}, which is not a fault. Label healthy "
                "recordings normal: twins get their noise and gain from these.",
                field="fault_of",
            )
        fault: Any = entry
        if isinstance(entry, str):
            fault = read_fault(entry)
        if isinstance(entry, str) and isinstance(fault, SwashPlateDefect):
            fault = fault.with_fitting_contact()
        if not isinstance(fault, Fault):
            raise InputError(
                f"The class {label!r} stands for {entry!r}, which is not a fault; it must be one "
                f"of {', '.join(name for name in FAULT_KINDS if not is_healthy(name))}.",
                field="fault_of",
            )
        faults.append(fault)

    parts = sorted({fault.label for fault in faults})
    if len(parts) != 1:
        raise InputError(
            f"The class {label!r} must stand for faults of one part, not for "
            f"{' and '.join(parts) or 'no fault'}.",
            field="fault_of",
        )
    return tuple(faults)


def _calibrated_fault(calibration: Calibration) -> Fault | None:
    """Return the fault whose dimensions a calibration knows.

    The corner of a recess under a law is left out: it is drawn from the estimate of the law.
    """
    if calibration.law is not None:
        return replace(calibration.law.fault, corner=0.0)
    return calibration.twin.fault


def _build_twin(source: TwinSource, condition: OperatingCondition, fault: Fault | None) -> Twin:
    """Return the twin of a fault at the speed and pressure of `condition`."""
    if isinstance(source, Pump):
        return Twin(source, condition, fault)
    at_point = source.twin.condition.replace(
        speed=condition.speed, discharge_pressure=condition.discharge_pressure
    )
    return source.twin.at(at_point).with_fault(fault)


def _limit_bandwidth(twin: Twin, sample_rate: float) -> Twin:
    """Return the twin with a bandwidth that windows of this sample rate [Hz] can hold."""
    return replace(twin, bandwidth=min(twin.bandwidth, sample_rate / BANDWIDTH_OF_SAMPLE_RATE))


def _collect_notes(plan: FillingPlan) -> tuple[str, ...]:
    """Return what stays empty and why, and what limits the windows, as sentences."""
    empty = () if plan.count else (str(_explain_empty_plan(plan)),)
    return (
        *empty,
        *_describe_unknown_classes(plan),
        *_describe_unrecorded_classes(plan),
        *_describe_unknown_points(plan.like),
        *_describe_typical_severities(plan),
        *_describe_missing_healthy(plan),
        *_describe_twins(plan),
    )


def _describe_unknown_classes(plan: FillingPlan) -> list[str]:
    if not plan.count:
        return []
    labels = dict.fromkeys(cell.label for cell in plan.cells if not cell.faults)
    return [
        f"The twins simulate no fault called {label}, so this class gets no window, and the filled "
        "classes may take its recordings. Name the fault that it stands for (fault_of), or label "
        "it normal if it is healthy."
        for label in labels
    ]


def _describe_unrecorded_classes(plan: FillingPlan) -> list[str]:
    """Return a note on classes without a recording, which may be names that were mistyped."""
    recorded = {cell.label for cell in plan.cells if cell.n_recordings}
    unrecorded = [label for label in plan.like.classes if label not in recorded]
    filled = {cell.label for cell in plan.filled}
    return [
        f"No recording has the class {label}, which fault_of names: the model learns it from "
        "simulated windows alone."
        for label in unrecorded
        if label in plan.filling.fault_of and label in filled
    ]


def _describe_unknown_points(like: WindowSet) -> list[str]:
    is_known = np.isfinite(like.speed) & np.isfinite(like.discharge_pressure)
    unknown = np.unique(like.recording_id[~is_known]).tolist()
    if not unknown:
        return []
    return [
        f"{plural(len(unknown), 'recording')} without speed or pressure count in no cell "
        f"({join_names(unknown)}). Add both to the index."
    ]


def _explain_empty_plan(plan: FillingPlan) -> InputError:
    """Return why no cell gets windows, and what to do."""
    if all(is_healthy(cell.label) for cell in plan.cells):
        return InputError(
            "All recordings are healthy.",
            remedy="Name classes and the faults to simulate for them with {fault_of}.",
        )
    unknown = sorted({cell.label for cell in plan.cells if not cell.faults})
    if any(cell.is_short for cell in plan.cells) and unknown:
        return InputError(
            f"The twins simulate no fault called {' or '.join(unknown)}, and no other class is "
            "short of recordings.",
            remedy="Name the fault that the class stands for with {fault_of}.",
        )
    return InputError(
        "No cell is short: every class has at least half as many recordings at each operating "
        "point as the others in the median.",
        remedy="To add windows nevertheless, set {fill='all'}.",
    )


def _describe_typical_severities(plan: FillingPlan) -> list[str]:
    """Return a note on the classes whose severity nobody specified or measured."""
    filling = plan.filling
    calibrated = {_calibrated_fault(calibration) for calibration in filling.calibrations}
    typical = []
    for label in dict.fromkeys(cell.label for cell in plan.filled):
        faults = next(cell.faults for cell in plan.filled if cell.label == label)
        if label not in filling.fault_of and not {None, *calibrated} & set(faults):
            typical.append(label)

    if not typical:
        return []
    return [
        f"The severities of {join_names(typical)} are typical values, not those of your pumps: "
        "specify what you know of them (fault_of)."
    ]


def _describe_missing_healthy(plan: FillingPlan) -> list[str]:
    """Return a note on points without healthy recordings, where levels are those of the model."""
    healthy = {cell.point: 0 for cell in plan.cells}
    for cell in plan.cells:
        if is_healthy(cell.label):
            healthy[cell.point] += cell.n_recordings

    points = {cell.point: cell.point_text for cell in plan.filled if not healthy[cell.point]}
    if not points:
        return []
    return [
        f"No healthy recording at {'; '.join(points.values())}: noise is that of the recordings "
        "with the nearest pressure, and the sensors have the gains of the pump file or the "
        "calibration. Record a healthy pump there."
    ]


def _describe_twins(plan: FillingPlan) -> list[str]:
    """Return why a calibration should not be used, and which machines have no twin."""
    if not plan.count:
        return []

    notes: list[str] = []
    for cell in plan.filled:
        for index, fault in plan.turns_of(cell):
            source = plan.filling.sources[index]
            if isinstance(source, Calibration):
                twin = _build_twin(source, cell.condition, fault)
                texts = (source.doubt, *describe_uncalibrated(source, source.law, twin, plan.like))
                notes += [f"{plan.twin_names[index]}: {text}" for text in texts if text]
    notes = list(dict.fromkeys(notes))

    described = set(plan.machines)
    machines = set(plan.like.specimen.tolist()) - {""}
    without_twin = sorted(machines - described)
    if described - {""} and without_twin:
        notes.append(
            f"No twin was calibrated on {join_names(without_twin)}: windows of the other twins "
            "stand for these machines too."
        )
    return notes
