"""Virtual pumps of one design, drawn before any pump was measured, and what faults change in their recordings.

A twin's levels are off by the housing, the sensors and the mounting, which nobody knows well; what a fault *changes*
against the healthy recordings of the same pump is not. So every virtual pump has healthy recordings of its own, each
another assembly at another oil temperature, and a fault is described by the changes of its levels against these.

The widths are estimates of ours of how far pumps of one drawing differ. Viscosity acts on leakages and on the films'
damping, a slipper follows a recess less the faster it is (a low pass of first order in power), and clearances, port
timing and unbalance have tolerances.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float, Int, Shaped
from joblib import delayed

from swashtwin.foundation import InputError, MPa, SwashTwinError, celsius, deg, mm, parallel, rpm, stream, um
from swashtwin.physics import (
    HarmonicBalance,
    LoadCase,
    SensorPath,
    assemble,
    excitation_lines,
    fault_forces,
    force_lines,
    worn_values,
)
from swashtwin.pump import (
    CLASSES,
    BoreDefect,
    DamScratch,
    Fault,
    GrooveErosion,
    OperatingCondition,
    PistonWear,
    Pump,
    SwashPlateDefect,
    load_pump,
)
from swashtwin.signals import OrderBands

_SWING = 0.004
"""Half-width of the speed's variation within a recording, relative."""
_REFERENCES = 3
"""Healthy recordings of a virtual pump, of which one to all are its reference."""
_HEALTHY = 2
"""Further healthy recordings that are compared with these."""
_AVERAGES = 16
"""Independent values in the noise's power of a band one order wide; a recording of 4 s has about as many."""


@dataclass(frozen=True)
class PumpPrior:
    """What is taken for granted of pumps of one drawing; a standard deviation of a logarithm where no unit stands."""

    pump: Pump = field(default_factory=lambda: load_pump("25scy14-1b"))
    """The drawing."""
    speed: tuple[float, float] = (rpm(750), rpm(1250))
    """Range of the speed [rad/s], uniform."""
    pressure: tuple[float, float] = (MPa(4), MPa(17))
    """Range of the discharge pressure [Pa], uniform."""
    interfaces: float = 0.7
    """Of each interface value from pump to pump: 95 % lie within a factor of four of the drawing."""
    assembly: float = 0.15
    """Of each interface value from one assembly of a pump to the next."""
    supports: float = 0.15
    """Of the stiffness of mounting and bearings, each axis and bearing on its own."""
    clearances: float = 0.15
    """Of the pistons' clearances, relative."""
    timing: float = deg(0.7)
    """Of the angle at which a port opens [rad]."""
    unbalance: float = 0.5
    """Of the rotor's eccentricity."""
    temperature: tuple[float, float] = (celsius(30), celsius(60))
    """Range of the oil temperature [K], uniform, drawn for each recording."""
    viscosity: tuple[float, float] = (0.4, 1.0)
    """Range of the power with which the films' damping follows the viscosity."""
    speed_setting: float = 0.004
    """Half-width of the speed around the set one, relative."""
    pressure_setting: float = 0.04
    """The same of the discharge pressure."""
    modes: int = 5
    """Modes of the housing, log-uniform in frequency."""
    mode_frequency: tuple[float, float] = (1300.0, 6000.0)
    """Range of their frequencies [Hz]."""
    mode_share: float = 0.08
    """Standard deviation of a mode's share in a sensor."""
    cross_talk: float = 0.1
    """Standard deviation of what a sensor reads of another one's direction, of a pump and again of each assembly."""
    following: tuple[float, float] = (800.0, 8000.0)
    """Range of the frequency [Hz] up to which slippers follow a recess, log-uniform."""
    noise: tuple[float, float] = (0.01, 0.6)
    """Range of the noise over the root mean square of a healthy recording, log-uniform."""

    def __post_init__(self) -> None:
        for name in ("speed", "pressure", "temperature", "mode_frequency", "following", "noise"):
            low, high = getattr(self, name)
            if not 0 < low <= high:
                raise InputError(f"the {name} of a pump prior ({low:g} to {high:g}) must rise from a positive value.")


@dataclass(frozen=True, eq=False)
class OrderChanges:
    """Changes of the levels of simulated recordings against the healthy ones of their pumps."""

    bands: OrderBands
    """Bands of the levels."""
    change: Float[np.ndarray, "recording channel band"]
    """log10 of the power in a band, less its mean over the pump's reference recordings."""
    label: Shaped[np.ndarray, " recording"]
    """Class of each recording."""
    pump: Int[np.ndarray, " recording"]
    """Number of its pump."""


def plausible_fault(label: str, rng: np.random.Generator) -> Fault | None:
    """Fault of a class with a severity log-uniform over a decade around what physics.md, section 5, calls plausible.

    The middles: recess 0.1 mm (what rejects a pump), bush 120 um, clearance 40 um, dam scratch 1 mm^2, grooves 2 deg.
    A defect is anywhere on the pressure side; a bush is felt over +-20...50 deg. Films that pull and slippers that lift
    off a recess are drawn alike, for nobody knows which law a pump follows.
    """
    factor = float(10 ** rng.uniform(-0.5, 0.5))
    angle = math.radians(rng.uniform(200, 340))
    if label == "swash_plate":
        contact: Literal["shared", "lift_off"] = "shared" if rng.random() < 0.5 else "lift_off"
        return SwashPlateDefect(depth=mm(0.1) * factor, length=mm(30), width=mm(24), angle=angle, contact=contact)
    if label == "cylinder_block":
        return BoreDefect(depth=um(120) * factor, half_width=deg(rng.uniform(20, 50)), angle=angle)
    if label == "piston":
        return PistonWear(clearance=um(40) * factor)
    if label == "valve_plate":
        return DamScratch(area=1e-6 * factor) if rng.random() < 0.5 else GrooveErosion(advance=deg(2) * factor)
    return None


def simulate_changes(
    prior: PumpPrior,
    count: int,
    *,
    bands: OrderBands | None = None,
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> OrderChanges:
    """Healthy recordings and one of each fault, of `count` virtual pumps, as changes against their references.

    Only lines of the steady state are computed, no samples: about 40 ms of a core for a pump.

    Parameters
    ----------
    bands : by default those of the drawing's number of pistons.
    seed : addresses every draw; a pump does not depend on how many are drawn with it.
    jobs : processes side by side.
    progress : called with the number of pumps that are done, and of all.

    Raises
    ------
    InputError
        No pump.
    """
    if count < 1:
        raise InputError(f"a pump prior needs a pump at least, not {count}.")
    bands = bands or OrderBands(prior.pump.rotating_group.piston_count)
    work = parallel(jobs, return_as="generator")(
        delayed(_changes_of_pump)(prior, bands, seed, number) for number in range(count)
    )
    parts = []
    for number, part in enumerate(work, 1):
        parts.append(part)
        if progress is not None:
            progress(number, count)
    labels = np.array(_TESTED)
    drawn = [number for number, part in enumerate(parts) if part is not None]
    return OrderChanges(
        bands,
        np.concatenate([part for part in parts if part is not None]),
        np.tile(labels, len(drawn)),
        np.repeat(drawn, len(labels)),
    )


_TESTED = (*("normal",) * _HEALTHY, *(label for label in CLASSES if label != "normal"))
"""Classes of the recordings of a virtual pump that are compared with its references."""


def _changes_of_pump(
    prior: PumpPrior, bands: OrderBands, seed: int, number: int
) -> Float[np.ndarray, "recording channel band"] | None:
    """Changes of one pump; None where the chamber pressures of one of its recordings do not converge."""
    torch.set_num_threads(1)
    rng = stream(seed, "pump prior", number)
    try:
        levels = _levels_of_pump(prior, bands, rng)
    except SwashTwinError:
        return None
    references = levels[: int(rng.integers(1, _REFERENCES + 1))]
    return (levels[_REFERENCES:] - references.mean(axis=0)).astype(np.float32)


def _levels_of_pump(
    prior: PumpPrior, bands: OrderBands, rng: np.random.Generator
) -> Float[np.ndarray, "recording channel band"]:
    """log10 of the power of each recording of one virtual pump: the references, then `_TESTED`."""
    pump, clearances = _draw_pump(prior, rng)
    set_speed, set_pressure = rng.uniform(*prior.speed), rng.uniform(*prior.pressure)
    values = np.array(pump.interfaces.values()) * _spread(rng, prior.interfaces, 6)
    follows = _log_uniform(rng, prior.following)
    exponent = rng.uniform(*prior.viscosity)
    orders = np.arange(1, int(bands.highest) + 1)
    structure = assemble(pump)
    frequencies, forces, worn = [], [], []
    labels = ("normal",) * _REFERENCES + _TESTED
    for label in labels:
        condition = OperatingCondition(
            speed=set_speed * (1 + prior.speed_setting * rng.uniform(-1, 1)),
            discharge_pressure=set_pressure * (1 + prior.pressure_setting * rng.uniform(-1, 1)),
            oil_temperature=rng.uniform(*prior.temperature),
        )
        fault = plausible_fault(label, rng)
        viscosity = pump.oil.viscosity_at(condition.oil_temperature) / pump.oil.viscosity
        assembled = values * _spread(rng, prior.assembly, 6)
        assembled[::2] *= viscosity**exponent
        frequency = np.arange(orders.size + 1) * condition.speed
        motion = excitation_lines(pump, condition, fault, orders.size)
        if isinstance(fault, SwashPlateDefect):
            motion = motion / (1 + (frequency / (2 * math.pi * follows)) ** 2)
        worn.append(worn_values(pump, fault, torch.as_tensor(assembled)))
        pressing = force_lines([LoadCase(pump, condition, fault, clearances)], orders.size)[0]
        straining = fault_forces(pump, structure, "T1", fault, worn[-1], frequency, motion)
        forces.append((straining + torch.as_tensor(pressing))[1:])
        frequencies.append(frequency[1:])
    supports = torch.as_tensor(_spread(rng, prior.supports, 9)).expand(len(labels), 9)
    motion_lines = HarmonicBalance().steady_state(
        structure.mass,
        structure.damping(torch.stack(worn)),
        structure.stiffness(torch.stack(worn), supports[:, 0], supports[:, 1], supports[:, 2:]),
        torch.as_tensor(np.array(frequencies)),
        torch.stack(forces),
    )
    rows = structure.sensor_rows.numpy()
    sensors = len(rows)
    path = _draw_path(prior, sensors, rng)
    shell = np.einsum("rlk,sk->rsl", motion_lines.numpy(), rows) * -(np.array(frequencies)[:, None] ** 2)
    response = path.response(torch.as_tensor(orders * set_speed / (2 * math.pi))).numpy()
    mixing = np.eye(sensors) + _cross_talk(rng, prior, sensors)
    mixing = np.stack([mixing + _cross_talk(rng, prior, sensors) for _ in labels])
    power = np.abs(mixing @ (shell * response)) ** 2 / 2
    noise = _noise(prior, orders * set_speed / (2 * math.pi), np.abs(response) ** 2, rng)
    noise *= power[:_REFERENCES].sum(axis=-1).mean()
    middle = orders.astype(np.float64)
    in_bands = bands.sums(power, middle, _SWING * middle)
    in_bands += bands.sums(noise, middle, 0.5) * _spread(rng, 0.1, (len(labels), sensors, 1))
    averages = _AVERAGES * np.maximum(bands.edges[:, 1] - bands.edges[:, 0], 0.5)
    in_bands *= np.exp(rng.normal(0, 1, in_bands.shape) * 0.3 / np.sqrt(averages))
    return np.log10(np.maximum(in_bands, 1e-30))


def _draw_pump(prior: PumpPrior, rng: np.random.Generator) -> tuple[Pump, tuple[float, ...]]:
    """One pump of the drawing with its tolerances, and the clearances of its pistons [m]."""
    nominal = prior.pump
    timing = rng.normal(0, prior.timing, 2)
    plate = replace(
        nominal.valve_plate,
        discharge_open=nominal.valve_plate.discharge_open + timing[0],
        suction_open=nominal.valve_plate.suction_open + timing[1],
    )
    eccentricity = nominal.masses.rotor_eccentricity * float(_spread(rng, prior.unbalance, 1)[0])
    pump = replace(nominal, masses=replace(nominal.masses, rotor_eccentricity=eccentricity), valve_plate=plate)
    group = nominal.rotating_group
    clearances = group.piston_clearance * np.clip(rng.normal(1, prior.clearances, group.piston_count), 0.3, None)
    return pump, tuple(clearances.tolist())


def _draw_path(prior: PumpPrior, sensors: int, rng: np.random.Generator) -> SensorPath:
    """Housing and sensors; a gain is the same in all recordings of a pump, and no change knows it."""
    return SensorPath(
        gain=(1.0,) * sensors,
        frequency=tuple(_log_uniform(rng, prior.mode_frequency) for _ in range(prior.modes)),
        damping_ratio=tuple(rng.uniform(0.015, 0.05, prior.modes).tolist()),
        residue=tuple(map(tuple, rng.normal(0, prior.mode_share, (sensors, prior.modes)).tolist())),
    )


def _noise(
    prior: PumpPrior, frequency: np.ndarray, response: Float[np.ndarray, "sensor line"], rng: np.random.Generator
) -> Float[np.ndarray, "sensor line"]:
    """Power of the noise in each order over that of a healthy recording: pink below 300 Hz, colored by the housing."""
    color = response * (1 + 300 / np.maximum(frequency, 30)) / (1 + (frequency / _log_uniform(rng, (2e3, 8e3))) ** 2)
    share = color / color.sum(axis=-1, keepdims=True) / len(response)
    return share * _log_uniform(rng, prior.noise) ** 2 * _spread(rng, 0.3, (len(response), 1))


def _cross_talk(rng: np.random.Generator, prior: PumpPrior, sensors: int) -> Float[np.ndarray, "sensor sensor"]:
    return rng.normal(0, prior.cross_talk, (sensors, sensors)) * (1 - np.eye(sensors))


def _spread(rng: np.random.Generator, deviation: float, shape: int | tuple[int, ...]) -> Float[np.ndarray, "..."]:
    """Factors with a log-normal spread around 1."""
    return np.exp(rng.normal(0, deviation, shape))


def _log_uniform(rng: np.random.Generator, limits: tuple[float, float]) -> float:
    return float(np.exp(rng.uniform(*np.log(limits))))
