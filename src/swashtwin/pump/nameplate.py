"""A pump scaled from its nameplate: geometric similarity to a pump whose parameters are known.

Ratios of the new pump to the original: length L (pitch radius), bore D (piston diameter), stroke S,
count N of pistons, pressure P and speed W of the nameplates. The bores keep their share of the
pitch circle's chord, so that

    D = L sin(pi/n) / sin(pi/n0),    S = L tan(gamma) / tan(gamma0),    N D^2 S = V_g / V_g0

and the displacement V_g sets L; with the same pistons and swash angle L = (V_g / V_g0)^(1/3).
Structural stiffnesses follow L: the laws of similarity for one material (M. Weber, *Das allgemeine
Ähnlichkeitsprinzip der Physik*, 1930; for machines of one series Pahl and Beitz, *Engineering
Design*, size ranges). Housings are not similar: the mass of the whole pump is the one specified, or
that of catalogs, `catalog_mass`; its parts keep their shares of it (ratio M), and inertias follow M
L^2. The other laws are our own derivations from the films and volumes of
docs/explanation/physics.md, section 4:

- gaps grow with the part that they belong to, the oil is the same: a squeeze film's damping mu a^4
  / h^3 follows its length, its stiffness p a^2 / h the pressure times its length, a fluid column's
  stiffness B A^2 / V the ratio D^2 / S;
- an unbalance keeps its quality grade, e omega (ISO 21940-11);
- a relief groove passes V p omega / B within its angle, at sqrt(p): its area follows D^2 S W
  sqrt(P);
- the kidneys open where a closed chamber has reached the pressure, as early or late about that as
  in the original.
"""

import math
import re
from dataclasses import dataclass, replace
from typing import Any

from swashtwin.foundation import InputError, UnitError, parse_quantity
from swashtwin.pump.condition import OperatingCondition
from swashtwin.pump.geometry import (
    compression_angle,
    decompression_angle,
    require_sound_geometry,
)
from swashtwin.pump.parameters import Pump, Rated, map_numbers

_PER_REVOLUTION = re.compile(r"\s*(?:/|per)\s*(?:rev(?:olution)?|r|U|turn)\.?\s*$")
_CUBIC = re.compile(r"\b(cm|dm|mm|m)(?:3|³)|\bccm\b")


@dataclass(frozen=True)
class Nameplate:
    """Values on the nameplate of a pump, or in its data sheet.

    Raises
    ------
    InputError
        A value is outside what axial piston pumps have.
    """

    displacement: float
    """Volume per revolution [m^3]."""
    piston_count: int
    """Number of pistons."""
    speed: float
    """Rated angular speed [rad/s]."""
    discharge_pressure: float
    """Rated discharge pressure [Pa]."""
    swash_angle: float | None = None
    """Inclination of the swash plate at full displacement [rad]; None takes the original's."""
    mass: float | None = None
    """Mass of the pump without oil [kg]; None takes that of catalogs (`catalog_mass`)."""

    def __post_init__(self) -> None:
        OperatingCondition(self.speed, self.discharge_pressure)  # which checks both

        if not 1e-8 <= self.displacement <= 5e-3:
            raise InputError(
                f"displacement ({self.displacement * 1e6:.4g} mL per revolution) must lie in "
                "0.01...5000 mL; check its unit."
            )
        if not 3 <= self.piston_count <= 19:
            raise InputError(
                f"piston_count ({self.piston_count}) must lie in 3...19; most pumps have 7 or 9."
            )
        if self.swash_angle is not None and not 0 < self.swash_angle < math.radians(45):
            raise InputError(
                f"swash_angle ({math.degrees(self.swash_angle):.4g} deg) "
                "must lie within 0...45 deg."
            )
        if self.mass is not None and not 0.1 <= self.mass <= 5000:
            raise InputError(
                f"mass ({self.mass:.4g} kg) must lie in 0.1...5000 kg; check its unit."
            )


def catalog_mass(displacement: float) -> float:
    """Return the typical mass [kg] of a variable swash plate pump without oil.

    22 kg (V / 45 cm^3)^0.8: within 12 % of 12, 15, 21, 33, 45 and 60 kg that the A10V(S)O of series
    31 weighs at 18, 28, 45, 71, 100 and 140 cm^3 (catalogs RE 92701 and 92711 of Bosch Rexroth,
    "weight without fluid").

    Parameters
    ----------
    displacement : volume per revolution [m^3].

    Examples
    --------
    >>> round(catalog_mass(100e-6))
    42
    """
    mass: float = 22.0 * (displacement / 45e-6) ** 0.8
    return mass


def read_nameplate(
    *,
    displacement: str,
    pistons: int,
    speed: str,
    pressure: str,
    swash_angle: str | None = None,
    mass: str | None = None,
) -> Nameplate:
    """Return the nameplate of quantities with units.

    Parameters
    ----------
    displacement, speed, pressure, swash_angle, mass : such as ``"45 cm3/rev"``, ``"1500 rpm"``,
        ``"280 bar"``, ``"15 deg"``, ``"21 kg"``.

    Raises
    ------
    UnitError
        A number has no unit, or one of another quantity.
    InputError
        A value is outside what axial piston pumps have.
    """
    volume_text = _PER_REVOLUTION.sub("", displacement)
    volume_text = _CUBIC.sub(lambda match: f"{match[1] or 'cm'}^3", volume_text)
    try:
        volume = parse_quantity(volume_text, "m^3", name="displacement")
    except UnitError as cause:
        raise UnitError(
            f"displacement = {displacement!r} is not a volume per revolution; "
            'write it as "45 cm3/rev" or "45 mL".'
        ) from cause

    return Nameplate(
        displacement=volume,
        piston_count=pistons,
        speed=parse_quantity(speed, "rad/s", name="speed"),
        discharge_pressure=parse_quantity(pressure, "Pa", name="pressure"),
        swash_angle=None
        if swash_angle is None
        else parse_quantity(swash_angle, "rad", name="swash_angle"),
        mass=None if mass is None else parse_quantity(mass, "kg", name="mass"),
    )


# Section and numbers that scale, their law in the ratios of the module's docstring, and why.
_LAW_TABLE = """
rotating_group piston_diameter | D | bores keep their share of the pitch circle
rotating_group pitch_radius | L | set by the nameplate's displacement
rotating_group slipper_diameter pocket_diameter orifice_diameter | D | as the bore
rotating_group piston_clearance slipper_film | D | as the bore
rotating_group orifice_length piston_guide_length | S | as the stroke
rotating_group dead_volume | D^2 S | as the volume of a stroke
valve_plate port_ramp | D/L | angle of a bore on the pitch circle
valve_plate film outer_land_outer_radius outer_land_inner_radius | L | as the length
valve_plate inner_land_outer_radius inner_land_inner_radius film_radius | L | as the length
line volume | N D^2 S | as the displacement; measure yours
masses shell rotor retainer | M | its share of the pump's mass
masses shell_inertia rotor_inertia | M L^2 | mass times length squared
masses piston_slipper | D^2 S | as the volume
masses rotor_eccentricity | 1/W | the quality grade of balancing stays, ISO 21940-11
positions shell rotor valve_plate mount | L | as the length
mount stiffness_x stiffness_y stiffness_z \
| L | a structure of one material; yours depends on its bracket
mount stiffness_tilt | L^3 | stiffness times length squared; yours depends on its bracket
bearings positions axial_stiffness | L | as the length
bearings stiffnesses | L | as the length; the load's small power is left out
coupling spring_stiffness | L | as the length
coupling spring_preload | L^2 | equal stress
interfaces.slipper_swash damping | N D | squeeze films of equal proportions
interfaces.slipper_swash stiffness | N P D | hydrostatic films of equal proportions
interfaces.block_valve damping | L | squeeze film of equal proportions
interfaces.block_valve stiffness | P L | hydrostatic film of equal proportions
interfaces.piston_bore damping | N S | sheared film of equal proportions
interfaces.piston_bore stiffness | N D^2/S | fluid columns
sensors position | L | as the length; say where yours are
"""


def _read_laws(table: str) -> dict[str, tuple[str, str]]:
    laws: dict[str, tuple[str, str]] = {}
    for line in table.strip().splitlines():
        paths, law, reason = (text.strip() for text in line.split("|"))
        section, *names = paths.split()
        for name in names:
            laws[f"{section}.{name}"] = (law, reason)
    return laws


# (law, reason) of each number that scales, by its path.
_LAWS = _read_laws(_LAW_TABLE)


def scaled_pump(original: Pump, nameplate: Nameplate, name: str) -> Pump:
    """Return pump `name` with the values of a nameplate, similar to `original`.

    The source of each number begins with ``nameplate``, with ``scaled`` (and the law), or with
    ``guess`` (the number of the original).

    Raises
    ------
    InputError
        `original` has no rated operating point, or the parts of the new pump do not fit each other.
    """
    if original.rated is None:
        raise InputError(
            f"{original.name} states no [rated] speed and discharge_pressure to scale from; "
            "add them to its file."
        )

    ratios = _similarity_ratios(original, original.rated, nameplate)
    masses = original.masses
    total_mass = nameplate.mass
    mass_source = "as specified"
    if total_mass is None:
        total_mass = catalog_mass(nameplate.displacement)
        mass_source = "by catalogs; weigh yours"
    ratios["M"] = total_mass / (masses.shell + masses.rotor + masses.retainer)

    nameplate_values = {
        "rotating_group.piston_count": nameplate.piston_count,
        "rotating_group.swash_angle": nameplate.swash_angle,
        "rated.speed": nameplate.speed,
        "rated.discharge_pressure": nameplate.discharge_pressure,
    }
    sources: dict[str, str] = {}

    def scale_number(path: str, value: Any, unit: str) -> Any:
        if nameplate_values.get(path) is not None:
            sources[path] = "nameplate"
            return nameplate_values[path]

        origin = f"{original.name} ({original.sources.get(path, 'no source')})"
        law, reason = _LAWS.get(re.sub(r"\[\d+\]", "", path), ("", ""))
        if not law:
            sources[path] = f"guess: as {origin}"
            return value

        factor = _evaluate_law(law, ratios)
        if law.startswith("M"):
            reason += f" ({total_mass:.3g} kg, {mass_source})"
        sources[path] = f"scaled: {law} = {factor:.4g}, {reason}, of {origin}"
        if isinstance(value, tuple):
            return tuple(number * factor for number in value)
        return value * factor

    pump = map_numbers(replace(original, name=name, sources=sources), scale_number)
    pump = _scale_port_timing(pump, original, original.rated, ratios, sources)
    require_sound_geometry(pump)
    return pump


def _similarity_ratios(original: Pump, rated: Rated, nameplate: Nameplate) -> dict[str, float]:
    """Return the ratios of the module's docstring but M, by their letters."""
    group = original.rotating_group
    swash_angle = nameplate.swash_angle or group.swash_angle

    chord = math.sin(math.pi / nameplate.piston_count) / math.sin(math.pi / group.piston_count)
    incline = math.tan(swash_angle) / math.tan(group.swash_angle)
    count = nameplate.piston_count / group.piston_count
    length = (nameplate.displacement / group.displacement / (count * chord**2 * incline)) ** (1 / 3)
    return {
        "L": length,
        "D": length * chord,
        "S": length * incline,
        "N": count,
        "P": nameplate.discharge_pressure / rated.discharge_pressure,
        "W": nameplate.speed / rated.speed,
    }


def _evaluate_law(law: str, ratios: dict[str, float]) -> float:
    """Return the factor of a law such as ``"N D^2/S"``."""
    numerator, _, denominator = law.partition("/")
    factor = 1.0
    for text, sign in ((numerator, 1), (denominator, -1)):
        for term in text.split():
            letter, _, exponent = term.partition("^")
            factor *= ratios.get(letter, 1.0) ** (sign * int(exponent or 1))
    return factor


def _scale_port_timing(
    pump: Pump, original: Pump, rated: Rated, ratios: dict[str, float], sources: dict[str, str]
) -> Pump:
    """Return the pump with kidneys and grooves for the nameplate's pressure.

    The kidneys open as early or late about the end of compression as in the original, and the
    grooves pass the oil that this compression takes.
    """
    plate = original.valve_plate
    timing: dict[str, float] = {}
    pressure = ratios["P"] * rated.discharge_pressure
    for name, angle_at, event in (
        ("discharge_open", compression_angle, "compression"),
        ("suction_open", decompression_angle, "decompression"),
    ):
        original_angle = angle_at(original.rotating_group, original.oil, rated.discharge_pressure)
        angle = angle_at(pump.rotating_group, pump.oil, pressure)
        timing[name] = getattr(plate, name) + angle - original_angle
        sources[f"valve_plate.{name}"] = (
            f"scaled: {event} at {pressure / 1e6:.4g} MPa takes {math.degrees(angle):.3g} deg, "
            f"{math.degrees(original_angle):.3g} deg in {original.name}"
        )

    area_ratio = _evaluate_law("D^2 S W", ratios) * math.sqrt(ratios["P"])
    timing["groove_slope"] = math.atan(
        math.tan(plate.groove_slope) * math.sqrt(area_ratio) / ratios["L"]
    )
    sources["valve_plate.groove_slope"] = (
        f"scaled: area D^2 S W sqrt(P) = {area_ratio:.4g}, to pass the oil that compression takes, "
        f"of {original.name} ({original.sources.get('valve_plate.groove_slope', 'no source')})"
    )
    return replace(pump, valve_plate=replace(pump.valve_plate, **timing))
