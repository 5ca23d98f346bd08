"""A pump scaled from its nameplate: geometric similarity to a pump whose parameters are known.

Ratios of the new pump to the original: length L (pitch radius), bore D (piston diameter), stroke S,
count N of pistons, pressure P and speed W of the nameplates. The bores keep their share of the
pitch circle's chord, so that

    D = L sin(pi/n) / sin(pi/n0),    S = L tan(gamma) / tan(gamma0),    N D^2 S = V_g / V_g0

and the displacement V_g sets L; with the same pistons and swash angle L = (V_g / V_g0)^(1/3).
Structural stiffnesses follow L: the laws of similarity for one material (M. Weber, *Das allgemeine
Ähnlichkeitsprinzip der Physik*, 1930; for machines of one series Pahl and Beitz, *Engineering
Design*, size ranges). Housings are not similar: the mass of the whole pump is the one stated, or
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
from swashtwin.pump.parameters import Oil, Pump, Rated, RotatingGroup, with_numbers

_PER_TURN = re.compile(r"\s*(?:/|per)\s*(?:rev(?:olution)?|r|U|turn)\.?\s*$")
_CUBIC = re.compile(r"\b(cm|dm|mm|m)(?:3|³)|\bccm\b")


@dataclass(frozen=True)
class Nameplate:
    """What the plate on a pump, or its data sheet, says.

    Raises
    ------
    InputError
        No axial piston pump has such a plate.
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
        OperatingCondition(self.speed, self.discharge_pressure)
        if not 1e-8 <= self.displacement <= 5e-3:
            raise InputError(
                f"displacement ({self.displacement * 1e6:.4g} mL per revolution) must lie in 0.01...5000 mL; look for "
                "a slip of the unit."
            )
        if not 3 <= self.piston_count <= 19:
            raise InputError(
                f"piston_count ({self.piston_count}) must lie in 3...19; most pumps have 7 or 9."
            )
        if self.swash_angle is not None and not 0 < self.swash_angle < math.radians(45):
            raise InputError(
                f"swash_angle ({math.degrees(self.swash_angle):.4g} deg) must lie within 0...45 deg."
            )
        if self.mass is not None and not 0.1 <= self.mass <= 5000:
            raise InputError(
                f"mass ({self.mass:.4g} kg) must lie in 0.1...5000 kg; look for a slip of the unit."
            )


def catalog_mass(displacement: float) -> float:
    """Usual mass [kg] of a variable swash plate pump without oil, by its volume per revolution
    [m^3].

    22 kg (V / 45 cm^3)^0.8: within 12 % of 12, 15, 21, 33, 45 and 60 kg that the A10V(S)O of series
    31 weighs at 18, 28, 45, 71, 100 and 140 cm^3 (catalogs RE 92701 and 92711 of Bosch Rexroth,
    "weight without fluid").

    Examples
    --------
    >>> round(catalog_mass(100e-6))
    42
    """
    return 22.0 * (displacement / 45e-6) ** 0.8


def read_nameplate(
    *,
    displacement: str,
    pistons: int,
    speed: str,
    pressure: str,
    swash_angle: str | None = None,
    mass: str | None = None,
) -> Nameplate:
    """Nameplate of quantities with units, such as ``"45 cm3/rev"``, ``"1500 rpm"``, ``"280 bar"``,
    ``"21 kg"``.

    Raises
    ------
    UnitError
        A number without a unit, or with one of another dimension.
    InputError
        No axial piston pump has such a plate.
    """
    volume = _CUBIC.sub(lambda match: f"{match[1] or 'cm'}^3", _PER_TURN.sub("", displacement))
    try:
        size = parse_quantity(volume, "m^3", name="displacement")
    except UnitError as cause:
        raise UnitError(
            f'displacement = {displacement!r} is no volume per revolution; write it as "45 cm3/rev" or "45 mL".'
        ) from cause
    return Nameplate(
        size,
        pistons,
        parse_quantity(speed, "rad/s", name="speed"),
        parse_quantity(pressure, "Pa", name="pressure"),
        None if swash_angle is None else parse_quantity(swash_angle, "rad", name="swash_angle"),
        None if mass is None else parse_quantity(mass, "kg", name="mass"),
    )


_LAWS = {
    f"{section}.{name}": (law, reason)
    for law, reason, section, names in (
        ("D", "bores keep their share of the pitch circle", "rotating_group", "piston_diameter"),
        ("L", "set by the nameplate's displacement", "rotating_group", "pitch_radius"),
        ("D", "as the bore", "rotating_group", "slipper_diameter pocket_diameter orifice_diameter"),
        ("D", "as the bore", "rotating_group", "piston_clearance slipper_film"),
        ("S", "as the stroke", "rotating_group", "orifice_length piston_guide_length"),
        ("D^2 S", "as the volume of a stroke", "rotating_group", "dead_volume"),
        ("D/L", "angle of a bore on the pitch circle", "valve_plate", "port_ramp"),
        (
            "L",
            "as the length",
            "valve_plate",
            "film outer_land_outer_radius outer_land_inner_radius",
        ),
        (
            "L",
            "as the length",
            "valve_plate",
            "inner_land_outer_radius inner_land_inner_radius film_radius",
        ),
        ("N D^2 S", "as the displacement; measure yours", "line", "volume"),
        ("M", "its share of the pump's mass", "masses", "shell rotor retainer"),
        ("M L^2", "mass times length squared", "masses", "shell_inertia rotor_inertia"),
        ("D^2 S", "as the volume", "masses", "piston_slipper"),
        (
            "1/W",
            "the quality grade of balancing stays, ISO 21940-11",
            "masses",
            "rotor_eccentricity",
        ),
        ("L", "as the length", "positions", "shell rotor valve_plate mount"),
        (
            "L",
            "a structure of one material; yours depends on its bracket",
            "mount",
            "stiffness_x stiffness_y",
        ),
        ("L", "a structure of one material; yours depends on its bracket", "mount", "stiffness_z"),
        (
            "L^3",
            "stiffness times length squared; yours depends on its bracket",
            "mount",
            "stiffness_tilt",
        ),
        ("L", "as the length", "bearings", "positions axial_stiffness"),
        ("L", "as the length; the load's small power is left out", "bearings", "stiffnesses"),
        ("L", "as the length", "coupling", "spring_stiffness"),
        ("L^2", "equal stress", "coupling", "spring_preload"),
        ("N D", "squeeze films of equal proportions", "interfaces.slipper_swash", "damping"),
        (
            "N P D",
            "hydrostatic films of equal proportions",
            "interfaces.slipper_swash",
            "stiffness",
        ),
        ("L", "squeeze film of equal proportions", "interfaces.block_valve", "damping"),
        ("P L", "hydrostatic film of equal proportions", "interfaces.block_valve", "stiffness"),
        ("N S", "sheared film of equal proportions", "interfaces.piston_bore", "damping"),
        ("N D^2/S", "fluid columns", "interfaces.piston_bore", "stiffness"),
        ("L", "as the length; say where yours are", "sensors", "position"),
    )
    for name in names.split()
}
"""Law of each number that scales, in the ratios of the module's docstring, and why."""


def scaled_pump(original: Pump, nameplate: Nameplate, name: str) -> Pump:
    """Pump `name` of a nameplate, similar to `original`; the source of each number says what it
    rests on.

    A source begins with ``nameplate``, with ``scaled`` (and the law), or with ``guess`` (as in the
    original).

    Raises
    ------
    InputError
        `original` states no rated operating point, or the parts of the new pump do not fit each
        other.
    """
    if original.rated is None:
        raise InputError(
            f"{original.name} states no [rated] speed and discharge_pressure to scale from; add them to its file."
        )
    ratios = _ratios(original, original.rated, nameplate)
    weight = catalog_mass(nameplate.displacement) if nameplate.mass is None else nameplate.mass
    ratios["M"] = weight / (
        original.masses.shell + original.masses.rotor + original.masses.retainer
    )
    stated = {
        "rotating_group.piston_count": nameplate.piston_count,
        "rotating_group.swash_angle": nameplate.swash_angle,
        "rated.speed": nameplate.speed,
        "rated.discharge_pressure": nameplate.discharge_pressure,
    }
    sources: dict[str, str] = {}

    def scaled(path: str, value: Any, unit: str) -> Any:
        if stated.get(path) is not None:
            sources[path] = "nameplate"
            return stated[path]
        law, reason = _LAWS.get(re.sub(r"\[\d+\]", "", path), ("", ""))
        factor = _power(law, ratios)
        if law.startswith("M"):
            reason += f" ({weight:.3g} kg, {'by catalogs; weigh yours' if nameplate.mass is None else 'as stated'})"
        there = f"{original.name} ({original.sources.get(path, 'no source')})"
        sources[path] = (
            f"scaled: {law} = {factor:.4g}, {reason}, of {there}" if law else f"guess: as {there}"
        )
        if not law:
            return value
        return (
            tuple(number * factor for number in value)
            if isinstance(value, tuple)
            else value * factor
        )

    pump = with_numbers(replace(original, name=name, sources=sources), scaled)
    pump = _with_timing(pump, original, original.rated, ratios, sources)
    require_sound_geometry(pump)
    return pump


def _ratios(original: Pump, rated: Rated, nameplate: Nameplate) -> dict[str, float]:
    group, angle = (
        original.rotating_group,
        nameplate.swash_angle or original.rotating_group.swash_angle,
    )
    chord = math.sin(math.pi / nameplate.piston_count) / math.sin(math.pi / group.piston_count)
    incline = math.tan(angle) / math.tan(group.swash_angle)
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


def _power(law: str, ratios: dict[str, float]) -> float:
    above, _, below = law.partition("/")
    factor = 1.0
    for text, sign in ((above, 1), (below, -1)):
        for term in text.split():
            letter, _, exponent = term.partition("^")
            factor *= ratios.get(letter, 1.0) ** (sign * int(exponent or 1))
    return factor


def _with_timing(
    pump: Pump, original: Pump, rated: Rated, ratios: dict[str, float], sources: dict[str, str]
) -> Pump:
    """The pump with kidneys that open at the nameplate's pressure, and grooves that pass the oil of
    its compression.
    """
    plate, values = original.valve_plate, {}
    pressure = ratios["P"] * rated.discharge_pressure
    for name, angle, event in (
        ("discharge_open", compression_angle, "compression"),
        ("suction_open", decompression_angle, "decompression"),
    ):
        before = angle(original.rotating_group, original.oil, rated.discharge_pressure)
        after = angle(pump.rotating_group, pump.oil, pressure)
        values[name] = getattr(plate, name) + after - before
        sources[f"valve_plate.{name}"] = (
            f"scaled: {event} at {pressure / 1e6:.4g} MPa takes {math.degrees(after):.3g} deg, "
            f"{math.degrees(before):.3g} deg in {original.name}"
        )
    area = _power("D^2 S W", ratios) * math.sqrt(ratios["P"])
    values["groove_slope"] = math.atan(math.tan(plate.groove_slope) * math.sqrt(area) / ratios["L"])
    sources["valve_plate.groove_slope"] = (
        f"scaled: area D^2 S W sqrt(P) = {area:.4g}, to pass the oil that compression takes, of {original.name} "
        f"({original.sources.get('valve_plate.groove_slope', 'no source')})"
    )
    return replace(pump, valve_plate=replace(pump.valve_plate, **values))


def require_sound_geometry(pump: Pump) -> None:
    """Refuse a pump two of whose parts cannot be built together; the error names them."""
    group, plate = pump.rotating_group, pump.valve_plate
    chord = 2 * group.pitch_radius * math.sin(math.pi / group.piston_count)
    stroke = stroke_of(group)
    if group.slipper_diameter >= chord:
        raise InputError(
            f"rotating_group: {group.piston_count} slippers of {_mm(group.slipper_diameter)} overlap on a pitch radius "
            f"of {_mm(group.pitch_radius)}, where they stand {_mm(chord)} apart; enlarge pitch_radius or reduce "
            "slipper_diameter."
        )
    if stroke >= group.piston_guide_length:
        raise InputError(
            f"rotating_group: the stroke of {_mm(stroke)} (twice pitch_radius times tan swash_angle) pulls the pistons "
            f"out of their bores, which guide them over {_mm(group.piston_guide_length)}; enlarge piston_guide_length "
            "or reduce swash_angle."
        )
    if group.orifice_diameter >= group.pocket_diameter:
        raise InputError(
            f"rotating_group.orifice_diameter ({_mm(group.orifice_diameter)}) must be below pocket_diameter "
            f"({_mm(group.pocket_diameter)})."
        )
    if not plate.inner_land_outer_radius < group.pitch_radius < plate.outer_land_inner_radius:
        raise InputError(
            f"rotating_group.pitch_radius ({_mm(group.pitch_radius)}) must lie between the sealing lands of the valve "
            f"plate, where the kidneys are: above inner_land_outer_radius ({_mm(plate.inner_land_outer_radius)}) and "
            f"below outer_land_inner_radius ({_mm(plate.outer_land_inner_radius)})."
        )
    if not plate.inner_land_inner_radius < plate.film_radius < plate.outer_land_outer_radius:
        raise InputError(
            f"valve_plate.film_radius ({_mm(plate.film_radius)}) must lie on the valve plate, between "
            f"inner_land_inner_radius ({_mm(plate.inner_land_inner_radius)}) and outer_land_outer_radius "
            f"({_mm(plate.outer_land_outer_radius)})."
        )
    if plate.discharge_close >= plate.suction_open + 2 * math.pi:
        raise InputError(
            f"valve_plate: the kidneys overlap at top dead center: discharge_close "
            f"({math.degrees(plate.discharge_close):.4g} deg) must be below suction_open one turn on "
            f"({math.degrees(plate.suction_open) + 360:.4g} deg)."
        )
    if plate.groove_slope >= math.radians(60) or plate.groove_flank >= math.pi:
        raise InputError(
            f"valve_plate: a groove of {math.degrees(plate.groove_slope):.4g} deg with flanks "
            f"{math.degrees(plate.groove_flank):.4g} deg apart cannot be milled; groove_slope must be below 60 deg and "
            "groove_flank below 180 deg."
        )
    if plate.balance_ratio >= 1:
        raise InputError(
            f"valve_plate.balance_ratio ({plate.balance_ratio:.4g}) must be below 1: the oil would push the cylinder "
            "block off the valve plate."
        )


def stroke_of(group: RotatingGroup) -> float:
    """Stroke of a piston [m]."""
    return 2 * group.pitch_radius * math.tan(group.swash_angle)


def compression_angle(group: RotatingGroup, oil: Oil, pressure: float) -> float:
    """Shaft angle [rad] after bottom dead center over which a closed chamber reaches `pressure`
    [Pa].

    The piston must sweep dV = V p / B of the full chamber V = V0 + 2 A R tan(gamma), and it sweeps
    A R tan(gamma) (1 - cos phi): phi = acos(1 - V p / (B A R tan(gamma))). Free air is left out
    (docs/explanation/physics.md, section 4).
    """
    return _angle(group, oil, pressure, group.dead_volume + group.piston_area * stroke_of(group))


def decompression_angle(group: RotatingGroup, oil: Oil, pressure: float) -> float:
    """The same after top dead center, over which the dead volume V0 expands from `pressure`
    [Pa].
    """
    return _angle(group, oil, pressure, group.dead_volume)


def _angle(group: RotatingGroup, oil: Oil, pressure: float, volume: float) -> float:
    swept = group.piston_area * stroke_of(group) / 2
    share = volume * pressure / (oil.bulk_modulus * swept)
    if share >= 2:
        raise InputError(
            f"the stroke displaces {2e6 * swept:.4g} mL, too little to bring a chamber of {volume * 1e6:.4g} mL to "
            f"{pressure / 1e6:.4g} MPa; reduce dead_volume or the pressure."
        )
    return math.acos(1 - share)


def _mm(length: float) -> str:
    return f"{length * 1e3:.4g} mm"
