"""Thin oil films of a pump: what they leak, what they carry, how stiff they are and how they damp.

Laminar gaps (Poiseuille and Reynolds) of parallel, rigid faces; lift from sliding and tilt is left out. A film's
leakage grows with the cube of its thickness, its damping falls with it. Damping is proportional to the viscosity and
knows no pressure; a hydrostatic stiffness is proportional to the pressure and knows no viscosity, because land and
damping hole are both laminar. Derivation: docs/explanation/physics.md, sections 4 and 5.
"""

import math
from typing import TypeVar

from torch import Tensor

from swashtwin.pump import Pump

Thickness = TypeVar("Thickness", float, Tensor)
"""A thickness [m] or what follows from it: a number, or a tensor through which it is differentiable."""


def orifice_conductance(pump: Pump, viscosity: float) -> float:
    """Laminar conductance [m^3/(s Pa)] of the damping hole of one piston and slipper."""
    group = pump.rotating_group
    return math.pi * group.orifice_diameter**4 / (128 * viscosity * group.orifice_length)


def slipper_land_conductance(pump: Pump, film: Thickness, viscosity: float) -> Thickness:
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


def _annular_squeeze_damping(inner: float, outer: float, film: Thickness, viscosity: float) -> Thickness:
    shape = outer**4 - inner**4 - (outer**2 - inner**2) ** 2 / math.log(outer / inner)
    return 3 * math.pi * viscosity * shape / (2 * film**3)


def land_squeeze_damping(pump: Pump, film: Thickness, viscosity: float) -> Thickness:
    """Damping [N s/m] of one slipper's land, an annulus whose edges are both held at constant pressure.

    c = 3 pi mu / (2 h^3) [R2^4 - R1^4 - (R2^2 - R1^2)^2 / ln(R2 / R1)]
    """
    group = pump.rotating_group
    return _annular_squeeze_damping(group.pocket_diameter / 2, group.slipper_diameter / 2, film, viscosity)


def slipper_effective_area(pump: Pump) -> float:
    """Area A_eff [m^2] on which the pocket's pressure lifts one slipper: pocket, and land over which it falls."""
    inner, outer = pump.rotating_group.pocket_diameter / 2, pump.rotating_group.slipper_diameter / 2
    return math.pi * (outer**2 - inner**2) / (2 * math.log(outer / inner))


def slipper_squeeze_damping(pump: Pump, film: Thickness, viscosity: float) -> Thickness:
    """Damping C_sw [N s/m] of all slippers on `film` [m]: their lands, and pockets that drain through land and hole.

    The paper's values of C_sw, 1.86e6 and 7.78e5 N s/m, are films of 7.5 and 10 um of the default pump at 45 degC.
    """
    drain = orifice_conductance(pump, viscosity) + slipper_land_conductance(pump, film, viscosity)
    pocket = slipper_effective_area(pump) ** 2 / drain
    return pump.rotating_group.piston_count * (land_squeeze_damping(pump, film, viscosity) + pocket)


def slipper_pressure_ratio(pump: Pump, film: Thickness) -> Thickness:
    """Pocket pressure over chamber pressure beta [1], both above the case's: hole and land share the fall.

    beta = G_hole / (G_hole + G_land) = 1 / (1 + c h^3), whatever the viscosity.
    """
    hole = orifice_conductance(pump, pump.oil.viscosity)
    return hole / (hole + slipper_land_conductance(pump, film, pump.oil.viscosity))


def slipper_lift(pump: Pump, film: Thickness, pressure: float) -> Thickness:
    """Force W = A_eff p beta(h) [N] on one slipper from its film at chamber `pressure` above the case's [Pa]."""
    return slipper_effective_area(pump) * pressure * slipper_pressure_ratio(pump, film)


def slipper_stiffness(pump: Pump, film: Thickness, pressure: float) -> Thickness:
    """Stiffness K_sw [N/m] of the slippers under `pressure` above the case's [Pa], half of all on average.

    K_sw = (n / 2) (-dW/dh) = (n / 2) 3 W (1 - beta) / h. A thin film already has all the pressure in its pocket and is
    soft; the stiffest has beta = 2/3, at 50 um for the default pump. Equal slippers; those on the suction side count 0.
    """
    hole = orifice_conductance(pump, pump.oil.viscosity)
    land = slipper_land_conductance(pump, film, pump.oil.viscosity)
    falls = land / (hole + land)  # 1 - beta, without the loss of digits
    return pump.rotating_group.piston_count / 2 * 3 * slipper_lift(pump, film, pressure) * falls / film


def valve_plate_squeeze_damping(pump: Pump, film: Thickness, viscosity: float) -> Thickness:
    """Damping C_v [N s/m] of the cylinder block on `film` [m]: two annular lands with the kidneys between them.

    Nearly mu L w^3 / h^3 for lands of length L and width w.
    """
    plate = pump.valve_plate
    outer = _annular_squeeze_damping(plate.outer_land_inner_radius, plate.outer_land_outer_radius, film, viscosity)
    inner = _annular_squeeze_damping(plate.inner_land_inner_radius, plate.inner_land_outer_radius, film, viscosity)
    return outer + inner


def valve_plate_load(pump: Pump, pressure: float) -> float:
    """Mean force W [N] that the kidneys leave to the film, with the central spring, at `pressure` above the case's."""
    group = pump.rotating_group
    pistons = group.piston_count / 2 * group.piston_area * pressure
    return (1 - pump.valve_plate.balance_ratio) * pistons + pump.coupling.spring_preload


def valve_plate_stiffness(pump: Pump, film: Thickness, pressure: float) -> Thickness:
    """Stiffness K_v = 3 W / h [N/m] of a film that carries `valve_plate_load` with a lift falling with its cube.

    An order of magnitude: which part of the load runs on wedges, and so falls with the square, is not known.
    """
    return 3 * valve_plate_load(pump, pressure) / film
