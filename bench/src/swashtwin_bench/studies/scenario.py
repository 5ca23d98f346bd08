"""Scenarios of scarcity: which cells of the data are scarce, and the role of each recording.

A cell is a class at a discharge pressure. All plans ask the same question with other numbers: the
scarce cells have few measured windows, or none, and something fills them. The test is at that
pressure, with equally many windows of all classes, on recordings that were used for nothing else.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from itertools import zip_longest
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from swashtwin.calibration import IPINN, Calibrator, Nuisances
from swashtwin.foundation import DataError, InputError, MPa, deg, mm, random_stream, um
from swashtwin.pump import (
    PRESSURE_TOLERANCE,
    BoreDefect,
    DamScratch,
    Fault,
    GrooveErosion,
    PistonWear,
    Pump,
    SwashPlateDefect,
    load_pump,
    values_match,
)
from swashtwin.recordings import Recording
from swashtwin_bench.rigs.version_two.fleet import PAPER_RECESS
from swashtwin_bench.studies.cells import recordings_by_cell

MACHINED: Mapping[str, tuple[Fault, ...]] = MappingProxyType(
    {
        "swash_plate": (SwashPlateDefect(depth=mm(0.07), length=mm(30), width=mm(24)),),
        "cylinder_block": (BoreDefect(depth=um(270), half_width=deg(40)),),
        "piston": (PistonWear(clearance=um(60)),),
        "valve_plate": (DamScratch(area=0.8e-6), GrooveErosion(advance=deg(5))),
    }
)
"""Faults that a twin simulates, as they were machined: the typical ones of the virtual rig.

The windows of a class with two kinds of fault alternate between them.
"""


def machined_faults(rig_version: str) -> Mapping[str, tuple[Fault, ...]]:
    """Return `MACHINED` for a version of the virtual rig.

    In ``1-deep`` and ``2-deep`` the recess is 0.6 mm deep. In ``2-deep`` it is simulated by the
    ``lift_off`` law, because slippers cannot follow it (docs/explanation/physics.md, section 6b);
    in ``1-deep`` by the law of the paper, in which films pull them.
    """
    if rig_version == "1-deep":
        return {**MACHINED, "swash_plate": (replace(PAPER_RECESS, contact="shared"),)}
    if rig_version == "2-deep":
        return {**MACHINED, "swash_plate": (PAPER_RECESS,)}
    return MACHINED


RANDOM_WINDOWS = "L0"
"""Split of a test whose windows are dealt at random with the training (`deal_windows`)."""


@dataclass(frozen=True)
class Scenario:
    """Scarce cells, the twins that may fill them, and the tests."""

    scarce: tuple[str, ...] = ("swash_plate",)
    """Classes of the scarce cells."""
    pressure: float = MPa(15)
    """Discharge pressure of the scarce cells and of the test [Pa]."""
    scarce_windows: int = 24
    """Measured windows of each scarce cell, from few recordings; 0 leaves the cell empty."""
    synthetic: int = 72
    """Synthetic windows of each scarce cell; the paper adds three for each measured one."""
    length: int = 2048
    """Samples per window; at 25.6 kHz 80 ms, 1.15 revolutions at 860 rev/min."""
    windows: int = 24
    """Windows of each recording outside the scarce cells, evenly spaced."""
    class_windows: int | None = None
    """Training windows of each class, evenly over its recordings; for a scarce class the measured
    and the synthetic windows in its cell count too. None takes all windows.
    """
    test_windows: int | None = None
    """Windows of each class in each test, evenly over its recordings; None takes the number of the
    smallest class.
    """
    held_out: int = 2
    """Number of held-out specimens, which are not trained on."""
    splits: tuple[str, str] = ("L2", "L4")
    """Splits of the tests: on training specimens, and on held-out ones. With `RANDOM_WINDOWS` as
    the first, recordings of that test are trained on too.
    """
    faults: Mapping[str, tuple[Fault, ...]] = field(default_factory=lambda: MACHINED)
    """Faults that the twin simulates, by class."""
    pump: Pump = field(default_factory=lambda: load_pump("25scy14-1b"))
    """Parameter set of the twin."""
    method: Calibrator = field(default_factory=IPINN)
    """Calibration method."""
    nuisances: Nuisances = field(default_factory=Nuisances)
    """Constants that are estimated in addition to the six parameters."""
    calibrated_on: Literal["fault", "law"] = "fault"
    """Recordings of the calibration.

    ``"fault"``: a twin for each scarce class, on training recordings of that class at the pressure
    nearest to the scarce one. ``"law"``: one twin for all classes, on healthy training recordings
    at all pressures, and the law of the recess on training recordings of the recess.
    """

    training_recordings: int | None = None
    """Training recordings of each cell of a training specimen, which then has one reference of each
    healthy cell as well, as the held-out ones have; None takes two thirds, and no reference.
    """
    with_reference: bool = False
    """Whether windows are compared with a healthy recording of their specimen, or synthetic ones
    with healthy windows of the same twin (`relative_to_healthy`).
    """

    def __post_init__(self) -> None:
        unknown = [name for name in self.scarce if name not in self.faults]
        if unknown:
            raise InputError(
                f"faults has no entry for the scarce class {unknown[0]!r}: add the faults that "
                "the twin simulates."
            )

    def is_at_pressure(self, recording: Recording) -> bool:
        """Return whether a recording is at the pressure of the scarce cells."""
        condition = recording.condition
        if condition is None:
            return False
        return bool(values_match(condition.discharge_pressure, self.pressure, PRESSURE_TOLERANCE))

    def is_scarce(self, recording: Recording) -> bool:
        """Return whether a recording is in a scarce cell."""
        return recording.label in self.scarce and self.is_at_pressure(recording)

    def describe(self) -> dict[str, Any]:
        """Return the scenario as JSON can hold it."""
        faults = {name: list(map(_describe_fault, self.faults[name])) for name in self.scarce}
        # A changed parameter set may keep its name.
        pump_sha256 = hashlib.sha256(describe_pump(self.pump).encode()).hexdigest()

        # Runs from before these settings existed keep their key.
        later_settings: dict[str, Any] = {}
        if self.training_recordings is not None:
            later_settings["training_recordings"] = self.training_recordings
        if self.with_reference:
            later_settings["with_reference"] = True

        return {
            "scarce": list(self.scarce),
            "pressure_Pa": self.pressure,
            "scarce_windows": self.scarce_windows,
            "synthetic": self.synthetic,
            "window_length": self.length,
            "windows_per_recording": self.windows,
            "test_windows": self.test_windows,
            "specimens_held_out": self.held_out,
            "splits": list(self.splits),
            "faults": faults,
            "pump": {"name": self.pump.name, "sha256": pump_sha256},
            "method": {"name": type(self.method).__name__, **_describe_settings(self.method)},
            "nuisances": _describe_settings(self.nuisances),
            "calibrated_on": self.calibrated_on,
            "class_windows": self.class_windows,
            **later_settings,
        }


def describe_pump(pump: Pump) -> str:
    """Return a text of all numbers of a pump, for hashes that stay the same between versions."""
    parts = [f"{part.name}={getattr(pump, part.name)!r}" for part in fields(pump) if part.repr]
    return f"Pump({', '.join(parts)})"


def _describe_fault(fault: Fault) -> dict[str, Any]:
    return {"kind": type(fault).__name__, **asdict(fault)}


def _describe_settings(settings: Any) -> dict[str, Any]:
    """Return the fields of an object; those that JSON cannot hold by their `repr`."""
    json_types = (bool, int, float, str, list, tuple, dict, type(None))
    return {
        name: value if isinstance(value, json_types) else repr(value)
        for name, value in vars(settings).items()
    }


@dataclass(frozen=True, eq=False)
class ScenarioSplit:
    """Recording ids by role."""

    train: frozenset[str]
    """Training recordings outside the scarce cells."""
    scarce: Mapping[str, tuple[str, ...]]
    """By scarce class, the recordings that may provide its few windows, in order of use."""
    references: frozenset[str]
    """Healthy recordings that are neither trained nor tested on: what a machine has from its first
    days.

    The held-out specimens have them always, so that a classifier that compares with them
    (`Scenario.with_reference`) is tested on the same windows as one that does not.
    """
    tests: Mapping[str, frozenset[str]]
    """Recordings of each test by split."""


def split_scenario(recordings: Sequence[Recording], scenario: Scenario, seed: int) -> ScenarioSplit:
    """Return which recordings train, which are references and which test, under `seed`.

    A third of the recordings of each training specimen, class and pressure (at least one) are test
    recordings, the others training recordings, unless the scenario sets their number. The held-out
    specimens are drawn first; one
    recording of each of their healthy cells is a reference, unless it is the only one to test on.

    Raises
    ------
    DataError
        There are too few specimens or repeats, or a fact is missing.
    """
    rng = random_stream(seed, "scenario", "split")
    held_out_specimens = _draw_held_out(recordings, scenario, rng)

    familiar, unseen = scenario.splits
    tests: dict[str, set[str]] = {familiar: set(), unseen: set()}
    train: set[str] = set()
    references: set[str] = set()
    lenders_by_class: dict[str, list[list[str]]] = {name: [] for name in scenario.scarce}
    for cell in recordings_by_cell(recordings, "the study"):
        shuffled = [cell[i] for i in rng.permutation(len(cell))]
        ids = [recording.recording_id for recording in shuffled]
        is_tested = scenario.is_at_pressure(cell[0])

        if cell[0].specimen in held_out_specimens:
            # The only recording of a tested cell is tested, and no reference.
            is_spare = len(ids) > 1 or not is_tested
            n_references = 1 if cell[0].label == "normal" and is_spare else 0
            references.update(ids[:n_references])
            if is_tested:
                tests[unseen].update(ids[n_references:])
            continue

        n_training = _count_training(shuffled, scenario)
        n_references = 0
        if scenario.training_recordings is not None and cell[0].label == "normal":
            n_references = 1
        references.update(ids[n_training : n_training + n_references])
        if is_tested:
            tests[familiar].update(ids[n_training + n_references :])
        if scenario.is_scarce(cell[0]):
            lenders_by_class[str(cell[0].label)].append(ids[:n_training])
        else:
            train.update(ids[:n_training])

    for split, description in ((familiar, "training"), (unseen, "held-out")):
        if not tests[split]:
            raise DataError(
                f"The study tests at {scenario.pressure / 1e6:g} MPa, the pressure of the paper's "
                f"cases, and the {description} specimens have no recording to test there."
            )

    return ScenarioSplit(
        frozenset(train),
        {name: _alternate(lists, rng) for name, lists in lenders_by_class.items()},
        frozenset(references),
        {name: frozenset(ids) for name, ids in tests.items()},
    )


def _draw_held_out(
    recordings: Sequence[Recording], scenario: Scenario, rng: np.random.Generator
) -> set[str]:
    # Sorted, so that the draw does not depend on the order of the recordings.
    specimens = sorted({str(recording.specimen) for recording in recordings})
    min_specimens = scenario.held_out + 1
    if len(specimens) < min_specimens:
        raise DataError(
            f"The study needs at least {min_specimens} specimens, {scenario.held_out} of them held "
            f"out; the recordings have {len(specimens)} ({', '.join(specimens)}). Specify the "
            "specimen of each recording in the index."
        )

    return set(rng.permutation(specimens).tolist()[: scenario.held_out])


def _count_training(cell: Sequence[Recording], scenario: Scenario) -> int:
    """Return the number of training recordings in a cell of a training specimen."""
    if scenario.training_recordings is not None:
        # One more is a reference, and one is tested.
        min_recordings = scenario.training_recordings + 2
        if len(cell) < min_recordings:
            raise DataError(
                f"The study needs {min_recordings} recordings of {cell[0].label} of specimen "
                f"{cell[0].specimen} at each pressure; there are {len(cell)}."
            )
        return scenario.training_recordings

    if len(cell) > 1:
        return len(cell) - max(1, len(cell) // 3)

    # At other pressures nothing is tested, and the only recording trains.
    if scenario.is_at_pressure(cell[0]):
        raise DataError(
            f"The study needs two recordings of {cell[0].label} at {scenario.pressure / 1e6:g} MPa "
            f"of specimen {cell[0].specimen}, one to train and one to test; there is only "
            f"{cell[0].recording_id}."
        )
    return 1


def _alternate(lists: Sequence[Sequence[str]], rng: np.random.Generator) -> tuple[str, ...]:
    """Return the recordings of the specimens in turns: all first ones, then all second ones."""
    shuffled = [lists[i] for i in rng.permutation(len(lists))]
    names: list[str] = []
    for turn in zip_longest(*shuffled):
        # Specimens with fewer recordings miss the last turns.
        names += [name for name in turn if name is not None]

    return tuple(names)
