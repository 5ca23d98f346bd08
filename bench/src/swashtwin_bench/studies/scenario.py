"""Which cells of the data are scarce, how scarce, and which recordings have which role then.

A cell is a class at a discharge pressure. All plans ask the same question with other numbers: in
the scarce cells only so many measured windows are known, or none, and something fills them. The
test is at that pressure, all classes alike, on recordings that had no part in anything.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
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
"""Faults as they were machined, which a twin simulates: on the virtual rig its typical ones. A
class of two kinds takes turns.
"""


def machined_faults(rig_version: str) -> Mapping[str, tuple[Fault, ...]]:
    """`MACHINED` as a version of the virtual rig has it: in ``1-deep`` and ``2-deep`` its recess is
    0.6 mm deep.

    In ``2-deep`` it is simulated under the ``lift_off`` law, since slippers cannot follow it
    (docs/explanation/physics.md, section 6b); in ``1-deep`` under the paper's law, where films pull
    them.
    """
    recesses = {"1-deep": replace(PAPER_RECESS, contact="shared"), "2-deep": PAPER_RECESS}
    return (
        {**MACHINED, "swash_plate": (recesses[rig_version],)}
        if rig_version in recesses
        else MACHINED
    )


RANDOM_WINDOWS = "L0"
"""Level of a nearer test whose windows, and those of the training, are dealt at random
(`deal_windows`).
"""


@dataclass(frozen=True)
class Scenario:
    """Scarce cells, the twins that may fill them, and the tests."""

    scarce: tuple[str, ...] = ("swash_plate",)
    """Classes of the scarce cells."""
    pressure: float = MPa(15)
    """Discharge pressure of the scarce cells and of the test [Pa]."""
    scarce_windows: int = 24
    """Measured windows of each scarce cell, from as few recordings as hold them; 0 leaves the cell
    empty.
    """
    synthetic: int = 72
    """Synthetic windows put into each scarce cell; the paper adds three for each measured one."""
    length: int = 2048
    """Readings per window; at 25.6 kHz 80 ms, 1.15 revolutions at 860 rev/min."""
    windows: int = 24
    """Windows taken from each other recording, evenly spaced."""
    class_windows: int | None = None
    """Training windows of each class, evenly over its recordings; of a scarce class they hold the
    synthetic ones that fill its cell, and the measured ones in it. None takes all that `windows`
    gives.
    """
    test_windows: int | None = None
    """Windows of each class in each test, evenly over its recordings; None takes as many as the
    smallest class has.
    """
    held_out: int = 2
    """Specimens that nothing is trained on."""
    splits: tuple[str, str] = ("L2", "L4")
    """Levels of generalization of the tests: known specimens, and those held out. With
    `RANDOM_WINDOWS` in place of the nearer one its recordings stand in training and test.
    """
    faults: Mapping[str, tuple[Fault, ...]] = field(default_factory=lambda: MACHINED)
    """What the twin simulates of each class."""
    pump: Pump = field(default_factory=lambda: load_pump("25scy14-1b"))
    """Parameter set of the twin."""
    method: Calibrator = field(default_factory=IPINN)
    """How the twins are calibrated."""
    nuisances: Nuisances = field(default_factory=Nuisances)
    """Constants found beside the six values."""
    calibrated_on: Literal["fault", "law"] = "fault"
    """``"fault"``: a twin for each scarce class, on that class's training recordings at the
    pressure nearest to the scarce one; ``"law"``: one twin for all, on healthy training recordings
    of every pressure, and the recess's law on its training recordings.
    """

    def __post_init__(self) -> None:
        unknown = [name for name in self.scarce if name not in self.faults]
        if unknown:
            raise InputError(
                f"faults has nothing for the scarce class {unknown[0]!r}; say what the twin simulates."
            )

    def is_at_pressure(self, recording: Recording) -> bool:
        """Whether a recording is at the scarce cells' pressure."""
        condition = recording.condition
        return condition is not None and bool(
            values_match(condition.discharge_pressure, self.pressure, PRESSURE_TOLERANCE)
        )

    def is_scarce(self, recording: Recording) -> bool:
        """Whether a recording lies in a scarce cell."""
        return recording.label in self.scarce and self.is_at_pressure(recording)

    def describe(self) -> dict[str, Any]:
        """The scenario as JSON can hold it."""
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
            "faults": {
                name: [_fault(fault) for fault in self.faults[name]] for name in self.scarce
            },
            "pump": {
                "name": self.pump.name,
                "sha256": hashlib.sha256(repr(self.pump).encode()).hexdigest(),
            },
            "method": {"name": type(self.method).__name__, **_settings(self.method)},
            "nuisances": _settings(self.nuisances),
            "calibrated_on": self.calibrated_on,
            "class_windows": self.class_windows,
        }


def _fault(fault: Fault) -> dict[str, Any]:
    return {"kind": type(fault).__name__, **asdict(fault)}


def _settings(settings: Any) -> dict[str, Any]:
    """Fields that JSON can hold; others in words."""
    plain = (bool, int, float, str, list, tuple, dict, type(None))
    return {
        name: value if isinstance(value, plain) else repr(value)
        for name, value in vars(settings).items()
    }


@dataclass(frozen=True, eq=False)
class ScenarioSplit:
    """Recording ids by role."""

    train: frozenset[str]
    """Train, outside the scarce cells."""
    scarce: Mapping[str, tuple[str, ...]]
    """Of each scarce class, the recordings that may lend its few windows, in the order in which
    they are asked.
    """
    references: frozenset[str]
    """Healthy recordings of the specimens held out: what such a machine has from its first days.
    Set aside and never tested on, so that a classifier that compares with them is tested on the
    same windows as one that does not. None of the studies' does: it gained nothing on the fleets
    that it was tried on (docs/explanation/networks.md).
    """
    tests: Mapping[str, frozenset[str]]
    """Recordings of each test, by its split."""


def split_scenario(recordings: Sequence[Recording], scenario: Scenario, seed: int) -> ScenarioSplit:
    """Which recordings train, which are references and which test, under `seed`.

    Of each training specimen, class and pressure a third of the recordings test (at least one) and
    the others train. Specimens for the farther test are drawn first; of each of their healthy cells
    one recording is a reference, where another is left to test.

    Raises
    ------
    DataError
        The recordings cannot be split so: too few specimens or repeats, a fact missing.
    """
    familiar, unseen = scenario.splits
    rng = random_stream(seed, "scenario", "split")
    specimens = sorted({str(r.specimen) for r in recordings})
    least = scenario.held_out + 1
    if len(specimens) < least:
        raise DataError(
            f"the study needs at least {least} specimens, {scenario.held_out} of them held out; the "
            f"recordings name {len(specimens)} ({', '.join(specimens)}). Give each recording its specimen in the index."
        )
    order_of_specimens = rng.permutation(specimens).tolist()
    held_out = set(order_of_specimens[: scenario.held_out])
    train: set[str] = set()
    references: set[str] = set()
    lenders_by_class: dict[str, list[list[str]]] = {name: [] for name in scenario.scarce}
    tests: dict[str, set[str]] = {familiar: set(), unseen: set()}
    for cell in recordings_by_cell(recordings, "the study"):
        order = [cell[i] for i in rng.permutation(len(cell))]
        ids = [r.recording_id for r in order]
        if order[0].specimen in held_out:
            spare = (
                1
                if order[0].label == "normal"
                and (len(ids) > 1 or not scenario.is_at_pressure(order[0]))
                else 0
            )
            references |= set(ids[:spare])
            tests[unseen] |= set(ids[spare:]) if scenario.is_at_pressure(order[0]) else set()
            continue
        count = _training_count(order, scenario)
        tests[familiar] |= set(ids[count:]) if scenario.is_at_pressure(order[0]) else set()
        if scenario.is_scarce(order[0]):
            lenders_by_class[str(order[0].label)].append(ids[:count])
        else:
            train |= set(ids[:count])
    for split, whose in ((familiar, "trained on"), (unseen, "held out")):
        if not tests[split]:
            raise DataError(
                f"the study tests at {scenario.pressure / 1e6:g} MPa, the pressure of the paper's cases, and the "
                f"specimens that are {whose} have no recording to test there."
            )
    lenders = {name: _in_turns(lists, rng) for name, lists in lenders_by_class.items()}
    return ScenarioSplit(
        frozenset(train),
        lenders,
        frozenset(references),
        {name: frozenset(ids) for name, ids in tests.items()},
    )


def _training_count(cell: Sequence[Recording], scenario: Scenario) -> int:
    """How many recordings of a training specimen's cell train."""
    if len(cell) > 1:
        return len(cell) - max(1, len(cell) // 3)
    if scenario.is_at_pressure(cell[0]):
        raise DataError(
            f"the study needs two recordings of {cell[0].label} at {scenario.pressure / 1e6:g} MPa of specimen "
            f"{cell[0].specimen}, one to train and one to test; there is one, {cell[0].recording_id}."
        )
    return 1


def _in_turns(lists: Sequence[Sequence[str]], rng: np.random.Generator) -> tuple[str, ...]:
    """One recording of each specimen after the other, then the second ones: the first few share one
    specimen each.
    """
    order = [lists[i] for i in rng.permutation(len(lists))]
    most = max((len(ids) for ids in order), default=0)
    return tuple(ids[turn] for turn in range(most) for ids in order if turn < len(ids))
