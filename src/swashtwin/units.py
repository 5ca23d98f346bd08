"""SI inside, the units of the trade at the edge.

The only module that knows a number may be anything but SI. Code writes ``MPa(15)``; text (TOML files, the command line)
writes ``"15 MPa"`` and is read by `parse`, which refuses a bare number.

Examples
--------
>>> MPa(15)
15000000.0
>>> parse("31 mm", "m")
0.031
"""

import math
from functools import cache
from typing import TYPE_CHECKING, Any

from swashtwin.errors import UnitError

if TYPE_CHECKING:
    from pint import UnitRegistry


def rpm(value: float) -> float:
    """Angular speed [rad/s] of `value` revolutions per minute."""
    return value * 2 * math.pi / 60


def hertz(value: float) -> float:
    """Angular speed [rad/s] of `value` revolutions per second."""
    return value * 2 * math.pi


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


@cache
def _registry() -> "UnitRegistry":
    from pint import UnitRegistry

    # "1 rpm" is an angular speed and "1 Hz" a frequency: both keep their own dimension, none is silently multiplied.
    return UnitRegistry(autoconvert_offset_to_baseunit=True)


def parse(text: str, unit: str, *, name: str = "value") -> float:
    """SI number of a quantity written with its unit.

    Parameters
    ----------
    text : quantity such as ``"31 mm"``; ``"1"`` is accepted only where `unit` is ``"1"`` (a plain number).
    unit : SI unit it is wanted in, such as ``"m"``.
    name : how the error message calls it.

    Raises
    ------
    UnitError
        No unit, an unknown unit, or a unit of another dimension.
    """
    import tokenize

    import pint

    if not isinstance(text, str):
        raise UnitError(f'{name} is the bare number {text!r}; write it with its unit, for example "{text} {unit}".')
    try:
        quantity: Any = _registry().Quantity(text)
    except (pint.errors.PintError, ValueError, AssertionError, AttributeError, TypeError, tokenize.TokenError) as cause:
        raise UnitError(f'{name} = {text!r} is not a quantity; write a number and a unit, "31 {unit}".') from cause
    if quantity.unitless and unit not in ("1", "rad"):
        raise UnitError(f'{name} = {text!r} has no unit; write it with one, for example "{text} {unit}".')
    try:
        value = float(quantity.to("dimensionless" if unit == "1" else unit).magnitude)
    except (pint.errors.DimensionalityError, TypeError) as cause:
        raise UnitError(
            f"{name} = {text!r} is no quantity in {unit}; write it in {unit} or a multiple of it."
        ) from cause
    if not math.isfinite(value):
        raise UnitError(f"{name} = {text!r} is not finite.")
    return float(f"{value:.15g}")  # 1e-3 * 31 in binary is 0.031 again
