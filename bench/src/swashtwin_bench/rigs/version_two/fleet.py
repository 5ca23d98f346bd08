"""The hidden truth of version 2: pumps, test stands and faults.

Pumps differ more than those of version 1. All random streams are separate, so no draw of version 1
returns.
"""

from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from jaxtyping import Complex, Float

from swashtwin.foundation import deg, mm, random_stream, um
from swashtwin.pump import (
    PARAMETERS,
    BoreDefect,
    DamScratch,
    Fault,
    GrooveErosion,
    PistonWear,
    Pump,
    SwashPlateDefect,
)
from swashtwin_bench.rigs.fleet import Housing, Specimen

FLEET_FACTORS = (0.6, 0.5, 0.7, 1.5, 2.2, 1.4)
"""Ratio of true to nominal interface values, mean of the fleet."""

DISPERSION = 0.25
"""Standard deviation of ln(interface value) between pumps."""

SUPPORT_RANGE = (0.8, 1.2)
"""Range of the ratio of true to nominal stiffness.

Drawn for the mounting along each axis and in tilt, and for each bearing.
"""

HOUSING_MODES = (1350.0, 2100.0, 2900.0, 3900.0, 5200.0)
"""Resonances [Hz] of the flexible housing, mean of the fleet."""

MIN_CLEARANCE_M = 8e-6
"""Smallest radial clearance of a piston [m]: a bound on rare draws."""

SEVERITY_SPREAD = 0.35
"""Standard deviation of ln(severity) between recordings of a class.

The training sets `default_prior` and changes assume the same spread, the others a smaller one.
"""

MAX_EROSION_SPREAD = 1.4
"""Largest severity of an eroded groove over the typical one.

It limits the advance to 7 deg; 6 deg is already much (`GrooveErosion`).
"""

SENSOR_PLACES = MappingProxyType(
    {
        "studs": (),
        "magnets": ((-0.020, 0.035, -0.060), (0.015, 0.080, 0.020), (0.080, -0.015, 0.085)),
    }
)
"""Positions [m] of the sensors of each set.

Sensors on studs sit at the positions of the pump file, sensors on magnets next to them.
"""

SENSOR_RESONANCE = MappingProxyType({"studs": (9500.0, 0.05), "magnets": (5500.0, 0.12)})
"""Resonance [Hz] and damping ratio of a sensor on its mounting.

A magnet is a softer mounting than a stud.
"""

SOURCES = ("ports", "slap", "bore", "recess")
"""Sources of impacts.

Chambers that meet a port, pistons that change sides in their bores, and two faults.
"""

STRENGTHS = np.array([4e-5, 3e-5, 1.6e-4, 8e-5])
"""Typical speed [m/s] that one impact of each source gives to the housing.

At 10 MPa and the typical severity.
"""

# Share of each mode in each sensor, mean of the fleet: pumps of one type are built alike.
_RESIDUES = random_stream(0, "housing of version 2").normal(0, 0.08, (3, len(HOUSING_MODES)))

# Share of each mode in each sensor when an impact of each source excites it, mean of the fleet.
_MODE_SHARES = random_stream(0, "places of version 2").normal(
    0, 0.6, (len(SOURCES), 3, len(HOUSING_MODES))
)


@dataclass(frozen=True, eq=False)
class Stand:
    """Machines of a test stand, and their amplitude in each sensor."""

    teeth: int
    """Teeth of the gear on the pump's shaft."""
    wheel_teeth: int
    """Teeth of the gear on the motor's shaft."""
    slip: float
    """Slip of the asynchronous motor per 10 MPa of discharge pressure [1]."""
    bearing_orders: Float[np.ndarray, " bearing"]
    """Ball passes of each bearing per revolution."""
    gear: Complex[np.ndarray, "sensor line"]
    """Amplitudes [m/s^2] of the gear's lines (`sounds.gear_orders`)."""
    motor: Float[np.ndarray, "sensor line"]
    """Amplitudes [m/s^2] of the motor.

    The supply's second, sixth and twelfth harmonic, and the motor's rotation.
    """
    bearing: Float[np.ndarray, "sensor bearing"]
    """Amplitudes [m/s^2] of the ball passes."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SecondSpecimen(Specimen):
    """One pump of version 2 with its true properties.

    `mount` and `bearing` of version 1 are 1, because `supports` replaces them.
    """

    is_reassembled: bool
    """Whether the pump is taken apart before each recording, or only to change a part."""
    sensors: str
    """Name of the sensor set in `SENSOR_PLACES`."""
    stand: Stand
    gauge: float
    """Ratio of true to specified pressure, an error of the gauge."""
    strengths: Float[np.ndarray, "source piston"]
    """Speed [m/s] that one impact of each piston gives to the housing at 10 MPa, by source."""
    mode_shares: Float[np.ndarray, "source sensor mode"]
    """Share of each mode in each sensor, by source of the impact."""
    jets: Float[np.ndarray, " piston"]
    """Loudness of the flow into and out of each chamber, over the mean."""

    def reassemble(self, seed: int, recording: str) -> "SecondSpecimen":
        """Return the same pump as assembled for `recording`."""
        rng = random_stream(seed, "assembly of version 2", recording)
        cross_talk = rng.normal(0, 0.08, (3, 3)) * (1 - np.eye(3))

        return replace(
            self,
            values=self.values * np.exp(rng.normal(0, 0.14, self.values.size)),
            housing=replace(self.housing, gain=self.housing.gain + cross_talk),
            strengths=self.strengths * np.exp(rng.normal(0, 0.2, self.strengths.shape)),
        )

    def truth(self) -> dict[str, object]:
        """Return supports, assembly and sensors, for the scoring file."""
        return {
            "supports": None if self.supports is None else self.supports.tolist(),
            "is_reassembled": self.is_reassembled,
            "sensors": self.sensors,
        }


def draw_specimen(nominal: Pump, name: str, seed: int) -> SecondSpecimen:
    """Return pump `name` of version 2's fleet of `seed`.

    Sensor sets alternate along the alphabet. Of every four pumps, two are reassembled.
    """
    # The order of the draws is part of the rig: another order gives other pumps.
    rng = random_stream(seed, "specimen of version 2", name)
    position_in_fleet = int(random_stream(seed, "fleet of version 2").integers(4)) + ord(name[0])
    sensor_set = tuple(SENSOR_PLACES)[position_in_fleet % 2]
    pump = _draw_pump(nominal, sensor_set, rng)

    piston_count = nominal.rotating_group.piston_count
    factors = np.exp(rng.normal(0, DISPERSION, len(PARAMETERS)))
    values = np.array(nominal.interfaces.values()) * FLEET_FACTORS * factors
    clearances = nominal.rotating_group.piston_clearance * rng.normal(1, 0.15, piston_count)

    return SecondSpecimen(
        name=name,
        pump=pump,
        values=values,
        mount=1.0,
        bearing=1.0,
        clearances=tuple(np.clip(clearances, MIN_CLEARANCE_M, None).tolist()),
        unloaded=float(rng.uniform(0.25, 0.6)),
        following=1.0,
        following_cutoff=float("inf"),
        housing=_draw_housing(rng),
        supports=rng.uniform(*SUPPORT_RANGE, 7),
        hangs_free=True,
        is_reassembled=bool(position_in_fleet // 2 % 2),
        sensors=sensor_set,
        stand=_draw_stand(rng),
        film_exponent=float(rng.uniform(0.6, 1.1)),
        gauge=float(rng.normal(1, 0.015)),
        strengths=_draw_strengths(rng, piston_count),
        mode_shares=_MODE_SHARES + rng.normal(0, 0.3, _MODE_SHARES.shape),
        jets=np.exp(rng.normal(0, 0.2, piston_count)),
    )


def _draw_pump(nominal: Pump, sensor_set: str, rng: np.random.Generator) -> Pump:
    """Return the nominal pump with another unbalance, other port angles and a sensor set."""
    eccentricity = nominal.masses.rotor_eccentricity * rng.lognormal(0, 0.5)
    plate = nominal.valve_plate
    discharge_open = plate.discharge_open + deg(rng.normal(0, 0.7))
    suction_open = plate.suction_open + deg(rng.normal(0, 0.7))

    sensors = nominal.sensors
    positions = SENSOR_PLACES[sensor_set]
    if positions:
        sensors = tuple(
            replace(sensor, position=position)
            for sensor, position in zip(sensors, positions, strict=True)
        )

    return replace(
        nominal,
        masses=replace(nominal.masses, rotor_eccentricity=eccentricity),
        valve_plate=replace(plate, discharge_open=discharge_open, suction_open=suction_open),
        sensors=sensors,
    )


def _draw_housing(rng: np.random.Generator) -> Housing:
    modes = len(HOUSING_MODES)
    return Housing(
        frequency=np.array(HOUSING_MODES) * rng.normal(1, 0.04, modes),
        damping_ratio=rng.uniform(0.015, 0.05, modes),
        residue=_RESIDUES + rng.normal(0, 0.04, (3, modes)),
        gain=np.diag(rng.normal(1, 0.08, 3)) + rng.normal(0, 0.07, (3, 3)) * (1 - np.eye(3)),
    )


def _draw_strengths(
    rng: np.random.Generator, piston_count: int
) -> Float[np.ndarray, "source piston"]:
    by_piston = rng.normal(0, 0.35, (len(SOURCES), piston_count))
    by_source = rng.normal(0, 0.3, (len(SOURCES), 1))

    return STRENGTHS[:, None] * np.exp(by_piston + by_source)


def _draw_stand(rng: np.random.Generator) -> Stand:
    return Stand(
        teeth=int(rng.integers(19, 32)),
        wheel_teeth=int(rng.integers(19, 32)),
        slip=float(rng.uniform(0.01, 0.03)),
        bearing_orders=np.array([4.93, 3.58, 3.05]) * rng.normal(1, 0.01, 3),
        gear=_draw_amplitudes(rng, 0.06, 4) * np.exp(2j * np.pi * rng.random(4)),
        motor=_draw_amplitudes(rng, 0.04, 4),
        bearing=_draw_amplitudes(rng, 0.03, 3),
    )


def _draw_amplitudes(
    rng: np.random.Generator, typical: float, lines: int
) -> Float[np.ndarray, "sensor line"]:
    """Return amplitudes around a `typical` one, with a random sign in each sensor."""
    amplitudes = typical * np.exp(rng.normal(0, 0.5, (3, lines)))
    return amplitudes * rng.choice([-1.0, 1.0], (3, lines))


RECESS_DEPTH = mm(0.07)
"""Typical depth of version 2's recess [m]."""

PAPER_RECESS = SwashPlateDefect(depth=mm(0.6), length=mm(30), width=mm(24), contact="lift_off")
"""The paper's recess, in version ``2-deep``."""


def draw_fault(
    label: str, specimen: str, seed: int, purpose: str, *, is_deep: bool = False
) -> Fault | None:
    """Return the fault of a pump of class `label`, or `None` if it is healthy.

    Parameters
    ----------
    purpose : addresses the random stream: of one recording, or of all recordings of a pump that is
        not reassembled.
    is_deep : whether the recess has the paper's dimensions; its angle is drawn.
    """
    rng = random_stream(seed, "fault of version 2", label, purpose)
    spread = float(np.exp(rng.normal(0, SEVERITY_SPREAD)))

    if label == "swash_plate":
        # A recess is machined once into each pump, so all its recordings share the place.
        machining = random_stream(seed, "recess of version 2", specimen)
        angle = deg(machining.uniform(205, 335))
        length = mm(machining.uniform(24, 36))
        width = mm(machining.uniform(22.5, 28))
        if is_deep:
            return replace(PAPER_RECESS, angle=angle)
        return SwashPlateDefect(RECESS_DEPTH * spread, length, width, angle, contact="lift_off")

    if label == "piston":
        return PistonWear(clearance=um(60) * spread, piston=int(rng.integers(7)))

    if label == "cylinder_block":
        loaded = deg(270 + rng.uniform(-40, 40))
        half_width = deg(rng.uniform(25, 55))
        return BoreDefect(
            um(270) * spread, half_width=half_width, angle=loaded, bore=int(rng.integers(7))
        )

    if label == "valve_plate":
        if rng.random() < 0.5:
            return DamScratch(area=0.8e-6 * spread, width=deg(rng.uniform(3, 8)))
        advance = deg(5) * min(spread, MAX_EROSION_SPREAD)
        return GrooveErosion(advance=advance, area_factor=float(rng.uniform(2, 6)))

    return None
