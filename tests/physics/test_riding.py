"""Slippers that ride through a recess one by one, pressed by their chambers."""

from dataclasses import replace

import numpy as np
import pytest

from swashtwin.foundation import deg, mm
from swashtwin.physics import Twin
from swashtwin.physics.excitation import displacement_lines, slipper_profile
from swashtwin.physics.lost_contact import pressing_force, ride, riding_lines
from swashtwin.pump import OperatingCondition, Pump, SwashPlateDefect

SHALLOW = SwashPlateDefect(depth=mm(0.07), contact="lift_off")
DEEP_UNLOADED = SwashPlateDefect(depth=mm(0.6), angle=deg(90), contact="lift_off")


def ridden(
    pump: Pump, condition: OperatingCondition, defect: SwashPlateDefect
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shaft angle [rad], displacement [m], and normal force between a slipper and the swash plate [N]."""
    displacement, tilt = ride(pump, condition, defect), np.cos(pump.rotating_group.swash_angle)
    angle = 2 * np.pi * np.arange(displacement.size) / displacement.size
    curvature = np.roll(displacement, -1) - 2 * displacement + np.roll(displacement, 1)
    inertia = pump.masses.piston_slipper / tilt * curvature / (condition.period / displacement.size) ** 2
    pressed = pressing_force(pump, condition, angle)
    force = (pressed - inertia) / tilt
    return angle, displacement, np.where(np.abs(force) > 1e-9 * pressed.max(), force, 0.0)


@pytest.mark.parametrize("defect", [SHALLOW, DEEP_UNLOADED])
def test_no_film_pulls_and_no_slipper_enters_the_plate(
    pump: Pump, at_15: OperatingCondition, defect: SwashPlateDefect
) -> None:
    angle, displacement, force = ridden(pump, at_15, defect)
    surface = slipper_profile(pump, defect, angle)[0]
    assert force.min() >= 0
    assert np.all(displacement <= surface)
    assert displacement.max() == pytest.approx(surface.max())


def test_the_plate_gives_back_what_presses_the_slipper(pump: Pump, at_15: OperatingCondition) -> None:
    angle, _, force = ridden(pump, at_15, DEEP_UNLOADED)
    pressed = pressing_force(pump, at_15, angle) / np.cos(pump.rotating_group.swash_angle)
    assert np.mean(force == 0) > 0.02  # in flight
    assert force.max() > 1.5 * pressed.max()
    assert force.mean() == pytest.approx(pressed.mean(), rel=1e-9)


def test_a_loaded_slipper_follows_a_shallow_recess(pump: Pump, at_15: OperatingCondition) -> None:
    assert np.all(ridden(pump, at_15, SHALLOW)[2] > 0)
    lines, ideal = riding_lines(pump, at_15, SHALLOW, 100), displacement_lines(pump, at_15, SHALLOW, 100)
    np.testing.assert_allclose(lines, ideal, atol=2e-3 * np.abs(ideal).max())
    assert np.flatnonzero(lines)[0] + 1 == 7


def test_one_word_lets_the_line_at_28_orders_stand(pump: Pump, at_15: OperatingCondition) -> None:
    """Films that pull halve the line at 28 times the shaft's speed; slippers that may lift off leave it nearly."""

    def line(fault: SwashPlateDefect | None) -> float:
        twin = Twin(pump, at_15, fault)
        return float(twin.acceleration().abs()[0, np.flatnonzero(twin.orders == 28)[0]])

    healthy = line(None)
    assert line(SHALLOW) == pytest.approx(healthy, rel=0.02)
    assert line(replace(SHALLOW, contact="shared")) < 0.6 * healthy
    assert Twin(pump, at_15, SHALLOW).notes() == ()
