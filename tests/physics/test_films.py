"""Films: what gaps leak against their integrals, and what oil and pressure do to stiffness and damping."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swashtwin.foundation import InputError, MPa, celsius, mm, rpm, um
from swashtwin.physics import film_factors
from swashtwin.physics.films import (
    open_slipper_leakage,
    piston_leakage,
    slipper_land_conductance,
    slipper_leakage,
    valve_plate_leakage,
    valve_plate_load,
)
from swashtwin.pump import OperatingCondition, Pump

VISCOSITY = 0.03
AT_15 = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(15))


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


def test_the_central_spring_alone_loads_a_valve_plate_without_pressure(pump: Pump) -> None:
    firmer = replace(pump, coupling=replace(pump.coupling, spring_preload=500.0))
    assert valve_plate_load(firmer, 0.0) == 500.0
    assert valve_plate_load(firmer, MPa(15)) - valve_plate_load(pump, MPa(15)) == pytest.approx(150)


@given(temperature=st.floats(0, 90), pressure=st.floats(1, 35))
def test_factors_there_and_back_are_one(pump: Pump, temperature: float, pressure: float) -> None:
    away = AT_15.replaced(oil_temperature=celsius(temperature), discharge_pressure=MPa(pressure), speed=rpm(1500))
    there, back = (film_factors(pump, *pair, bore_exponent=0.5).values() for pair in ((AT_15, away), (away, AT_15)))
    np.testing.assert_allclose(np.multiply(there, back), 1, rtol=1e-12)


def test_warm_oil_takes_two_thirds_of_the_films_damping_and_no_stiffness(pump: Pump, at_15: OperatingCondition) -> None:
    cold, warm = (at_15.replaced(oil_temperature=celsius(warmth)) for warmth in (30, 60))
    thinner = math.exp(-0.0366 * 30)
    assert thinner == pytest.approx(1 / 3, rel=1e-3)
    assert film_factors(pump, cold, warm).values() == pytest.approx([thinner, 1, thinner, 1, 1, 1])
    assert film_factors(pump, cold, warm, bore_exponent=1).piston_bore.damping == pytest.approx(thinner)


def test_pressure_stiffens_the_films_and_leaves_their_damping(pump: Pump, at_15: OperatingCondition) -> None:
    piston_force = 0.08 * 3.5 * math.pi / 4 * mm(17) ** 2
    load = (piston_force * MPa(4.9) + 350) / (piston_force * MPa(14.9) + 350)
    factors = film_factors(pump, at_15, at_15.replaced(discharge_pressure=MPa(5)))
    assert factors.values() == pytest.approx([1, 4.9 / 14.9, 1, load, 1, 1])


def test_a_pump_with_more_pressure_in_its_case_than_at_its_outlet_has_no_film(
    pump: Pump, at_15: OperatingCondition
) -> None:
    with pytest.raises(InputError, match=r"discharge_pressure \(1.5e\+07 Pa\) must exceed case_pressure"):
        film_factors(pump, at_15, at_15.replaced(case_pressure=MPa(16)))
