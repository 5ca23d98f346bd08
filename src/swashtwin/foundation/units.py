"""Conversion of practical units to SI at the edge of the package.

The only module in which a number may have another unit. Code writes ``MPa(15)``; text (TOML files,
the command line) writes ``"15 MPa"`` and is read by `parse_quantity`, which refuses a bare number.

Examples
--------
>>> MPa(15)
15000000.0
>>> parse_quantity("31 mm", "m")
0.031
"""

import math
import re
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any

from swashtwin.foundation.errors import UnitError

if TYPE_CHECKING:
    from pint import Unit, UnitRegistry

_QUANTITY = re.compile(r"\s*([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)\s*(.*?)\s*")

# Names, products, quotients and powers of one digit: no second number, and nothing that takes long
# to evaluate.
_UNIT = re.compile(r"(?:1\s*/)?(?:[^\W\d]\w*+|(?:\^|\*\*)-?[1-9](?!\w)|[%°*/·()]|\s)*")


def rpm(value: float) -> float:
    """Return the angular speed [rad/s] of `value` revolutions per minute."""
    return value * 2 * math.pi / 60


def MPa(value: float) -> float:
    """Return the pressure [Pa] of `value` megapascal."""
    return value * 1e6


def bar(value: float) -> float:
    """Return the pressure [Pa] of `value` bar."""
    return value * 1e5


def mm(value: float) -> float:
    """Return the length [m] of `value` millimeters."""
    return value * 1e-3


def um(value: float) -> float:
    """Return the length [m] of `value` micrometers."""
    return value * 1e-6


def deg(value: float) -> float:
    """Return the angle [rad] of `value` degrees."""
    return math.radians(value)


def celsius(value: float) -> float:
    """Return the temperature [K] of `value` degrees Celsius."""
    return value + 273.15


# SI unit and factor of the units in daily use. Other units are looked up with pint, which takes
# half a second to build its registry.
_COMMON = {
    "m": ("m", 1.0),
    "cm": ("m", 1e-2),
    "mm": ("m", 1e-3),
    "um": ("m", 1e-6),
    "kg": ("kg", 1.0),
    "s": ("s", 1.0),
    "ms": ("s", 1e-3),
    "m/s^2": ("m/s^2", 1.0),
    "mm/s^2": ("m/s^2", 1e-3),
    "g_0": ("m/s^2", 9.80665),
    "mg_0": ("m/s^2", 9.80665e-3),
    "m/s": ("m/s", 1.0),
    "mm/s": ("m/s", 1e-3),
    "Hz": ("Hz", 1.0),
    "kHz": ("Hz", 1e3),
    "rad/s": ("rad/s", 1.0),
    "rpm": ("rad/s", math.pi / 30),
    "Pa": ("Pa", 1.0),
    "kPa": ("Pa", 1e3),
    "MPa": ("Pa", 1e6),
    "bar": ("Pa", 1e5),
    "mbar": ("Pa", 1e2),
    "N": ("N", 1.0),
    "V": ("V", 1.0),
    "K": ("K", 1.0),
    "1": ("1", 1.0),
}

_SHAFT_SPEEDS = dict.fromkeys(
    ("rpm", "r/min", "rev/min", "1/min", "/min", "min^-1", "min-1", "U/min", "Upm"), math.pi / 30
)
_SHAFT_SPEEDS |= dict.fromkeys(("Hz", "rev/s", "r/s", "rps"), 2 * math.pi)
"""Angular speed [rad/s] of one unit of a shaft's speed. Hertz are its turns per second; 1/s is
not accepted, since it may be rad/s as well."""

# Units that are understood in any case of letters, but for mPa (millipascal).
_CASELESS = ("Pa", "hPa", "kPa", "MPa", "bar", "psi", "Hz", "kHz", "rpm", "U/min", "degC")

# Common names of units of acceleration; pint takes g for gram.
_SPELLINGS = {"g": "g_0", "gn": "g_0", "G": "g_0", "mg": "mg_0", "m/s/s": "m/s^2"}

_POWERS = {"²": "^2", "³": "^3", "⁻¹": "^-1", "**": "^"}


@cache
def _registry() -> "UnitRegistry[Any]":
    from pint import UnitRegistry

    registry: UnitRegistry[Any] = UnitRegistry()
    registry.define("@alias turn = rev = r")
    return registry


# A pump has 70 quantities in a dozen units, which pint would parse for each anew.
@lru_cache(maxsize=256)
def _pint_unit(text: str) -> "Unit | None":
    import tokenize

    import pint

    if not _UNIT.fullmatch(text):
        return None
    try:
        unit = _registry().parse_units(text)
        # For Pa/dB, pint reports only here that it is not a unit, and from 0.26 on at a conversion.
        _ = unit.dimensionality
        _registry().Quantity(1.0, unit).to_root_units()
        return unit
    except (
        pint.errors.PintError,
        ValueError,
        TypeError,
        AssertionError,
        KeyError,
        tokenize.TokenError,
    ):
        return None


@lru_cache(maxsize=256)
def _dimension(unit: "Unit") -> str:
    return str(_registry().Quantity(1.0, unit).to_root_units().units)


def _describe_misfit(number: float, source: "Unit", unit: str) -> str:
    """Describe what is wrong with a quantity of another dimension, and what to write."""
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
        return "must be a plain number; write it without a unit."
    return f"is not a quantity in {unit}; write it in {unit} or a multiple of it."


def _spell_unit(text: str, target: str = "") -> str:
    """Return a unit in the spelling of `_COMMON` or pint.

    Such as ``m/s^2`` for ``m/s2``, ``MPa`` for ``Mpa``, and ``g_0`` for ``g`` if `target` is m/s^2.
    """
    for sign, power in _POWERS.items():
        text = text.replace(sign, power)
    if target == "m/s^2" and text in _SPELLINGS:
        return _SPELLINGS[text]
    if text in _COMMON or text in _SHAFT_SPEEDS:
        return text
    if text != "mPa":
        for name in _CASELESS:
            if name.casefold() == text.casefold():
                return name
    return re.sub(r"(?<=[A-Za-z])([23])(?![\w^])", r"^\1", text)


# Unit that people use in place of the SI unit: a bare 860 is a speed in revolutions per minute.
_TYPICAL_UNITS = {"rad/s": "rpm", "Pa": "MPa"}

# A bare sample rate below this is probably in kHz.
_MIN_RATE_HZ = 1000


def is_unit(text: str) -> bool:
    """Whether `text` is a unit, such as ``"g"`` or ``"m/s^2"``.

    Examples
    --------
    >>> is_unit("m/s^2"), is_unit("gg"), is_unit("Pa/dB")
    (True, False, False)
    """
    text = _spell_unit(text)
    return text in _COMMON or _pint_unit(text) is not None


def parse_quantity(text: object, unit: str, *, name: str = "value") -> float:
    """Return the SI number of a quantity that is written with its unit.

    Radians and turns count as a dimension: ``"860 rpm"`` is not a frequency, ``"14 1/s"`` is not an
    angular speed, and ``"1 N*m"`` is not a stiffness in N m/rad. So a factor of 2 pi is never added
    or left out silently. Only the speed of a shaft may be written in ``Hz`` or ``1/min``, which are
    turns. ``g`` is the acceleration of gravity if an acceleration is required. A wrong case of
    letters is understood unless it is another unit: ``"15 Mpa"``.

    Parameters
    ----------
    text : one number, its decimal mark a point, and its unit: ``"31 mm"``; a number alone only if
        `unit` is ``"1"``.
    unit : SI unit of the result, such as ``"m"``; ``"1"`` is a plain number.
    name : name of the quantity in an error message.

    Raises
    ------
    UnitError
        `text` has no number or no unit, or its unit is unknown or of another dimension.

    Examples
    --------
    >>> parse_quantity("15 Mpa", "Pa"), round(parse_quantity("25 Hz", "rad/s"), 6)
    (15000000.0, 157.079633)
    >>> parse_quantity("860 rpm", "Hz", name="sample_rate")
    Traceback (most recent call last):
    ...
    swashtwin.foundation.errors.UnitError: sample_rate = '860 rpm' is an angular speed; ...
    """
    unit_suffix = "" if unit == "1" else f" {unit}"
    if not isinstance(text, str):
        raise UnitError(
            f"{name} is the bare number {text!r}; write it with its unit, for example "
            f'"{text}{unit_suffix}".'
        )
    match = _QUANTITY.fullmatch(text)
    if match is None:
        raise _not_a_quantity(name, text, unit_suffix)

    number = float(match[1])
    symbol = _spell_unit(match[2], unit)
    if symbol:
        value = _common_value(number, symbol, unit)
        if value is not None:
            return value
    if unit == "Pa" and symbol == "mPa":
        raise UnitError(
            f'{name} = {text!r} is in thousandths of a pascal; was "{match[1]} MPa" meant?'
        )

    source = _pint_unit(symbol)
    target = _pint_unit(unit_suffix.strip())
    if source is None or target is None:
        raise _not_a_quantity(name, text, unit_suffix)
    if unit_suffix and not match[2]:
        is_low_rate = "rate" in name and unit == "Hz" and number < _MIN_RATE_HZ
        typical_unit = "kHz" if is_low_rate else _TYPICAL_UNITS.get(unit, unit)
        raise UnitError(
            f'{name} = {text!r} has no unit; write it with one, for example "{text} '
            f'{typical_unit}".'
        )
    if _dimension(source) != _dimension(target):
        raise UnitError(f"{name} = {text!r} {_describe_misfit(number, source, unit)}")

    value = float(_registry().Quantity(number, source).to(target).magnitude)
    if not math.isfinite(value):
        raise UnitError(f"{name} = {text!r} is not finite.")
    return _round_value(value)


def _not_a_quantity(name: str, text: str, unit_suffix: str) -> UnitError:
    return UnitError(
        f'{name} = {text!r} is not a quantity; write a number and a unit, "31{unit_suffix}".'
    )


def _round_value(value: float) -> float:
    """Round to 15 digits, so that 1e-3 * 31 is 0.031 although it is not in binary."""
    return float(f"{value:.15g}")


def _common_value(number: float, source: str, target: str) -> float | None:
    """Return a number of unit `source` in unit `target`; None if the units are not common."""
    if not math.isfinite(number):
        return None
    if (source, target) == ("degC", "K"):
        return _round_value(celsius(number))
    if target == "rad/s" and source in _SHAFT_SPEEDS:
        return _round_value(number * _SHAFT_SPEEDS[source])
    if source not in _COMMON or target not in _COMMON:
        return None

    source_dimension, source_factor = _COMMON[source]
    target_dimension, target_factor = _COMMON[target]
    # Only SI units are targets.
    if source_dimension != target_dimension or (source != target and target_factor != 1.0):
        return None
    value = number if source == target else number * source_factor
    return _round_value(value) if math.isfinite(value) else None
