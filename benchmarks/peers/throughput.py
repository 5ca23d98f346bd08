"""Many sets of values at once, and many synthetic windows."""

import time
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from peers.measuring import seconds, settle
from peers.problem import pump_twin
from swashtwin.learning import WindowSet, cut_windows
from swashtwin.signals import add_noise
from swashtwin.synthesis import simulate_windows

WINDOW, SAMPLE_RATE = 2048, 25600.0
CORES = 2
"""The cores that the windows may use."""


def ours(count: int) -> float:
    """Time [s] of one value and gradient for each of `count` sets, as one batch in steady state."""
    settle()
    twin = pump_twin()
    spread = np.exp(np.random.default_rng(0).normal(0, 0.3, (count, 6)))
    values = torch.tensor(twin.values.numpy() * spread, requires_grad=True)

    def gradient() -> Tensor:
        return torch.autograd.grad(twin.acceleration(values).abs().square().sum(), values)[0]

    gradient()
    return seconds(gradient)


def measured_windows() -> WindowSet:
    """Windows as a machine would give them, from which synthetic ones take layout and noise."""
    twin = pump_twin()
    label = twin.label
    recordings = []
    for model in (twin, twin.with_fault(None)):
        recording = model.simulate(2.0, SAMPLE_RATE, recording_id=model.label)
        recordings.append(
            replace(recording, signal=add_noise(recording.signal, 20.0, 0), synthetic=False)
        )
    return cut_windows(recordings, length=WINDOW, classes=("normal", label))


def windows() -> float:
    """Wall time [s] of 1,000 synthetic windows, each with its own values, severity, phase and
    noise.
    """
    settle(CORES)
    like, twin = measured_windows(), pump_twin()
    simulate_windows(twin, count=2, like=like, seed=9)
    started = time.perf_counter()
    simulate_windows(twin, count=1000, like=like, seed=0)
    return time.perf_counter() - started
