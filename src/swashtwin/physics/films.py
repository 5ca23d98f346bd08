"""Thin oil films of a pump: what they leak, and how oil and pressure move their stiffness and
damping.

Laminar gaps (Poiseuille and Reynolds) of parallel, rigid faces; lift from sliding and tilt is left
out. A film's leakage grows with the cube of its thickness, its damping falls with it. Damping is
proportional to the viscosity and knows no pressure; a hydrostatic stiffness is proportional to the
pressure and knows no viscosity, because land and damping hole are both laminar. Derivation:
docs/explanation/physics.md, sections 4 and 5.
"""

import math

from swashtwin.foundation import InputError
from swashtwin.pump import Interface, Interfaces, OperatingCondition, Pump


def slipper_land_conductance(pump: Pump, film: float, viscosity: float) -> float:
    """Conductance [m^3/(s Pa)] of the sealing land of one slipper that rides on `film` [m]."""
    group = pump.rotating_group
    return (
        math.pi
        * film**3
        / (6 * viscosity * math.log(group.slipper_diameter / group.pocket_diameter))
    )


def slipper_leakage(pump: Pump, film: float, viscosity: float) -> float:
    """Conductance [m^3/(s Pa)] from a chamber to the case through damping hole and slipper land in
    series.
    """
    group, land = pump.rotating_group, slipper_land_conductance(pump, film, viscosity)
    hole = math.pi * group.orifice_diameter**4 / (128 * viscosity * group.orifice_length)
    return hole * land / (hole + land)


def open_slipper_leakage(pump: Pump, film: float, viscosity: float, pressure: float) -> float:
    """Conductance [m^3/(s Pa)] of a slipper lifted to `film` [m]: the hole turns turbulent and
    limits it.

    The hole is a sharp-edged orifice, linearized so that its flow is right at the chamber's working
    `pressure` [Pa].
    """
    group = pump.rotating_group
    area = math.pi / 4 * group.orifice_diameter**2
    hole = pump.oil.discharge_coefficient * area * math.sqrt(2 / (pump.oil.density * pressure))
    land = slipper_land_conductance(pump, film, viscosity)
    return hole * land / (hole + land)


def valve_plate_leakage(pump: Pump, film: float, viscosity: float) -> float:
    """Conductance [m^3/(s Pa)] from one chamber across its share of both sealing lands of the valve
    plate.
    """
    plate = pump.valve_plate
    lands = 1 / math.log(
        plate.outer_land_outer_radius / plate.outer_land_inner_radius
    ) + 1 / math.log(plate.inner_land_outer_radius / plate.inner_land_inner_radius)
    return film**3 / (12 * viscosity) * (2 * math.pi / pump.rotating_group.piston_count) * lands


def piston_leakage(pump: Pump, viscosity: float) -> float:
    """Conductance of one piston's gap times its guided length, over its radial clearance cubed
    [m/(s Pa)/m^2].

    An eccentric piston leaks 1 + 1.5 e^2 times as much as a centered one.
    """
    group = pump.rotating_group
    return (
        math.pi
        * group.piston_diameter
        * (1 + 1.5 * group.piston_eccentricity**2)
        / (12 * viscosity)
    )


def valve_plate_load(pump: Pump, pressure: float) -> float:
    """Mean force W [N] that the kidneys leave to the film, with the central spring, at `pressure`
    above the case's.
    """
    group = pump.rotating_group
    pistons = group.piston_count / 2 * group.piston_area * pressure
    return (1 - pump.valve_plate.balance_ratio) * pistons + pump.coupling.spring_preload


def film_factors(
    pump: Pump, here: OperatingCondition, there: OperatingCondition, *, bore_exponent: float = 0.0
) -> Interfaces:
    """Factors on the interface values from one condition to another, as the films' laws move them.

    - C_sw and C_v move with the viscosity at the oil temperature.
    - K_sw moves with the discharge pressure above the case's.
    - K_v moves with `valve_plate_load`: that pressure, and the central spring.
    - K_Hz, a column of oil, stays: its bulk modulus moves by less than 3 % between 5 and 15 MPa.

    Films keep their thickness, which is what hydrostatic balance gives: a slipper floats where its
    pocket holds a fixed share of the pressure, whatever pressure and viscosity are. Films that
    sliding carries would thin instead, h ~ (viscosity speed / pressure)^0.5, and then damp *more*
    when warm. Which of both a pump does is not in the paper: our reading.

    Parameters
    ----------
    bore_exponent : power of the viscosity with which C_Hz moves. The pistons' sliding films damp
        1000 times less than the paper's C_Hz and their squeeze films 2000 times more, so no film
        law gives it: 0 keeps it, 1 is pure film.

    Raises
    ------
    InputError
        A discharge pressure does not exceed the case's, so that no film carries.
    """
    for condition in (here, there):
        if condition.discharge_pressure <= condition.case_pressure:
            raise InputError(
                f"discharge_pressure ({condition.discharge_pressure:g} Pa) must exceed case_pressure "
                f"({condition.case_pressure:g} Pa), or no film carries. Pressures are in Pa: 15 MPa is MPa(15)."
            )
    before, after = (point.discharge_pressure - point.case_pressure for point in (here, there))
    viscosity = pump.oil.viscosity_at(there.oil_temperature) / pump.oil.viscosity_at(
        here.oil_temperature
    )
    load = valve_plate_load(pump, after) / valve_plate_load(pump, before)
    return Interfaces(
        slipper_swash=Interface(damping=viscosity, stiffness=after / before),
        block_valve=Interface(damping=viscosity, stiffness=load),
        piston_bore=Interface(damping=viscosity**bore_exponent, stiffness=1.0),
    )
