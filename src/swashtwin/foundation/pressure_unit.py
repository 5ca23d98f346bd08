"""The unit in which pages and messages show pressures.

Histories and files keep pascals, and sentences and names of operating points are in MPa.
"""

import re
from typing import Literal

PressureUnit = Literal["MPa", "bar"]
"""Unit of absolute pressures."""

PASCALS = {"MPa": 1e6, "bar": 1e5}
"""Size of each unit [Pa]."""

_BAR_PER_MPA = 10

_NUMBER = re.compile(r"\d+(?:\.\d+)?")

# One or several values in MPa, such as "10 and 15 MPa", "0.1 to 100 MPa" or "15.2 ... 16 MPa".
_SEPARATOR = r"(?:, | and | or | to | \.\.\. |…|-)"
_PRESSURES = re.compile(rf"({_NUMBER.pattern}(?:{_SEPARATOR}{_NUMBER.pattern})*) MPa\b")


def convert_pressures(text: str, unit: PressureUnit) -> str:
    """Return a text with its pressures in a unit; they are in MPa.

    Examples
    --------
    >>> convert_pressures("1500 rpm, 15 MPa", "bar")
    '1500 rpm, 150 bar'
    >>> convert_pressures("trained: 5 and 10.5 MPa", "bar")
    'trained: 50 and 105 bar'
    >>> convert_pressures("between 15.2 ... 16 MPa", "bar")
    'between 152 ... 160 bar'
    """
    if unit == "MPa":
        return text

    def to_bar(number: re.Match[str]) -> str:
        return f"{_BAR_PER_MPA * float(number[0]):.4g}"

    return _PRESSURES.sub(lambda match: f"{_NUMBER.sub(to_bar, match[1])} bar", text)
