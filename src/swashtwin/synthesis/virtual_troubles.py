"""What is wrong with virtual pumps: a fault of the twin, what its contacts strike, how it raises the noise floor."""

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import deg, mm, um
from swashtwin.pump import (
    BoreDefect,
    DamScratch,
    Fault,
    GrooveErosion,
    LooseSlipper,
    PistonWear,
    Pump,
    SealingLandScratch,
    SwashPlateDefect,
    TiltedBlockFace,
    ValvePlateWear,
)
from swashtwin.synthesis.pump_prior import PumpPrior, log_uniform, spread

OTHER = "other"
"""Class of what is wrong with a pump and is none of the four faults."""


@dataclass(frozen=True, eq=False)
class Impacts:
    """What strikes, once a turn and piston at each of some angles, more or less irregularly."""

    impulse: float
    """Mean impulse [N s]."""
    angles: tuple[float, ...]
    """Angles of a piston [rad] at which it strikes."""
    shares: Float[np.ndarray, " piston"]
    """Share of each piston."""
    direction: int
    """0 along the slippers' contact, 1 across in a bore, 2 along the valve plate's film."""


@dataclass(frozen=True, eq=False)
class Trouble:
    """What is wrong with a pump in one recording."""

    faults: tuple[Fault, ...] = ()
    """Faults of the twin; two are a compound."""
    impacts: tuple[Impacts, ...] = ()
    """Impacts that it adds."""
    noise: float = 0.0
    """Logarithm by which it raises the power of the noise floor."""
    unbalance: float = 1.0
    """Factor on the rotor's eccentricity."""
    bearing: float = 0.0
    """Power of the lines of a damaged bearing over that of a healthy recording."""


def plausible_fault(label: str, rng: np.random.Generator) -> Fault | None:
    """Fault of a class with a severity log-uniform over a decade around what physics.md, section 5, calls plausible.

    The middles: recess 0.1 mm (what rejects a pump), bush 120 um, clearance 40 um, dam scratch 1 mm^2, grooves 2 deg,
    plate film 7 um. A defect is anywhere on the pressure side; a bush is felt over +-20...50 deg. No law of contact is
    known to hold, so a recess is drawn with each.
    """
    factor = float(10 ** rng.uniform(-0.5, 0.5))
    angle = math.radians(rng.uniform(200, 340))
    if label == "swash_plate":
        recess = SwashPlateDefect(depth=mm(0.1) * factor, length=mm(30), width=mm(24), angle=angle)
        return replace(recess, contact=rng.choice(("shared", "lift_off", "physical"), p=(0.5, 0.35, 0.15)))
    if label == "cylinder_block":
        return BoreDefect(depth=um(120) * factor, half_width=deg(rng.uniform(20, 50)), angle=angle)
    if label == "piston":
        return PistonWear(clearance=um(40) * factor)
    if label == "valve_plate":
        kind = rng.random()
        if kind < 0.4:
            return DamScratch(area=1e-6 * factor)
        return GrooveErosion(advance=deg(2) * factor) if kind < 0.8 else ValvePlateWear(film_increase=um(7) * factor)
    return None


@dataclass(frozen=True, eq=False)
class Troubles:
    """Draws what is wrong in recordings of one pump."""

    prior: PumpPrior
    """Widths."""
    rng: np.random.Generator
    """Of the pump."""
    program: int
    """0: a twin's pump; 1: its faults strike; 2: they also raise the noise floor."""
    pump: Pump
    """The pump."""

    def of(self, label: str) -> Trouble:
        """What is wrong in a recording of a class."""
        rng = self.rng
        if label == "normal":
            return Trouble()
        if label == OTHER:
            return self._other()
        fault = plausible_fault(label, rng)
        assert fault is not None
        return Trouble((fault,), self._strikes(fault) if self.program else (), self._noise_rise())

    def _noise_rise(self) -> float:
        return float(self.rng.uniform(0, self.prior.noise_rise)) if self.program == 2 else 0.0

    def _other(self) -> Trouble:
        """What the four classes do not hold."""
        rng, factor = self.rng, float(10 ** self.rng.uniform(-0.5, 0.5))
        rise = self._noise_rise()
        kind = rng.choice(7, p=(0.15, 0.15, 0.1, 0.25, 0.1, 0.15, 0.1))
        if kind == 0:
            return Trouble((SealingLandScratch(conductance=1.2e-12 * factor),), noise=rise)
        if kind == 1:
            return Trouble((LooseSlipper(clearance=mm(0.1) * factor),), noise=rise)
        if kind == 2:
            return Trouble((TiltedBlockFace(variation=min(0.25 * factor, 0.9)),), noise=rise)
        if kind == 3:
            first, second = rng.permutation(["swash_plate", "cylinder_block", "piston", "valve_plate"])[:2]
            faults = tuple(plausible_fault(str(label), rng) for label in (first, second))
            strikes = tuple(item for fault in faults for item in self._strikes(fault)) if self.program else ()
            return Trouble(faults, strikes, rise)  # type: ignore[arg-type]
        if kind == 4:
            return Trouble(noise=float(rng.uniform(0.5, self.prior.noise_rise)))
        if kind == 5:
            return Trouble(noise=rise, bearing=log_uniform(rng, (1e-3, 1.0)))
        return Trouble(noise=rise, unbalance=float(rng.uniform(3, 30)))

    def _strikes(self, fault: Fault | None) -> tuple[Impacts, ...]:
        """Impacts of a fault at the edges of a defect, or where the force on a piston changes its sign."""
        rng = self.rng
        count, impulse = self.pump.rotating_group.piston_count, log_uniform(rng, self.prior.impulse)
        alone, all_pistons = np.eye(count)[0], spread(rng, 0.3, count)
        if isinstance(fault, BoreDefect):
            edges = (fault.angle - fault.half_width, fault.angle + fault.half_width)
            return (Impacts(impulse, _some(edges, rng), alone, 1),)
        if isinstance(fault, SwashPlateDefect):
            reach = fault.length / 2 / self.pump.rotating_group.pitch_radius
            return (Impacts(impulse, _some((fault.angle - reach, fault.angle + reach), rng), all_pistons, 0),)
        if rng.random() < 0.5:  # leakage alone
            return ()
        angles = _some((math.radians(8), math.radians(188)), rng)
        if isinstance(fault, PistonWear):
            return (Impacts(impulse, angles, alone, int(rng.choice([0, 1]))),)
        return (Impacts(impulse, angles, all_pistons, int(rng.choice([0, 2]))),)


def _some(angles: tuple[float, ...], rng: np.random.Generator) -> tuple[float, ...]:
    """One of the angles, or all."""
    return angles if rng.random() < 0.5 else (angles[int(rng.integers(len(angles)))],)
