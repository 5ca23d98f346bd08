"""What moves inside a pump of version 3: oil in chambers and outlet; slippers, pistons and block in
their contacts.

Chambers: continuity with orifices and free air (Manring, *Fluid Power Pumps and Motors*, ch. 3),
under ports with grooves or relief holes as real valve plates have them (Seeniraj and Ivantysynova,
Int. J. Fluid Power 12, 2011, on pre-compression). The outlet is a volume, the oil in a pipe, and a
second volume at a relief valve. Contacts: a film pushes and never pulls, so each slipper lifts off
by itself and strikes plate or retainer (Hooke and Kakoullis, *The lubrication of slippers on axial
piston pumps*, 1978), and each piston changes sides in its bore.
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
"""Their angles [rad]."""
DENSITY, BULK = 865.0, 1.45e9
"""Of the oil [kg/m^3], and its bulk modulus without air [Pa]."""


def viscosity(temperature: float) -> float:
    """Of an oil ISO VG 46 [Pa s] at a temperature [K], by Walther's law (ASTM D341; viscosity index
    near 100).
    """
    return float(10**10 ** (9.417 - 3.684 * math.log10(temperature)) - 0.7) * 1e-6 * DENSITY


def near(
    phi: Float[np.ndarray, "*axes"], middle: float, half: float, edge: float
) -> Float[np.ndarray, "*axes"]:
    """1 within `half` of `middle` [rad], 0 beyond an `edge` [rad] more, smooth between."""
    away = np.abs(np.mod(phi - middle + np.pi, 2 * np.pi) - np.pi)
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.clip((half + edge - away) / edge, 0, 1)))


def along(
    table: Float[np.ndarray, "*rows step"], angle: Float[np.ndarray, "*axes"]
) -> Float[np.ndarray, "..."]:
    """What a `table` over `TURN` says at each `angle` [rad]."""
    index = np.mod(angle, 2 * np.pi) * (STEPS / (2 * np.pi))
    left = index.astype(np.int64) % STEPS
    share = index - np.floor(index)
    return np.asarray(table[..., left] * (1 - share) + table[..., (left + 1) % STEPS] * share)


class Oil(NamedTuple):
    """One revolution of the oil, by the shaft angle of piston 0 in `STEPS` equal steps."""

    pressure: Float[np.ndarray, "piston step"]
    """Of each chamber [Pa]."""
    outlet: Float[np.ndarray, " step"]
    """Of the outlet [Pa]."""
    jets: Float[np.ndarray, " step"]
    """Power lost at the ports [W], which makes noise there."""
    seepage: Float[np.ndarray, " step"]
    """Power lost in leakage [W]."""


def _opening(run: Run, specimen: ThirdSpecimen, port: int) -> Float[np.ndarray, " step"]:
    """Area [m^2] by which a bore opens on the suction (0) or the discharge (1), by its angle."""
    design, erosion, scratch = (
        specimen.design,
        *(find_damage(run.fault, mode) for mode in ("erosion", "scratch")),
    )
    begin, end = np.array((design.suction, design.discharge)[port]) + specimen.shifts[port]
    begin -= (0.5, 1.0)[port] * deg(3.5) * erosion.extent
    ramp, half = 0.8 * design.piston_diameter / design.pitch_radius, (end - begin) / 2
    kidney = 0.5 * design.area * near(TURN, begin + half, half - ramp, ramp)
    inside = (np.mod(TURN - begin + design.relief_angle + 1, 2 * np.pi) - 1) / design.relief_angle
    shape = np.clip(inside, 0, 1) ** 2 if design.relief == "groove" else np.clip(4 * inside, 0, 1)
    relief = (
        design.relief_area
        * (1 + 1.2 * erosion.extent)
        * shape
        * (inside * design.relief_angle < half)
    )
    dam = port * 0.7e-6 * scratch.extent * near(TURN, np.pi + deg(2), deg(3), deg(7))
    return np.asarray(np.maximum(kidney, relief) + dam)


def solve_oil(run: Run, specimen: ThirdSpecimen) -> Oil:
    """Pressures and losses of a run, once they repeat from turn to turn."""
    design, condition, count = specimen.design, run.condition, len(specimen.clearances)
    modes = ("scuffed", "face", "wear", "loose", "recess", "scoring", "cavitation")
    scuffed, face, wear, loose, recess, scoring, cavitation = (
        find_damage(run.fault, mode) for mode in modes
    )
    mu, which = viscosity(condition.oil_temperature), np.arange(count)
    clearance = np.array(specimen.clearances) + um(45) * scuffed.extent * (which == scuffed.piston)
    pistons = (
        1.5 * np.pi * clearance**3 / (12 * mu * 1.7) + (um(9) * (1 + 1.6 * wear.extent)) ** 3 / mu
    )
    pistons += 6e-15 * face.extent / mu * (1 + np.cos(2 * np.pi * (which - face.piston) / count))
    pistons += 4.5e-15 / mu * (1 + 1.5 * loose.extent * (which == loose.piston))
    swash = 7.5e-15 / mu * recess.extent * near(TURN, recess.angle, recess.half_width, deg(6))
    swash += (
        3.6e-15 / mu * scoring.extent * near(TURN, scoring.angle, 3 * scoring.half_width, deg(15))
    )
    openings = [_opening(run, specimen, port) * 0.68 * math.sqrt(2 / DENSITY) for port in (0, 1)]
    offset = (
        np.round((which / count + specimen.spacing / (2 * np.pi)) * STEPS).astype(np.int64) % STEPS
    )
    inertance = BULK / (specimen.line[0] * (2 * math.pi * specimen.line[1]) ** 2)
    flow = count * design.area * 2 * design.lift * condition.shaft_frequency
    air = (0.006 + 0.02 * cavitation.extent) * specimen.noise[3]
    suction = max(condition.suction_pressure - 4e4 * cavitation.extent, 3e4)
    return Oil(*_flow(condition.period / STEPS, condition.speed, specimen.volumes, design.area * design.lift, *openings,
                      pistons, swash, offset, BULK, air, suction, condition.case_pressure, condition.discharge_pressure,
                      specimen.line[0], inertance, flow))  # fmt: skip


@compiled
@no_type_check
def _flow(step, speed, dead, swing, suction_area, discharge_area, pistons, swash, offset, bulk, air, suction, case,
          discharge, volume, inertance, nominal):  # fmt: skip
    """What `Oil` holds, of the last of eight revolutions; implicit Euler in the chambers,
    safeguarded Newton.
    """
    count, steps = len(dead), len(swash)
    pressure, outlet, jets, seepage = (
        np.empty((count, steps)),
        np.empty(steps),
        np.empty(steps),
        np.empty(steps),
    )
    p = np.where(offset > steps // 2, discharge, suction)
    near_end, far_end, pipe = discharge, discharge, nominal
    for _turn in range(8):
        for i in range(steps):
            inflow, lost, seep = 0.0, 0.0, 0.0
            for j in range(count):
                k = (i + offset[j]) % steps
                phi = 2 * np.pi * k / steps
                growth = swing * speed * np.sin(phi)
                leak = pistons[j] + swash[k]
                old, now, low, high = p[j], p[j], 1e3, 1e8
                gas = air * 1e5 / max(old, 2e4) ** 2
                yielding = step / ((dead[j] + swing * (1 - np.cos(phi))) * (1 / bulk + gas))
                for _ in range(40):
                    a, b = suction - now, now - near_end
                    root_a, root_b = (a * a + 4e8) ** 0.25, (b * b + 4e8) ** 0.25
                    drawn, pushed = suction_area[k] * a / root_a, discharge_area[k] * b / root_b
                    slope = suction_area[k] * (1 - 0.5 * a * a / root_a**4) / root_a
                    slope += discharge_area[k] * (1 - 0.5 * b * b / root_b**4) / root_b + leak
                    excess = now - old - yielding * (drawn - pushed - leak * (now - case) - growth)
                    low, high = (low, now) if excess > 0 else (now, high)
                    new = now - excess / (1 + yielding * slope)
                    if not low < new < high:
                        new = 0.5 * (low + high)
                    change, now = abs(new - now), new
                    if change < 1.0:
                        break
                p[j] = now
                inflow += pushed
                lost += abs(drawn * (suction - now)) + abs(pushed * (now - near_end))
                seep += leak * (now - case) ** 2
                pressure[j, i] = now
            near_end = max(near_end + step * bulk / volume * (inflow - pipe), 1e4)
            pipe += step * ((near_end - far_end) / inertance - 0.05 * speed * (pipe - nominal))
            far_end += (
                step
                * bulk
                / (3 * volume)
                * (pipe - nominal * max(0.0, 1 + (far_end - discharge) / 1.2e6))
            )
            outlet[i], jets[i], seepage[i] = near_end, lost, seep
    return pressure, outlet, jets, seepage


@compiled
@no_type_check
def contact_forces(force, floor, play, mass, stiffness, damping, ceiling, step):
    """What a floor takes, less what a ceiling takes, of bodies that `force` (body, time) presses
    down [N].

    The floor has receded by `floor` (body, time) [m]; the ceiling, `ceiling` times as stiff, hangs
    each body's `play` above an even floor. Films push only; between them oil drags a little.
    Semi-implicit Euler, damping implicit.
    """
    reaction = np.empty_like(force)
    for j in range(force.shape[0]):
        x, v, before = max(0.0, force[j, 0] / stiffness), 0.0, floor[j, 0]
        for i in range(force.shape[1]):
            sinking, before = (floor[j, i] - before) / step, floor[j, i]
            deep, high = x - before, -play[j] - x
            push, pull = max(0.0, stiffness * deep), max(0.0, ceiling * stiffness * high)
            moving = sinking if deep > 0 else 0.0
            c = damping if deep > 0 else (0.5 * damping if high > 0 else 0.02 * damping)
            v = (v + step / mass * (force[j, i] - push + pull + c * moving)) / (1 + step * c / mass)
            x += step * v
            reaction[j, i] = (max(0.0, push + c * (v - moving)) if deep > 0 else 0.0) - pull
    return reaction
