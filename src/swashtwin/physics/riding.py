"""How slippers ride through a recess one by one, pressed by their chambers: they lift off, and land with an impact.

No film holds a slipper down. Over the swash plate's surface H (`recess`) the displacement s of a slipper obeys

    s <= H    and    m s'' <= F cos(gamma),    one of them with equality,

F being the force along the shaft that presses it on: of its chamber, of its share in the central spring and of its own
acceleration on the tilted plane. Where the surface falls away faster than F moves the slipper, or throws it off at the
end of the recess, its contact force (F - m s'' / cos gamma) / cos gamma is zero until it lands. It does not rebound:
the film damps m within C_sw / n, in less than a microsecond. Ours; docs/explanation/physics.md, section 2.5.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import no_type_check

import numpy as np
from jaxtyping import Complex, Float

from swashtwin.foundation import compiled
from swashtwin.physics.excitation import combined_lines, slipper_profile, stages
from swashtwin.physics.loads import LoadCase, chamber_pressures
from swashtwin.pump import OperatingCondition, Pump, SwashPlateDefect
from swashtwin.signals import fourier_lines

STEPS = 16384
"""Time steps of a revolution. At 860 rev/min one is 4 microseconds; a loaded slipper falls by 0.07 mm in 80."""


@dataclass(frozen=True, eq=False)
class Ride:
    """One revolution of one slipper, on a uniform grid of its own shaft angle that starts at 0."""

    angle: Float[np.ndarray, " step"]
    """Its shaft angle [rad]."""
    displacement: Float[np.ndarray, " step"]
    """Its displacement s into the recess [m]."""
    force: Float[np.ndarray, " step"]
    """Normal force between it and the swash plate [N]: never below zero, and zero in flight."""

    @property
    def in_flight(self) -> float:
        """Share of the revolution during which it touches nothing [1]."""
        return float(np.mean(self.force <= 1e-9 * self.force.max()))


def pressing_force(
    pump: Pump, condition: OperatingCondition, angle: Float[np.ndarray, " angle"]
) -> Float[np.ndarray, " angle"]:
    """Force along the shaft that presses a slipper on [N] at shaft `angle` [rad], as in a healthy pump, not below 0."""
    group, tight = pump.rotating_group, chamber_pressures([LoadCase(pump, condition)])
    pressure = np.interp(angle, tight.angle, tight.chamber[0, 0], period=2 * math.pi)
    lift = group.pitch_radius * math.tan(group.swash_angle) * condition.speed**2
    spring = pump.coupling.spring_preload / group.piston_count
    force = group.piston_area * (pressure - condition.case_pressure) + spring
    return np.maximum(force - pump.masses.piston_slipper * lift * np.cos(angle), 0.0)


@lru_cache(maxsize=64)
def ride(pump: Pump, condition: OperatingCondition, defect: SwashPlateDefect) -> Ride:
    """How a slipper of `pump` rides through `defect`, once a revolution; under pressure it lands at the latest."""
    angle = 2 * math.pi * np.arange(STEPS) / STEPS
    mass, tilt = pump.masses.piston_slipper, math.cos(pump.rotating_group.swash_angle)
    first = int((defect.angle - stages(pump, defect).total / 2) / (2 * math.pi) * STEPS) - 1
    step = condition.period / STEPS
    pressed = pressing_force(pump, condition, angle)
    surface = np.roll(slipper_profile(pump, defect, angle)[0], -first)
    displacement = np.roll(_path(surface, np.roll(pressed, -first) * (step**2 * tilt / mass)), first)
    curvature = np.roll(displacement, -1) - 2 * displacement + np.roll(displacement, 1)
    force = (pressed - mass / tilt * curvature / step**2) / tilt
    return Ride(angle, displacement, np.where(force > 1e-9 * pressed.max(), force, 0.0))


@compiled
@no_type_check
def _path(surface, falls):
    """Displacement [m] over a `surface` [m], where it is free to fall by `falls` [m] more in each step."""
    path = np.zeros(surface.size)
    for k in range(1, surface.size - 1):
        path[k + 1] = min(2 * path[k] - path[k - 1] + falls[k], surface[k + 1])
    return path


def riding_lines(
    pump: Pump,
    condition: OperatingCondition,
    defect: SwashPlateDefect,
    n_lines: int,
    *,
    scatter: Float[np.ndarray, " slipper"] | None = None,
) -> Complex[np.ndarray, " line"]:
    """Order lines 1...`n_lines` [m] of the total displacement of all slippers, in place of `displacement_lines`."""
    lines = fourier_lines(ride(pump, condition, defect).displacement)[1 : n_lines + 1]
    return combined_lines(pump, np.arange(1, n_lines + 1), scatter) * lines
