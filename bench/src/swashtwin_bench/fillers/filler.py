"""Fillers of scarce cells: their protocol, the windows they draw from, and their result."""

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
    """A method that makes windows for a cell (class and discharge pressure) with too few of them.

    A filler is fitted on the measured windows of `train` only. Its windows have their layout and
    classes, are marked ``synthetic=True``, and are the same for the same seed.
    """

    def __call__(
        self, train: WindowSet, *, label: str, pressure: float, count: int, seed: int
    ) -> WindowSet:
        """Return `count` synthetic windows of `label` at `pressure`.

        Parameters
        ----------
        train : training windows with labels; never test windows. Synthetic windows among them are
            ignored.
        label : class of the cell, one of the windows' classes.
        pressure : discharge pressure of the cell [Pa]; NaN for windows of unknown pressure.
        count : number of windows.
        seed : seed of all draws.

        Raises
        ------
        InputError
            The class, the pressure or the count is invalid.
        DataError
            There are no measured windows of the class.
        """
        ...


def in_cell(windows: WindowSet, label: str, pressure: float) -> np.ndarray:
    """Return the mask of the measured windows of `label` at `pressure` [Pa].

    For NaN it selects the windows of unknown pressure.
    """
    is_at_pressure = values_match(windows.discharge_pressure, pressure, PRESSURE_TOLERANCE)
    return ~windows.synthetic & (windows.label == label) & is_at_pressure


def find_sources(train: WindowSet, label: str, pressure: float) -> Int64[np.ndarray, " source"]:
    """Return the indices of the measured windows of a cell, or of its class if the cell has none.

    Raises
    ------
    InputError
        The class or the pressure is invalid.
    DataError
        No window of the class was measured. Only a twin can fill such a cell.
    """
    if label not in train.classes:
        raise InputError(
            f"Class {label!r} is not among the windows' classes ({', '.join(train.classes)})."
        )
    if not (math.isnan(pressure) or 0 < pressure < math.inf):
        raise InputError(
            f"pressure ({pressure:g} Pa) must be positive, or math.nan if it is unknown."
        )

    is_source = in_cell(train, label, pressure)
    if not is_source.any():
        is_source = ~train.synthetic & (train.label == label)
    if not is_source.any():
        raise DataError(
            f"There is no measured window of {label} at any pressure to draw from; a twin can "
            "simulate some (synthesize)."
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
    """Return `signal` as windows of a cell.

    Parameters
    ----------
    sources : index in `train` of the window from which each was made; its speed is taken over.
    name : name of the filler.
    """
    specimens = [f"{name} of {specimen}" for specimen in train.specimen[sources]]
    return build_windows(
        signal,
        like=train,
        name=name,
        label=label,
        pressure=np.full(len(signal), float(pressure)),
        speed=train.speed[sources].astype(float),
        specimen=np.array(specimens, dtype=np.str_),
        seed=seed,
    )
