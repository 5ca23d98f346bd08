"""Chamber pressures of a pump, healthy or faulty, and their forces on the 13 degrees of freedom.

These loads do not depend on the six interface values: a twin computes them once for each operating
point. Equations and expected effects of each fault: docs/explanation/physics.md, sections 2.4 and
5. Pressures act on the piston, slipper and valve plate faults; a swash plate defect acts on them
only with ``contact="physical"`` or ``"lift_off"``; the other faults leave them as in a healthy
pump.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import numpy as np
from jaxtyping import Complex, Float

from swashtwin.foundation import InputError, SwashTwinError
from swashtwin.physics.chambers import ATMOSPHERE, ITERATIONS, march
from swashtwin.physics.dynamics import N_DOF, Dof
from swashtwin.physics.excitation import (
    added_leakage,
    canonical_recess,
    find_recess,
    port_change,
    slipper_profile,
)
from swashtwin.physics.films import (
    open_slipper_leakage,
    piston_leakage,
    slipper_leakage,
    valve_plate_leakage,
)
from swashtwin.pump import Fault, OperatingCondition, Pump
from swashtwin.signals import fourier_lines

DEFAULT_STEPS = 2464
"""Steps of a revolution, a multiple of 7 and 11 pistons. The lines up to 5 n are then within 0.5 %
of the sum of those of a stiff solver (scipy's Radau), and take the time of 1800 steps of Euler's
method.
"""
CRACKING_SHARE = 0.95
"""Share of the relief valve's override by which its cracking pressure lies below the set discharge
pressure.
"""


@dataclass(frozen=True)
class LoadCase:
    """One pump at one operating point with at most one fault."""

    pump: Pump
    condition: OperatingCondition
    fault: Fault | None = None
    """Fault of the pump; None is a healthy one."""
    piston_clearances: tuple[float, ...] | None = None
    """Radial clearance of each piston [m]; None: all as in the pump file."""

    def __post_init__(self) -> None:
        count = self.pump.rotating_group.piston_count
        if self.piston_clearances is not None and len(self.piston_clearances) != count:
            raise InputError(
                f"piston_clearances has {len(self.piston_clearances)} values for {count} pistons."
            )
        added_leakage(self.fault, self.pump)  # which refuses a piston that the pump does not have


@dataclass(frozen=True, eq=False)
class ChamberPressures:
    """Pressures over one revolution, once they repeat."""

    angle: Float[np.ndarray, " step"]
    """Shaft angle [rad] of each step, 0 at top dead center of piston 0: uniform, up to 2 pi."""
    chamber: Float[np.ndarray, "piston step"]
    """Pressure in each chamber [Pa]."""
    discharge: Float[np.ndarray, " step"]
    """Pressure in the outlet line [Pa]."""
    flow: float
    """Mean flow out of the pump [m^3/s]."""


def port_openings(
    pump: Pump, fault: Fault | None, angle: Float[np.ndarray, " angle"]
) -> tuple[Float[np.ndarray, " angle"], Float[np.ndarray, " angle"]]:
    """Return the areas [m^2] by which a bore opens onto the suction and the discharge port.

    A kidney opens and closes linearly. Ahead of it lies a triangular relief groove of depth s
    tan(slope), s from its tip.

    Parameters
    ----------
    angle : shaft angle of the bore [rad].
    """
    plate = pump.valve_plate
    change = port_change(fault, angle)
    advance = change.advance

    def port(opens: float, closes: float) -> np.ndarray:
        length = closes - opens + advance
        turned = (
            np.mod(angle - opens + advance + plate.groove_angle, 2 * math.pi) - plate.groove_angle
        )
        ramp = np.clip(np.minimum(turned, length - turned) / plate.port_ramp, 0, 1)
        kidney = plate.port_area_ratio * pump.rotating_group.piston_area * ramp

        along = pump.rotating_group.pitch_radius * np.clip(
            turned + plate.groove_angle, 0, plate.groove_angle
        )
        groove = (
            change.groove_factor
            * (along * math.tan(plate.groove_slope)) ** 2
            * math.tan(plate.groove_flank / 2)
        )
        return np.where(turned < length / 2, np.maximum(kidney, groove), kidney)

    suction = port(plate.suction_open, plate.suction_close)
    discharge = port(plate.discharge_open, plate.discharge_close)
    return suction, discharge + change.discharge_opening


def _over_angle(case: LoadCase, angle: np.ndarray, step_time: float) -> np.ndarray:
    """Return the table over the angle of a piston; see `chambers.march`."""
    pump = case.pump
    condition = case.condition
    group = pump.rotating_group
    viscosity = pump.oil.viscosity_at(condition.oil_temperature)

    # Chamber volume and its growth over the angle, with the recess that a slipper sinks into.
    lift = group.pitch_radius * math.tan(group.swash_angle)
    volume = group.dead_volume + group.piston_area * lift * (1 - np.cos(angle))
    swept = group.piston_area * lift * np.sin(angle)
    slipper = np.full_like(angle, slipper_leakage(pump, group.slipper_film, viscosity))
    recess = find_recess(case.fault)
    if recess is not None and not recess.strains_films and recess.depth > 0:
        height, slope = slipper_profile(pump, recess, angle)
        volume = volume + group.piston_area * height / math.cos(group.swash_angle)
        swept = swept + group.piston_area * slope / math.cos(group.swash_angle)

        # A slipper over the recess does not seal.
        film = group.slipper_film + float(height.max())
        lifted = open_slipper_leakage(pump, film, viscosity, condition.discharge_pressure)
        slipper = (
            slipper + recess.leakage * max(0.0, lifted - float(slipper[0])) * height / height.max()
        )

    film = pump.valve_plate.film + added_leakage(case.fault, pump).valve_plate_film
    guide = group.piston_guide_length - lift * (1 - np.cos(angle))
    orifice = pump.oil.discharge_coefficient * math.sqrt(2 / pump.oil.density)
    suction, discharge = port_openings(pump, case.fault, angle)
    columns = [
        orifice * suction,
        orifice * discharge,
        step_time / volume,
        swept * condition.speed,
        slipper + valve_plate_leakage(pump, film, viscosity),
        piston_leakage(pump, viscosity) / guide,
    ]
    return np.stack(columns, axis=1)


def _over_pistons(case: LoadCase) -> np.ndarray:
    """Return the table over the pistons; see `chambers.march`."""
    group = case.pump.rotating_group
    leakage = added_leakage(case.fault, case.pump)
    clearance = np.full(group.piston_count, group.piston_clearance)
    if case.piston_clearances is not None:
        clearance = np.array(case.piston_clearances, dtype=float)
    return np.stack(
        [
            (clearance + leakage.piston_clearance) ** 3,
            np.zeros(group.piston_count) + leakage.conductance,
        ]
    )


@lru_cache(maxsize=8)
def _solved(case: LoadCase, steps: int, revolutions: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Return pressures of chambers (piston, step) and outlet line (step), and the mean flow."""
    pump = case.pump
    condition = case.condition
    step_time = 2 * math.pi / steps / condition.speed
    # At full override the relief valve passes all that the pump displaces.
    relief = (
        pump.rotating_group.displacement * condition.shaft_frequency / pump.line.relief_override
    )
    cracking = condition.discharge_pressure - CRACKING_SHARE * pump.line.relief_override
    constants = np.array(
        [
            condition.suction_pressure,
            condition.discharge_pressure,
            condition.case_pressure,
            1 / pump.oil.bulk_modulus,
            pump.oil.air_fraction * ATMOSPHERE,
            step_time * pump.oil.bulk_modulus / pump.line.volume,
            relief,
            cracking,
        ]
    )
    over_angle = _over_angle(case, 2 * math.pi * np.arange(steps) / steps, step_time)
    over_pistons = _over_pistons(case)

    chamber = np.empty((steps, pump.rotating_group.piston_count))
    discharge = np.empty(steps)
    failed = march(over_angle, over_pistons, constants, revolutions, ITERATIONS, chamber, discharge)

    case_name = (
        f"{pump.name}, {condition.speed * 30 / math.pi:.4g} rev/min, "
        f"{condition.discharge_pressure / 1e6:.4g} MPa, fault {case.fault}"
    )
    if failed:
        raise SwashTwinError(
            f"chamber pressures of {case_name} do not converge at shaft angle "
            f"{360 * (failed % steps) / steps:.4g} deg; more steps than {steps} per revolution "
            "may help."
        )
    flow = relief * float(np.maximum(discharge - cracking, 0.0).mean())
    if flow <= 0:
        raise InputError(
            f"{case_name} leaks all it displaces and cannot hold its discharge pressure; raise the "
            "speed, or lower discharge_pressure or oil_temperature."
        )

    # The arrays are cached, and shared by all callers.
    chamber.flags.writeable = False
    discharge.flags.writeable = False
    return chamber.T, discharge, flow


def _round_up_steps(steps: int, case: LoadCase) -> int:
    """Return `steps` rounded up to a multiple of the number of pistons."""
    count = case.pump.rotating_group.piston_count
    return -(-steps // count) * count


def chamber_pressures(
    case: LoadCase, *, steps: int = DEFAULT_STEPS, revolutions: int = 2
) -> ChamberPressures:
    """Return the periodic pressures of a case.

    Parameters
    ----------
    steps : steps per revolution, rounded up to a multiple of the number of pistons.
    revolutions : number of revolutions to integrate; the last is returned, and the second already
        repeats to 3e-4.

    Raises
    ------
    InputError
        A pump that leaks more than it displaces, or too few steps.
    SwashTwinError
        The iteration does not converge.
    """
    if steps < 180 or revolutions < 1:
        raise InputError(
            f"steps ({steps}) must be at least 180 and revolutions ({revolutions}) at least 1."
        )

    steps = _round_up_steps(steps, case)
    return ChamberPressures(_end_angles(steps), *_solved(case, steps, revolutions))


def _end_angles(steps: int) -> np.ndarray:
    """Return the shaft angle [rad] at the end of each step."""
    return 2 * math.pi * np.arange(1, steps + 1) / steps


def force_and_moments(
    pump: Pump, force: np.ndarray, cosine: np.ndarray, sine: np.ndarray
) -> np.ndarray:
    """Return the sum of the piston forces [N], and their moments about x and y [N m].

    Parameters
    ----------
    force : axial force on each piston (piston, step) [N].
    cosine, sine : of the shaft angle of each piston (piston, step).
    """
    radius = pump.rotating_group.pitch_radius
    return np.stack(
        [
            force.sum(axis=0),
            radius * (force * cosine).sum(axis=0),
            radius * (force * sine).sum(axis=0),
        ]
    )


def pressure_shares(pump: Pump) -> Float[np.ndarray, "13 3"]:
    """Return the share of each of the 13 degrees of freedom in `force_and_moments`, for T1.

    Those are of the chamber pressures: force A (p - p_case) on each piston.
    """
    balance = pump.valve_plate.balance_ratio
    tangent = math.tan(pump.rotating_group.swash_angle)
    shares = np.zeros((N_DOF, 3))
    shares[Dof.SHELL_Z, 0] = balance
    shares[Dof.ROTOR_Z, 0] = 1 - balance
    shares[Dof.RETAINER_Z, 0] = -1.0
    shares[Dof.SHELL_TILT_X, 1] = balance - 1 - tangent**2
    shares[Dof.ROTOR_TILT_X, 1] = 1 - balance + tangent**2
    shares[Dof.SHELL_TILT_Y, 2] = 1 - balance
    shares[Dof.ROTOR_TILT_Y, 2] = balance - 1
    return shares


@lru_cache(maxsize=4)
def _piston_cosines_and_sines(count: int, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Return cosine and sine of the angle of each piston (piston, step)."""
    angle = _end_angles(steps) + 2 * math.pi * np.arange(count)[:, None] / count
    return np.cos(angle), np.sin(angle)


def force_lines(
    case: LoadCase,
    n_lines: int,
    *,
    topology: Literal["T1", "T2"] = "T1",
    steps: int = DEFAULT_STEPS,
) -> Complex[np.ndarray, "order 13"]:
    """Return the order lines of the forces of chamber pressures and unbalance [N, N m].

    Entry k holds the complex amplitude at k times the shaft frequency, entry 0 the mean: x(t) = X_0
    + Re sum_k X_k exp(i k theta), where theta is 0 at top dead center of piston 0. The last
    `CACHED_POINTS` operating points are cached.

    Parameters
    ----------
    n_lines : highest order.
    topology : T1, slippers ride on the retainer; T2, they are rigid with the rotor, which then
        takes the piston force.
    steps : minimum steps per revolution; more are taken if the lines need them. The method is of
        second order: with `DEFAULT_STEPS` the lines up to 5 n are off by 0.2 % of their sum (2 % of
        the smallest), by 0.8 % if a port opens suddenly (`DamScratch`, `GrooveErosion`); with half
        as many by three to four times that.

    Raises
    ------
    InputError
        `n_lines` is not positive; see also `chamber_pressures`.
    """
    if n_lines < 1:
        raise InputError(f"n_lines ({n_lines}) must be at least 1.")

    n_steps = _round_up_steps(max(steps, 2 * n_lines + 2), case)
    all_lines = _all_force_lines(_without_idle_fault(case), n_steps)
    lines = all_lines[: n_lines + 1].copy()
    if topology == "T2":
        lines[:, Dof.ROTOR_Z] += lines[:, Dof.RETAINER_Z]
        lines[:, Dof.RETAINER_Z] = 0
    return lines


def _without_idle_fault(case: LoadCase) -> LoadCase:
    """Return the case without a fault that does not change its pressures.

    Cases of equal pressures become equal, and share one entry of the cache.
    """
    recess = find_recess(case.fault)
    if recess is not None and not recess.strains_films:
        return replace(case, fault=canonical_recess(recess))
    for effect in (port_change, added_leakage):
        if effect.dispatch(type(case.fault)) is not effect.dispatch(object):
            return case
    return replace(case, fault=None)


CACHED_POINTS = 64
"""Operating points whose forces are remembered, of about 0.2 MB each."""


@lru_cache(maxsize=CACHED_POINTS)
def _all_force_lines(case: LoadCase, steps: int) -> Complex[np.ndarray, "order 13"]:
    """Return all lines that `steps` give, for topology T1."""
    chamber, _, _ = _solved(case, steps, revolutions=2)
    force = case.pump.rotating_group.piston_area * (chamber - case.condition.case_pressure)
    resultants = force_and_moments(case.pump, force, *_piston_cosines_and_sines(len(force), steps))

    # The first step ends at the angle 2 pi / steps; lines count from the angle 0.
    to_zero = np.exp(-1j * np.arange(steps // 2 + 1) * (2 * math.pi / steps))
    lines = (fourier_lines(resultants) * to_zero).T @ pressure_shares(case.pump).T

    unbalance = (
        case.pump.masses.rotor * case.pump.masses.rotor_eccentricity * case.condition.speed**2
    )
    lines[1, Dof.ROTOR_X] += unbalance
    lines[1, Dof.ROTOR_Y] -= 1j * unbalance
    lines.flags.writeable = False  # cached, and shared by all callers
    return lines
