"""Whether windows of a model run as the machine that was measured."""

import math

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import InputError
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.pump import PRESSURE_TOLERANCE, values_match

SYNTHETIC_SPEED_TOLERANCE = 0.03
"""Relative difference of speeds: the slip of a motor, and the spread with which synthetic windows are drawn."""


def require_shared_speed(measured: WindowSet, synthetic: WindowSet) -> None:
    """Refuse synthetic windows that run at no speed that was measured; the error names the speeds of both.

    Windows without a stated speed pass: that they run alike cannot be known.

    Raises
    ------
    InputError
        No synthetic window runs at a speed that a measured one states.
    """
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
    there, here = (_range(values * factor, unit) for values in (simulated, measured))
    raise InputError(f"{who} at {there} and the recordings state {here}: they are not alike; {remedy}.")


def _range(values: Float[np.ndarray, " n"], unit: str) -> str:
    low, high = f"{values.min():.4g}", f"{values.max():.4g}"
    return f"{low} {unit}" if low == high else f"{low} to {high} {unit}"
