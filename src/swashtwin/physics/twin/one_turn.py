"""One revolution of a twin: what its pistons, chambers, slippers and accelerometers do."""

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from swashtwin.physics.excitation import angle_ahead, find_recess, slipper_profile
from swashtwin.physics.loads import LoadCase, chamber_pressures
from swashtwin.physics.lost_contact import (
    START,
    LooseMotion,
    loose_motion,
    pressing_force_of,
    ride,
)
from swashtwin.physics.twin.model import Twin
from swashtwin.pump import BoreDefect, LooseSlipper, SwashPlateDefect
from swashtwin.signals import synchronous_signal

TURN_POINTS = 512
"""Shaft angles of a revolution, 0.7 deg apart: a power of two, as are the steps of the marches."""
POINTS_PER_PERIOD = 4
"""Points of a waveform in a period of its highest order, so that a curve through them is seen."""


@dataclass(frozen=True, eq=False)
class OneTurn:
    """Steady state over one revolution, on uniform grids of the shaft angle from 0.

    The angle is 0 at top dead center of piston 0, and piston j is 2 pi j / n ahead.
    """

    chamber: Float[np.ndarray, "piston angle"]
    """Pressure in each chamber [Pa]."""
    discharge: Float[np.ndarray, " angle"]
    """Pressure in the outlet line [Pa]."""
    contact: Float[np.ndarray, "piston angle"]
    """Normal force between each slipper and the swash plate [N].

    What a recess strains in the films (`SwashPlateDefect.strains_films`) is not part of it.
    """
    displacement: Float[np.ndarray, "piston angle"]
    """Displacement [m] that a fault imposes: of a slipper into the recess, of a piston in its worn
    ball joint or, laterally, in its damaged bore."""
    acceleration: Float[np.ndarray, "sensor point"]
    """Reading of each sensor [m/s^2], on a grid that may be finer."""


def solve_turn(twin: Twin) -> OneTurn:
    """Return one revolution of a twin."""
    pump = twin.port_timing.apply(twin.pump)
    condition = twin.condition
    fault = twin.fault
    count = pump.rotating_group.piston_count
    shaft_angle = _uniform_angles(TURN_POINTS)
    angle = shaft_angle + 2 * math.pi * np.arange(count)[:, None] / count

    pressures = chamber_pressures(LoadCase(pump, condition, fault))
    discharge = np.interp(shaft_angle, pressures.angle, pressures.discharge, period=2 * math.pi)
    chamber = np.stack(
        [
            np.interp(shaft_angle, pressures.angle, pressure, period=2 * math.pi)
            for pressure in pressures.chamber
        ]
    )
    displacement = np.zeros_like(angle)
    inertia = np.zeros_like(angle)

    recess = find_recess(fault)
    if recess is not None:
        path, acceleration = _recess_motion(twin, recess)
        displacement = _at_angles(path, angle)
        inertia = -pump.masses.piston_slipper * _at_angles(acceleration, angle)
    elif isinstance(fault, LooseSlipper):
        loose = fault.slipper
        motion = loose_motion(pump, condition, fault)
        chamber[loose] = _at_angles(_from_zero(motion, motion.pressure), angle[loose])
        displacement[loose] = _at_angles(_from_zero(motion, motion.displacement), angle[loose])
        extra = _at_angles(_from_zero(motion, motion.extra_acceleration), angle[loose])
        inertia[loose] = pump.masses.piston_slipper * extra
    elif isinstance(fault, BoreDefect):
        angle_ahead(pump, fault.bore, "BoreDefect.bore")
        offset = np.mod(angle[fault.bore] - fault.angle + math.pi, 2 * math.pi) - math.pi
        arch = np.cos(math.pi * offset / (2 * fault.half_width))
        displacement[fault.bore] = fault.depth * arch * (np.abs(offset) < fault.half_width)

    pressing = pressing_force_of(pump, condition, angle, chamber)
    tilt = math.cos(pump.rotating_group.swash_angle)
    return OneTurn(
        chamber=chamber,
        discharge=discharge,
        contact=np.maximum(pressing + inertia, 0.0) / tilt,
        displacement=displacement,
        acceleration=_acceleration(twin),
    )


def _uniform_angles(count: int) -> np.ndarray:
    return 2 * math.pi * np.arange(count) / count


def _recess_motion(twin: Twin, recess: SwashPlateDefect) -> tuple[np.ndarray, np.ndarray]:
    """Return displacement [m] and acceleration along the shaft [m/s^2] of a slipper.

    Both are means about `TURN_POINTS` angles of its piston. The films hold a slipper to a recess
    that strains them; the inertia of the slipper is neglected.
    """
    if recess.contact == "lift_off":
        path = ride(twin.pump, twin.condition, recess)
    else:
        angle = _uniform_angles(16 * TURN_POINTS)
        path = slipper_profile(twin.pump, recess, angle)[0]
    if recess.strains_films:
        return _means(path), np.zeros(TURN_POINTS)

    step = twin.condition.period / len(path)
    curvature = (np.roll(path, -1) - 2 * path + np.roll(path, 1)) / step**2
    tilt = math.cos(twin.pump.rotating_group.swash_angle)
    return _means(path), _means(curvature) / tilt


def _means(values: np.ndarray) -> np.ndarray:
    """Return means of a revolution about `TURN_POINTS` angles, which keep an impact's impulse."""
    width = values.size // TURN_POINTS
    return np.roll(values, width // 2).reshape(TURN_POINTS, width).mean(axis=1)


def _from_zero(motion: LooseMotion, values: np.ndarray) -> np.ndarray:
    """Return means of a loose piston's motion, from its shaft angle 0 on."""
    steps = len(motion.angle)
    return _means(np.roll(values, round(START / (2 * math.pi) * steps)))


def _at_angles(values: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Return values of a revolution at other angles [rad]."""
    return np.interp(angle, _uniform_angles(values.size), values, period=2 * math.pi)


def _acceleration(twin: Twin) -> np.ndarray:
    with torch.no_grad():
        lines = twin.acceleration().numpy()
    points = max(TURN_POINTS, POINTS_PER_PERIOD * int(twin.orders.max()))
    return synchronous_signal(lines, twin.orders, _uniform_angles(points))
