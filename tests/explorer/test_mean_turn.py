"""The mean turn of a recording, and the shaft angle at which it is most like a twin's turn."""

import numpy as np
import pytest
import torch

from swashtwin.explorer.mean_turn import align_turn, average_turns
from swashtwin.foundation import DataError
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, PistonWear, Pump
from swashtwin.recordings import Recording
from swashtwin.signals import synchronous_signal

RATE = 12_800.0


@pytest.fixture(scope="module")
def worn(pump: Pump, at_15: OperatingCondition) -> tuple[Twin, np.ndarray]:
    """A twin one of whose pistons differs, and its lines."""
    twin = Twin(pump, at_15, PistonWear(clearance=6e-5), bandwidth=1500.0)
    with torch.no_grad():
        return twin, twin.acceleration().numpy()


def record(twin: Twin, lines: np.ndarray, turns: float, start: float, noise: float) -> Recording:
    """A recording of a twin whose shaft starts at an angle [rad] and wanders by 0.3 %."""
    shaft = twin.condition.shaft_frequency
    time = np.arange(int(turns / shaft * RATE)) / RATE
    wander = 0.003 * np.sin(2 * np.pi * 0.7 * time) / 0.7
    signal = synchronous_signal(lines, twin.orders, start + 2 * np.pi * shaft * time + wander)
    random = np.random.default_rng(0)
    signal = signal + noise * signal.std() * random.normal(size=signal.shape)
    return Recording(signal, RATE, "worn", twin.pump.channels, condition=twin.condition)


@pytest.mark.parametrize("start", [0.0, 2.0, 5.5])
def test_a_turn_is_found_at_the_angle_of_the_twin_wherever_the_shaft_started(
    worn: tuple[Twin, np.ndarray], start: float
) -> None:
    twin, lines = worn
    recording = record(twin, lines, turns=30.3, start=start, noise=0.5)

    mean_turn = average_turns(recording, 7, int(twin.orders.max()))
    aligned = align_turn(mean_turn, twin, lines)

    assert mean_turn.n_turns in (29, 30)
    angle = np.linspace(0, 2 * np.pi, aligned.waveform.shape[1], endpoint=False)
    waveform = synchronous_signal(lines, twin.orders, angle)
    # noise of half the signal, averaged over 30 turns: a tenth
    assert np.std(aligned.waveform - waveform) < 0.15 * np.std(waveform)
    assert aligned.correlation > 0.98


def test_a_recording_without_clear_piston_lines_has_no_mean_turn(
    worn: tuple[Twin, np.ndarray],
) -> None:
    twin, lines = worn
    with pytest.raises(DataError):
        average_turns(record(twin, lines, turns=30, start=0, noise=100.0), 7, 100)
