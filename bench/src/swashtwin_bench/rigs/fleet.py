"""The hidden truth of the virtual rig: a fleet of different pumps, and the faults they have.

The twin knows nothing of this. Effects that its physics does not contain at all have a star:

- interface values that differ from the nominal ones, and from pump to pump;
- mounting and bearings that differ from the drawing;
- piston clearances that scatter*, so that a healthy pump has once-per-revolution content;
- slippers that are unloaded on the suction side*: a film stiffness that turns with the shaft;
- slippers that follow a recess only in part and with a delay*;
- a flexible housing* with four modes above 1 kHz, different for each axis (a real pump housing was
  measured to resonate in this range), and sensors with gain errors, cross-talk* and a finite band;
- films that thin with pressure and warm oil*.
"""

import math
from dataclasses import dataclass, replace

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

FLEET_FACTORS = (0.45, 0.7, 1.6, 0.75, 3.2, 0.7)
"""Ratio of true to nominal interface values, mean of the fleet.

C_sw and C_Hz move in the direction that the paper reports.
"""

DISPERSION = 0.18
"""Standard deviation of ln(interface value) between pumps."""

HOUSING_MODES = (1717.0, 2967.0, 3600.0, 4450.0)
"""Resonances [Hz] of the flexible housing, mean of the fleet.

The first three were measured on a real front housing.
"""

WIDE_VALUE_SPREAD = 0.7
"""Largest |ln| of an interface value over the fleet's mean in the wide spread: a factor of 2."""

WIDE_SUPPORT_SPREAD = 0.5
"""Largest |ln| of the stiffness of mounting and of bearings over the drawing's in the wide spread:
a factor of 1.65, as brackets and preloads differ from plant to plant.
"""

MIN_CLEARANCE_M = 8e-6
"""Smallest radial clearance of a piston [m]: a bound on rare draws."""


@dataclass(frozen=True, eq=False)
class Housing:
    """Path from the rigid shell to the accelerometers."""

    frequency: Float[np.ndarray, " mode"]
    """Resonances [Hz]."""
    damping_ratio: Float[np.ndarray, " mode"]
    """Modal damping ratios."""
    residue: Float[np.ndarray, "sensor mode"]
    """Share of each mode in each sensor."""
    gain: Float[np.ndarray, "sensor sensor"]
    """Sensor gains on the diagonal, cross-talk off the diagonal."""

    def response(self, frequency: Float[np.ndarray, " line"]) -> Complex[np.ndarray, "sensor line"]:
        """Return the complex factor on the shell's acceleration at `frequency` [Hz]."""
        ratio = frequency[:, None] / self.frequency
        modes = ratio**2 / (1 - ratio**2 + 2j * self.damping_ratio * ratio)

        return 1 + np.einsum("sm,lm->sl", self.residue, modes)


@dataclass(frozen=True, eq=False)
class Specimen:
    """One pump of the fleet with its true properties."""

    name: str
    """Name of the pump, such as ``"A"``."""
    pump: Pump
    """Parameter set with this pump's tolerances."""
    values: Float[np.ndarray, " 6"]
    """True interface values at 45 degC and 10 MPa, in the order of `pump.PARAMETERS`."""
    mount: float
    """Ratio of true to nominal stiffness of the mounting."""
    bearing: float
    """Ratio of true to nominal stiffness of the bearings."""
    clearances: tuple[float, ...]
    """Radial clearance of each piston [m]."""
    unloaded: float
    """Ratio of the stiffness of a slipper on the suction side to that of a loaded one."""
    following: float
    """Share of a recess's depth that slippers follow, 0...1 and a little above."""
    following_cutoff: float
    """Frequency [Hz] above which slippers no longer follow a recess."""
    housing: Housing
    supports: Float[np.ndarray, " 7"] | None = None
    """Ratio of true to nominal stiffness of each part of mounting and bearings, if not 1.

    The parts are those of `Structure.support_parts`.
    """
    film_exponent: float = 1.0
    """Exponent of the viscosity in the films' dampings."""
    hangs_free: bool = False
    """Whether a piston over a defect of its bush hangs free when the film would have to pull.

    No force is then applied at order 0.
    """

    def reassemble(self, seed: int, recording: str) -> "Specimen":
        """Return the same pump after reassembly.

        A part can only be changed by taking the pump apart, after which the films and the sensors
        differ a little.
        """
        rng = random_stream(seed, "assembly", recording)
        gain = self.housing.gain + _draw_cross_talk(rng, 0.1, len(self.housing.gain))
        values = self.values * np.exp(rng.normal(0, 0.12, self.values.size))

        return replace(self, values=values, housing=replace(self.housing, gain=gain))

    def truth(self) -> dict[str, object]:
        """Return what differs between pumps besides the interface values, for the scoring file."""
        return {"mount": self.mount, "bearing": self.bearing}

    def true_values(self) -> dict[str, float]:
        """Return the interface values by name, for the scoring file."""
        return dict(zip(PARAMETERS, (float(value) for value in self.values), strict=True))


def _draw_cross_talk(
    rng: np.random.Generator, deviation: float, sensors: int
) -> Float[np.ndarray, "sensor sensor"]:
    """Return the share of each sensor in the reading of every other one.

    `deviation` holds for three sensors. With more sensors each share is smaller, so that the
    cross-talk in a reading keeps its power.
    """
    deviation *= math.sqrt(2 / (sensors - 1))

    return rng.normal(0, deviation, (sensors, sensors)) * (1 - np.eye(sensors))


def _draw_housing(rng: np.random.Generator, sensors: int) -> Housing:
    modes = len(HOUSING_MODES)
    gain = np.diag(rng.normal(1, 0.04, sensors)) + _draw_cross_talk(rng, 0.07, sensors)

    return Housing(
        frequency=np.array(HOUSING_MODES) * rng.normal(1, 0.03, modes),
        damping_ratio=rng.uniform(0.02, 0.045, modes),
        residue=rng.normal(0, 0.06, (sensors, modes)),
        gain=gain,
    )


def draw_specimen(nominal: Pump, name: str, seed: int) -> Specimen:
    """Return pump `name` of the fleet of `seed`."""
    # The order of the draws is part of the rig: another order gives other pumps.
    rng = random_stream(seed, "specimen", name)
    factors = np.array(FLEET_FACTORS) * np.exp(rng.normal(0, DISPERSION, len(PARAMETERS)))

    masses = replace(
        nominal.masses, rotor_eccentricity=nominal.masses.rotor_eccentricity * rng.lognormal(0, 0.4)
    )
    plate = replace(
        nominal.valve_plate,
        discharge_open=nominal.valve_plate.discharge_open + deg(rng.normal(0, 0.5)),
        suction_open=nominal.valve_plate.suction_open + deg(rng.normal(0, 0.5)),
    )

    group = nominal.rotating_group
    clearances = group.piston_clearance * rng.normal(1, 0.12, group.piston_count)
    clearances = np.clip(clearances, MIN_CLEARANCE_M, None)

    return Specimen(
        name=name,
        pump=replace(nominal, masses=masses, valve_plate=plate),
        values=np.array(nominal.interfaces.values()) * factors,
        mount=float(np.exp(rng.normal(0, 0.03))),
        bearing=float(np.exp(rng.normal(0, 0.03))),
        clearances=tuple(clearances.tolist()),
        unloaded=float(rng.uniform(0.3, 0.6)),
        following=float(rng.uniform(0.85, 1.1)),
        following_cutoff=float(rng.uniform(1200, 1800)),
        housing=_draw_housing(rng, len(nominal.sensors)),
    )


def draw_wide_specimen(nominal: Pump, name: str, seed: int) -> Specimen:
    """Return pump `name` of the fleet of `seed`, further from its drawing than `draw_specimen`.

    Interface values, mounting and bearings are drawn anew, uniformly in the logarithm so that no
    pump lies beyond the limits. Everything else is that of `draw_specimen`.
    """
    rng = random_stream(seed, "wide spread", name)
    factors = np.exp(rng.uniform(-WIDE_VALUE_SPREAD, WIDE_VALUE_SPREAD, len(PARAMETERS)))
    mount, bearing = np.exp(rng.uniform(-WIDE_SUPPORT_SPREAD, WIDE_SUPPORT_SPREAD, 2)).tolist()

    return replace(
        draw_specimen(nominal, name, seed),
        values=np.array(nominal.interfaces.values()) * np.array(FLEET_FACTORS) * factors,
        mount=mount,
        bearing=bearing,
    )


RECESS = SwashPlateDefect(depth=mm(0.07), length=mm(30), width=mm(24))
"""The machined recess: the paper's length and width, with a smaller depth.

The depth is near the wear that rejects a pump (0.1 mm of the swash plate, Grundfos BMP manual). At
the paper's 0.6 mm the loudness alone would separate every window.
"""

PAPER_RECESS = SwashPlateDefect(depth=mm(0.6), length=mm(30), width=mm(24))
"""The paper's recess, in version ``1-deep``.

Films pull the slippers through it, as in the paper's model.
"""

SEVERITY_SPREAD = 0.2
"""Standard deviation of ln(severity) between recordings of a class."""

MAX_EROSION_SPREAD = 1.4
"""Largest severity of an eroded groove over the typical one.

It limits the advance to 7 deg; 6 deg is already much (`GrooveErosion`).
"""


def draw_fault(
    label: str, specimen: str, seed: int, *purpose: object, is_deep: bool = False
) -> Fault | None:
    """Return the fault of a pump of class `label` in one recording, or `None` if it is healthy.

    The severity spreads around the typical one of the class. A recess is machined once into each
    pump, so its angle differs between pumps only.

    Parameters
    ----------
    purpose : addresses the random stream of one recording.
    is_deep : whether the recess is the paper's, of the same depth in every pump.
    """
    rng = random_stream(seed, "fault", label, *purpose)
    spread = float(np.exp(rng.normal(0, SEVERITY_SPREAD)))

    if label == "swash_plate":
        angle = deg(270 + random_stream(seed, "recess", specimen).normal(0, 0.5))
        recess = PAPER_RECESS if is_deep else RECESS.scaled(spread)
        return replace(recess, angle=angle)

    if label == "piston":
        return PistonWear(clearance=um(60) * spread, piston=int(rng.integers(7)))

    if label == "cylinder_block":
        return BoreDefect(
            depth=um(270) * spread, bore=int(rng.integers(7)), half_width=deg(rng.uniform(36, 44))
        )

    if label == "valve_plate":
        if rng.random() < 0.5:
            return DamScratch(area=0.8e-6 * spread)
        return GrooveErosion(advance=deg(5) * min(spread, MAX_EROSION_SPREAD))

    return None


def film_factors(pressure: float, relative_viscosity: float) -> Float[np.ndarray, " 6"]:
    """Return factors on the six interface values for a pressure and an oil temperature.

    Dampings follow the viscosity. Only part of the pistons' damping comes from films, so it follows
    the square root. A film thins as the load grows, which raises all values by (p / 10 MPa)^0.1.

    Parameters
    ----------
    pressure : discharge pressure [Pa].
    relative_viscosity : viscosity of the oil over that at 45 degC.
    """
    thinning = math.pow(pressure / 10e6, 0.1)
    damping = relative_viscosity * thinning

    return np.array([damping, thinning, damping, thinning, math.sqrt(damping), thinning])
