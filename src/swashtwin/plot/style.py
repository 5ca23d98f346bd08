"""Colors, settings, panels and axes that all figures share.

A color means the same everywhere.

The palette is that of Okabe and Ito (https://jfly.uni-koeln.de/color/), whose colors color-blind
readers can distinguish. Each training set and each class has one color in all figures; a marker, a
line style or a word repeats it.
"""

import base64
import io
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

MEASURED = "#4d4d4d"
NOMINAL = "#e69f00"
CALIBRATED = "#0072b2"
LIGHT = "#d9d9d9"
"""Gray behind the data: bounds, chance level, the best step."""
ON_SHADE = "#101010"
"""Text on a light shade, which stays dark on a dark page."""
ON_DARK = "#fefefe"
"""Text on a dark shade, which stays light."""

# Color of each class.
_CLASS_COLORS = {
    "normal": "#009e73",
    "swash_plate": "#d55e00",
    "cylinder_block": "#aa4499",
    "piston": "#56b4e9",
    "valve_plate": "#a89a1d",
    "loose_slipper": "#000000",
}

# Color of each training set by the source of its windows, which is also that of the twin before and
# after calibration. Sets whose names begin alike have one source and thus one color, such as
# `nominal_every_class`; within a figure, dashes distinguish them.
_TRAINING_SET_COLORS = {
    "measured": MEASURED,
    "nominal": NOMINAL,
    "calibrated": CALIBRATED,
    "every_class": CALIBRATED,
    "law": "#009e73",
    "posterior": "#56b4e9",
    "default_prior": "#56b4e9",
    "no_gain": "#d55e00",
    "ceiling_true": "#aa4499",
    "ceiling_perfect": "#332288",
    "class_weights": "#888888",
    "duplicate": "#a89a1d",
    "noisy_duplicate": "#882255",
    "smote": "#44aa99",
    "adasyn": "#117733",
    "cvae": "#cc79a7",
    "wgan_gp": "#000000",
}

# Color of the default network, where networks are compared.
_NETWORK_COLORS = {"spectral_bitcn": CALIBRATED}

_NAMED_COLORS = {**_CLASS_COLORS, **_TRAINING_SET_COLORS, **_NETWORK_COLORS}

_FURTHER_COLORS = ("#882255", "#44aa99", "#332288", "#999933", "#cc79a7", "#117733")

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
    # text stays text: small, selectable, and any script shows in the reader's own font
    "svg.fonttype": "none",
    "svg.hashsalt": "swashtwin",
}


@contextmanager
def figure_style() -> Iterator[None]:
    """Return a context in which figures look alike, whatever the user's settings are."""
    with mpl.rc_context(), warnings.catch_warnings():
        mpl.rcdefaults()
        mpl.rcParams.update(_SETTINGS)
        warnings.filterwarnings("ignore", message="Glyph .* missing from")  # the browser has it
        yield


def series_colors(names: Sequence[str]) -> dict[str, str]:
    """Return the color of each line or class of a figure: the standard one if it has one.

    Examples
    --------
    >>> series_colors(["nominal", "nominal_every_class"])
    {'nominal': '#e69f00', 'nominal_every_class': '#e69f00'}
    """
    colors: dict[str, str] = {}
    n_further = 0
    for name in names:
        color = _find_standard_color(name)
        if color is None and name not in colors:
            color = _FURTHER_COLORS[n_further % len(_FURTHER_COLORS)]
            n_further += 1
        colors.setdefault(name, color or "")
    return colors


def _find_standard_color(name: str) -> str | None:
    """Return the color of a name, or of the training set that it is a variant of."""
    if name in _NAMED_COLORS:
        return _NAMED_COLORS[name]
    for source, color in _TRAINING_SET_COLORS.items():
        if name.startswith(f"{source}_"):
            return color
    return None


class _NotebookFigure(Figure):
    """Figure that a notebook shows although pyplot does not know it."""

    def _repr_html_(self) -> str:
        image = io.BytesIO()
        with figure_style():
            self.savefig(image, format="png", dpi=100)
        content = base64.b64encode(image.getvalue()).decode("ascii")
        return f"<img alt='figure' style='max-width:100%' src='data:image/png;base64,{content}'>"


def create_panels(
    rows: int, columns: int, height: float, **options: Any
) -> tuple[Figure, np.ndarray]:
    """Return an empty figure of the common width and a `height` [inch], and its axes as an array of
    (row, column).
    """
    figure = _NotebookFigure(figsize=(WIDTH, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def spread_labels(positions: Sequence[float], gap: float) -> list[float]:
    """Return the positions moved as little as possible so that labels are `gap` apart, in order.

    Examples
    --------
    >>> spread_labels([0.0, 0.1, 5.0], gap=1.0)
    [-0.45, 0.55, 5.0]
    """
    from scipy.optimize import isotonic_regression

    # less the gaps below them, positions that are far enough apart do not fall
    order = np.argsort(positions, kind="stable")
    gaps = gap * np.arange(len(positions))
    reduced = np.asarray(positions, dtype=float)[order] - gaps
    spread_positions = np.empty(len(order))
    spread_positions[order] = isotonic_regression(reduced).x + gaps
    return [round(float(position), 12) for position in spread_positions]


def label_log_axis(axis: Axis) -> None:
    """Label a logarithmic axis 0.1, 1, 10, and values between if it spans few decades."""
    low, high = axis.get_view_interval()
    steps: tuple[float, ...]
    if high / low > 200:
        steps = (1,)
    elif high / low > 4:
        steps = (1, 2, 5)
    else:
        steps = (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8)
    axis.set_major_locator(LogLocator(subs=steps))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())
