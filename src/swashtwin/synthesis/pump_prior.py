"""What is taken for granted of pumps that nobody has measured, and what may be wrong with them."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import InputError, MPa, celsius, deg, mm, rpm, um
from swashtwin.physics import SensorPath
from swashtwin.pump import (
    BoreDefect,
    DamScratch,
    Fault,
    GrooveErosion,
    LooseSlipper,
    Nameplate,
    PistonWear,
    Pump,
    SealingLandScratch,
    SwashPlateDefect,
    TiltedBlockFace,
    ValvePlateWear,
    load_pump,
    scaled_pump,
)


@dataclass(frozen=True)
class PumpPrior:
    """Widths of all draws; a standard deviation of a natural logarithm where no unit stands."""

    pump: Pump = field(default_factory=lambda: load_pump("25scy14-1b"))
    """The drawing."""
    speed: tuple[float, float] = (0.4, 1.5)
    """Range of the speed over the rated one, uniform."""
    pressure: tuple[float, float] = (0.15, 1.15)
    """Range of the discharge pressure over the rated one, uniform."""
    interfaces: float = 0.7
    """Of each interface value from pump to pump: 95 % lie within a factor of four of the drawing
    (physics.md, 4: a film of 7.5 or of 10 um).
    """
    assembly: float = 0.15
    """Of each interface value from one assembly of a pump to the next."""
    supports: float = 0.2
    """Of the stiffness of mounting and bearings, each axis and bearing on its own (physics.md:
    +-15...20 %).
    """
    clearances: float = 0.15
    """Of the pistons' clearances, relative."""
    slippers: float = 0.1
    """Of how far each slipper follows a recess (physics.md, 3)."""
    timing: float = deg(0.7)
    """Of the angle at which a port opens [rad]."""
    unbalance: float = 0.5
    """Of the rotor's eccentricity."""
    temperature: tuple[float, float] = (celsius(30), celsius(60))
    """Range of the oil temperature [K], uniform, drawn for each recording."""
    viscosity: tuple[float, float] = (0.4, 1.0)
    """Range of the power with which the films' damping follows the viscosity."""
    speed_setting: float = 0.01
    """Half-width of the speed around the set one, relative: what the product takes for one
    operating point.
    """
    pressure_setting: float = 0.06
    """The same of the discharge pressure."""
    wandering: tuple[float, float] = (0.0005, 0.006)
    """Half-width of the speed's variation within a recording, relative, log-uniform."""
    care: tuple[float, float] = (0.1, 1.0)
    """Range of a pump's share in what differs from recording to recording (assembly, setting,
    sensors), log-uniform: a pump that is never opened and runs at a controlled point differs
    little.
    """
    modes: int = 5
    """Modes of the housing, log-uniform in frequency."""
    mode_frequency: tuple[float, float] = (1000.0, 8000.0)
    """Range of their frequencies [Hz]."""
    mode_share: float = 0.08
    """Standard deviation of a mode's share in a sensor."""
    cross_talk: float = 0.1
    """Standard deviation of what a sensor reads of another one's direction, of a pump and again of
    each assembly.
    """
    mounting: tuple[float, float] = (4000.0, 25000.0)
    """Range of a sensor's mounted resonance [Hz], log-uniform (ISO 5348: magnet to stud), 3 % apart
    from one recording to the next.
    """
    following: tuple[float, float] = (800.0, 8000.0)
    """Range of the frequency [Hz] up to which slippers follow a recess by films that pull,
    log-uniform.
    """
    noise: tuple[float, float] = (0.01, 0.6)
    """Range of the noise over the root mean square of a healthy recording, log-uniform."""
    noise_scatter: tuple[float, float] = (0.05, 0.5)
    """Range of the deviation of its power from one recording to the next, log-uniform."""
    noise_rise: float = 3.4
    """Most by which a fault raises its power in the pumps where it does: a factor of 30, of which
    cavitation and worn ports are known.
    """
    impulse: tuple[float, float] = (0.002, 0.2)
    """Range of an impact's impulse [N s], log-uniform (physics.md, 5: 0.03 at a recess, 0.04...0.25
    of a joint).
    """
    pulse: tuple[float, float] = (5e-5, 5e-4)
    """Range of its duration [s], log-uniform (physics.md, 5: 0.1...0.3 ms)."""
    irregular: tuple[float, float] = (0.1, 1.0)
    """Range of the deviation of an impulse from turn to turn, relative."""
    ringing: tuple[float, float] = (800.0, 10000.0)
    """Range of the resonances [Hz] of what is struck, log-uniform."""
    foreign: tuple[float, float] = (1e-6, 1e-1)
    """Range of the power of a foreign line (drive, grid, second machine) over a healthy
    recording's, log-uniform.
    """

    def __post_init__(self) -> None:
        for name in (
            "speed",
            "pressure",
            "temperature",
            "mode_frequency",
            "following",
            "noise",
            "impulse",
            "pulse",
        ):
            low, high = getattr(self, name)
            if not 0 < low <= high:
                raise InputError(
                    f"the {name} of a pump prior ({low:g} to {high:g}) must rise from a positive value."
                )


def spread(
    rng: np.random.Generator, deviation: float, shape: int | tuple[int, ...]
) -> Float[np.ndarray, "..."]:
    """Factors with a log-normal spread around 1."""
    return np.exp(rng.normal(0, deviation, shape))


def log_uniform(rng: np.random.Generator, limits: tuple[float, float]) -> float:
    """A number between two limits, its logarithm uniform."""
    return float(np.exp(rng.uniform(*np.log(limits))))


def drawn_modes(
    rng: np.random.Generator,
    count: int,
    channels: int,
    frequency: tuple[float, float],
    share: float,
) -> SensorPath:
    """Modes with random frequencies and shares."""
    return SensorPath(
        gain=(1.0,) * channels,
        frequency=tuple(log_uniform(rng, frequency) for _ in range(count)),
        damping_ratio=tuple(rng.uniform(0.015, 0.05, count).tolist()),
        residue=tuple(map(tuple, rng.normal(0, share, (channels, count)).tolist())),
    )


def smooth_curves(
    rng: np.random.Generator,
    deviation: float,
    shape: tuple[int, ...],
    frequency: Float[np.ndarray, " line"],
) -> Float[np.ndarray, "... line"]:
    """Random curves over the logarithm of the frequency, with six knots."""
    knots = np.linspace(np.log(frequency[0]), np.log(frequency[-1]), 6)
    at = np.searchsorted(knots, np.log(frequency)).clip(1, 5)
    share = (np.log(frequency) - knots[at - 1]) / (knots[at] - knots[at - 1])
    values = rng.normal(0, deviation, (*shape, 6))
    return np.asarray(values[..., at - 1] * (1 - share) + values[..., at] * share)


def operating_range(
    pump: Pump, prior: PumpPrior
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Ranges of a drawing's speed [rad/s] and discharge pressure [Pa]; an `InputError` where none
    is rated.
    """
    if pump.rated is None:
        raise InputError(
            f"{pump.name} states no [rated] speed and discharge_pressure; add them to its file."
        )
    low, high = prior.speed
    least, most = prior.pressure
    rated = pump.rated
    return (low * rated.speed, high * rated.speed), (
        least * rated.discharge_pressure,
        most * rated.discharge_pressure,
    )


def draw_drawing(rng: np.random.Generator) -> Pump:
    """Drawing of a pump scaled from that of the 25SCY14-1B (`pump.scaled_pump`).

    It has 5 to 11 pistons, 10 to 200 mL, 1000 to 2600 rev/min and 14 to 35 MPa: what catalogs
    offer.
    """
    while True:
        plate = Nameplate(
            displacement=log_uniform(rng, (10e-6, 200e-6)),
            piston_count=int(rng.choice([5, 7, 9, 11], p=[0.1, 0.4, 0.4, 0.1])),
            speed=rng.uniform(rpm(1000), rpm(2600)),
            discharge_pressure=rng.uniform(MPa(14), MPa(35)),
            swash_angle=math.radians(rng.uniform(14, 20)),
        )
        try:
            return scaled_pump(load_pump("25scy14-1b"), plate, "a swash plate pump")
        except InputError:  # parts that do not fit each other
            continue


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
    impacts: tuple[Impacts, ...] = ()
    noise: float = 0.0
    """Logarithm by which it raises the power of the noise floor."""
    unbalance: float = 1.0
    """Factor on the rotor's eccentricity."""
    bearing: float = 0.0
    """Power of the lines of a damaged bearing over that of a healthy recording."""


def plausible_fault(label: str, rng: np.random.Generator) -> Fault | None:
    """Fault of a class with a severity log-uniform over a decade around what physics.md, section 5,
    calls plausible.

    The middles: recess 0.1 mm (what rejects a pump), bush 120 um, clearance 40 um, dam scratch 1
    mm^2, grooves 2 deg, plate film 7 um. A defect is anywhere on the pressure side; a bush is felt
    over +-20...50 deg. No law of contact is known to hold, so a recess is drawn with each.
    """
    factor = float(10 ** rng.uniform(-0.5, 0.5))
    angle = math.radians(rng.uniform(200, 340))
    if label == "swash_plate":
        recess = SwashPlateDefect(depth=mm(0.1) * factor, length=mm(30), width=mm(24), angle=angle)
        return replace(
            recess, contact=rng.choice(("shared", "lift_off", "physical"), p=(0.5, 0.35, 0.15))
        )
    if label == "cylinder_block":
        return BoreDefect(depth=um(120) * factor, half_width=deg(rng.uniform(20, 50)), angle=angle)
    if label == "piston":
        return PistonWear(clearance=um(40) * factor)
    if label == "valve_plate":
        kind = rng.random()
        if kind < 0.4:
            return DamScratch(area=1e-6 * factor)
        return (
            GrooveErosion(advance=deg(2) * factor)
            if kind < 0.8
            else ValvePlateWear(film_increase=um(7) * factor)
        )
    return None


@dataclass(frozen=True, eq=False)
class Troubles:
    """Draws what is wrong in recordings of one pump."""

    prior: PumpPrior
    rng: np.random.Generator
    program: int
    """0: a twin's pump; 1: its faults strike; 2: they also raise the noise floor."""
    pump: Pump

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
            first, second = rng.permutation(
                ["swash_plate", "cylinder_block", "piston", "valve_plate"]
            )[:2]
            faults = tuple(plausible_fault(str(label), rng) for label in (first, second))
            strikes = (
                tuple(item for fault in faults for item in self._strikes(fault))
                if self.program
                else ()
            )
            return Trouble(faults, strikes, rise)  # type: ignore[arg-type]
        if kind == 4:
            return Trouble(noise=float(rng.uniform(0.5, self.prior.noise_rise)))
        if kind == 5:
            return Trouble(noise=rise, bearing=log_uniform(rng, (1e-3, 1.0)))
        return Trouble(noise=rise, unbalance=float(rng.uniform(3, 30)))

    def _strikes(self, fault: Fault | None) -> tuple[Impacts, ...]:
        """Impacts of a fault at the edges of a defect, or where the force on a piston changes its
        sign.
        """
        rng = self.rng
        count, impulse = self.pump.rotating_group.piston_count, log_uniform(rng, self.prior.impulse)
        alone, all_pistons = np.eye(count)[0], spread(rng, 0.3, count)
        if isinstance(fault, BoreDefect):
            edges = (fault.angle - fault.half_width, fault.angle + fault.half_width)
            return (Impacts(impulse, _some(edges, rng), alone, 1),)
        if isinstance(fault, SwashPlateDefect):
            reach = fault.length / 2 / self.pump.rotating_group.pitch_radius
            return (
                Impacts(
                    impulse, _some((fault.angle - reach, fault.angle + reach), rng), all_pistons, 0
                ),
            )
        if rng.random() < 0.5:  # leakage alone
            return ()
        angles = _some((math.radians(8), math.radians(188)), rng)
        if isinstance(fault, PistonWear):
            return (Impacts(impulse, angles, alone, int(rng.choice([0, 1]))),)
        return (Impacts(impulse, angles, all_pistons, int(rng.choice([0, 2]))),)


def _some(angles: tuple[float, ...], rng: np.random.Generator) -> tuple[float, ...]:
    """One of the angles, or all."""
    return angles if rng.random() < 0.5 else (angles[int(rng.integers(len(angles)))],)
