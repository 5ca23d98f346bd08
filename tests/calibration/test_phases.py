"""Phases of the lines: one shaft position is unknown, and all else that they say counts."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from swashtwin.calibration import GaussNewton, Nuisances, build_objective, calibrate, measure
from swashtwin.calibration.measurement import (
    average_phased_lines,
    find_shaft_position,
    measure_phased_lines,
)
from swashtwin.foundation import DataError, mm, random_stream
from swashtwin.physics import Twin
from swashtwin.pump import Interfaces, SwashPlateDefect
from swashtwin.recordings import Recording
from swashtwin.signals import synchronous_signal

FACTORS = np.array([1.0, 1.0, 1.6, 0.7, 2.5, 1.0])


@pytest.fixture(scope="module")
def nominal(pump, at_15) -> Twin:
    return Twin(
        pump, at_15, SwashPlateDefect(length=mm(30), width=mm(24), depth=mm(0.6)), bandwidth=2600.0
    )


def recorded(twin: Twin, start: float = 1.0, wander: float = 0.003, name: str = "one") -> Recording:
    """Two seconds whose speed swings, from an arbitrary shaft angle on, with a little noise."""
    rate, time = 12800.0, np.arange(25600) / 12800.0
    angle = start + twin.condition.speed * (time + wander * np.sin(2 * np.pi * time) / (2 * np.pi))
    with torch.no_grad():
        lines = twin.acceleration().numpy()
    signal = synchronous_signal(lines, twin.orders, angle)
    signal = signal + 0.05 * random_stream(0, "phases", name).standard_normal(signal.shape)
    return Recording(
        signal,
        rate,
        name,
        channels=twin.pump.channels,
        label="swash_plate",
        condition=twin.condition,
    )


@pytest.fixture(scope="module")
def true(nominal) -> Twin:
    return nominal.with_interfaces(Interfaces.from_values(nominal.values.numpy() * FACTORS))


def test_the_best_position_is_the_one_the_lines_were_turned_by():
    rng = random_stream(0, "position")
    orders = 7 * np.arange(1, 13)
    lines = torch.as_tensor(rng.normal(size=12) + 1j * rng.normal(size=12))
    turned = lines * torch.as_tensor(np.exp(-0.4j * orders))
    angle = find_shaft_position(turned * lines.conj(), torch.as_tensor(orders))
    assert math.remainder(float(angle) - 0.4, 2 * math.pi / 7) == pytest.approx(0, abs=1e-12)


def test_the_best_position_moves_as_its_derivative_says():
    rng = random_stream(1, "position")
    cross = torch.as_tensor(rng.normal(size=(2, 9)) + 1j * rng.normal(size=(2, 9))).requires_grad_()
    orders = torch.arange(1, 10) * 7
    assert torch.autograd.gradcheck(lambda lines: find_shaft_position(lines, orders), cross)


def test_lines_of_a_swinging_speed_keep_amplitude_and_phase(nominal):
    orders = nominal.orders[(nominal.orders % 7 == 0) & (nominal.orders > 0)]
    line, deviation = measure_phased_lines(recorded(nominal), orders, 7)
    with torch.no_grad():
        simulated = nominal.acceleration().numpy()[:, np.isin(nominal.orders, orders)]
    angle = float(
        find_shaft_position(
            torch.as_tensor((simulated * line.conj()).sum(axis=0)), torch.as_tensor(orders)
        )
    )
    error = np.abs(simulated * np.exp(1j * orders * angle) - line)
    assert error.max() < 0.01 * np.abs(simulated).max()
    assert np.median(deviation) < 0.01


def test_recordings_that_begin_at_other_shaft_positions_add_up(nominal):
    orders = np.array([7, 14, 21, 28])
    pairs = [
        measure_phased_lines(recorded(nominal, start, name=f"at {start}"), orders, 7)
        for start in (0.3, 1.7)
    ]
    line, deviation = average_phased_lines(pairs, orders)
    np.testing.assert_allclose(np.abs(line), np.abs(pairs[0][0]), atol=0.02)
    assert deviation.shape == line.shape


def test_phases_make_the_values_more_certain_and_find_them(nominal, true):
    method = GaussNewton(starts=2)
    calibrations = [
        calibrate(nominal, [recorded(true)], method=method, phases=phases, nuisances=Nuisances())
        for phases in (False, True)
    ]
    for name in ("C_v", "K_v", "C_Hz"):
        plain, phased = (calibration.estimate(name) for calibration in calibrations)
        assert phased.log_std < plain.log_std
        assert phased.interval[0] <= value_of(true, name) <= phased.interval[1]
    assert calibrations[1].settings["phases"] is True
    assert (
        calibrations[1].calibrated_agreement.rmse < 1.05 * calibrations[0].calibrated_agreement.rmse
    )


def value_of(twin: Twin, letter: str) -> float:
    index = ("C_sw", "K_sw", "C_v", "K_v", "C_Hz", "K_Hz").index(letter)
    return float(twin.values[index])


def test_observables_with_phases_have_exact_derivatives(nominal, true):
    objective = build_objective(
        nominal, measure(nominal, [recorded(true)], phases=True), None, Nuisances.housing()
    )
    point = objective.start
    observables, slope = objective.sensitivity(point)
    assert observables.shape == objective.measured.shape == objective.sigma.shape
    for index in (2, 7, len(point) - 1):
        step = torch.zeros_like(point)
        step[index] = 1e-6
        with torch.no_grad():
            difference = (
                objective.observables(point + step) - objective.observables(point - step)
            ) / 2e-6
        np.testing.assert_allclose(
            slope[:, index], difference, atol=1e-5 * float(slope[:, index].abs().max())
        )


def test_a_recording_without_a_clear_line_has_no_phases(nominal):
    noise = replace(recorded(nominal), signal=random_stream(0, "noise").standard_normal((3, 25600)))
    with pytest.raises(DataError, match="stands clear"):
        measure_phased_lines(noise, np.array([7, 14]), 7)
