"""Films against a numerical solution of Reynolds' equation and the numbers in physics.md."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from swashtwin.films import (
    land_squeeze_damping,
    open_slipper_leakage,
    piston_leakage,
    slipper_land_conductance,
    slipper_leakage,
    slipper_squeeze_damping,
    valve_plate_leakage,
)
from swashtwin.pump import Pump
from swashtwin.units import MPa, mm, um

VISCOSITY = 0.03


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
