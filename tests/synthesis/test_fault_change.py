"""A fault's change laid over measured healthy windows: where a twin made the 'measured' ones, the answer is known."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from swashtwin.foundation import InputError, MPa, celsius, mm, um
from swashtwin.learning import WindowSet, cut_windows
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, PistonWear, Pump, SwashPlateDefect
from swashtwin.synthesis import Background, Variation, simulate_windows
from swashtwin.synthesis import twin_windows as synthesis
from swashtwin.synthesis.fault_change import change_share
from swashtwin.synthesis.shaft_alignment import align_windows

RATE = 12800.0
STILL = Variation(
    speed=0.0, pressure=0.0, severity=0.0, angle=0.0, temperature=(celsius(45), celsius(45)), interfaces=0.0, sensor=0.0
)
RECESS = SwashPlateDefect(depth=mm(0.06), length=mm(30), width=mm(24))
PITCH = 2 * math.pi / 7


@pytest.fixture(scope="module")
def healthy(pump: Pump, at_15: OperatingCondition) -> Twin:
    return Twin(pump, at_15.replaced(oil_temperature=celsius(45)), bandwidth=4000.0)


def recording_windows(twin: Twin, name: str, *, phase: float, rate: float = 1.0, specimen: str = "A") -> WindowSet:
    """Windows of a noiseless recording of a twin whose shaft turns `rate` times as fast as it states."""
    turning = twin.at(twin.condition.replaced(speed=twin.condition.speed * rate))
    recording = turning.simulate(0.5, RATE, phase=phase, recording_id=name)
    stated = replace(recording, synthetic=False, specimen=specimen, condition=twin.condition)
    return cut_windows([stated], length=2048, classes=("normal", "swash_plate", "piston"))


def up_to_a_pitch(angle: np.ndarray) -> np.ndarray:
    return (angle + PITCH / 2) % PITCH - PITCH / 2


def test_angle_and_speed_of_the_shaft_are_read_off_the_piston_pass_lines(healthy: Twin) -> None:
    windows = recording_windows(healthy, "r", phase=0.3, rate=1.004)
    aligned = align_windows(windows, healthy)
    speed = 1.004 * healthy.condition.speed
    np.testing.assert_allclose(aligned.speed, speed, rtol=3e-4)
    np.testing.assert_allclose(up_to_a_pitch(aligned.angle - 0.3 - speed * windows.start / RATE), 0, atol=0.01)


def test_a_change_turns_a_twin_s_healthy_windows_into_its_faulty_ones(healthy: Twin) -> None:
    worn = healthy.with_fault(RECESS)
    measured = recording_windows(healthy, "r", phase=0.3)
    changed = simulate_windows(worn, count=3, like=measured, seed=0, variation=STILL, background="healthy")
    expected = recording_windows(worn, "w", phase=0.3)
    assert set(changed.label) == {"swash_plate"}
    for window in changed.signal:
        nearest = min(float(np.std(window - other)) for other in expected.signal)
        assert nearest < 0.05 * float(np.std(window))
    assert len({window.tobytes() for window in changed.signal}) == 3


def test_the_windows_of_one_healthy_recording_are_one_recording_of_its_machine(healthy: Twin) -> None:
    measured = recording_windows(healthy, "a", phase=0.3) + recording_windows(healthy, "b", phase=1.0, specimen="B")
    settings = {"count": 8, "like": measured, "seed": 0, "background": "healthy"}
    changed = simulate_windows(healthy.with_fault(RECESS), **settings)
    names = {f"changed_swash_plate_15MPa_0_{name}" for name in ("a", "b")}
    assert set(changed.recording_id.tolist()) == names
    assert set(changed.specimen.tolist()) == {"twin of A", "twin of B"}
    assert set(changed.manifest) == {"a", "b"}
    of_a = simulate_windows(healthy.with_fault(RECESS), **settings, specimens=["A"])
    assert set(of_a.specimen.tolist()) == {"twin of A"}


def test_a_healthy_pump_s_windows_are_the_measured_ones(healthy: Twin) -> None:
    measured = recording_windows(healthy, "r", phase=0.3)
    again = simulate_windows(healthy, count=len(measured), like=measured, seed=0, background="healthy")
    assert {window.tobytes() for window in again.signal} == {window.tobytes() for window in measured.signal}


def test_the_piston_that_is_worn_differs_from_window_to_window(healthy: Twin) -> None:
    measured = recording_windows(healthy, "r", phase=0.3).subset(np.array([0]))
    worn = healthy.with_fault(PistonWear(clearance=um(60)))
    changed = simulate_windows(worn, count=20, like=measured, seed=0, variation=STILL, background="healthy")
    assert 3 < len({window.tobytes() for window in changed.signal}) <= 7


def test_a_window_does_not_depend_on_those_made_beside_it(healthy: Twin, monkeypatch: pytest.MonkeyPatch) -> None:
    measured = recording_windows(healthy, "r", phase=0.3)
    worn = healthy.with_fault(RECESS)
    few, many = (
        simulate_windows(worn, count=count, like=measured, seed=0, background="healthy").signal for count in (2, 5)
    )
    monkeypatch.setattr(synthesis, "_CHUNK", 2)
    chunked = simulate_windows(worn, count=5, like=measured, seed=0, background="healthy").signal
    np.testing.assert_array_equal(many[:2], few)
    np.testing.assert_array_equal(many, chunked)


@pytest.mark.parametrize("background", ["healthy", "spectrum"])
def test_severities_spread_within_a_factor_of_two_unless_told(healthy: Twin, background: Background) -> None:
    measured = recording_windows(healthy, "r", phase=0.3)
    settings: dict[str, Any] = {"count": 3, "like": measured, "seed": 0, "background": background}
    worn = healthy.with_fault(RECESS)
    usual = simulate_windows(worn, **settings).signal
    assert math.exp(1.96 * Variation().severity) == pytest.approx(2, rel=0.02)
    np.testing.assert_array_equal(usual, simulate_windows(worn, **settings, variation=Variation()).signal)
    narrower = replace(Variation(), severity=0.2)
    assert np.abs(usual - simulate_windows(worn, **settings, variation=narrower).signal).max() > 0.01


def test_a_machine_measured_with_half_the_change_follows_half_of_it(healthy: Twin) -> None:
    at_10 = healthy.at(healthy.condition.replaced(discharge_pressure=MPa(10)))
    base = recording_windows(at_10, "h", phase=0.3)
    worn = recording_windows(at_10.with_fault(RECESS), "w", phase=0.3)
    half = replace(worn, signal=(worn.signal + base.signal) / 2)
    twin = healthy.with_fault(RECESS)
    np.testing.assert_array_equal(change_share(base, twin), 1.0)
    share = change_share(base + half, twin)
    assert (share > 0.4).all()
    assert share.min() < 0.6
    np.testing.assert_allclose(change_share(base + worn, twin), 1.0, atol=0.1)


def test_what_cannot_be_laid_over_healthy_windows_is_refused(healthy: Twin) -> None:
    measured = recording_windows(healthy, "r", phase=0.3)
    elsewhere = healthy.at(healthy.condition.replaced(discharge_pressure=MPa(5))).with_fault(RECESS)
    settings = {"count": 1, "seed": 0, "background": "healthy"}
    with pytest.raises(InputError, match=r"no measured healthy window at 5 MPa.*some at 15 MPa"):
        simulate_windows(elsewhere, like=measured, **settings)
    short = replace(measured, signal=measured.signal[:, :, :512])
    with pytest.raises(InputError, match=r"0\.57 revolutions"):
        simulate_windows(healthy.with_fault(RECESS), like=short, **settings)
    with pytest.raises(InputError, match="window of p9 at 15 MPa"):
        simulate_windows(healthy.with_fault(RECESS), like=measured, specimens=["p9"], **settings)
