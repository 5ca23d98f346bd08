"""How speed and pressure go while a recording lasts."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.integrate import trapezoid
from scipy.signal import lfilter

from swashtwin.foundation import InputError, stream
from swashtwin.pump import OperatingCondition

MOST_JITTER = 0.2
"""Largest relative standard deviation of the speed."""
_CUT = 4.0
"""Standard deviations at which the jitter is cut off, so that the shaft never turns back."""
_DRAWS = 10
"""Draws of the jitter within one correlation time."""


@dataclass(frozen=True, eq=False)
class Shaft:
    """Speed of the shaft over time, and the angle it has turned through: linear and quadratic between the knots."""

    time: Float[np.ndarray, " knot"]
    """Time of each knot since the recording starts [s]."""
    speed: Float[np.ndarray, " knot"]
    """Angular speed at each knot [rad/s]."""
    angle: Float[np.ndarray, " knot"]
    """Angle at each knot [rad], 0 at top dead center of piston 0."""

    def at(self, time: Float[np.ndarray, " time"]) -> tuple[Float[np.ndarray, " time"], Float[np.ndarray, " time"]]:
        """Angle [rad] and angular speed [rad/s] at `time` [s]; before the first knot its speed holds."""
        knot = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(self.time) - 2)
        rate = np.diff(self.speed) / np.diff(self.time)
        since = time - self.time[knot]
        speed = self.speed[knot] + rate[knot] * np.maximum(since, 0.0)
        return self.angle[knot] + (self.speed[knot] + speed) / 2 * since, speed


@dataclass(frozen=True, eq=False)
class OperatingProfile:
    """Speed and outlet pressure over time, linear between knots; all else of the condition stays as it is.

    Examples
    --------
    >>> from swashtwin.foundation.units import MPa, rpm
    >>> at_15 = OperatingCondition(speed=rpm(1500), discharge_pressure=MPa(15))
    >>> run_up = OperatingProfile.run_up(at_15, 8.0, hold=2.0)
    >>> run_up.duration, float(run_up.speed[0]), run_up.mean(at_15).speed / rpm(1500)
    (10.0, 0.0, 0.6)
    """

    time: Float[np.ndarray, " knot"]
    """Time of each knot [s], rising; the recording lasts from the first to the last."""
    speed: Float[np.ndarray, " knot"]
    """Angular speed of the shaft at each knot [rad/s]; 0 is standstill."""
    discharge_pressure: Float[np.ndarray, " knot"]
    """Absolute pressure at the outlet at each knot [Pa]."""
    jitter: float = 0.0
    """Standard deviation of the speed about its profile, relative; it is Gaussian, cut at four of them."""
    correlation_time: float = 0.05
    """Time after which the jitter has forgotten a share 1 - 1/e of itself [s]; an estimate."""

    def __post_init__(self) -> None:
        count = len(self.time)
        if count < 2 or not {len(self.speed), len(self.discharge_pressure)} == {count}:
            raise InputError(
                f"a profile needs at least two knots, and a speed and a pressure for each: {count} times, "
                f"{len(self.speed)} speeds, {len(self.discharge_pressure)} pressures."
            )
        for name in ("time", "speed", "discharge_pressure"):
            if not np.isfinite(getattr(self, name)).all():
                raise InputError(f"a profile's {name} must be finite at every knot.")
        stuck = np.flatnonzero(np.diff(self.time) <= 0)
        if stuck.size:
            before, after = self.time[stuck[0]], self.time[stuck[0] + 1]
            raise InputError(f"a profile's times must rise; {after:g} s follows {before:g} s.")
        if self.speed.min() < 0:
            raise InputError(
                f"a profile's speed ({self.speed.min():g} rad/s) must not be negative; a pump turns one way."
            )
        if self.speed.max() == 0:
            raise InputError("a profile's speed is zero throughout; a pump that stands still is silent.")
        if not 0 <= self.jitter <= MOST_JITTER:
            raise InputError(f"jitter ({self.jitter:g}) must lie in 0...{MOST_JITTER}; it is relative: 0.5 % is 0.005.")
        if not (np.isfinite(self.correlation_time) and self.correlation_time > 0):
            raise InputError(f"correlation_time ({self.correlation_time:g} s) must be a positive number.")

    @classmethod
    def steady(cls, condition: OperatingCondition, duration: float, *, jitter: float = 0.0) -> "OperatingProfile":
        """Speed and pressure of `condition` for `duration` [s]."""
        return cls.ramp(condition, duration, jitter=jitter)

    @classmethod
    def ramp(
        cls,
        condition: OperatingCondition,
        duration: float,
        *,
        to_speed: float | None = None,
        to_pressure: float | None = None,
        jitter: float = 0.0,
    ) -> "OperatingProfile":
        """From `condition` to another speed [rad/s], outlet pressure [Pa] or both, evenly within `duration` [s]."""
        if not duration > 0:
            raise InputError(f"duration ({duration:g} s) must be a positive number.")
        speed = condition.speed if to_speed is None else to_speed
        pressure = condition.discharge_pressure if to_pressure is None else to_pressure
        return cls(
            time=np.array([0.0, duration]),
            speed=np.array([condition.speed, float(speed)]),
            discharge_pressure=np.array([condition.discharge_pressure, float(pressure)]),
            jitter=jitter,
        )

    @classmethod
    def run_up(
        cls,
        condition: OperatingCondition,
        duration: float,
        *,
        from_speed: float = 0.0,
        hold: float = 0.0,
        jitter: float = 0.0,
    ) -> "OperatingProfile":
        """From `from_speed` [rad/s] up to the speed of `condition` within `duration` [s], then `hold` [s] there.

        The outlet pressure is that of `condition` throughout, as of a pump that starts against a loaded line.
        """
        if not duration > 0 or hold < 0:
            raise InputError(f"duration ({duration:g} s) must be positive and hold ({hold:g} s) not negative.")
        knots = 2 if hold == 0 else 3
        return cls(
            time=np.array([0.0, duration, duration + hold])[:knots],
            speed=np.array([float(from_speed), condition.speed, condition.speed])[:knots],
            discharge_pressure=np.full(knots, condition.discharge_pressure),
            jitter=jitter,
        )

    @property
    def duration(self) -> float:
        """Length [s]."""
        return float(self.time[-1] - self.time[0])

    def mean(self, condition: OperatingCondition) -> OperatingCondition:
        """`condition` at the mean speed and the mean pressure of the profile."""
        speed, pressure = (
            float(trapezoid(values, self.time)) / self.duration for values in (self.speed, self.discharge_pressure)
        )
        return condition.replaced(speed=speed, discharge_pressure=pressure)

    def pressure_at(self, time: Float[np.ndarray, " time"]) -> Float[np.ndarray, " time"]:
        """Outlet pressure [Pa] at `time` [s] since the recording starts."""
        return np.interp(time, self.time - self.time[0], self.discharge_pressure)

    def scaled(self, speed: float, pressure: float) -> "OperatingProfile":
        """The same profile with every speed and every pressure times a factor."""
        return replace(self, speed=self.speed * speed, discharge_pressure=self.discharge_pressure * pressure)

    def shaft(self, *, phase: float = 0.0, seed: int = 0) -> Shaft:
        """What the shaft does: the profile with the jitter that `seed` draws, from the angle `phase` [rad] on.

        The jitter is a Gauss-Markov process, drawn ten times within its correlation time and linear in between; it does
        not depend on the sample rate.
        """
        time, speed = self.time - self.time[0], self.speed
        if self.jitter > 0:
            grid = np.linspace(0, self.duration, 2 + int(self.duration * _DRAWS / self.correlation_time))
            time = np.union1d(time, grid)
            drawn = np.interp(time, grid, _gauss_markov(len(grid), grid[1] / self.correlation_time, seed))
            base = np.interp(time, self.time - self.time[0], self.speed)
            speed = base * (1 + self.jitter * np.clip(drawn, -_CUT, _CUT))
        turned = np.cumsum(np.diff(time) * (speed[1:] + speed[:-1]) / 2)
        return Shaft(time, speed, phase + np.concatenate([[0.0], turned]))


def _gauss_markov(count: int, step: float, seed: int) -> Float[np.ndarray, " draw"]:
    """Gaussian draws of variance 1 whose correlation falls by exp(-step) from one to the next."""
    decay = np.exp(-step)
    noise = stream(seed, "jitter").standard_normal(count)
    noise[1:] *= np.sqrt(1 - decay**2)
    return lfilter([1.0], [1.0, -decay], noise)
