"""The hidden truth of the virtual rig: a fleet of pumps that differ, and what is wrong with each at
a time.

Nothing here is known to a twin. What the twin's physics does not contain at all is marked with a
star:

- interface values away from the nominal ones, and different from pump to pump;
- mounting and bearings that differ from the drawing;
- piston clearances that scatter*, so that a healthy pump has once-per-revolution content;
- slippers that are unloaded on the suction side*, a film stiffness that turns with the shaft;
- a slipper that follows a recess only in part and not at once*;
- a flexible housing* with four modes above 1 kHz (where a real pump housing was measured to
  resonate), different for each axis, and sensors with gain errors, cross-talk* and a finite band;
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
"""Truth over nominal of the six interface values, fleet mean; C_sw and C_Hz move as the paper found
them to.
"""

DISPERSION = 0.18
"""Standard deviation of ln(interface value) between pumps."""

HOUSING_MODES = (1717.0, 2967.0, 3600.0, 4450.0)
"""Fleet mean resonances [Hz] of the flexible housing; the first three were measured on a real front
housing.
"""


@dataclass(frozen=True, eq=False)
class Housing:
    """Path from the rigid shell to the samples of the accelerometers."""

    frequency: Float[np.ndarray, " mode"]
    """Resonances [Hz]."""
    damping_ratio: Float[np.ndarray, " mode"]
    """Modal damping ratios."""
    residue: Float[np.ndarray, "sensor mode"]
    """Share of each mode in each sensor."""
    gain: Float[np.ndarray, "sensor sensor"]
    """Sensor gains on the diagonal, cross-talk beside it."""

    def response(self, frequency: Float[np.ndarray, " line"]) -> Complex[np.ndarray, "sensor line"]:
        """Complex factor on the shell's acceleration at `frequency` [Hz]."""
        ratio = frequency[:, None] / self.frequency
        modes = ratio**2 / (1 - ratio**2 + 2j * self.damping_ratio * ratio)
        return 1 + np.einsum("sm,lm->sl", self.residue, modes)


@dataclass(frozen=True, eq=False)
class Specimen:
    """One pump of the fleet, as it truly is."""

    name: str
    """Name on its plate."""
    pump: Pump
    """Parameter set with this pump's tolerances."""
    values: Float[np.ndarray, " 6"]
    """True interface values at 45 degC and 10 MPa, in the order of `pump.PARAMETERS`."""
    mount: float
    """True over nominal stiffness of the mounting."""
    bearing: float
    """True over nominal stiffness of the bearings."""
    clearances: tuple[float, ...]
    """Radial clearance of each piston [m]."""
    unloaded: float
    """Stiffness of a slipper on the suction side over that of a loaded one."""
    following: float
    """How far slippers follow a recess, 0...1 and a little above."""
    following_cutoff: float
    """Frequency [Hz] above which they no longer do."""
    housing: Housing
    supports: Float[np.ndarray, " 7"] | None = None
    """True over nominal stiffness of each part of mounting and bearings
    (`Structure.support_parts`), if not 1.
    """
    film_exponent: float = 1.0
    """Power of the viscosity that the films' dampings follow."""
    hangs_free: bool = False
    """Whether a piston over a defect of its bush hangs free where the film would have to pull; no
    force stands still then.
    """

    def reassemble(self, seed: int, recording: str) -> "Specimen":
        """The same pump after reassembly, which changing a part needs: films and sensors do not sit
        as before.
        """
        rng = random_stream(seed, "assembly", recording)
        gain = self.housing.gain + _cross_talk(rng, 0.1, len(self.housing.gain))
        housing = replace(self.housing, gain=gain)
        return replace(
            self,
            values=self.values * np.exp(rng.normal(0, 0.12, self.values.size)),
            housing=housing,
        )

    def truth(self) -> dict[str, object]:
        """What differs from pump to pump beside the interface values, for the scoring file."""
        return {"mount": self.mount, "bearing": self.bearing}

    def true_values(self) -> dict[str, float]:
        """Interface values by name, for the scoring file."""
        return dict(zip(PARAMETERS, (float(value) for value in self.values), strict=True))


def _cross_talk(
    rng: np.random.Generator, deviation: float, sensors: int
) -> Float[np.ndarray, "sensor sensor"]:
    """What each sensor takes from the others: of many as much together as of the two others among
    three.
    """
    deviation *= math.sqrt(2 / (sensors - 1))
    return rng.normal(0, deviation, (sensors, sensors)) * (1 - np.eye(sensors))


def _housing(rng: np.random.Generator, sensors: int) -> Housing:
    modes = len(HOUSING_MODES)
    gain = np.diag(rng.normal(1, 0.04, sensors)) + _cross_talk(rng, 0.07, sensors)
    return Housing(
        frequency=np.array(HOUSING_MODES) * rng.normal(1, 0.03, modes),
        damping_ratio=rng.uniform(0.02, 0.045, modes),
        residue=rng.normal(0, 0.06, (sensors, modes)),
        gain=gain,
    )


def draw_specimen(nominal: Pump, name: str, seed: int) -> Specimen:
    """Pump `name` of the fleet of `seed`."""
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
    return Specimen(
        name=name,
        pump=replace(nominal, masses=masses, valve_plate=plate),
        values=np.array(nominal.interfaces.values()) * factors,
        mount=float(np.exp(rng.normal(0, 0.03))),
        bearing=float(np.exp(rng.normal(0, 0.03))),
        clearances=tuple(float(clearance) for clearance in np.clip(clearances, 8e-6, None)),
        unloaded=float(rng.uniform(0.3, 0.6)),
        following=float(rng.uniform(0.85, 1.1)),
        following_cutoff=float(rng.uniform(1200, 1800)),
        housing=_housing(rng, len(nominal.sensors)),
    )


RECESS = SwashPlateDefect(depth=mm(0.07), length=mm(30), width=mm(24))
"""The machined recess: the paper's length and width, and a depth near what rejects a pump (0.1 mm
of swash plate wear, Grundfos BMP manual). At the paper's 0.6 mm the level alone would separate
every window.
"""

PAPER_RECESS = SwashPlateDefect(depth=mm(0.6), length=mm(30), width=mm(24))
"""The paper's recess, in version ``1-deep``: films pull the slippers through it, as in the paper's
model.
"""


def draw_fault(
    label: str, specimen: str, seed: int, *purpose: object, is_deep: bool = False
) -> Fault | None:
    """What is wrong with a pump of class `label` in one recording; its severity spreads around the
    class's typical one.

    A recess is machined once into each pump, so its place differs from pump to pump only.

    Parameters
    ----------
    purpose : addresses the random stream of one recording.
    is_deep : the recess is the paper's, of the same depth in every pump.
    """
    rng = random_stream(seed, "fault", label, *purpose)
    spread = float(np.exp(rng.normal(0, 0.2)))
    if label == "swash_plate":
        angle = deg(270 + random_stream(seed, "recess", specimen).normal(0, 0.5))
        return replace(PAPER_RECESS if is_deep else RECESS.scaled(spread), angle=angle)
    if label == "piston":
        return PistonWear(clearance=um(60) * spread, piston=int(rng.integers(7)))
    if label == "cylinder_block":
        return BoreDefect(
            depth=um(270) * spread, bore=int(rng.integers(7)), half_width=deg(rng.uniform(36, 44))
        )
    if label == "valve_plate":
        if rng.random() < 0.5:
            return DamScratch(area=0.8e-6 * spread)
        return GrooveErosion(advance=deg(5) * min(spread, 1.4))
    return None


def film_factors(pressure: float, relative_viscosity: float) -> Float[np.ndarray, " 6"]:
    """Factors on the six interface values at a discharge pressure [Pa] and a viscosity over that at
    45 degC.

    Dampings follow the viscosity (the pistons', of which only part is film, its square root); a
    film thins as the load grows, which raises all values by (p / 10 MPa)^0.1.
    """
    thinning = math.pow(pressure / 10e6, 0.1)
    damping = relative_viscosity * thinning
    return np.array([damping, thinning, damping, thinning, math.sqrt(damping), thinning])
