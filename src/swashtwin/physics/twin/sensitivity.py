"""Which numbers of a pump file its vibration depends on."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from swashtwin.foundation import InputError
from swashtwin.physics.twin.model import Twin
from swashtwin.pump import Pump, in_trade_units, pump_numbers, with_number

SHARE = 0.05
"""Relative change of a number."""
ANGLE = math.radians(2)
"""Change of an angle at which a kidney opens or closes [rad]: 5 % of one would be another valve plate."""
TEMPERATURE = 5.0
"""Change of a temperature [K]."""


@dataclass(frozen=True)
class Sensitivity:
    """What a number of a pump does to the vibration."""

    path: str
    """Path of the number, such as ``masses.shell``."""
    step: str
    """By how much it was changed, in words."""
    effect: float
    """Norm of the change of all line amplitudes over the norm of the amplitudes, all sensors together."""


def sensitivities(twin: Twin) -> tuple[Sensitivity, ...]:
    """Effect of each number of the twin's pump on its lines, the largest first.

    Each number is changed alone, by 5 % (a kidney's edge by 2 degrees, a temperature by 5 K), up or, where the pump
    could not be built so, down. It is the effect on this twin's amplitudes below its bandwidth, not on the phases.
    """
    before = _amplitudes(twin)
    effects = []
    for path, value, unit in pump_numbers(twin.pump):
        if path == "rotating_group.piston_count" or path.startswith("rated."):
            continue
        pump, step = _changed(twin.pump, path, value, unit)
        after = _amplitudes(Twin(pump, twin.condition, twin.fault, bandwidth=twin.bandwidth))
        effects.append(Sensitivity(path, step, float(np.linalg.norm(after - before) / np.linalg.norm(before))))
    return tuple(sorted(effects, key=lambda entry: -entry.effect))


def _amplitudes(twin: Twin) -> np.ndarray:
    with torch.no_grad():
        return np.abs(twin.acceleration().numpy())


def _changed(pump: Pump, path: str, value: Any, unit: str) -> tuple[Pump, str]:
    """The pump with one number changed, and by how much."""
    if path.startswith("valve_plate.") and path.endswith(("_open", "_close")):
        steps = [
            (value + sign * ANGLE, f"{'+' if sign > 0 else '-'}{in_trade_units(ANGLE, 'rad')}") for sign in (1, -1)
        ]
    elif unit == "K":
        steps = [(value + TEMPERATURE, f"+{TEMPERATURE:g} K")]
    else:
        steps = [(_times(value, 1 + sign * SHARE), f"{sign * SHARE:+.0%}") for sign in (1, -1)]
    try:
        return with_number(pump, path, steps[0][0]), steps[0][1]
    except InputError:
        return with_number(pump, path, steps[-1][0]), steps[-1][1]


def _times(value: Any, factor: float) -> Any:
    return tuple(number * factor for number in value) if isinstance(value, tuple) else value * factor
