"""Operating conditions, and the slips of units they catch."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swashtwin.foundation import InputError, MPa, celsius
from swashtwin.pump import OperatingCondition, merge_close_values, values_match


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        pytest.param(
            {"speed": 860},
            r"speed \(860 rad/s, 8212 rev/min\) .* rad/s: 860 rev/min is rpm\(860\)",
            id="speed in rev/min",
        ),
        pytest.param(
            {"discharge_pressure": 15},
            r"\(15 Pa\) must exceed suction_pressure \(110000 Pa\).* 15 MPa is MPa\(15\)",
            id="pressure in MPa",
        ),
        pytest.param(
            {"discharge_pressure": MPa(15e6)},
            r"above any .* \(200 MPa\). Pressures are in Pa: 15 MPa is MPa\(15\)",
            id="pressure converted twice",
        ),
        pytest.param(
            {"suction_pressure": MPa(15)}, "must exceed suction_pressure", id="pressures exchanged"
        ),
        pytest.param(
            {"oil_temperature": 45},
            r"45 K\) lies outside .* kelvin: 45 degC is celsius\(45\)",
            id="temperature in degC",
        ),
        pytest.param(
            {"oil_temperature": celsius(151)},
            r"424.15 K\) lies outside -40...150 degC",
            id="temperature above the limit",
        ),
    ],
)
def test_a_value_in_a_wrong_unit_is_refused_with_its_remedy(
    at_15: OperatingCondition, changes: dict[str, float], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        at_15.replace(**changes)


@pytest.mark.parametrize(
    "name", ["speed", "discharge_pressure", "suction_pressure", "case_pressure", "oil_temperature"]
)
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_every_value_of_a_condition_must_be_positive_and_finite(
    at_15: OperatingCondition, name: str, value: float
) -> None:
    with pytest.raises(InputError, match=f"{name} .* must be a positive number"):
        at_15.replace(**{name: value})


def test_conditions_match_within_the_tolerances_of_speed_and_pressure(
    at_15: OperatingCondition,
) -> None:
    # 2 % of the speed, 6 % of the pressure
    assert at_15.matches(at_15.replace(speed=at_15.speed * 1.019, discharge_pressure=MPa(15.9)))
    assert not at_15.matches(at_15.replace(speed=at_15.speed * 1.03))
    assert not at_15.matches(at_15.replace(discharge_pressure=MPa(16.1)))


def test_conditions_match_at_any_oil_temperature(at_15: OperatingCondition) -> None:
    assert at_15.matches(at_15.replace(oil_temperature=celsius(60)))


def test_an_unspecified_value_matches_only_an_unspecified_one() -> None:
    assert values_match(math.nan, math.nan, 0.1)
    assert not values_match(math.nan, 1.0, 0.1)


def test_unspecified_values_are_not_merged() -> None:
    merged = merge_close_values(np.array([2.0, math.nan, 1.0]), 0.1)
    np.testing.assert_array_equal(merged, [2.0, math.nan, 1.0])


def test_no_values_are_merged_into_none() -> None:
    assert merge_close_values(np.array([]), 0.1).size == 0


@given(st.lists(st.floats(1e5, 5e7), min_size=1, max_size=20), st.floats(0, 0.2))
def test_merged_values_match_each_other_and_their_level(
    values: list[float], tolerance: float
) -> None:
    sample = np.array(values)

    levels = merge_close_values(sample, tolerance)

    for level in np.unique(levels):
        members = sample[levels == level]
        assert values_match(members.min(), members.max(), tolerance)
        # the level is a mean, rounded
        assert values_match(members, np.full(members.size, level), tolerance + 1e-12).all()
