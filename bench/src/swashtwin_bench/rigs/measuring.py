"""How the virtual rig turns a specimen under a condition into samples of its accelerometers."""

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
    force_lines,
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

T = TypeVar("T")

BANDWIDTH = 6400.0
"""Highest frequency [Hz] at which the rig's pumps are excited."""

TOPOLOGY: Topology = "T1"

CONVERTER_STEP = 100.0 / 2**15
"""Smallest difference [m/s^2] that the rig's 16-bit converter tells apart; its range is +-100
m/s^2.
"""


@dataclass(frozen=True, eq=False)
class Run:
    """One measurement to be taken."""

    specimen: Specimen
    """Which pump."""
    condition: OperatingCondition
    """What really held, drift included; the index file states only what was set."""
    fault: Fault | None
    """What is wrong with it."""


def slipper_loading(
    piston_count: int, unloaded: float, orders: Sequence[int]
) -> Complex[np.ndarray, " order"]:
    """Lines at shaft `orders` of the slippers' stiffness over its mean, slippers on the suction
    side being softer.
    """
    angle = 2 * np.pi * np.arange(4096) / 4096
    phi = angle + 2 * np.pi * np.arange(piston_count)[:, None] / piston_count
    weight = np.where(np.sin(phi) < 0, 1.0, unloaded).sum(axis=0)
    return fourier_lines(weight / weight.mean())[list(orders)]


def slipper_terms(run: Run, structure: Structure, values: torch.Tensor) -> list[PeriodicTerm]:
    """Parts of the slippers' films that turn with the shaft, because those on the suction side are
    softer.
    """
    count = run.specimen.pump.rotating_group.piston_count
    orders = [count, 3 * count]
    shape = structure.interface_shapes[0]
    lines = slipper_loading(count, run.specimen.unloaded, orders)
    return [
        PeriodicTerm(order, complex(line) * values[1] * shape, complex(line) * values[0] * shape)
        for order, line in zip(orders, lines, strict=True)
    ]


def true_values(run: Run) -> Float[np.ndarray, " 6"]:
    """The six interface values in a run: the specimen's as assembled, at this oil temperature and
    pressure.
    """
    oil, condition = run.specimen.pump.oil, run.condition
    viscosity = oil.viscosity_at(condition.oil_temperature) / oil.viscosity
    return run.specimen.values * film_factors(
        condition.discharge_pressure, viscosity**run.specimen.film_exponent
    )


def bore_force(
    run: Run,
    defect: BoreDefect,
    values: Float[np.ndarray, " 6"],
    motion: Complex[np.ndarray, " line"],
) -> Complex[np.ndarray, " line"]:
    """Lines [N] of the side force that a piston misses over a defect of its bush.

    One-sided: where the film would have to pull, the piston hangs free and its whole side load is
    missing.

    Parameters
    ----------
    motion : displacement lines of the defect [m], from order 0, without its mean.
    """
    group, condition = run.specimen.pump.rotating_group, run.condition
    steps = 4 * len(motion)
    share = run.specimen.pump.coupling.lateral_ratio / group.piston_count
    stiffness, damping = (
        values[InterfaceValue.PISTON_BORE_STIFFNESS],
        values[InterfaceValue.PISTON_BORE_DAMPING],
    )
    mean = 2 * defect.half_width / math.pi**2 * defect.depth
    motion = np.concatenate([[mean], motion[1:]])
    film = share * (stiffness + 1j * condition.speed * damping * np.arange(len(motion))) * motion
    phi = 2 * np.pi * (np.arange(steps) / steps + defect.bore / group.piston_count)
    pressure = condition.discharge_pressure - condition.case_pressure
    pressed = np.maximum((1 - np.tanh(np.sin(phi) / 0.12)) / 2, 0.02)
    side_load = group.piston_area * pressure * math.tan(group.swash_angle) * pressed
    return -fourier_lines(np.minimum(periodic_signal(film, steps), side_load))[: len(motion)]


def shell_lines(
    run: Run, pressure: Complex[np.ndarray, "order 13"]
) -> Complex[np.ndarray, "sensor line"]:
    """Acceleration lines [m/s^2], orders 1..., of the rigid shell where the sensors sit.

    Motions are about the static deflection, so order 0 carries no force.
    """
    specimen, condition = run.specimen, run.condition
    pump = specimen.pump
    structure = assemble(pump, TOPOLOGY)
    values = worn_values(pump, run.fault, torch.as_tensor(true_values(run)))
    n_lines = pressure.shape[0] - 1
    frequency = np.arange(n_lines + 1) * condition.speed
    motion = excitation_lines(pump, condition, run.fault, n_lines)
    if isinstance(run.fault, SwashPlateDefect):
        hertz = frequency / (2 * np.pi)
        motion = motion * specimen.following / (1 + (hertz / specimen.following_cutoff) ** 2)
    moving = torch.as_tensor(np.arange(n_lines + 1) > 0)[:, None]
    if isinstance(run.fault, BoreDefect) and specimen.hangs_free:
        force = (
            torch.as_tensor(bore_force(run, run.fault, values.numpy(), motion))[:, None]
            * structure.lateral_vector
        )
    else:
        force = fault_forces(pump, structure, TOPOLOGY, run.fault, values, frequency, motion)
    force = (force * moving if specimen.hangs_free else force) + torch.as_tensor(pressure) * moving
    parts = None if specimen.supports is None else torch.as_tensor(specimen.supports)
    lines = periodic_steady_state(
        HarmonicBalance(),
        structure.mass,
        structure.damping(values),
        structure.stiffness(values, specimen.mount, specimen.bearing, parts=parts),
        condition.speed,
        force,
        slipper_terms(run, structure, values),
        tolerance=1e-4,
    )
    rows = structure.sensor_rows.numpy()
    return -(frequency[1:] ** 2) * (rows @ lines.numpy()[1:].T)


def sensor_lines(run: Run) -> Complex[np.ndarray, "sensor line"]:
    """Lines [m/s^2], orders 1..., of what the sensors read in a run, free of noise, drift and
    converter.

    The best that any model could know of it: scores of twins are held against it, and nothing else
    may use it.
    """
    pump, condition, housing = run.specimen.pump, run.condition, run.specimen.housing
    case = LoadCase(pump, condition, run.fault, run.specimen.clearances)
    pressure = force_lines(case, int(BANDWIDTH / condition.shaft_frequency), topology=TOPOLOGY)
    lines = shell_lines(run, pressure)
    frequency = np.arange(1, lines.shape[1] + 1) * condition.shaft_frequency
    return housing.gain @ (lines * housing.response(frequency))


def shaft_angle(
    condition: OperatingCondition, n: int, sample_rate: float, rng: np.random.Generator
) -> Float[np.ndarray, " time"]:
    """Shaft angle [rad] with a random start and a speed that wanders by up to 0.5 % within
    seconds.
    """
    time = np.arange(n) / sample_rate
    angle = rng.uniform(0, 2 * np.pi) + condition.speed * time
    for rate in rng.uniform(0.2, 2.0, 3):
        swing = rng.uniform(0, 0.005 / 3)
        angle = angle + condition.speed * swing * np.sin(
            2 * np.pi * (rate * time + rng.random())
        ) / (2 * np.pi * rate)
    return angle


def _random_numbers(seed: int, name: str) -> np.random.Generator:
    """Random numbers of one recording, the shaft's angle first."""
    return random_stream(seed, "reading", name)


STEPS = (1792, 2688, 4032, 8064)
"""Steps a revolution in which chamber pressures are solved, the first that converges."""


def solve_with_steps(solve: Callable[[int], T]) -> T:
    """Result of `solve` with as many steps a revolution as it needs: a steep pressure may need
    finer ones.
    """
    for steps in STEPS[:-1]:
        try:
            return solve(steps)
        except InputError:
            raise
        except SwashTwinError:
            continue
    return solve(STEPS[-1])


def _flow_noise(
    run: Run, n: int, sample_rate: float, rng: np.random.Generator
) -> Float[np.ndarray, "sensor time"]:
    """Broadband noise of flow and cavitation, colored by the housing; grows with the pressure."""
    frequency = line_frequencies(n, sample_rate)
    color = np.abs(run.specimen.housing.response(frequency)) / np.sqrt(1 + (frequency / 4000) ** 2)
    color = color * np.sqrt(1 + 300 / np.maximum(frequency, 30))
    noise = inverse_transform(
        transform(rng.standard_normal((len(run.specimen.pump.sensors), n))) * color, n
    )
    return noise * FLOW_NOISE * math.sqrt(run.condition.discharge_pressure / 10e6)


FLOW_NOISE = 0.25
"""Standard deviation [m/s^2] of the flow noise at 10 MPa before the housing colors it."""


def _mains(
    sensors: int, n: int, sample_rate: float, rng: np.random.Generator
) -> Float[np.ndarray, "sensor time"]:
    time = np.arange(n) / sample_rate
    hum = np.zeros((sensors, n))
    for harmonic, level in ((1, 0.02), (2, 0.01), (3, 0.015)):
        phase = 2 * np.pi * rng.random((sensors, 1))
        hum += (
            level
            * rng.uniform(0.5, 1.5, (sensors, 1))
            * np.sin(2 * np.pi * 50.02 * harmonic * time + phase)
        )
    return hum


def measure(
    runs: Sequence[Run], duration: float, sample_rate: float, seeds: Sequence[tuple[int, str]]
) -> list[Float[np.ndarray, "sensor time"]]:
    """Readings [m/s^2] of each run.

    Parameters
    ----------
    duration : length [s].
    sample_rate : [Hz].
    seeds : seed and recording id of each run, which address its random streams.
    """
    signals = []
    for run, (seed, name) in zip(runs, seeds, strict=True):
        rng = _random_numbers(seed, name)
        n = round(duration * sample_rate)
        case = LoadCase(run.specimen.pump, run.condition, run.fault, run.specimen.clearances)
        pressure = force_lines(
            case, int(BANDWIDTH / run.condition.shaft_frequency), topology=TOPOLOGY
        )
        orders = np.arange(1, len(pressure))
        path = run.specimen.housing.response(orders * run.condition.shaft_frequency)
        angle = shaft_angle(run.condition, n, sample_rate, rng)
        signal = synchronous_signal(shell_lines(run, pressure) * path, orders, angle)
        swell = 1 + 0.02 * np.sin(
            2 * np.pi * (rng.uniform(0.1, 0.5) * np.arange(n) / sample_rate + rng.random())
        )
        signal = run.specimen.housing.gain @ (
            signal * swell + _flow_noise(run, n, sample_rate, rng)
        )
        signal = (
            signal
            + _mains(len(signal), n, sample_rate, rng)
            + 0.02 * rng.standard_normal(signal.shape)
        )
        signals.append(digitize(signal))
    return signals


def digitize(signal: Float[np.ndarray, "sensor time"]) -> Float[np.ndarray, "sensor time"]:
    """The signal [m/s^2] as the low pass and the 16-bit converter give it."""
    filtered = scipy.signal.sosfilt(scipy.signal.butter(4, 0.8, output="sos"), signal, axis=-1)
    return (
        (np.round(filtered / CONVERTER_STEP) * CONVERTER_STEP).astype(np.float32).astype(np.float64)
    )
