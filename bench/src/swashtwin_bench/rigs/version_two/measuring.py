"""How version 2 turns a specimen under a condition into samples of its three accelerometers."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import random_stream
from swashtwin.physics import LoadCase, force_lines
from swashtwin.pump import OperatingCondition
from swashtwin.signals import inverse_transform, line_frequencies, synchronous_signal
from swashtwin_bench.rigs.measuring import (
    BANDWIDTH,
    TOPOLOGY,
    Run,
    digitize,
    shaft_angle,
    shell_lines,
    solve_with_steps,
)
from swashtwin_bench.rigs.version_two.fleet import SecondSpecimen
from swashtwin_bench.rigs.version_two.sounds import (
    bursts,
    flow_noise,
    gear_orders,
    sensor_response,
    stand_noise,
)


def measure(
    runs: Sequence[Run], duration: float, sample_rate: float, seeds: Sequence[tuple[int, str]]
) -> list[Float[np.ndarray, "sensor time"]]:
    """Readings [m/s^2] of each run; parameters as of version 1."""
    signals = []
    for run, (seed, name) in zip(runs, seeds, strict=True):
        specimen = run.specimen
        assert isinstance(specimen, SecondSpecimen)
        signals.append(_samples(run, specimen, duration, sample_rate, _random_numbers(seed, name)))
    return signals


def _random_numbers(seed: int, name: str) -> np.random.Generator:
    """Random numbers of one recording, the shaft's angle first."""
    return random_stream(seed, "reading of version 2", name)


def _drifting_angle(
    condition: OperatingCondition, duration: float, sample_rate: float, rng: np.random.Generator
) -> Float[np.ndarray, " time"]:
    n = round(duration * sample_rate)
    angle, time = shaft_angle(condition, n, sample_rate, rng), np.arange(n) / sample_rate
    return angle + condition.speed * rng.uniform(-0.004, 0.004) * time**2 / (2 * duration)


def _samples(
    run: Run,
    specimen: SecondSpecimen,
    duration: float,
    sample_rate: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "sensor time"]:
    n, condition = round(duration * sample_rate), run.condition
    time = np.arange(n) / sample_rate
    case = LoadCase(specimen.pump, condition, run.fault, specimen.clearances)
    n_lines = int(BANDWIDTH / condition.shaft_frequency)
    pressure = solve_with_steps(
        lambda steps: force_lines(case, n_lines, topology=TOPOLOGY, steps=steps)
    )
    lines = shell_lines(run, pressure)
    orders = np.arange(1, lines.shape[1] + 1)
    lines = lines * specimen.housing.response(orders * condition.shaft_frequency)
    lines[:, np.array(gear_orders(specimen)) - 1] += (
        specimen.stand.gear * condition.discharge_pressure / 10e6
    )
    lines = lines * sensor_response(specimen, orders * condition.shaft_frequency)
    angle = _drifting_angle(condition, duration, sample_rate, rng)
    drift = 1 + rng.uniform(-0.05, 0.05) * (time / duration - 0.5)
    drift = drift + 0.03 * np.sin(2 * np.pi * (rng.uniform(0.1, 0.6) * time + rng.random()))
    sound = flow_noise(run, specimen, angle, sample_rate, rng) + bursts(
        run, specimen, angle, sample_rate, rng
    )
    sound = sound * sensor_response(specimen, line_frequencies(n, sample_rate))
    signal = synchronous_signal(lines, orders, angle) * drift + inverse_transform(sound, n)
    signal = specimen.housing.gain @ (signal + stand_noise(run, specimen, angle, sample_rate, rng))
    signal = signal + 0.025 * rng.standard_normal(signal.shape)
    return digitize(signal)
