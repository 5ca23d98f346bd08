"""Operating points: recordings are dealt to the nearest one within the tolerances."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from swashtwin.foundation import MPa, rpm
from swashtwin.monitoring.alarms.baseline import OperatingPoint, choose_point
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording


def recording(speed: float, pressure: float) -> Recording:
    """A recording at a speed [rev/min] and a pressure [MPa]."""
    return Recording(np.ones((1, 9)), 100.0, "r", condition=OperatingCondition(rpm(speed), MPa(pressure)))


POINTS = [OperatingPoint(rpm(860), MPa(10)), OperatingPoint(rpm(860), MPa(11)), OperatingPoint(rpm(1500), MPa(10))]


@pytest.mark.parametrize(
    ("speed", "pressure", "name"),
    [
        (862, 10.2, "860 rpm, 10 MPa"),
        (850, 10.8, "860 rpm, 11 MPa"),
        (1490, 10, "1500 rpm, 10 MPa"),
        (1200, 10, "1200 rpm, 10 MPa"),
    ],
)
def test_a_recording_belongs_to_the_nearest_point_or_makes_one(speed: float, pressure: float, name: str) -> None:
    assert choose_point(recording(speed, pressure), POINTS).name == name
    assert choose_point(Recording(np.ones((1, 9)), 100.0, "states nothing"), POINTS).name == "any"


@given(some.floats(100, 3000), some.floats(1, 30))
def test_a_recording_belongs_to_the_point_that_it_made(speed: float, pressure: float) -> None:
    point = choose_point(recording(speed, pressure), POINTS)
    assert choose_point(recording(speed, pressure), [*POINTS, point]) == point
