"""Measurement in version 3: from a pump at an operating point to accelerometer samples.

Forces come through one-sided contacts along a shaft that turns unevenly. They drive a shell on its
mounting and the housing's flexible modes at once: what swash plate and cover do to each other
cancels on a rigid shell and stretches a flexible one (Jpn. J. Fluid Power 18(1) 60, 1987: vibration
comes through the trunnion axis).

Noise and impacts that do not come from the contacts take the same paths: jets and leakage, as loud
as the root of the power that they lose, rubbing, a struck race (Randall and Antoni 2011,
doi:10.1016/j.ymssp.2010.07.017), the coupling's claws, and collapsing bubbles.
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
    angle_window,
    contact_forces,
    interpolate_turn,
    solve_oil,
    viscosity,
)

FINE = 2
"""Time steps of the contacts per reading."""

GUARD = 5120
"""Readings before the recording that are dropped.

The wrap-around of the transform dies away in them.
"""

BALANCE = 0.91
"""Ratio of the force of the valve plate to that of the pistons."""

SPRING = 420.0
"""Force of the central spring [N]."""

PIPE = 4e-4
"""Area of the outlet [m^2]."""

SENSOR_NOISE = 0.03
"""Standard deviation [m/s^2] of the sensors' white noise."""

Y, Z, TILT_X, TILT_Y, ROTOR_Y, ROTOR_TILT_X, ROTOR_TILT_Y, ROTOR_X, COVER, ROLL, OUTLET = range(
    len(PATHS)
)
"""Indices in `PATHS`; the first four are the swash plate's."""


def measure(
    runs: Sequence[Run], duration: float, sample_rate: float, seeds: Sequence[tuple[int, str]]
) -> list[Float[np.ndarray, "sensor time"]]:
    """Return the readings [m/s^2] of each run; parameters as in version 1."""
    n = round(duration * sample_rate)
    signals = []
    for run, (seed, name) in zip(runs, seeds, strict=True):
        specimen = run.specimen
        assert isinstance(specimen, ThirdSpecimen)
        rng = random_stream(seed, "reading of version 3", name)
        signals.append(_measure_run(run, specimen, n, sample_rate, rng))

    return signals


def _measure_run(
    run: Run, specimen: ThirdSpecimen, n: int, sample_rate: float, rng: np.random.Generator
) -> Float[np.ndarray, "sensor time"]:
    oil = solve_oil(run, specimen)
    n += GUARD
    frequency = line_frequencies(n, sample_rate)

    # The order of the draws is part of the rig: another order gives other recordings.
    angle = uneven_angle(run, FINE * n, FINE * sample_rate, rng)
    fine_forces = contact_paths(run, specimen, oil, angle, FINE * sample_rate)
    forces = transform(fine_forces)[:, : n // 2 + 1] / FINE
    angle = angle[::FINE]

    # The rotor hands on to its bearings what the swash plate does to it, through its resonance.
    turning = frequency / specimen.design.rotor_mode
    rotor_response = 1 / (1 - turning**2 + 0.12j * turning)
    forces[ROTOR_Y] *= rotor_response
    forces[ROTOR_TILT_X] = -rotor_response * forces[TILT_X]
    forces[ROTOR_TILT_Y] = -rotor_response * forces[TILT_Y]
    forces += transform(draw_sounds(run, specimen, oil, angle, sample_rate, rng))

    ratio = frequency / specimen.mounting[:, None]
    sensor_response = 1 - ratio**2 + 0.1j * ratio
    lines = housing_response(specimen, frequency, forces) / sensor_response
    signal = specimen.housing.gain @ inverse_transform(lines, n)
    signal = signal + foreign_lines(run, specimen, angle, sample_rate, rng)

    signal = signal[:, GUARD:]
    return digitize(signal + SENSOR_NOISE * rng.standard_normal(signal.shape))


def uneven_angle(
    run: Run, n: int, sample_rate: float, rng: np.random.Generator
) -> Float[np.ndarray, " time"]:
    """Return the angle [rad] of an induction motor's shaft.

    It wanders, beats with the motor's slip, and is twisted as it turns.
    """
    time = np.arange(n) / sample_rate
    speed = run.condition.speed
    piston_count = len(run.specimen.clearances)
    angle = rng.uniform(0, 2 * np.pi) + speed * time

    for rate, swing in zip(rng.uniform(0.08, 3, 5), rng.uniform(0, 1.2e-3, 5), strict=True):
        phase = 2 * np.pi * (rate * time + rng.random())
        angle += speed * swing / (2 * np.pi * rate) * np.sin(phase)

    for order, twist in ((1, 8e-4), (2, 4e-4), (piston_count, 3e-5)):
        amplitude = twist * rng.uniform(0.5, 1.5)
        angle += amplitude * np.sin(order * angle + 2 * np.pi * rng.random())

    return angle


def contact_paths(
    run: Run,
    specimen: ThirdSpecimen,
    oil: Oil,
    angle: Float[np.ndarray, " time"],
    sample_rate: float,
) -> Float[np.ndarray, "path time"]:
    """Return the forces of the contacts along each path, without their means.

    Those of the rotor's bearings follow in `measure`, from the tilting moments.

    Parameters
    ----------
    angle : shaft angle [rad] of each time step.
    """
    design = specimen.design
    condition = run.condition
    piston_mass = design.masses[2]
    piston_count = len(specimen.clearances)
    damping, stiffness = _contact_totals(run, specimen)

    scuffed = find_damage(run.fault, "scuffed")
    bore = find_damage(run.fault, "bore")
    face = find_damage(run.fault, "face")
    piston = np.arange(piston_count)
    step = 1 / sample_rate
    tangent = math.tan(design.swash_angle)
    phi = angle + (2 * np.pi * piston / piston_count + specimen.spacing)[:, None]
    pressing = design.area * (interpolate_turn(oil.pressure, angle) - condition.case_pressure)
    spin = piston_mass * condition.speed**2 * design.pitch_radius * np.cos(phi)

    slippers = _slipper_forces(run, specimen, phi, pressing, spin, damping, stiffness, step)

    # Each piston moves between the two sides of its bore.
    scuffed_gap = um(45) * scuffed.extent * (piston == scuffed.piston)
    play = 2 * (np.array(specimen.clearances) + scuffed_gap)
    spall = um(55) * bore.extent * angle_window(phi, bore.angle, bore.half_width / 2, deg(5))
    spall = spall * (piston == bore.piston)[:, None]
    lateral = contact_forces(
        tangent * slippers - spin,
        spall,
        play,
        piston_mass,
        stiffness[2] / piston_count,
        damping[2] / piston_count,
        1.0,
        step,
    )

    # The block rides on the valve plate, with a face that is a little out of square.
    load = pressing.sum(axis=0)
    wobble = um(7) * face.extent * np.cos(angle + 2 * np.pi * face.piston / piston_count)
    wobble = wobble + um(0.4) * np.cos(angle)
    block = contact_forces(
        ((1 - BALANCE) * load + SPRING)[None],
        wobble[None],
        np.array([1e-4]),
        design.masses[1],
        stiffness[1],
        damping[1],
        1.0,
        step,
    )

    radius = design.pitch_radius
    forces = np.zeros((len(PATHS), len(angle)))
    forces[Y] = tangent * slippers.sum(axis=0)
    forces[Z] = -slippers.sum(axis=0)
    forces[TILT_X] = (
        -radius * (slippers * np.cos(phi)).sum(axis=0) / math.cos(design.swash_angle) ** 2
    )
    forces[TILT_Y] = radius * (slippers * np.sin(phi)).sum(axis=0)
    forces[ROTOR_Y] = -lateral.sum(axis=0)
    unbalance = design.masses[1] * condition.speed**2 * specimen.unbalance
    forces[ROTOR_X] = unbalance * np.sin(angle) + 3 * np.sin(2 * angle)
    forces[COVER] = BALANCE * load + block[0]
    forces[ROLL] = tangent * forces[TILT_Y]
    forces[OUTLET] = PIPE * interpolate_turn(oil.outlet, angle)

    return forces - forces.mean(axis=1, keepdims=True)


def _contact_totals(
    run: Run, specimen: ThirdSpecimen
) -> tuple[Float[np.ndarray, " contact"], Float[np.ndarray, " contact"]]:
    """Return total damping and stiffness of slippers, block and pistons in a run."""
    wear = find_damage(run.fault, "wear")

    pressed = (run.condition.discharge_pressure / 10e6) ** np.array([0.15, 0.4])
    thick = viscosity(run.condition.oil_temperature) / viscosity(celsius(45))
    thick = thick**specimen.film_exponent
    damping, stiffness = (specimen.values.reshape(3, 2) * pressed * [thick, 1]).T

    # Wear widens the film under the block: stiffness falls with it, damping with its cube.
    damping[1] /= (1 + 0.7 * wear.extent) ** 3
    stiffness[1] /= 1 + 0.7 * wear.extent

    return damping, stiffness


def _slipper_forces(
    run: Run,
    specimen: ThirdSpecimen,
    phi: Float[np.ndarray, "piston time"],
    pressing: Float[np.ndarray, "piston time"],
    spin: Float[np.ndarray, "piston time"],
    damping: Float[np.ndarray, " contact"],
    stiffness: Float[np.ndarray, " contact"],
    step: float,
) -> Float[np.ndarray, "piston time"]:
    """Return the force [N] of each slipper on the swash plate.

    Parameters
    ----------
    phi : angle of each piston [rad].
    pressing : force of the pressure on each piston [N].
    spin : centrifugal force on each piston along y [N].
    """
    design = specimen.design
    recess = find_damage(run.fault, "recess")
    scoring = find_damage(run.fault, "scoring")
    loose = find_damage(run.fault, "loose")
    piston_count = len(phi)
    is_loose = np.arange(piston_count) == loose.piston

    # Depth of the swash plate below an even one, over a turn.
    turns = np.arange(1, 4)[:, None] * TURN
    plate = specimen.waviness[0] @ np.cos(turns) + specimen.waviness[1] @ np.sin(turns)
    plate += um(70) * recess.extent * angle_window(TURN, recess.angle, recess.half_width, deg(4))
    waves = 1 - np.cos(14 * (TURN - scoring.angle))
    scored = angle_window(TURN, scoring.angle, 3 * scoring.half_width, deg(15))
    plate += um(4) * scoring.extent * waves * scored

    held = SPRING / piston_count / (1 + loose.extent * is_loose)[:, None]
    plays = specimen.plays + um(150) * loose.extent * is_loose
    friction = 12 * np.tanh(10 * np.sin(phi))
    along_piston = pressing - math.tan(design.swash_angle) * spin - friction + held

    return contact_forces(
        along_piston / math.cos(design.swash_angle),
        interpolate_turn(plate, phi),
        plays,
        design.masses[2],
        stiffness[0] / piston_count,
        damping[0] / piston_count,
        specimen.unloaded,
        step,
    )


def draw_sounds(
    run: Run,
    specimen: ThirdSpecimen,
    oil: Oil,
    angle: Float[np.ndarray, " time"],
    sample_rate: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "path time"]:
    """Return noise and impacts [N] along each path.

    Parameters
    ----------
    angle : shaft angle [rad] of each sample.
    """
    n = len(angle)
    piston_count = len(specimen.clearances)
    jet_noise, leakage_noise, rubbing_noise, _ = specimen.noise
    speed = run.condition.speed / 150
    load = run.condition.discharge_pressure / 10e6
    scoring = find_damage(run.fault, "scoring")
    face = find_damage(run.fault, "face")
    wear = find_damage(run.fault, "wear")
    race = find_damage(run.fault, "race")
    cavitation = find_damage(run.fault, "cavitation")

    def draw_impacts(order: float, jitter: float, scatter: float, impulse: float) -> np.ndarray:
        """Return impacts [N] at an order of the shaft.

        Their angles err by `jitter` [rad], their impulses [N s] by exp(+-scatter).
        """
        # A separate stream, so that the number of impacts does not shift other draws.
        (stream,) = rng.spawn(1)
        impact_angle = np.arange(angle[0], angle[-1], 2 * np.pi / order) + stream.uniform(0, 6)
        impact_angle = stream.normal(impact_angle, jitter)
        index = np.interp(impact_angle, angle, np.arange(n)).astype(int)
        strength = np.exp(stream.normal(0, scatter, len(index)))

        return np.bincount(index, impulse * sample_rate * strength, n)

    # The noise of jets and leakage also swells at random, with knots a quarter of a second apart.
    white = rng.standard_normal((4, n))
    knots = np.arange(0, n + 12800, 6400)
    swelling = np.exp(0.12 * np.interp(np.arange(n), knots, rng.normal(size=len(knots))))
    jets = swelling * np.sqrt(interpolate_turn(oil.jets, angle))
    seepage = swelling * np.sqrt(interpolate_turn(oil.seepage, angle))

    phi = TURN + 2 * np.pi * np.arange(piston_count)[:, None] / piston_count
    scored = angle_window(phi, scoring.angle, 3 * scoring.half_width, deg(15))
    face_angle = 2 * np.pi * face.piston / piston_count
    rubbing = 1 + 2 * scoring.extent * scored.sum(axis=0)
    rubbing += 0.8 * face.extent * angle_window(TURN, face_angle, deg(40), deg(60))

    sounds = np.zeros((len(PATHS), n))
    rubbed = np.sqrt(interpolate_turn(rubbing, angle))
    sounds[Z] = 2.0 * rubbing_noise * speed * rubbed * white[2]
    sounds[ROTOR_Y] = (
        0.35 * leakage_noise * seepage * white[1] + 1.2 * rubbing_noise * speed * white[3]
    )
    sounds[COVER] = 0.22 * jet_noise * jets * white[0] * (1 + 0.25 * wear.extent)
    sounds[ROLL] = draw_impacts(2, 0.02, 0.3, 2e-4 * rubbing_noise * load)
    sounds[OUTLET] = 0.12 * jet_noise * jets * white[0]

    # A flaw on the inner race turns through the load zone, one on the outer race does not.
    inner = race.piston % 2
    load_zone = 1 + 0.9 * inner * np.cos(angle - race.angle)
    race_impulse = 1.6e-3 * race.extent * load**0.7 * speed
    sounds[ROTOR_Y] += load_zone * draw_impacts(
        specimen.design.race[inner], 0.01, 0.4, race_impulse
    )

    # Bubbles collapse once for each chamber that meets the port, and at random times.
    sounds[COVER] += draw_impacts(piston_count, deg(3), 0.9, 1.2e-3 * cavitation.extent * speed)
    sounds[COVER] += draw_impacts(
        4.1 * piston_count, deg(12), 1.1, 5e-4 * cavitation.extent * speed
    )

    return sounds


def housing_response(
    specimen: ThirdSpecimen,
    frequency: Float[np.ndarray, " line"],
    forces: Complex[np.ndarray, "path line"],
) -> Complex[np.ndarray, "sensor line"]:
    """Return the acceleration [m/s^2] at the sensors.

    It is the sum of the modes of a rigid shell on its mounting and those of a flexible one.
    """
    shell_mass = specimen.design.masses[0]
    center = np.array([0, 0, specimen.pump.positions.shell])

    # Forces along and moments about x, y, z of each path; the pipe has an arm of 80 mm.
    wrenches = np.zeros((len(PATHS), 6))
    wrenches[np.arange(len(PATHS)), [1, 2, 3, 4, 1, 3, 4, 0, 2, 5, 0]] = 1
    wrenches[OUTLET, 4] = 0.08

    directions = np.array([sensor.direction for sensor in specimen.pump.sensors])
    arms = np.array([np.array(sensor.position) - center for sensor in specimen.pump.sensors])
    rigid = np.concatenate([directions, np.cross(arms, directions)], axis=1)
    shapes = np.concatenate([rigid, specimen.housing.residue], axis=1)

    inertia = shell_mass * np.array([1, 1, 1, 0.012, 0.012, 0.006])
    drives = np.concatenate([wrenches / inertia, specimen.drives / (0.4 * shell_mass)], axis=1)
    resonances = np.concatenate([specimen.rigid, specimen.housing.frequency])
    damping = np.concatenate([np.full(6, 0.05), specimen.housing.damping_ratio])[:, None]
    ratio = frequency / resonances[:, None]
    response = ratio**2 / (ratio**2 - 1 - 2j * damping * ratio)

    return np.asarray(shapes @ (response * (drives.T @ forces)))


def foreign_lines(
    run: Run,
    specimen: ThirdSpecimen,
    angle: Float[np.ndarray, " time"],
    sample_rate: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "sensor time"]:
    """Return lines [m/s^2] of other machines than the pump.

    They are the mains (first and third harmonic), the motor (twice the mains), the charge pump (its
    mesh and the second harmonic), and the motor's drive.
    """
    supply = 2 * np.pi * rng.normal(50, 0.02) * np.arange(len(angle)) / sample_rate
    mesh = specimen.design.charge_teeth * angle
    drive = 2 * supply + 2 * np.pi * 4000 * np.arange(len(angle)) / sample_rate
    phases = np.stack([supply, 3 * supply, 2 * supply, mesh, 2 * mesh, drive])
    phases = phases + rng.uniform(0, 2 * np.pi, (6, 1))

    amplitudes = specimen.foreign * np.exp(rng.normal(0, 0.2, specimen.foreign.shape))
    amplitudes[:, 2] *= run.condition.discharge_pressure / 10e6

    return amplitudes @ np.sin(phases)
