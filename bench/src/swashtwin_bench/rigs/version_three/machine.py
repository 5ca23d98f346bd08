"""Motion inside a pump of version 3: oil in chambers and outlet, and parts in their contacts.

Chambers: continuity with orifices and free air (Manring, *Fluid Power Pumps and Motors*, ch. 3),
under ports with grooves or relief holes as real valve plates have them (Seeniraj and Ivantysynova,
Int. J. Fluid Power 12, 2011, on pre-compression). The outlet is a volume, the oil in a pipe, and a
second volume at a relief valve.

Contacts: a film pushes and never pulls, so each slipper lifts off separately and strikes plate or
retainer (Hooke and Kakoullis, *The lubrication of slippers on axial piston pumps*, 1978), and each
piston changes sides in its bore.
"""

import math
from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import compiled, deg, um
from swashtwin_bench.rigs.measuring import Run
from swashtwin_bench.rigs.version_three.fleet import ThirdSpecimen, find_damage

STEPS = 3780
"""Steps of a revolution in every table: a multiple of 7 and of 9."""

TURN = 2 * np.pi * np.arange(STEPS) / STEPS
"""Angles of the steps [rad]."""

DENSITY = 865.0
"""Density of the oil [kg/m^3]."""

BULK = 1.45e9
"""Bulk modulus of the oil without air [Pa]."""

MIN_SUCTION_PA = 3e4
"""Lowest pressure at the suction port, even with cavitation [Pa]."""

DISCHARGE_COEFFICIENT = 0.68
"""Ratio of the flow through a port to that of an ideal orifice."""


def viscosity(temperature: float) -> float:
    """Return the viscosity [Pa s] of an oil ISO VG 46 at a temperature [K].

    By Walther's law (ASTM D341), for a viscosity index near 100.
    """
    return float(10**10 ** (9.417 - 3.684 * math.log10(temperature)) - 0.7) * 1e-6 * DENSITY


def angle_window(
    phi: Float[np.ndarray, "*axes"], center: float, half_width: float, edge: float
) -> Float[np.ndarray, "*axes"]:
    """Return 1 within `half_width` of the `center`, falling smoothly to 0 over an `edge` [rad]."""
    distance = np.abs(np.mod(phi - center + np.pi, 2 * np.pi) - np.pi)
    share = np.clip((half_width + edge - distance) / edge, 0, 1)

    return np.asarray(0.5 - 0.5 * np.cos(np.pi * share))


def interpolate_turn(
    table: Float[np.ndarray, "*rows step"], angle: Float[np.ndarray, "*axes"]
) -> Float[np.ndarray, "..."]:
    """Return the values of a `table` over `TURN` at each `angle` [rad]."""
    index = np.mod(angle, 2 * np.pi) * (STEPS / (2 * np.pi))
    # Rounding can give an index of STEPS, which is the first step again.
    left = index.astype(np.int64) % STEPS
    share = index - np.floor(index)

    return np.asarray(table[..., left] * (1 - share) + table[..., (left + 1) % STEPS] * share)


class Oil(NamedTuple):
    """One revolution of the oil, by the shaft angle of piston 0 in `STEPS` equal steps."""

    pressure: Float[np.ndarray, "piston step"]
    """Pressure of each chamber [Pa]."""
    outlet: Float[np.ndarray, " step"]
    """Pressure of the outlet [Pa]."""
    jets: Float[np.ndarray, " step"]
    """Power lost at the ports [W], which makes noise there."""
    seepage: Float[np.ndarray, " step"]
    """Power lost in leakage [W]."""


def _port_area(run: Run, specimen: ThirdSpecimen, port: int) -> Float[np.ndarray, " step"]:
    """Return the open area [m^2] of a bore by its angle, on the suction (0) or discharge (1)."""
    design = specimen.design
    erosion = find_damage(run.fault, "erosion")
    scratch = find_damage(run.fault, "scratch")

    edges = design.suction if port == 0 else design.discharge
    begin, end = np.array(edges) + specimen.shifts[port]
    advance = deg(3.5)
    # Erosion advances on the suction side by half of that on the discharge side.
    begin -= (0.5 if port == 0 else 1.0) * advance * erosion.extent

    half_width = (end - begin) / 2
    ramp = 0.8 * design.piston_diameter / design.pitch_radius
    window = angle_window(TURN, begin + half_width, half_width - ramp, ramp)
    kidney = 0.5 * design.area * window

    # Position along the relief: 0 at its tip, 1 at the kidney. The radian before the tip keeps
    # negative positions negative.
    position = (np.mod(TURN - begin + design.relief_angle + 1, 2 * np.pi) - 1) / design.relief_angle
    if design.relief == "groove":
        shape = np.clip(position, 0, 1) ** 2
    else:
        shape = np.clip(4 * position, 0, 1)
    is_before_center = position * design.relief_angle < half_width
    relief = design.relief_area * (1 + 1.2 * erosion.extent) * shape * is_before_center

    dam = port * 0.7e-6 * scratch.extent * angle_window(TURN, np.pi + deg(2), deg(3), deg(7))
    return np.asarray(np.maximum(kidney, relief) + dam)


def _leakage(run: Run, specimen: ThirdSpecimen) -> tuple[np.ndarray, np.ndarray]:
    """Return leakage conductances [m^3/(Pa s)]: of each piston, and by the angle on the plate."""
    scuffed = find_damage(run.fault, "scuffed")
    face = find_damage(run.fault, "face")
    wear = find_damage(run.fault, "wear")
    loose = find_damage(run.fault, "loose")
    recess = find_damage(run.fault, "recess")
    scoring = find_damage(run.fault, "scoring")
    mu = viscosity(run.condition.oil_temperature)
    piston = np.arange(len(specimen.clearances))
    count = len(piston)

    # Annular gap of each piston, and the gap between block and valve plate.
    clearance = np.array(specimen.clearances)
    clearance = clearance + um(45) * scuffed.extent * (piston == scuffed.piston)
    plate_gap = um(9) * (1 + 1.6 * wear.extent)
    pistons = 1.5 * np.pi * clearance**3 / (12 * mu * 1.7) + plate_gap**3 / mu

    # A face out of square opens the gap on one side; a loose slipper leaks more.
    pistons += 6e-15 * face.extent / mu * (1 + np.cos(2 * np.pi * (piston - face.piston) / count))
    pistons += 4.5e-15 / mu * (1 + 1.5 * loose.extent * (piston == loose.piston))

    recess_window = angle_window(TURN, recess.angle, recess.half_width, deg(6))
    scoring_window = angle_window(TURN, scoring.angle, 3 * scoring.half_width, deg(15))
    plate = 7.5e-15 / mu * recess.extent * recess_window
    plate += 3.6e-15 / mu * scoring.extent * scoring_window

    return pistons, plate


def solve_oil(run: Run, specimen: ThirdSpecimen) -> Oil:
    """Return pressures and losses of a run in the periodic steady state."""
    design = specimen.design
    condition = run.condition
    cavitation = find_damage(run.fault, "cavitation")
    count = len(specimen.clearances)

    # Areas times the factor of an orifice: flow [m^3/s] over the root of the pressure difference.
    root = math.sqrt(2 / DENSITY)
    suction_area = _port_area(run, specimen, 0) * DISCHARGE_COEFFICIENT * root
    discharge_area = _port_area(run, specimen, 1) * DISCHARGE_COEFFICIENT * root
    pistons, plate = _leakage(run, specimen)

    turn_share = np.arange(count) / count + specimen.spacing / (2 * np.pi)
    offset = np.round(turn_share * STEPS).astype(np.int64) % STEPS

    # The pipe's inertance follows from its resonance with the oil of the outlet.
    volume, pipe_resonance = specimen.line
    inertance = BULK / (volume * (2 * math.pi * pipe_resonance) ** 2)
    flow = count * design.area * 2 * design.lift * condition.shaft_frequency

    air = (0.006 + 0.02 * cavitation.extent) * specimen.noise[3]
    suction = max(condition.suction_pressure - 4e4 * cavitation.extent, MIN_SUCTION_PA)

    tables = _solve_turns(
        step=condition.period / STEPS,
        speed=condition.speed,
        dead=specimen.volumes,
        swing=design.area * design.lift,
        suction_area=suction_area,
        discharge_area=discharge_area,
        pistons=pistons,
        swash=plate,
        offset=offset,
        bulk=BULK,
        air=air,
        suction=suction,
        case=condition.case_pressure,
        discharge=condition.discharge_pressure,
        volume=volume,
        inertance=inertance,
        nominal=flow,
    )
    return Oil(*tables)


@compiled
@no_type_check
def _solve_turns(
    step,
    speed,
    dead,
    swing,
    suction_area,
    discharge_area,
    pistons,
    swash,
    offset,
    bulk,
    air,
    suction,
    case,
    discharge,
    volume,
    inertance,
    nominal,
):
    """Return the tables of `Oil` over the last of eight revolutions.

    By implicit Euler in the chambers, with a safeguarded Newton search.
    """
    count = len(dead)
    steps = len(swash)
    pressure = np.empty((count, steps))
    outlet = np.empty(steps)
    jets = np.empty(steps)
    seepage = np.empty(steps)

    p = np.where(offset > steps // 2, discharge, suction)
    near_end = discharge
    far_end = discharge
    pipe = nominal

    for _turn in range(8):
        for i in range(steps):
            inflow = 0.0
            lost = 0.0
            seep = 0.0

            for j in range(count):
                k = (i + offset[j]) % steps
                phi = 2 * np.pi * k / steps
                growth = swing * speed * np.sin(phi)
                leak = pistons[j] + swash[k]

                # Free air softens the oil at low pressure.
                old = p[j]
                gas = air * 1e5 / max(old, 2e4) ** 2
                yielding = step / ((dead[j] + swing * (1 - np.cos(phi))) * (1 / bulk + gas))

                # Newton's step, or bisection when the step leaves the bracket.
                new = old
                low = 1e3
                high = 1e8
                for _ in range(40):
                    current = new
                    a = suction - current
                    b = current - near_end
                    # The orifice's square root is rounded below 20 kPa, to have a finite slope.
                    root_a = (a * a + 4e8) ** 0.25
                    root_b = (b * b + 4e8) ** 0.25
                    drawn = suction_area[k] * a / root_a
                    pushed = discharge_area[k] * b / root_b
                    slope = suction_area[k] * (1 - 0.5 * a * a / root_a**4) / root_a
                    slope += discharge_area[k] * (1 - 0.5 * b * b / root_b**4) / root_b + leak
                    flow = drawn - pushed - leak * (current - case) - growth
                    excess = current - old - yielding * flow

                    if excess > 0:
                        high = current
                    else:
                        low = current
                    new = current - excess / (1 + yielding * slope)
                    if not low < new < high:
                        new = 0.5 * (low + high)
                    if abs(new - current) < 1.0:
                        break

                p[j] = new
                pressure[j, i] = new
                inflow += pushed
                lost += abs(drawn * (suction - new)) + abs(pushed * (new - near_end))
                seep += leak * (new - case) ** 2

            # Outlet: volume, oil in the pipe, and a second volume at the relief valve.
            near_end = max(near_end + step * bulk / volume * (inflow - pipe), 1e4)
            pipe += step * ((near_end - far_end) / inertance - 0.05 * speed * (pipe - nominal))
            valve = nominal * max(0.0, 1 + (far_end - discharge) / 1.2e6)
            far_end += step * bulk / (3 * volume) * (pipe - valve)

            outlet[i] = near_end
            jets[i] = lost
            seepage[i] = seep

    return pressure, outlet, jets, seepage


@compiled
@no_type_check
def contact_forces(force, floor, play, mass, stiffness, damping, ceiling, step):
    """Return the force [N] on a floor less that on a ceiling, of bodies between them.

    `force` (body, time) presses the bodies down [N]. The floor has receded by `floor` (body, time)
    [m]. The ceiling, `ceiling` times as stiff, is each body's `play` above an even floor. Films
    push only; between them oil drags a little. Semi-implicit Euler, damping implicit.
    """
    reaction = np.empty_like(force)

    for j in range(force.shape[0]):
        # Each body starts at rest on the floor. Positions are positive downwards.
        x = max(0.0, force[j, 0] / stiffness)
        v = 0.0
        previous_floor = floor[j, 0]

        for i in range(force.shape[1]):
            floor_speed = (floor[j, i] - previous_floor) / step
            previous_floor = floor[j, i]
            floor_depth = x - floor[j, i]
            ceiling_depth = -play[j] - x
            push = max(0.0, stiffness * floor_depth)
            pull = max(0.0, ceiling * stiffness * ceiling_depth)

            moving = 0.0
            c = 0.02 * damping
            if floor_depth > 0:
                moving = floor_speed
                c = damping
            elif ceiling_depth > 0:
                c = 0.5 * damping

            v = (v + step / mass * (force[j, i] - push + pull + c * moving)) / (1 + step * c / mass)
            x += step * v

            floor_force = 0.0
            if floor_depth > 0:
                floor_force = max(0.0, push + c * (v - moving))
            reaction[j, i] = floor_force - pull

    return reaction
