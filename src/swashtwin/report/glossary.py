"""Words of the field that a page explains where they first stand."""

import re
from types import MappingProxyType

from markupsafe import Markup, escape

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
_PATTERN = re.compile(rf"(\(?)\b({_TERM})\b([),.;:]*)")
_OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")
_UNBROKEN = Markup('<span class="option">{}</span>')
_BUTTON = Markup('<button class="term" type="button" popovertarget="term-{}">{}</button>')


class Glossary:
    """Which words of a page have been explained; a page has one."""

    def __init__(self) -> None:
        self.used: dict[str, str] = {}
        """Explanations by word, in the order of the page."""

    def mark(self, text: str) -> Markup:
        """The text as markup, with a button at each word that stands here first; it opens the explanation."""
        parts, end = [Markup()], 0
        for match in _PATTERN.finditer(text):
            before, term, after = match.groups()
            if TERMS[term] in self.used.values():
                continue
            self.used[term] = TERMS[term]
            button = Markup("{}{}{}").format(before, _BUTTON.format(len(self.used), term), after)
            # browsers may end a line at either side of a button, so its punctuation stays in one line with it
            parts += [_unbroken(text[end : match.start()]), _UNBROKEN.format(button) if before or after else button]
            end = match.end()
        return Markup().join([*parts, _unbroken(text[end:])])


def _unbroken(text: str) -> Markup:
    """The text as markup in which no line ends within an option such as ``--report``."""
    parts, end = [Markup()], 0
    for match in _OPTION.finditer(text):
        parts += [escape(text[end : match.start()]), _UNBROKEN.format(match[0])]
        end = match.end()
    return Markup().join([*parts, escape(text[end:])])
