"""Parts that lose contact and strike: slippers in a recess, and a piston in a worn ball joint.

**Riding.** No film holds a slipper down. Over the swash plate's surface H the displacement s of a
slipper obeys

    s <= H    and    m s'' <= F cos(gamma),    one of them with equality.

F is the force along the shaft that presses it on: of its chamber, of its share in the central
spring and of its own acceleration on the tilted plane. If the surface falls away faster than F
moves the slipper, or throws it off at the end of the recess, its contact force (F - m s'' / cos
gamma) / cos gamma is zero until it lands. It does not rebound: the film damps m within C_sw / n, in
less than a microsecond. Ours; docs/explanation/physics.md, section 2.5.

**A loose slipper.** Its piston has a displacement u along the shaft, relative to its slipper and
positive toward the valve plate. Pressure presses it on at u = 0, and the retainer pulls it at u =
clearance:

    m u'' = -A (p - p_case) + m R tan(gamma) omega^2 cos(phi) - friction + stop forces
    p' = B(p) / V [Q_suction - Q_discharge - G (p - p_case) - V' + A u']

p is the pressure of the piston's chamber, whose ports are the orifices of `chambers`: while a port
is barely open the pressure may be megapascals away from a tight joint's, and a linearized port
would be wrong. Friction opposes the piston's sliding. A stop is a spring of such stiffness that an
impact lasts `LooseSlipper.pulse`, with a damper for its restitution, and can only push; without
bounce, as in the default, it is critically damped, which leaves e^-2 of the speed. The other
chambers, the outlet line and the 13 degrees of freedom are those of a tight joint. The result is
the difference to the same joint without clearance: the extra load -m u'' along the shaft at the
slipper, because the piston's mass moves with the retainer in the model, and the loads of the extra
pressure.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache, singledispatch
from typing import no_type_check

import numpy as np
from jaxtyping import Complex, Float
from scipy.optimize import brentq

from swashtwin.foundation import InputError, SwashTwinError, compiled
from swashtwin.physics.chambers import AIR_FLOOR, ATMOSPHERE, FLOOR, orifice
from swashtwin.physics.dynamics import N_DOF, Dof
from swashtwin.physics.excitation import angle_ahead, combined_lines, slipper_profile, stages
from swashtwin.physics.films import piston_leakage, slipper_leakage, valve_plate_leakage
from swashtwin.physics.loads import (
    LoadCase,
    chamber_pressures,
    port_openings,
    pressure_shares,
)
from swashtwin.pump import Fault, LooseSlipper, OperatingCondition, Pump, SwashPlateDefect
from swashtwin.signals import fourier_lines

STEPS = 16384
"""Time steps of a revolution: 4 us at 860 rev/min. A loaded slipper falls by 0.07 mm in 80 us."""


def pressing_force(
    pump: Pump, condition: OperatingCondition, angle: Float[np.ndarray, " angle"]
) -> Float[np.ndarray, " angle"]:
    """Return the force along the shaft [N] that presses a slipper on, as in a healthy pump.

    Parameters
    ----------
    angle : shaft angle [rad]. The force is not below 0.
    """
    tight = chamber_pressures(LoadCase(pump, condition))
    pressure = np.interp(angle, tight.angle, tight.chamber[0], period=2 * math.pi)
    return pressing_force_of(pump, condition, angle, pressure)


def pressing_force_of(
    pump: Pump,
    condition: OperatingCondition,
    angle: Float[np.ndarray, "*batch"],
    pressure: Float[np.ndarray, "*batch"],
) -> Float[np.ndarray, "*batch"]:
    """Return the force [N] of `pressing_force` for other chamber pressures [Pa]."""
    group = pump.rotating_group
    spring = pump.coupling.spring_preload / group.piston_count
    force = group.piston_area * (pressure - condition.case_pressure) + spring

    lift = group.pitch_radius * math.tan(group.swash_angle) * condition.speed**2
    return np.maximum(force - pump.masses.piston_slipper * lift * np.cos(angle), 0.0)


@lru_cache(maxsize=64)
def ride(
    pump: Pump, condition: OperatingCondition, defect: SwashPlateDefect
) -> Float[np.ndarray, " step"]:
    """Return the displacement s [m] of a slipper in `defect` over `STEPS` shaft angles from 0.

    A slipper that is pressed on lands once a turn, so that the ride repeats.
    """
    angle = 2 * math.pi * np.arange(STEPS) / STEPS
    step = condition.period / STEPS
    mass = pump.masses.piston_slipper
    tilt = math.cos(pump.rotating_group.swash_angle)

    # The march begins on the plate, one step before the recess.
    first = int((defect.angle - stages(pump, defect).total / 2) / (2 * math.pi) * STEPS) - 1
    surface = np.roll(slipper_profile(pump, defect, angle)[0], -first)
    pressed = np.roll(pressing_force(pump, condition, angle), -first)
    return np.roll(_path(surface, pressed * (step**2 * tilt / mass)), first)


@compiled
@no_type_check
def _path(surface, falls):
    """Return the displacement [m] over a `surface` [m], free to fall by `falls` [m] more a step."""
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
    """Return the order lines 1...`n_lines` [m] of the total displacement of all slippers.

    For slippers that may lift off; `displacement_lines` is for those that follow the recess.
    """
    lines = fourier_lines(ride(pump, condition, defect))[1 : n_lines + 1]
    return combined_lines(pump, np.arange(1, n_lines + 1), scatter) * lines


FRICTION = 20.0
"""Friction [N] of a piston in its bore, which resists the retainer's pull; an estimate."""

STEPS_PER_PULSE = 100
"""Time steps of the march during one impact."""

START = 1.5 * math.pi
"""Shaft angle of the loose piston [rad] at the start: under pressure, so it is pressed on."""

MAX_REVOLUTIONS = 20
"""Revolutions after which a motion that has not repeated is given up; two are typical."""

MIN_SLIDING_SPEED = 0.01
"""Sliding speed [m/s] below which friction fades, so that it does not switch at every step."""

MAX_REPEAT_ERROR = 1e-6
"""Change over a revolution, relative to typical sizes, at which the motion repeats."""

ITERATIONS = 80
"""Newton iterations of the chamber's pressure in one step, at most."""


@dataclass(frozen=True, eq=False)
class LooseMotion:
    """One revolution of a loose piston, on a uniform grid of its shaft angle from `START`."""

    angle: Float[np.ndarray, " step"]
    """Its shaft angle [rad]."""
    displacement: Float[np.ndarray, " step"]
    """Its displacement u relative to the slipper [m]."""
    velocity: Float[np.ndarray, " step"]
    """u' [m/s]."""
    pressure: Float[np.ndarray, " step"]
    """Pressure of its chamber [Pa]."""
    extra_acceleration: Float[np.ndarray, " step"]
    """u'' less that of a tight joint [m/s^2], from each angle to the next."""
    extra_pressure: Float[np.ndarray, " step"]
    """Pressure less that of a tight joint [Pa]."""


def stop_damping_ratio(restitution: float) -> float:
    """Return the damping ratio of a stop that returns `restitution` of a speed.

    The stop is a damped spring that only pushes: it returns exp(-2 x / tan x), with ratio cos x.
    """
    if not 0 <= restitution <= 1:
        raise InputError(f"LooseSlipper.restitution ({restitution:g}) must lie in 0...1.")
    if restitution <= math.exp(-2):
        return 1.0
    if restitution == 1:
        return 0.0

    def excess(x: float) -> float:
        return 2 * x / math.tan(x) + math.log(restitution)

    return math.cos(brentq(excess, 1e-6, math.pi / 2))


def _steps(condition: OperatingCondition, fault: LooseSlipper) -> int:
    if not condition.period / 1e4 <= fault.pulse <= condition.period:
        raise InputError(
            f"LooseSlipper.pulse ({fault.pulse:g} s) must lie between a ten-thousandth of a "
            f"revolution and a revolution ({condition.period:.3g} s) to be simulated. "
            "Times are in seconds: 0.2 ms is 2e-4."
        )
    return int(2 ** max(14, math.ceil(math.log2(STEPS_PER_PULSE * condition.period / fault.pulse))))


def _tables(
    pump: Pump, condition: OperatingCondition, fault: LooseSlipper, angle: np.ndarray
) -> np.ndarray:
    """Return the tables of `_rattle` over the shaft angles of the loose piston."""
    group = pump.rotating_group
    speed = condition.speed
    viscosity = pump.oil.viscosity_at(condition.oil_temperature)
    lift = group.pitch_radius * math.tan(group.swash_angle)

    # The outlet line is that of tight joints, whose angle is that of piston 0.
    tight = chamber_pressures(LoadCase(pump, condition))
    turned = np.mod(angle - angle_ahead(pump, fault.slipper, "LooseSlipper.slipper"), 2 * math.pi)
    outlet = np.interp(turned, tight.angle, tight.discharge, period=2 * np.pi)

    guide = group.piston_guide_length - lift * (1 - np.cos(angle))
    leakage = (
        slipper_leakage(pump, group.slipper_film, viscosity)
        + valve_plate_leakage(pump, pump.valve_plate.film, viscosity)
        + piston_leakage(pump, viscosity) / guide * group.piston_clearance**3
    )
    orifice = pump.oil.discharge_coefficient * math.sqrt(2 / pump.oil.density)
    suction, discharge = port_openings(pump, fault, angle)
    return np.stack(
        [
            group.dead_volume + group.piston_area * lift * (1 - np.cos(angle)),
            group.piston_area * lift * speed * np.sin(angle),
            orifice * suction,
            orifice * discharge,
            leakage,
            outlet,
            -lift * speed * np.sin(angle),
            -lift * speed**2 * np.cos(angle),
        ]
    )


@lru_cache(maxsize=2)
def loose_motion(pump: Pump, condition: OperatingCondition, fault: LooseSlipper) -> LooseMotion:
    """Return the motion of the loose piston once it repeats.

    The last ones are cached: lines and drawing of a twin need the same.

    Raises
    ------
    SwashTwinError
        It does not repeat.
    """
    tables, tight = _tight(pump, condition, replace(fault, clearance=0.0))
    loose = _march(pump, condition, tables, fault)

    n_steps = len(tight[0])
    step = condition.period / n_steps
    loose_acceleration = (np.roll(loose[1], -1) - loose[1]) / step
    tight_acceleration = (np.roll(tight[1], -1) - tight[1]) / step
    motion = LooseMotion(
        angle=_angles(n_steps),
        displacement=loose[0],
        velocity=loose[1],
        pressure=loose[2],
        extra_acceleration=loose_acceleration - tight_acceleration,
        extra_pressure=loose[2] - tight[2],
    )
    # The arrays are cached, and shared by all callers.
    for values in vars(motion).values():
        values.flags.writeable = False
    return motion


@lru_cache(maxsize=2)
def _tight(
    pump: Pump, condition: OperatingCondition, fault: LooseSlipper
) -> tuple[np.ndarray, np.ndarray]:
    """`_tables`, and the motion of a joint without play, which are those of any clearance."""
    tables = np.ascontiguousarray(
        _tables(pump, condition, fault, _angles(_steps(condition, fault)))
    )
    return tables, _march(pump, condition, tables, fault)


def _angles(steps: int) -> np.ndarray:
    return START + 2 * math.pi * np.arange(steps) / steps


def _march(
    pump: Pump, condition: OperatingCondition, tables: np.ndarray, fault: LooseSlipper
) -> np.ndarray:
    """Return displacement, velocity and pressure over the revolution that repeats."""
    area = pump.rotating_group.piston_area
    oil = pump.oil
    mass = pump.masses.piston_slipper
    clearance = fault.clearance
    n_steps = tables.shape[1]
    step = condition.period / n_steps

    # A half period of mass and stop lasts a pulse.
    stop = mass * (math.pi / fault.pulse) ** 2
    damper = 2 * stop_damping_ratio(fault.restitution) * math.sqrt(stop * mass)

    pressed = area * (condition.discharge_pressure - condition.case_pressure) / stop
    start = np.array([-pressed, 0.0, condition.discharge_pressure])
    scale = np.array(
        [pressed + clearance, (pressed + clearance) * condition.speed, condition.discharge_pressure]
    )
    motion = np.empty((3, n_steps))
    for _ in range(MAX_REVOLUTIONS):
        end = _rattle(
            step,
            clearance,
            stop,
            damper,
            mass,
            area,
            oil.bulk_modulus,
            oil.air_fraction,
            condition.suction_pressure,
            condition.case_pressure,
            tables,
            start,
            *motion,
        )
        change = float(np.max(np.abs(np.array(end) - start) / scale))
        if change < MAX_REPEAT_ERROR:
            return motion
        start = np.array(end)
    raise SwashTwinError(
        f"The loose slipper's motion does not repeat within {MAX_REVOLUTIONS} revolutions (it "
        f"still changes by {change:.1e} of its play), so it has no order lines; lower "
        "LooseSlipper.restitution or clearance."
    )


@compiled
@no_type_check
def _rattle(
    step,
    clearance,
    stop,
    damper,
    mass,
    area,
    bulk,
    air,
    suction,
    case,
    tables,
    start,
    displacement,
    speed,
    pressure,
):
    """Fill displacement, velocity and pressure from `start`; return the state after a revolution.

    Rows of `tables`: volume [m^3], its growth [m^3/s], suction and discharge opening, leakage,
    outlet pressure, rigid velocity [m/s], rigid acceleration [m/s^2].
    """
    n_steps = tables.shape[1]
    u = start[0]
    v = start[1]
    p = start[2]
    for i in range(n_steps):
        displacement[i] = u
        speed[i] = v
        pressure[i] = p

        force = -area * (p - case) - mass * tables[7, i]
        if u < 0:
            force += max(0.0, -stop * u - damper * v)
        if u > clearance:
            force -= max(0.0, stop * (u - clearance) + damper * v)
        sliding = (tables[6, i] + v) / MIN_SLIDING_SPEED
        force -= FRICTION * max(-1.0, min(1.0, sliding))

        # Velocity before displacement: in this order (symplectic Euler) a stop gains no energy.
        v += step * force / mass
        u += step * v
        p = _next_pressure(
            step, area * v, bulk, air, suction, case, tables[:, (i + 1) % n_steps], p
        )
    return u, v, p


@compiled
@no_type_check
def _next_pressure(step, displaced, bulk, air, suction, case, row, previous):
    """Return the chamber's pressure after a step of backward Euler.

    `displaced` is the flow [m^3/s] that the loose piston displaces, and `row` is a column of the
    tables of `_rattle`. The step is implicit because an open port is far stiffer than a time step.
    """
    gas = air * ATMOSPHERE / max(previous, AIR_FLOOR) ** 2
    compliance = step / (row[0] * (1 / bulk + gas))
    p = previous
    damping = 1.0
    previous_change = 0.0
    for _ in range(ITERATIONS):
        inward, falling = orifice(row[2], suction - p)
        outward, rising = orifice(row[3], p - row[5])
        flow = inward - outward - row[4] * (p - case) - row[1] + displaced
        slope = 1 + compliance * (falling + rising + row[4])
        change = (previous + compliance * flow - p) / slope

        # A change of the other sign has passed the solution: the step is halved, and then regrows.
        if change * previous_change < 0:
            damping = 0.5 * damping
        else:
            damping = min(1.0, 1.5 * damping)
        previous_change = change
        p = max(p + damping * change, FLOOR)
        if abs(change) < 1e-3:
            break
    return p


@singledispatch
def contact_lines(
    fault: Fault | None, pump: Pump, condition: OperatingCondition, n_lines: int, topology: str
) -> Complex[np.ndarray, "line 13"] | None:
    """Return the lines 0...`n_lines` [N, N m] of forces that a fault's contacts add, or None.

    They do not depend on the interface values. A new fault with such forces registers a function
    here.
    """
    return None


@contact_lines.register(LooseSlipper)
def loose_slipper_lines(
    fault: LooseSlipper,
    pump: Pump,
    condition: OperatingCondition,
    n_lines: int,
    topology: str = "T1",
) -> Complex[np.ndarray, "line 13"]:
    """Return the order lines 0...`n_lines` [N, N m] that a loose slipper adds to a pump's forces.

    Parameters
    ----------
    topology : T1, the piston's inertia acts on the retainer; T2, on the rotor, with which its
        slippers are rigid.
    """
    motion = loose_motion(pump, condition, fault)
    group = pump.rotating_group
    steps = len(motion.angle)
    if n_lines < 1 or 2 * n_lines >= steps:
        raise InputError(f"n_lines ({n_lines}) must lie in 1...{steps // 2 - 1}.")

    # An acceleration is the difference of two steps, and belongs to the angle between them.
    first = motion.angle[0]
    half_step = math.pi / steps
    inertia = pump.masses.piston_slipper * motion.extra_acceleration
    lines = _lines_of_force(pump, slipper_shares(pump), inertia, first + half_step, n_lines)
    pressing = group.piston_area * motion.extra_pressure
    lines += _lines_of_force(pump, pressure_shares(pump), pressing, first, n_lines)

    # From the loose piston's angle to that of piston 0.
    ahead = angle_ahead(pump, fault.slipper, "LooseSlipper.slipper")
    lines *= np.exp(1j * np.arange(n_lines + 1) * ahead)[:, None]
    if topology == "T2":
        lines[:, Dof.ROTOR_Z] += lines[:, Dof.RETAINER_Z]
        lines[:, Dof.RETAINER_Z] = 0
    return lines


def slipper_shares(pump: Pump) -> Float[np.ndarray, "13 3"]:
    """Return the share of each of the 13 degrees of freedom in `force_and_moments`, for T1.

    Those are of an axial force on one slipper toward the swash plate; its side load in the bore is
    included.
    """
    slope = math.tan(pump.rotating_group.swash_angle) ** 2
    shares = np.zeros((N_DOF, 3))
    shares[Dof.RETAINER_Z, 0] = -1
    shares[Dof.SHELL_TILT_X, 1] = -(1 + slope)
    shares[Dof.ROTOR_TILT_X, 1] = slope
    shares[Dof.SHELL_TILT_Y, 2] = 1
    return shares


def _lines_of_force(
    pump: Pump, shares: np.ndarray, force: np.ndarray, first: float, n_lines: int
) -> np.ndarray:
    """Return the order lines (line, 13) of the loads of an axial force on one slipper.

    Parameters
    ----------
    shares : of each degree of freedom in the force and its moments.
    force : over one revolution (step) [N].
    first : shaft angle of the slipper's piston at the first step [rad].
    """
    orders = np.arange(n_lines + 2)
    lines = fourier_lines(force)[: n_lines + 2] * np.exp(-1j * orders * first)

    # The moments are the force times cosine and sine of the angle. With coefficients c_k of the
    # two-sided series, -1...n_lines + 1, those of the products are (c_k-1 + c_k+1) / 2 and
    # (c_k-1 - c_k+1) / 2j. A line is twice its coefficient, except line 0.
    harmonics = np.concatenate([lines[1:2].conj() / 2, lines[:1], lines[1:] / 2])
    radius = pump.rotating_group.pitch_radius
    moment_x = radius * (harmonics[:-2] + harmonics[2:])
    moment_y = radius * (harmonics[:-2] - harmonics[2:]) / 1j
    moment_x[0] /= 2
    moment_y[0] /= 2
    return np.stack([lines[:-1], moment_x, moment_y], axis=1) @ shares.T
