"""The hidden truth of version 3: two designs, the pumps of a fleet, how they are put together and
what is wrong.

Everything is drawn from streams of its own. Numbers without a source are estimates in the ranges of
docs/explanation/physics.md, section 4, moved to another maker's sizes.
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
    """What all pumps of one design have in common.

    Kidneys begin and end at angles from top dead center [rad]. Before each lies a relief of an
    angle and a largest area [m^2]: a ``groove`` that widens, or a ``hole``. Masses are of shell,
    rotor and one piston with its slipper [kg]; contacts are totals of damping and stiffness at 45
    degC and 10 MPa, as `pump.PARAMETERS`. Resonances [Hz] are of the shell on its mounting (along
    x, y, z, about x, y, z), of the housing, and of the rotor in its bearings. A flaw on the outer
    and inner race of the block's roller bearing is passed so often a turn.
    """

    name: str
    nameplate: Nameplate
    piston_diameter: float
    pitch_radius: float
    swash_angle: float
    dead_volume: float
    suction: tuple[float, float]
    discharge: tuple[float, float]
    relief: str
    relief_angle: float
    relief_area: float
    masses: tuple[float, float, float]
    contacts: tuple[float, ...]
    rigid: tuple[float, ...]
    flexible: tuple[float, ...]
    rotor_mode: float
    race: tuple[float, float]
    charge_teeth: int

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
        "seven", Nameplate(45e-6, 7, rpm(1500), MPa(25), deg(17.5), 27.0), mm(19), mm(36), deg(17.5), 4.2e-6,
        (deg(11), deg(179)), (deg(193), deg(359)), "groove", deg(11), 7e-6, (21.0, 5.2, 0.17),
        (4.2e4, 6e7, 3.2e4, 2.1e8, 1.4e4, 1.1e8), (118.0, 156.0, 265.0, 330.0, 385.0, 210.0),
        (820.0, 1240.0, 1610.0, 2330.0, 3050.0, 3900.0, 5100.0, 6800.0), 1080.0, (6.41, 8.59), 11,
    ),
    Design(
        "nine", Nameplate(71e-6, 9, rpm(1500), MPa(28), deg(16.7), 36.0), mm(20), mm(42), deg(16.7), 5.5e-6,
        (deg(13), deg(178)), (deg(195), deg(358)), "hole", deg(11), 2.4e-6, (28.0, 8.6, 0.21),
        (6.5e4, 1.1e8, 5.5e4, 3.4e8, 2.2e4, 1.7e8), (92.0, 140.0, 215.0, 255.0, 310.0, 175.0),
        (650.0, 980.0, 1420.0, 1880.0, 2750.0, 3400.0, 4600.0, 6100.0), 860.0, (7.83, 10.17), 9,
    ),
)  # fmt: skip
"""Both designs. Films are of 3 W / h and thicker than the twin's (physics.md, section 4); housings
resonate above 0.65 kHz, where the twin's shell is rigid.
"""

MODES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "swash_plate": ("recess", "scoring"), "cylinder_block": ("bore", "face"), "piston": ("scuffed",),
        "valve_plate": ("scratch", "erosion", "wear"), "loose_slipper": ("loose",), "bearing_race": ("race",),
        "cavitation": ("cavitation",),
    }
)  # fmt: skip
"""How each class fails."""
LABELS = (*CLASSES, "loose_slipper", "bearing_race", "cavitation", "compound")
"""All classes that version 3 records: the paper's five, and four that are none of them."""


@dataclass(frozen=True)
class Damage(Fault):
    """What is wrong with a pump of version 3."""

    extent: float
    """Severity over the typical one."""
    mode: str
    """Name in `MODES`."""
    piston: int = 0
    """Which piston, bore or slipper, from 0, where it concerns one."""
    angle: float = math.radians(270)
    """Where it lies or is loaded, from top dead center [rad]."""
    half_width: float = math.radians(20)
    """Half of its length [rad]."""
    second: "Damage | None" = None
    """What else is wrong, in a compound of two."""

    @property
    def label(self) -> str:  # type: ignore[override]
        """Class of the damage."""
        return (
            "compound"
            if self.second
            else next(label for label, modes in MODES.items() if self.mode in modes)
        )


def find_damage(fault: Fault | None, mode: str) -> Damage:
    """The damage of that mode in a run's fault, of extent 0 where there is none."""
    while isinstance(fault, Damage):
        if fault.mode == mode:
            return fault
        fault = fault.second
    return Damage(0.0, mode)


def draw_fault(label: str, pistons: int, seed: int, purpose: str) -> Damage | None:
    """What is wrong with a pump of class `label`; severities spread by exp(+-0.4).

    Parameters
    ----------
    purpose : addresses the random stream, of all recordings that share one damaged part.
    """
    rng = random_stream(seed, "fault of version 3", label, purpose)
    if label == "compound":
        one, other = (
            draw_fault(str(part), pistons, seed, purpose)
            for part in rng.permutation(CLASSES[1:])[:2]
        )
        return None if one is None else replace(one, second=other)
    return None if label == "normal" else Damage(
        extent=float(np.exp(rng.normal(0, 0.4))),
        mode=str(rng.choice(MODES[label])),
        piston=int(rng.integers(pistons)),
        angle=deg(rng.uniform(215, 325)),
        half_width=deg(rng.uniform(13, 26)),
    )  # fmt: skip


PATHS = ("swash_y", "swash_z", "swash_tilt_x", "swash_tilt_y", "rotor_y", "rotor_tilt_x", "rotor_tilt_y", "rotor_x",
         "cover_z", "roll", "pipe")  # fmt: skip
"""Ways by which forces [N] and moments [N m] reach the housing: from the swash plate, the rotor's
bearings, the cover behind the valve plate, the reaction to the shaft's torque, and the outlet
pipe.
"""


@dataclass(frozen=True, eq=False, kw_only=True)
class ThirdSpecimen(Specimen):
    """One pump of version 3.

    Its `values` are totals of its contacts, its `housing` holds the flexible modes, `unloaded` is
    the retainer's stiffness over a slipper film's. `rigid` are resonances of the shell on its
    mounting, `mounting` of each sensor on its place [Hz]; `drives` says how far each path excites
    each flexible mode. `plays` are of each slipper between plate and retainer [m], `volumes` dead
    volumes [m^3], `shifts` how much later than drawn each port begins and ends, `spacing` errors of
    the bores [rad], `waviness` the swash plate's out of flatness, once to three times a turn, and
    `unbalance` the rotor's [m]. `line` is the outlet's volume [m^3] and its pipe's resonance [Hz].
    `noise` is the loudness of jets, leakage and rubbing, and the free air, over the typical,
    `foreign` the amplitudes [m/s^2] of `measuring.foreign_lines`, `slip` the motor's at 15 MPa,
    `gauge` the true over the stated pressure.
    """

    design: Design
    rigid: Float[np.ndarray, " 6"]
    mounting: Float[np.ndarray, " sensor"]
    drives: Float[np.ndarray, "path mode"]
    plays: Float[np.ndarray, " piston"]
    volumes: Float[np.ndarray, " piston"]
    shifts: Float[np.ndarray, "port edge"]
    spacing: Float[np.ndarray, " piston"]
    waviness: Float[np.ndarray, "2 3"]
    unbalance: float
    line: Float[np.ndarray, " 2"]
    noise: Float[np.ndarray, " 4"]
    foreign: Float[np.ndarray, "sensor line"]
    slip: float
    gauge: float

    def reassemble(self, seed: int, recording: str) -> "ThirdSpecimen":
        """The same pump as put together and bolted down for what `recording` names."""
        rng, housing = random_stream(seed, "assembly of version 3", recording), self.housing
        off = lambda value, deviation: value * np.exp(rng.normal(0, deviation, value.shape))  # noqa: E731
        gain = housing.gain * np.exp(rng.normal(0, 0.05, (len(housing.gain), 1)))
        frequency, damping_ratio = off(housing.frequency, 0.006), off(housing.damping_ratio, 0.1)
        return replace(
            self,
            values=off(self.values, 0.1),
            rigid=off(self.rigid, 0.05),
            drives=off(self.drives, 0.07),
            plays=off(self.plays, 0.07),
            mounting=off(self.mounting, 0.05),
            housing=replace(housing, frequency=frequency, damping_ratio=damping_ratio, gain=gain),
        )

    def truth(self) -> dict[str, object]:
        """Design and mounting, for the scoring file."""
        return {"design": self.design.name, "rigid": self.rigid.tolist()}


def draw_specimen(nominal: Pump, name: str, seed: int) -> ThirdSpecimen:
    """Pump `name` of version 3's fleet of `seed`; neighbors in the alphabet are of different
    designs.

    Its `pump` is what a user makes of the nameplate: the nominal pump scaled, not this one.
    """
    design = DESIGNS[
        (int(random_stream(seed, "fleet of version 3").integers(2)) + ord(name[0])) % 2
    ]
    rng, built = (
        random_stream(seed, "specimen of version 3", name),
        random_stream(0, "design of version 3", design.name),
    )
    count, sensors, flexible = (
        design.nameplate.piston_count,
        len(nominal.sensors),
        np.array(design.flexible),
    )
    drives, shapes = (
        built.normal(0, level, (rows, len(flexible)))
        for level, rows in ((0.5, len(PATHS)), (0.6, sensors))
    )
    drives[[1, 8], ::3] += [
        [-1.0],
        [1.0],
    ]  # every third mode stretches the housing between swash plate and cover
    drives[[2, 3, 5, 6, 9]] *= 18  # a moment is a pair of forces on an arm
    vary = lambda typical, deviation: typical * np.exp(rng.normal(0, deviation, np.shape(typical)))  # noqa: E731
    return ThirdSpecimen(
        name=name,
        pump=scaled_pump(nominal, design.nameplate, design.name),
        values=vary(np.array(design.contacts), 0.22),
        mount=1.0,
        bearing=1.0,
        clearances=tuple(
            np.clip(
                design.piston_diameter * 7e-4 * rng.normal(1, 0.16, count), um(7), None
            ).tolist()
        ),
        unloaded=float(rng.uniform(0.2, 0.5)),
        following=1.0,
        following_cutoff=math.inf,
        housing=Housing(
            frequency=vary(flexible, 0.03),
            damping_ratio=rng.uniform(0.012, 0.045, len(flexible)),
            residue=shapes + rng.normal(0, 0.15, shapes.shape),
            gain=np.diag(rng.normal(1, 0.05, sensors)) + rng.normal(0, 0.04, (sensors, sensors)),
        ),
        film_exponent=float(rng.uniform(0.5, 1.0)),
        design=design,
        rigid=vary(np.array(design.rigid), 0.12),
        drives=0.012 * (flexible / 1000) ** 1.3 * (drives * rng.normal(1, 0.25, drives.shape)),
        plays=1e-6 * rng.uniform(12, 35, count),
        volumes=design.dead_volume * rng.normal(1, 0.02, count),
        shifts=np.radians(rng.normal(0, 0.6, (2, 2))),
        spacing=np.radians(rng.normal(0, 0.15, count)),
        waviness=1e-6 * rng.normal(0, 1.5, (2, 3)),
        unbalance=float(vary(um(8), 0.5)),
        line=vary(np.array([2.2e-4, 420.0]), 0.2),
        noise=vary(np.ones(4), 0.25),
        foreign=vary(np.tile([0.02, 0.015, 0.03, 0.05, 0.06, 0.02], (sensors, 1)), 0.6),
        mounting=rng.uniform(6500, 11500, sensors),
        slip=float(rng.uniform(0.006, 0.014)),
        gauge=float(rng.normal(1, 0.012)),
    )
