"""Figures together with the data they show."""

import io
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter

from swashtwin.foundation import csv_text, escape_controls
from swashtwin.report.style import WIDTH

_NO_METADATA = {"Date": None, "Creator": None, "Format": None, "Type": None}


@dataclass(frozen=True, eq=False)
class Drawing:
    """One figure of a report."""

    name: str
    """File name without suffix."""
    title: str
    """What it shows."""
    caption: str
    """How to read it."""
    svg: str
    """The figure as a file of its own."""
    columns: Mapping[str, Sequence[Any] | np.ndarray]
    """Its data, one entry of each column per row."""

    @property
    def csv(self) -> str:
        """The data as text, every number with all its digits."""
        return csv_text(
            tuple(self.columns), zip(*(map(_plain, column) for column in self.columns.values()), strict=True)
        )

    @property
    def inline(self) -> str:
        """The figure as part of a page: without its own prolog and size, ids made unique by the name."""
        body = self.svg[self.svg.index("<svg") :]
        body = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", body, count=1)
        body = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", body, count=1)
        body = re.sub(r'\bid="([^"]+)"', rf'id="{self.name}-\1"', body)
        body = re.sub(r'href="#([^"]+)"', rf'href="#{self.name}-\1"', body)
        return re.sub(r"url\(#([^)]+)\)", rf"url(#{self.name}-\1)", body)


def render_drawing(
    name: str, figure: Figure, columns: Mapping[str, Sequence[Any] | np.ndarray], *, title: str, caption: str
) -> Drawing:
    """The figure as SVG, with its data; call it within `figure_style`."""
    _escape_texts(figure)
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata=_NO_METADATA)
    return Drawing(name, title, caption, text.getvalue(), columns)


def _escape_texts(figure: Figure) -> None:
    """Show control characters of names as codes: XML does not allow them, and a lone surrogate has no glyph."""
    for text in figure.findobj(Text):
        text.set_text(escape_controls(text.get_text(), keep="\n"))
    for axis in figure.findobj(Axis):
        if isinstance(formatter := axis.get_major_formatter(), FuncFormatter):  # which set_ticks makes of its labels
            formatter.func = partial(_escaped_label, formatter.func)


def _escaped_label(label_of: Callable[..., str], *position: Any) -> str:
    return escape_controls(label_of(*position), keep="\n")


def panels(rows: int, columns: int, height: float, **options: Any) -> tuple[Figure, np.ndarray]:
    """Empty figure of the common width, and its axes as an array of (row, column).

    Parameters
    ----------
    height : height of the whole figure [inch].
    """
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def tabulate(rows: Iterable[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Columns of rows that all have the same names."""
    rows = list(rows)
    return {name: [row[name] for row in rows] for name in (rows[0] if rows else ())}


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


def _plain(value: Any) -> Any:
    if value is None:
        return ""
    return value.item() if isinstance(value, np.generic) else value
