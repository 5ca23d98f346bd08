"""Pressure of every chamber over the shaft angle, for a batch of pumps at once.

Each chamber follows dp/dtheta = B / (omega V) [Q_suction - Q_discharge - G (p - p_case)] - B / V dV/dtheta, and the
outlet line follows the sum of the flows into it less that of its relief valve (docs/physics.md, section 5). Backward
Euler over a uniform grid of the shaft angle; each step is solved by Newton's method, whose matrix is an arrow (chambers
meet only in the line), with a step halved wherever it changes sign. Pressures and coefficients have one column a case,
so that a time loop serves them all; a case that has converged waits unchanged for the others, which makes a batch equal
to its cases.
"""

import math
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float

SMOOTHING = 2e4
"""Pressure difference [Pa] below which the square root law of an orifice turns linear."""
FLOOR = 1e3
"""Lowest pressure [Pa]; oil cavitates rather than fall below it."""
AIR_FLOOR = 5e4
"""Lowest pressure [Pa] at which free air is still compressed as a gas."""
ATMOSPHERE = 1e5
"""Pressure [Pa] at which the fraction of free air is stated."""
TOLERANCE = 1.0
"""Newton step [Pa] after which a pressure is solved: the next one would be smaller by orders of magnitude."""
ITERATIONS = 60
"""Newton iterations of one step before it counts as failed."""


@dataclass(frozen=True, eq=False)
class Chambers:
    """Coefficients of the chambers and outlet lines of a batch."""

    volume: Float[np.ndarray, "angle case"]
    """Volume of a chamber whose piston stands at that angle [m^3]."""
    swept: Float[np.ndarray, "angle case"]
    """Its growth dV/dphi [m^3/rad]."""
    suction_opening: Float[np.ndarray, "angle case"]
    """Flow through the suction port over the root of the pressure difference [m^3/(s Pa^0.5)]."""
    discharge_opening: Float[np.ndarray, "angle case"]
    """The same of the discharge port [m^3/(s Pa^0.5)]."""
    leakage: Float[np.ndarray, "angle case"]
    """Leakage to the case that all chambers share [m^3/(s Pa)]."""
    piston_leakage: Float[np.ndarray, "angle case"]
    """Leakage along a piston over its clearance cubed [1/(s Pa)]."""
    cubed_clearance: Float[np.ndarray, "piston case"]
    """Cube of the pistons' radial clearances [m^3]."""
    scratch_leakage: Float[np.ndarray, "piston case"]
    """Leakage of single chambers [m^3/(s Pa)]."""
    speed: Float[np.ndarray, " case"]
    """Angular speed of the shaft [rad/s]."""
    bulk_modulus: Float[np.ndarray, " case"]
    """Bulk modulus of the oil without free air [Pa]."""
    air_fraction: Float[np.ndarray, " case"]
    """Volume fraction of free air at 100 kPa [1]."""
    suction_pressure: Float[np.ndarray, " case"]
    """Pressure in the suction port [Pa]."""
    discharge_pressure: Float[np.ndarray, " case"]
    """Pressure at which the outlet line starts [Pa]."""
    case_pressure: Float[np.ndarray, " case"]
    """Pressure in the housing [Pa]."""
    line_volume: Float[np.ndarray, " case"]
    """Volume of the outlet line [m^3]."""
    relief_slope: Float[np.ndarray, " case"]
    """Flow of the relief valve over the pressure above cracking [m^3/(s Pa)]."""
    cracking_pressure: Float[np.ndarray, " case"]
    """Pressure at which the relief valve opens [Pa]."""


class NotConverged(Exception):
    """Newton's method failed at a step; `case` and `angle` [rad] say where."""

    def __init__(self, case: int, angle: float) -> None:
        super().__init__(f"case {case} at {angle:g} rad")
        self.case, self.angle = case, angle


@dataclass(eq=False)
class _Step:
    """Coefficients of one backward Euler step for the columns still being solved; `opening` has both ports first."""

    opening: np.ndarray
    compliance: np.ndarray
    leakage: np.ndarray
    constant: np.ndarray
    suction: np.ndarray
    line_compliance: np.ndarray
    line_constant: np.ndarray
    relief: np.ndarray
    cracking: np.ndarray

    def only(self, columns: Bool[np.ndarray, " case"]) -> "_Step":
        return _Step(**{item.name: getattr(self, item.name)[..., columns] for item in fields(self)})


def solve(
    chambers: Chambers, revolutions: int
) -> tuple[Float[np.ndarray, "case piston angle"], Float[np.ndarray, "case angle"]]:
    """Pressures [Pa] in the chambers and in the outlet lines over the last of `revolutions`.

    Element k belongs to the shaft angle 2 pi (k + 1) / angle. The number of angles must be a multiple of the pistons'.

    Raises
    ------
    NotConverged
        A step took more than `ITERATIONS`.
    """
    n_angles, n_cases = chambers.volume.shape
    n_pistons = chambers.cubed_clearance.shape[0]
    step_time = 2 * math.pi / n_angles / chambers.speed
    over_angle = np.stack(
        [
            chambers.suction_opening,
            chambers.discharge_opening,
            step_time / chambers.volume,
            chambers.swept * chambers.speed,
            chambers.leakage,
            chambers.piston_leakage,
        ]
    )
    place = np.arange(n_pistons) * (n_angles // n_pistons)
    rising = np.sin(2 * math.pi * np.arange(n_pistons) / n_pistons) < -1e-9
    pressure = np.where(rising[:, None], chambers.discharge_pressure, chambers.suction_pressure)
    line = chambers.discharge_pressure.copy()
    chamber_out, line_out = np.empty((n_cases, n_pistons, n_angles)), np.empty((n_cases, n_angles))
    for index in range(1, revolutions * n_angles + 1):
        here = np.take(over_angle, (place + index) % n_angles, axis=1)
        pressure, line, failed = _advance(chambers, here, step_time, pressure, line)
        if failed is not None:
            raise NotConverged(failed, 2 * math.pi * (index % n_angles) / n_angles)
        chamber_out[:, :, (index - 1) % n_angles] = pressure.T
        line_out[:, (index - 1) % n_angles] = line
    return chamber_out, line_out


def _advance(
    chambers: Chambers, here: np.ndarray, step_time: np.ndarray, pressure: np.ndarray, line: np.ndarray
) -> tuple[np.ndarray, np.ndarray, int | None]:
    """Pressures one step later, and the first case that did not converge."""
    air = chambers.air_fraction * ATMOSPHERE / np.maximum(pressure, AIR_FLOOR) ** 2
    compliance = here[2] / (1 / chambers.bulk_modulus + air)
    leakage = here[4] + here[5] * chambers.cubed_clearance + chambers.scratch_leakage
    step = _Step(
        opening=here[:2],
        compliance=compliance,
        leakage=leakage,
        constant=pressure + compliance * (leakage * chambers.case_pressure - here[3]),
        suction=chambers.suction_pressure,
        line_compliance=step_time * chambers.bulk_modulus / chambers.line_volume,
        line_constant=line,
        relief=chambers.relief_slope,
        cracking=chambers.cracking_pressure,
    )
    return _newton(step, pressure, line)


def _newton(step: _Step, pressure: np.ndarray, line: np.ndarray) -> tuple[np.ndarray, np.ndarray, int | None]:
    pressure, line = pressure.copy(), line.copy()
    columns = np.arange(line.size)
    now, now_line = pressure, line
    damping, before = np.ones_like(now), np.zeros_like(now)
    for _ in range(ITERATIONS):
        change, line_change = _newton_change(step, now, now_line)
        damping = np.where(change * before < 0, 0.5 * damping, np.minimum(1.0, 1.5 * damping))
        before = change
        after = np.maximum(now + damping * change, FLOOR)
        now_line = now_line + damping.min(axis=0) * line_change
        moved = np.maximum(np.abs(after - now).max(axis=0) / damping.min(axis=0), np.abs(line_change))
        now = after
        done = moved < TOLERANCE
        if done.any():
            pressure[:, columns[done]], line[columns[done]] = now[:, done], now_line[done]
            if done.all():
                return pressure, line, None
            left = ~done
            step, columns = step.only(left), columns[left]
            now, now_line, damping, before = now[:, left], now_line[left], damping[:, left], before[:, left]
    return pressure, line, int(columns[0])


def _newton_change(step: _Step, pressure: np.ndarray, line: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Full Newton change of the chamber and the line pressures."""
    difference = np.stack([step.suction - pressure, pressure - line])
    magnitude = np.abs(difference)
    root = magnitude + SMOOTHING
    slope = step.opening / np.sqrt(root)
    flow = slope * difference
    slope *= 1 - 0.5 * magnitude / root
    residual = pressure - step.constant - step.compliance * (flow[0] - flow[1] - step.leakage * pressure)
    own = 1 + step.compliance * (slope[0] + slope[1] + step.leakage)
    to_line = -step.compliance * slope[1]
    excess = line - step.cracking
    out = step.relief * np.maximum(excess, 0.0)
    line_residual = line - step.line_constant - step.line_compliance * (flow[1].sum(axis=0) - out)
    line_own = 1 + step.line_compliance * (slope[1].sum(axis=0) + step.relief * (excess > 0))
    from_chambers = -step.line_compliance * slope[1] / own
    line_change = ((from_chambers * residual).sum(axis=0) - line_residual) / (
        line_own - (from_chambers * to_line).sum(axis=0)
    )
    return (-residual - to_line * line_change) / own, line_change
