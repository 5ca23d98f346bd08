"""How version 3 turns a pump under a condition into samples of its accelerometers.

Forces come through one-sided contacts along a shaft that turns unevenly. They drive a shell on its
mounting and the housing's flexible modes at once: what swash plate and cover do to each other
cancels on a rigid shell and stretches a flexible one (Jpn. J. Fluid Power 18(1) 60, 1987: vibration
comes through the trunnion axis). Noise and impacts that the contacts do not give go the same ways:
jets and leakage as loud as the root of the power that they lose, rubbing, a struck race (Randall
and Antoni 2011, doi:10.1016/j.ymssp.2010.07.017), the coupling's claws, collapsing bubbles.
"""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from swashtwin.foundation import celsius, deg, random_stream, um
from swashtwin.signals import inverse_transform, line_frequencies, transform
from swashtwin_bench.rigs.measuring import Run, digitize
from swashtwin_bench.rigs.version_three.fleet import PATHS, ThirdSpecimen, find_damage
from swashtwin_bench.rigs.version_three.machine import (
    TURN,
    Oil,
    along,
    contact_forces,
    near,
    solve_oil,
    viscosity,
)

FINE = 2
"""Time steps of the contacts in one reading."""
GUARD = 5120
"""Readings before those that are kept, in which what a transform wraps around dies away."""
BALANCE, SPRING, PIPE = 0.91, 420.0, 4e-4
"""Force of the valve plate over that of the pistons; the central spring's force [N]; the outlet's
area [m^2].
"""


def measure(
    runs: Sequence[Run], duration: float, sample_rate: float, seeds: Sequence[tuple[int, str]]
) -> list[Float[np.ndarray, "sensor time"]]:
    """Readings [m/s^2] of each run; parameters as of version 1."""
    signals = []
    for run, (seed, name) in zip(runs, seeds, strict=True):
        specimen = run.specimen
        assert isinstance(specimen, ThirdSpecimen)
        rng, oil, n = (
            random_stream(seed, "reading of version 3", name),
            solve_oil(run, specimen),
            round(duration * sample_rate),
        )
        n += GUARD
        angle = uneven_angle(run, FINE * n, FINE * sample_rate, rng)
        forces = (
            transform(forces_of(run, specimen, oil, angle, FINE * sample_rate))[:, : n // 2 + 1]
            / FINE
        )
        angle, frequency = angle[::FINE], line_frequencies(n, sample_rate)
        turning = frequency / specimen.design.rotor_mode
        late = 1 / (1 - turning**2 + 0.12j * turning)
        forces[4] *= late
        forces[5:7] = (
            -late * forces[2:4]
        )  # the rotor hands its bearings what the swash plate does to it
        forces += transform(sounds_of(run, specimen, oil, angle, sample_rate, rng))
        ratio = frequency / specimen.mounting[:, None]
        lines = housing_response(specimen, frequency, forces) / (1 - ratio**2 + 0.1j * ratio)
        signal = specimen.housing.gain @ inverse_transform(lines, n) + foreign_lines(
            run, specimen, angle, sample_rate, rng
        )
        signals.append(
            digitize(signal[:, GUARD:] + 0.03 * rng.standard_normal((len(signal), n - GUARD)))
        )
    return signals


def uneven_angle(
    run: Run, n: int, sample_rate: float, rng: np.random.Generator
) -> Float[np.ndarray, " time"]:
    """Angle [rad] of an induction motor's shaft: it wanders, beats with its slip, and is twisted as
    it turns.
    """
    time, speed, pistons = (
        np.arange(n) / sample_rate,
        run.condition.speed,
        len(run.specimen.clearances),
    )
    angle = rng.uniform(0, 2 * np.pi) + speed * time
    for rate, swing in zip(rng.uniform(0.08, 3, 5), rng.uniform(0, 1.2e-3, 5), strict=True):
        angle += (
            speed * swing / (2 * np.pi * rate) * np.sin(2 * np.pi * (rate * time + rng.random()))
        )
    for order, twist in ((1, 8e-4), (2, 4e-4), (pistons, 3e-5)):
        angle += twist * rng.uniform(0.5, 1.5) * np.sin(order * angle + 2 * np.pi * rng.random())
    return angle


def forces_of(
    run: Run,
    specimen: ThirdSpecimen,
    oil: Oil,
    angle: Float[np.ndarray, " time"],
    sample_rate: float,
) -> Float[np.ndarray, "path time"]:
    """What goes each path along a shaft `angle` [rad]; the rotor's bearings and its tilting are
    left to `measure`.
    """
    design, condition, count, step = (
        specimen.design,
        run.condition,
        len(specimen.clearances),
        1 / sample_rate,
    )
    modes = ("recess", "scoring", "loose", "scuffed", "bore", "face", "wear")
    recess, scoring, loose, scuffed, bore, face, wear = (
        find_damage(run.fault, mode) for mode in modes
    )
    pressed = (condition.discharge_pressure / 10e6) ** np.array([0.15, 0.4])
    thick = (
        viscosity(condition.oil_temperature) / viscosity(celsius(45))
    ) ** specimen.film_exponent
    damping, stiffness = (specimen.values.reshape(3, 2) * pressed * [thick, 1]).T
    damping[1] /= (1 + 0.7 * wear.extent) ** 3
    stiffness[1] /= 1 + 0.7 * wear.extent
    which, radius, tangent, steep = (
        np.arange(count),
        design.pitch_radius,
        math.tan(design.swash_angle),
        design.swash_angle,
    )
    phi = angle + (2 * np.pi * which / count + specimen.spacing)[:, None]
    sine, cosine = np.sin(phi), np.cos(phi)
    pressing = design.area * (along(oil.pressure, angle) - condition.case_pressure)
    spin = design.masses[2] * condition.speed**2 * radius * cosine

    turns = np.arange(1, 4)[:, None] * TURN
    plate = specimen.waviness[0] @ np.cos(turns) + specimen.waviness[1] @ np.sin(turns)
    plate += um(70) * recess.extent * near(TURN, recess.angle, recess.half_width, deg(4))
    waves = 1 - np.cos(14 * (TURN - scoring.angle))
    plate += (
        um(4) * scoring.extent * waves * near(TURN, scoring.angle, 3 * scoring.half_width, deg(15))
    )
    held = SPRING / count / (1 + loose.extent * (which == loose.piston))[:, None]
    plays = specimen.plays + um(150) * loose.extent * (which == loose.piston)
    slippers = contact_forces(
        (pressing - tangent * spin - 12 * np.tanh(10 * sine) + held) / math.cos(steep), along(plate, phi), plays,
        design.masses[2], stiffness[0] / count, damping[0] / count, specimen.unloaded, step,
    )  # fmt: skip
    room = 2 * (np.array(specimen.clearances) + um(45) * scuffed.extent * (which == scuffed.piston))
    spall = (
        um(55)
        * bore.extent
        * near(phi, bore.angle, bore.half_width / 2, deg(5))
        * (which == bore.piston)[:, None]
    )
    lateral = contact_forces(
        tangent * slippers - spin,
        spall,
        room,
        design.masses[2],
        stiffness[2] / count,
        damping[2] / count,
        1.0,
        step,
    )
    load = pressing.sum(axis=0)
    wobble = um(7) * face.extent * np.cos(angle + 2 * np.pi * face.piston / count) + um(
        0.4
    ) * np.cos(angle)
    block = contact_forces(
        ((1 - BALANCE) * load + SPRING)[None], wobble[None], np.array([1e-4]), design.masses[1], stiffness[1],
        damping[1], 1.0, step,
    )  # fmt: skip
    forces = np.zeros((len(PATHS), len(angle)))
    forces[0], forces[1] = tangent * slippers.sum(axis=0), -slippers.sum(axis=0)
    forces[2] = -radius * (slippers * cosine).sum(axis=0) / math.cos(steep) ** 2
    forces[3] = radius * (slippers * sine).sum(axis=0)
    forces[4] = -lateral.sum(axis=0)
    forces[7] = design.masses[1] * condition.speed**2 * specimen.unbalance * np.sin(
        angle
    ) + 3 * np.sin(2 * angle)
    forces[8], forces[9], forces[10] = (
        BALANCE * load + block[0],
        tangent * forces[3],
        PIPE * along(oil.outlet, angle),
    )
    return forces - forces.mean(axis=1, keepdims=True)


def sounds_of(
    run: Run, specimen: ThirdSpecimen, oil: Oil, angle: Float[np.ndarray, " time"], sample_rate: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "path time"]:  # fmt: skip
    """Noise and impacts [N] that go each path."""
    n, count, noise = len(angle), len(specimen.clearances), specimen.noise
    speed, load = run.condition.speed / 150, run.condition.discharge_pressure / 10e6
    modes = ("scoring", "face", "wear", "race", "cavitation")
    scoring, face, wear, race, cavitation = (find_damage(run.fault, mode) for mode in modes)

    def struck(order: float, jitter: float, scatter: float, impulse: float) -> np.ndarray:
        """Impacts [N] so often a turn; angles err by `jitter` [rad], impulses [N s] by
        exp(+-scatter).
        """
        (chance,) = rng.spawn(1)
        where = np.arange(angle[0], angle[-1], 2 * np.pi / order) + chance.uniform(0, 6)
        place = np.interp(chance.normal(where, jitter), angle, np.arange(n)).astype(int)
        return np.bincount(
            place, impulse * sample_rate * np.exp(chance.normal(0, scatter, len(place))), n
        )

    white = rng.standard_normal((4, n))
    knots = np.arange(0, n + 12800, 6400)
    swelling = np.exp(0.12 * np.interp(np.arange(n), knots, rng.normal(size=len(knots))))
    jets, seepage = (swelling * np.sqrt(along(power, angle)) for power in (oil.jets, oil.seepage))
    ahead = TURN + 2 * np.pi * np.arange(count)[:, None] / count
    rubbing = 1 + 2 * scoring.extent * near(
        ahead, scoring.angle, 3 * scoring.half_width, deg(15)
    ).sum(axis=0)
    rubbing += 0.8 * face.extent * near(TURN, 2 * np.pi * face.piston / count, deg(40), deg(60))
    sounds = np.zeros((len(PATHS), n))
    sounds[1] = 2.0 * noise[2] * speed * np.sqrt(along(rubbing, angle)) * white[2]
    sounds[4] = 0.35 * noise[1] * seepage * white[1] + 1.2 * noise[2] * speed * white[3]
    sounds[8] = 0.22 * noise[0] * jets * white[0] * (1 + 0.25 * wear.extent)
    sounds[9] = struck(2, 0.02, 0.3, 2e-4 * noise[2] * load)
    sounds[10] = 0.12 * noise[0] * jets * white[0]
    inner = race.piston % 2
    zone = 1 + 0.9 * inner * np.cos(angle - race.angle)
    sounds[4] += zone * struck(
        specimen.design.race[inner], 0.01, 0.4, 1.6e-3 * race.extent * load**0.7 * speed
    )
    sounds[8] += struck(count, deg(3), 0.9, 1.2e-3 * cavitation.extent * speed)
    sounds[8] += struck(4.1 * count, deg(12), 1.1, 5e-4 * cavitation.extent * speed)
    return sounds


def housing_response(
    specimen: ThirdSpecimen,
    frequency: Float[np.ndarray, " line"],
    forces: Complex[np.ndarray, "path line"],
) -> Complex[np.ndarray, "sensor line"]:
    """Acceleration [m/s^2] at the sensors: the modes of a rigid shell on its mounting, and those of
    a flexible one.
    """
    shell, center = specimen.design.masses[0], np.array([0, 0, specimen.pump.positions.shell])
    wrenches = np.zeros((len(PATHS), 6))  # forces along x, y, z and moments about them
    wrenches[np.arange(len(PATHS)), [1, 2, 3, 4, 1, 3, 4, 0, 2, 5, 0]] = 1
    wrenches[10, 4] = 0.08
    places = np.array(
        [[sensor.direction, np.array(sensor.position) - center] for sensor in specimen.pump.sensors]
    )
    rigid = np.concatenate([places[:, 0], np.cross(places[:, 1], places[:, 0])], axis=1)
    shapes = np.concatenate([rigid, specimen.housing.residue], axis=1)
    inertia = shell * np.array([1, 1, 1, 0.012, 0.012, 0.006])
    drives = np.concatenate([wrenches / inertia, specimen.drives / (0.4 * shell)], axis=1)
    ratio = frequency / np.concatenate([specimen.rigid, specimen.housing.frequency])[:, None]
    damping = np.concatenate([np.full(6, 0.05), specimen.housing.damping_ratio])[:, None]
    return np.asarray(
        shapes @ (ratio**2 / (ratio**2 - 1 - 2j * damping * ratio) * (drives.T @ forces))
    )


def foreign_lines(
    run: Run,
    specimen: ThirdSpecimen,
    angle: Float[np.ndarray, " time"],
    sample_rate: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "sensor time"]:
    """Lines [m/s^2] of mains (first, third), motor (twice the mains), charge pump (mesh, its
    second) and drive.
    """
    supply = 2 * np.pi * rng.normal(50, 0.02) * np.arange(len(angle)) / sample_rate
    mesh = specimen.design.charge_teeth * angle
    drive = 2 * supply + 2 * np.pi * 4000 * np.arange(len(angle)) / sample_rate
    phases = np.stack([supply, 3 * supply, 2 * supply, mesh, 2 * mesh, drive]) + rng.uniform(
        0, 2 * np.pi, (6, 1)
    )
    levels = specimen.foreign * np.exp(rng.normal(0, 0.2, specimen.foreign.shape))
    levels[:, 2] *= run.condition.discharge_pressure / 10e6
    return levels @ np.sin(phases)
