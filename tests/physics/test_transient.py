"""Twins marched along a profile: the steady state where nothing changes, and physics where something does."""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.signal

from swashtwin.foundation import InputError, MPa, mm, rpm, um
from swashtwin.physics import OperatingProfile, Scales, Twin, profile_blocks, simulate_profile
from swashtwin.physics.twin import transient
from swashtwin.physics.twin.operating_grid import operating_grid
from swashtwin.pump import (
    BoreDefect,
    DamScratch,
    Fault,
    LooseSlipper,
    OperatingCondition,
    PistonWear,
    Pump,
    SwashPlateDefect,
    TiltedBlockFace,
    ValvePlateWear,
)
from swashtwin.recordings import Recording

RECESS = SwashPlateDefect(depth=mm(0.6), length=mm(30), width=mm(24))
RATE = 6400.0


def exact(twin: Twin, angle: np.ndarray) -> np.ndarray:
    """Sum of the twin's lines at shaft `angle` [rad]."""
    lines = twin.acceleration().detach().numpy()
    return (lines @ np.exp(1j * twin.orders[:, None] * angle)).real


def misfit(signal: np.ndarray, expected: np.ndarray) -> float:
    return float(np.sqrt(((signal - expected) ** 2).mean() / (expected**2).mean()))


def angle_of(recording: Recording, phase: float = 0.0) -> np.ndarray:
    assert recording.speed is not None
    steps = (recording.speed[1:] + recording.speed[:-1]) / 2 / recording.sample_rate
    return phase + np.concatenate([[0.0], np.cumsum(steps)])


# ---- a profile on which nothing changes


@pytest.mark.parametrize(
    "fault",
    [
        None,
        RECESS,
        replace(RECESS, contact="physical"),
        replace(RECESS, contact="literal", off_axis=False),
        BoreDefect(um(150)),
        LooseSlipper(mm(0.1)),
        PistonWear(um(40)),
        ValvePlateWear(um(10)),
    ],
)
def test_a_constant_profile_is_the_steady_recording(pump: Pump, at_15: OperatingCondition, fault: Fault | None) -> None:
    twin = Twin(pump, at_15, fault, bandwidth=1000)
    marched = simulate_profile(twin, OperatingProfile.steady(at_15, 0.3), RATE, phase=0.7)
    assert misfit(marched.signal, exact(twin, 0.7 + at_15.speed * marched.time)) < 1e-3
    steady = twin.simulate(0.3, RATE, phase=0.7)
    assert (marched.label, marched.channels, marched.condition) == (steady.label, steady.channels, steady.condition)
    assert misfit(marched.signal, steady.signal) < 3e-3  # whose own interpolation shows


def test_topology_scales_and_interface_values_act_as_in_the_steady_state(pump: Pump, at_15: OperatingCondition) -> None:
    twin = Twin(pump, at_15, RECESS, bandwidth=1000, topology="T2", scales=Scales(1.3, 0.8, 0.5, 2.0))
    twin = twin.with_interfaces(type(pump.interfaces).from_values([0.8e6, 1e8, 6e4, 1.2e8, 1.5e5, 5e7]))
    marched = simulate_profile(twin, OperatingProfile.steady(at_15, 0.2), RATE)
    assert misfit(marched.signal, exact(twin, at_15.speed * marched.time)) < 1e-3


def test_the_error_falls_at_least_with_the_square_of_the_step(pump: Pump, at_15: OperatingCondition) -> None:
    twin = Twin(pump, at_15, RECESS, bandwidth=2500)
    errors = []
    for oversampling in (2, 4, 8):
        marched = simulate_profile(twin, OperatingProfile.steady(at_15, 0.1), RATE, oversampling=oversampling)
        errors.append(misfit(marched.signal, exact(twin, at_15.speed * marched.time)))
    assert errors[0] / errors[1] > 4
    assert errors[1] / errors[2] > 4


def test_a_start_from_rest_dies_away_to_the_steady_state(pump: Pump, at_15: OperatingCondition) -> None:
    """The slowest mode is that at 180 Hz, whose oscillation loses a factor e in 41 ms."""
    twin = Twin(pump, at_15, bandwidth=1000)
    marched = simulate_profile(twin, OperatingProfile.steady(at_15, 0.8), RATE, start="rest")
    expected = exact(twin, at_15.speed * marched.time)
    parts = [slice(first, first + 640) for first in (0, 1280, 4480)]
    early, later, late = (misfit(marched.signal[:, part], expected[:, part]) for part in parts)
    assert early > 1
    assert later < early * math.exp(-0.2 / 0.05)
    assert late < 1e-3


def test_no_reading_depends_on_where_a_block_ends(
    pump: Pump, at_15: OperatingCondition, monkeypatch: pytest.MonkeyPatch
) -> None:
    twin = Twin(pump, at_15, RECESS, bandwidth=1000)
    profile = OperatingProfile.ramp(at_15, 0.1, to_speed=80.0, to_pressure=MPa(12), jitter=0.01)
    whole = simulate_profile(twin, profile, RATE)
    monkeypatch.setattr(transient, "BLOCK", 97)
    blocks = list(profile_blocks(twin, profile, RATE))
    assert [block.signal.shape[1] for block in blocks] == [97] * 6 + [58]
    np.testing.assert_allclose(np.concatenate([b.signal for b in blocks], axis=1), whole.signal, atol=1e-8)
    np.testing.assert_array_equal(np.concatenate([b.speed for b in blocks]), whole.speed)


# ---- profiles on which something does


def test_the_hold_after_a_ramp_becomes_the_steady_state_at_its_end(pump: Pump, at_15: OperatingCondition) -> None:
    fast = at_15.replaced(speed=rpm(1200), discharge_pressure=MPa(10))
    knots = np.array([0.0, 0.3, 0.9])
    profile = OperatingProfile(
        knots, np.array([at_15.speed, fast.speed, fast.speed]), np.array([MPa(15), MPa(10), MPa(10)])
    )
    twin = Twin(pump, at_15, RECESS, bandwidth=1000)
    marched = simulate_profile(twin, profile, RATE, phase=0.2)
    turned = 0.2 + (at_15.speed + fast.speed) / 2 * 0.3
    expected = exact(twin.at(fast), turned + fast.speed * (marched.time - 0.3))
    assert misfit(marched.signal[:, -640:], expected[:, -640:]) < 1e-3
    assert misfit(marched.signal[:, :640], expected[:, :640]) > 0.5


@pytest.fixture(scope="module")
def run_up(pump: Pump) -> Recording:
    """From 60 to 1500 rev/min in 6 s."""
    condition = OperatingCondition(speed=rpm(1500), discharge_pressure=MPa(15))
    twin = Twin(pump, condition, bandwidth=1000)
    return simulate_profile(twin, OperatingProfile.run_up(condition, 6.0, from_speed=rpm(60)), 2560.0, oversampling=5)


def tracked(recording: Recording, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Frequency [Hz] of an order and its amplitude in each channel, over time."""
    assert recording.speed is not None
    low_pass = scipy.signal.butter(2, 4, fs=recording.sample_rate, output="sos")
    turned = recording.signal * np.exp(-1j * order * angle_of(recording))
    amplitude = 2 * np.abs(scipy.signal.sosfiltfilt(low_pass, turned, axis=1))
    return order * recording.speed / (2 * math.pi), amplitude


@pytest.mark.parametrize(("order", "mode"), [(14, 180), (28, 180), (28, 608)])
def test_an_order_is_loudest_where_it_crosses_a_mode(run_up: Recording, order: int, mode: float) -> None:
    """Within 3 %: a sweep arrives a little late, and forces change with the speed."""
    frequency, amplitude = tracked(run_up, order)
    near = (frequency > 0.8 * mode) & (frequency < min(1.15 * mode, 0.96 * frequency.max()))
    row = amplitude[1, near]
    assert frequency[near][row.argmax()] == pytest.approx(mode, rel=0.04)
    assert row.max() > 1.05 * max(row[0], row[-1])


def test_between_the_modes_a_slow_run_up_is_steady_at_every_speed(pump: Pump, run_up: Recording) -> None:
    assert run_up.speed is not None
    frequency, amplitude = tracked(run_up, 28)
    for line in (100.0, 500.0):
        speed = 2 * math.pi * line / 28
        twin = Twin(pump, OperatingCondition(speed=speed, discharge_pressure=MPa(15)), bandwidth=1000)
        level = np.abs(twin.acceleration().detach().numpy()[:, twin.orders == 28])[:, 0]
        height = amplitude[:, np.abs(frequency - line).argmin()]
        np.testing.assert_allclose(height[:2], level[:2], rtol=0.02)


def test_a_recording_of_a_profile_says_its_speed_and_its_mean_condition(run_up: Recording) -> None:
    assert run_up.speed is not None
    assert run_up.condition is not None
    np.testing.assert_allclose(run_up.speed, rpm(60) + rpm(1440) * run_up.time / 6, rtol=1e-12)
    assert run_up.condition.speed == pytest.approx(rpm(780))
    assert run_up.synthetic


def test_a_pump_starts_from_standstill_and_is_silent_there(pump: Pump, at_15: OperatingCondition) -> None:
    """Below 60 rev/min the pump could not hold its pressure; the shape of the lowest speed that can stands in."""
    twin = Twin(pump, at_15, RECESS, bandwidth=1000)
    profile = OperatingProfile(np.array([0.0, 0.2, 0.7]), np.array([0.0, 0.0, at_15.speed]), np.full(3, MPa(15)))
    marched = simulate_profile(twin, profile, RATE)
    assert np.isfinite(marched.signal).all()
    assert np.abs(marched.signal[:, :1200]).max() < 1e-6
    assert marched.signal[:, -640:].std() > 0.1


def test_a_ramp_down_to_standstill_is_finite_and_never_turns_back(pump: Pump, at_15: OperatingCondition) -> None:
    twin = Twin(pump, at_15, LooseSlipper(mm(0.1), pulse=2e-3), bandwidth=1000)
    marched = simulate_profile(twin, OperatingProfile.ramp(at_15, 0.5, to_speed=0.0), RATE)
    assert marched.speed is not None
    assert marched.speed.min() >= 0
    assert np.isfinite(marched.signal).all()


def test_the_unbalance_grows_with_the_square_of_the_speed(pump: Pump, at_15: OperatingCondition) -> None:
    profile = OperatingProfile.run_up(at_15, 1.0)
    twin = Twin(pump, at_15, bandwidth=1000)
    grid = operating_grid(twin, profile, profile.shaft(), [np.linspace(0, 1, 500)])
    force = pump.masses.rotor * pump.masses.rotor_eccentricity
    for speed in (0.0, 1.0, 33.3, at_15.speed):
        expected = force * speed**2 * np.array([1, -1j])
        np.testing.assert_allclose(grid.lines_at(speed, MPa(15))[1, 5:7], expected, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("fault", [RECESS, replace(RECESS, contact="physical"), BoreDefect(um(150)), DamScratch(1e-6)])
def test_forces_between_the_points_of_the_grid_are_nearly_those_solved_there(
    pump: Pump, at_15: OperatingCondition, fault: Fault
) -> None:
    """The points of a profile that visits only its neighborhood are its own, so that both grids differ."""
    twin, between = Twin(pump, at_15, fault, bandwidth=2000), at_15.speed * 1.0312
    wide = OperatingProfile.ramp(at_15, 1.0, to_speed=at_15.speed * 1.2, to_pressure=MPa(18))
    time = np.array([(between / at_15.speed - 1) / 0.2])
    here = OperatingCondition(speed=between, discharge_pressure=float(wide.pressure_at(time)[0]))
    narrow = OperatingProfile.steady(here, 1.0)
    lines = operating_grid(twin, wide, wide.shaft(), [time]).lines_at(between, here.discharge_pressure)
    solved = operating_grid(twin.at(here), narrow, narrow.shaft(), [time]).lines_at(between, here.discharge_pressure)
    n = len(solved) * 9 // 10  # the wide grid leaves out the orders that would leave the band before its next point
    assert np.linalg.norm(lines[1:n] - solved[1:n]) < 1e-3 * np.linalg.norm(solved[1:n])


def test_no_order_of_a_changing_speed_exceeds_the_bandwidth(pump: Pump) -> None:
    condition = OperatingCondition(speed=rpm(1500), discharge_pressure=MPa(15))
    profile = OperatingProfile.run_up(condition, 1.0, from_speed=rpm(400))
    grid = operating_grid(Twin(pump, condition, RECESS), profile, profile.shaft(), [np.linspace(0, 1, 500)])
    for low, high in zip(grid.speeds, grid.speeds[1:], strict=False):
        present = np.flatnonzero(np.abs(grid.lines_at(0.999 * high + 0.001 * low, MPa(15))).max(axis=1))
        assert 0.9 * 5000 < present.max() * high / (2 * math.pi) <= 5000


# ---- jitter


def test_jitter_has_the_spread_and_the_memory_asked_for(at_15: OperatingCondition) -> None:
    profile = replace(OperatingProfile.steady(at_15, 400.0, jitter=0.01), correlation_time=0.2)
    _, speed = profile.shaft(seed=3).at(np.arange(40000) * 0.01)
    swing = speed / at_15.speed - 1
    assert swing.mean() == pytest.approx(0, abs=1e-3)
    assert swing.std() == pytest.approx(0.01, rel=0.1)
    assert (swing[20:] * swing[:-20]).mean() / swing.var() == pytest.approx(math.exp(-1), abs=0.08)


def test_jitter_depends_on_the_seed_and_not_on_the_sample_rate(pump: Pump, at_15: OperatingCondition) -> None:
    profile, twin = OperatingProfile.steady(at_15, 0.2, jitter=0.01), Twin(pump, at_15, bandwidth=1000)
    first, again, other = (simulate_profile(twin, profile, RATE, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.signal, again.signal)
    assert misfit(other.signal, first.signal) > 1e-2
    slower = simulate_profile(twin, profile, RATE / 2, seed=1)
    assert slower.speed is not None
    assert first.speed is not None
    np.testing.assert_allclose(slower.speed, first.speed[::2], rtol=1e-12)
    assert misfit(slower.signal, first.signal[:, ::2]) < 1e-3


def test_the_shaft_turns_by_the_integral_of_its_speed(at_15: OperatingCondition) -> None:
    profile = OperatingProfile.run_up(at_15, 1.0, hold=0.5, jitter=0.02)
    time = np.linspace(0, 1.5, 300001)
    angle, speed = profile.shaft(phase=0.4).at(time)
    summed = 0.4 + np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(time))])
    np.testing.assert_allclose(angle, summed, atol=1e-6)
    assert angle[0] == 0.4


# ---- what is refused


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"time": np.array([0.0, 0.0])}, "times must rise; 0 s follows 0 s"),
        ({"time": np.array([0.0, 1.0, 2.0])}, "3 times, 2 speeds, 2 pressures"),
        ({"speed": np.array([0.0, math.nan])}, "speed must be finite"),
        ({"speed": np.array([-1.0, 90.0])}, "must not be negative"),
        ({"speed": np.array([0.0, 0.0])}, "stands still is silent"),
        ({"jitter": 0.5}, "0.5 % is 0.005"),
        ({"jitter": -0.01}, "must lie in"),
        ({"correlation_time": 0.0}, "must be a positive number"),
    ],
)
def test_a_profile_that_is_none_is_refused(change: dict[str, object], said: str) -> None:
    given = {"time": np.array([0.0, 1.0]), "speed": np.array([0.0, 90.0]), "discharge_pressure": np.full(2, MPa(15))}
    given |= change
    arrays = [given.pop(name) for name in ("time", "speed", "discharge_pressure")]
    profile = object.__new__(
        OperatingProfile
    )  # the tests' type checker would refuse arrays of different lengths earlier
    names = ("time", "speed", "discharge_pressure", *given)
    for name, value in zip(names, (*arrays, *given.values()), strict=True):
        object.__setattr__(profile, name, value)
    with pytest.raises(InputError, match=said):
        profile.__post_init__()


def test_profiles_of_no_length_are_refused(at_15: OperatingCondition) -> None:
    with pytest.raises(InputError, match=r"duration \(0 s\) must be a positive number"):
        OperatingProfile.ramp(at_15, 0.0)
    with pytest.raises(InputError, match=r"hold \(-1 s\) not negative"):
        OperatingProfile.run_up(at_15, 1.0, hold=-1.0)


@pytest.mark.parametrize(
    ("fault", "options", "rate", "said"),
    [
        (TiltedBlockFace(0.2), {}, RATE, "simulate it at a steady condition"),
        (None, {"to_pressure": 1e5}, RATE, "must exceed suction_pressure"),
        (None, {"to_speed": rpm(9000)}, RATE, "above 8000 rev/min"),
        (None, {"to_speed": rpm(5000)}, RATE, "below the piston-pass frequency"),
        (None, {}, 1500.0, "below twice the twin's bandwidth"),
    ],
)
def test_a_profile_that_a_twin_cannot_follow_is_refused(
    pump: Pump, at_15: OperatingCondition, fault: Fault | None, options: dict[str, float], rate: float, said: str
) -> None:
    twin = Twin(pump, at_15, fault, bandwidth=1000 if "to_speed" not in options else 500)
    with pytest.raises(InputError, match=said):
        simulate_profile(twin, OperatingProfile.ramp(at_15, 0.1, **options), rate)


def test_a_pump_that_never_holds_its_pressure_is_refused(pump: Pump, at_15: OperatingCondition) -> None:
    """At 10 rev/min it leaks more than it displaces."""
    with pytest.raises(InputError, match="cannot hold its discharge pressure"):
        simulate_profile(
            Twin(pump, at_15, bandwidth=1000), OperatingProfile.run_up(at_15.replaced(speed=rpm(10)), 1.0), RATE
        )


def test_no_steps_between_two_readings_are_refused(pump: Pump, at_15: OperatingCondition) -> None:
    with pytest.raises(InputError, match=r"oversampling \(0\)"):
        simulate_profile(Twin(pump, at_15), OperatingProfile.steady(at_15, 0.1), 25600.0, oversampling=0)
