"""Thin oil films of a pump: what they leak and how they damp.

Laminar gaps (Poiseuille and Reynolds); a film's leakage grows with the cube of its thickness, its damping falls with
it. Derivation: docs/physics.md, sections 4 and 5.
"""

import math

from swashtwin.pump import Pump


def orifice_conductance(pump: Pump, viscosity: float) -> float:
    """Laminar conductance [m^3/(s Pa)] of the damping hole of one piston and slipper."""
    group = pump.rotating_group
    return math.pi * group.orifice_diameter**4 / (128 * viscosity * group.orifice_length)


def slipper_land_conductance(pump: Pump, film: float, viscosity: float) -> float:
    """Conductance [m^3/(s Pa)] of the sealing land of one slipper that rides on `film` [m]."""
    group = pump.rotating_group
    return math.pi * film**3 / (6 * viscosity * math.log(group.slipper_diameter / group.pocket_diameter))


def slipper_leakage(pump: Pump, film: float, viscosity: float) -> float:
    """Conductance [m^3/(s Pa)] from a chamber to the case through damping hole and slipper land in series."""
    hole, land = orifice_conductance(pump, viscosity), slipper_land_conductance(pump, film, viscosity)
    return hole * land / (hole + land)


def open_slipper_leakage(pump: Pump, film: float, viscosity: float, pressure: float) -> float:
    """Conductance [m^3/(s Pa)] of a slipper lifted to `film` [m]: the hole turns turbulent and limits it.

    The hole is a sharp-edged orifice, linearized so that its flow is right at the chamber's working `pressure` [Pa].
    """
    group = pump.rotating_group
    area = math.pi / 4 * group.orifice_diameter**2
    hole = pump.oil.discharge_coefficient * area * math.sqrt(2 / (pump.oil.density * pressure))
    land = slipper_land_conductance(pump, film, viscosity)
    return hole * land / (hole + land)


def valve_plate_leakage(pump: Pump, film: float, viscosity: float) -> float:
    """Conductance [m^3/(s Pa)] from one chamber across its share of both sealing lands of the valve plate."""
    plate = pump.valve_plate
    lands = 1 / math.log(plate.outer_land_outer_radius / plate.outer_land_inner_radius) + 1 / math.log(
        plate.inner_land_outer_radius / plate.inner_land_inner_radius
    )
    return film**3 / (12 * viscosity) * (2 * math.pi / pump.rotating_group.piston_count) * lands


def piston_leakage(pump: Pump, viscosity: float) -> float:
    """Conductance of one piston's gap times its guided length, over its radial clearance cubed [m/(s Pa)/m^2].

    An eccentric piston leaks 1 + 1.5 e^2 times as much as a centered one.
    """
    group = pump.rotating_group
    return math.pi * group.piston_diameter * (1 + 1.5 * group.piston_eccentricity**2) / (12 * viscosity)


def land_squeeze_damping(pump: Pump, film: float, viscosity: float) -> float:
    """Damping [N s/m] of one slipper's land, an annulus whose edges are both held at constant pressure.

    c = 3 pi mu / (2 h^3) [R2^4 - R1^4 - (R2^2 - R1^2)^2 / ln(R2 / R1)]
    """
    inner, outer = pump.rotating_group.pocket_diameter / 2, pump.rotating_group.slipper_diameter / 2
    shape = outer**4 - inner**4 - (outer**2 - inner**2) ** 2 / math.log(outer / inner)
    return 3 * math.pi * viscosity / (2 * film**3) * shape


def slipper_squeeze_damping(pump: Pump, film: float, viscosity: float) -> float:
    """Damping C_sw [N s/m] of all slippers on `film` [m]: their lands, and pockets that drain through land and hole.

    The paper's values of C_sw, 1.86e6 and 7.78e5 N s/m, are films of 7.5 and 10 um of the default pump at 45 degC.
    """
    group = pump.rotating_group
    inner, outer = group.pocket_diameter / 2, group.slipper_diameter / 2
    effective_area = math.pi * (outer**2 - inner**2) / (2 * math.log(outer / inner))
    drain = orifice_conductance(pump, viscosity) + slipper_land_conductance(pump, film, viscosity)
    pocket = effective_area**2 / drain
    return group.piston_count * (land_squeeze_damping(pump, film, viscosity) + pocket)
