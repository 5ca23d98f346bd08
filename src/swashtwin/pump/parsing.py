"""Conditions and faults in words, each number with its unit: ``"860 rpm"``, ``"15 MPa"``, ``"0.6 mm"``.

The command line reads what a person types with these two functions.

Examples
--------
>>> round(read_condition(speed="860 rpm", discharge_pressure="15 MPa").shaft_frequency, 6)
14.333333
>>> read_fault("plunger", clearance="60 um")
PistonWear(clearance=6e-05, piston=0)
>>> read_fault("swash_plate", contact="lift_off").contact
'lift_off'
"""

from dataclasses import fields, replace
from typing import Any, Literal, get_origin, get_type_hints

from swashtwin.foundation import InputError, parse
from swashtwin.pump.condition import OperatingCondition
from swashtwin.pump.faults import FAULT_KINDS, Fault, canonical_label, register_installed_faults


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
    values = {"speed": parse(speed, "rad/s", name="speed")}
    values["discharge_pressure"] = parse(discharge_pressure, "Pa", name="discharge_pressure")
    if oil_temperature is not None:
        values["oil_temperature"] = parse(oil_temperature, "K", name="oil_temperature")
    if suction_pressure is not None:
        values["suction_pressure"] = parse(suction_pressure, "Pa", name="suction_pressure")
    return OperatingCondition(**values)


def read_fault(kind: str, **dimensions: str) -> Fault | None:
    """Fault of that kind (`FAULT_KINDS`, or an alias) with some dimensions replaced; None is a healthy pump.

    Raises
    ------
    InputError
        No such kind (the nearest is offered), no such dimension, or an impossible number or word.
    UnitError
        A dimension without a unit, or with one of another dimension.
    """
    if kind not in FAULT_KINDS:
        register_installed_faults()
    name = kind if kind in FAULT_KINDS else canonical_label(kind, tuple(FAULT_KINDS))
    fault = FAULT_KINDS[name]
    if fault is None:
        if dimensions:
            raise InputError(f"a {name} pump has no {next(iter(dimensions))}; name a fault, such as swash_plate.")
        return None
    types = {item.name: get_type_hints(type(fault))[item.name] for item in fields(fault)}
    numbers = {item: kind for item, kind in types.items() if kind in (float, int)}
    words = [item for item, kind in types.items() if get_origin(kind) is Literal]
    values: dict[str, Any] = {}
    for key, text in dimensions.items():
        if key in words:
            values[key] = text
            continue
        if key not in numbers:
            raise InputError(f"{name} has no dimension {key!r}; it has {', '.join([*numbers, *words])}.")
        number = parse(text, fault.units.get(key, "1"), name=f"{name}'s {key}")
        if numbers[key] is int and number != int(number):
            raise InputError(f"{name}'s {key} = {text!r} must be a whole number.")
        values[key] = int(number) if numbers[key] is int else number
    return replace(fault, **values)
