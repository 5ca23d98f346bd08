"""Under which speed, pressures and oil temperature a pump runs."""

import math
from dataclasses import dataclass, replace

from swashtwin.foundation import InputError


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
    discharge_pressure: float
    """Absolute pressure at the outlet [Pa]."""
    suction_pressure: float = 0.11e6
    """Absolute pressure at the inlet [Pa]."""
    case_pressure: float = 0.10e6
    """Absolute pressure in the housing [Pa]."""
    oil_temperature: float = 318.15
    """Oil temperature [K]; `units.celsius` converts."""

    def __post_init__(self) -> None:
        for name in ("speed", "discharge_pressure", "suction_pressure", "case_pressure", "oil_temperature"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"{name} ({value:g}) must be a positive number.")
        if self.speed > 8000 * math.pi / 30:
            raise InputError(
                f"speed ({self.speed:g} rad/s, {self.speed * 30 / math.pi:.0f} rev/min) is above 8000 rev/min, which "
                "no industrial axial piston pump reaches. Speeds are in rad/s: 860 rev/min is rpm(860)."
            )
        if self.discharge_pressure <= self.suction_pressure:
            raise InputError(
                f"discharge_pressure ({self.discharge_pressure:g} Pa) must exceed suction_pressure "
                f"({self.suction_pressure:g} Pa). Pressures are in Pa: 15 MPa is MPa(15)."
            )
        if self.discharge_pressure > 2e8:
            raise InputError(
                f"discharge_pressure ({self.discharge_pressure:g} Pa) is above any axial piston pump's (200 MPa). "
                "Pressures are in Pa: 15 MPa is MPa(15)."
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

    def replaced(self, **changes: float) -> "OperatingCondition":
        """The same condition with some values changed."""
        return replace(self, **changes)
