"""Public sets of recordings, read as published, and honest splits of them.

An honest split keeps whole groups apart. A set's reader takes the folder of its files and returns
recordings whose `attributes` name the groups; its docstring describes them, and what misleads in
the set. No data comes with this package.

==========================  ====================================  ================================
set                         labels                                groups
==========================  ====================================  ================================
``bearing_run_to_failure``  none: six bearings until they failed  ``specimen``
``cwru``                    normal, inner_race, ball, outer_race  ``specimen``, ``fault_size_mil``
                                                                  and ``end``
``motor_pump_industrial``   healthy, faulty                       ``block``
``pump_cavitation``         healthy, cavitation25, 50, 75, 100    ``speed_nominal``, ``repeat``
``uci_hydraulic``           no_, weak_, severe_leakage            ``pump_run``, ``cooler_block``
==========================  ====================================  ================================
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from sklearn.model_selection import GroupKFold

from swashtwin.foundation import DataError, InputError, parse_quantity
from swashtwin.recordings import Recording
from swashtwin_bench.public.readers.cwru import read_cwru
from swashtwin_bench.public.readers.named_files import (
    read_bearing_run_to_failure,
    read_motor_pump_industrial,
    read_pump_cavitation,
)
from swashtwin_bench.public.readers.uci_hydraulic import read_uci_hydraulic

PUBLIC_SETS: dict[str, Callable[[Path], list[Recording]]] = {
    "bearing_run_to_failure": read_bearing_run_to_failure,
    "cwru": read_cwru,
    "motor_pump_industrial": read_motor_pump_industrial,
    "pump_cavitation": read_pump_cavitation,
    "uci_hydraulic": read_uci_hydraulic,
}
"""Reader of each set by its name."""


def read_public_set(name: str, folder: Path | str) -> list[Recording]:
    """Return every recording of the public set `name`, in a fixed order.

    Parameters
    ----------
    name : one of `PUBLIC_SETS`.
    folder : folder of its files, as published or as unpacked; it is only read.

    Raises
    ------
    InputError
        The set is unknown.
    DataError
        The folder holds none of its files, or one is damaged.
    """
    if name not in PUBLIC_SETS:
        raise InputError(f"Invalid public set {name!r}: must be one of {', '.join(PUBLIC_SETS)}.")

    return PUBLIC_SETS[name](Path(folder))


MAX_FOLDS_OF_ONE = 3
"""Largest number of groups of the hydraulic rig that are each held out in turn."""

# Diameters of the faults [mil] that every label of the set has.
_CWRU_SIZES = ("7", "14", "21")

# Training blocks and test blocks, one of each class on either side.
_MOTOR_BLOCKS = (
    (("hA", "fA"), ("hB", "fB")),
    (("hB", "fB"), ("hA", "fA")),
    (("hB", "fA"), ("hA", "fB")),
    (("hA", "fB"), ("hB", "fA")),
)


@dataclass(frozen=True)
class Fold:
    """Groups of the training side and of the test side."""

    name: str
    """Name of the test side."""
    train: frozenset[str]
    """Groups to learn from."""
    test: frozenset[str]
    """Groups to test on."""


@dataclass(frozen=True, eq=False)
class Split:
    """Recordings of one public set, split so that groups stay apart."""

    name: str
    """Name of the split, such as ``"cwru/size"``."""
    recordings: tuple[Recording, ...]
    """Recordings of either side."""
    group: Callable[[Recording], str]
    """Returns the group of a recording."""
    folds: tuple[Fold, ...]
    """Every pair of sides."""
    floor: float
    """Balanced accuracy by window of the reference: extra trees on 48 bands."""
    grades: tuple[str, ...] = ()
    """Labels in ascending order if they are grades of one fault; empty if they are its kinds."""

    def select(self, groups: Collection[str]) -> list[Recording]:
        """Return the recordings of some groups."""
        return [recording for recording in self.recordings if self.group(recording) in groups]


def _hold_out_each(groups: Sequence[str]) -> tuple[Fold, ...]:
    """Return a fold for each group, which is its test side."""
    if len(groups) < 2:
        raise DataError(
            "All recordings are of one group, so that none can be held out. Use the whole set."
        )

    return tuple(Fold(group, frozenset(groups) - {group}, frozenset({group})) for group in groups)


def _group_by_attribute(name: str) -> Callable[[Recording], str]:
    return lambda recording: recording.attributes[name]


# Positions of the throttle in the suction: each cuts the flow by a quarter more.
_CAVITATION_GRADES = (
    "healthy",
    "cavitation25",
    "cavitation50",
    "cavitation75",
    "cavitation100",
)


def cavitation_splits(recordings: Sequence[Recording]) -> list[Split]:
    """Return the split that holds out each nominal speed of the pump in turn.

    Its labels are grades.
    """
    group = _group_by_attribute("speed_nominal")
    groups = {group(recording) for recording in recordings}
    speeds = sorted(groups, key=lambda text: parse_quantity(text, "rad/s"))
    folds = _hold_out_each(speeds)

    split = Split(
        "pump_cavitation/speed",
        tuple(recordings),
        group,
        folds,
        floor=0.38,
        grades=_CAVITATION_GRADES,
    )
    return [split]


def hydraulic_splits(recordings: Sequence[Recording]) -> list[Split]:
    """Return splits by runs of the pump and by states of the cooler.

    Runs are in five folds of whole runs; each state of the cooler is held out in turn.
    """
    splits = []
    for name, attribute, floor in (
        ("pump_run", "pump_run", 0.88),
        ("cooler", "cooler_block", 0.77),
    ):
        group = _group_by_attribute(attribute)
        groups = np.array([group(recording) for recording in recordings])
        unique_groups = np.unique(groups).tolist()

        # To hold out each of the 37 runs would take as many trainings.
        if len(unique_groups) <= MAX_FOLDS_OF_ONE:
            folds = _hold_out_each(unique_groups)
        else:
            folds = _make_five_folds(groups)
        splits.append(Split(f"uci_hydraulic/{name}", tuple(recordings), group, folds, floor))

    return splits


def _make_five_folds(groups: np.ndarray) -> tuple[Fold, ...]:
    sides = GroupKFold(5).split(np.zeros(len(groups)), groups=groups.astype(int))
    folds = []
    for number, (train, test) in enumerate(sides, start=1):
        train_groups = frozenset(groups[train].tolist())
        test_groups = frozenset(groups[test].tolist())
        folds.append(Fold(f"fold {number}", train_groups, test_groups))

    return tuple(folds)


def bearing_splits(recordings: Sequence[Recording]) -> list[Split]:
    """Return splits of the CWRU recordings at 12 kHz.

    One holds out each fault size at the drive end in turn, the other learns at the drive end and
    tests at the fan end. Outer races of the drive end are those damaged at 6 o'clock, in the load
    zone.
    """

    def group(recording: Recording) -> str:
        return f"{recording.attributes['end']} {recording.attributes['fault_size_mil']}"

    selected = tuple(recording for recording in recordings if _is_in_bearing_splits(recording))
    if not selected:
        raise DataError(
            "The CWRU folder holds no recording at 12 kHz with a fault of 7, 14 or 21 mil."
        )

    drive_end = [f"DE {size}" for size in _CWRU_SIZES]
    fan_end = [f"FE {size}" for size in _CWRU_SIZES]
    drive_to_fan = Fold("fan end", frozenset(drive_end), frozenset(fan_end))

    return [
        Split("cwru/size", selected, group, _hold_out_each(drive_end), floor=0.50),
        Split("cwru/drive_to_fan", selected, group, (drive_to_fan,), floor=0.29),
    ]


def _is_in_bearing_splits(recording: Recording) -> bool:
    attributes = recording.attributes
    if recording.label not in ("ball", "inner_race", "outer_race"):
        return False
    if recording.sample_rate != 12000.0 or attributes["fault_size_mil"] not in _CWRU_SIZES:
        return False

    # Away from 6 o'clock the damage lies outside the load zone.
    is_drive_end_race = recording.label == "outer_race" and attributes["end"] == "DE"
    return not is_drive_end_race or attributes["or_position"] == "6"


def motor_splits(recordings: Sequence[Recording]) -> list[Split]:
    """Return the split that has a block of each class on either side."""
    folds = tuple(
        Fold(" + ".join(test), frozenset(train), frozenset(test)) for train, test in _MOTOR_BLOCKS
    )
    group = _group_by_attribute("block")

    return [Split("motor_pump_industrial/block", tuple(recordings), group, folds, floor=0.62)]


SPLITS: Mapping[str, Callable[[Sequence[Recording]], list[Split]]] = {
    "pump_cavitation": cavitation_splits,
    "uci_hydraulic": hydraulic_splits,
    "cwru": bearing_splits,
    "motor_pump_industrial": motor_splits,
}
"""Honest splits of each set."""
