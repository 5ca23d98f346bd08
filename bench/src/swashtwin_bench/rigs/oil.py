"""Oil of versions 1 and 2: chamber pressures, their forces, and the slippers that ride on them.

The rig stands for a machine, and its versions are frozen. A machine does not change when the
numerics of a twin are mended, so the rig does not call the twin's chambers: it keeps the laws and
the solver that its recordings were made with. A rig that is not bit for bit the code of the twin is
also a harder and more honest test of it. Do not mend anything here: another law is another version.

Known differences from the twin: backward Euler, whose 1,792 steps miss the solution by 1.5 % of the
sum of the lines, and pistons that withdraw by half of their stroke only, so that they leak less.
Only the faults that versions 1 and 2 draw are covered.
"""

import math
from typing import no_type_check

import numpy as np
from jaxtyping import Complex, Float

from swashtwin.foundation import InputError, SwashTwinError, compiled
from swashtwin.physics import LoadCase
from swashtwin.pump import (
    DamScratch,
    GrooveErosion,
    OperatingCondition,
    PistonWear,
    Pump,
    SwashPlateDefect,
)
from swashtwin.signals import fourier_lines

STEPS = 1792
"""Steps of a revolution."""

REVOLUTIONS = 2
"""Revolutions of the march, the last of which counts."""

CRACKING_SHARE = 0.95
"""Share of the relief valve's override by which it opens below the set pressure."""

SMOOTHING = 2e4
"""Pressure difference [Pa] below which the flow through an orifice turns linear."""

FLOOR = 1e3
"""Lowest pressure [Pa]: oil cavitates."""

AIR_FLOOR = 5e4
"""Lowest pressure [Pa] at which free air is still compressed."""

ATMOSPHERE = 1e5
"""Pressure [Pa] at which the share of free air is stated."""

TOLERANCE = 1.0
"""Change of a pressure [Pa] at which Newton's method ends."""

ITERATIONS = 60
"""Maximum number of Newton iterations in a step."""

RIDE_STEPS = 16384
"""Steps of a revolution in which a slipper rides through a recess."""


# ---- forces


def force_lines(
    case: LoadCase, n_lines: int, *, steps: int = STEPS
) -> Complex[np.ndarray, "order 13"]:
    """Return order lines 0...`n_lines` of the forces of pressures and unbalance [N, N m].

    The slippers ride on the retainer (topology T1). Sign and clock are those of
    `swashtwin.physics.force_lines`.

    Parameters
    ----------
    steps : steps of a revolution.

    Raises
    ------
    InputError
        The pump leaks all that it displaces.
    SwashTwinError
        The pressures do not converge; more steps may help.
    """
    pump = case.pump
    count = pump.rotating_group.piston_count
    steps = max(steps, 2 * n_lines + 2)
    steps = -(-steps // count) * count

    chamber, _ = _solve(case, steps)
    angle = _end_angles(steps) + 2 * math.pi * np.arange(count)[:, None] / count
    force = pump.rotating_group.piston_area * (chamber - case.condition.case_pressure)
    radius = pump.rotating_group.pitch_radius
    resultants = np.stack(
        [
            force.sum(axis=0),
            radius * (force * np.cos(angle)).sum(axis=0),
            radius * (force * np.sin(angle)).sum(axis=0),
        ]
    )

    # The first step ends at the angle 2 pi / steps; lines count from the angle 0.
    to_zero = np.exp(-1j * np.arange(steps // 2 + 1) * (2 * math.pi / steps))
    lines = (fourier_lines(resultants) * to_zero).T @ _shares(pump).T

    masses = pump.masses
    unbalance = masses.rotor * masses.rotor_eccentricity * case.condition.speed**2
    lines[1, 5] += unbalance
    lines[1, 6] -= 1j * unbalance
    return lines[: n_lines + 1]


def _shares(pump: Pump) -> Float[np.ndarray, "13 3"]:
    """Return the share of each degree of freedom in the axial force and in its two moments."""
    balance = pump.valve_plate.balance_ratio
    tangent = math.tan(pump.rotating_group.swash_angle)
    shares = np.zeros((13, 3))

    # The shell's z and tilts.
    shares[2] = (balance, 0, 0)
    shares[3] = (0, balance - 1 - tangent**2, 0)
    shares[4] = (0, 0, 1 - balance)

    # The rotor's z and tilts, and the retainer's z.
    shares[7] = (1 - balance, 0, 0)
    shares[8] = (0, 1 - balance + tangent**2, 0)
    shares[9] = (0, 0, balance - 1)
    shares[12] = (-1, 0, 0)
    return shares


# ---- slippers in a recess


def ride_lines(
    pump: Pump, condition: OperatingCondition, defect: SwashPlateDefect, n_lines: int
) -> Complex[np.ndarray, " line"]:
    """Return order lines 0...`n_lines` [m] of the displacement of all slippers, without its mean.

    A slipper leaves a surface that falls away faster than the pressure moves it, and lands again
    without rebound.
    """
    angle = 2 * math.pi * np.arange(RIDE_STEPS) / RIDE_STEPS
    step = condition.period / RIDE_STEPS
    tilt = math.cos(pump.rotating_group.swash_angle)
    mass = pump.masses.piston_slipper

    # The march begins on the plate, one step before the recess.
    _, total = _extent(pump, defect)
    first = int((defect.angle - total / 2) / (2 * math.pi) * RIDE_STEPS) - 1
    surface = np.roll(_profile(pump, defect, angle)[0], -first)
    pressed = np.roll(_pressing_force(pump, condition, angle), -first)
    path = np.roll(_path(surface, pressed * (step**2 * tilt / mass)), first)

    # Equal slippers leave multiples of their number only.
    count = pump.rotating_group.piston_count
    orders = np.arange(1, n_lines + 1)
    slippers = np.where(orders % count == 0, float(count), 0.0).astype(complex)
    return np.concatenate([[0.0], slippers * fourier_lines(path)[1 : n_lines + 1]])


def _pressing_force(
    pump: Pump, condition: OperatingCondition, angle: Float[np.ndarray, " angle"]
) -> Float[np.ndarray, " angle"]:
    """Return the force along the shaft [N] that presses a slipper on, in a healthy pump."""
    group = pump.rotating_group
    chamber, end_angle = _solve(LoadCase(pump, condition), STEPS)
    pressure = np.interp(angle, end_angle, chamber[0], period=2 * math.pi)
    spring = pump.coupling.spring_preload / group.piston_count
    force = group.piston_area * (pressure - condition.case_pressure) + spring

    lift = group.pitch_radius * math.tan(group.swash_angle) * condition.speed**2
    return np.maximum(force - pump.masses.piston_slipper * lift * np.cos(angle), 0.0)


@compiled
@no_type_check
def _path(surface, falls):
    """Return the displacement [m] over a `surface` [m], free to fall by `falls` [m] more a step."""
    path = np.zeros(surface.size)
    for k in range(1, surface.size - 1):
        path[k + 1] = min(2 * path[k] - path[k - 1] + falls[k], surface[k + 1])
    return path


def _extent(pump: Pump, defect: SwashPlateDefect) -> tuple[float, float]:
    """Return the shaft angle [rad] of a slipper's entry, and that of its whole way."""
    group = pump.rotating_group
    rise = min(group.slipper_diameter, defect.length) / 2
    return rise / group.pitch_radius, defect.length / group.pitch_radius


def _profile(
    pump: Pump, defect: SwashPlateDefect, angle: Float[np.ndarray, " angle"]
) -> tuple[Float[np.ndarray, " angle"], Float[np.ndarray, " angle"]]:
    """Return the displacement [m] of a slipper that follows a recess, and its slope [m/rad]."""
    rise, total = _extent(pump, defect)
    depth = defect.effective_depth(pump.rotating_group.slipper_diameter)
    offset = np.mod(angle - defect.angle + math.pi, 2 * math.pi) - math.pi
    inward = np.clip(total / 2 - np.abs(offset), 0.0, rise) / rise
    rate = -np.sign(offset) * ((inward > 0) & (inward < 1)) / rise

    phase = math.pi / 2 * inward
    slope = math.pi / 2 * np.cos(phase)
    return depth * np.sin(phase), depth * slope * rate


# ---- openings and leaks over the shaft angle


def _port_openings(
    case: LoadCase, angle: Float[np.ndarray, " angle"]
) -> tuple[Float[np.ndarray, " angle"], Float[np.ndarray, " angle"]]:
    """Return the areas [m^2] by which a bore opens onto the suction and the discharge port."""
    plate = case.pump.valve_plate
    group = case.pump.rotating_group
    fault = case.fault
    advance = 0.0
    groove_factor = 1.0
    if isinstance(fault, GrooveErosion):
        advance = fault.advance
        groove_factor = fault.area_factor

    def port(opens: float, closes: float) -> np.ndarray:
        length = closes - opens + advance
        turned = (
            np.mod(angle - opens + advance + plate.groove_angle, 2 * math.pi) - plate.groove_angle
        )
        ramp = np.clip(np.minimum(turned, length - turned) / plate.port_ramp, 0, 1)
        kidney = plate.port_area_ratio * group.piston_area * ramp

        along = group.pitch_radius * np.clip(turned + plate.groove_angle, 0, plate.groove_angle)
        groove = (
            groove_factor
            * (along * math.tan(plate.groove_slope)) ** 2
            * math.tan(plate.groove_flank / 2)
        )
        return np.where(turned < length / 2, np.maximum(kidney, groove), kidney)

    suction = port(plate.suction_open, plate.suction_close)
    discharge = port(plate.discharge_open, plate.discharge_close)
    if isinstance(fault, DamScratch):
        from_bottom = np.mod(angle, 2 * math.pi) - math.pi
        discharge = discharge + fault.area * np.exp(-0.5 * (from_bottom / fault.width) ** 2)
    return suction, discharge


def _slipper_leakage(pump: Pump, film: float, viscosity: float, hole: float) -> float:
    """Return the conductance [m^3/(s Pa)] through a slipper: its `hole` and its land in series."""
    radius_ratio = pump.rotating_group.slipper_diameter / pump.rotating_group.pocket_diameter
    land = math.pi * film**3 / (6 * viscosity * math.log(radius_ratio))
    return hole * land / (hole + land)


def _valve_plate_leakage(pump: Pump, viscosity: float) -> float:
    """Return the conductance [m^3/(s Pa)] from one chamber across the lands of the valve plate."""
    plate = pump.valve_plate
    outer_ratio = plate.outer_land_outer_radius / plate.outer_land_inner_radius
    inner_ratio = plate.inner_land_outer_radius / plate.inner_land_inner_radius
    lands = 1 / math.log(outer_ratio) + 1 / math.log(inner_ratio)
    share = 2 * math.pi / pump.rotating_group.piston_count
    return plate.film**3 / (12 * viscosity) * share * lands


def _over_angle(
    case: LoadCase, angle: Float[np.ndarray, " angle"], step_time: float
) -> Float[np.ndarray, "angle 6"]:
    """Return the table over the angle of a piston; see `_march`."""
    pump = case.pump
    condition = case.condition
    group = pump.rotating_group
    viscosity = pump.oil.viscosity_at(condition.oil_temperature)

    lift = group.pitch_radius * math.tan(group.swash_angle)
    volume = group.dead_volume + group.piston_area * lift * (1 - np.cos(angle))
    swept = group.piston_area * lift * np.sin(angle)
    hole = math.pi * group.orifice_diameter**4 / (128 * viscosity * group.orifice_length)
    sealed = _slipper_leakage(pump, group.slipper_film, viscosity, hole)
    slipper = np.full_like(angle, sealed)

    recess = case.fault
    if isinstance(recess, SwashPlateDefect) and recess.contact == "lift_off":
        # The chamber grows by the recess, over which a slipper does not seal. Its hole is turbulent
        # then, and linearized at the working pressure.
        height, slope = _profile(pump, recess, angle)
        volume = volume + group.piston_area * height / math.cos(group.swash_angle)
        swept = swept + group.piston_area * slope / math.cos(group.swash_angle)

        area = math.pi / 4 * group.orifice_diameter**2
        root = math.sqrt(2 / (pump.oil.density * condition.discharge_pressure))
        turbulent = pump.oil.discharge_coefficient * area * root
        film = group.slipper_film + float(height.max())
        lifted = _slipper_leakage(pump, film, viscosity, turbulent)
        slipper = slipper + max(0.0, lifted - sealed) * height / height.max()

    # Half of the stroke, as the recordings were made.
    guide = group.piston_guide_length - lift * (1 - np.cos(angle)) / 2
    gap = math.pi * group.piston_diameter * (1 + 1.5 * group.piston_eccentricity**2)
    orifice = pump.oil.discharge_coefficient * math.sqrt(2 / pump.oil.density)
    suction, discharge = _port_openings(case, angle)
    columns = [
        orifice * suction,
        orifice * discharge,
        step_time / volume,
        swept * condition.speed,
        slipper + _valve_plate_leakage(pump, viscosity),
        gap / (12 * viscosity) / guide,
    ]
    return np.stack(columns, axis=1)


def _clearances_cubed(case: LoadCase) -> Float[np.ndarray, " piston"]:
    """Return the cube of the clearance of each piston [m^3]."""
    group = case.pump.rotating_group
    clearance = np.full(group.piston_count, group.piston_clearance)
    if case.piston_clearances is not None:
        clearance = np.array(case.piston_clearances, dtype=float)
    if isinstance(case.fault, PistonWear):
        clearance[case.fault.piston] += case.fault.clearance
    return clearance**3


# ---- pressures


def _end_angles(steps: int) -> Float[np.ndarray, " step"]:
    """Return the shaft angle [rad] at the end of each step."""
    return 2 * math.pi * np.arange(1, steps + 1) / steps


def _solve(
    case: LoadCase, steps: int
) -> tuple[Float[np.ndarray, "piston step"], Float[np.ndarray, " step"]]:
    """Return the pressure of each chamber [Pa], and the shaft angle [rad] of each step."""
    pump = case.pump
    condition = case.condition
    displacement = pump.rotating_group.displacement
    step_time = 2 * math.pi / steps / condition.speed
    relief = displacement * condition.shaft_frequency / pump.line.relief_override
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
    chamber = np.empty((steps, pump.rotating_group.piston_count))
    line = np.empty(steps)
    failed_step = _march(over_angle, _clearances_cubed(case), constants, chamber, line)

    if failed_step:
        raise SwashTwinError(f"Pressures of the rig do not converge with {steps} steps.")
    if relief * float(np.maximum(line - cracking, 0.0).mean()) <= 0:
        raise InputError(
            f"{pump.name} leaks all it displaces at {condition.discharge_pressure / 1e6:.4g} MPa; "
            "lower the pressure or the oil temperature."
        )
    return chamber.T, _end_angles(steps)


@compiled
@no_type_check
def _march(over_angle, clearances_cubed, constants, chamber, line):
    """Fill `chamber` (angle, piston) and `line` (angle) with the last revolution.

    Backward Euler; returns the step that failed, or 0. The tables:

    - `over_angle` (angle, 6), of a piston that stands there: flow over the root of the pressure
      difference through the suction and the discharge port [m^3/(s Pa^0.5)], time of a step over
      the volume [s/m^3], growth of the volume [m^3/s], leakage to the case [m^3/(s Pa)], leakage
      along the piston over its clearance cubed [1/(s Pa)];
    - `constants` (8): pressures in the suction port, of the outlet line at the start, and in the
      case [Pa]; 1 over the bulk modulus [1/Pa]; share of free air times `ATMOSPHERE` [Pa]; time of
      a step times bulk modulus over the line's volume [Pa s/m^3]; flow of the relief valve over the
      pressure above cracking [m^3/(s Pa)]; that pressure [Pa].
    """
    n_angles, n_pistons = chamber.shape
    suction = constants[0]
    discharge = constants[1]
    case = constants[2]
    softness = constants[3]
    air = constants[4]
    pressure = np.empty(n_pistons)
    step = np.empty((5, n_pistons))
    work = np.empty((5, n_pistons))

    # Chambers whose pistons go in start at the discharge pressure, the others at the suction's.
    for j in range(n_pistons):
        rising = math.sin(2 * math.pi * j / n_pistons) < -1e-9
        pressure[j] = discharge if rising else suction
    line_pressure = discharge

    stride = n_angles // n_pistons
    for index in range(1, REVOLUTIONS * n_angles + 1):
        end = (index - 1) % n_angles
        for j in range(n_pistons):
            row = end + 1 + j * stride
            here = over_angle[row if row < n_angles else row - n_angles]
            compliance = here[2] / (softness + air / max(pressure[j], AIR_FLOOR) ** 2)
            leakage = here[4] + here[5] * clearances_cubed[j]
            step[0, j] = here[0]
            step[1, j] = here[1]
            step[2, j] = compliance
            step[3, j] = leakage
            step[4, j] = pressure[j] + compliance * (leakage * case - here[3])

        line_pressure = _newton(step, constants, work, pressure, line_pressure)
        if math.isnan(line_pressure):
            return index
        chamber[end] = pressure
        line[end] = line_pressure
    return 0


@compiled
@no_type_check
def _newton(step, constants, work, pressure, previous_line):
    """Solve one step into `pressure`; return the outlet line's pressure, NaN without convergence.

    Chambers meet in the line only: they are eliminated, which leaves one equation for the line.
    """
    suction = constants[0]
    line_compliance = constants[5]
    relief = constants[6]
    cracking = constants[7]
    residual = work[0]
    diagonal = work[1]
    through = work[2]
    damping = work[3]
    previous_change = work[4]
    damping[:] = 1.0
    previous_change[:] = 0.0
    n_pistons = pressure.size
    line = previous_line
    for _ in range(ITERATIONS):
        flow_sum = 0.0
        slope_sum = 0.0
        pushed = 0.0
        answered = 0.0
        for j in range(n_pistons):
            flow_in, slope_in = _orifice(step[0, j], suction - pressure[j])
            flow_out, slope_out = _orifice(step[1, j], pressure[j] - line)
            residual[j] = (
                pressure[j]
                - step[4, j]
                - step[2, j] * (flow_in - flow_out - step[3, j] * pressure[j])
            )
            diagonal[j] = 1 + step[2, j] * (slope_in + slope_out + step[3, j])
            through[j] = -step[2, j] * slope_out
            from_chamber = -line_compliance * slope_out / diagonal[j]
            flow_sum += flow_out
            slope_sum += slope_out
            pushed += from_chamber * residual[j]
            answered += from_chamber * through[j]

        excess = line - cracking
        line_residual = (
            line - previous_line - line_compliance * (flow_sum - relief * max(excess, 0.0))
        )
        line_diagonal = 1 + line_compliance * (slope_sum + relief * (excess > 0))
        line_change = (pushed - line_residual) / (line_diagonal - answered)

        # A change of the other sign has passed the solution: its step is halved, and then regrows.
        largest_change = 0.0
        min_damping = 1.0
        for j in range(n_pistons):
            change = (-residual[j] - through[j] * line_change) / diagonal[j]
            if change * previous_change[j] < 0:
                damping[j] = 0.5 * damping[j]
            else:
                damping[j] = min(1.0, 1.5 * damping[j])
            previous_change[j] = change
            updated = max(pressure[j] + damping[j] * change, FLOOR)
            largest_change = max(largest_change, abs(updated - pressure[j]))
            min_damping = min(min_damping, damping[j])
            pressure[j] = updated
        line += min_damping * line_change

        if max(largest_change / min_damping, abs(line_change)) < TOLERANCE:
            return line
    return math.nan


@compiled
@no_type_check
def _orifice(opening, difference):
    """Return the flow through an orifice under a pressure `difference`, and its derivative."""
    if opening == 0.0:
        return 0.0, 0.0

    root = abs(difference) + SMOOTHING
    slope = opening / math.sqrt(root)
    return slope * difference, slope * (1 - 0.5 * abs(difference) / root)
