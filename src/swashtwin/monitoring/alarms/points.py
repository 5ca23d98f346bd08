"""Operating points of a machine, and which levels a recording of one is described by."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import scipy.fft

from swashtwin.learning import LevelLayout, level_layout
from swashtwin.pump import PRESSURE_TOLERANCE, SPEED_TOLERANCE, values_match
from swashtwin.recordings import Recording, stated_pressure, stated_speed

if TYPE_CHECKING:
    from swashtwin.monitoring.history.tables import Point


@dataclass(frozen=True)
class OperatingPoint:
    """Speed and discharge pressure that recordings are compared at."""

    speed: float | None
    """Angular speed of the shaft [rad/s], or None where it is not stated."""
    pressure: float | None
    """Discharge pressure [Pa], or None where it is not stated."""

    @classmethod
    def of(cls, recording: Recording) -> "OperatingPoint":
        """What a recording states."""
        shaft, pressure = stated_speed(recording), stated_pressure(recording)
        return cls(2 * math.pi * shaft if shaft else None, None if math.isnan(pressure) else pressure)

    @property
    def name(self) -> str:
        """Name for people and for the history.

        Examples
        --------
        >>> from swashtwin.foundation import MPa, rpm
        >>> OperatingPoint(rpm(860), MPa(10)).name
        '860 rpm, 10 MPa'
        >>> OperatingPoint(None, None).name
        'any'
        """
        parts = []
        if self.speed is not None:
            parts.append(f"{self.speed * 30 / math.pi:.4g} rpm")
        if self.pressure is not None:
            parts.append(f"{self.pressure / 1e6:.3g} MPa")
        return ", ".join(parts) or "any"

    def distance(self, other: "OperatingPoint | Point") -> float:
        """Relative difference to another point in units of the tolerances, infinite where they are not the same.

        The tolerances are those of `OperatingCondition.matches`.
        """
        pairs = (
            (self.speed, other.speed, SPEED_TOLERANCE),
            (self.pressure, other.pressure, PRESSURE_TOLERANCE),
        )
        distance = 0.0
        for first, second, tolerance in pairs:
            if first is None and second is None:
                continue
            if first is None or second is None or not values_match(first, second, tolerance):
                return math.inf
            distance = max(distance, abs(first - second) / (tolerance * max(first, second)))
        return distance


def choose_point(recording: Recording, points: Iterable["OperatingPoint | Point"]) -> OperatingPoint:
    """The nearest of a machine's points that a recording belongs to, or a new one at what the recording states."""
    stated = OperatingPoint.of(recording)
    nearest = min(points, key=stated.distance, default=None)
    if nearest is None or math.isinf(stated.distance(nearest)):
        return stated
    return OperatingPoint(nearest.speed, nearest.pressure)


def point_layout(recording: Recording) -> LevelLayout:
    """Levels of the recordings of a point, by its first one; segments are of a length that transforms fast."""
    layout, _ = level_layout([recording])
    length = int(scipy.fft.next_fast_len(layout.length, real=True))
    return replace(layout, length=length) if length <= recording.n_samples else layout
