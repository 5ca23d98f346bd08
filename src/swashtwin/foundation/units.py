"""SI inside, the units of the trade at the edge.

The only module that knows a number may be anything but SI. Code writes ``MPa(15)``; text (TOML
files, the command line) writes ``"15 MPa"`` and is read by `parse_quantity`, which refuses a bare number.

Examples
--------
>>> MPa(15)
15000000.0
>>> parse_quantity("31 mm", "m")
0.031
"""

import math
import re
from functools import cache
from typing import TYPE_CHECKING

from swashtwin.foundation.errors import UnitError

if TYPE_CHECKING:
    from pint import Unit, UnitRegistry

_QUANTITY = re.compile(r"\s*([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)\s*(.*?)\s*")
_UNIT = re.compile(r"(?:1\s*/)?(?:[^\W\d]\w*+|(?:\^|\*\*)-?[1-9](?!\w)|[%°*/·()]|\s)*")
"""Names, products, quotients and powers of one digit: no second number, and nothing that takes long
to work out.
"""


def rpm(value: float) -> float:
    """Angular speed [rad/s] of `value` revolutions per minute."""
    return value * 2 * math.pi / 60


def MPa(value: float) -> float:
    """Pressure [Pa] of `value` megapascal."""
    return value * 1e6


def bar(value: float) -> float:
    """Pressure [Pa] of `value` bar."""
    return value * 1e5


def mm(value: float) -> float:
    """Length [m] of `value` millimeters."""
    return value * 1e-3


def um(value: float) -> float:
    """Length [m] of `value` micrometers."""
    return value * 1e-6


def deg(value: float) -> float:
    """Angle [rad] of `value` degrees."""
    return math.radians(value)


def celsius(value: float) -> float:
    """Temperature [K] of `value` degrees Celsius."""
    return value + 273.15


_COMMON = {
    "m": ("m", 1.0), "cm": ("m", 1e-2), "mm": ("m", 1e-3), "um": ("m", 1e-6),
    "kg": ("kg", 1.0), "s": ("s", 1.0), "ms": ("s", 1e-3),
    "m/s^2": ("m/s^2", 1.0), "mm/s^2": ("m/s^2", 1e-3), "g_0": ("m/s^2", 9.80665), "mg_0": ("m/s^2", 9.80665e-3),
    "m/s": ("m/s", 1.0), "mm/s": ("m/s", 1e-3),
    "Hz": ("Hz", 1.0), "kHz": ("Hz", 1e3),
    "rad/s": ("rad/s", 1.0), "rpm": ("rad/s", math.pi / 30),
    "Pa": ("Pa", 1.0), "kPa": ("Pa", 1e3), "MPa": ("Pa", 1e6), "bar": ("Pa", 1e5), "mbar": ("Pa", 1e2),
    "N": ("N", 1.0), "V": ("V", 1.0), "K": ("K", 1.0), "1": ("1", 1.0),
}  # fmt: skip
"""SI unit and factor of the units in daily use. Every other unit is looked up with pint, which
takes half a second to build its registry.
"""
_TURNS = dict.fromkeys(
    ("rpm", "r/min", "rev/min", "1/min", "/min", "min^-1", "min-1", "U/min", "Upm"), math.pi / 30
)
_TURNS |= dict.fromkeys(("Hz", "rev/s", "r/s", "rps"), 2 * math.pi)
"""Angular speed [rad/s] of one unit of a shaft's speed. Hertz are its turns per second; 1/s may be
rad/s as well.
"""
_CASELESS = ("Pa", "hPa", "kPa", "MPa", "bar", "psi", "Hz", "kHz", "rpm", "U/min", "degC")
"""Units that are understood in any case of letters; millipascal (mPa) is not meant by any of
them.
"""
_SPELLINGS = {"g": "g_0", "gn": "g_0", "G": "g_0", "mg": "mg_0", "m/s/s": "m/s^2"}
"""Units of acceleration by their usual names, which mean a mass elsewhere."""
_POWERS = {"²": "^2", "³": "^3", "⁻¹": "^-1", "**": "^"}


@cache
def _registry() -> "UnitRegistry":
    from pint import UnitRegistry

    registry: UnitRegistry = UnitRegistry()
    registry.define("@alias turn = rev = r")
    return registry


def _unit(text: str) -> "Unit | None":
    import tokenize

    import pint

    if not _UNIT.fullmatch(text):
        return None
    try:
        return _registry().parse_units(text)
    except (
        pint.errors.PintError,
        ValueError,
        TypeError,
        AssertionError,
        KeyError,
        tokenize.TokenError,
    ):
        return None


def _dimension(unit: "Unit") -> str:
    return str(_registry().Quantity(1.0, unit).to_root_units().units)


def _misfit(number: float, source: "Unit", unit: str) -> str:
    """What is wrong with a quantity of another dimension than `unit`, and what to write."""
    turns_per_second = {"1 / second": 1.0, "radian / second": 1 / (2 * math.pi)}
    dimension = _dimension(source)
    if unit in ("rad/s", "Hz") and dimension in turns_per_second:
        turns = turns_per_second[dimension] * float(
            _registry().Quantity(number, source).to_root_units().magnitude
        )
        if unit == "Hz":
            return f'is an angular speed; write it as "{turns:g} Hz".'
        return f'is a frequency; write it as "{turns * 60:g} rpm".'
    if unit == "1":
        return "is no plain number; write it without a unit."
    return f"is no quantity in {unit}; write it in {unit} or a multiple of it."


def _spelled(text: str, target: str = "") -> str:
    """A unit as `_COMMON` or pint write it: ``m/s^2`` of ``m/s2``, ``MPa`` of ``Mpa``, in m/s^2
    ``g_0`` of ``g``.
    """
    for sign, power in _POWERS.items():
        text = text.replace(sign, power)
    if target == "m/s^2" and text in _SPELLINGS:
        return _SPELLINGS[text]
    if text in _COMMON or text in _TURNS:
        return text
    if text != "mPa" and (
        names := [name for name in _CASELESS if name.casefold() == text.casefold()]
    ):
        return names[0]
    return re.sub(r"(?<=[A-Za-z])([23])(?![\w^])", r"^\1", text)


_USUAL = {"rad/s": "rpm", "Pa": "MPa"}
"""What people write where SI has another unit: a bare 860 is a speed in revolutions per minute."""


def is_unit(text: str) -> bool:
    """Whether `text` is a unit, such as ``"g"`` or ``"m/s^2"``.

    Examples
    --------
    >>> is_unit("m/s^2"), is_unit("gg")
    (True, False)
    """
    text = _spelled(text)
    return text in _COMMON or _unit(text) is not None


def parse_quantity(text: object, unit: str, *, name: str = "value") -> float:
    """SI number of a quantity written with its unit.

    Radians and turns count as a dimension: ``"860 rpm"`` is no frequency, ``"14 1/s"`` no angular
    speed, and ``"1 N*m"`` no stiffness in N m/rad. So a factor of 2 pi is never put in or left out
    silently. Only the speed of a shaft may be written in ``Hz`` or ``1/min``, which are turns.
    ``g`` is the acceleration of gravity where an acceleration is due. Slips of the case are
    understood where they are none of another unit: ``"15 Mpa"``.

    Parameters
    ----------
    text : one number, its decimal mark a point, and its unit: ``"31 mm"``; a number alone only
        where `unit` is ``"1"``.
    unit : SI unit it is wanted in, such as ``"m"``; ``"1"`` is a plain number.
    name : how the error message calls it.

    Raises
    ------
    UnitError
        No number, no unit, an unknown unit, or one of another dimension.

    Examples
    --------
    >>> parse_quantity("15 Mpa", "Pa"), round(parse_quantity("25 Hz", "rad/s"), 6)
    (15000000.0, 157.079633)
    >>> parse_quantity("860 rpm", "Hz", name="sample_rate")
    Traceback (most recent call last):
    ...
    swashtwin.foundation.errors.UnitError: sample_rate = '860 rpm' is an angular speed; write it as "14.3333 Hz".
    """
    suffix = "" if unit == "1" else f" {unit}"
    if not isinstance(text, str):
        raise UnitError(
            f'{name} is the bare number {text!r}; write it with its unit, for example "{text}{suffix}".'
        )
    match = _QUANTITY.fullmatch(text)
    symbol = _spelled(match[2], unit) if match else ""
    if (
        match is not None
        and symbol
        and (value := _common_value(float(match[1]), symbol, unit)) is not None
    ):
        return value
    if unit == "Pa" and symbol == "mPa":
        raise UnitError(
            f'{name} = {text!r} is in thousandths of a pascal; was "{match and match[1]} MPa" meant?'
        )
    source, target = _unit(symbol) if match else None, _unit(suffix.strip())
    if match is None or source is None or target is None:
        raise UnitError(
            f'{name} = {text!r} is not a quantity; write a number and a unit, "31{suffix}".'
        )
    if suffix and not match[2]:
        usual = (
            "kHz"
            if "rate" in name and unit == "Hz" and float(match[1]) < 1000
            else _USUAL.get(unit, unit)
        )
        raise UnitError(
            f'{name} = {text!r} has no unit; write it with one, for example "{text} {usual}".'
        )
    number = float(match[1])
    if _dimension(source) != _dimension(target):
        raise UnitError(f"{name} = {text!r} {_misfit(number, source, unit)}")
    value = float(_registry().Quantity(number, source).to(target).magnitude)
    if not math.isfinite(value):
        raise UnitError(f"{name} = {text!r} is not finite.")
    return float(f"{value:.15g}")  # 1e-3 * 31 in binary is 0.031 again


def _common_value(number: float, source: str, target: str) -> float | None:
    """Value in `target` of a number in `source`, or None where neither `_COMMON` nor `_TURNS` says
    it.
    """
    if (source, target) == ("degC", "K") and math.isfinite(number):
        return float(f"{celsius(number):.15g}")
    if target == "rad/s" and source in _TURNS and math.isfinite(number):
        return float(f"{number * _TURNS[source]:.15g}")
    if source not in _COMMON or target not in _COMMON:
        return None
    (dimension, factor), (other, divisor) = _COMMON[source], _COMMON[target]
    value = number if source == target else number * factor
    if dimension != other or (source != target and divisor != 1.0) or not math.isfinite(value):
        return None
    return float(f"{value:.15g}")
