"""Advice of the library in the words of the shell: options and commands where Python would call a function.

Errors of the library name what a Python caller would write. A person at the shell cannot, so `in_options` rewrites
each such piece before an error is printed. A test holds every error text of the package against it.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager

from swashtwin.foundation import SwashTwinError

_UNITS = {"MPa": "MPa", "rpm": "rpm", "mm": "mm", "um": "um", "deg": "deg", "celsius": "degC"}

_ADVICE: tuple[tuple[str, str], ...] = (
    (r"(?: in both)? with recording\.picked\((?:\[\.\.\.\]|\.\.\.)\)", " with --channels"),
    (r"recording\.picked\((?:\[\.\.\.\]|\.\.\.)\)", "--channels"),
    (r"; (?:a|one) \w+ is saved with \w+\(\w+, path\)|; a network is saved with save_amortized\(method, path\)", ""),
    (r"; save one with save_classifier\(\w+, path\)", "; swashtwin train writes one"),
    (r"; windows are saved with save_windows\(windows, path\)", "; swashtwin synthesize writes windows"),
    (r"save_\w+\((\w+, )?path\)", "the command that makes it"),
    (r"; in Python [^;.]*(?:\.\w+[^;.)]*\))*(?=[;.)])", ""),
)
"""(pattern, words of the shell) of each advice, the longer ones first."""


def in_options(text: str) -> str:
    """An error text with every Python call in it said as options."""
    for pattern, words in _ADVICE:
        text = re.sub(pattern, words, text)
    return re.sub(rf"\b({'|'.join(_UNITS)})\(([^()]*)\)", _quantity, text)


def _quantity(match: re.Match[str]) -> str:
    """``"15 MPa"`` of ``MPa(15)``."""
    return f'"{match[2]} {_UNITS[match[1]]}"'


_SINGLE_FILE = {"sample_rate": "--sample-rate", "unit": "--unit", "channels": "--channels", "names": "--names"}
_SINGLE_FILE |= {"calibration_factor": "--calibration-factor", "speed": "--speed"}
"""Options that state for a single file what keys of an index state for many."""


@contextmanager
def single_file_options() -> Iterator[None]:
    """Within it, errors that advise to edit the index name the options of a single file instead."""
    try:
        yield
    except SwashTwinError as cause:
        text = re.sub(r"\b([a-z_]+) = (?=[\"'\[])", _as_option, str(cause))
        text = text.replace("the index says", "the option says").replace("correct the index", "correct the option")
        text = text.replace("remove unit,", "leave out --unit,").replace("--channels [...]", "--channels NAME")
        raise type(cause)(text) from cause


def _as_option(match: re.Match[str]) -> str:
    option = _SINGLE_FILE.get(match[1])
    return match[0] if option is None else f"{option} "
