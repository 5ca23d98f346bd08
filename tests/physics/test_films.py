"""Films: what gaps leak against their integrals, and what oil and pressure do to stiffness and
damping.
"""

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


def test_land_leakage_is_the_flow_of_a_radial_gap(pump: Pump) -> None:
    radius = np.linspace(mm(7), mm(11), 2001)
    resistance = np.trapezoid(12 * VISCOSITY / (2 * math.pi * radius * um(12) ** 3), radius)
    assert slipper_land_conductance(pump, um(12), VISCOSITY) == pytest.approx(
        1 / resistance, rel=1e-6
    )


def test_all_chambers_together_leak_across_the_whole_valve_plate(pump: Pump) -> None:
    lands = [np.linspace(mm(29), mm(33), 2001), np.linspace(mm(19), mm(23), 2001)]
    whole = sum(
        1 / np.trapezoid(12 * VISCOSITY / (2 * math.pi * land * um(10) ** 3), land)
        for land in lands
    )
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
    assert open_slipper_leakage(pump, lifted, VISCOSITY, MPa(15)) == pytest.approx(
        turbulent, rel=1e-3
    )


def test_warm_oil_takes_two_thirds_of_the_films_damping_and_no_stiffness(
    pump: Pump, at_15: OperatingCondition
) -> None:
    cold, warm = (at_15.replace(oil_temperature=celsius(warmth)) for warmth in (30, 60))
    thinner = math.exp(-0.0366 * 30)
    assert thinner == pytest.approx(1 / 3, rel=1e-3)
    assert film_factors(pump, cold, warm).values() == pytest.approx([thinner, 1, thinner, 1, 1, 1])
    assert film_factors(pump, cold, warm, bore_exponent=1).piston_bore.damping == pytest.approx(
        thinner
    )


def test_pressure_stiffens_the_films_and_leaves_their_damping(
    pump: Pump, at_15: OperatingCondition
) -> None:
    piston_force = 0.08 * 3.5 * math.pi / 4 * mm(17) ** 2
    load = (piston_force * MPa(4.9) + 350) / (piston_force * MPa(14.9) + 350)
    factors = film_factors(pump, at_15, at_15.replace(discharge_pressure=MPa(5)))
    assert factors.values() == pytest.approx([1, 4.9 / 14.9, 1, load, 1, 1])
