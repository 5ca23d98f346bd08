"""A pump as the text of its file, and its numbers in the units of the trade."""

import json
import math
from dataclasses import fields, is_dataclass
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


def pump_text(pump: Pump, comment: str) -> str:
    """Text of the file that `load_pump` reads as this pump, each number with its unit and its source."""
    lines = [*(f"# {line}" for line in comment.splitlines()), "format = 1", f"name = {json.dumps(pump.name)}"]
    for section in fields(pump):
        part = getattr(pump, section.name)
        if not is_dataclass(part):
            continue
        if section.name == "interfaces":
            for joint in fields(part):
                lines += _table(pump, f"interfaces.{joint.name}", getattr(part, joint.name))
        else:
            lines += _table(pump, section.name, part)
    for index, sensor in enumerate(pump.sensors):
        position = _entry(pump, f"sensors[{index}].position", sensor.position, "m")
        lines += ["", "[[sensors]]", f"name = {json.dumps(sensor.name)}", f"position = {position}"]
        lines.append(f"direction = {[float(component) for component in sensor.direction]}")
    return "\n".join(lines) + "\n"


def _table(pump: Pump, path: str, part: Any) -> list[str]:
    entries = [
        f"{item.name} = {_entry(pump, f'{path}.{item.name}', getattr(part, item.name), item.metadata['unit'])}"
        for item in fields(part)
    ]
    return ["", f"[{path}]", *entries]


def _entry(pump: Pump, path: str, value: Any, unit: str) -> str:
    digits = 12 if path in _EXACT else _DIGITS
    texts = [in_trade_units(number, unit, digits) for number in (value if isinstance(value, tuple) else (value,))]
    quantity = json.dumps(texts if isinstance(value, tuple) else texts[0])
    return f"{{ value = {quantity}, source = {json.dumps(pump.sources.get(path, 'no source'), ensure_ascii=False)} }}"
