"""Measurement in version 2: from a pump at an operating point to samples of its sensors."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import random_stream
from swashtwin.physics import LoadCase
from swashtwin.pump import OperatingCondition
from swashtwin.signals import inverse_transform, line_frequencies, synchronous_signal
from swashtwin_bench.rigs.measuring import (
    BANDWIDTH,
    Run,
    digitize,
    shaft_angle,
    shell_lines,
    solve_with_steps,
)
from swashtwin_bench.rigs.oil import force_lines
from swashtwin_bench.rigs.version_two.fleet import SecondSpecimen
from swashtwin_bench.rigs.version_two.sounds import (
    bursts,
    flow_noise,
    gear_orders,
    sensor_response,
    stand_noise,
)

SENSOR_NOISE = 0.025
"""Standard deviation [m/s^2] of the sensors' white noise."""


def measure(
    runs: Sequence[Run], duration: float, sample_rate: float, seeds: Sequence[tuple[int, str]]
) -> list[Float[np.ndarray, "sensor time"]]:
    """Return the readings [m/s^2] of each run; parameters as in version 1."""
    signals = []
    for run, (seed, name) in zip(runs, seeds, strict=True):
        specimen = run.specimen
        assert isinstance(specimen, SecondSpecimen)
        rng = _random_numbers(seed, name)
        signals.append(_measure_run(run, specimen, duration, sample_rate, rng))

    return signals


def _random_numbers(seed: int, name: str) -> np.random.Generator:
    """Return the random numbers of one recording, whose first is the shaft's angle."""
    return random_stream(seed, "reading of version 2", name)


def _drifting_angle(
    condition: OperatingCondition, duration: float, sample_rate: float, rng: np.random.Generator
) -> Float[np.ndarray, " time"]:
    """Return a shaft angle [rad] whose speed also drifts by up to 0.4 % over the recording."""
    n = round(duration * sample_rate)
    time = np.arange(n) / sample_rate
    angle = shaft_angle(condition, n, sample_rate, rng)

    return angle + condition.speed * rng.uniform(-0.004, 0.004) * time**2 / (2 * duration)


def _measure_run(
    run: Run,
    specimen: SecondSpecimen,
    duration: float,
    sample_rate: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "sensor time"]:
    condition = run.condition
    n = round(duration * sample_rate)
    time = np.arange(n) / sample_rate

    # Lines of the pump and the gear, as the sensors on their mountings read them.
    case = LoadCase(specimen.pump, condition, run.fault, specimen.clearances)
    n_lines = int(BANDWIDTH / condition.shaft_frequency)
    pressure = solve_with_steps(lambda steps: force_lines(case, n_lines, steps=steps))
    lines = shell_lines(run, pressure)
    orders = np.arange(1, lines.shape[1] + 1)
    lines = lines * specimen.housing.response(orders * condition.shaft_frequency)
    gear_rows = np.array(gear_orders(specimen)) - 1
    lines[:, gear_rows] += specimen.stand.gear * condition.discharge_pressure / 10e6
    lines = lines * sensor_response(specimen, orders * condition.shaft_frequency)

    # From here the order of the draws is part of the rig: another order gives other recordings.
    angle = _drifting_angle(condition, duration, sample_rate, rng)
    drift = 1 + rng.uniform(-0.05, 0.05) * (time / duration - 0.5)
    drift = drift + 0.03 * np.sin(2 * np.pi * (rng.uniform(0.1, 0.6) * time + rng.random()))

    sound = flow_noise(run, specimen, angle, sample_rate, rng)
    sound = sound + bursts(run, specimen, angle, sample_rate, rng)
    sound = sound * sensor_response(specimen, line_frequencies(n, sample_rate))
    signal = synchronous_signal(lines, orders, angle) * drift + inverse_transform(sound, n)

    # Motor and bearings do not reach the sensors through the housing's modes.
    signal = specimen.housing.gain @ (signal + stand_noise(run, specimen, angle, sample_rate, rng))
    signal = signal + SENSOR_NOISE * rng.standard_normal(signal.shape)

    return digitize(signal)
