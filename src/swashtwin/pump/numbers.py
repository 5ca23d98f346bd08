"""Every number of a pump by its path, such as ``masses.shell``; numbers in the units of the trade; a pump as text."""

import json
import math
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from typing import Any

from swashtwin.pump.parameters import Pump

_TRADE = {
    "m": ("mm", 1e-3), "m^3": ("cm^3", 1e-6), "rad": ("deg", math.pi / 180), "rad/s": ("rpm", math.pi / 30),
    "Pa": ("MPa", 1e6), "m^3/s": ("L/min", 1e-3 / 60),
}  # fmt: skip
_THINNEST = 1e-4
"""Length [m] below which a gap is written in um."""
_DIGITS = 6
_EXACT = ("rotating_group.piston_diameter", "rotating_group.pitch_radius", "rotating_group.swash_angle")
"""What sets the displacement, which is that of the nameplate to all digits."""


def in_trade_units(value: float, unit: str, digits: int = _DIGITS) -> str:
    """A number in SI as people of the trade write it, with its unit: millimeters, degrees, MPa, rpm, cm^3.

    Examples
    --------
    >>> in_trade_units(0.026, "m"), in_trade_units(1.2e-5, "m"), in_trade_units(15e6, "Pa")
    ('26 mm', '12 um', '15 MPa')
    """
    if unit == "K":
        return f"{value - 273.15:.{digits}g} degC"
    if unit == "m" and 0 < abs(value) < _THINNEST:
        return f"{value * 1e6:.{digits}g} um"
    name, factor = _TRADE.get(unit, (unit, 1.0))
    return f"{value / factor:.{digits}g}{'' if name == '1' else f' {name}'}"


def pump_numbers(pump: Pump) -> list[tuple[str, Any, str]]:
    """(path, value in SI units, SI unit) of every number of a pump, or list of numbers, in the order of its parts.

    A path is of sections and name, such as ``interfaces.block_valve.damping`` or ``sensors[0].position``.
    """
    numbers = []

    def note(path: str, value: Any, unit: str) -> Any:
        numbers.append((path, value, unit))
        return value

    with_numbers(pump, note)
    return numbers


def with_number(pump: Pump, path: str, value: Any) -> Pump:
    """The pump with another value of the number at `path`.

    Raises
    ------
    InputError
        The part cannot be so.
    """
    changed: Pump = with_numbers(pump, lambda at, before, unit: value if at == path else before)
    return changed


def with_numbers(part: Any, change: Callable[[str, Any, str], Any], path: str = "") -> Any:
    """The pump, or a part of it, with what `change` gives for the path, the value and the unit of each number."""
    changes: dict[str, Any] = {}
    for item in fields(part):
        value, at = getattr(part, item.name), f"{path}.{item.name}".removeprefix(".")
        if "unit" in item.metadata:
            changes[item.name] = change(at, value, item.metadata["unit"])
        elif is_dataclass(value):
            changes[item.name] = with_numbers(value, change, at)
        elif item.name == "sensors":
            changes[item.name] = tuple(
                with_numbers(sensor, change, f"{at}[{number}]") for number, sensor in enumerate(value)
            )
    return replace(part, **changes)


def pump_text(pump: Pump, comment: str) -> str:
    """Text of the file that `load_pump` reads as this pump, each number with its unit and its source."""
    lines = [*(f"# {line}" for line in comment.splitlines()), "format = 1", f"name = {json.dumps(pump.name)}"]
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
        digits = 12 if path in _EXACT else _DIGITS
        numbers = [in_trade_units(number, unit, digits) for number in (value if isinstance(value, tuple) else (value,))]
        quantity = json.dumps(numbers if isinstance(value, tuple) else numbers[0])
        source = json.dumps(pump.sources.get(path, "no source"), ensure_ascii=False)
        lines.append(f"{name} = {{ value = {quantity}, source = {source} }}")
    return "\n".join(lines) + "\n"
