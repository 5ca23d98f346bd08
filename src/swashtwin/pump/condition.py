"""Under which speed, pressures and oil temperature a pump runs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Bool, Float

from swashtwin.foundation import InputError, parse_quantity, rpm

SPEED_TOLERANCE = 0.02
"""Relative difference up to which two speeds belong to the same operating point: the slip of a
motor under load.
"""
PRESSURE_TOLERANCE = 0.06
"""Relative difference up to which two discharge pressures belong to the same operating point: a
relief valve holds what was set within some percent.
"""
MAX_SPEED = rpm(8000)
"""Speed [rad/s] that no industrial axial piston pump reaches."""
MAX_PRESSURE = 2e8
"""Discharge pressure [Pa] above that of any axial piston pump."""


@dataclass(frozen=True)
class OperatingCondition:
    """Steady operating point of a pump.

    Examples
    --------
    >>> from swashtwin.foundation.units import MPa, rpm
    >>> condition = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(15))
    >>> round(condition.shaft_frequency, 3)
    14.333
    """

    speed: float
    """Angular speed of the shaft [rad/s]; `units.rpm` converts."""
    discharge_pressure: float = math.nan
    """Absolute pressure at the outlet [Pa], which must be given."""
    suction_pressure: float = 0.11e6
    """Absolute pressure at the inlet [Pa]."""
    case_pressure: float = 0.10e6
    """Absolute pressure in the housing [Pa]."""
    oil_temperature: float = 318.15
    """Oil temperature [K]; `units.celsius` converts."""

    def __post_init__(self) -> None:
        for field_info in fields(self):
            name = field_info.name
            value = getattr(self, name)
            if not isinstance(value, (int, float, np.number)):
                raise InputError(
                    f"{name} ({value!r}) must be a number in SI units, "
                    "such as rpm(1500) or MPa(15)."
                )
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"{name} ({value:g}) must be a positive number.")

        # Beyond these limits a unit was mistaken: the messages name the likely slip.
        if self.speed > MAX_SPEED:
            raise InputError(
                f"speed ({self.speed:g} rad/s, {self.speed * 30 / math.pi:.0f} rev/min) is above "
                "8000 rev/min, which no industrial axial piston pump reaches. "
                "Speeds are in rad/s: 860 rev/min is rpm(860)."
            )
        if self.discharge_pressure <= self.suction_pressure:
            raise InputError(
                f"discharge_pressure ({self.discharge_pressure:g} Pa) must exceed suction_pressure "
                f"({self.suction_pressure:g} Pa). Pressures are in Pa: 15 MPa is MPa(15)."
            )
        if self.discharge_pressure > MAX_PRESSURE:
            raise InputError(
                f"discharge_pressure ({self.discharge_pressure:g} Pa) is above any axial piston "
                "pump's (200 MPa). Pressures are in Pa: 15 MPa is MPa(15)."
            )
        if not 233.15 <= self.oil_temperature <= 423.15:
            raise InputError(
                f"oil_temperature ({self.oil_temperature:g} K) lies outside -40...150 degC. "
                "Temperatures are in kelvin: 45 degC is celsius(45)."
            )

    @property
    def shaft_frequency(self) -> float:
        """Revolutions per second [Hz]."""
        return self.speed / (2 * math.pi)

    @property
    def period(self) -> float:
        """Time of one revolution [s]."""
        return 1 / self.shaft_frequency

    def matches(self, other: "OperatingCondition", *, speed: float = SPEED_TOLERANCE) -> bool:
        """Whether two conditions are the same operating point: their discharge pressures agree
        within 6 %.

        Parameters
        ----------
        speed : relative difference of the speeds up to which they agree.

        Examples
        --------
        >>> from swashtwin.foundation.units import MPa, rpm
        >>> condition = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(15))
        >>> condition.matches(condition.replace(speed=rpm(850), discharge_pressure=MPa(14.5)))
        True
        >>> condition.matches(condition.replace(speed=rpm(850)), speed=0.01)
        False
        """
        return bool(
            values_match(self.speed, other.speed, speed)
            and values_match(self.discharge_pressure, other.discharge_pressure, PRESSURE_TOLERANCE)
        )

    def replace(self, **changes: float) -> "OperatingCondition":
        """Return the same operating point with some values changed."""
        return replace(self, **changes)


def read_condition(
    *,
    speed: str,
    discharge_pressure: str,
    oil_temperature: str | None = None,
    suction_pressure: str | None = None,
) -> OperatingCondition:
    """Return the operating point of quantities with units; others keep their defaults.

    Raises
    ------
    UnitError
        A number without a unit, or with one of another dimension; a speed in hertz.
    InputError
        No pump runs at such a point.

    Examples
    --------
    >>> round(read_condition(speed="860 rpm", discharge_pressure="15 MPa").shaft_frequency, 6)
    14.333333
    """
    quantities = {
        "speed": (speed, "rad/s"),
        "discharge_pressure": (discharge_pressure, "Pa"),
        "oil_temperature": (oil_temperature, "K"),
        "suction_pressure": (suction_pressure, "Pa"),
    }
    values = {
        name: parse_quantity(text, unit, name=name)
        for name, (text, unit) in quantities.items()
        if text is not None
    }
    return OperatingCondition(**values)


def values_match(
    a: float | Float[np.ndarray, " n"], b: float | Float[np.ndarray, " n"], tolerance: float
) -> np.bool_ | Bool[np.ndarray, " n"]:
    """Return whether two speeds, or two pressures, differ by at most `tolerance` of the larger.

    NaN matches only NaN. This is `OperatingCondition.matches` for single values, for callers that
    have a part of an operating point.
    """
    are_close = np.abs(np.subtract(a, b)) <= tolerance * np.maximum(np.abs(a), np.abs(b))
    return are_close | (np.isnan(a) & np.isnan(b))


def merge_close_values(
    values: Float[np.ndarray, " n"], tolerance: float
) -> Float[np.ndarray, " n"]:
    """Return speeds or pressures with close values replaced by their mean.

    A run of close values starts at the lowest value that is in no other run, and holds every value
    that matches it within `tolerance` of the larger. So any two values of a run match, and each
    matches the mean; NaN stays NaN.

    Examples
    --------
    >>> merge_close_values(np.array([15e6, 10.1e6, 9.9e6]), 0.06).tolist()
    [15000000.0, 10000000.0, 10000000.0]
    >>> merge_close_values(np.array([10e6, 10.5e6, 11e6, 11.5e6]), 0.06).tolist()
    [10250000.0, 10250000.0, 11250000.0, 11250000.0]
    """
    merged = np.full(values.shape, np.nan)
    is_known = ~np.isnan(values)
    if not is_known.any():
        return merged

    distinct, index = np.unique(values[is_known], return_inverse=True)
    run_lengths: list[int] = []
    start = 0
    while start < distinct.size:
        matching = values_match(distinct[start:], distinct[start], tolerance)
        run_lengths.append(max(1, int(np.sum(matching))))
        start += run_lengths[-1]

    run = np.repeat(np.arange(len(run_lengths)), run_lengths)
    run_means = np.bincount(run, weights=distinct) / np.bincount(run)
    merged[is_known] = run_means[run][index]
    return merged


def group_by_condition(
    conditions: Sequence[OperatingCondition], *, speed: float = SPEED_TOLERANCE
) -> list[list[int]]:
    """Indices of the conditions of each operating point, by ascending discharge pressure, then
    speed.

    Conditions of one point match each other within the tolerances of `OperatingCondition.matches`.

    Examples
    --------
    >>> from swashtwin.foundation.units import MPa, rpm
    >>> conditions = [OperatingCondition(rpm(860), MPa(value)) for value in (15, 10, 14.9)]
    >>> group_by_condition(conditions)
    [[1], [0, 2]]
    """
    pressures = merge_close_values(
        np.array([c.discharge_pressure for c in conditions]), PRESSURE_TOLERANCE
    )
    speeds = merge_close_values(np.array([c.speed for c in conditions]), speed)
    points: dict[tuple[float, float], list[int]] = {}
    for index, point in enumerate(zip(pressures.tolist(), speeds.tolist(), strict=True)):
        points.setdefault(point, []).append(index)
    return [points[point] for point in sorted(points)]
