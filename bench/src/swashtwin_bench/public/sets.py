"""Public sets of recordings, each read as it was published, and their honest splits, which keep
whole groups apart.

A set's reader takes the folder of its files and gives recordings whose `attributes` name the
groups; its docstring says which attribute is which, and what misleads in the set. No data comes
with this package.

=========================  ======================================  ===========================================
set                        labels                                  groups (attributes, or
``specimen``)
=========================  ======================================  ===========================================
``bearing_run_to_failure`` none: six bearings until they failed    ``specimen`` ``cwru``
normal, inner_race, ball, outer_race    ``specimen``, ``fault_size_mil``, ``end``
``motor_pump_industrial``  healthy, faulty                         ``block`` ``pump_cavitation``
healthy, cavitation25, 50, 75, 100      ``speed_nominal``, ``repeat`` ``uci_hydraulic``
no_, weak_, severe_leakage              ``pump_run``, ``cooler_block``
=========================  ======================================  ===========================================
"""

from collections.abc import Callable, Mapping, Sequence
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
    """Every recording of the public set `name`, in a fixed order.

    Parameters
    ----------
    name : one of `PUBLIC_SETS`.
    folder : where its files are, as published or as unpacked; it is only read.

    Raises
    ------
    InputError
        There is no such set.
    DataError
        The folder holds none of its files, or one is damaged.
    """
    if name not in PUBLIC_SETS:
        raise InputError(
            f"{name!r} is no public set that is known; there are {', '.join(PUBLIC_SETS)}."
        )
    return PUBLIC_SETS[name](Path(folder))


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
    """Groups on either side."""

    name: str
    """What is tested."""
    train: frozenset[str]
    """Groups to learn from."""
    test: frozenset[str]
    """Groups to test on."""


@dataclass(frozen=True, eq=False)
class Split:
    """Recordings of one public set, dealt so that groups stay apart."""

    name: str
    """Its name, such as ``"cwru/size"``."""
    recordings: tuple[Recording, ...]
    """Recordings of either side."""
    group: Callable[[Recording], str]
    """Group of a recording."""
    folds: tuple[Fold, ...]
    """Every pair of sides."""
    floor: float
    """Balanced accuracy by window of the reference that came with the aims: extra trees on 48
    bands.
    """


def _held_out(groups: Sequence[str]) -> tuple[Fold, ...]:
    """Each group held out once."""
    if len(groups) < 2:
        raise DataError(
            "the recordings are of one group only, so nothing can be held out; take the whole set."
        )
    return tuple(Fold(group, frozenset(groups) - {group}, frozenset({group})) for group in groups)


def _of_attribute(name: str) -> Callable[[Recording], str]:
    return lambda recording: recording.attributes[name]


def cavitation_splits(recordings: Sequence[Recording]) -> list[Split]:
    """Each nominal speed of the pump in turn."""
    group = _of_attribute("speed_nominal")
    speeds = sorted(set(map(group, recordings)), key=lambda text: parse_quantity(text, "rad/s"))
    return [Split("pump_cavitation/speed", tuple(recordings), group, _held_out(speeds), 0.38)]


def hydraulic_splits(recordings: Sequence[Recording]) -> list[Split]:
    """Runs of the pump, in five folds of whole runs, and each state of the cooler in turn."""
    splits = []
    for name, attribute, floor in (
        ("pump_run", "pump_run", 0.88),
        ("cooler", "cooler_block", 0.77),
    ):
        group = _of_attribute(attribute)
        of_recording = np.array(list(map(group, recordings)))
        names = np.unique(of_recording).tolist()
        folds = _held_out(names) if len(names) <= 3 else _five_folds(of_recording)
        splits.append(Split(f"uci_hydraulic/{name}", tuple(recordings), group, folds, floor))
    return splits


def _five_folds(group: np.ndarray) -> tuple[Fold, ...]:
    sides = GroupKFold(5).split(np.zeros(len(group)), groups=group.astype(int))
    return tuple(
        Fold(f"fold {number}", frozenset(group[train].tolist()), frozenset(group[test].tolist()))
        for number, (train, test) in enumerate(sides, start=1)
    )


def bearing_splits(recordings: Sequence[Recording]) -> list[Split]:
    """Each fault size at the drive end in turn, and the fan end after the drive end; recordings at
    12 kHz.

    Outer races of the drive end are those damaged at 6 o'clock, in the load zone.
    """

    def group(recording: Recording) -> str:
        return f"{recording.attributes['end']} {recording.attributes['fault_size_mil']}"

    def is_used(recording: Recording) -> bool:
        facts = recording.attributes
        beside = (
            recording.label == "outer_race" and facts["end"] == "DE" and facts["or_position"] != "6"
        )
        sound = (
            recording.label in ("ball", "inner_race", "outer_race")
            and recording.sample_rate == 12000.0
        )
        return sound and facts["fault_size_mil"] in _CWRU_SIZES and not beside

    selected = tuple(filter(is_used, recordings))
    if not selected:
        raise DataError(
            "the CWRU folder holds no recording at 12 kHz with a fault of 7, 14 or 21 mil."
        )
    drive, fan = ([f"{end} {size}" for size in _CWRU_SIZES] for end in ("DE", "FE"))
    return [
        Split("cwru/size", selected, group, _held_out(drive), 0.50),
        Split(
            "cwru/drive_to_fan",
            selected,
            group,
            (Fold("fan end", frozenset(drive), frozenset(fan)),),
            0.29,
        ),
    ]


def motor_splits(recordings: Sequence[Recording]) -> list[Split]:
    """A block of each class on either side."""
    folds = tuple(
        Fold(" + ".join(test), frozenset(train), frozenset(test)) for train, test in _MOTOR_BLOCKS
    )
    return [
        Split("motor_pump_industrial/block", tuple(recordings), _of_attribute("block"), folds, 0.62)
    ]


SPLITS: Mapping[str, Callable[[Sequence[Recording]], list[Split]]] = {
    "pump_cavitation": cavitation_splits,
    "uci_hydraulic": hydraulic_splits,
    "cwru": bearing_splits,
    "motor_pump_industrial": motor_splits,
}
"""Honest splits of each set."""
