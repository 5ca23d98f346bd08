"""What is taken for granted of pumps that nobody has measured: how far each named effect may reach, and by what source.

A twin's levels are off by the housing, the sensors and the mounting, which nobody knows well; what a fault *changes*
against the healthy recordings of the same pump is not. Contacts that push and cannot pull, floors that rise with a
fault or stay, and whatever else runs beside the pump change it further, so each is drawn for a pump as widely as the
literature and `docs/explanation/physics.md` allow. No width was taken from the virtual rigs of the bench.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import InputError, MPa, celsius, deg, rpm
from swashtwin.pump import Nameplate, Pump, load_pump, scaled_pump


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
    """Of each interface value from pump to pump: 95 % lie within a factor of four of the drawing (physics.md, 4: a film
    of 7.5 or of 10 um)."""
    assembly: float = 0.15
    """Of each interface value from one assembly of a pump to the next."""
    supports: float = 0.2
    """Of the stiffness of mounting and bearings, each axis and bearing on its own (physics.md: +-15...20 %)."""
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
    """Half-width of the speed around the set one, relative: what the product takes for one operating point."""
    pressure_setting: float = 0.06
    """The same of the discharge pressure."""
    wandering: tuple[float, float] = (0.0005, 0.006)
    """Half-width of the speed's variation within a recording, relative, log-uniform."""
    care: tuple[float, float] = (0.1, 1.0)
    """Range of a pump's share in what differs from recording to recording (assembly, setting, sensors), log-uniform: a
    pump that is never opened and runs at a controlled point differs little."""
    modes: int = 5
    """Modes of the housing, log-uniform in frequency."""
    mode_frequency: tuple[float, float] = (1000.0, 8000.0)
    """Range of their frequencies [Hz]."""
    mode_share: float = 0.08
    """Standard deviation of a mode's share in a sensor."""
    cross_talk: float = 0.1
    """Standard deviation of what a sensor reads of another one's direction, of a pump and again of each assembly."""
    mounting: tuple[float, float] = (4000.0, 25000.0)
    """Range of a sensor's mounted resonance [Hz], log-uniform (ISO 5348: magnet to stud), 3 % apart from one recording
    to the next."""
    following: tuple[float, float] = (800.0, 8000.0)
    """Range of the frequency [Hz] up to which slippers follow a recess by films that pull, log-uniform."""
    noise: tuple[float, float] = (0.01, 0.6)
    """Range of the noise over the root mean square of a healthy recording, log-uniform."""
    noise_scatter: tuple[float, float] = (0.05, 0.5)
    """Range of the deviation of its power from one recording to the next, log-uniform."""
    noise_rise: float = 3.4
    """Most by which a fault raises its power in the pumps where it does: a factor of 30, of which cavitation and worn
    ports are known."""
    impulse: tuple[float, float] = (0.002, 0.2)
    """Range of an impact's impulse [N s], log-uniform (physics.md, 5: 0.03 at a recess, 0.04...0.25 of a joint)."""
    pulse: tuple[float, float] = (5e-5, 5e-4)
    """Range of its duration [s], log-uniform (physics.md, 5: 0.1...0.3 ms)."""
    irregular: tuple[float, float] = (0.1, 1.0)
    """Range of the deviation of an impulse from turn to turn, relative."""
    ringing: tuple[float, float] = (800.0, 10000.0)
    """Range of the resonances [Hz] of what is struck, log-uniform."""
    foreign: tuple[float, float] = (1e-6, 1e-1)
    """Range of the power of a foreign line (drive, grid, second machine) over a healthy recording's, log-uniform."""

    def __post_init__(self) -> None:
        for name in ("speed", "pressure", "temperature", "mode_frequency", "following", "noise", "impulse", "pulse"):
            low, high = getattr(self, name)
            if not 0 < low <= high:
                raise InputError(f"the {name} of a pump prior ({low:g} to {high:g}) must rise from a positive value.")


def spread(rng: np.random.Generator, deviation: float, shape: int | tuple[int, ...]) -> Float[np.ndarray, "..."]:
    """Factors with a log-normal spread around 1."""
    return np.exp(rng.normal(0, deviation, shape))


def log_uniform(rng: np.random.Generator, limits: tuple[float, float]) -> float:
    """A number between two limits, its logarithm uniform."""
    return float(np.exp(rng.uniform(*np.log(limits))))


def operating_range(pump: Pump, prior: PumpPrior) -> tuple[tuple[float, float], tuple[float, float]]:
    """Ranges of the speed [rad/s] and of the discharge pressure [Pa] of a drawing.

    Raises
    ------
    InputError
        It states no rated operating point.
    """
    if pump.rated is None:
        raise InputError(f"{pump.name} states no [rated] speed and discharge_pressure; add them to its file.")
    low, high = prior.speed
    least, most = prior.pressure
    rated = pump.rated
    return (low * rated.speed, high * rated.speed), (least * rated.discharge_pressure, most * rated.discharge_pressure)


def draw_drawing(rng: np.random.Generator) -> Pump:
    """Drawing of a pump scaled from that of the 25SCY14-1B (`pump.scaled_pump`).

    It has 5 to 11 pistons, 10 to 200 mL, 1000 to 2600 rev/min and 14 to 35 MPa: what catalogs offer.
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
