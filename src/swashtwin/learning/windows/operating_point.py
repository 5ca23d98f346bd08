"""Operating points of recordings, and whether windows of a model run at those that were measured."""

import math

import numpy as np
from jaxtyping import Float, Float64, Int, Int64

from swashtwin.foundation import InputError
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.pump import PRESSURE_TOLERANCE, SPEED_TOLERANCE, merge_close_values, values_match

SYNTHETIC_SPEED_TOLERANCE = 0.03
"""Relative difference of speeds: the slip of a motor, and the spread with which synthetic windows are drawn."""


def require_shared_speed(measured: WindowSet, synthetic: WindowSet) -> None:
    """Refuse synthetic windows that run at no speed that was measured; those without a stated speed pass."""
    refuse_other_values(
        synthetic.speed, measured.speed[~measured.synthetic], quantity="speed", who="the synthetic windows run",
        remedy="make synthetic windows with a twin that is calibrated on these recordings",
    )  # fmt: skip


def refuse_other_values(
    simulated: Float[np.ndarray, " simulated"],
    measured: Float[np.ndarray, " measured"],
    *,
    quantity: str,
    who: str,
    remedy: str,
) -> None:
    """Refuse a model none of whose values matches a measured one; the error names both.

    Parameters
    ----------
    simulated, measured : speeds [rad/s] or discharge pressures [Pa], NaN where not stated.
    quantity : ``"speed"`` or ``"pressure"``.
    who : whose values `simulated` are, with a verb: ``"the twin runs"``.
    remedy : what to do.
    """
    tolerance, factor, unit = {
        "speed": (SYNTHETIC_SPEED_TOLERANCE, 30 / math.pi, "rev/min"),
        "pressure": (PRESSURE_TOLERANCE, 1e-6, "MPa"),
    }[quantity]
    simulated, measured = (np.unique(values[~np.isnan(values)]) for values in (simulated, measured))
    is_shared = any(np.any(values_match(measured, value, tolerance)) for value in simulated.tolist())
    if is_shared or not (simulated.size and measured.size):
        return
    texts = []
    for values in (simulated, measured):
        low, high = (f"{value * factor:.4g}" for value in (values.min(), values.max()))
        texts.append(f"{low} {unit}" if low == high else f"{low} to {high} {unit}")
    raise InputError(f"{who} at {texts[0]} and the recordings state {texts[1]}: they are not alike; {remedy}.")


def operating_points(
    condition: Float[np.ndarray, "recording quantity"],
) -> tuple[Float64[np.ndarray, "point quantity"], Int64[np.ndarray, " recording"]]:
    """(speed [rad/s] and pressure [Pa] of each operating point, index of each recording's); close ones are one."""
    tolerances = (SPEED_TOLERANCE, PRESSURE_TOLERANCE)
    merged = [merge_close_values(column, limit) for column, limit in zip(condition.T, tolerances, strict=True)]
    points, point = np.unique(np.stack(merged, axis=1), axis=0, return_inverse=True)
    return points, point.reshape(-1)


def group_means(
    rows: Float[np.ndarray, "row *axes"], group: Int[np.ndarray, " row"]
) -> Float[np.ndarray, "group *axes"]:
    """Mean of the rows of each group 0, 1, ..."""
    return np.stack([rows[group == number].mean(axis=0) for number in range(int(group.max()) + 1)])
