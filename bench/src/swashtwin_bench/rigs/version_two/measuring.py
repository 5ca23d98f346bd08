"""How version 2 turns a specimen under a condition into samples of its three accelerometers."""

import math
from collections.abc import Sequence

import numpy as np
import scipy.signal
import torch
from jaxtyping import Complex, Float

from swashtwin.foundation import stream
from swashtwin.physics import (
    HarmonicBalance,
    LoadCase,
    assemble,
    excitation_lines,
    fault_forces,
    force_lines,
    periodic_steady_state,
    worn_values,
)
from swashtwin.pump import BoreDefect, InterfaceValue, OperatingCondition
from swashtwin.signals import fourier_lines, inverse_transform, line_frequencies, periodic_signal, synchronous_signal
from swashtwin_bench.rigs.fleet import film_factors
from swashtwin_bench.rigs.measuring import (
    BANDWIDTH,
    CONVERTER_STEP,
    TOPOLOGY,
    Run,
    shaft_angle,
    slipper_terms,
    with_steps,
)
from swashtwin_bench.rigs.version_two.fleet import SecondSpecimen
from swashtwin_bench.rigs.version_two.sounds import (
    bursts,
    flow_noise,
    gear_orders,
    sensor_response,
    stand_noise,
)


def true_values(run: Run, specimen: SecondSpecimen) -> Float[np.ndarray, " 6"]:
    """The six interface values in a run: as assembled, at this oil temperature and pressure."""
    oil, condition = specimen.pump.oil, run.condition
    viscosity = oil.viscosity_at(condition.oil_temperature) / oil.viscosity
    return specimen.values * film_factors(condition.discharge_pressure, viscosity**specimen.film_exponent)


def bore_force(
    run: Run, defect: BoreDefect, values: Float[np.ndarray, " 6"], motion: Complex[np.ndarray, " line"]
) -> Complex[np.ndarray, " line"]:
    """Lines [N] of the side force that a piston misses over a defect of its bush.

    One-sided: where the film would have to pull, the piston hangs free and its whole side load is missing.

    Parameters
    ----------
    motion : displacement lines of the defect [m], from order 0, without its mean.
    """
    group, condition = run.specimen.pump.rotating_group, run.condition
    steps = 4 * len(motion)
    share = run.specimen.pump.coupling.lateral_ratio / group.piston_count
    stiffness, damping = values[InterfaceValue.PISTON_BORE_STIFFNESS], values[InterfaceValue.PISTON_BORE_DAMPING]
    mean = 2 * defect.half_width / math.pi**2 * defect.depth
    motion = np.concatenate([[mean], motion[1:]])
    film = share * (stiffness + 1j * condition.speed * damping * np.arange(len(motion))) * motion
    phi = 2 * np.pi * (np.arange(steps) / steps + defect.bore / group.piston_count)
    pressure = condition.discharge_pressure - condition.case_pressure
    pressed = np.maximum((1 - np.tanh(np.sin(phi) / 0.12)) / 2, 0.02)
    side_load = group.piston_area * pressure * math.tan(group.swash_angle) * pressed
    return -fourier_lines(np.minimum(periodic_signal(film, steps), side_load))[: len(motion)]


def shell_lines(
    run: Run, specimen: SecondSpecimen, pressure: Complex[np.ndarray, "order 13"]
) -> Complex[np.ndarray, "sensor line"]:
    """Acceleration lines [m/s^2], orders 1..., of the rigid shell where the sensors sit."""
    pump, condition, fault = specimen.pump, run.condition, run.fault
    structure = assemble(pump, TOPOLOGY)
    values = worn_values(pump, fault, torch.as_tensor(true_values(run, specimen)))
    n_lines = pressure.shape[0] - 1
    frequency = np.arange(n_lines + 1) * condition.speed
    motion = excitation_lines(pump, condition, fault, n_lines)
    if isinstance(fault, BoreDefect):
        lateral = torch.as_tensor(bore_force(run, fault, values.numpy(), motion))
        force = lateral[:, None] * structure.lateral_vector
    else:
        force = fault_forces(pump, structure, TOPOLOGY, fault, values, frequency, motion)
    force = (force + torch.as_tensor(pressure)) * torch.as_tensor(np.arange(n_lines + 1) > 0)[:, None]
    lines = periodic_steady_state(
        HarmonicBalance(),
        structure.mass,
        structure.damping(values),
        structure.stiffness(values, parts=torch.as_tensor(specimen.supports)),
        condition.speed,
        force,
        slipper_terms(run, structure, values),
        tolerance=1e-4,
    )
    return np.asarray(-(frequency[1:] ** 2) * (structure.sensor_rows.numpy() @ lines.numpy()[1:].T))


def measure(
    runs: Sequence[Run], duration: float, sample_rate: float, seeds: Sequence[tuple[int, str]]
) -> list[Float[np.ndarray, "sensor time"]]:
    """Readings [m/s^2] of each run; parameters as of version 1."""
    signals = []
    for run, (seed, name) in zip(runs, seeds, strict=True):
        specimen = run.specimen
        if not isinstance(specimen, SecondSpecimen):
            raise TypeError(f"{specimen.name} is no pump of version 2 of the rig.")
        signals.append(_samples(run, specimen, duration, sample_rate, _random_numbers(seed, name)))
    return signals


def recorded_angle(run: Run, duration: float, sample_rate: float, seed: int, name: str) -> Float[np.ndarray, " time"]:
    """Shaft angle [rad] at the samples of recording `name`; parameters as of version 1."""
    return _drifting_angle(run.condition, duration, sample_rate, _random_numbers(seed, name))


def _random_numbers(seed: int, name: str) -> np.random.Generator:
    """Random numbers of one recording, the shaft's angle first."""
    return stream(seed, "reading of version 2", name)


def _drifting_angle(
    condition: OperatingCondition, duration: float, sample_rate: float, rng: np.random.Generator
) -> Float[np.ndarray, " time"]:
    n = round(duration * sample_rate)
    angle, time = shaft_angle(condition, n, sample_rate, rng), np.arange(n) / sample_rate
    return angle + condition.speed * rng.uniform(-0.004, 0.004) * time**2 / (2 * duration)


def _samples(
    run: Run, specimen: SecondSpecimen, duration: float, sample_rate: float, rng: np.random.Generator
) -> Float[np.ndarray, "sensor time"]:
    n, condition = round(duration * sample_rate), run.condition
    time = np.arange(n) / sample_rate
    case = LoadCase(specimen.pump, condition, run.fault, specimen.clearances)
    n_lines = int(BANDWIDTH / condition.shaft_frequency)
    pressure = with_steps(lambda steps: force_lines([case], n_lines, topology=TOPOLOGY, steps=steps)[0])
    lines = shell_lines(run, specimen, pressure)
    orders = np.arange(1, lines.shape[1] + 1)
    lines = lines * specimen.housing.response(orders * condition.shaft_frequency)
    lines[:, np.array(gear_orders(specimen)) - 1] += specimen.stand.gear * condition.discharge_pressure / 10e6
    lines = lines * sensor_response(specimen, orders * condition.shaft_frequency)
    angle = _drifting_angle(condition, duration, sample_rate, rng)
    drift = 1 + rng.uniform(-0.05, 0.05) * (time / duration - 0.5)
    drift = drift + 0.03 * np.sin(2 * np.pi * (rng.uniform(0.1, 0.6) * time + rng.random()))
    sound = flow_noise(run, specimen, angle, sample_rate, rng) + bursts(run, specimen, angle, sample_rate, rng)
    sound = sound * sensor_response(specimen, line_frequencies(n, sample_rate))
    signal = synchronous_signal(lines, orders, angle) * drift + inverse_transform(sound, n)
    signal = specimen.housing.gain @ (signal + stand_noise(run, specimen, angle, sample_rate, rng))
    signal = signal + 0.025 * rng.standard_normal(signal.shape)
    filtered = scipy.signal.sosfilt(scipy.signal.butter(4, 0.8, output="sos"), signal, axis=-1)
    return (np.round(filtered / CONVERTER_STEP) * CONVERTER_STEP).astype(np.float32).astype(np.float64)
