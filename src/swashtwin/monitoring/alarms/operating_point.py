"""Operating points of a machine: the speeds and pressures at which recordings are compared."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from swashtwin.pump import PRESSURE_TOLERANCE, SPEED_TOLERANCE, values_match
from swashtwin.recordings import Recording, specified_pressure, specified_shaft_frequency

if TYPE_CHECKING:
    from swashtwin.monitoring.history.schema import OperatingPointRow


@dataclass(frozen=True)
class OperatingPoint:
    """Speed and discharge pressure at which recordings are compared."""

    speed: float | None
    """Angular speed of the shaft [rad/s]; None if it is not specified."""
    pressure: float | None
    """Discharge pressure [Pa]; None if it is not specified."""

    @classmethod
    def of(cls, recording: Recording) -> "OperatingPoint":
        """Return the operating point that a recording specifies."""
        frequency = specified_shaft_frequency(recording)
        pressure = specified_pressure(recording)
        speed = None
        if frequency:
            speed = 2 * math.pi * frequency
        return cls(speed, None if math.isnan(pressure) else pressure)

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

    def distance(self, point: "OperatingPoint | OperatingPointRow") -> float:
        """Return the relative difference to another operating point, in units of the tolerances.

        It is infinite if the operating points do not match. The tolerances are those of
        `OperatingCondition.matches`.
        """
        return max(
            _distance(self.speed, point.speed, SPEED_TOLERANCE),
            _distance(self.pressure, point.pressure, PRESSURE_TOLERANCE),
        )


def _distance(first: float | None, second: float | None, tolerance: float) -> float:
    if first is None and second is None:
        return 0.0
    if first is None or second is None or not values_match(first, second, tolerance):
        return math.inf
    return abs(first - second) / (tolerance * max(first, second))


def match_operating_point(
    recording: Recording, points: Iterable["OperatingPoint | OperatingPointRow"]
) -> OperatingPoint:
    """Return the nearest operating point that matches a recording.

    If none matches, it is a new operating point with the values that the recording specifies.
    """
    specified_point = OperatingPoint.of(recording)
    nearest = min(points, key=specified_point.distance, default=None)
    # The nearest one keeps its values: recordings that wander do not shift an operating point.
    if nearest is None or math.isinf(specified_point.distance(nearest)):
        return specified_point
    return OperatingPoint(nearest.speed, nearest.pressure)
