"""What fills a scarce cell: the protocol, the measured windows it draws from, and the windows that it hands back."""

import math
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int64, Shaped

from swashtwin.foundation import DataError, InputError
from swashtwin.learning import WindowSet
from swashtwin.pump import PRESSURE_TOLERANCE, values_match


@runtime_checkable
class Filler(Protocol):
    """What makes windows of a cell (class and discharge pressure) that has too few measured ones.

    Every one is fitted on the measured windows of `train` alone, makes windows of their layout and classes, marks them
    ``synthetic=True``, and gives the same windows for the same seed.
    """

    def __call__(self, train: WindowSet, *, label: str, pressure: float, count: int, seed: int) -> WindowSet:
        """`count` synthetic windows of `label` at `pressure`.

        Parameters
        ----------
        train : training windows with labels; never test windows. Synthetic ones among them are not looked at.
        label : class of the cell, one of the windows' classes.
        pressure : discharge pressure of the cell [Pa]; NaN for windows whose pressure nobody wrote down.
        count : how many.
        seed : addresses every draw.

        Raises
        ------
        InputError
            No such class, no such pressure, or no count.
        DataError
            There is nothing measured to make them from.
        """
        ...


def in_cell(windows: WindowSet, label: str, pressure: float) -> np.ndarray:
    """Mask of the measured windows of `label` at `pressure` [Pa], or, for NaN, without a known pressure."""
    near = values_match(windows.discharge_pressure, pressure, PRESSURE_TOLERANCE)
    return ~windows.synthetic & (windows.label == label) & near


def sources_of(train: WindowSet, label: str, pressure: float) -> Int64[np.ndarray, " source"]:
    """Indices of the measured windows that stand for a cell: its own, or, where it has none, its class's everywhere.

    Raises
    ------
    InputError
        No such class, or no such pressure.
    DataError
        Nothing of the class was measured: data alone cannot fill it, a twin can.
    """
    if label not in train.classes:
        raise InputError(f"class {label!r} is not among the windows' classes ({', '.join(train.classes)}).")
    if not (math.isnan(pressure) or 0 < pressure < math.inf):
        raise InputError(f"pressure ({pressure:g} Pa) must be positive; where none is known, math.nan.")
    own = in_cell(train, label, pressure)
    if not own.any():
        own = ~train.synthetic & (train.label == label)
    if not own.any():
        raise DataError(
            f"no measured window of {label} to draw from, at any pressure; a twin can make what nobody measured "
            "(synthesize, TwinFiller)."
        )
    return np.flatnonzero(own)


def require_count(count: int) -> None:
    """Raise an `InputError` where `count` is below 1."""
    if count < 1:
        raise InputError(f"count ({count}) must be at least 1.")


def made_windows(
    signal: Float[np.ndarray, "window channel time"],
    *,
    like: WindowSet,
    name: str,
    label: str,
    pressure: Float[np.ndarray, " window"],
    speed: Float[np.ndarray, " window"],
    specimen: Shaped[np.ndarray, " window"],
    seed: int,
) -> WindowSet:
    """`signal` as synthetic windows of the layout and the classes of `like`, each a recording of its own.

    Parameters
    ----------
    name : what made them; begins their recordings' ids.
    label : class of all.
    pressure, speed : discharge pressure [Pa] and speed [rad/s] of each.
    specimen : whose windows they are to be taken for.
    seed : ends their recordings' ids, with each window's number.
    """
    count = len(signal)
    at = ["" if math.isnan(p) else f"_{p / 1e6:.4g}MPa" for p in pressure.tolist()]
    return WindowSet(
        signal=signal.astype(np.float32),
        target=np.full(count, like.classes.index(label), dtype=np.int64),
        classes=like.classes,
        recording_id=np.array([f"{name}_{label}{at[i]}_{seed}_{i}" for i in range(count)], dtype=np.str_),
        specimen=specimen,
        discharge_pressure=pressure,
        speed=speed,
        start=np.zeros(count, dtype=np.int64),
        synthetic=np.ones(count, dtype=bool),
        sample_rate=like.sample_rate,
        channels=like.channels,
        unit=like.unit,
    )


def filled_cell(
    signal: Float[np.ndarray, "window channel time"],
    sources: Int64[np.ndarray, " window"],
    *,
    train: WindowSet,
    name: str,
    label: str,
    pressure: float,
    seed: int,
    speed: Float[np.ndarray, " window"] | None = None,
) -> WindowSet:
    """`signal` as windows of a cell, made by `name` from the windows `sources` of `train`, whose speed they have."""
    return made_windows(
        signal,
        like=train,
        name=name,
        label=label,
        pressure=np.full(len(signal), float(pressure)),
        speed=train.speed[sources].astype(float) if speed is None else speed,
        specimen=np.array([f"{name} of {one}" for one in train.specimen[sources]], dtype=np.str_),
        seed=seed,
    )
