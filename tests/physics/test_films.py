"""Films against a numerical solution of Reynolds' equation and the numbers in physics.md."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_bvp
from scipy.linalg import solve_banded
from scipy.optimize import brentq, minimize_scalar

from swashtwin.foundation import MPa, mm, um
from swashtwin.physics.films import (
    land_squeeze_damping,
    open_slipper_leakage,
    orifice_conductance,
    piston_leakage,
    slipper_land_conductance,
    slipper_leakage,
    slipper_lift,
    slipper_pressure_ratio,
    slipper_squeeze_damping,
    slipper_stiffness,
    valve_plate_leakage,
    valve_plate_load,
    valve_plate_squeeze_damping,
    valve_plate_stiffness,
)
from swashtwin.pump import Pump

VISCOSITY = 0.03


def force_of(pump: Pump, film: float, closing: float = 0.0, pressure: float = MPa(15), n: int = 4000) -> float:
    """Force of one slipper's film by finite volumes: Reynolds' equation in the land, a pocket fed through the hole."""
    radius, step = np.linspace(mm(7), mm(11), n, retstep=True)
    between = 2 * math.pi * (radius[1:] + radius[:-1]) / 2 * film**3 / (12 * VISCOSITY * step)  # flow per pressure
    ring = 2 * math.pi * radius * step
    ring[0] = math.pi * ((mm(7) + step / 2) ** 2)  # the pocket and half a cell
    hole = orifice_conductance(pump, VISCOSITY)
    diagonal = np.ones(n)
    diagonal[0], diagonal[1:-1] = hole + between[0], between[1:] + between[:-1]
    bands = np.zeros((3, n))
    bands[0, 1:], bands[1], bands[2, :-1] = -between, diagonal, -between
    bands[2, -2] = 0.0  # the outer edge is open to the case
    source = ring * closing
    source[0] += hole * pressure
    source[-1] = 0.0
    solved = solve_banded((1, 1), bands, source)
    return math.pi * mm(7) ** 2 * solved[0] + float(np.trapezoid(2 * math.pi * radius * solved, radius))


@pytest.mark.parametrize("film", [7.5, 10, 25])
def test_squeeze_damping_solves_the_reynolds_equation(pump: Pump, film: float) -> None:
    radius = np.linspace(mm(7), mm(11), 201)
    strength = 12 * VISCOSITY / um(film) ** 3

    def slopes(r: np.ndarray, state: np.ndarray) -> np.ndarray:  # (r p')' = -r 12 mu / h^3 at unit closing speed
        return np.stack([state[1] / r, -strength * r])

    def edges(inner: np.ndarray, outer: np.ndarray) -> np.ndarray:
        return np.array([inner[0], outer[0]])

    solution = solve_bvp(slopes, edges, radius, np.zeros((2, radius.size)), tol=1e-8)
    assert solution.success
    force = np.trapezoid(2 * math.pi * radius * solution.sol(radius)[0], radius)
    assert land_squeeze_damping(pump, um(film), VISCOSITY) == pytest.approx(force, rel=1e-3)


@pytest.mark.parametrize(("film", "damping"), [(7.5, 1.85e6), (10, 8.08e5), (15, 2.71e5), (25, 9.19e4)])
def test_the_papers_damping_of_the_slippers_is_a_film_of_7_5_to_10_um(pump: Pump, film: float, damping: float) -> None:
    assert slipper_squeeze_damping(pump, um(film), VISCOSITY) == pytest.approx(damping, rel=3e-3)


def test_land_leakage_is_the_flow_of_a_radial_gap(pump: Pump) -> None:
    radius = np.linspace(mm(7), mm(11), 2001)
    resistance = np.trapezoid(12 * VISCOSITY / (2 * math.pi * radius * um(12) ** 3), radius)
    assert slipper_land_conductance(pump, um(12), VISCOSITY) == pytest.approx(1 / resistance, rel=1e-6)


def test_all_chambers_together_leak_across_the_whole_valve_plate(pump: Pump) -> None:
    lands = [np.linspace(mm(29), mm(33), 2001), np.linspace(mm(19), mm(23), 2001)]
    whole = sum(1 / np.trapezoid(12 * VISCOSITY / (2 * math.pi * land * um(10) ** 3), land) for land in lands)
    assert 7 * valve_plate_leakage(pump, um(10), VISCOSITY) == pytest.approx(whole, rel=1e-6)


def test_a_centered_piston_leaks_as_an_unrolled_gap(pump: Pump) -> None:
    gap = math.pi * mm(17) / (12 * VISCOSITY)
    assert piston_leakage(pump, VISCOSITY) == pytest.approx(gap * (1 + 1.5 * 0.36))


def test_the_damping_hole_limits_what_a_slipper_leaks(pump: Pump) -> None:
    riding, lifted = um(12), mm(0.6)
    assert slipper_leakage(pump, riding, VISCOSITY) == pytest.approx(
        slipper_land_conductance(pump, riding, VISCOSITY), rel=0.02
    )
    turbulent = 0.65 * math.pi / 4 * mm(0.8) ** 2 * math.sqrt(2 / 870 / MPa(15))
    assert open_slipper_leakage(pump, lifted, VISCOSITY, MPa(15)) == pytest.approx(turbulent, rel=1e-3)


@pytest.mark.parametrize("film", [7.5, 10, 25, 50])
def test_lift_and_stiffness_are_those_of_a_land_fed_through_the_hole(pump: Pump, film: float) -> None:
    assert slipper_lift(pump, um(film), MPa(15)) == pytest.approx(force_of(pump, um(film)), rel=1e-4)
    thinner, thicker = force_of(pump, um(film) * 0.999), force_of(pump, um(film) * 1.001)
    assert slipper_stiffness(pump, um(film), MPa(15)) == pytest.approx(
        3.5 * (thinner - thicker) / (0.002 * um(film)), rel=1e-3
    )


@pytest.mark.parametrize("film", [5, 10, 25, 50])
def test_damping_is_that_of_a_land_and_a_pocket_that_drains_through_land_and_hole(pump: Pump, film: float) -> None:
    closing = 1e-3
    force = force_of(pump, um(film), closing) - force_of(pump, um(film))
    assert slipper_squeeze_damping(pump, um(film), VISCOSITY) == pytest.approx(7 * force / closing, rel=1e-3)


@pytest.mark.parametrize(("film", "stiffness"), [(7.5, 8.91e6), (10, 1.58e7), (15, 3.48e7), (20, 5.97e7), (25, 8.79e7)])
def test_the_stiffness_of_the_slippers_is_the_printed_one(pump: Pump, film: float, stiffness: float) -> None:
    """physics.md, section 4: 1.6e7 N/m at 10 um to 8.8e7 at 25 um; the other films from the reference model."""
    assert float(f"{slipper_stiffness(pump, um(film), MPa(15)):.3g}") == stiffness


@pytest.mark.parametrize(
    ("film", "ratio", "lift"), [(7.5, 0.998, 3747), (10, 0.996, 3738), (15, 0.987, 3703), (25, 0.941, 3531)]
)
def test_the_pockets_share_of_the_pressure_is_that_of_the_reference_model(
    pump: Pump, film: float, ratio: float, lift: float
) -> None:
    assert slipper_pressure_ratio(pump, um(film)) == pytest.approx(ratio, abs=5e-4)
    assert slipper_lift(pump, um(film), MPa(15)) == pytest.approx(lift, rel=2e-4)


def test_the_slippers_are_stiffest_where_the_pocket_holds_two_thirds(pump: Pump) -> None:
    optimum = minimize_scalar(lambda film: -slipper_stiffness(pump, um(film), MPa(15)), bounds=(5, 200))
    assert slipper_pressure_ratio(pump, um(optimum.x)) == pytest.approx(2 / 3, rel=1e-3)
    assert optimum.x == pytest.approx(49.9, rel=2e-3)


def test_a_free_slipper_of_the_papers_pump_would_float_higher_than_its_damping_says(pump: Pump) -> None:
    """Balance of lift and piston force knows neither pressure nor viscosity; only the estimated geometry decides it."""
    group = pump.rotating_group

    def surplus(film: float, pressure: float) -> float:
        return slipper_lift(pump, film, pressure) - group.piston_area * pressure / math.cos(group.swash_angle)

    floats = [brentq(surplus, um(5), um(50), args=(pressure,)) for pressure in (MPa(5), MPa(15))]
    assert floats[0] == pytest.approx(floats[1])
    assert floats[1] == pytest.approx(um(24.0), rel=0.01)


@pytest.mark.parametrize(("film", "damping", "stiffness"), [(15, 1.86e5, 2.6e8), (30, 2.32e4, 1.3e8)])
def test_the_film_at_the_valve_plate_is_the_printed_one(
    pump: Pump, film: float, damping: float, stiffness: float
) -> None:
    """physics.md, section 4: C_v 1.9e5 N s/m at 15 um to 2.3e4 at 30 um, K_v 3 W / h with W = 1.3 kN."""
    assert valve_plate_squeeze_damping(pump, um(film), VISCOSITY) == pytest.approx(damping, rel=3e-3)
    slab = VISCOSITY * 2 * math.pi * mm(31 + 21) * mm(4) ** 3 / um(film) ** 3
    assert valve_plate_squeeze_damping(pump, um(film), VISCOSITY) == pytest.approx(slab, rel=3e-3)
    assert valve_plate_load(pump, MPa(15)) == pytest.approx(1300, rel=5e-3)
    assert valve_plate_stiffness(pump, um(film), MPa(15)) == pytest.approx(stiffness, rel=5e-3)


def test_the_central_spring_alone_loads_a_valve_plate_without_pressure(pump: Pump) -> None:
    firmer = replace(pump, coupling=replace(pump.coupling, spring_preload=500.0))
    assert valve_plate_load(firmer, 0.0) == 500.0
    assert valve_plate_load(firmer, MPa(15)) - valve_plate_load(pump, MPa(15)) == pytest.approx(150)
