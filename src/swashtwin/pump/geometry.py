"""Whether the parts of a pump fit each other: what a file's numbers cannot be together."""

import math

from swashtwin.foundation import InputError
from swashtwin.pump.parameters import Oil, Pump, RotatingGroup


def require_sound_geometry(pump: Pump) -> None:
    """Refuse a pump two of whose parts cannot be built together; the error names them.

    Raises
    ------
    InputError
        Slippers overlap, a piston leaves its bore, a damping hole is wider than its pocket, the bores lie outside the
        kidneys, kidneys overlap, a groove is too steep, or the block is pushed off the valve plate.
    """
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
    """Shaft angle [rad] after bottom dead center over which a closed chamber reaches `pressure` [Pa].

    The piston must sweep dV = V p / B of the full chamber V = V0 + 2 A R tan(gamma), and it sweeps A R tan(gamma)
    (1 - cos phi): phi = acos(1 - V p / (B A R tan(gamma))). Free air is left out (docs/explanation/physics.md, section
    4).

    Raises
    ------
    InputError
        The chamber is too large: not even the whole stroke reaches the pressure.
    """
    return _angle(group, oil, pressure, group.dead_volume + group.piston_area * stroke_of(group))


def decompression_angle(group: RotatingGroup, oil: Oil, pressure: float) -> float:
    """The same after top dead center, over which the dead volume V0 expands from `pressure` [Pa]."""
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
