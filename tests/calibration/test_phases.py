"""Phases of the lines: all but one unknown shaft position determines the values."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from swashtwin.calibration import (
    Calibration,
    GaussNewton,
    Nuisances,
    build_objective,
    calibrate,
    measure,
)
from swashtwin.calibration.measurement import (
    average_phased_lines,
    find_shaft_position,
    measure_phased_lines,
)
from swashtwin.foundation import DataError, mm, random_stream
from swashtwin.physics import Twin
from swashtwin.pump import Interfaces, OperatingCondition, Pump, SwashPlateDefect
from swashtwin.recordings import Recording
from swashtwin.signals import synchronous_signal

FACTORS = np.array([1.0, 1.0, 1.6, 0.7, 2.5, 1.0])


@pytest.fixture(scope="module")
def nominal(pump: Pump, at_15: OperatingCondition) -> Twin:
    recess = SwashPlateDefect(length=mm(30), width=mm(24), depth=mm(0.6))
    return Twin(pump, at_15, recess, bandwidth=2600.0)


@pytest.fixture(scope="module")
def true(nominal: Twin) -> Twin:
    return nominal.with_interfaces(Interfaces.from_values(nominal.values.numpy() * FACTORS))


def simulate_recording(twin: Twin, start: float = 1.0, name: str = "one") -> Recording:
    """Two seconds of a speed that swings by 0.3 %, from a shaft angle on, with a little noise."""
    rate = 12800.0
    time = np.arange(25600) / rate
    swing = 0.003 * np.sin(2 * np.pi * time) / (2 * np.pi)
    angle = start + twin.condition.speed * (time + swing)
    with torch.no_grad():
        lines = twin.acceleration().numpy()
    signal = synchronous_signal(lines, twin.orders, angle)
    noise = 0.05 * random_stream(0, "phases", name).standard_normal(signal.shape)

    return Recording(
        signal + noise,
        rate,
        name,
        channels=twin.pump.channels,
        label="swash_plate",
        condition=twin.condition,
    )


def test_the_shaft_position_is_the_angle_by_which_lines_were_turned() -> None:
    rng = random_stream(0, "position")
    orders = 7 * np.arange(1, 13)
    lines = torch.as_tensor(rng.normal(size=12) + 1j * rng.normal(size=12))
    turned = lines * torch.as_tensor(np.exp(-0.4j * orders))

    angle = find_shaft_position(turned * lines.conj(), torch.as_tensor(orders))

    # multiples of 7 leave a seventh of a turn open
    assert math.remainder(float(angle) - 0.4, 2 * math.pi / 7) == pytest.approx(0, abs=1e-12)


def test_the_shaft_position_has_exact_gradients() -> None:
    rng = random_stream(1, "position")
    cross_spectrum = torch.as_tensor(rng.normal(size=(2, 9)) + 1j * rng.normal(size=(2, 9)))
    orders = torch.arange(1, 10) * 7
    assert torch.autograd.gradcheck(
        lambda cross: find_shaft_position(cross, orders), cross_spectrum.requires_grad_()
    )


def test_lines_of_a_swinging_speed_keep_amplitude_and_phase(nominal: Twin) -> None:
    orders = nominal.orders[(nominal.orders % 7 == 0) & (nominal.orders > 0)]
    lines, deviation = measure_phased_lines(simulate_recording(nominal), orders, 7)
    with torch.no_grad():
        simulated = nominal.acceleration().numpy()[:, np.isin(nominal.orders, orders)]

    cross_spectrum = torch.as_tensor((simulated * lines.conj()).sum(axis=0))
    angle = float(find_shaft_position(cross_spectrum, torch.as_tensor(orders)))
    error = np.abs(simulated * np.exp(1j * orders * angle) - lines)
    assert error.max() < 0.01 * np.abs(simulated).max()
    assert np.median(deviation) < 0.01


def test_recordings_from_different_shaft_positions_are_averaged(nominal: Twin) -> None:
    orders = np.array([7, 14, 21, 28])
    pairs = [
        measure_phased_lines(simulate_recording(nominal, start, name=f"at {start}"), orders, 7)
        for start in (0.3, 1.7)
    ]

    lines, deviation = average_phased_lines(pairs, orders)

    # without turning them to one position, the lines would cancel in part
    first_lines, _ = pairs[0]
    np.testing.assert_allclose(np.abs(lines), np.abs(first_lines), atol=0.02)
    assert deviation.shape == lines.shape


def calibrate_nominal(nominal: Twin, true: Twin, phases: bool) -> Calibration:
    recording = simulate_recording(true)
    method = GaussNewton(starts=2)
    return calibrate(nominal, [recording], method=method, phases=phases, nuisances=Nuisances())


@pytest.fixture(scope="module")
def plain(nominal: Twin, true: Twin) -> Calibration:
    return calibrate_nominal(nominal, true, phases=False)


@pytest.fixture(scope="module")
def phased(nominal: Twin, true: Twin) -> Calibration:
    return calibrate_nominal(nominal, true, phases=True)


@pytest.mark.parametrize(("symbol", "index"), [("C_v", 2), ("K_v", 3), ("C_Hz", 4)])
def test_phases_narrow_the_interval_around_the_truth(
    plain: Calibration, phased: Calibration, true: Twin, symbol: str, index: int
) -> None:
    estimate = phased.estimate(symbol)
    assert estimate.log_std < plain.estimate(symbol).log_std
    assert estimate.interval[0] <= float(true.values[index]) <= estimate.interval[1]


def test_phases_do_not_spoil_the_amplitudes(plain: Calibration, phased: Calibration) -> None:
    plain_rmse = plain.calibrated_agreement.rmse
    assert phased.calibrated_agreement.rmse < 1.05 * plain_rmse


def test_the_settings_record_phases(phased: Calibration) -> None:
    assert phased.settings["phases"] is True


def test_observables_with_phases_have_exact_derivatives(nominal: Twin, true: Twin) -> None:
    measurement = measure(nominal, [simulate_recording(true)], phases=True)
    objective = build_objective(nominal, measurement, None, Nuisances.housing())
    point = objective.start
    observables, slope = objective.sensitivity(point)
    assert observables.shape == objective.measured.shape == objective.sigma.shape

    # one of the values, of the scales, and of the housing
    for index in (2, 7, len(point) - 1):
        step = torch.zeros_like(point)
        step[index] = 1e-6
        with torch.no_grad():
            above = objective.observables(point + step)
            below = objective.observables(point - step)
        difference = (above - below) / 2e-6
        atol = 1e-5 * float(slope[:, index].abs().max())
        np.testing.assert_allclose(slope[:, index], difference, atol=atol)


def test_a_recording_without_a_clear_line_has_no_phases(nominal: Twin) -> None:
    noise = random_stream(0, "noise").standard_normal((3, 25600))
    recording = replace(simulate_recording(nominal), signal=noise)
    with pytest.raises(DataError, match="stands clear"):
        measure_phased_lines(recording, np.array([7, 14]), 7)
