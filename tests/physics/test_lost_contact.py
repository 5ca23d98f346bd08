"""Parts that lose contact: a rattling loose slipper, and slippers that ride through a recess."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from rigid_body import rigid_motions

from swashtwin.foundation import InputError, SwashTwinError, deg, mm
from swashtwin.physics import Twin, lost_contact
from swashtwin.physics.dynamics import N_DOF, Dof
from swashtwin.physics.excitation import displacement_lines, slipper_profile
from swashtwin.physics.loads import force_and_moments, pressure_shares
from swashtwin.physics.lost_contact import (
    LooseMotion,
    loose_motion,
    loose_slipper_lines,
    pressing_force,
    ride,
    riding_lines,
    slipper_shares,
)
from swashtwin.pump import LooseSlipper, OperatingCondition, Pump, SwashPlateDefect
from swashtwin.signals import fourier_lines

LOOSE = LooseSlipper(clearance=mm(0.2))


@pytest.fixture(scope="module")
def motion(pump: Pump, at_15: OperatingCondition) -> LooseMotion:
    return loose_motion(pump, at_15, LOOSE)


class Impact(NamedTuple):
    angle: float
    """Shaft angle [rad]."""
    speed: float
    """Speed before the impact [m/s]."""
    restitution: float
    """Share of the speed that remains after it."""


def impacts_at(beyond_stop: np.ndarray, motion: LooseMotion) -> list[Impact]:
    """Impacts at one stop of the joint, given the steps at which the piston is beyond it."""
    impacts = []
    for first in np.flatnonzero(beyond_stop & ~np.roll(beyond_stop, 1)):
        end = first + int(np.argmin(np.roll(beyond_stop, -first)))
        speed_before = abs(motion.velocity[first - 1])
        speed_after = abs(motion.velocity[end % len(beyond_stop)])
        # a piston that rests on a stop may cross it slowly, which is no impact
        if speed_before > 0.01:
            angle = np.mod(motion.angle[first], 2 * math.pi)
            impact = Impact(float(angle), float(speed_before), float(speed_after / speed_before))
            impacts.append(impact)
    return impacts


def impacts_of(motion: LooseMotion) -> list[Impact]:
    """All impacts: those at the end of the play, pulled, before those at its start, pressed."""
    pulled = impacts_at(motion.displacement > LOOSE.clearance, motion)
    pressed = impacts_at(motion.displacement < 0, motion)
    return pulled + pressed


def stroke_speed(pump: Pump, condition: OperatingCondition, angle: float) -> float:
    """Speed [m/s] of a slipper along the shaft."""
    return condition.speed * half_stroke(pump) * abs(math.sin(angle))


def half_stroke(pump: Pump) -> float:
    return pump.rotating_group.pitch_radius * math.tan(pump.rotating_group.swash_angle)


def test_a_tight_joint_adds_no_load(pump: Pump, at_15: OperatingCondition) -> None:
    assert not loose_slipper_lines(LooseSlipper(0.0), pump, at_15, 50).any()


def test_the_piston_leaves_its_play_only_by_the_compression_of_the_stops(
    pump: Pump, motion: LooseMotion
) -> None:
    # an impact lasts half a period of the piston on the spring of the stop
    stop_stiffness = pump.masses.piston_slipper * (math.pi / LOOSE.pulse) ** 2
    compression = pump.rotating_group.piston_area * motion.pressure.max() / stop_stiffness
    assert -1.05 * compression < motion.displacement.min() < 0
    assert LOOSE.clearance < motion.displacement.max() < 1.1 * LOOSE.clearance


def test_the_piston_is_pressed_on_at_the_speed_of_the_stroke_that_takes_up_its_play(
    pump: Pump, at_15: OperatingCondition, motion: LooseMotion
) -> None:
    _, pressed = impacts_of(motion)
    taken_up = half_stroke(pump) * (1 + math.cos(pressed.angle))
    assert taken_up == pytest.approx(LOOSE.clearance, rel=0.03)
    assert pressed.speed == pytest.approx(stroke_speed(pump, at_15, pressed.angle), rel=0.06)


def test_a_pulled_impact_is_no_faster_than_inertia_and_friction_allow(
    pump: Pump, at_15: OperatingCondition, motion: LooseMotion
) -> None:
    pulled, _ = impacts_of(motion)

    # sqrt(2 a e) over the play e, with the highest acceleration of the stroke and of friction
    acceleration = half_stroke(pump) * at_15.speed**2
    acceleration += lost_contact.FRICTION / pump.masses.piston_slipper
    max_speed = math.sqrt(2 * acceleration * LOOSE.clearance)
    assert max_speed == pytest.approx(0.281, rel=3e-3)
    assert 0.5 * max_speed < pulled.speed < max_speed

    # friction can stop a piston, no more
    assert pulled.speed < 1.05 * stroke_speed(pump, at_15, pulled.angle)


def test_a_pressed_impact_is_much_slower_than_the_trapped_oil_allows(
    pump: Pump, motion: LooseMotion
) -> None:
    _, pressed = impacts_of(motion)

    # the energy of the oil that a stroke over the play compresses in the full chamber
    group = pump.rotating_group
    full_volume = group.dead_volume + 2 * group.piston_area * half_stroke(pump)
    oil = pump.oil.bulk_modulus / (full_volume * pump.masses.piston_slipper)
    max_speed = group.piston_area * math.sqrt(oil) * LOOSE.clearance
    assert max_speed == pytest.approx(1.65, rel=3e-3)
    assert pressed.speed < 0.2 * max_speed


def test_a_bouncing_slipper_rebounds_with_its_restitution(
    pump: Pump, at_15: OperatingCondition
) -> None:
    motion = loose_motion(pump, at_15, LooseSlipper(mm(0.2), restitution=0.9))
    assert impacts_of(motion)[0].restitution == pytest.approx(0.9, rel=0.03)

    # a periodic motion has no mean acceleration
    assert abs(motion.extra_acceleration.mean()) < 1e-9 * np.abs(motion.extra_acceleration).max()


def test_the_load_does_only_the_work_of_the_pistons_inertia_on_rigid_motions(
    pump: Pump, at_15: OperatingCondition, motion: LooseMotion
) -> None:
    load = loose_slipper_lines(LOOSE, pump, at_15, 60)
    x, y, z, about_x, about_y = (load @ rigid_motions(pump)).T

    # Fourier lines from the middle of each step
    step = 2 * math.pi / len(motion.angle)
    angle = motion.angle + step / 2
    transform = np.exp(-1j * np.arange(1, 61)[:, None] * angle) * (2 / len(angle))
    inertia = pump.masses.piston_slipper * motion.extra_acceleration
    radius = pump.rotating_group.pitch_radius
    axial = transform @ inertia
    moment_x = transform @ (inertia * radius * np.cos(angle))
    moment_y = transform @ (inertia * radius * np.sin(angle))

    scale = np.abs(z).max()
    assert np.abs(x).max() < 1e-12 * scale
    assert np.abs(y).max() < 1e-12 * scale
    np.testing.assert_allclose(z[1:], -axial, atol=1e-9 * scale)
    np.testing.assert_allclose(about_x[1:], -moment_x, atol=1e-9 * scale)
    np.testing.assert_allclose(about_y[1:], moment_y, atol=1e-9 * scale)


def test_the_lines_are_those_of_the_loads_at_each_shaft_angle(
    pump: Pump, at_15: OperatingCondition, motion: LooseMotion
) -> None:
    """Derived from the force's own lines, they are those of its loads, line 0 too."""
    n_steps = len(motion.angle)
    half_step = math.pi / n_steps
    inertia = pump.masses.piston_slipper * motion.extra_acceleration
    pressing = pump.rotating_group.piston_area * motion.extra_pressure
    orders = np.arange(41)[:, None]
    expected = np.zeros((41, N_DOF), dtype=complex)
    for force, angle, shares in (
        (inertia, motion.angle + half_step, slipper_shares(pump)),
        (pressing, motion.angle, pressure_shares(pump)),
    ):
        moments = force_and_moments(pump, force[None], np.cos(angle)[None], np.sin(angle)[None])
        lines_of_loads = fourier_lines(shares @ moments).T[:41]
        expected += lines_of_loads * np.exp(-1j * orders * angle[0])

    lines = loose_slipper_lines(LOOSE, pump, at_15, 40)
    np.testing.assert_allclose(lines, expected, rtol=0, atol=1e-10 * np.abs(expected).max())
    assert np.abs(expected[0]).max() > 1e-3 * np.abs(expected).max()


def test_pressing_a_slipper_on_pushes_the_retainer_toward_the_swash_plate(
    pump: Pump, at_15: OperatingCondition, motion: LooseMotion
) -> None:
    _, pressed = impacts_of(motion)
    mass = pump.masses.piston_slipper
    since_impact = np.mod(motion.angle - pressed.angle, 2 * math.pi)
    during_pulse = since_impact < at_15.speed * LOOSE.pulse
    time_step = at_15.period / len(motion.angle)

    impulse = -mass * motion.extra_acceleration[during_pulse].sum() * time_step

    # without restitution, the momentum before the impact
    assert impulse == pytest.approx(-mass * pressed.speed, rel=0.15)


def test_slippers_that_are_rigid_with_the_rotor_load_it_instead_of_the_retainer(
    pump: Pump, at_15: OperatingCondition
) -> None:
    series = loose_slipper_lines(LOOSE, pump, at_15, 20)
    rigid = loose_slipper_lines(LOOSE, pump, at_15, 20, topology="T2")
    assert not rigid[:, Dof.RETAINER_Z].any()
    np.testing.assert_allclose(
        rigid[:, Dof.ROTOR_Z], series[:, Dof.ROTOR_Z] + series[:, Dof.RETAINER_Z]
    )


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
    ids=["eighth slipper", "gain at an impact", "no duration", "milliseconds as seconds"],
)
def test_an_impossible_loose_slipper_is_refused(
    pump: Pump, at_15: OperatingCondition, fault: LooseSlipper, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        loose_slipper_lines(fault, pump, at_15, 10)


def test_a_slipper_that_bounces_differently_each_revolution_is_refused(
    pump: Pump, at_15: OperatingCondition, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lost_contact, "MAX_REVOLUTIONS", 1)
    lost_contact.loose_motion.cache_clear()
    with pytest.raises(SwashTwinError, match="does not repeat within 1 revolutions"):
        loose_slipper_lines(LOOSE, pump, at_15, 10)


SHALLOW = SwashPlateDefect(depth=mm(0.07), contact="lift_off")
# on the suction side (90 degrees) little more than the spring presses a slipper on
DEEP_UNLOADED = SwashPlateDefect(depth=mm(0.6), angle=deg(90), contact="lift_off")


class Ride(NamedTuple):
    """A slipper over a turn."""

    angle: np.ndarray
    """Shaft angle [rad]."""
    displacement: np.ndarray
    """Displacement along the normal of the swash plate [m]."""
    contact_force: np.ndarray
    """Normal force between the slipper and the swash plate [N]."""


def simulate_ride(pump: Pump, condition: OperatingCondition, defect: SwashPlateDefect) -> Ride:
    displacement = ride(pump, condition, defect)
    n_steps = displacement.size
    angle = 2 * np.pi * np.arange(n_steps) / n_steps
    time_step = condition.period / n_steps

    # force balance along the shaft
    cosine = np.cos(pump.rotating_group.swash_angle)
    mass = pump.masses.piston_slipper
    difference = np.roll(displacement, -1) - 2 * displacement + np.roll(displacement, 1)
    inertia = mass / cosine * difference / time_step**2
    pressed = pressing_force(pump, condition, angle)
    force = (pressed - inertia) / cosine

    # a rounding error is no contact
    is_contact = np.abs(force) > 1e-9 * pressed.max()
    return Ride(angle, displacement, np.where(is_contact, force, 0.0))


@pytest.mark.parametrize("defect", [SHALLOW, DEEP_UNLOADED], ids=["shallow", "deep, unloaded"])
def test_no_film_pulls_and_no_slipper_enters_the_plate(
    pump: Pump, at_15: OperatingCondition, defect: SwashPlateDefect
) -> None:
    slipper = simulate_ride(pump, at_15, defect)
    surface, _ = slipper_profile(pump, defect, slipper.angle)

    assert slipper.contact_force.min() >= 0
    assert np.all(slipper.displacement <= surface)
    assert slipper.displacement.max() == pytest.approx(surface.max())


def test_the_plate_returns_the_force_that_presses_the_slipper(
    pump: Pump, at_15: OperatingCondition
) -> None:
    slipper = simulate_ride(pump, at_15, DEEP_UNLOADED)
    force = slipper.contact_force
    pressed = pressing_force(pump, at_15, slipper.angle) / np.cos(pump.rotating_group.swash_angle)

    assert np.mean(force == 0) > 0.02  # in flight
    assert force.max() > 1.5 * pressed.max()
    # over a turn the slipper gains no momentum
    assert force.mean() == pytest.approx(pressed.mean(), rel=1e-9)


def test_a_loaded_slipper_follows_a_shallow_recess(pump: Pump, at_15: OperatingCondition) -> None:
    assert np.all(simulate_ride(pump, at_15, SHALLOW).contact_force > 0)

    lines = riding_lines(pump, at_15, SHALLOW, 100)
    ideal = displacement_lines(pump, at_15, SHALLOW, 100)
    np.testing.assert_allclose(lines, ideal, atol=2e-3 * np.abs(ideal).max())

    first_order = np.flatnonzero(lines)[0] + 1
    assert first_order == 7


def test_only_films_that_pull_halve_the_line_at_28_orders(
    pump: Pump, at_15: OperatingCondition
) -> None:
    def line(fault: SwashPlateDefect | None) -> float:
        twin = Twin(pump, at_15, fault)
        index = np.flatnonzero(twin.orders == 28)[0]
        return float(twin.acceleration().abs()[0, index])

    # physics.md 2.5: healthy 1.239 m/s^2; 1.228 if slippers may lift off, 0.625 if films pull
    healthy = line(None)
    assert line(SHALLOW) == pytest.approx(healthy, rel=0.02)
    assert line(replace(SHALLOW, contact="shared")) < 0.6 * healthy


def test_slippers_that_may_lift_off_need_no_note(pump: Pump, at_15: OperatingCondition) -> None:
    assert Twin(pump, at_15, SHALLOW).notes() == ()
