"""Sounds that version 2 adds to the lines of the pump: impacts, flow noise and the test stand.

Impacts come at shaft angles, with jitter and varying strength, and make the housing ring. Flow
noise swells when chambers meet the ports and when a fault leaks. Motor, gear and bearings of the
stand do not depend on the pump's fault.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from swashtwin.foundation import deg, rpm, um
from swashtwin.pump import BoreDefect, DamScratch, GrooveErosion, PistonWear, SwashPlateDefect
from swashtwin.signals import line_frequencies, transform
from swashtwin_bench.rigs.measuring import Run
from swashtwin_bench.rigs.version_two.fleet import (
    RECESS_DEPTH,
    SENSOR_RESONANCE,
    SOURCES,
    SecondSpecimen,
)

JITTER = deg(1.2)
"""Standard deviation [rad] of the angle at which an impact comes."""

IRREGULARITY = 0.5
"""Standard deviation of ln(strength) from one impact to the next."""

PULSE = 1.5e-4
"""Duration [s] of an impact, which excites little above the inverse of it."""

FLOW_NOISE = 0.25
"""Standard deviation [m/s^2] of the flow noise at 10 MPa before the housing colors it."""

SPEED = rpm(860)
"""Reference speed [rad/s] of the strengths and of the flow noise."""

SUCTION = deg(10)
"""Shaft angle [rad] at which a chamber meets the suction port."""

DISCHARGE = deg(194)
"""Shaft angle [rad] at which a chamber meets the discharge port."""

ANGLE_STEPS = 2048
"""Steps per revolution of the flow noise's loudness."""

TYPICAL_CLEARANCE = um(60)
"""Extra clearance of a worn piston at the typical severity [m]."""

TYPICAL_BUSH_DEPTH = um(270)
"""Depth of a defect of a bush at the typical severity [m]."""

TYPICAL_ADVANCE = deg(5)
"""Advance of an eroded groove at the typical severity [rad]."""

TYPICAL_SCRATCH = 0.8e-6
"""Area of a scratched dam at the typical severity [m^2]."""


@dataclass(frozen=True, eq=False)
class Impacts:
    """Impacts of one source in a revolution."""

    source: int
    """Index in `SOURCES`."""
    angle: Float[np.ndarray, " impact"]
    """Shaft angles of piston 0 [rad]."""
    strength: Float[np.ndarray, " impact"]
    """Speed [m/s] that each gives to the housing."""


def piston_wear(run: Run) -> Float[np.ndarray, " piston"]:
    """Return the severity of piston wear over the typical one, by piston."""
    wear = np.zeros(run.specimen.pump.rotating_group.piston_count)
    if isinstance(run.fault, PistonWear):
        wear[run.fault.piston] = run.fault.clearance / TYPICAL_CLEARANCE

    return wear


def list_impacts(run: Run, specimen: SecondSpecimen) -> list[Impacts]:
    """Return all impacts of a revolution."""
    fault = run.fault
    piston_count = run.specimen.pump.rotating_group.piston_count
    piston_angle = 2 * math.pi * np.arange(piston_count) / piston_count
    load = (run.condition.discharge_pressure / 10e6) ** 0.7
    strengths = specimen.strengths * load

    # Erosion lets a chamber meet the port at a larger pressure difference; a scratch across the
    # dam equalizes the pressure early.
    port_factor = np.ones(piston_count)
    if isinstance(fault, GrooveErosion):
        port_factor *= 1 + 0.35 * fault.advance / TYPICAL_ADVANCE
    if isinstance(fault, DamScratch):
        port_factor /= 1 + 0.35 * fault.area / TYPICAL_SCRATCH

    slap_factor = 1 + 4 * piston_wear(run)
    impacts = [
        Impacts(0, DISCHARGE - piston_angle, strengths[0] * port_factor),
        Impacts(0, SUCTION - piston_angle, 0.6 * strengths[0] * port_factor),
        Impacts(1, DISCHARGE + deg(9) - piston_angle, strengths[1] * slap_factor),
    ]

    # Pistons and slippers strike the edge by which they leave a defect.
    if isinstance(fault, BoreDefect):
        exit_angle = fault.angle + fault.half_width - piston_angle[[fault.bore]]
        strength = strengths[2, [fault.bore]] * fault.depth / TYPICAL_BUSH_DEPTH
        impacts.append(Impacts(2, exit_angle, strength))

    if isinstance(fault, SwashPlateDefect):
        half_width = fault.length / (2 * specimen.pump.rotating_group.pitch_radius)
        strength = strengths[3] * (fault.depth / RECESS_DEPTH) * run.condition.speed / SPEED
        impacts.append(Impacts(3, fault.angle + half_width - piston_angle, strength))

    return impacts


def bursts(
    run: Run,
    specimen: SecondSpecimen,
    angle: Float[np.ndarray, " time"],
    sample_rate: float,
    rng: np.random.Generator,
) -> Complex[np.ndarray, "sensor frequency"]:
    """Return the transform of the sensors' readings [m/s^2] of all impacts.

    Parameters
    ----------
    angle : shaft angle [rad] of each sample.
    """
    trains = _draw_impact_trains(run, specimen, angle, sample_rate, rng)
    frequency = line_frequencies(len(angle), sample_rate)

    # Each impact makes the housing ring in its modes; a pulse excites little above its inverse.
    ratio = frequency[:, None] / specimen.housing.frequency
    modes = ratio**2 / (1 - ratio**2 + 2j * specimen.housing.damping_ratio * ratio)
    modes *= np.exp(-((frequency * PULSE) ** 2))[:, None]

    active = np.flatnonzero(trains.any(axis=1))
    ringing = np.zeros((3, len(frequency)), dtype=complex)
    for source, spectrum in zip(active, transform(trains[active]), strict=True):
        ringing += specimen.mode_shares[source] @ modes.T * spectrum

    return ringing


def _draw_impact_trains(
    run: Run,
    specimen: SecondSpecimen,
    angle: Float[np.ndarray, " time"],
    sample_rate: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "source time"]:
    """Return the impacts of each source as accelerations [m/s^2] along a shaft `angle` [rad]."""
    n = len(angle)
    sample = np.arange(n)
    trains = np.zeros((len(SOURCES), n))

    # One more turn at either end, since angles of impacts may be negative and jitter.
    first_turn = math.floor(angle[0] / (2 * np.pi)) - 1
    end_turn = math.ceil(angle[-1] / (2 * np.pi)) + 1
    turns = np.arange(first_turn, end_turn)

    for impacts in list_impacts(run, specimen):
        shape = (len(turns), len(impacts.angle))
        impact_angle = 2 * np.pi * turns[:, None] + impacts.angle + rng.normal(0, JITTER, shape)
        speed = impacts.strength * np.exp(rng.normal(0, IRREGULARITY, shape))
        is_inside = (impact_angle > angle[0]) & (impact_angle < angle[-1])
        speed = speed[is_inside]

        # An impact falls between two samples, which share it by their distance.
        position = np.interp(impact_angle[is_inside], angle, sample)
        left = np.minimum(position.astype(int), n - 2)
        right_share = position - left
        train = trains[impacts.source]
        np.add.at(train, left, (1 - right_share) * speed * sample_rate)
        np.add.at(train, left + 1, right_share * speed * sample_rate)

    return trains


def loudness(run: Run, specimen: SecondSpecimen) -> Float[np.ndarray, " step"]:
    """Return the power of the flow noise at `ANGLE_STEPS` shaft angles of a revolution.

    It is relative to the mean in a healthy pump.
    """
    fault = run.fault
    piston_count = run.specimen.pump.rotating_group.piston_count
    shaft = 2 * np.pi * np.arange(ANGLE_STEPS) / ANGLE_STEPS
    piston = np.arange(piston_count)[:, None]
    phi = np.mod(shaft + 2 * np.pi * piston / piston_count, 2 * np.pi)

    # Jets at the ports and at defects that a chamber passes.
    jets = _bell(phi, DISCHARGE, deg(8)) + 0.7 * _bell(phi, SUCTION, deg(8))
    if isinstance(fault, DamScratch):
        jets = jets + 0.8 * fault.area / TYPICAL_SCRATCH * _bell(phi, np.pi, fault.width)
    if isinstance(fault, GrooveErosion):
        early_discharge = _bell(phi, DISCHARGE - fault.advance, deg(5))
        early_suction = _bell(phi, SUCTION - fault.advance, deg(5))
        severity = fault.advance / TYPICAL_ADVANCE
        jets = jets + 0.6 * severity * (early_discharge + early_suction)
    if isinstance(fault, SwashPlateDefect):
        half_width = fault.length / (2 * specimen.pump.rotating_group.pitch_radius)
        severity = min(3.0, fault.depth / RECESS_DEPTH)
        jets = jets + 0.8 * severity * _bell(phi, fault.angle, half_width / 2)

    # Leakage along pistons under pressure and through a damaged bush.
    pressed = (1 - np.tanh(np.sin(phi) / 0.12)) / 2
    leakage = 1.3 * piston_wear(run)[:, None] * pressed
    if isinstance(fault, BoreDefect):
        strength = 0.8 * (piston == fault.bore) * fault.depth / TYPICAL_BUSH_DEPTH
        leakage = leakage + strength * _bell(phi, fault.angle, fault.half_width / 2)

    return np.asarray(1 + specimen.jets @ jets + leakage.sum(axis=0))


def _bell(
    phi: Float[np.ndarray, "piston step"], center: float, width: float
) -> Float[np.ndarray, "piston step"]:
    """Return a Gaussian of standard deviation `width` around a `center`, on the circle [rad]."""
    distance = np.mod(phi - center + np.pi, 2 * np.pi) - np.pi
    return np.exp(-0.5 * (distance / width) ** 2)


def flow_noise(
    run: Run,
    specimen: SecondSpecimen,
    angle: Float[np.ndarray, " time"],
    sample_rate: float,
    rng: np.random.Generator,
) -> Complex[np.ndarray, "sensor frequency"]:
    """Return the transform of the flow noise [m/s^2] at each sensor.

    The resonance of the sensor on its mounting is not included.
    """
    frequency = line_frequencies(len(angle), sample_rate)

    step = (np.mod(angle, 2 * np.pi) * (ANGLE_STEPS / (2 * np.pi))).astype(int) % ANGLE_STEPS
    amplitude = np.sqrt(loudness(run, specimen))[step]
    color = (1 + 300 / np.maximum(frequency, 30)) / (1 + (frequency / 3500) ** 2)
    color = np.sqrt(color) * np.abs(specimen.housing.response(frequency))

    relative_power = run.condition.discharge_pressure / 10e6 * run.condition.speed / SPEED
    scale = FLOW_NOISE * math.sqrt(relative_power)
    white = rng.standard_normal((3, len(angle)))

    return np.asarray(transform(white * amplitude) * color * scale)


def sensor_response(
    specimen: SecondSpecimen, frequency: Float[np.ndarray, " line"]
) -> Complex[np.ndarray, " line"]:
    """Return the reading of a sensor over the motion of its position, at `frequency` [Hz]."""
    resonance, damping = SENSOR_RESONANCE[specimen.sensors]
    ratio = frequency / resonance

    return 1 / (1 - ratio**2 + 2j * damping * ratio)


def gear_orders(specimen: SecondSpecimen) -> list[int]:
    """Return the orders of the mesh, its sidebands of one turn, and its second harmonic."""
    teeth = specimen.stand.teeth
    return [teeth - 1, teeth, teeth + 1, 2 * teeth]


def stand_noise(
    run: Run,
    specimen: SecondSpecimen,
    angle: Float[np.ndarray, " time"],
    sample_rate: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "sensor time"]:
    """Return the lines [m/s^2] of motor and bearings, which are not at orders of the shaft.

    The motor has three pole pairs and drives the pump through a gear. The balls of the bearings
    slide a little.
    """
    stand = specimen.stand
    time = np.arange(len(angle)) / sample_rate
    load = run.condition.discharge_pressure / 10e6
    noise = np.zeros((3, len(angle)))

    motor_order = stand.teeth / stand.wheel_teeth
    supply = 3 * motor_order * run.condition.shaft_frequency * (1 + stand.slip * load)
    for amplitude, harmonic in zip(stand.motor.T[:3], (2, 6, 12), strict=True):
        phase = 2 * np.pi * (harmonic * supply * time + rng.random())
        noise += amplitude[:, None] * np.sin(phase)
    noise += stand.motor[:, 3:] * load * np.sin(motor_order * angle + 2 * np.pi * rng.random())

    slide = np.cumsum(rng.normal(0, 0.01, len(angle)))
    for amplitude, order in zip(stand.bearing.T, stand.bearing_orders, strict=True):
        phase = order * angle + slide + 2 * np.pi * rng.random()
        noise += amplitude[:, None] * np.sin(phase)

    return noise
