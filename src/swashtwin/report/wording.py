"""Numbers, facts and names as pages write them, and the terms of the field that a page explains."""

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
    """Return a number with three significant digits.

    Large and small numbers are written as powers of ten; NaN, infinity and `None` as ``—``.

    Examples
    --------
    >>> format_number(0.98), format_number(12), format_number(778000.0), format_number(float("nan"))
    ('0.980', '12.0', '7.78·10⁵', '—')
    """
    if value is None or not math.isfinite(value):
        return "—"
    if value == 0:
        return "0"

    mantissa, exponent_text = f"{value:.2e}".split("e")
    exponent = int(exponent_text)
    if not -3 <= exponent <= 4:
        return f"{mantissa}·10{str(exponent).translate(_SUPERSCRIPTS)}"
    rounded = float(f"{value:.3g}")
    return f"{rounded:.{max(0, 2 - exponent)}f}"


def format_percent(share: float) -> str:
    """Return a share in percent, without decimals but never rounded up to all or down to nothing.

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
    """Return the cell of a number; for NaN it is ``—``, with the reason as tooltip."""
    text = format_number(value)
    if text == "—":
        return Cell(text, reason or "not defined for these data")
    if reason:
        text += " *"
    return Cell(text, reason)


def format_parameter(name: str) -> str:
    """Return the name of an interface value in words.

    Examples
    --------
    >>> format_parameter("slipper_swash.damping")
    'slipper/swash plate damping'
    """
    interface, quantity = name.split(".")
    return f"{_INTERFACES[interface]} {quantity}"


def capitalize_sentence(text: str) -> str:
    """Return a text with a capital first letter."""
    return f"{text[:1].upper()}{text[1:]}"


def build_facts_table(caption: str, entries: Iterable[tuple[str, object]]) -> Table:
    """Return a table of names and values."""
    return Table(caption, ("", ""), tuple((name, _format_value(value)) for name, value in entries))


def flatten_settings(settings: Mapping[str, Any], prefix: str = "") -> list[tuple[str, object]]:
    """Return settings within settings as one list of dotted names."""
    entries: list[tuple[str, object]] = []
    for name, value in settings.items():
        if isinstance(value, Mapping):
            entries += flatten_settings(value, f"{prefix}{name}.")
        else:
            entries.append((f"{prefix}{name}", value))
    return entries


def _format_value(value: object) -> str:
    """Return a value of a setting as text."""
    if value is None:
        return "none"
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, list | tuple):
        return ", ".join(_format_value(entry) for entry in value) or "none"
    return str(value)


_NUMBER = re.compile(r"[0-9.]+")
_PRESSURES = re.compile(r"([0-9.]+(?:(?:, | and | to | / )[0-9.]+)*) MPa")


def add_bar_values(text: str) -> str:
    """Return a text with the value in bar after each absolute pressure in MPa.

    Examples
    --------
    >>> add_bar_values("860 rev/min, 10 and 15 MPa")
    '860 rev/min, 10 and 15 MPa (100 and 150 bar absolute)'
    """

    def to_bar(megapascals: re.Match[str]) -> str:
        return f"{10 * float(megapascals[0]):.4g}"

    def with_bar(pressures: re.Match[str]) -> str:
        return f"{pressures[0]} ({_NUMBER.sub(to_bar, pressures[1])} bar absolute)"

    return _PRESSURES.sub(with_bar, text)


def list_facts(facts: RecordingSummary) -> tuple[tuple[str, str], ...]:
    """Return (name, value) of each fact that is specified."""
    entries = (
        _match_plural("Machine", facts.machine),
        ("Recorded", facts.date),
        ("Condition", add_bar_values(facts.condition)),
        _match_plural("File", facts.file),
    )
    return tuple((name, value) for name, value in entries if value)


def _match_plural(name: str, value: str) -> tuple[str, str]:
    """Return (name, value), the name in the plural if the value lists several or is their
    number.
    """
    count = value.removesuffix(f" {name.lower()}s")
    if count != value or ", " in value:
        return (f"{name}s", count)
    return (name, value)


def rig_notice(facts: RecordingSummary) -> str:
    """Return a notice that recordings of the virtual rig are of no real pump; empty for others."""
    if "virtual rig" not in facts.origin:
        return ""
    return (
        f"Recordings of the {facts.origin}: they stand in for a machine and do not describe any "
        "real one."
    )


_ORDER = "A frequency as a multiple of the shaft's: what happens three times per turn has order 3."
_WINDOW = "A section of fixed length of a recording; the model classifies each one."
_AUROC_SCALE = "0.5 is a coin, 1 is perfect."
TERMS = MappingProxyType(
    {
        "shaft order": _ORDER,
        "order of the shaft": _ORDER,
        "orders": _ORDER,
        "piston-pass line": "The frequency at which pistons pass: their number times that of the "
        "shaft. Healthy pumps have this line too.",
        "window": _WINDOW,
        "windows": _WINDOW,
        "error rate": "How often such a statement may be wrong, among recordings like those that "
        "calibrated it.",
        "false-alarm rate": "Share of healthy recordings that raise an alarm.",
        "p-value": "Probability that a healthy recording looks at least as unusual as this one; "
        "small means unusual.",
        "dB": "Decibel, a ratio of levels: 6 dB are twice the amplitude, 20 dB ten times.",
        "posterior": "The values that the measurement leaves possible, and how likely each is.",
        "identified": "The measurement determines the value: with 90 % probability it lies within "
        "a factor of 1.5.",
        "SVE": "Spectrum value error: how far the twin's line amplitudes are from the measured "
        "ones; 0 is best.",
        "RMSE": "Root mean square error: size of the difference between two waveforms.",
        "twin": "A physical model of this pump, whose values are fitted to recordings.",
        "macro recall": "Share of each class that is classified correctly, averaged over the "
        "classes: a rare class counts as much.",
        "macro F1": "Balance of how much of a class is detected and how many of its detections are "
        "right, averaged over the classes.",
        "G-mean": "Geometric mean of the recalls of the classes: one class never detected makes it "
        "0.",
        "macro AUROC": "Probability that a class ranks its own recordings above others: "
        + _AUROC_SCALE,
        "AUROC": "Probability that a faulty recording ranks above a healthy one: " + _AUROC_SCALE,
        "expected calibration error": "How far probabilities are from how often they come true.",
        "spreads": "1.4826 times the median absolute deviation: for ordinary scatter, one standard "
        "deviation.",
        "baseline": "This machine's healthy recordings at the same speed and pressure.",
        "kurtosis": "How much the samples spike: 3 for noise, more with impacts.",
        "crest factor": "Highest peak over the root mean square.",
        "C_sw": "Damping between slippers and swash plate.",
        "K_sw": "Stiffness between slippers and swash plate.",
        "C_v": "Damping between cylinder block and valve plate.",
        "K_v": "Stiffness between cylinder block and valve plate.",
        "C_Hz": "Damping between pistons and their bores.",
        "K_Hz": "Stiffness between pistons and their bores.",
        "G_ε": "Geometric mean of the recalls, with half a window more counted as right and as "
        "wrong in each class.",
        "RMS": "Root mean square: strength of the vibration as one number.",
    }
)
"""Explanations by term, as the pages spell it."""

# longest first, so that "macro AUROC" is not matched as "AUROC"
_TERM = "|".join(map(re.escape, sorted(TERMS, key=len, reverse=True)))
_MARKED = re.compile(rf"(\(?)\b({_TERM})\b([),.;:]*)|(?<![\w-])(--[a-z][a-z-]*)")


class Glossary:
    """Terms of a page that have been explained; a page has one glossary."""

    def __init__(self) -> None:
        self.used: dict[str, str] = {}
        """Explanations by term, in the order of the page."""

    def mark(self, text: str) -> Markup:
        """Return the text as markup, with a button at the first occurrence of each term; it opens
        the explanation.
        """
        return Markup(_MARKED.sub(self._mark_match, escape(text)))

    def _mark_match(self, match: re.Match[str]) -> str:
        """Return a term as a button that does not break from its punctuation, and an option such
        as ``--report`` that does not break.
        """
        opening, term, closing, option = match.groups()
        if option is not None:
            return f'<span class="option">{option}</span>'
        if TERMS[term] in self.used.values():
            return match[0]

        self.used[term] = TERMS[term]
        target = f"term-{len(self.used)}"
        button = f'<button class="term" type="button" popovertarget="{target}">{term}</button>'
        if opening or closing:
            return f'<span class="option">{opening}{button}{closing}</span>'
        return button
