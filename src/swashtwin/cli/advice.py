"""Advice of the library in the words of the shell: options and commands where Python would call a function.

Errors of the library name what a Python caller would write. A person at the shell cannot, so `in_options` rewrites
each such piece before an error is printed. A test holds every error text of the package against it.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager

from swashtwin.foundation import SwashTwinError

_CALL = r"[A-Za-z_][\w.]*\((?:[^()]|\([^()]*\))*\)"
_UNITS = {"MPa": "MPa", "rpm": "rpm", "mm": "mm", "um": "um", "deg": "deg", "celsius": "degC"}
_OPTIONS = {"length": "window", "by": "group"}
"""Options that are not called as their parameters are."""

_KINDS = "BoreDefect|DamScratch|LooseSlipper|SeveritySettings|SwashPlateDefect|TiltedBlockFace"
"""Dataclasses whose fields errors name."""

_ADVICE: tuple[tuple[str, str], ...] = (
    (r"with recording\.picked\(\[?\.\.\.\]?\)", 'by channels = ["..."] in the index'),
    (r"recording\.picked\(\[?\.\.\.\]?\)", 'channels = ["..."] in the index'),
    (r"; one file alone is loaded by load_recording", "; swashtwin index FOLDER writes one"),
    (r"; load it with load_recordings", "; name a file of one recording"),
    (r"AnomalyDetector.fit\(recordings\) makes", "swashtwin train makes"),
    (r"; use register_network first", "; install the package that registers it"),
    (r"Register your own with register_fault before loading what names it", "Install the package that registers it"),
    (r"\(synthesize, TwinFiller\)", "(swashtwin synthesize)"),
    (r"; features= belongs to the classifiers on features", "; it takes no vibration features"),
    (r" \(Twin\.simulate\)|, such as BoreDefect", ""),
    (rf"(?<![\w/])(?:{_KINDS})\.(?=\w+ (?:\(|and |or |must|exceeds))", ""),
    (rf"give it one with {_CALL}", "label it in the index"),
    (rf"name the test side with {_CALL}", "name the test recordings in an index of their own"),
    (rf"an attribute of the recordings is given as {_CALL}", "give one of them, or an attribute of the recordings"),
    (rf"call {_CALL} with the same network before loading", "install the package that registers it"),
    (r"calibrate it: learn_confidence\([^()]*\)", "calibrate it: train --validation-fraction 0.2"),
    (r"; (?:build it|cut them) with (?:classes=[\w.]+|\([^()]*\([^()]*\)\))", ""),
    (r", or (?:use a twin with bandwidth=[\d.]+|take contact=\"\w+\")", ""),
    (r"; use bandwidth=[\d.]+", "; raise the sample rate"),
    (r"take length (?=[\d<])", "take --window "),
    (rf"(?:with )?{_CALL}, or (?=by |--)", ""),
    (rf"{_CALL} \((--[^)]*)\)", r"\1"),
    (rf"; in Python {_CALL}(?:, {_CALL})*", ""),
    (rf"(?:, or |: ){_CALL}(?=[.,;])", ""),
    (r"\bband=\(([\d.e+<x>]+), ([\d.e+<x>]+)\)", r'--band "\1-\2 Hz"'),
    (r"\bseeds=\((\d+),\)", r"--seeds \1"),
)
"""(pattern, words of the shell) of what functions are advised, in the order in which they are applied."""


def in_options(text: str) -> str:
    """An error text with every piece of Python in it said as options.

    Examples
    --------
    >>> in_options("Pressures are in Pa: 15 MPa is MPa(15).")
    'Pressures are in Pa: 15 MPa is "15 MPa".'
    >>> in_options("continue it with resume=True, or delete it to start again.")
    'continue it with --resume, or delete it to start again.'
    """
    text = re.sub(rf"\b({'|'.join(_UNITS)})\(([^()]*)\)", _quantity, text)
    for pattern, words in _ADVICE:
        text = re.sub(pattern, words, text)
    return re.sub(r"\b([a-z_]+)=(\w+|'\w+'|\"\w+\"|\.\.\.)?(?![\w=])", _option, text)


def _quantity(match: re.Match[str]) -> str:
    """``"15 MPa"`` of ``MPa(15)``."""
    return f'"{match[2]} {_UNITS[match[1]]}"'


def _option(match: re.Match[str]) -> str:
    """``--no-phases`` of ``phases=False``, ``--lines shaft`` of ``lines='shaft'``."""
    name, value = _OPTIONS.get(match[1], match[1]).replace("_", "-"), (match[2] or "").strip("'\".")
    if value in ("True", "False"):
        return f"--{'no-' if value == 'False' else ''}{name}"
    return f"--{name} {value}".rstrip()


SINGLE_FILE_OPTIONS = {"sample_rate": "--sample-rate", "unit": "--unit", "channels": "--channels", "names": "--names"}
SINGLE_FILE_OPTIONS |= {"calibration_factor": "--calibration-factor", "speed": "--speed"}
SINGLE_FILE_OPTIONS |= {"discharge_pressure": "--pressure", "resample": "--resample"}
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
    option = SINGLE_FILE_OPTIONS.get(match[1])
    return match[0] if option is None else f"{option} "
