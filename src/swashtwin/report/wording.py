"""Numbers and names as a reader should see them."""

import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

from swashtwin.recordings import RecordingFacts
from swashtwin.report.page import Cell, Table

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

_INTERFACES = {
    "slipper_swash": "slipper/swash plate",
    "block_valve": "cylinder block/valve plate",
    "piston_bore": "piston/bore",
}


def number(value: float | None) -> str:
    """Three significant digits, large and small ones as powers of ten, ``—`` for NaN, infinity and none.

    Examples
    --------
    >>> number(0.98), number(12), number(778000.0), number(float("nan"))
    ('0.980', '12.0', '7.78·10⁵', '—')
    """
    if value is None or not math.isfinite(value):
        return "—"
    if value == 0:
        return "0"
    mantissa, exponent = f"{value:.2e}".split("e")
    if not -3 <= int(exponent) <= 4:
        return f"{mantissa}·10{str(int(exponent)).translate(_SUPERSCRIPTS)}"
    return f"{float(f'{value:.3g}'):.{max(0, 2 - int(exponent))}f}"


def percent(share: float) -> str:
    """Share in percent, without decimals but never rounded up to all or down to nothing.

    Examples
    --------
    >>> percent(0.9996), percent(0.5), percent(0.001)
    ('> 99 %', '50 %', '< 1 %')
    """
    if not math.isfinite(share):
        return "—"
    if 0.99 < share < 1:
        return "> 99 %"
    if 0 < share < 0.01:
        return "< 1 %"
    return f"{100 * share:.0f} %"


def number_cell(value: float | None, reason: str = "") -> Cell:
    """Cell of a number; for NaN it is ``—``, with the reason as tooltip."""
    text = number(value)
    if text == "—":
        return Cell(text, reason or "not defined for these data")
    return Cell(f"{text} *" if reason else text, reason)


def parameter_words(name: str) -> str:
    """Name of an interface value in words.

    Examples
    --------
    >>> parameter_words("slipper_swash.damping")
    'slipper/swash plate damping'
    """
    interface, quantity = name.split(".")
    return f"{_INTERFACES[interface]} {quantity}"


def sentence(text: str) -> str:
    """A text that begins as a sentence does."""
    return f"{text[:1].upper()}{text[1:]}"


def facts_table(caption: str, entries: Iterable[tuple[str, object]]) -> Table:
    """Table of names and values."""
    return Table(caption, ("", ""), tuple((name, _plain(value)) for name, value in entries))


def flatten_settings(settings: Mapping[str, Any], prefix: str = "") -> list[tuple[str, object]]:
    """Settings within settings as one list of dotted names."""
    entries: list[tuple[str, object]] = []
    for name, value in settings.items():
        if isinstance(value, Mapping):
            entries += flatten_settings(value, f"{prefix}{name}.")
        else:
            entries.append((f"{prefix}{name}", value))
    return entries


def _plain(value: object) -> str:
    if value is None:
        return "none"
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, list | tuple):
        return ", ".join(_plain(entry) for entry in value) or "none"
    return str(value)


def also_in_bar(text: str) -> str:
    """A text with each absolute pressure in bar beside MPa.

    Examples
    --------
    >>> also_in_bar("860 rev/min, 10 and 15 MPa")
    '860 rev/min, 10 and 15 MPa (100 and 150 bar absolute)'
    """

    def both(match: re.Match[str]) -> str:
        return (
            f"{match[0]} ({re.sub(r'[0-9.]+', lambda number: f'{10 * float(number[0]):.4g}', match[1])} bar absolute)"
        )

    return re.sub(r"([0-9.]+(?:(?:, | and | to | / )[0-9.]+)*) MPa", both, text)


def fact_entries(facts: RecordingFacts) -> tuple[tuple[str, str], ...]:
    """(name, value) of each fact that is stated."""
    entries = (
        _counted("Machine", facts.machine),
        ("Recorded", facts.date),
        ("Condition", also_in_bar(facts.condition)),
        _counted("File", facts.file),
    )
    return tuple((name, value) for name, value in entries if value)


def _counted(name: str, value: str) -> tuple[str, str]:
    """(name, value), the name in the plural where the value lists several or is their number."""
    count = value.removesuffix(f" {name.lower()}s")
    return (f"{name}s", count) if count != value or ", " in value else (name, value)


def rig_notice(facts: RecordingFacts) -> str:
    """That recordings are of no real pump; empty unless they state that they are of the virtual rig."""
    if "virtual rig" not in facts.origin:
        return ""
    return f"Recordings of the {facts.origin}: they stand in for a machine and say nothing about any real one."
