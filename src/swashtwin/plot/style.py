"""Colors, markers and settings that all figures share, so that a color means the same thing everywhere.

Okabe and Ito's palette (https://jfly.uni-koeln.de/color/), which color-blind readers can tell apart; each training set
and each class has its own color, and a marker, a line style or a word repeats it.
"""

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl

MEASURED = "#4d4d4d"
NOMINAL = "#e69f00"
CALIBRATED = "#0072b2"
LIGHT = "#d9d9d9"
"""Gray behind the data: bounds, chance level, the best step."""
ON_SHADE = "#101010"
"""Text on a light shade of its own, which stays dark on a dark page."""
ON_DARK = "#fefefe"
"""Text on a dark shade of its own, which stays light."""

TRAINING_SET_COLORS = {"measured": MEASURED, "nominal": NOMINAL, "calibrated": CALIBRATED}
"""Color of each training set; the twin before and after calibration has the color of its training set."""

CLASS_COLORS = {
    "normal": "#009e73",
    "swash_plate": "#d55e00",
    "cylinder_block": "#aa4499",
    "piston": "#56b4e9",
    "valve_plate": "#a89a1d",
    "loose_slipper": "#000000",
}
_MORE_COLORS = ("#882255", "#44aa99", "#332288", "#999933", "#cc79a7", "#117733")

INTERFACE_COLORS = {"slipper_swash": "#d55e00", "block_valve": "#009e73", "piston_bore": "#aa4499"}
"""Color of each interface; its damping is drawn solid, its stiffness dashed."""

WIDTH = 9.0
"""Width of a figure [inch]."""

_SETTINGS: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Verdana", "Helvetica", "Arial", "sans-serif"],
    "font.size": 10,
    "axes.titlesize": 10,
    "axes.labelsize": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.4,
    "legend.frameon": False,
    "xtick.labelsize": 9,
    "ytick.labelsize": 9,
    "text.parse_math": False,  # a user's "$" is a dollar
    "svg.fonttype": "none",  # text stays text: small, selectable, and any script shows in the reader's own font
    "svg.hashsalt": "swashtwin",
}


@contextmanager
def figure_style() -> Iterator[None]:
    """Context in which figures look alike, whatever the user's own settings are."""
    with mpl.rc_context(), warnings.catch_warnings():
        mpl.rcdefaults()
        mpl.rcParams.update(_SETTINGS)
        warnings.filterwarnings("ignore", message="Glyph .* missing from")  # the browser has it
        yield


def series_colors(names: Sequence[str]) -> dict[str, str]:
    """Color of each line of a figure; a training set keeps its own, and the default network is blue."""
    return _colors(names, {**TRAINING_SET_COLORS, "spectral_bitcn": CALIBRATED})


def class_colors(classes: Sequence[str]) -> dict[str, str]:
    """Color of each class: the standard one if it has one."""
    return _colors(classes, CLASS_COLORS)


def _colors(names: Sequence[str], standard_colors: dict[str, str]) -> dict[str, str]:
    unknown = [name for name in names if name not in standard_colors]
    return {
        name: standard_colors[name]
        if name in standard_colors
        else _MORE_COLORS[unknown.index(name) % len(_MORE_COLORS)]
        for name in names
    }
