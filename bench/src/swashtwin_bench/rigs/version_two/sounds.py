"""What version 2 adds to the lines of the pump: bursts of impacts, flow noise that the shaft
modulates, its stand.

Impacts come at shaft angles, each a little early or late and never twice equally strong, and let
the housing ring. Flow noise swells where chambers meet the ports and where a fault leaks. Motor,
gear and bearings go on as they do.
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
"""Duration [s] of an impact: above its inverse it excites little."""
FLOW_NOISE = 0.25
"""Standard deviation [m/s^2] of the flow noise at 10 MPa before the housing colors it."""
SPEED = rpm(860)
"""Speed [rad/s] at which levels are stated."""
SUCTION, DISCHARGE = deg(10), deg(194)
"""Shaft angles [rad] at which a chamber meets the ports."""


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
    """Severity of piston wear over the typical one, by piston."""
    wear = np.zeros(run.specimen.pump.rotating_group.piston_count)
    if isinstance(run.fault, PistonWear):
        wear[run.fault.piston] = run.fault.clearance / um(60)
    return wear


def list_impacts(run: Run, specimen: SecondSpecimen) -> list[Impacts]:
    """All impacts of a revolution."""
    fault, count = run.fault, run.specimen.pump.rotating_group.piston_count
    load = (run.condition.discharge_pressure / 10e6) ** 0.7
    turn = 2 * math.pi * np.arange(count) / count
    strengths = specimen.strengths * load
    meeting = np.ones(count)
    if isinstance(fault, GrooveErosion):
        meeting *= 1 + 0.35 * fault.advance / deg(5)
    if isinstance(fault, DamScratch):
        meeting /= 1 + 0.35 * fault.area / 0.8e-6
    impacts = [
        Impacts(0, DISCHARGE - turn, strengths[0] * meeting),
        Impacts(0, SUCTION - turn, 0.6 * strengths[0] * meeting),
        Impacts(1, DISCHARGE + deg(9) - turn, strengths[1] * (1 + 4 * piston_wear(run))),
    ]
    if isinstance(fault, BoreDefect):
        leaving = fault.angle + fault.half_width - turn[[fault.bore]]
        strength = strengths[2, [fault.bore]] * fault.depth / um(270)
        impacts.append(Impacts(2, leaving, strength))
    if isinstance(fault, SwashPlateDefect):
        half = fault.length / (2 * specimen.pump.rotating_group.pitch_radius)
        strength = strengths[3] * (fault.depth / RECESS_DEPTH) * run.condition.speed / SPEED
        impacts.append(Impacts(3, fault.angle + half - turn, strength))
    return impacts


def bursts(
    run: Run,
    specimen: SecondSpecimen,
    angle: Float[np.ndarray, " time"],
    sample_rate: float,
    rng: np.random.Generator,
) -> Complex[np.ndarray, "sensor frequency"]:
    """Transform of what the impacts along a shaft `angle` [rad] let each sensor read [m/s^2]."""
    n, time = len(angle), np.arange(len(angle))
    frequency = line_frequencies(n, sample_rate)
    trains = np.zeros((len(SOURCES), n))
    turns = np.arange(
        math.floor(angle[0] / (2 * np.pi)) - 1, math.ceil(angle[-1] / (2 * np.pi)) + 1
    )
    for impacts in list_impacts(run, specimen):
        shape = (len(turns), len(impacts.angle))
        where = 2 * np.pi * turns[:, None] + impacts.angle + rng.normal(0, JITTER, shape)
        speed = impacts.strength * np.exp(rng.normal(0, IRREGULARITY, shape))
        inside = (where > angle[0]) & (where < angle[-1])
        position = np.interp(where[inside], angle, time)
        left = np.minimum(position.astype(int), n - 2)
        for step, share in ((left, 1 - (position - left)), (left + 1, position - left)):
            np.add.at(trains[impacts.source], step, share * speed[inside] * sample_rate)
    ratio = frequency[:, None] / specimen.housing.frequency
    modes = ratio**2 / (1 - ratio**2 + 2j * specimen.housing.damping_ratio * ratio)
    modes *= np.exp(-((frequency * PULSE) ** 2))[:, None]
    active = np.flatnonzero(trains.any(axis=1))
    ringing = np.zeros((3, len(frequency)), dtype=complex)
    for source, spectrum in zip(active, transform(trains[active]), strict=True):
        ringing += specimen.mode_shares[source] @ modes.T * spectrum
    return ringing


def loudness(run: Run, specimen: SecondSpecimen) -> Float[np.ndarray, " step"]:
    """Flow noise over its mean in a healthy pump, at 2,048 shaft angles of a revolution."""
    fault, count = run.fault, run.specimen.pump.rotating_group.piston_count
    theta = 2 * np.pi * np.arange(2048) / 2048
    phi = np.mod(theta + 2 * np.pi * np.arange(count)[:, None] / count, 2 * np.pi)

    def near(middle: float, width: float) -> np.ndarray:
        return np.exp(-0.5 * ((np.mod(phi - middle + np.pi, 2 * np.pi) - np.pi) / width) ** 2)

    jets = near(DISCHARGE, deg(8)) + 0.7 * near(SUCTION, deg(8))
    if isinstance(fault, DamScratch):
        jets = jets + 0.8 * fault.area / 0.8e-6 * near(np.pi, fault.width)
    if isinstance(fault, GrooveErosion):
        early = fault.advance / deg(5)
        jets = jets + 0.6 * early * (
            near(DISCHARGE - fault.advance, deg(5)) + near(SUCTION - fault.advance, deg(5))
        )
    if isinstance(fault, SwashPlateDefect):
        half = fault.length / (2 * specimen.pump.rotating_group.pitch_radius)
        jets = jets + 0.8 * min(3.0, fault.depth / RECESS_DEPTH) * near(fault.angle, half / 2)
    pressed = (1 - np.tanh(np.sin(phi) / 0.12)) / 2
    leaking = 1.3 * piston_wear(run)[:, None] * pressed
    if isinstance(fault, BoreDefect):
        struck = np.arange(count)[:, None] == fault.bore
        leaking = leaking + 0.8 * struck * fault.depth / um(270) * near(
            fault.angle, fault.half_width / 2
        )
    return np.asarray(1 + specimen.jets @ jets + leaking.sum(axis=0))


def flow_noise(
    run: Run,
    specimen: SecondSpecimen,
    angle: Float[np.ndarray, " time"],
    sample_rate: float,
    rng: np.random.Generator,
) -> Complex[np.ndarray, "sensor frequency"]:
    """Transform of the flow's noise [m/s^2] as each sensor reads it, without the sensor's own
    resonance.
    """
    frequency = line_frequencies(len(angle), sample_rate)
    step = (np.mod(angle, 2 * np.pi) * (2048 / (2 * np.pi))).astype(int) % 2048
    level = np.sqrt(loudness(run, specimen))[step]
    color = (1 + 300 / np.maximum(frequency, 30)) / (1 + (frequency / 3500) ** 2)
    color = np.sqrt(color) * np.abs(specimen.housing.response(frequency))
    load = FLOW_NOISE * math.sqrt(
        run.condition.discharge_pressure / 10e6 * run.condition.speed / SPEED
    )
    return np.asarray(transform(rng.standard_normal((3, len(angle))) * level) * color * load)


def sensor_response(
    specimen: SecondSpecimen, frequency: Float[np.ndarray, " line"]
) -> Complex[np.ndarray, " line"]:
    """What a sensor reads over what its place does, at `frequency` [Hz]."""
    resonance, damping = SENSOR_RESONANCE[specimen.sensors]
    ratio = frequency / resonance
    return 1 / (1 - ratio**2 + 2j * damping * ratio)


def gear_orders(specimen: SecondSpecimen) -> list[int]:
    """Orders of the mesh, its sidebands of one turn, and its second harmonic."""
    teeth = specimen.stand.teeth
    return [teeth - 1, teeth, teeth + 1, 2 * teeth]


def stand_noise(
    run: Run,
    specimen: SecondSpecimen,
    angle: Float[np.ndarray, " time"],
    sample_rate: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "sensor time"]:
    """Lines [m/s^2] of motor and bearings, which do not turn with the pump's shaft: three pairs of
    poles behind a gear, balls that slide a little.
    """
    stand, time = specimen.stand, np.arange(len(angle)) / sample_rate
    load = run.condition.discharge_pressure / 10e6
    motor_order = stand.teeth / stand.wheel_teeth
    supply = 3 * motor_order * run.condition.shaft_frequency * (1 + stand.slip * load)
    noise = np.zeros((3, len(angle)))
    for amplitude, harmonic in zip(stand.motor.T[:3], (2, 6, 12), strict=True):
        noise += amplitude[:, None] * np.sin(2 * np.pi * (harmonic * supply * time + rng.random()))
    noise += stand.motor[:, 3:] * load * np.sin(motor_order * angle + 2 * np.pi * rng.random())
    wander = np.cumsum(rng.normal(0, 0.01, len(angle)))
    for amplitude, order in zip(stand.bearing.T, stand.bearing_orders, strict=True):
        noise += amplitude[:, None] * np.sin(order * angle + wander + 2 * np.pi * rng.random())
    return noise
