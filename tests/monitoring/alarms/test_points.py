"""Operating points: recordings are dealt to the nearest one within the tolerances."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from swashtwin.foundation import MPa, rpm
from swashtwin.monitoring.alarms.points import OperatingPoint, choose_point
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording


def recording(speed: float, pressure: float) -> Recording:
    """A recording at a speed [rev/min] and a pressure [MPa]."""
    return Recording(np.ones((1, 9)), 100.0, "r", condition=OperatingCondition(rpm(speed), MPa(pressure)))


POINTS = [OperatingPoint(rpm(860), MPa(10)), OperatingPoint(rpm(860), MPa(11)), OperatingPoint(rpm(1500), MPa(10))]


@pytest.mark.parametrize(("speed", "pressure", "index"), [(862, 10.2, 0), (850, 10.8, 1), (1490, 10, 2)])
def test_a_recording_belongs_to_the_nearest_point(speed: float, pressure: float, index: int) -> None:
    assert choose_point(recording(speed, pressure), POINTS) == POINTS[index]


def test_a_recording_elsewhere_makes_a_point_of_its_own() -> None:
    assert choose_point(recording(1200, 10), POINTS).name == "1200 rpm, 10 MPa"


def test_a_recording_that_states_nothing_belongs_to_no_stated_point() -> None:
    bare = Recording(np.ones((1, 9)), 100.0, "r")
    assert choose_point(bare, POINTS) == OperatingPoint(None, None)
    assert choose_point(bare, POINTS).name == "any"


@given(some.floats(100, 3000), some.floats(1, 30))
def test_a_recording_belongs_to_the_point_that_it_made(speed: float, pressure: float) -> None:
    point = choose_point(recording(speed, pressure), POINTS)
    assert choose_point(recording(speed, pressure), [*POINTS, point]) == point
