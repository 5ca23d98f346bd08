"""Conditions and faults in words, each number with its unit: ``"860 rpm"``, ``"15 MPa"``, ``"0.6 mm"``.

The command line reads what a person types with these two functions.

Examples
--------
>>> round(read_condition(speed="860 rpm", discharge_pressure="15 MPa").shaft_frequency, 6)
14.333333
>>> read_fault("plunger", clearance="60 um")
PistonWear(clearance=6e-05, piston=0)
"""

from collections.abc import Mapping
from dataclasses import fields, replace
from types import MappingProxyType

from swashtwin.foundation import InputError, deg, mm, parse, um
from swashtwin.pump.condition import OperatingCondition
from swashtwin.pump.faults import (
    BoreDefect,
    DamScratch,
    Fault,
    GrooveErosion,
    LooseSlipper,
    PistonWear,
    SealingLandScratch,
    SwashPlateDefect,
    TiltedBlockFace,
    ValvePlateWear,
    canonical_label,
)

FAULT_KINDS: Mapping[str, Fault | None] = MappingProxyType(
    {
        "normal": None,
        "swash_plate": SwashPlateDefect(depth=mm(0.6), length=mm(30), width=mm(24)),
        "piston": PistonWear(clearance=um(40)),
        "cylinder_block": BoreDefect(depth=um(150)),
        "valve_plate": ValvePlateWear(film_increase=um(10)),
        "loose_slipper": LooseSlipper(clearance=mm(0.1)),
        "scratched_block": SealingLandScratch(conductance=1.2e-12),
        "tilted_block": TiltedBlockFace(variation=0.2),
        "scratched_valve_plate": DamScratch(area=1e-6),
        "eroded_grooves": GrooveErosion(advance=deg(4)),
    }
)
"""Kinds of fault by name, each with the dimensions taken where none are given: the paper's defect, and moderate
severities of `docs/physics.md` for the others. A class's own name stands for its commonest fault."""

_ANGLES = {(SwashPlateDefect, "angle"), (BoreDefect, "half_width"), (BoreDefect, "angle"), (DamScratch, "width")}
_ANGLES |= {(GrooveErosion, "advance")}
_UNITS = {"depth": "m", "length": "m", "width": "m", "clearance": "m", "film_increase": "m", "area": "m^2"}
_UNITS |= {"conductance": "m^3/(s*Pa)", "pulse": "s"}


def read_condition(
    *, speed: str, discharge_pressure: str, oil_temperature: str | None = None, suction_pressure: str | None = None
) -> OperatingCondition:
    """Operating condition of quantities with units; what is not said stays at the default.

    Raises
    ------
    UnitError
        A number without a unit, or with one of another dimension; a speed in hertz.
    InputError
        No pump runs so.
    """
    given = {"speed": parse(speed, "rad/s", name="speed")}
    given["discharge_pressure"] = parse(discharge_pressure, "Pa", name="discharge_pressure")
    if oil_temperature is not None:
        given["oil_temperature"] = parse(oil_temperature, "K", name="oil_temperature")
    if suction_pressure is not None:
        given["suction_pressure"] = parse(suction_pressure, "Pa", name="suction_pressure")
    return OperatingCondition(**given)


def read_fault(kind: str, **dimensions: str) -> Fault | None:
    """Fault of that kind (`FAULT_KINDS`, or an alias) with some dimensions replaced; None is a healthy pump.

    Raises
    ------
    InputError
        No such kind (the nearest is offered), no such dimension, or an impossible one.
    UnitError
        A dimension without a unit, or with one of another dimension.
    """
    name = kind if kind in FAULT_KINDS else canonical_label(kind, tuple(FAULT_KINDS))
    fault = FAULT_KINDS[name]
    if fault is None:
        if dimensions:
            raise InputError(f"a {name} pump has no {next(iter(dimensions))}; name a fault, such as swash_plate.")
        return None
    known = {item.name: item for item in fields(fault) if item.type in (float, int)}
    values: dict[str, float] = {}
    for key, text in dimensions.items():
        if key not in known:
            raise InputError(f"{name} has no dimension {key!r}; it has {', '.join(known)}.")
        unit = "rad" if (type(fault), key) in _ANGLES else _UNITS.get(key, "1")
        number = parse(text, unit, name=f"{name}'s {key}")
        if known[key].type is int and number != int(number):
            raise InputError(f"{name}'s {key} = {text!r} must be a whole number.")
        values[key] = int(number) if known[key].type is int else number
    return replace(fault, **values)  # type: ignore[arg-type]
