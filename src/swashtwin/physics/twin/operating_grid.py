"""Forces at a shaft angle, a speed and a pressure that all change: lines on a grid of operating points.

Assumed: the chambers follow speed and outlet pressure without delay, for they settle within a revolution. So the force
at an instant is that of the steady operating point which then holds, read at the angle at which the shaft then stands.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from swashtwin.physics.contacts.loose_slipper import contact_lines
from swashtwin.physics.dynamics import N_DOF, ROTOR_XY, Structure
from swashtwin.physics.fault_forcing import excitation_lines, fault_forces, worn_values
from swashtwin.physics.loads import LoadCase, chamber_pressures, force_lines
from swashtwin.physics.twin.model import Twin
from swashtwin.physics.twin.operating_profile import OperatingProfile, Shaft
from swashtwin.signals import periodic_signal

RATIO = 1.06
"""Largest ratio of neighboring speeds, or pressures, of the grid: between them the force lines are off by 0.02 %."""
FLOOR = 1.5
"""Lowest speed whose chamber pressures are solved, over the one at which the pump would leak all it displaces."""
ORDERS = 895
"""Orders of a grid at low speeds, where more lie within the bandwidth: as many as the chambers' steps resolve."""
_TABLE = 16
"""Angles of a table, at least, per period of its highest order; read off with cubic polynomials."""
_TAPS = (-1, 0, 1, 2)
_CREEP = 1e-3
"""Speed [rad/s] that stands for standstill where a condition needs one."""


@dataclass(frozen=True, eq=False)
class OperatingGrid:
    """Force lines of a twin at the operating points around a profile."""

    speeds: Float[np.ndarray, " speed"]
    """Speeds of the grid [rad/s], rising."""
    pressures: Float[np.ndarray, " pressure"]
    """Outlet pressures of the grid [Pa], rising."""
    row_of: Int[np.ndarray, "speed pressure"]
    """Which row holds the lines of an operating point; -1 where the profile does not come."""
    lines: Complex[np.ndarray, "row order 13"]
    """Force lines [N, N m] without the unbalance, orders from 0."""
    unbalance: Complex[np.ndarray, " 2"]
    """Lines of order 1 on the rotor's x and y over the speed squared [N s^2]."""

    def corners(
        self, speed: Float[np.ndarray, " time"], pressure: Float[np.ndarray, " time"]
    ) -> list[tuple[Int[np.ndarray, " time"], Float[np.ndarray, " time"]]]:
        """Rows between which the force at each instant lies, and their weights, which sum to 1."""
        low_speed, speed_weight = _between(self.speeds, speed)
        low_pressure, pressure_weight = _between(self.pressures, pressure)
        corners = []
        for i in range(min(2, len(self.speeds))):
            for j in range(min(2, len(self.pressures))):
                weight = np.abs(1 - i - speed_weight) * np.abs(1 - j - pressure_weight)
                corners.append((self.row_of[low_speed + i, low_pressure + j], weight))
        return corners

    def lines_at(self, speed: float, pressure: float) -> Complex[np.ndarray, "order 13"]:
        """Force lines [N, N m] at one operating point, with the unbalance."""
        total = np.zeros_like(self.lines[0])
        for row, weight in self.corners(np.array([speed]), np.array([pressure])):
            total += weight[0] * self.lines[row[0]]
        total[1, ROTOR_XY] += self.unbalance * speed**2
        return total

    def tables(self, step: float) -> "ForceTables":
        """The same forces over the shaft angle, each line raised by what straight runs over `step` [s] take off."""
        active = np.flatnonzero(np.abs(self.lines).max(axis=(0, 1)) > 0)
        n_angles = 1 << math.ceil(math.log2(max(4096, _TABLE * self.lines.shape[1])))
        speed = np.empty(len(self.lines))
        i, j = np.nonzero(self.row_of >= 0)
        speed[self.row_of[i, j]] = self.speeds[i]
        turned = speed[:, None] * np.arange(self.lines.shape[1]) * step / (2 * np.pi)  # periods within a step
        spectrum = self.lines[:, :, active] / np.sinc(turned)[:, :, None] ** 2
        table = np.moveaxis(periodic_signal(np.moveaxis(spectrum, 1, -1), n_angles), -1, 1)
        wrapped = np.concatenate([table[:, -1:], table, table[:, :2]], axis=1)
        return ForceTables(self, active, n_angles, np.ascontiguousarray(wrapped).reshape(-1, len(active)))


@dataclass(frozen=True, eq=False)
class ForceTables:
    """Forces of an `OperatingGrid`, tabulated over one revolution."""

    grid: OperatingGrid
    active: Int[np.ndarray, " active"]
    """Degrees of freedom on which there is any force but the unbalance."""
    n_angles: int
    """Angles of one revolution."""
    table: Float[np.ndarray, "angle active"]
    """Forces [N, N m] of every row of the grid, one below the other; each revolution begins one angle early and ends
    two late."""

    def force(
        self, angle: Float[np.ndarray, " time"], speed: Float[np.ndarray, " time"], pressure: Float[np.ndarray, " time"]
    ) -> Float[np.ndarray, "time 13"]:
        """Forces [N, N m] at shaft `angle` [rad], `speed` [rad/s] and outlet `pressure` [Pa]."""
        position = np.mod(angle, 2 * np.pi) * (self.n_angles / (2 * np.pi))
        left = position.astype(np.int64)
        part = position - left
        left %= self.n_angles  # rounding may give a whole revolution
        total = np.zeros((len(angle), len(self.active)))
        for row, weight in self.grid.corners(speed, pressure):
            start = row * (self.n_angles + 3) + left + 1
            for tap, share in zip(_TAPS, _cubic(part), strict=True):
                total += self.table.take(start + tap, axis=0) * (share * weight)[:, None]
        force = np.zeros((len(angle), N_DOF))
        force[:, self.active] = total
        turn = np.exp(1j * angle) * speed**2
        force[:, ROTOR_XY] += (turn[:, None] * self.grid.unbalance).real
        return force


def operating_grid(
    twin: Twin, profile: OperatingProfile, shaft: Shaft, time: Iterable[Float[np.ndarray, " time"]]
) -> OperatingGrid:
    """Grid of the operating points around those that a profile visits at `time` [s], which comes block by block.

    Chamber pressures are solved at each, down to the lowest speed at which the pump surely holds its outlet pressure;
    below it their shape over the angle is kept, and so are a loose slipper's forces. An order is left out where it
    would exceed the twin's bandwidth before the next speed of the grid, so that nothing folds.

    Raises
    ------
    InputError
        The pump cannot hold the highest pressure at the highest speed, or a speed or a pressure is none.
    """
    slowest, fastest = float(shaft.speed.min()), float(shaft.speed.max())
    lowest, highest = float(profile.discharge_pressure.min()), float(profile.discharge_pressure.max())
    floor = _lowest_speed(twin, fastest, highest) if slowest < fastest else fastest
    speeds = _spaced(max(slowest, floor), fastest)
    if slowest < floor:
        speeds = np.concatenate([[slowest], speeds])
    pressures = _spaced(lowest, highest)
    needed = np.argwhere(_visited(speeds, pressures, profile, shaft, time))
    conditions = [
        twin.condition.replaced(speed=max(float(speeds[i]), floor), discharge_pressure=float(pressures[j]))
        for i, j in needed
    ]
    reach = _reach(twin.bandwidth, speeds)
    cases = [LoadCase(twin.pump, condition, twin.fault) for condition in conditions]
    lines = force_lines(cases, int(reach.max()), topology=twin.topology)
    unbalance = lines[-1, 1, ROTOR_XY] / conditions[-1].speed ** 2  # on these two nothing else acts
    lines[:, :, ROTOR_XY] = 0
    row_of, structure = np.full((len(speeds), len(pressures)), -1), twin.structure
    for row, (i, j) in enumerate(needed):
        row_of[i, j] = row
        contact_forces = contact_lines(twin.fault, twin.pump, conditions[row], int(reach.max()), twin.topology)
        if contact_forces is not None:
            lines[row] += contact_forces
        lines[row] += _fault_lines(twin, structure, float(speeds[i]), int(reach.max()))
        lines[row, reach[i] + 1 :] = 0
    return OperatingGrid(speeds, pressures, row_of, lines, unbalance)


def _lowest_speed(twin: Twin, speed: float, pressure: float) -> float:
    """Speed [rad/s] from which on the chambers are solved: `FLOOR` times the one at which all is leaked."""
    condition = twin.condition.replaced(speed=speed, discharge_pressure=pressure)
    flow = float(chamber_pressures([LoadCase(twin.pump, condition, twin.fault)]).flow[0])
    displaced = twin.pump.rotating_group.displacement / (2 * math.pi)
    return min(speed, FLOOR * (speed - flow / displaced))


def _spaced(low: float, high: float) -> Float[np.ndarray, " point"]:
    """Points from `low` to `high`, neighbors at most `RATIO` apart."""
    if low == high:
        return np.array([high])
    points = np.geomspace(low, high, 1 + math.ceil(math.log(high / low) / math.log(RATIO)))
    points[[0, -1]] = low, high
    return points


def _visited(
    speeds: Float[np.ndarray, " speed"],
    pressures: Float[np.ndarray, " pressure"],
    profile: OperatingProfile,
    shaft: Shaft,
    time: Iterable[Float[np.ndarray, " time"]],
) -> Bool[np.ndarray, "speed pressure"]:
    """Which points of a grid are a corner of a cell in which the profile is at any of the instants."""
    seen = np.zeros((len(speeds), len(pressures)), dtype=bool)
    for block in time:
        i, _ = _between(speeds, shaft.at(block)[1])
        j, _ = _between(pressures, profile.pressure_at(block))
        for more_speed in range(min(2, len(speeds))):
            for more_pressure in range(min(2, len(pressures))):
                seen[i + more_speed, j + more_pressure] = True
    return seen


def _between(
    grid: Float[np.ndarray, " point"], value: Float[np.ndarray, " time"]
) -> tuple[Int[np.ndarray, " time"], Float[np.ndarray, " time"]]:
    """Point of a grid below each value, and how far it is to the next one, 0...1."""
    if len(grid) == 1:
        return np.zeros(len(value), dtype=np.int64), np.zeros(len(value))
    low = np.clip(np.searchsorted(grid, value, side="right") - 1, 0, len(grid) - 2)
    return low, (value - grid[low]) / (grid[low + 1] - grid[low])


def _reach(bandwidth: float, speeds: Float[np.ndarray, " speed"]) -> Int[np.ndarray, " speed"]:
    """Highest order of each speed of the grid."""
    following = np.append(speeds[1:], speeds[-1])
    most = max(ORDERS, int(bandwidth * 2 * math.pi / speeds[-1]))
    return np.array([min(most, int(bandwidth * 2 * math.pi / speed)) for speed in following])


def _fault_lines(twin: Twin, structure: Structure, speed: float, n_lines: int) -> Complex[np.ndarray, "order 13"]:
    """Force lines [N, N m] of the twin's fault beyond the pressures."""
    turning = twin.condition.replaced(speed=max(speed, _CREEP))
    motion = excitation_lines(twin.pump, turning, twin.fault, n_lines)
    frequency = np.arange(n_lines + 1) * speed
    worn = worn_values(twin.pump, twin.fault, twin.values)
    force = fault_forces(twin.pump, structure, twin.topology, twin.fault, worn, frequency, motion)
    return twin.scales.excitation * force.numpy()


def _cubic(part: Float[np.ndarray, " time"]) -> tuple[Float[np.ndarray, " time"], ...]:
    """Weights of the four angles around a place that lies `part` of a step after the second."""
    before, after, second = part + 1, part - 1, part - 2
    return (
        -part * after * second / 6,
        before * after * second / 2,
        -before * part * second / 2,
        before * part * after / 6,
    )
