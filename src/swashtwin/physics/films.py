"""Leakage of a pump's oil films, and how oil and pressure change their stiffness and damping.

Laminar gaps (Poiseuille and Reynolds) between parallel, rigid faces; lift from sliding and tilt is
neglected. The leakage of a film grows with the cube of its thickness, and its damping falls with
it. Damping is proportional to the viscosity and independent of the pressure; a hydrostatic
stiffness is proportional to the pressure and independent of the viscosity, because land and damping
hole are both laminar. Derivation: docs/explanation/physics.md, sections 4 and 5.
"""

import math

from swashtwin.foundation import InputError
from swashtwin.pump import Interface, Interfaces, OperatingCondition, Pump


def slipper_land_conductance(pump: Pump, film: float, viscosity: float) -> float:
    """Return the conductance [m^3/(s Pa)] of the sealing land of a slipper on a `film` [m]."""
    group = pump.rotating_group
    radius_ratio = group.slipper_diameter / group.pocket_diameter
    return math.pi * film**3 / (6 * viscosity * math.log(radius_ratio))


def slipper_leakage(pump: Pump, film: float, viscosity: float) -> float:
    """Return the conductance [m^3/(s Pa)] from a chamber to the case through one slipper.

    Damping hole (laminar) and slipper land are in series.
    """
    group = pump.rotating_group
    land = slipper_land_conductance(pump, film, viscosity)
    hole = math.pi * group.orifice_diameter**4 / (128 * viscosity * group.orifice_length)
    return hole * land / (hole + land)


def open_slipper_leakage(pump: Pump, film: float, viscosity: float, pressure: float) -> float:
    """Return the conductance [m^3/(s Pa)] of a slipper lifted to `film` [m].

    So much oil flows that the hole turns turbulent and limits it: a sharp-edged orifice, linearized
    so that its flow is right at the chamber's working `pressure` [Pa].
    """
    group = pump.rotating_group
    area = math.pi / 4 * group.orifice_diameter**2
    hole = pump.oil.discharge_coefficient * area * math.sqrt(2 / (pump.oil.density * pressure))
    land = slipper_land_conductance(pump, film, viscosity)
    return hole * land / (hole + land)


def valve_plate_leakage(pump: Pump, film: float, viscosity: float) -> float:
    """Return the conductance [m^3/(s Pa)] from one chamber across the valve plate's sealing lands.

    It is the chamber's share, one n-th of the circumference, of both lands.
    """
    lands = valve_plate_lands(pump)
    return film**3 / (12 * viscosity) * (2 * math.pi / pump.rotating_group.piston_count) * lands


def valve_plate_lands(pump: Pump) -> float:
    """Return the sum over both sealing lands of one over the logarithm of their radii's ratio."""
    plate = pump.valve_plate
    outer_ratio = plate.outer_land_outer_radius / plate.outer_land_inner_radius
    inner_ratio = plate.inner_land_outer_radius / plate.inner_land_inner_radius
    return 1 / math.log(outer_ratio) + 1 / math.log(inner_ratio)


def piston_leakage(pump: Pump, viscosity: float) -> float:
    """Return the conductance of one piston's gap times length over clearance cubed [m/(s Pa)].

    The length is the guided one, the clearance the radial one. An eccentric piston leaks 1 + 1.5
    e^2 times as much as a centered one.
    """
    group = pump.rotating_group
    eccentricity_factor = 1 + 1.5 * group.piston_eccentricity**2
    return math.pi * group.piston_diameter * eccentricity_factor / (12 * viscosity)


def valve_plate_load(pump: Pump, pressure: float) -> float:
    """Return the mean force W [N] that the kidneys leave to the valve plate's film.

    Parameters
    ----------
    pressure : discharge pressure above the case's [Pa].
    """
    group = pump.rotating_group
    # Half of the pistons, on average, are under pressure.
    piston_force = group.piston_count / 2 * group.piston_area * pressure
    return (1 - pump.valve_plate.balance_ratio) * piston_force + pump.coupling.spring_preload


def film_factors(
    pump: Pump,
    original: OperatingCondition,
    target: OperatingCondition,
    *,
    bore_exponent: float = 0.0,
) -> Interfaces:
    """Return the factors on the interface values between two operating points.

    - C_sw and C_v change with the viscosity at the oil temperature.
    - K_sw changes with the discharge pressure above the case's.
    - K_v changes with `valve_plate_load`: that pressure, and the central spring.
    - K_Hz, a column of oil, stays: its bulk modulus changes by less than 3 % between 5 and 15 MPa.

    Films keep their thickness, as in hydrostatic balance: a slipper floats at the height at which
    its pocket holds a fixed share of the pressure, whatever pressure and viscosity are. Films that
    sliding carries would become thinner instead, h ~ (viscosity speed / pressure)^0.5, and then
    damp *more* when warm. Which of the two a pump does is not in the paper: this is our reading.

    Parameters
    ----------
    original, target : operating points that the factors lead from and to.
    bore_exponent : power of the viscosity with which C_Hz changes. The pistons' sliding films damp
        1000 times less than the paper's C_Hz and their squeeze films 2000 times more, so no film
        law gives it: 0 keeps it, 1 is pure film.

    Raises
    ------
    InputError
        A discharge pressure does not exceed the case's, so that no film carries.
    """
    for condition in (original, target):
        if condition.discharge_pressure <= condition.case_pressure:
            raise InputError(
                f"discharge_pressure ({condition.discharge_pressure:g} Pa) must exceed "
                f"case_pressure ({condition.case_pressure:g} Pa), or no film carries. "
                "Pressures are in Pa: 15 MPa is MPa(15)."
            )
    original_pressure = original.discharge_pressure - original.case_pressure
    target_pressure = target.discharge_pressure - target.case_pressure
    target_viscosity = pump.oil.viscosity_at(target.oil_temperature)
    viscosity_ratio = target_viscosity / pump.oil.viscosity_at(original.oil_temperature)
    load_ratio = valve_plate_load(pump, target_pressure) / valve_plate_load(pump, original_pressure)
    return Interfaces(
        slipper_swash=Interface(
            damping=viscosity_ratio, stiffness=target_pressure / original_pressure
        ),
        block_valve=Interface(damping=viscosity_ratio, stiffness=load_ratio),
        piston_bore=Interface(damping=viscosity_ratio**bore_exponent, stiffness=1.0),
    )
