"""Panels, axes and labels that all figures share."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter

from swashtwin.plot.style import WIDTH


def panels(rows: int, columns: int, height: float, **options: Any) -> tuple[Figure, np.ndarray]:
    """Empty figure of the common width, and its axes as an array of (row, column).

    Parameters
    ----------
    height : height of the whole figure [inch].
    """
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def spread_labels(
    positions: Sequence[float], gap: float, low: float = -math.inf, high: float = math.inf
) -> list[float]:
    """Positions moved as little as possible so that labels are `gap` apart, in order, and between `low` and `high`.

    Examples
    --------
    >>> spread_labels([0.0, 0.1, 5.0], gap=1.0)
    [-0.45, 0.55, 5.0]
    >>> spread_labels([0.0, 0.1, 5.0], gap=1.0, low=0.0)
    [0.0, 1.0, 5.0]
    """
    order = np.argsort(positions, kind="stable")
    clusters: list[tuple[float, int]] = []  # (center, labels), each cluster's labels being `gap` apart
    for position in np.asarray(positions, dtype=float)[order]:
        clusters.append((float(position), 1))
        while len(clusters) > 1 and _overlap(clusters[-2], clusters[-1], gap):
            (below, n_below), (above, n_above) = clusters[-2:]
            count = n_below + n_above
            clusters[-2:] = [((below * n_below + above * n_above) / count, count)]
    spots = [center + (i - (count - 1) / 2) * gap for center, count in clusters for i in range(count)]
    steps = gap * np.arange(len(spots))
    moved = np.empty(len(spots))
    moved[order] = np.maximum(np.minimum(spots, high - steps[::-1]), low + steps)
    return [round(float(spot), 12) for spot in moved]


def _overlap(below: tuple[float, int], above: tuple[float, int], gap: float) -> bool:
    return above[0] - below[0] < gap * (below[1] + above[1]) / 2


def ratio_axis(axes: Axes, along: str, label: str) -> None:
    """Logarithmic axis of values over a reference, with ticks such as 0.1, 0.2, 0.5, 1, 2."""
    axes.set(**{f"{along}scale": "log", f"{along}label": label})
    axis = axes.xaxis if along == "x" else axes.yaxis
    low, high = axes.get_xlim() if along == "x" else axes.get_ylim()
    ticks = [
        step * 10.0**decade
        for decade in range(-6, 7)
        for step in ((1, 2, 5) if high / low < 200 else (1, 3) if high / low < 2000 else (1,))
    ]
    axis.set_major_locator(FixedLocator([tick for tick in ticks if low <= tick <= high]))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.3g}"))
    axis.set_minor_formatter(NullFormatter())


def name_decades(axes: Axes) -> None:
    """Label a logarithmic vertical axis 0.1, 1, 10, and between them if it spans few decades."""
    low, high = axes.get_ylim()
    steps = (1,) if high / low > 100 else (1, 2, 5) if high / low > 4 else (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8)
    ticks = [step * 10.0**decade for decade in range(-12, 13) for step in steps]
    axes.yaxis.set_major_locator(FixedLocator([tick for tick in ticks if low <= tick <= high]))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def words(label: str) -> str:
    """Name of a class, a sensor or a setting in words."""
    return label.replace("_", " ")
