"""Numbers, facts and names as pages write them, and the words of the field that a page explains."""

import math
import re
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any

from markupsafe import Markup, escape

from swashtwin.recordings import RecordingSummary
from swashtwin.report.page import Cell, Table

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

_INTERFACES = {
    "slipper_swash": "slipper/swash plate",
    "block_valve": "cylinder block/valve plate",
    "piston_bore": "piston/bore",
}


def format_number(value: float | None) -> str:
    """Three significant digits, large and small ones as powers of ten, ``—`` for NaN, infinity and
    none.

    Examples
    --------
    >>> format_number(0.98), format_number(12), format_number(778000.0), format_number(float("nan"))
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


def format_percent(share: float) -> str:
    """Share in percent, without decimals but never rounded up to all or down to nothing.

    Examples
    --------
    >>> format_percent(0.9996), format_percent(0.5), format_percent(0.001)
    ('> 99 %', '50 %', '< 1 %')
    """
    if not math.isfinite(share):
        return "—"
    if 0.99 < share < 1:
        return "> 99 %"
    if 0 < share < 0.01:
        return "< 1 %"
    return f"{100 * share:.0f} %"


def format_number_cell(value: float | None, reason: str = "") -> Cell:
    """Cell of a number; for NaN it is ``—``, with the reason as tooltip."""
    text = format_number(value)
    if text == "—":
        return Cell(text, reason or "not defined for these data")
    return Cell(f"{text} *" if reason else text, reason)


def format_parameter(name: str) -> str:
    """Name of an interface value in words.

    Examples
    --------
    >>> format_parameter("slipper_swash.damping")
    'slipper/swash plate damping'
    """
    interface, quantity = name.split(".")
    return f"{_INTERFACES[interface]} {quantity}"


def end_sentence(text: str) -> str:
    """A text that begins as a sentence does."""
    return f"{text[:1].upper()}{text[1:]}"


def build_facts_table(caption: str, entries: Iterable[tuple[str, object]]) -> Table:
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


def add_bar_values(text: str) -> str:
    """A text with each absolute pressure in bar beside MPa.

    Examples
    --------
    >>> add_bar_values("860 rev/min, 10 and 15 MPa")
    '860 rev/min, 10 and 15 MPa (100 and 150 bar absolute)'
    """

    def both(match: re.Match[str]) -> str:
        return f"{match[0]} ({re.sub(r'[0-9.]+', lambda number: f'{10 * float(number[0]):.4g}', match[1])} bar absolute)"

    return re.sub(r"([0-9.]+(?:(?:, | and | to | / )[0-9.]+)*) MPa", both, text)


def list_facts(facts: RecordingSummary) -> tuple[tuple[str, str], ...]:
    """(name, value) of each fact that is stated."""
    entries = (
        _counted("Machine", facts.machine),
        ("Recorded", facts.date),
        ("Condition", add_bar_values(facts.condition)),
        _counted("File", facts.file),
    )
    return tuple((name, value) for name, value in entries if value)


def _counted(name: str, value: str) -> tuple[str, str]:
    """(name, value), the name in the plural where the value lists several or is their number."""
    count = value.removesuffix(f" {name.lower()}s")
    return (f"{name}s", count) if count != value or ", " in value else (name, value)


def rig_notice(facts: RecordingSummary) -> str:
    """That recordings are of no real pump; empty unless they state that they are of the virtual
    rig.
    """
    if "virtual rig" not in facts.origin:
        return ""
    return f"Recordings of the {facts.origin}: they stand in for a machine and say nothing about any real one."


_ORDER = "A frequency as a multiple of the shaft's: what happens seven times per turn has order 7."
_WINDOW = "A stretch of fixed length, cut out of a recording; the model judges one after the other."
TERMS = MappingProxyType(
    {
        "shaft order": _ORDER,
        "order of the shaft": _ORDER,
        "orders": _ORDER,
        "piston-pass line": "The frequency at which pistons pass: their number times that of the shaft. Healthy pumps "
        "have this line too.",
        "window": _WINDOW,
        "windows": _WINDOW,
        "error rate": "How often such a statement may be wrong, among recordings like those that calibrated it.",
        "false-alarm rate": "Share of healthy recordings that raise an alarm all the same.",
        "p-value": "Chance that a healthy recording looks as unusual as this one; small means unusual.",
        "dB": "Decibel, a ratio of levels: 6 dB are twice the amplitude, 20 dB ten times.",
        "posterior": "What the measurement leaves possible for a value, and how likely each possibility is.",
        "identified": "The measurement tells the value: with 90 % probability it lies within a factor of 1.5.",
        "SVE": "Spectrum value error: how far the twin's line amplitudes are from the measured ones; 0 is best.",
        "RMSE": "Root mean square error: size of the difference between two waveforms.",
        "twin": "A physical model of this pump, with values of its own that are fitted to recordings.",
        "macro recall": "Share found of each class, averaged over the classes: a rare class counts as much.",
        "macro F1": "Balance of how much of a class is found and how much of what is named is right.",
        "G-mean": "Geometric mean of the shares found of each class: one class never found makes it 0.",
        "macro AUROC": "Chance that a class ranks its own recordings above others: 0.5 is a coin, 1 is perfect.",
        "AUROC": "Chance that a faulty recording ranks above a healthy one: 0.5 is a coin, 1 is perfect.",
        "expected calibration error": "How far stated probabilities are from how often they come true.",
        "spreads": "1.4826 times the median absolute deviation: for ordinary scatter, one standard deviation.",
        "baseline": "What this machine does when it is healthy, at the same speed and pressure.",
        "kurtosis": "How much the samples spike: 3 for noise, more where there are impacts.",
        "crest factor": "Highest peak over the root mean square.",
        "C_sw": "Damping between slippers and swash plate.",
        "K_sw": "Stiffness between slippers and swash plate.",
        "C_v": "Damping between cylinder block and valve plate.",
        "K_v": "Stiffness between cylinder block and valve plate.",
        "C_Hz": "Damping between pistons and their bores.",
        "K_Hz": "Stiffness between pistons and their bores.",
        "G_ε": "Geometric mean of the shares found, with half a window more counted as found and as missed.",
        "RMS": "Root mean square: strength of the vibration as one number.",
    }
)
"""Explanations by word, as the pages spell it."""

_TERM = "|".join(map(re.escape, sorted(TERMS, key=len, reverse=True)))
_MARKED = re.compile(rf"(\(?)\b({_TERM})\b([),.;:]*)|(?<![\w-])(--[a-z][a-z-]*)")


class Glossary:
    """Which words of a page have been explained; a page has one."""

    def __init__(self) -> None:
        self.used: dict[str, str] = {}
        """Explanations by word, in the order of the page."""

    def mark(self, text: str) -> Markup:
        """The text as markup, with a button at each word that stands here first; it opens the
        explanation.
        """
        return Markup(_MARKED.sub(self._mark, escape(text)))

    def _mark(self, match: re.Match[str]) -> str:
        """A word as a button, one line with its punctuation, and an option such as ``--report`` in
        one line.
        """
        before, term, after, option = match.groups()
        if option is not None:
            return f'<span class="option">{option}</span>'
        if TERMS[term] in self.used.values():
            return match[0]
        self.used[term] = TERMS[term]
        button = f'<button class="term" type="button" popovertarget="term-{len(self.used)}">{term}</button>'
        return f'<span class="option">{before}{button}{after}</span>' if before or after else button
