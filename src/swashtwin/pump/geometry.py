"""Geometry that involves several parts of a pump: whether they fit, and how chambers compress."""

import math

from swashtwin.foundation import InputError
from swashtwin.pump.parameters import Oil, Pump, RotatingGroup, ValvePlate

# Steepest groove [rad] that a cutter with a flank can mill.
_MAX_GROOVE_SLOPE = math.radians(60)

# Angle [rad] between the groove's flanks at which they no longer form a groove.
_MAX_GROOVE_FLANK = math.pi


def require_sound_geometry(pump: Pump) -> None:
    """Refuse a pump with two parts that cannot be built together.

    Raises
    ------
    InputError
        The message names both parts and what to change.
    """
    _require_sound_rotating_group(pump.rotating_group)
    _require_kidneys_between_lands(pump.rotating_group, pump.valve_plate)
    _require_sound_valve_plate(pump.valve_plate)


def _require_sound_rotating_group(group: RotatingGroup) -> None:
    slipper_distance = 2 * group.pitch_radius * math.sin(math.pi / group.piston_count)
    if group.slipper_diameter >= slipper_distance:
        raise InputError(
            f"rotating_group: {group.piston_count} slippers of {_mm(group.slipper_diameter)} "
            f"overlap on a pitch radius of {_mm(group.pitch_radius)}, where they stand "
            f"{_mm(slipper_distance)} apart; enlarge pitch_radius or reduce slipper_diameter."
        )

    stroke = stroke_of(group)
    if stroke >= group.piston_guide_length:
        raise InputError(
            f"rotating_group: the stroke of {_mm(stroke)} (twice pitch_radius times tan "
            "swash_angle) pulls the pistons out of their bores, which guide them over "
            f"{_mm(group.piston_guide_length)}; enlarge piston_guide_length or reduce swash_angle."
        )

    if group.orifice_diameter >= group.pocket_diameter:
        raise InputError(
            f"rotating_group.orifice_diameter ({_mm(group.orifice_diameter)}) must be below "
            f"pocket_diameter ({_mm(group.pocket_diameter)})."
        )


def _require_kidneys_between_lands(group: RotatingGroup, plate: ValvePlate) -> None:
    if not plate.inner_land_outer_radius < group.pitch_radius < plate.outer_land_inner_radius:
        raise InputError(
            f"rotating_group.pitch_radius ({_mm(group.pitch_radius)}) must lie between the "
            "sealing lands of the valve plate, where the kidneys are: above "
            f"inner_land_outer_radius ({_mm(plate.inner_land_outer_radius)}) and below "
            f"outer_land_inner_radius ({_mm(plate.outer_land_inner_radius)})."
        )


def _require_sound_valve_plate(plate: ValvePlate) -> None:
    if not plate.inner_land_inner_radius < plate.film_radius < plate.outer_land_outer_radius:
        raise InputError(
            f"valve_plate.film_radius ({_mm(plate.film_radius)}) must lie on the valve plate, "
            f"between inner_land_inner_radius ({_mm(plate.inner_land_inner_radius)}) and "
            f"outer_land_outer_radius ({_mm(plate.outer_land_outer_radius)})."
        )

    if plate.discharge_close >= plate.suction_open + 2 * math.pi:
        raise InputError(
            "valve_plate: the kidneys overlap at top dead center: discharge_close "
            f"({math.degrees(plate.discharge_close):.4g} deg) must be below suction_open one "
            f"turn later ({math.degrees(plate.suction_open) + 360:.4g} deg)."
        )

    if plate.groove_slope >= _MAX_GROOVE_SLOPE or plate.groove_flank >= _MAX_GROOVE_FLANK:
        raise InputError(
            f"valve_plate: a groove of {math.degrees(plate.groove_slope):.4g} deg with flanks "
            f"{math.degrees(plate.groove_flank):.4g} deg apart cannot be milled; groove_slope "
            "must be below 60 deg and groove_flank below 180 deg."
        )

    if plate.balance_ratio >= 1:
        raise InputError(
            f"valve_plate.balance_ratio ({plate.balance_ratio:.4g}) must be below 1: otherwise "
            "the oil pushes the cylinder block off the valve plate."
        )


def stroke_of(group: RotatingGroup) -> float:
    """Return the stroke of a piston [m]."""
    return 2 * group.pitch_radius * math.tan(group.swash_angle)


def compression_angle(group: RotatingGroup, oil: Oil, pressure: float) -> float:
    """Return the angle after bottom dead center [rad] at which a closed chamber has `pressure`.

    The piston must sweep dV = V p / B of the full chamber V = V0 + 2 A R tan(gamma), and it sweeps
    A R tan(gamma) (1 - cos phi): phi = acos(1 - V p / (B A R tan(gamma))). Free air is left out
    (docs/explanation/physics.md, section 4).

    Parameters
    ----------
    pressure : [Pa].

    Raises
    ------
    InputError
        The whole stroke does not suffice.
    """
    full_volume = group.dead_volume + group.piston_area * stroke_of(group)
    return _compression_angle_of_volume(group, oil, pressure, full_volume)


def decompression_angle(group: RotatingGroup, oil: Oil, pressure: float) -> float:
    """Return the shaft angle [rad] after top dead center at which V0 has expanded from `pressure`.

    As `compression_angle`, with the dead volume V0 in place of the full chamber.
    """
    return _compression_angle_of_volume(group, oil, pressure, group.dead_volume)


def _compression_angle_of_volume(
    group: RotatingGroup, oil: Oil, pressure: float, volume: float
) -> float:
    half_stroke_volume = group.piston_area * stroke_of(group) / 2
    swept_share = volume * pressure / (oil.bulk_modulus * half_stroke_volume)
    if swept_share >= 2:
        raise InputError(
            f"the stroke displaces {2e6 * half_stroke_volume:.4g} mL, too little to bring a "
            f"chamber of {volume * 1e6:.4g} mL to {pressure / 1e6:.4g} MPa; reduce dead_volume "
            "or the pressure."
        )
    return math.acos(1 - swept_share)


def _mm(length: float) -> str:
    return f"{length * 1e3:.4g} mm"
