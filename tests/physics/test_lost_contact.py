"""Parts that lose contact: a loose slipper that rattles, and slippers that ride through a recess
one by one.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from rigid_body import rigid_motions

from swashtwin.foundation import InputError, SwashTwinError, deg, mm
from swashtwin.physics import Twin, lost_contact
from swashtwin.physics.excitation import displacement_lines, slipper_profile
from swashtwin.physics.lost_contact import (
    LooseMotion,
    loose_motion,
    loose_slipper_lines,
    pressing_force,
    ride,
    riding_lines,
)
from swashtwin.pump import LooseSlipper, OperatingCondition, Pump, SwashPlateDefect

LOOSE = LooseSlipper(clearance=mm(0.2))


@pytest.fixture(scope="module")
def motion(pump: Pump, at_15: OperatingCondition) -> LooseMotion:
    return loose_motion(pump, at_15, LOOSE)


def impacts_of(motion: LooseMotion) -> list[tuple[float, float, float]]:
    """Shaft angle [rad], speed [m/s] before and share of it after each impact, pulled ones
    first.
    """
    impacts = []
    for outside in (motion.displacement > LOOSE.clearance, motion.displacement < 0):
        for first in np.flatnonzero(outside & ~np.roll(outside, 1)):
            last = first + int(np.argmin(np.roll(outside, -first)))
            before, after = (
                abs(motion.velocity[first - 1]),
                abs(motion.velocity[last % len(outside)]),
            )
            if before > 0.01:
                impacts.append(
                    (
                        float(np.mod(motion.angle[first], 2 * math.pi)),
                        float(before),
                        float(after / before),
                    )
                )
    return impacts


def stroke_speed(pump: Pump, condition: OperatingCondition, angle: float) -> float:
    """Speed [m/s] of a slipper along the shaft."""
    group = pump.rotating_group
    return condition.speed * group.pitch_radius * math.tan(group.swash_angle) * abs(math.sin(angle))


def test_a_tight_joint_adds_no_load(pump: Pump, at_15: OperatingCondition) -> None:
    assert not loose_slipper_lines(LooseSlipper(0.0), pump, at_15, 50).any()


def test_the_piston_stays_in_its_play_but_for_what_the_stops_give(
    pump: Pump, motion: LooseMotion
) -> None:
    stop = pump.masses.piston_slipper * (math.pi / LOOSE.pulse) ** 2
    give = pump.rotating_group.piston_area * motion.pressure.max() / stop
    assert -1.05 * give < motion.displacement.min() < 0
    assert LOOSE.clearance < motion.displacement.max() < 1.1 * LOOSE.clearance


def test_the_piston_is_pressed_on_at_the_speed_of_the_stroke_that_takes_up_its_play(
    pump: Pump, at_15: OperatingCondition, motion: LooseMotion
) -> None:
    angle, speed, _ = impacts_of(motion)[1]
    group = pump.rotating_group
    taken_up = group.pitch_radius * math.tan(group.swash_angle) * (1 + math.cos(angle))
    assert taken_up == pytest.approx(LOOSE.clearance, rel=0.03)
    assert speed == pytest.approx(stroke_speed(pump, at_15, angle), rel=0.06)


def test_no_impact_is_faster_than_friction_or_trapped_oil_allow(
    pump: Pump, at_15: OperatingCondition, motion: LooseMotion
) -> None:
    """sqrt(2 a e) pulled, and what a stroke over the play compresses in the full chamber
    pressed.
    """
    (angle, pulled, _), (_, pressed, _) = impacts_of(motion)
    group, mass = pump.rotating_group, pump.masses.piston_slipper
    lift = group.pitch_radius * math.tan(group.swash_angle)
    most_pulled = math.sqrt(
        2 * (lift * at_15.speed**2 + lost_contact.FRICTION / mass) * LOOSE.clearance
    )
    full = group.dead_volume + 2 * group.piston_area * lift
    most_pressed = (
        group.piston_area * math.sqrt(pump.oil.bulk_modulus / (full * mass)) * LOOSE.clearance
    )
    assert (most_pulled, most_pressed) == pytest.approx((0.281, 1.65), rel=3e-3)
    assert 0.5 * most_pulled < pulled < most_pulled
    assert pulled < 1.05 * stroke_speed(pump, at_15, angle)  # friction stops a piston, no more
    assert pressed < 0.2 * most_pressed


def test_a_bouncing_slipper_rebounds_with_its_restitution(
    pump: Pump, at_15: OperatingCondition
) -> None:
    motion = loose_motion(pump, at_15, LooseSlipper(mm(0.2), restitution=0.9))
    assert impacts_of(motion)[0][2] == pytest.approx(0.9, rel=0.03)
    assert abs(motion.extra_acceleration.mean()) < 1e-9 * np.abs(motion.extra_acceleration).max()


def test_the_load_does_no_work_on_rigid_motions_but_that_of_the_pistons_inertia(
    pump: Pump, at_15: OperatingCondition, motion: LooseMotion
) -> None:
    load = loose_slipper_lines(LOOSE, pump, at_15, 60)
    x, y, z, about_x, about_y = (load @ rigid_motions(pump)).T
    inertia = pump.masses.piston_slipper * motion.extra_acceleration
    middle, radius = motion.angle + math.pi / len(motion.angle), pump.rotating_group.pitch_radius
    orders = np.exp(-1j * np.arange(1, 61)[:, None] * middle) * (2 / len(middle))
    scale = np.abs(z).max()
    assert np.abs(x).max() < 1e-12 * scale
    assert np.abs(y).max() < 1e-12 * scale
    np.testing.assert_allclose(z[1:], -orders @ inertia, atol=1e-9 * scale)
    np.testing.assert_allclose(
        about_x[1:], -orders @ (inertia * radius * np.cos(middle)), atol=1e-9 * scale
    )
    np.testing.assert_allclose(
        about_y[1:], orders @ (inertia * radius * np.sin(middle)), atol=1e-9 * scale
    )


def test_pressing_a_slipper_on_pushes_the_retainer_toward_the_swash_plate(
    pump: Pump, at_15: OperatingCondition, motion: LooseMotion
) -> None:
    angle, speed, _ = impacts_of(motion)[1]
    since = np.mod(motion.angle - angle, 2 * math.pi)
    during = since < at_15.speed * LOOSE.pulse
    pushed = (
        -pump.masses.piston_slipper
        * motion.extra_acceleration[during].sum()
        * at_15.period
        / len(since)
    )
    assert pushed == pytest.approx(-pump.masses.piston_slipper * speed, rel=0.15)


def test_slippers_that_are_rigid_with_the_rotor_load_it_instead_of_the_retainer(
    pump: Pump, at_15: OperatingCondition
) -> None:
    retainer = loose_slipper_lines(LOOSE, pump, at_15, 20)
    rotor = loose_slipper_lines(LOOSE, pump, at_15, 20, topology="T2")
    assert not rotor[:, 12].any()
    np.testing.assert_allclose(rotor[:, 7], retainer[:, 7] + retainer[:, 12])


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (LooseSlipper(mm(0.2), slipper=7), r"LooseSlipper.slipper \(7\) must be 0 to 6"),
        (LooseSlipper(mm(0.2), restitution=1.5), r"restitution \(1.5\) must lie in 0...1"),
        (LooseSlipper(mm(0.2), pulse=0.0), r"pulse \(0 s\) must lie between"),
        (
            LooseSlipper(mm(0.2), pulse=0.2),
            r"pulse \(0.2 s\) .* Times are in seconds: 0.2 ms is 2e-4",
        ),
    ],
)
def test_what_cannot_be_simulated_is_refused(
    pump: Pump, at_15: OperatingCondition, fault: LooseSlipper, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        loose_slipper_lines(fault, pump, at_15, 10)


def test_a_slipper_that_bounces_differently_each_revolution_is_refused(
    pump: Pump, at_15: OperatingCondition, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lost_contact, "MAX_REVOLUTIONS", 1)
    with pytest.raises(SwashTwinError, match="does not repeat within 1 revolutions"):
        loose_slipper_lines(LOOSE, pump, at_15, 10)


SHALLOW = SwashPlateDefect(depth=mm(0.07), contact="lift_off")
DEEP_UNLOADED = SwashPlateDefect(depth=mm(0.6), angle=deg(90), contact="lift_off")


def ridden(
    pump: Pump, condition: OperatingCondition, defect: SwashPlateDefect
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shaft angle [rad], displacement [m], and normal force between a slipper and the swash plate
    [N].
    """
    displacement, tilt = ride(pump, condition, defect), np.cos(pump.rotating_group.swash_angle)
    angle = 2 * np.pi * np.arange(displacement.size) / displacement.size
    curvature = np.roll(displacement, -1) - 2 * displacement + np.roll(displacement, 1)
    inertia = (
        pump.masses.piston_slipper / tilt * curvature / (condition.period / displacement.size) ** 2
    )
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


def test_the_plate_gives_back_what_presses_the_slipper(
    pump: Pump, at_15: OperatingCondition
) -> None:
    angle, _, force = ridden(pump, at_15, DEEP_UNLOADED)
    pressed = pressing_force(pump, at_15, angle) / np.cos(pump.rotating_group.swash_angle)
    assert np.mean(force == 0) > 0.02  # in flight
    assert force.max() > 1.5 * pressed.max()
    assert force.mean() == pytest.approx(pressed.mean(), rel=1e-9)


def test_a_loaded_slipper_follows_a_shallow_recess(pump: Pump, at_15: OperatingCondition) -> None:
    assert np.all(ridden(pump, at_15, SHALLOW)[2] > 0)
    lines, ideal = (
        riding_lines(pump, at_15, SHALLOW, 100),
        displacement_lines(pump, at_15, SHALLOW, 100),
    )
    np.testing.assert_allclose(lines, ideal, atol=2e-3 * np.abs(ideal).max())
    assert np.flatnonzero(lines)[0] + 1 == 7


def test_one_word_lets_the_line_at_28_orders_stand(pump: Pump, at_15: OperatingCondition) -> None:
    """Films that pull halve the line at 28 times the shaft's speed; slippers that may lift off
    leave it nearly.
    """

    def line(fault: SwashPlateDefect | None) -> float:
        twin = Twin(pump, at_15, fault)
        return float(twin.acceleration().abs()[0, np.flatnonzero(twin.orders == 28)[0]])

    healthy = line(None)
    assert line(SHALLOW) == pytest.approx(healthy, rel=0.02)
    assert line(replace(SHALLOW, contact="shared")) < 0.6 * healthy
    assert Twin(pump, at_15, SHALLOW).notes() == ()
