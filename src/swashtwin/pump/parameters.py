"""What a pump is made of: geometry, masses, films and sensors, each number with its unit and source.

Pumps live in TOML files, which `pump_files` reads; ``pumps/25scy14-1b.toml`` is the paper's.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum
from itertools import pairwise
from types import MappingProxyType
from typing import Any

from swashtwin.foundation import InputError

PARAMETERS = (
    "slipper_swash.damping",
    "slipper_swash.stiffness",
    "block_valve.damping",
    "block_valve.stiffness",
    "piston_bore.damping",
    "piston_bore.stiffness",
)
"""The six values that calibration finds, in the order of every vector of them."""


class InterfaceValue(IntEnum):
    """Index of each of the six values in the order of `PARAMETERS`."""

    SLIPPER_SWASH_DAMPING = 0
    SLIPPER_SWASH_STIFFNESS = 1
    BLOCK_VALVE_DAMPING = 2
    BLOCK_VALVE_STIFFNESS = 3
    PISTON_BORE_DAMPING = 4
    PISTON_BORE_STIFFNESS = 5


LETTERS = MappingProxyType(
    {
        "slipper_swash.damping": "C_sw",
        "slipper_swash.stiffness": "K_sw",
        "block_valve.damping": "C_v",
        "block_valve.stiffness": "K_v",
        "piston_bore.damping": "C_Hz",
        "piston_bore.stiffness": "K_Hz",
    }
)
"""The paper's letters. Its names contradict each other (C_v is its "cylinder damping"): this map is ours."""


def _unit(unit: str) -> Any:
    return field(metadata={"unit": unit})


def _require_rising(plate: "ValvePlate", *names: str) -> None:
    for lower, upper in pairwise(names):
        if getattr(plate, lower) >= getattr(plate, upper):
            raise InputError(
                f"valve_plate.{lower} ({getattr(plate, lower):.4g}) must be below "
                f"{upper} ({getattr(plate, upper):.4g})."
            )


@dataclass(frozen=True)
class RotatingGroup:
    """Pistons, slippers and the swash plate's inclination."""

    piston_count: int = _unit("1")
    """Number n of pistons."""
    piston_diameter: float = _unit("m")
    """Diameter d of a piston [m]."""
    pitch_radius: float = _unit("m")
    """Radius R of the circle of bores [m]."""
    swash_angle: float = _unit("rad")
    """Inclination gamma of the swash plate [rad]."""
    slipper_diameter: float = _unit("m")
    """Outer diameter a of a slipper [m]."""
    pocket_diameter: float = _unit("m")
    """Diameter of a slipper's pressure pocket [m]."""
    orifice_diameter: float = _unit("m")
    """Diameter of the damping hole through piston and slipper [m]."""
    orifice_length: float = _unit("m")
    """Length of that hole [m]."""
    piston_clearance: float = _unit("m")
    """Radial clearance of a piston in its bore [m]."""
    piston_eccentricity: float = _unit("1")
    """Relative eccentricity of a piston in its bore [1]."""
    piston_guide_length: float = _unit("m")
    """Length of a piston in its bore at top dead center [m]."""
    slipper_film: float = _unit("m")
    """Film thickness under a healthy slipper [m]."""
    dead_volume: float = _unit("m^3")
    """Chamber volume V0 at top dead center [m^3]."""

    def __post_init__(self) -> None:
        if not 3 <= self.piston_count <= 19:
            raise InputError(f"rotating_group.piston_count ({self.piston_count}) must lie in 3...19.")
        if not 0 < self.swash_angle < math.radians(45):
            raise InputError(
                f"rotating_group.swash_angle ({math.degrees(self.swash_angle):.4g} deg) must lie within 0...45 deg."
            )
        if not 0 <= self.piston_eccentricity <= 1:
            raise InputError(f"rotating_group.piston_eccentricity ({self.piston_eccentricity:g}) must lie in 0...1.")
        wall = 2 * self.pitch_radius * math.sin(math.pi / self.piston_count) - self.piston_diameter
        if wall <= 0:
            raise InputError(
                f"rotating_group: {self.piston_count} bores of {self.piston_diameter * 1e3:.4g} mm overlap on a "
                f"pitch radius of {self.pitch_radius * 1e3:.4g} mm; enlarge pitch_radius or reduce piston_diameter."
            )
        if self.slipper_diameter <= self.pocket_diameter:
            raise InputError("rotating_group.slipper_diameter must exceed pocket_diameter.")
        if not 1e-8 <= self.displacement <= 5e-3:
            raise InputError(
                f"rotating_group: piston_diameter, pitch_radius and swash_angle give {self.displacement * 1e6:.4g} mL "
                "per revolution, outside 0.01...5000 mL; look for a slip of the unit."
            )

    @property
    def piston_area(self) -> float:
        """Area of a piston [m^2]."""
        return math.pi / 4 * self.piston_diameter**2

    @property
    def displacement(self) -> float:
        """Volume per revolution [m^3]."""
        return self.piston_count * self.piston_area * 2 * self.pitch_radius * math.tan(self.swash_angle)


@dataclass(frozen=True)
class ValvePlate:
    """Port timing from top dead center, relief grooves and sealing lands."""

    suction_open: float = _unit("rad")
    """Shaft angle at which a bore meets the suction kidney [rad]."""
    suction_close: float = _unit("rad")
    """Shaft angle at which it leaves it [rad]."""
    discharge_open: float = _unit("rad")
    """Shaft angle at which a bore meets the discharge kidney [rad]."""
    discharge_close: float = _unit("rad")
    """Shaft angle at which it leaves it [rad]."""
    port_ramp: float = _unit("rad")
    """Angle over which a kidney opens and closes linearly [rad]."""
    port_area_ratio: float = _unit("1")
    """Largest opening over the piston's area [1]."""
    groove_angle: float = _unit("rad")
    """Length of the relief groove ahead of a kidney [rad]."""
    groove_slope: float = _unit("rad")
    """Inclination of the groove's bottom [rad]."""
    groove_flank: float = _unit("rad")
    """Angle between the groove's flanks [rad]."""
    film: float = _unit("m")
    """Film thickness h_v at the valve plate [m]."""
    outer_land_outer_radius: float = _unit("m")
    """Outer radius of the outer sealing land [m]."""
    outer_land_inner_radius: float = _unit("m")
    """Inner radius of the outer sealing land [m]."""
    inner_land_outer_radius: float = _unit("m")
    """Outer radius of the inner sealing land [m]."""
    inner_land_inner_radius: float = _unit("m")
    """Inner radius of the inner sealing land [m]."""
    film_radius: float = _unit("m")
    """Mean radius r_v of the film [m]."""
    balance_ratio: float = _unit("1")
    """Kidney and film force over piston force, B [1]."""

    def __post_init__(self) -> None:
        _require_rising(
            self,
            "inner_land_inner_radius",
            "inner_land_outer_radius",
            "outer_land_inner_radius",
            "outer_land_outer_radius",
        )
        _require_rising(self, "suction_open", "suction_close", "discharge_open", "discharge_close")


@dataclass(frozen=True)
class Oil:
    """The working fluid."""

    density: float = _unit("kg/m^3")
    """Density [kg/m^3]."""
    viscosity: float = _unit("Pa*s")
    """Dynamic viscosity at `reference_temperature` [Pa s]."""
    reference_temperature: float = _unit("K")
    """Temperature at which `viscosity` holds [K]."""
    viscosity_slope: float = _unit("1/K")
    """Relative fall of the viscosity per kelvin [1/K]."""
    bulk_modulus: float = _unit("Pa")
    """Effective bulk modulus without free air [Pa]."""
    air_fraction: float = _unit("1")
    """Volume fraction of free air at 100 kPa [1]."""
    discharge_coefficient: float = _unit("1")
    """Discharge coefficient of the ports [1]."""

    def viscosity_at(self, temperature: float) -> float:
        """Dynamic viscosity [Pa s] at `temperature` [K], falling exponentially."""
        return self.viscosity * math.exp(-self.viscosity_slope * (temperature - self.reference_temperature))


@dataclass(frozen=True)
class Line:
    """Outlet line with its relief valve."""

    volume: float = _unit("m^3")
    """Oil volume between pump and relief valve [m^3]."""
    relief_override: float = _unit("Pa")
    """Pressure rise of the relief valve from cracking to the pump's full flow [Pa]."""


@dataclass(frozen=True)
class Masses:
    """Masses and transverse inertias of the three bodies."""

    shell: float = _unit("kg")
    """Housing, swash plate and valve plate [kg]."""
    shell_inertia: float = _unit("kg*m^2")
    """Their moment of inertia about x and y [kg m^2]."""
    rotor: float = _unit("kg")
    """Shaft, cylinder block, pistons and bearings [kg]."""
    rotor_inertia: float = _unit("kg*m^2")
    """Their moment of inertia about x and y [kg m^2]."""
    retainer: float = _unit("kg")
    """Retainer, spring and slippers [kg]."""
    piston_slipper: float = _unit("kg")
    """One piston with its slipper [kg]."""
    rotor_eccentricity: float = _unit("m")
    """Eccentricity of the rotor's center of gravity [m]."""


@dataclass(frozen=True)
class Positions:
    """Places along the shaft, from the slippers' plane toward the valve plate."""

    shell: float = _unit("m")
    """Center of gravity zeta_F of the shell [m]."""
    rotor: float = _unit("m")
    """Center of gravity zeta_C of the rotor [m]."""
    valve_plate: float = _unit("m")
    """Valve plate z_v [m]."""
    mount: float = _unit("m")
    """Mounting flange z_m [m]."""


@dataclass(frozen=True)
class Mount:
    """How the shell stands on the ground."""

    stiffness_x: float = _unit("N/m")
    """Transverse stiffness [N/m]."""
    stiffness_y: float = _unit("N/m")
    """Transverse stiffness in the swash plate's direction of rise [N/m]."""
    stiffness_z: float = _unit("N/m")
    """Axial stiffness [N/m]."""
    stiffness_tilt: float = _unit("N*m/rad")
    """Stiffness against tilting about x and y [N m/rad]."""
    damping_ratio: float = _unit("1")
    """Modal damping ratio [1]."""


@dataclass(frozen=True)
class Bearings:
    """The three bearings between rotor and shell."""

    positions: tuple[float, ...] = _unit("m")
    """Places along the shaft [m]."""
    stiffnesses: tuple[float, ...] = _unit("N/m")
    """Radial stiffnesses [N/m]."""
    axial_stiffness: float = _unit("N/m")
    """Axial stiffness of the last one [N/m]."""
    damping_time: float = _unit("s")
    """Damping over stiffness [s]."""

    def __post_init__(self) -> None:
        if len(self.positions) != len(self.stiffnesses) or not self.positions:
            raise InputError(
                "bearings: positions and stiffnesses must be lists of the same length, one entry a bearing."
            )


@dataclass(frozen=True)
class Coupling:
    """What ties retainer and rotor besides the films."""

    spring_stiffness: float = _unit("N/m")
    """Central spring [N/m]."""
    spring_preload: float = _unit("N")
    """Force of the central spring, which presses the block on the valve plate [N]."""
    lateral_ratio: float = _unit("1")
    """Lateral over axial stiffness of a piston in its bore, kappa_r [1]."""


@dataclass(frozen=True)
class Interface:
    """One spring-damper between two bodies."""

    damping: float = _unit("N*s/m")
    """Damping C [N s/m]."""
    stiffness: float = _unit("N/m")
    """Stiffness K [N/m]."""


@dataclass(frozen=True)
class Interfaces:
    """The three interfaces whose six values calibration finds."""

    slipper_swash: Interface
    """Slippers on the swash plate: C_sw, K_sw, totals of all slippers."""
    block_valve: Interface
    """Cylinder block on the valve plate: C_v, K_v."""
    piston_bore: Interface
    """Pistons in their bores: C_Hz, K_Hz, totals of all pistons."""

    def values(self) -> tuple[float, ...]:
        """The six values in the order of `PARAMETERS` [N s/m, N/m, ...]."""
        return tuple(float(getattr(getattr(self, name.split(".")[0]), name.split(".")[1])) for name in PARAMETERS)

    @classmethod
    def from_values(cls, values: Any) -> "Interfaces":
        """Interfaces with six values in the order of `PARAMETERS`.

        Raises
        ------
        InputError
            Not six values, or one that is not positive.
        """
        numbers = [float(value) for value in values]
        if len(numbers) != len(PARAMETERS):
            raise InputError(f"{len(numbers)} interface values; there are {len(PARAMETERS)}: {', '.join(PARAMETERS)}.")
        for name, number in zip(PARAMETERS, numbers, strict=True):
            if not (math.isfinite(number) and number > 0):
                raise InputError(f"{name} ({number:g}) must be a positive number.")
        return cls(
            slipper_swash=Interface(damping=numbers[0], stiffness=numbers[1]),
            block_valve=Interface(damping=numbers[2], stiffness=numbers[3]),
            piston_bore=Interface(damping=numbers[4], stiffness=numbers[5]),
        )


@dataclass(frozen=True)
class Rated:
    """Operating point that the pump is made for; port timing and interface values of its file hold there."""

    speed: float = _unit("rad/s")
    """Angular speed of the shaft [rad/s]."""
    discharge_pressure: float = _unit("Pa")
    """Discharge pressure [Pa]."""


@dataclass(frozen=True)
class Sensor:
    """One accelerometer on the shell."""

    name: str
    """Channel name."""
    position: tuple[float, float, float]
    """Place (x, y, z) [m]; z along the shaft from the slippers' plane toward the valve plate."""
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
    """Operating point that it is made for, or None where its file states none."""
    sources: Mapping[str, str] = field(default_factory=dict, compare=False, repr=False)
    """Where each number comes from, by its path such as ``masses.shell``."""

    @property
    def channels(self) -> tuple[str, ...]:
        """Channel names of the sensors."""
        return tuple(sensor.name for sensor in self.sensors)

    def with_interfaces(self, interfaces: Interfaces) -> "Pump":
        """The same pump with other nominal interface values."""
        return replace(self, interfaces=interfaces)
