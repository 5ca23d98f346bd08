"""Operating conditions, and the slips of units they catch."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swashtwin.foundation import InputError, MPa, celsius, rpm
from swashtwin.pump import OperatingCondition


@given(turns=st.floats(1, 7999))
def test_the_shaft_frequency_is_the_revolutions_per_second(turns: float) -> None:
    condition = OperatingCondition(speed=rpm(turns), discharge_pressure=MPa(15))
    assert condition.shaft_frequency == pytest.approx(turns / 60, rel=1e-12)
    assert condition.period == pytest.approx(60 / turns, rel=1e-12)
    assert condition.speed * condition.period == pytest.approx(2 * math.pi, rel=1e-12)


def test_a_replaced_condition_differs_in_that_value_only(at_15: OperatingCondition) -> None:
    other = at_15.replaced(discharge_pressure=MPa(10))
    assert other == OperatingCondition(speed=at_15.speed, discharge_pressure=MPa(10))
    assert at_15.discharge_pressure == MPa(15)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"speed": 860}, r"speed \(860 rad/s, 8212 rev/min\) .* rad/s: 860 rev/min is rpm\(860\)"),
        ({"discharge_pressure": 15}, r"\(15 Pa\) must exceed suction_pressure \(110000 Pa\).* 15 MPa is MPa\(15\)"),
        ({"discharge_pressure": MPa(15e6)}, r"above any .* \(200 MPa\). Pressures are in Pa: 15 MPa is MPa\(15\)"),
        ({"suction_pressure": MPa(15)}, "must exceed suction_pressure"),
        ({"oil_temperature": 45}, r"45 K\) lies outside .* kelvin: 45 degC is celsius\(45\)"),
        ({"oil_temperature": celsius(151)}, r"424.15 K\) lies outside -40...150 degC"),
    ],
)
def test_a_slip_of_the_unit_is_refused_with_its_remedy(
    at_15: OperatingCondition, changes: dict[str, float], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        at_15.replaced(**changes)


@pytest.mark.parametrize(
    "name", ["speed", "discharge_pressure", "suction_pressure", "case_pressure", "oil_temperature"]
)
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_no_value_of_a_condition_is_zero_negative_or_infinite(
    at_15: OperatingCondition, name: str, value: float
) -> None:
    with pytest.raises(InputError, match=f"{name} .* must be a positive number"):
        at_15.replaced(**{name: value})
