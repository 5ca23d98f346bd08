"""What a pump is made of: geometry, masses, films and sensors, each number with its unit and
source.

Pumps live in TOML files, which `load_pump` reads; ``pumps/25scy14-1b.toml`` is the paper's.
"""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from enum import IntEnum
from itertools import pairwise
from operator import attrgetter
from types import MappingProxyType
from typing import Any

from swashtwin.foundation import InputError, plural, shorten

PARAMETERS = (
    "slipper_swash.damping",
    "slipper_swash.stiffness",
    "block_valve.damping",
    "block_valve.stiffness",
    "piston_bore.damping",
    "piston_bore.stiffness",
)
"""The six values that calibration finds, in the order of every vector of them."""


InterfaceValue = IntEnum(
    "InterfaceValue",
    "SLIPPER_SWASH_DAMPING SLIPPER_SWASH_STIFFNESS BLOCK_VALVE_DAMPING BLOCK_VALVE_STIFFNESS "
    "PISTON_BORE_DAMPING PISTON_BORE_STIFFNESS",
    start=0,
)
"""Index of each of the six values in the order of `PARAMETERS`."""

PARAMETER_SYMBOLS = MappingProxyType(
    dict(zip(PARAMETERS, ("C_sw", "K_sw", "C_v", "K_v", "C_Hz", "K_Hz"), strict=True))
)
"""The paper's letters. Its names contradict each other (C_v is its "cylinder damping"): this map is
ours.
"""


def _number(unit: str, meaning: str) -> Any:
    """Field of a number of a pump file, with its SI unit and what it is."""
    return field(metadata={"unit": unit, "meaning": meaning})


@dataclass(frozen=True)
class RotatingGroup:
    """Pistons, slippers and the swash plate's inclination."""

    piston_count: int = _number("1", "Number n of pistons")
    piston_diameter: float = _number("m", "Diameter d of a piston")
    pitch_radius: float = _number("m", "Radius R of the circle of bores")
    swash_angle: float = _number("rad", "Inclination gamma of the swash plate")
    slipper_diameter: float = _number("m", "Outer diameter a of a slipper")
    pocket_diameter: float = _number("m", "Diameter of a slipper's pressure pocket")
    orifice_diameter: float = _number(
        "m", "Diameter of the damping hole through piston and slipper"
    )
    orifice_length: float = _number("m", "Length of that hole")
    piston_clearance: float = _number("m", "Radial clearance of a piston in its bore")
    piston_eccentricity: float = _number("1", "Relative eccentricity of a piston in its bore")
    piston_guide_length: float = _number("m", "Length of a piston in its bore at top dead center")
    slipper_film: float = _number("m", "Film thickness under a healthy slipper")
    dead_volume: float = _number("m^3", "Chamber volume V0 at top dead center")

    def __post_init__(self) -> None:
        if not 3 <= self.piston_count <= 19:
            raise InputError(
                f"rotating_group.piston_count ({self.piston_count}) must lie in 3...19."
            )
        if not 0 < self.swash_angle < math.radians(45):
            raise InputError(
                f"rotating_group.swash_angle ({math.degrees(self.swash_angle):.4g} deg) "
                "must lie within 0...45 deg."
            )
        if not 0 <= self.piston_eccentricity <= 1:
            raise InputError(
                f"rotating_group.piston_eccentricity ({self.piston_eccentricity:g}) "
                "must lie in 0...1."
            )

        # The chord between neighboring bores must leave a wall.
        wall = 2 * self.pitch_radius * math.sin(math.pi / self.piston_count) - self.piston_diameter
        if wall <= 0:
            raise InputError(
                f"rotating_group: {self.piston_count} bores of {self.piston_diameter * 1e3:.4g} mm "
                f"overlap on a pitch radius of {self.pitch_radius * 1e3:.4g} mm; "
                "enlarge pitch_radius or reduce piston_diameter."
            )
        if self.slipper_diameter <= self.pocket_diameter:
            raise InputError("rotating_group.slipper_diameter must exceed pocket_diameter.")

        if not 1e-8 <= self.displacement <= 5e-3:
            raise InputError(
                f"rotating_group: piston_diameter, pitch_radius and swash_angle give "
                f"{self.displacement * 1e6:.4g} mL per revolution, outside 0.01...5000 mL; "
                "check their units."
            )

    @property
    def piston_area(self) -> float:
        """Area of a piston [m^2]."""
        return math.pi / 4 * self.piston_diameter**2

    @property
    def displacement(self) -> float:
        """Volume per revolution [m^3]."""
        return (
            self.piston_count
            * self.piston_area
            * 2
            * self.pitch_radius
            * math.tan(self.swash_angle)
        )


@dataclass(frozen=True)
class ValvePlate:
    """Port timing from top dead center, relief grooves and sealing lands."""

    suction_open: float = _number("rad", "Shaft angle at which a bore meets the suction kidney")
    suction_close: float = _number("rad", "Shaft angle at which it leaves it")
    discharge_open: float = _number("rad", "Shaft angle at which a bore meets the discharge kidney")
    discharge_close: float = _number("rad", "Shaft angle at which it leaves it")
    port_ramp: float = _number("rad", "Angle over which a kidney opens and closes linearly")
    port_area_ratio: float = _number("1", "Largest opening over the piston's area")
    groove_angle: float = _number("rad", "Length of the relief groove ahead of a kidney")
    groove_slope: float = _number("rad", "Inclination of the groove's bottom")
    groove_flank: float = _number("rad", "Angle between the groove's flanks")
    film: float = _number("m", "Film thickness h_v at the valve plate")
    outer_land_outer_radius: float = _number("m", "Outer radius of the outer sealing land")
    outer_land_inner_radius: float = _number("m", "Inner radius of the outer sealing land")
    inner_land_outer_radius: float = _number("m", "Outer radius of the inner sealing land")
    inner_land_inner_radius: float = _number("m", "Inner radius of the inner sealing land")
    film_radius: float = _number("m", "Mean radius r_v of the film")
    balance_ratio: float = _number("1", "Kidney and film force over piston force, B")

    def __post_init__(self) -> None:
        radii = [
            f"{land}_land_{edge}_radius"
            for land in ("inner", "outer")
            for edge in ("inner", "outer")
        ]
        angles = ("suction_open", "suction_close", "discharge_open", "discharge_close")
        for lower, upper in (*pairwise(radii), *pairwise(angles)):
            if getattr(self, lower) >= getattr(self, upper):
                raise InputError(
                    f"valve_plate.{lower} ({getattr(self, lower):.4g}) must be below "
                    f"{upper} ({getattr(self, upper):.4g})."
                )


@dataclass(frozen=True)
class Oil:
    """The working fluid."""

    density: float = _number("kg/m^3", "Density")
    viscosity: float = _number("Pa*s", "Dynamic viscosity at `reference_temperature`")
    reference_temperature: float = _number("K", "Temperature at which `viscosity` holds")
    viscosity_slope: float = _number("1/K", "Relative fall of the viscosity per kelvin")
    bulk_modulus: float = _number("Pa", "Effective bulk modulus without free air")
    air_fraction: float = _number("1", "Volume fraction of free air at 100 kPa")
    discharge_coefficient: float = _number("1", "Discharge coefficient of the ports")

    def viscosity_at(self, temperature: float) -> float:
        """Dynamic viscosity [Pa s] at `temperature` [K], falling exponentially."""
        return self.viscosity * math.exp(
            -self.viscosity_slope * (temperature - self.reference_temperature)
        )


@dataclass(frozen=True)
class Line:
    """Outlet line with its relief valve."""

    volume: float = _number("m^3", "Oil volume between pump and relief valve")
    relief_override: float = _number(
        "Pa", "Pressure rise of the relief valve from cracking to the pump's full flow"
    )


@dataclass(frozen=True)
class Masses:
    """Masses and transverse inertias of the three bodies."""

    shell: float = _number("kg", "Housing, swash plate and valve plate")
    shell_inertia: float = _number("kg*m^2", "Their moment of inertia about x and y")
    rotor: float = _number("kg", "Shaft, cylinder block, pistons and bearings")
    rotor_inertia: float = _number("kg*m^2", "Their moment of inertia about x and y")
    retainer: float = _number("kg", "Retainer, spring and slippers")
    piston_slipper: float = _number("kg", "One piston with its slipper")
    rotor_eccentricity: float = _number("m", "Eccentricity of the rotor's center of gravity")


@dataclass(frozen=True)
class Positions:
    """Places along the shaft, from the slippers' plane toward the valve plate."""

    shell: float = _number("m", "Center of gravity zeta_F of the shell")
    rotor: float = _number("m", "Center of gravity zeta_C of the rotor")
    valve_plate: float = _number("m", "Valve plate z_v")
    mount: float = _number("m", "Mounting flange z_m")


@dataclass(frozen=True)
class Mount:
    """How the shell stands on the ground."""

    stiffness_x: float = _number("N/m", "Transverse stiffness")
    stiffness_y: float = _number(
        "N/m", "Transverse stiffness in the swash plate's direction of rise"
    )
    stiffness_z: float = _number("N/m", "Axial stiffness")
    stiffness_tilt: float = _number("N*m/rad", "Stiffness against tilting about x and y")
    damping_ratio: float = _number("1", "Modal damping ratio")


@dataclass(frozen=True)
class Bearings:
    """The three bearings between rotor and shell."""

    positions: tuple[float, ...] = _number("m", "Places along the shaft")
    stiffnesses: tuple[float, ...] = _number("N/m", "Radial stiffnesses")
    axial_stiffness: float = _number("N/m", "Axial stiffness of the last one")
    damping_time: float = _number("s", "Damping over stiffness")

    def __post_init__(self) -> None:
        if len(self.positions) != len(self.stiffnesses) or not self.positions:
            raise InputError(
                "bearings: positions and stiffnesses must be lists of the same length, "
                "with one entry for each bearing."
            )


@dataclass(frozen=True)
class Coupling:
    """Spring and lateral stiffness between retainer and rotor."""

    spring_stiffness: float = _number("N/m", "Central spring")
    spring_preload: float = _number(
        "N", "Force of the central spring, which presses the block on the valve plate"
    )
    lateral_ratio: float = _number(
        "1", "Lateral over axial stiffness of a piston in its bore, kappa_r"
    )


@dataclass(frozen=True)
class Interface:
    """One spring-damper between two bodies."""

    damping: float = _number("N*s/m", "Damping C")
    stiffness: float = _number("N/m", "Stiffness K")


@dataclass(frozen=True)
class Interfaces:
    """The three interfaces, whose six values calibration estimates."""

    slipper_swash: Interface
    """Slippers on the swash plate: C_sw, K_sw, totals of all slippers."""
    block_valve: Interface
    """Cylinder block on the valve plate: C_v, K_v."""
    piston_bore: Interface
    """Pistons in their bores: C_Hz, K_Hz, totals of all pistons."""

    def values(self) -> tuple[float, ...]:
        """Return the six values in the order of `PARAMETERS` [N s/m, N/m, ...]."""
        return tuple(float(attrgetter(name)(self)) for name in PARAMETERS)

    @classmethod
    def from_values(cls, values: Any) -> "Interfaces":
        """Return interfaces with six values in the order of `PARAMETERS`.

        Raises
        ------
        InputError
            Not six values, or one that is not positive.
        """
        numbers = [float(value) for value in values]
        if len(numbers) != len(PARAMETERS):
            raise InputError(
                f"{len(numbers)} interface values given; {len(PARAMETERS)} are required: "
                f"{', '.join(PARAMETERS)}."
            )
        for name, number in zip(PARAMETERS, numbers, strict=True):
            if not (math.isfinite(number) and number > 0):
                raise InputError(f"{name} ({number:g}) must be a positive number.")
        return cls(*(Interface(*pair) for pair in zip(numbers[::2], numbers[1::2], strict=True)))


@dataclass(frozen=True)
class Rated:
    """Rated operating point, at which the file's port timing and interface values hold."""

    speed: float = _number("rad/s", "Angular speed of the shaft")
    discharge_pressure: float = _number("Pa", "Discharge pressure")


@dataclass(frozen=True)
class Sensor:
    """One accelerometer on the shell."""

    name: str
    """Channel name."""
    position: tuple[float, float, float] = field(
        metadata={"unit": "m", "meaning": "Place (x, y, z)"}
    )
    """z lies along the shaft from the slippers' plane toward the valve plate."""
    direction: tuple[float, float, float]
    """Measuring direction (a unit vector)."""


@dataclass(frozen=True)
class Pump:
    """Parameter set of one pump."""

    name: str
    """Name of the set."""
    rotating_group: RotatingGroup
    valve_plate: ValvePlate
    oil: Oil
    line: Line
    masses: Masses
    positions: Positions
    mount: Mount
    bearings: Bearings
    coupling: Coupling
    interfaces: Interfaces
    """Nominal (the paper's *empirical*) values."""
    sensors: tuple[Sensor, ...]
    """Accelerometers, one channel each."""
    rated: Rated | None = field(default=None, compare=False, repr=False)
    """Rated operating point, or None if the file has none."""
    sources: Mapping[str, str] = field(default_factory=dict, compare=False, repr=False)
    """Source of each number, by its path such as ``masses.shell``."""

    def __repr__(self) -> str:
        group = self.rotating_group
        return shorten(
            f"<Pump {self.name}: {group.piston_count} pistons of "
            f"{format_quantity(group.piston_diameter, 'm')} on a pitch radius of "
            f"{format_quantity(group.pitch_radius, 'm')}, swash angle "
            f"{format_quantity(group.swash_angle, 'rad', 3)}, "
            f"{plural(len(self.sensors), 'sensor')}>"
        )

    @property
    def channels(self) -> tuple[str, ...]:
        """Channel names of the sensors."""
        return tuple(sensor.name for sensor in self.sensors)

    def with_interfaces(self, interfaces: Interfaces) -> "Pump":
        """Return the pump with other nominal interface values."""
        return replace(self, interfaces=interfaces)


_TRADE = {
    "m": ("mm", 1e-3),
    "m^3": ("cm^3", 1e-6),
    "rad": ("deg", math.pi / 180),
    "rad/s": ("rpm", math.pi / 30),
    "Pa": ("MPa", 1e6),
    "m^3/s": ("L/min", 1e-3 / 60),
}

# Shorter lengths are gaps, and written in um.
_MAX_GAP_M = 1e-4

_DIGITS = 6
_EXACT_DIGITS = 12

# Numbers that set the displacement, which must equal the nameplate's to all digits.
_EXACT = (
    "rotating_group.piston_diameter",
    "rotating_group.pitch_radius",
    "rotating_group.swash_angle",
)


def format_quantity(value: float, unit: str, digits: int = _DIGITS) -> str:
    """Return a number in SI units as people of the trade write it, in mm, deg, MPa, rpm, cm^3.

    Examples
    --------
    >>> format_quantity(0.026, "m"), format_quantity(1.2e-5, "m"), format_quantity(15e6, "Pa")
    ('26 mm', '12 um', '15 MPa')
    """
    if unit == "K":
        return f"{value - 273.15:.{digits}g} degC"
    if unit == "m" and 0 < abs(value) < _MAX_GAP_M:
        return f"{value * 1e6:.{digits}g} um"

    name, factor = _TRADE.get(unit, (unit, 1.0))
    number = f"{value / factor:.{digits}g}"
    return number if name == "1" else f"{number} {name}"


def pump_numbers(pump: Pump) -> list[tuple[str, Any, str]]:
    """Return (path, value in SI units, SI unit) of every number of a pump, or list of numbers.

    They have the order of the pump's parts. A path is of sections and name, such as
    ``interfaces.block_valve.damping`` or ``sensors[0].position``.
    """
    numbers: list[tuple[str, Any, str]] = []

    def collect(path: str, value: Any, unit: str) -> Any:
        numbers.append((path, value, unit))
        return value

    map_numbers(pump, collect)
    return numbers


def replace_number(pump: Pump, path: str, value: Any) -> Pump:
    """Return the pump with another value of the number at `path`.

    Raises
    ------
    InputError
        No such pump can be built.
    """

    def change(number_path: str, number: Any, unit: str) -> Any:
        return value if number_path == path else number

    changed: Pump = map_numbers(pump, change)
    return changed


def map_numbers(part: Any, change: Callable[[str, Any, str], Any], path: str = "") -> Any:
    """Return the pump, or a part of it, with each number replaced by the result of `change`.

    Parameters
    ----------
    change : called with path, value and unit of each number.
    path : of the part.
    """
    changes: dict[str, Any] = {}
    for part_field in fields(part):
        name = part_field.name
        value = getattr(part, name)
        field_path = f"{path}.{name}".removeprefix(".")
        if "unit" in part_field.metadata:
            changes[name] = change(field_path, value, part_field.metadata["unit"])
        elif is_dataclass(value):
            changes[name] = map_numbers(value, change, field_path)
        elif name == "sensors":
            changes[name] = tuple(
                map_numbers(sensor, change, f"{field_path}[{number}]")
                for number, sensor in enumerate(value)
            )
    return replace(part, **changes)


def pump_text(pump: Pump, comment: str) -> str:
    """Return the text of a pump file that `load_pump` reads as this pump, with all sources."""
    lines = [f"# {line}" for line in comment.splitlines()]
    lines += ["format = 1", f"name = {json.dumps(pump.name)}"]
    table = ""
    for path, value, unit in pump_numbers(pump):
        section, _, name = path.rpartition(".")
        if section.startswith("sensors["):
            sensor = pump.sensors[int(section[8:-1])]
            lines += ["", "[[sensors]]", f"name = {json.dumps(sensor.name)}"]
            lines.append(f"direction = {[float(component) for component in sensor.direction]}")
        elif section != table:
            table = section
            lines += ["", f"[{section}]"]

        digits = _EXACT_DIGITS if path in _EXACT else _DIGITS
        if isinstance(value, tuple):
            quantity = json.dumps([format_quantity(number, unit, digits) for number in value])
        else:
            quantity = json.dumps(format_quantity(value, unit, digits))
        source = json.dumps(pump.sources.get(path, "no source"), ensure_ascii=False)
        lines.append(f"{name} = {{ value = {quantity}, source = {source} }}")
    return "\n".join(lines) + "\n"
