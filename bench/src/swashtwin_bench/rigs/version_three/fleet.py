"""The hidden truth of version 3: two designs, the pumps of a fleet and their faults.

All random streams are separate from those of the other versions. Numbers without a source are
estimates in the ranges of docs/explanation/physics.md, section 4, moved to another maker's sizes.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import MPa, deg, mm, random_stream, rpm, um
from swashtwin.pump import CLASSES, Fault, Nameplate, Pump, scaled_pump
from swashtwin_bench.rigs.fleet import Housing, Specimen


@dataclass(frozen=True, eq=False)
class Design:
    """Properties that all pumps of one design share."""

    name: str
    nameplate: Nameplate
    piston_diameter: float
    """[m]."""
    pitch_radius: float
    """Radius of the circle of pistons [m]."""
    swash_angle: float
    """[rad]."""
    dead_volume: float
    """Volume of a chamber at top dead center [m^3]."""
    suction: tuple[float, float]
    """Angles from top dead center at which the suction kidney begins and ends [rad]."""
    discharge: tuple[float, float]
    """Angles from top dead center at which the discharge kidney begins and ends [rad]."""
    relief: str
    """Relief before each kidney: a ``groove`` that widens, or a ``hole``."""
    relief_angle: float
    """Angle that the relief covers [rad]."""
    relief_area: float
    """Largest opening of the relief [m^2]."""
    masses: tuple[float, float, float]
    """Masses of the shell, the rotor, and one piston with its slipper [kg]."""
    contacts: tuple[float, ...]
    """Total damping and stiffness of the contacts at 45 degC and 10 MPa, as `pump.PARAMETERS`."""
    rigid: tuple[float, ...]
    """Resonances of the shell on its mounting along and about x, y, z [Hz]."""
    flexible: tuple[float, ...]
    """Resonances of the housing [Hz]."""
    rotor_mode: float
    """Resonance of the rotor in its bearings [Hz]."""
    race: tuple[float, float]
    """Rolling elements per revolution over a flaw of the outer and inner race."""
    charge_teeth: int
    """Teeth of the charge pump."""

    @property
    def area(self) -> float:
        """Cross section of a bore [m^2]."""
        return math.pi / 4 * self.piston_diameter**2

    @property
    def lift(self) -> float:
        """Half of a piston's stroke [m]."""
        return self.pitch_radius * math.tan(self.swash_angle)


DESIGNS = (
    Design(
        name="seven",
        nameplate=Nameplate(45e-6, 7, rpm(1500), MPa(25), deg(17.5), 27.0),
        piston_diameter=mm(19),
        pitch_radius=mm(36),
        swash_angle=deg(17.5),
        dead_volume=4.2e-6,
        suction=(deg(11), deg(179)),
        discharge=(deg(193), deg(359)),
        relief="groove",
        relief_angle=deg(11),
        relief_area=7e-6,
        masses=(21.0, 5.2, 0.17),
        contacts=(4.2e4, 6e7, 3.2e4, 2.1e8, 1.4e4, 1.1e8),
        rigid=(118.0, 156.0, 265.0, 330.0, 385.0, 210.0),
        flexible=(820.0, 1240.0, 1610.0, 2330.0, 3050.0, 3900.0, 5100.0, 6800.0),
        rotor_mode=1080.0,
        race=(6.41, 8.59),
        charge_teeth=11,
    ),
    Design(
        name="nine",
        nameplate=Nameplate(71e-6, 9, rpm(1500), MPa(28), deg(16.7), 36.0),
        piston_diameter=mm(20),
        pitch_radius=mm(42),
        swash_angle=deg(16.7),
        dead_volume=5.5e-6,
        suction=(deg(13), deg(178)),
        discharge=(deg(195), deg(358)),
        relief="hole",
        relief_angle=deg(11),
        relief_area=2.4e-6,
        masses=(28.0, 8.6, 0.21),
        contacts=(6.5e4, 1.1e8, 5.5e4, 3.4e8, 2.2e4, 1.7e8),
        rigid=(92.0, 140.0, 215.0, 255.0, 310.0, 175.0),
        flexible=(650.0, 980.0, 1420.0, 1880.0, 2750.0, 3400.0, 4600.0, 6100.0),
        rotor_mode=860.0,
        race=(7.83, 10.17),
        charge_teeth=9,
    ),
)
"""Both designs.

Films have a stiffness of 3 W / h and are thicker than the twin's (physics.md, section 4). Housings
resonate above 0.65 kHz, at which the twin's shell is rigid.
"""

MODES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "swash_plate": ("recess", "scoring"),
        "cylinder_block": ("bore", "face"),
        "piston": ("scuffed",),
        "valve_plate": ("scratch", "erosion", "wear"),
        "loose_slipper": ("loose",),
        "bearing_race": ("race",),
        "cavitation": ("cavitation",),
    }
)
"""Modes of damage of each class."""

LABELS = (*CLASSES, "loose_slipper", "bearing_race", "cavitation", "compound")
"""All classes that version 3 records: the paper's five, and four others."""

FOREIGN_AMPLITUDES = (0.02, 0.015, 0.03, 0.05, 0.06, 0.02)
"""Typical amplitudes [m/s^2] of the lines in `measuring.foreign_lines`."""

SEVERITY_SPREAD = 0.4
"""Standard deviation of ln(severity) between damaged parts."""

PATHS = (
    "swash_y",
    "swash_z",
    "swash_tilt_x",
    "swash_tilt_y",
    "rotor_y",
    "rotor_tilt_x",
    "rotor_tilt_y",
    "rotor_x",
    "cover_z",
    "roll",
    "pipe",
)
"""Paths of forces [N] and moments [N m] into the housing.

They lead from the swash plate, the rotor's bearings, the cover behind the valve plate, the reaction
to the shaft's torque, and the outlet pipe.
"""


@dataclass(frozen=True)
class Damage(Fault):
    """Damage of a pump of version 3."""

    extent: float
    """Severity over the typical one."""
    mode: str
    """Name in `MODES`."""
    piston: int = 0
    """Index of the piston, bore or slipper, if the damage concerns one."""
    angle: float = math.radians(270)
    """Angle from top dead center at which the damage lies or is loaded [rad]."""
    half_width: float = math.radians(20)
    """Half of its length [rad]."""
    second: "Damage | None" = None
    """Second damage, if this is a compound of two."""

    @property
    def label(self) -> str:  # type: ignore[override]
        """Class of the damage."""
        if self.second:
            return "compound"

        return next(label for label, modes in MODES.items() if self.mode in modes)


def find_damage(fault: Fault | None, mode: str) -> Damage:
    """Return the damage of a mode in a run's fault, or one of extent 0 if the run lacks it."""
    while isinstance(fault, Damage):
        if fault.mode == mode:
            return fault
        fault = fault.second

    return Damage(0.0, mode)


def draw_fault(label: str, pistons: int, seed: int, purpose: str) -> Damage | None:
    """Return the damage of a pump of class `label`, or `None` if it is healthy.

    Parameters
    ----------
    pistons : number of pistons.
    purpose : addresses the random stream of all recordings that share one damaged part.
    """
    if label == "normal":
        return None

    rng = random_stream(seed, "fault of version 3", label, purpose)
    if label == "compound":
        first_label, second_label = rng.permutation(CLASSES[1:])[:2].tolist()
        first = draw_fault(first_label, pistons, seed, purpose)
        assert first is not None  # classes after the first are faults
        return replace(first, second=draw_fault(second_label, pistons, seed, purpose))

    return Damage(
        extent=float(np.exp(rng.normal(0, SEVERITY_SPREAD))),
        mode=str(rng.choice(MODES[label])),
        piston=int(rng.integers(pistons)),
        angle=deg(rng.uniform(215, 325)),
        half_width=deg(rng.uniform(13, 26)),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class ThirdSpecimen(Specimen):
    """One pump of version 3.

    Of the inherited fields, `values` are totals of the contacts, `housing` holds the flexible
    modes, and `unloaded` is the stiffness of the retainer over that of a slipper's film.
    """

    design: Design
    rigid: Float[np.ndarray, " 6"]
    """Resonances of the shell on its mounting along and about x, y, z [Hz]."""
    mounting: Float[np.ndarray, " sensor"]
    """Resonance of each sensor on its mounting [Hz]."""
    drives: Float[np.ndarray, "path mode"]
    """Excitation of each flexible mode by each path."""
    plays: Float[np.ndarray, " piston"]
    """Play of each slipper between plate and retainer [m]."""
    volumes: Float[np.ndarray, " piston"]
    """Dead volume of each chamber [m^3]."""
    shifts: Float[np.ndarray, "port edge"]
    """Delay of the beginning and end of each port against the drawing [rad]."""
    spacing: Float[np.ndarray, " piston"]
    """Error of the angle of each bore [rad]."""
    waviness: Float[np.ndarray, "2 3"]
    """Cosines and sines of the swash plate's unevenness, once to three times a turn [m]."""
    unbalance: float
    """Eccentricity of the rotor's center of mass [m]."""
    line: Float[np.ndarray, " 2"]
    """Volume of the outlet [m^3] and resonance of its pipe [Hz]."""
    noise: Float[np.ndarray, " 4"]
    """Loudness of jets, leakage and rubbing, and the free air, over the typical ones."""
    foreign: Float[np.ndarray, "sensor line"]
    """Amplitudes [m/s^2] of `measuring.foreign_lines`."""
    slip: float
    """Slip of the motor at 15 MPa."""
    gauge: float
    """Ratio of true to specified pressure."""

    def reassemble(self, seed: int, recording: str) -> "ThirdSpecimen":
        """Return the same pump as assembled and mounted for `recording`."""
        # The order of the draws is part of the rig.
        rng = random_stream(seed, "assembly of version 3", recording)
        housing = self.housing
        housing = replace(
            housing,
            gain=housing.gain * np.exp(rng.normal(0, 0.05, (len(housing.gain), 1))),
            frequency=_vary(rng, housing.frequency, 0.006),
            damping_ratio=_vary(rng, housing.damping_ratio, 0.1),
        )

        return replace(
            self,
            values=_vary(rng, self.values, 0.1),
            rigid=_vary(rng, self.rigid, 0.05),
            drives=_vary(rng, self.drives, 0.07),
            plays=_vary(rng, self.plays, 0.07),
            mounting=_vary(rng, self.mounting, 0.05),
            housing=housing,
        )

    def truth(self) -> dict[str, object]:
        """Return design and mounting, for the scoring file."""
        return {"design": self.design.name, "rigid": self.rigid.tolist()}


def _vary(
    rng: np.random.Generator, typical: Float[np.ndarray, "*axes"], deviation: float
) -> Float[np.ndarray, "*axes"]:
    """Return values whose logarithm has a standard `deviation` around that of the typical ones."""
    return np.asarray(typical * np.exp(rng.normal(0, deviation, typical.shape)))


def draw_specimen(nominal: Pump, name: str, seed: int) -> ThirdSpecimen:
    """Return pump `name` of version 3's fleet of `seed`.

    The two designs alternate along the alphabet. The `pump` of the specimen is what a user makes of
    the nameplate: the nominal pump scaled, not the true one.
    """
    first_design = int(random_stream(seed, "fleet of version 3").integers(2))
    design = DESIGNS[(first_design + ord(name[0])) % 2]
    piston_count = design.nameplate.piston_count
    sensor_count = len(nominal.sensors)
    flexible = np.array(design.flexible)
    drive_scale = 0.012 * (flexible / 1000) ** 1.3
    typical_drives, shapes = _draw_mode_shapes(design, sensor_count)

    # The order of the draws is part of the rig: another order gives other pumps.
    rng = random_stream(seed, "specimen of version 3", name)
    values = _vary(rng, np.array(design.contacts), 0.22)
    clearances = design.piston_diameter * 7e-4 * rng.normal(1, 0.16, piston_count)

    return ThirdSpecimen(
        name=name,
        pump=scaled_pump(nominal, design.nameplate, design.name),
        values=values,
        mount=1.0,
        bearing=1.0,
        clearances=tuple(np.clip(clearances, um(7), None).tolist()),
        unloaded=float(rng.uniform(0.2, 0.5)),
        following=1.0,
        following_cutoff=math.inf,
        housing=Housing(
            frequency=_vary(rng, flexible, 0.03),
            damping_ratio=rng.uniform(0.012, 0.045, len(flexible)),
            residue=shapes + rng.normal(0, 0.15, shapes.shape),
            gain=_draw_gain(rng, sensor_count),
        ),
        film_exponent=float(rng.uniform(0.5, 1.0)),
        design=design,
        rigid=_vary(rng, np.array(design.rigid), 0.12),
        drives=drive_scale * (typical_drives * rng.normal(1, 0.25, typical_drives.shape)),
        plays=1e-6 * rng.uniform(12, 35, piston_count),
        volumes=design.dead_volume * rng.normal(1, 0.02, piston_count),
        shifts=np.radians(rng.normal(0, 0.6, (2, 2))),
        spacing=np.radians(rng.normal(0, 0.15, piston_count)),
        waviness=1e-6 * rng.normal(0, 1.5, (2, 3)),
        unbalance=float(_vary(rng, np.array(um(8)), 0.5)),
        line=_vary(rng, np.array([2.2e-4, 420.0]), 0.2),
        noise=_vary(rng, np.ones(4), 0.25),
        foreign=_vary(rng, np.tile(FOREIGN_AMPLITUDES, (sensor_count, 1)), 0.6),
        mounting=rng.uniform(6500, 11500, sensor_count),
        slip=float(rng.uniform(0.006, 0.014)),
        gauge=float(rng.normal(1, 0.012)),
    )


def _draw_mode_shapes(
    design: Design, sensor_count: int
) -> tuple[Float[np.ndarray, "path mode"], Float[np.ndarray, "sensor mode"]]:
    """Return the excitation of the housing's modes by each path, and their share in each sensor.

    All pumps of a design share them, whichever the fleet.
    """
    rng = random_stream(0, "design of version 3", design.name)
    modes = len(design.flexible)
    drives = rng.normal(0, 0.5, (len(PATHS), modes))
    shapes = rng.normal(0, 0.6, (sensor_count, modes))

    # Every third mode stretches the housing between swash plate and cover.
    drives[PATHS.index("swash_z"), ::3] -= 1.0
    drives[PATHS.index("cover_z"), ::3] += 1.0

    # A moment is a pair of forces on an arm.
    moments = [PATHS.index(path) for path in PATHS if "tilt" in path or path == "roll"]
    drives[moments] *= 18

    return drives, shapes


def _draw_gain(rng: np.random.Generator, sensor_count: int) -> Float[np.ndarray, "sensor sensor"]:
    gains = np.diag(rng.normal(1, 0.05, sensor_count))
    return gains + rng.normal(0, 0.04, (sensor_count, sensor_count))
