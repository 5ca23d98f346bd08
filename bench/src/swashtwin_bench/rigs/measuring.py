"""Measurement in the virtual rig: from a pump at an operating point to accelerometer samples."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import scipy.signal
import torch
from jaxtyping import Complex, Float

from swashtwin.foundation import InputError, SwashTwinError, random_stream
from swashtwin.physics import (
    HarmonicBalance,
    LoadCase,
    PeriodicTerm,
    Structure,
    Topology,
    assemble,
    excitation_lines,
    fault_forces,
    periodic_steady_state,
    worn_values,
)
from swashtwin.pump import BoreDefect, Fault, InterfaceValue, OperatingCondition, SwashPlateDefect
from swashtwin.signals import (
    fourier_lines,
    inverse_transform,
    line_frequencies,
    periodic_signal,
    synchronous_signal,
    transform,
)
from swashtwin_bench.rigs.fleet import Specimen, film_factors
from swashtwin_bench.rigs.oil import force_lines, ride_lines

T = TypeVar("T")

BANDWIDTH = 6400.0
"""Highest frequency [Hz] at which the rig's pumps are excited."""

TOPOLOGY: Topology = "T1"

STEPS = (1792, 2688, 4032, 8064)
"""Candidate numbers of steps per revolution for the chamber pressures; the first that converges."""

FLOW_NOISE = 0.25
"""Standard deviation [m/s^2] of the flow noise at 10 MPa before the housing colors it."""

MAINS_FREQUENCY = 50.02
"""Frequency of the mains hum [Hz], slightly off nominal as in a real grid."""

MAINS_HARMONICS = ((1, 0.02), (2, 0.01), (3, 0.015))
"""Harmonics of the mains and their typical amplitudes [m/s^2]."""

SENSOR_NOISE = 0.02
"""Standard deviation [m/s^2] of the sensors' white noise."""

CONVERTER_STEP = 100.0 / 2**15
"""Resolution [m/s^2] of the rig's 16-bit converter, whose range is +-100 m/s^2."""


@dataclass(frozen=True, eq=False)
class Run:
    """One measurement to be taken."""

    specimen: Specimen
    """Pump that is measured."""
    condition: OperatingCondition
    """True operating point, drift included; the index file states only what was set."""
    fault: Fault | None
    """Fault of the pump, or `None` if it is healthy."""


def slipper_loading(
    piston_count: int, unloaded: float, orders: Sequence[int]
) -> Complex[np.ndarray, " order"]:
    """Return lines at shaft `orders` of the slippers' stiffness, over its mean.

    Slippers on the suction side are softer, by the factor `unloaded`.
    """
    angle = 2 * np.pi * np.arange(4096) / 4096
    phi = angle + 2 * np.pi * np.arange(piston_count)[:, None] / piston_count
    weight = np.where(np.sin(phi) < 0, 1.0, unloaded).sum(axis=0)

    return fourier_lines(weight / weight.mean())[list(orders)]


def slipper_terms(run: Run, structure: Structure, values: torch.Tensor) -> list[PeriodicTerm]:
    """Return the parts of the slippers' films that turn with the shaft.

    They arise because slippers on the suction side are softer.
    """
    piston_count = run.specimen.pump.rotating_group.piston_count
    orders = [piston_count, 3 * piston_count]
    lines = slipper_loading(piston_count, run.specimen.unloaded, orders)
    shape = structure.interface_shapes[0]

    return [
        PeriodicTerm(order, complex(line) * values[1] * shape, complex(line) * values[0] * shape)
        for order, line in zip(orders, lines, strict=True)
    ]


def true_values(run: Run) -> Float[np.ndarray, " 6"]:
    """Return the six true interface values in a run.

    They are those of the specimen as assembled, at the run's oil temperature and pressure.
    """
    oil = run.specimen.pump.oil
    viscosity = oil.viscosity_at(run.condition.oil_temperature) / oil.viscosity
    factors = film_factors(run.condition.discharge_pressure, viscosity**run.specimen.film_exponent)

    return run.specimen.values * factors


def bore_force(
    run: Run,
    defect: BoreDefect,
    values: Float[np.ndarray, " 6"],
    motion: Complex[np.ndarray, " line"],
) -> Complex[np.ndarray, " line"]:
    """Return lines [N] of the side force that a piston loses over a defect of its bush.

    The contact is one-sided: when the film would have to pull, the piston hangs free and its whole
    side load is lost.

    Parameters
    ----------
    values : interface values of the run.
    motion : displacement lines of the defect [m], from order 0, without its mean.
    """
    group = run.specimen.pump.rotating_group
    condition = run.condition
    steps = 4 * len(motion)

    # Lines carry no mean, but a one-sided contact needs the whole displacement.
    mean = 2 * defect.half_width / math.pi**2 * defect.depth
    motion = np.concatenate([[mean], motion[1:]])

    share = run.specimen.pump.coupling.lateral_ratio / group.piston_count
    stiffness = values[InterfaceValue.PISTON_BORE_STIFFNESS]
    damping = values[InterfaceValue.PISTON_BORE_DAMPING]
    film = share * (stiffness + 1j * condition.speed * damping * np.arange(len(motion))) * motion

    phi = 2 * np.pi * (np.arange(steps) / steps + defect.bore / group.piston_count)
    pressure = condition.discharge_pressure - condition.case_pressure
    pressed = np.maximum((1 - np.tanh(np.sin(phi) / 0.12)) / 2, 0.02)
    side_load = group.piston_area * pressure * math.tan(group.swash_angle) * pressed

    lost_force = np.minimum(periodic_signal(film, steps), side_load)
    return -fourier_lines(lost_force)[: len(motion)]


def shell_lines(
    run: Run, pressure: Complex[np.ndarray, "order 13"]
) -> Complex[np.ndarray, "sensor line"]:
    """Return acceleration lines [m/s^2], orders 1..., of the rigid shell at the sensors.

    Motions are about the static deflection, so order 0 carries no force.
    """
    specimen = run.specimen
    structure = assemble(specimen.pump, TOPOLOGY)
    values = worn_values(specimen.pump, run.fault, torch.as_tensor(true_values(run)))
    frequency = np.arange(pressure.shape[0]) * run.condition.speed

    has_force = torch.as_tensor(np.arange(pressure.shape[0]) > 0)[:, None]
    fault_force = _fault_lines(run, structure, values, frequency)
    if specimen.hangs_free:
        fault_force = fault_force * has_force
    force = fault_force + torch.as_tensor(pressure) * has_force

    supports = None if specimen.supports is None else torch.as_tensor(specimen.supports)
    lines = periodic_steady_state(
        HarmonicBalance(),
        structure.mass,
        structure.damping(values),
        structure.stiffness(values, specimen.mount, specimen.bearing, parts=supports),
        run.condition.speed,
        force,
        slipper_terms(run, structure, values),
        tolerance=1e-4,
    )

    rows = structure.sensor_rows.numpy()
    return -(frequency[1:] ** 2) * (rows @ lines.numpy()[1:].T)


def _fault_lines(
    run: Run, structure: Structure, values: torch.Tensor, frequency: Float[np.ndarray, " line"]
) -> torch.Tensor:
    """Return the lines of a fault's forces at angular frequencies [rad/s]."""
    specimen = run.specimen
    motion = _motion_lines(run, len(frequency) - 1)

    if isinstance(run.fault, SwashPlateDefect):
        hertz = frequency / (2 * np.pi)
        motion = motion * specimen.following / (1 + (hertz / specimen.following_cutoff) ** 2)

    if isinstance(run.fault, BoreDefect) and specimen.hangs_free:
        force = bore_force(run, run.fault, values.numpy(), motion)
        return torch.as_tensor(force)[:, None] * structure.lateral_vector

    return fault_forces(specimen.pump, structure, TOPOLOGY, run.fault, values, frequency, motion)


def _motion_lines(run: Run, n_lines: int) -> Complex[np.ndarray, " line"]:
    """Return order lines 0...`n_lines` [m] of the displacement that a fault imposes."""
    fault = run.fault
    if isinstance(fault, SwashPlateDefect) and fault.contact == "lift_off":
        return ride_lines(run.specimen.pump, run.condition, fault, n_lines)

    return excitation_lines(run.specimen.pump, run.condition, fault, n_lines)


def sensor_lines(run: Run) -> Complex[np.ndarray, "sensor line"]:
    """Return lines [m/s^2], orders 1..., of the sensors' readings without noise or drift.

    No model can know more about a run. Scores of twins are compared with these lines, and ceilings
    of studies are made of them (`studies.ceilings`); nothing else may use them.
    """
    pressure = _pressure_lines(run)
    lines = shell_lines(run, pressure)
    frequency = np.arange(1, lines.shape[1] + 1) * run.condition.shaft_frequency
    housing = run.specimen.housing

    return housing.gain @ (lines * housing.response(frequency))


def _pressure_lines(run: Run) -> Complex[np.ndarray, "order 13"]:
    """Return the lines of the pressure forces up to `BANDWIDTH`."""
    case = LoadCase(run.specimen.pump, run.condition, run.fault, run.specimen.clearances)
    n_lines = int(BANDWIDTH / run.condition.shaft_frequency)

    return force_lines(case, n_lines)


def shaft_angle(
    condition: OperatingCondition, n: int, sample_rate: float, rng: np.random.Generator
) -> Float[np.ndarray, " time"]:
    """Return the shaft angle [rad] of `n` samples.

    It starts at random, and the speed wanders by up to 0.5 % within seconds.
    """
    time = np.arange(n) / sample_rate
    angle = rng.uniform(0, 2 * np.pi) + condition.speed * time

    for rate in rng.uniform(0.2, 2.0, 3):
        swing = rng.uniform(0, 0.005 / 3)
        phase = 2 * np.pi * (rate * time + rng.random())
        angle = angle + condition.speed * swing * np.sin(phase) / (2 * np.pi * rate)

    return angle


def _random_numbers(seed: int, name: str) -> np.random.Generator:
    """Return the random numbers of one recording, whose first is the shaft's angle."""
    return random_stream(seed, "reading", name)


def solve_with_steps(solve: Callable[[int], T]) -> T:
    """Return the result of `solve` with the fewest steps per revolution that converge.

    A steep pressure may need finer steps than others.
    """
    for steps in STEPS[:-1]:
        try:
            return solve(steps)
        except InputError:
            # Wrong input does not become right with finer steps.
            raise
        except SwashTwinError:
            continue

    return solve(STEPS[-1])


def _draw_flow_noise(
    run: Run, n: int, sample_rate: float, rng: np.random.Generator
) -> Float[np.ndarray, "sensor time"]:
    """Return broadband noise of flow and cavitation, which grows with the pressure."""
    frequency = line_frequencies(n, sample_rate)
    color = np.abs(run.specimen.housing.response(frequency)) / np.sqrt(1 + (frequency / 4000) ** 2)
    color = color * np.sqrt(1 + 300 / np.maximum(frequency, 30))

    white = rng.standard_normal((len(run.specimen.pump.sensors), n))
    noise = inverse_transform(transform(white) * color, n)

    return noise * FLOW_NOISE * math.sqrt(run.condition.discharge_pressure / 10e6)


def _draw_mains_hum(
    sensors: int, n: int, sample_rate: float, rng: np.random.Generator
) -> Float[np.ndarray, "sensor time"]:
    time = np.arange(n) / sample_rate
    hum = np.zeros((sensors, n))

    for harmonic, typical in MAINS_HARMONICS:
        phase = 2 * np.pi * rng.random((sensors, 1))
        amplitude = typical * rng.uniform(0.5, 1.5, (sensors, 1))
        hum += amplitude * np.sin(2 * np.pi * MAINS_FREQUENCY * harmonic * time + phase)

    return hum


def measure(
    runs: Sequence[Run], duration: float, sample_rate: float, seeds: Sequence[tuple[int, str]]
) -> list[Float[np.ndarray, "sensor time"]]:
    """Return the readings [m/s^2] of each run.

    Parameters
    ----------
    duration : length [s].
    sample_rate : [Hz].
    seeds : seed and recording id of each run, which address its random streams.
    """
    n = round(duration * sample_rate)
    return [
        _measure_run(run, n, sample_rate, _random_numbers(seed, name))
        for run, (seed, name) in zip(runs, seeds, strict=True)
    ]


def _measure_run(
    run: Run, n: int, sample_rate: float, rng: np.random.Generator
) -> Float[np.ndarray, "sensor time"]:
    housing = run.specimen.housing
    pressure = _pressure_lines(run)
    orders = np.arange(1, len(pressure))

    # The order of the draws is part of the rig: another order gives other recordings.
    angle = shaft_angle(run.condition, n, sample_rate, rng)
    lines = shell_lines(run, pressure) * housing.response(orders * run.condition.shaft_frequency)
    signal = synchronous_signal(lines, orders, angle)

    swell_phase = rng.uniform(0.1, 0.5) * np.arange(n) / sample_rate + rng.random()
    swell = 1 + 0.02 * np.sin(2 * np.pi * swell_phase)
    signal = housing.gain @ (signal * swell + _draw_flow_noise(run, n, sample_rate, rng))

    hum = _draw_mains_hum(len(signal), n, sample_rate, rng)
    noise = SENSOR_NOISE * rng.standard_normal(signal.shape)

    return digitize(signal + hum + noise)


def digitize(signal: Float[np.ndarray, "sensor time"]) -> Float[np.ndarray, "sensor time"]:
    """Return a signal [m/s^2] after the low pass and the 16-bit converter."""
    filtered = scipy.signal.sosfilt(scipy.signal.butter(4, 0.8, output="sos"), signal, axis=-1)
    steps = np.round(filtered / CONVERTER_STEP)

    # Recordings are stored in single precision, so the samples must not hold more.
    return (steps * CONVERTER_STEP).astype(np.float32).astype(np.float64)
