"""What differs from one synthetic window to the next."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from swashtwin.foundation import celsius, stream
from swashtwin.physics import Twin


@dataclass(frozen=True)
class Variation:
    """Spreads of what is drawn for each synthetic window, besides the shaft's phase. Zero switches one off.

    Speed, pressure and temperature follow docs/explanation/physics.md, section 5. Severity, angle, interface values and
    sensor are estimates of ours. Severity and angle are those of somebody who knows a fault's typical size and place,
    and not how they differ from pump to pump: 95 % of the severities are within a factor of two, of the places within
    10 degrees. Those of version 1 of the virtual rig spread less (docs/bench/rig.md). The interface values spread
    alike; what a calibration leaves open of each comes on top of it (`synthesize`).
    """

    speed: float = 0.005
    """Half-width of the uniform spread of the speed, relative."""
    pressure: float = 0.03
    """Half-width of the uniform spread of the discharge pressure, relative."""
    severity: float = 0.35
    """Standard deviation of the logarithm of the fault's severity."""
    angle: float = math.radians(5)
    """Standard deviation of the position of a swash plate or bore defect [rad]."""
    temperature: tuple[float, float] = (celsius(30), celsius(60))
    """Range of the oil temperature [K]; it acts on the leakage only, not on the films' damping."""
    interfaces: float = 0.1
    """Standard deviation of the logarithm of each interface value."""
    sensor: float = 0.04
    """Standard deviation of each channel's gain, relative."""


DEFAULT_VARIATION = Variation()
"""Spread around the twin where nobody states one."""


def draw_twin(twin: Twin, variation: Variation, seed: int, index: int) -> Twin:
    """`twin` with its condition, fault and interface values as `variation` spreads them.

    Parameters
    ----------
    seed, index : address the draw; the same ones give the same twin.
    """
    rng = stream(seed, "variation", twin.label, index)
    condition = replace(
        twin.condition,
        speed=twin.condition.speed * (1 + variation.speed * rng.uniform(-1, 1)),
        discharge_pressure=twin.condition.discharge_pressure * (1 + variation.pressure * rng.uniform(-1, 1)),
        oil_temperature=rng.uniform(*variation.temperature),
    )
    fault = twin.fault
    if fault is not None:
        fault = fault.scaled(float(np.exp(rng.normal(0, variation.severity))))
        if hasattr(fault, "angle"):
            angle: dict[str, Any] = {"angle": abs(fault.angle + rng.normal(0, variation.angle))}
            fault = replace(fault, **angle)
    values = twin.values.numpy() * np.exp(rng.normal(0, variation.interfaces, 6))
    interfaces = type(twin.pump.interfaces).from_values(values)
    return replace(twin, condition=condition, fault=fault, interfaces=interfaces)
