"""Prior knowledge of pumps that nobody has measured: their spread, and what may be wrong."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import InputError, MPa, celsius, deg, mm, rpm, um
from swashtwin.physics import PORT_TOLERANCE, SensorPath
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
    """Widths of all draws: standard deviations of natural logarithms, unless a unit is given."""

    pump: Pump = field(default_factory=lambda: load_pump("25scy14-1b"))
    """The drawing."""
    speed: tuple[float, float] = (0.4, 1.5)
    """Range of the speed over the rated one, uniform."""
    pressure: tuple[float, float] = (0.15, 1.15)
    """Range of the discharge pressure over the rated one, uniform."""
    interfaces: float = 0.7
    """Spread of each interface value from pump to pump: 95 % lie within a factor of four of the
    drawing (physics.md, 4: a film of 7.5 or of 10 um).
    """
    assembly: float = 0.15
    """Spread of each interface value from one assembly of a pump to the next."""
    supports: float = 0.2
    """Spread of the stiffness of mounting and bearings, independent for each axis and bearing
    (physics.md: +-15...20 %).
    """
    clearances: float = 0.15
    """Standard deviation of the pistons' clearances, relative."""
    slippers: float = 0.1
    """Standard deviation of the share by which each slipper follows a recess (physics.md, 3)."""
    timing: float = PORT_TOLERANCE
    """Standard deviation of the angle at which a port opens [rad]."""
    unbalance: float = 0.5
    """Spread of the rotor's eccentricity."""
    temperature: tuple[float, float] = (celsius(30), celsius(60))
    """Range of the oil temperature [K], uniform, drawn for each recording."""
    viscosity: tuple[float, float] = (0.4, 1.0)
    """Range of the power with which the films' damping follows the viscosity."""
    speed_setting: float = 0.01
    """Half-width of the speed around the set one, relative: what counts as the same operating
    point.
    """
    pressure_setting: float = 0.06
    """Half-width of the discharge pressure around the set one, relative."""
    wandering: tuple[float, float] = (0.0005, 0.006)
    """Half-width of the speed's variation within a recording, relative, log-uniform."""
    care: tuple[float, float] = (0.1, 1.0)
    """Range of the factor on what differs from recording to recording (assembly, setting,
    sensors), log-uniform: a pump that is never opened and runs at a controlled operating point
    differs little.
    """
    modes: int = 5
    """Modes of the housing, log-uniform in frequency."""
    mode_frequency: tuple[float, float] = (1000.0, 8000.0)
    """Range of their frequencies [Hz]."""
    mode_share: float = 0.08
    """Standard deviation of a mode's share in a sensor."""
    cross_talk: float = 0.1
    """Standard deviation of the share that a sensor reads of another one's direction, for a pump
    and again for each assembly.
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
    """Range of the spread of its power from one recording to the next, log-uniform."""
    noise_rise: float = 3.4
    """Maximum logarithm by which a fault raises the power of the noise: a factor of 30, as
    cavitation and worn ports do.
    """
    impulse: tuple[float, float] = (0.002, 0.2)
    """Range of an impact's impulse [N s], log-uniform (physics.md, 5: 0.03 at a recess, 0.04...0.25
    of a joint).
    """
    pulse: tuple[float, float] = (5e-5, 5e-4)
    """Range of its duration [s], log-uniform (physics.md, 5: 0.1...0.3 ms)."""
    irregular: tuple[float, float] = (0.1, 1.0)
    """Range of the standard deviation of an impulse from turn to turn, relative."""
    ringing: tuple[float, float] = (800.0, 10000.0)
    """Range of the resonances [Hz] of what is struck, log-uniform."""
    foreign: tuple[float, float] = (1e-6, 1e-1)
    """Range of the power of a foreign line (drive, grid, second machine) over a healthy
    recording's, log-uniform.
    """

    def __post_init__(self) -> None:
        for name in _POSITIVE_RANGES:
            low, high = getattr(self, name)
            if not 0 < low <= high:
                raise InputError(
                    f"The {name} of a pump prior ({low:g} to {high:g}) must rise from a positive "
                    "value."
                )


_POSITIVE_RANGES = (
    "speed",
    "pressure",
    "temperature",
    "mode_frequency",
    "following",
    "noise",
    "impulse",
    "pulse",
)


def spread(
    rng: np.random.Generator, deviation: float, shape: int | tuple[int, ...]
) -> Float[np.ndarray, "..."]:
    """Return factors with a log-normal spread around 1."""
    return np.exp(rng.normal(0, deviation, shape))


def log_uniform(rng: np.random.Generator, limits: tuple[float, float]) -> float:
    """Return a number between two limits whose logarithm is uniform."""
    return float(np.exp(rng.uniform(*np.log(limits))))


def draw_modes(
    rng: np.random.Generator,
    count: int,
    channels: int,
    frequency: tuple[float, float],
    share: float,
) -> SensorPath:
    """Return a sensor path of modes with random frequencies and shares."""
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
    """Return random curves over the logarithm of the frequency, linear between six knots."""
    log_frequency = np.log(frequency)
    knots = np.linspace(log_frequency[0], log_frequency[-1], _N_KNOTS)
    upper = np.searchsorted(knots, log_frequency).clip(1, _N_KNOTS - 1)
    lower = upper - 1
    share = (log_frequency - knots[lower]) / (knots[upper] - knots[lower])
    values = rng.normal(0, deviation, (*shape, _N_KNOTS))
    return np.asarray(values[..., lower] * (1 - share) + values[..., upper] * share)


_N_KNOTS = 6


def operating_range(
    pump: Pump, prior: PumpPrior
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the ranges of a drawing's speed [rad/s] and discharge pressure [Pa].

    Raises
    ------
    InputError
        The drawing states no rated speed and pressure.
    """
    rated = pump.rated
    if rated is None:
        raise InputError(
            f"{pump.name} states no rated speed and pressure. Add a table [rated] with speed and "
            "discharge_pressure to the pump file."
        )

    min_speed, max_speed = prior.speed
    min_pressure, max_pressure = prior.pressure
    speed_range = (min_speed * rated.speed, max_speed * rated.speed)
    pressure_range = (
        min_pressure * rated.discharge_pressure,
        max_pressure * rated.discharge_pressure,
    )
    return speed_range, pressure_range


def draw_drawing(rng: np.random.Generator) -> Pump:
    """Draw a pump scaled from the drawing of the 25SCY14-1B (`pump.scaled_pump`).

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
        except InputError:
            # The scaled parts of some nameplates do not fit each other; draw another one.
            continue


OTHER_TROUBLE = "other"
"""Class of all troubles of a pump other than the four faults."""


@dataclass(frozen=True, eq=False)
class Impacts:
    """Impacts once a turn and piston at each of some angles, more or less irregular."""

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
    """Draw a fault of a class; None if the class is not one of the four faults.

    Its severity is log-uniform over a decade around what physics.md, section 5, calls plausible:
    recess 0.1 mm (which rejects a pump), bush 120 um, clearance 40 um, dam scratch 1 mm^2, grooves
    2 deg, plate film 7 um. A defect is anywhere on the pressure side; a bush acts over
    +-20...50 deg. No law of contact is known to hold, so one is drawn for each recess.
    """
    factor = float(10 ** rng.uniform(-0.5, 0.5))
    angle = math.radians(rng.uniform(200, 340))
    if label == "swash_plate":
        recess = SwashPlateDefect(depth=mm(0.1) * factor, length=mm(30), width=mm(24), angle=angle)
        contact = rng.choice(("shared", "lift_off", "physical"), p=(0.5, 0.35, 0.15))
        return replace(recess, contact=contact)
    if label == "cylinder_block":
        return BoreDefect(depth=um(120) * factor, half_width=deg(rng.uniform(20, 50)), angle=angle)
    if label == "piston":
        return PistonWear(clearance=um(40) * factor)
    if label == "valve_plate":
        kind = rng.random()
        if kind < 0.4:
            return DamScratch(area=1e-6 * factor)
        if kind < 0.8:
            return GrooveErosion(advance=deg(2) * factor)
        return ValvePlateWear(film_increase=um(7) * factor)
    return None


FORCE_REVERSALS = (math.radians(8), math.radians(188))
"""Angles of a piston [rad] at which the force on it changes its sign."""

# Kinds of trouble that the four classes do not contain.
_OTHER_KINDS = (
    "sealing_land",
    "loose_slipper",
    "tilted_block",
    "two_faults",
    "noise",
    "bearing",
    "unbalance",
)

# Probability of each kind [estimate].
_OTHER_SHARES = (0.15, 0.15, 0.1, 0.25, 0.1, 0.15, 0.1)

_ALONG_SLIPPERS, _ACROSS_BORE, _ALONG_VALVE_PLATE = range(3)
"""Directions of `Impacts`."""


@dataclass(frozen=True, eq=False)
class TroubleSource:
    """Draws what is wrong in each recording of one pump."""

    prior: PumpPrior
    rng: np.random.Generator
    program: int
    """0: a twin's pump; 1: its faults strike; 2: they also raise the noise floor."""
    pump: Pump

    def draw(self, label: str) -> Trouble:
        """Draw what is wrong in a recording of a class."""
        if label == "normal":
            return Trouble()
        if label == OTHER_TROUBLE:
            return self._other()

        fault = plausible_fault(label, self.rng)
        assert fault is not None
        impacts = self._impacts(fault)
        return Trouble((fault,), impacts, self._noise_rise())

    def _noise_rise(self) -> float:
        if self.program != 2:
            return 0.0
        return float(self.rng.uniform(0, self.prior.noise_rise))

    def _other(self) -> Trouble:
        """Draw a trouble that the four classes do not contain."""
        rng = self.rng
        factor = float(10 ** rng.uniform(-0.5, 0.5))
        noise_rise = self._noise_rise()
        kind = _OTHER_KINDS[rng.choice(len(_OTHER_KINDS), p=_OTHER_SHARES)]

        if kind == "sealing_land":
            return Trouble((SealingLandScratch(conductance=1.2e-12 * factor),), noise=noise_rise)
        if kind == "loose_slipper":
            return Trouble((LooseSlipper(clearance=mm(0.1) * factor),), noise=noise_rise)
        if kind == "tilted_block":
            return Trouble((TiltedBlockFace(variation=min(0.25 * factor, 0.9)),), noise=noise_rise)
        if kind == "two_faults":
            return self._two_faults(noise_rise)
        if kind == "noise":
            return Trouble(noise=float(rng.uniform(0.5, self.prior.noise_rise)))
        if kind == "bearing":
            return Trouble(noise=noise_rise, bearing=log_uniform(rng, (1e-3, 1.0)))
        return Trouble(noise=noise_rise, unbalance=float(rng.uniform(3, 30)))

    def _two_faults(self, noise_rise: float) -> Trouble:
        labels = ["swash_plate", "cylinder_block", "piston", "valve_plate"]
        faults: list[Fault] = []
        for label in self.rng.permutation(labels)[:2]:
            fault = plausible_fault(str(label), self.rng)
            assert fault is not None
            faults.append(fault)

        impacts: tuple[Impacts, ...] = ()
        for fault in faults:
            impacts += self._impacts(fault)
        return Trouble(tuple(faults), impacts, noise_rise)

    def _impacts(self, fault: Fault) -> tuple[Impacts, ...]:
        """Draw the impacts of a fault; none in a pump whose faults do not strike.

        They are at the edges of a defect, or at the `FORCE_REVERSALS` of each piston.
        """
        if not self.program:
            return ()

        rng = self.rng
        group = self.pump.rotating_group
        impulse = log_uniform(rng, self.prior.impulse)
        first_piston = np.eye(group.piston_count)[0]
        all_pistons = spread(rng, 0.3, group.piston_count)
        if isinstance(fault, BoreDefect):
            edges = (fault.angle - fault.half_width, fault.angle + fault.half_width)
            return (Impacts(impulse, self._one_or_all(edges), first_piston, _ACROSS_BORE),)
        if isinstance(fault, SwashPlateDefect):
            reach = fault.length / 2 / group.pitch_radius
            edges = (fault.angle - reach, fault.angle + reach)
            return (Impacts(impulse, self._one_or_all(edges), all_pistons, _ALONG_SLIPPERS),)

        # Half of the other faults only leak.
        if rng.random() < 0.5:
            return ()
        angles = self._one_or_all(FORCE_REVERSALS)
        if isinstance(fault, PistonWear):
            shares = first_piston
            directions = [_ALONG_SLIPPERS, _ACROSS_BORE]
        else:
            shares = all_pistons
            directions = [_ALONG_SLIPPERS, _ALONG_VALVE_PLATE]
        return (Impacts(impulse, angles, shares, int(rng.choice(directions))),)

    def _one_or_all(self, angles: tuple[float, ...]) -> tuple[float, ...]:
        """Return one of the angles, or all of them, with equal probability."""
        if self.rng.random() < 0.5:
            return angles
        return (angles[int(self.rng.integers(len(angles)))],)
