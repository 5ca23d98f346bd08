"""The hidden truth of version 2: pumps that differ more than those of version 1, their test stands
and their faults.

Everything is drawn anew, from streams of its own; no number of version 1 returns.
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
"""Truth over nominal of the six interface values, fleet mean."""

DISPERSION = 0.25
"""Standard deviation of ln(interface value) between pumps."""

SUPPORT_RANGE = (0.8, 1.2)
"""True over nominal stiffness of the mounting along each axis and in tilt, and of each bearing."""

HOUSING_MODES = (1350.0, 2100.0, 2900.0, 3900.0, 5200.0)
"""Fleet mean resonances [Hz] of the flexible housing."""

SEVERITY_SPREAD = 0.35
"""Standard deviation of ln(severity); `default_prior` and changes assume the same, other training
sets less.
"""

SENSOR_PLACES = MappingProxyType(
    {
        "studs": (),
        "magnets": ((-0.020, 0.035, -0.060), (0.015, 0.080, 0.020), (0.080, -0.015, 0.085)),
    }
)
"""Both sensor sets: on studs where the pump file says, or on magnets [m], beside these places."""

SENSOR_RESONANCE = MappingProxyType({"studs": (9500.0, 0.05), "magnets": (5500.0, 0.12)})
"""Resonance [Hz] and damping ratio of a sensor on its mounting."""

SOURCES = ("ports", "slap", "bore", "recess")
"""Where impacts come from: chambers that meet a port, pistons that change sides in their bores, and
two faults.
"""


@dataclass(frozen=True, eq=False)
class Stand:
    """What else turns beside a pump, and how loudly it is heard in each sensor."""

    teeth: int
    """Teeth of the gear on the pump's shaft."""
    wheel_teeth: int
    """Teeth of the gear on the motor's shaft."""
    slip: float
    """Slip of the asynchronous motor at no load [1]."""
    bearing_orders: Float[np.ndarray, " bearing"]
    """Ball passes of each bearing per revolution."""
    gear: Complex[np.ndarray, "sensor line"]
    """Amplitudes [m/s^2] of the mesh, its sidebands of one turn of the shaft, and the second
    harmonic.
    """
    motor: Float[np.ndarray, "sensor line"]
    """Amplitudes [m/s^2] of the supply's second, sixth and twelfth harmonic, and of the motor's
    turning.
    """
    bearing: Float[np.ndarray, "sensor bearing"]
    """Amplitudes [m/s^2] of the ball passes."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SecondSpecimen(Specimen):
    """One pump of version 2, as it truly is; mount and bearing of version 1 are 1, for `supports`
    take their place.
    """

    is_reassembled: bool
    """Whether it is taken apart before each recording, or only where another part is put in."""
    sensors: str
    """Name in `SENSOR_PLACES`."""
    stand: Stand
    gauge: float
    """True over stated pressure, an error of the gauge."""
    strengths: Float[np.ndarray, "source piston"]
    """Speed [m/s] that one impact of each piston gives to the housing at 10 MPa, by source."""
    mode_shares: Float[np.ndarray, "source sensor mode"]
    """How far an impact of each source excites each mode in each sensor."""
    jets: Float[np.ndarray, " piston"]
    """How loud the flow into and out of each chamber is over the mean."""

    def reassemble(self, seed: int, recording: str) -> "SecondSpecimen":
        """The same pump as put together for what `recording` names."""
        rng = random_stream(seed, "assembly of version 2", recording)
        off = rng.normal(0, 0.08, (3, 3)) * (1 - np.eye(3))
        return replace(
            self,
            values=self.values * np.exp(rng.normal(0, 0.14, self.values.size)),
            housing=replace(self.housing, gain=self.housing.gain + off),
            strengths=self.strengths * np.exp(rng.normal(0, 0.2, self.strengths.shape)),
        )

    def truth(self) -> dict[str, object]:
        """Supports, assembly and sensors, for the scoring file."""
        return {
            "supports": None if self.supports is None else self.supports.tolist(),
            "is_reassembled": self.is_reassembled,
            "sensors": self.sensors,
        }


def draw_specimen(nominal: Pump, name: str, seed: int) -> SecondSpecimen:
    """Pump `name` of version 2's fleet of `seed`.

    Of neighbors in the alphabet one has the first sensor set and one the second; of every four, two
    are reassembled.
    """
    rng = random_stream(seed, "specimen of version 2", name)
    turn = int(random_stream(seed, "fleet of version 2").integers(4)) + ord(name[0])
    sensors = tuple(SENSOR_PLACES)[turn % 2]
    positions = SENSOR_PLACES[sensors]
    plate, masses, group = nominal.valve_plate, nominal.masses, nominal.rotating_group
    modes, count = len(HOUSING_MODES), group.piston_count
    pump = replace(
        nominal,
        masses=replace(
            masses, rotor_eccentricity=masses.rotor_eccentricity * rng.lognormal(0, 0.5)
        ),
        valve_plate=replace(
            plate,
            discharge_open=plate.discharge_open + deg(rng.normal(0, 0.7)),
            suction_open=plate.suction_open + deg(rng.normal(0, 0.7)),
        ),
        sensors=tuple(
            replace(sensor, position=position)
            for sensor, position in zip(nominal.sensors, positions, strict=True)
        )
        if positions
        else nominal.sensors,
    )
    return SecondSpecimen(
        name=name,
        pump=pump,
        values=np.array(nominal.interfaces.values())
        * FLEET_FACTORS
        * np.exp(rng.normal(0, DISPERSION, len(PARAMETERS))),
        mount=1.0,
        bearing=1.0,
        clearances=tuple(
            np.clip(group.piston_clearance * rng.normal(1, 0.15, count), 8e-6, None).tolist()
        ),
        unloaded=float(rng.uniform(0.25, 0.6)),
        following=1.0,
        following_cutoff=float("inf"),
        housing=Housing(
            frequency=np.array(HOUSING_MODES) * rng.normal(1, 0.04, modes),
            damping_ratio=rng.uniform(0.015, 0.05, modes),
            residue=_RESIDUES + rng.normal(0, 0.04, (3, modes)),
            gain=np.diag(rng.normal(1, 0.08, 3)) + rng.normal(0, 0.07, (3, 3)) * (1 - np.eye(3)),
        ),
        supports=rng.uniform(*SUPPORT_RANGE, 7),
        hangs_free=True,
        is_reassembled=bool(turn // 2 % 2),
        sensors=sensors,
        stand=_draw_stand(rng),
        film_exponent=float(rng.uniform(0.6, 1.1)),
        gauge=float(rng.normal(1, 0.015)),
        strengths=STRENGTHS[:, None]
        * np.exp(
            rng.normal(0, 0.35, (len(SOURCES), count)) + rng.normal(0, 0.3, (len(SOURCES), 1))
        ),
        mode_shares=_MODE_SHARES + rng.normal(0, 0.3, (len(SOURCES), 3, modes)),
        jets=np.exp(rng.normal(0, 0.2, count)),
    )


STRENGTHS = np.array([4e-5, 3e-5, 1.6e-4, 8e-5])
"""Typical speed [m/s] that one impact gives to the housing at 10 MPa and the typical severity, by
source.
"""


# Share of each mode in each sensor, fleet mean.
_RESIDUES = random_stream(0, "housing of version 2").normal(0, 0.08, (3, len(HOUSING_MODES)))

# How far an impact of each source excites each mode in each sensor, fleet mean: pumps of one type
# are built alike.
_MODE_SHARES = random_stream(0, "places of version 2").normal(
    0, 0.6, (len(SOURCES), 3, len(HOUSING_MODES))
)


def _draw_stand(rng: np.random.Generator) -> Stand:
    def level(typical: float, lines: int) -> np.ndarray:
        return (
            typical * np.exp(rng.normal(0, 0.5, (3, lines))) * rng.choice([-1.0, 1.0], (3, lines))
        )

    return Stand(
        teeth=int(rng.integers(19, 32)),
        wheel_teeth=int(rng.integers(19, 32)),
        slip=float(rng.uniform(0.01, 0.03)),
        bearing_orders=np.array([4.93, 3.58, 3.05]) * rng.normal(1, 0.01, 3),
        gear=level(0.06, 4) * np.exp(2j * np.pi * rng.random(4)),
        motor=level(0.04, 4),
        bearing=level(0.03, 3),
    )


RECESS_DEPTH = mm(0.07)
"""Typical depth of version 2's recess [m]."""
PAPER_RECESS = SwashPlateDefect(depth=mm(0.6), length=mm(30), width=mm(24), contact="lift_off")
"""The paper's recess, in version ``2-deep``."""


def draw_fault(
    label: str, specimen: str, seed: int, purpose: str, *, is_deep: bool = False
) -> Fault | None:
    """What is wrong with a pump of class `label`.

    Parameters
    ----------
    purpose : addresses the random stream: of one recording, or of all of a pump that is not
        reassembled.
    is_deep : the recess has the paper's dimensions; where it lies is drawn.
    """
    rng = random_stream(seed, "fault of version 2", label, purpose)
    spread = float(np.exp(rng.normal(0, SEVERITY_SPREAD)))
    if label == "swash_plate":
        machining = random_stream(seed, "recess of version 2", specimen)
        angle, length, width = (
            deg(machining.uniform(205, 335)),
            mm(machining.uniform(24, 36)),
            mm(machining.uniform(22.5, 28)),
        )
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
        return GrooveErosion(
            advance=deg(5) * min(spread, 1.4), area_factor=float(rng.uniform(2, 6))
        )
    return None
