"""Fillers of scarce cells: the protocol, the measured windows a filler draws from and its
result.
"""

import math
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int64

from swashtwin.foundation import DataError, InputError
from swashtwin.learning import WindowSet
from swashtwin.pump import PRESSURE_TOLERANCE, values_match
from swashtwin.synthesis import build_windows


@runtime_checkable
class Filler(Protocol):
    """Maker of windows for a cell (class and discharge pressure) that has too few measured ones.

    A filler is fitted on the measured windows of `train` alone, makes windows of their layout and
    classes, marks them ``synthetic=True``, and gives the same windows for the same seed.
    """

    def __call__(
        self, train: WindowSet, *, label: str, pressure: float, count: int, seed: int
    ) -> WindowSet:
        """`count` synthetic windows of `label` at `pressure`.

        Parameters
        ----------
        train : training windows with labels; never test windows. Synthetic windows among them are
            ignored.
        label : class of the cell, one of the windows' classes.
        pressure : discharge pressure of the cell [Pa]; NaN for windows without a stated pressure.
        count : how many.
        seed : addresses every draw.

        Raises
        ------
        InputError
            No such class, no such pressure, or no count.
        DataError
            There are no measured windows to make them from.
        """
        ...


def in_cell(windows: WindowSet, label: str, pressure: float) -> np.ndarray:
    """Mask of the measured windows of `label` at `pressure` [Pa], or, for NaN, without a known
    pressure.
    """
    is_near = values_match(windows.discharge_pressure, pressure, PRESSURE_TOLERANCE)
    return ~windows.synthetic & (windows.label == label) & is_near


def find_sources(train: WindowSet, label: str, pressure: float) -> Int64[np.ndarray, " source"]:
    """Indices of the measured windows that stand for a cell: those in it, or, where there is none,
    those of its class.

    Raises
    ------
    InputError
        No such class, or no such pressure.
    DataError
        No window of the class was measured. Only a twin can fill such a cell.
    """
    if label not in train.classes:
        raise InputError(
            f"class {label!r} is not among the windows' classes ({', '.join(train.classes)})."
        )
    if not (math.isnan(pressure) or 0 < pressure < math.inf):
        raise InputError(
            f"pressure ({pressure:g} Pa) must be positive; where none is stated, math.nan."
        )
    is_source = in_cell(train, label, pressure)
    if not is_source.any():
        is_source = ~train.synthetic & (train.label == label)
    if not is_source.any():
        raise DataError(
            f"no measured window of {label} to draw from, at any pressure; a twin can make windows of it (synthesize)."
        )
    return np.flatnonzero(is_source)


def fill_cell(
    signal: Float[np.ndarray, "window channel time"],
    sources: Int64[np.ndarray, " window"],
    *,
    train: WindowSet,
    name: str,
    label: str,
    pressure: float,
    seed: int,
) -> WindowSet:
    """`signal` as windows of a cell, made by `name` from the windows `sources` of `train`, whose
    speed they have.
    """
    return build_windows(
        signal,
        like=train,
        name=name,
        label=label,
        pressure=np.full(len(signal), float(pressure)),
        speed=train.speed[sources].astype(float),
        specimen=np.array(
            [f"{name} of {specimen}" for specimen in train.specimen[sources]], dtype=np.str_
        ),
        seed=seed,
    )
