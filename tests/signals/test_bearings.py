"""Rhythms of a flaw in a bearing are those that makers print."""

import math

import pytest

from swashtwin.foundation import InputError
from swashtwin.signals import defect_orders


def test_the_orders_are_those_that_the_maker_prints() -> None:
    # CWRU's page, drive end (SKF 6205) and fan end (SKF 6203)
    assert defect_orders(9, 0.3126 / 1.537) == pytest.approx((5.4152, 3.5848, 4.7135, 0.39828), rel=1e-4)
    assert defect_orders(8, 0.2656 / 1.122) == pytest.approx((4.9469, 3.0530, 3.9874, 0.3817), rel=2e-4)


def test_a_contact_angle_slows_the_ball_less_than_the_other_rhythms() -> None:
    assert defect_orders(8, 0.3, math.radians(40)).ball == pytest.approx(3.157, rel=1e-3)


@pytest.mark.parametrize(("bodies", "ratio"), [(2, 0.2), (9, 0.0), (9, 1.2)])
def test_a_bearing_that_cannot_be_is_refused(bodies: int, ratio: float) -> None:
    with pytest.raises(InputError, match="bearing"):
        defect_orders(bodies, ratio)
