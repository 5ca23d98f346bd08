"""Films: leakage of gaps against their integrals; the effect of oil and pressure on the films."""

import math

import numpy as np
import pytest

from swashtwin.foundation import MPa, celsius, mm, um
from swashtwin.physics import film_factors
from swashtwin.physics.films import (
    open_slipper_leakage,
    piston_leakage,
    slipper_land_conductance,
    slipper_leakage,
    valve_plate_leakage,
)
from swashtwin.pump import OperatingCondition, Pump

VISCOSITY = 0.03


def ring_conductance(inner_radius: float, outer_radius: float, gap: float) -> float:
    """Conductance [m^3/(s Pa)] of radial flow, from the resistance integrated over the radius."""
    radius = np.linspace(inner_radius, outer_radius, 2001)
    resistance_per_length = 12 * VISCOSITY / (2 * math.pi * radius * gap**3)
    return 1 / np.trapezoid(resistance_per_length, radius)


def test_land_leakage_is_the_flow_of_a_radial_gap(pump: Pump) -> None:
    land = slipper_land_conductance(pump, um(12), VISCOSITY)
    assert land == pytest.approx(ring_conductance(mm(7), mm(11), um(12)), rel=1e-6)


def test_all_chambers_together_leak_across_the_whole_valve_plate(pump: Pump) -> None:
    outer_land = ring_conductance(mm(29), mm(33), um(10))
    inner_land = ring_conductance(mm(19), mm(23), um(10))
    one_chamber = valve_plate_leakage(pump, um(10), VISCOSITY)
    assert 7 * one_chamber == pytest.approx(outer_land + inner_land, rel=1e-6)


def test_a_piston_leaks_as_an_unrolled_eccentric_gap(pump: Pump) -> None:
    gap = math.pi * mm(17) / (12 * VISCOSITY)
    eccentricity = 1 + 1.5 * 0.36  # 1 + 1.5 e^2, at e = 0.6
    assert piston_leakage(pump, VISCOSITY) == pytest.approx(gap * eccentricity)


def test_the_land_limits_the_leakage_of_a_slipper_on_its_film(pump: Pump) -> None:
    land = slipper_land_conductance(pump, um(12), VISCOSITY)
    assert slipper_leakage(pump, um(12), VISCOSITY) == pytest.approx(land, rel=0.02)


def test_the_damping_hole_limits_the_leakage_of_a_lifted_slipper(pump: Pump) -> None:
    hole_area = math.pi / 4 * mm(0.8) ** 2
    turbulent = 0.65 * hole_area * math.sqrt(2 / 870 / MPa(15))
    leakage = open_slipper_leakage(pump, mm(0.6), VISCOSITY, MPa(15))
    assert leakage == pytest.approx(turbulent, rel=1e-3)


def test_oil_that_is_30_kelvin_warmer_reduces_damping_by_two_thirds_and_no_stiffness(
    pump: Pump, at_15: OperatingCondition
) -> None:
    cold = at_15.replace(oil_temperature=celsius(30))
    warm = at_15.replace(oil_temperature=celsius(60))
    thinner = math.exp(-0.0366 * 30)  # the law of the pump file, per kelvin
    assert thinner == pytest.approx(1 / 3, rel=1e-3)

    # C_sw, K_sw, C_v, K_v, C_Hz, K_Hz: by default the bores do not follow the oil
    assert film_factors(pump, cold, warm).values() == pytest.approx([thinner, 1, thinner, 1, 1, 1])

    with_bores = film_factors(pump, cold, warm, bore_exponent=1)
    assert with_bores.piston_bore.damping == pytest.approx(thinner)


def test_pressure_stiffens_the_films_and_leaves_their_damping(
    pump: Pump, at_15: OperatingCondition
) -> None:
    at_5 = at_15.replace(discharge_pressure=MPa(5))

    # physics.md 6b: K_v carries (1 - B)(n/2) A p and the 350 N of the spring; K_sw follows p above
    # the pressure of the case, 0.1 MPa
    unbalanced_area = 0.08 * 3.5 * math.pi / 4 * mm(17) ** 2
    load_at_5 = unbalanced_area * MPa(4.9) + 350
    load_at_15 = unbalanced_area * MPa(14.9) + 350
    expected = [1, 4.9 / 14.9, 1, load_at_5 / load_at_15, 1, 1]
    assert film_factors(pump, at_15, at_5).values() == pytest.approx(expected)
