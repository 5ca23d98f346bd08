"""Cells of training data, which of them are short of recordings, and which are to be filled.

A *cell* is a class at an operating point (speed and discharge pressure).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal, get_args

import numpy as np

from swashtwin.foundation import InputError
from swashtwin.learning import WindowSet, operating_points
from swashtwin.pump import FAULT_KINDS, Fault, OperatingCondition, format_quantity

Fill = Literal["cells", "points", "all"]
"""Which cells are filled: the short ones alone; every class at the operating points that have a
short cell; or every class at every operating point.
"""

FILLS: tuple[Fill, ...] = get_args(Fill)

DEFAULT_FILL: Fill = "points"
"""A class that alone gets simulated windows has more assemblies and severities than the others, and
draws their recordings to itself. On five choosing fleets ``"all"`` was not better than ``"points"``
beyond chance, and takes three times the windows (docs/bench/filling.md).
"""

WINDOWS_PER_CELL = 72
"""Synthetic windows of each filled cell, and so assemblies and severities: as in study `filling`,
where three recordings of a cell have 54 measured windows. All filled cells get the same number, so
that no class is more diverse than another.
"""

SHORT_SHARE = 0.5
"""A cell is short if it has fewer than this share of the recordings that the measured cells at its
operating point have in the median. A split into training and test changes the counts of equally
recorded classes by one or two, which half allows for; with fewer, a class weighs less than half of
another.
"""


NO_OPERATING_POINT = (
    "No recording specifies both speed and discharge pressure, which a twin needs to simulate it. "
    'Add them to the index, such as speed = "860 rpm" and pressure = "15 MPa".'
)
"""Message if nothing can be simulated."""


@dataclass(frozen=True)
class PlannedCell:
    """A class at an operating point: what was measured there, and what twins add."""

    label: str
    """Class."""
    speed: float
    """Shaft speed [rad/s]."""
    pressure: float
    """Absolute discharge pressure [Pa]."""
    n_recordings: int
    """Measured recordings."""
    n_windows: int
    """Measured windows."""
    is_short: bool
    """Whether it has too few recordings beside the other cells of the operating point
    (`SHORT_SHARE`).
    """
    faults: tuple[Fault | None, ...] = ()
    """Faults that twins simulate for the class, in turns; None is a healthy pump. Empty if they
    simulate no fault of the class.
    """
    count: int = 0
    """Synthetic windows."""

    @property
    def point(self) -> tuple[float, float]:
        """Speed and pressure of the operating point."""
        return self.speed, self.pressure

    @property
    def condition(self) -> OperatingCondition:
        """The operating point, with default values of what recordings seldom specify."""
        return OperatingCondition(speed=self.speed, discharge_pressure=self.pressure)

    @property
    def point_text(self) -> str:
        """The operating point in the units of the trade."""
        return f"{self.speed * 30 / np.pi:.4g} rpm, {format_quantity(self.pressure, 'Pa', 4)}"

    @property
    def fault_text(self) -> str:
        """The faults with their severities; empty if there are none."""
        return " or ".join(map(describe_fault, self.faults))


def describe_fault(fault: Fault | None) -> str:
    """Return the name of a fault with its severity.

    Examples
    --------
    >>> from swashtwin.pump import PistonWear
    >>> describe_fault(PistonWear(clearance=60e-6)), describe_fault(None)
    ('piston, clearance 60 um', 'healthy')
    """
    if fault is None:
        return "healthy"

    names = [name for name, typical in FAULT_KINDS.items() if type(typical) is type(fault)]
    name = names[0] if names else type(fault).__name__
    dimension = fields(fault)[0].name
    severity = format_quantity(fault.severity, fault.units.get(dimension, "1"), 3)
    return f"{name}, {dimension} {severity}"


def require_fill(fill: str) -> None:
    """Raise an `InputError` if there is no such way to fill."""
    if fill not in FILLS:
        raise InputError(f"Invalid fill {fill!r}: must be one of {', '.join(FILLS)}.", field="fill")


def count_cells(measured: WindowSet, labels: Iterable[str]) -> list[PlannedCell]:
    """Return the cell of each class at each operating point that was measured.

    Parameters
    ----------
    measured : measured windows. Those that specify no speed or pressure are in no cell.
    labels : classes, also those that no window has.

    Raises
    ------
    InputError
        No window specifies its operating point.
    """
    condition = np.stack([measured.speed, measured.discharge_pressure], axis=1)
    is_known = np.isfinite(condition).all(axis=1)
    if not is_known.any():
        raise InputError(NO_OPERATING_POINT)

    located_windows = measured.subset(is_known)
    points, point_index = operating_points(condition[is_known])
    cells = []
    for number, (speed, pressure) in enumerate(points.tolist()):
        counts = []
        for label in labels:
            in_cell = (point_index == number) & (located_windows.label == label)
            recordings = set(located_windows.recording_id[in_cell].tolist())
            counts.append((label, len(recordings), int(in_cell.sum())))

        median = np.median([n_recordings for _, n_recordings, _ in counts if n_recordings] or [0])
        for label, n_recordings, n_windows in counts:
            is_short = n_recordings < SHORT_SHARE * median
            cells.append(
                PlannedCell(label, speed, pressure, n_recordings, n_windows, bool(is_short))
            )
    return cells


def plan_cells(
    cells: Sequence[PlannedCell],
    faults: Mapping[str, tuple[Fault | None, ...]],
    *,
    fill: Fill,
    count: int,
) -> tuple[PlannedCell, ...]:
    """Return the cells with the faults of their classes and the number of synthetic windows.

    Parameters
    ----------
    faults : faults that twins simulate by class; empty for a class that they do not simulate.
    count : synthetic windows of each cell that is filled.
    """
    with_faults = [replace(cell, faults=faults[cell.label]) for cell in cells]

    # A point whose only short class cannot be simulated gains nothing from the other classes.
    short_points = {cell.point for cell in with_faults if cell.is_short and cell.faults}
    planned = []
    for cell in with_faults:
        is_selected = {
            "cells": cell.is_short,
            "points": cell.point in short_points,
            "all": True,
        }[fill]
        planned.append(replace(cell, count=count if is_selected and cell.faults else 0))
    return tuple(planned)
