"""Figures together with the data they show."""

import base64
import io
import math
import re
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis, XAxis
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.text import Annotation, Text
from matplotlib.ticker import FuncFormatter

from swashtwin.foundation import csv_text, escape_controls

NARROW = 4.3
"""Width of the form for a phone [inch]: 10 points are about 12 pixels on a screen 390 pixels wide."""
_LABEL = 18
"""Characters of a label in that form, after which it is wrapped."""
_LINE, _MARGIN = 0.155, 1.1
"""Height of a line of a label, and of what stands above and below the axes [inch]."""
_UPRIGHT = 0.042
"""Width of an upright label over that of the axis."""
_NO_METADATA = {"Date": None, "Creator": None, "Format": None, "Type": None}
_PAGE_COLORS = {
    "#000000": "ink", "#ffffff": "paper", "#4d4d4d": "measured", "#0072b2": "blue", "#d9d9d9": "light",
    "#e6e6e6": "grid", "#efefef": "faint", "#009e73": "green", "#d55e00": "orange", "#aa4499": "purple",
    "#888888": "gray",
}  # fmt: skip
"""Colors of figures that the page has a dark form of, by the name of its variable."""


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
    narrow: str = ""
    """The same figure, as high and narrow as a phone; where empty, the page shows `svg` on a phone too."""
    description: str = ""
    """What it shows, for those who cannot see it; where empty, the page takes what the columns range over."""

    @property
    def csv(self) -> str:
        """The data as text, every number with all its digits."""
        return csv_text(
            tuple(self.columns), zip(*(map(_plain, column) for column in self.columns.values()), strict=True)
        )

    @property
    def link(self) -> str:
        """The data as an address that holds them, so that a page alone is enough."""
        content = base64.b64encode(self.csv.encode("utf-8", "backslashreplace"))
        return f"data:text/csv;charset=utf-8;base64,{content.decode()}"

    @property
    def forms(self) -> list[tuple[str, str]]:
        """(class of its frame, SVG within a page) of each form: for wide screens and paper, and for phones."""
        forms = [("wide", self.svg), ("narrow", self.narrow)] if self.narrow else [("any", self.svg)]
        return [(name, _within_page(svg, f"{self.name}-{name}")) for name, svg in forms]

    @property
    def words(self) -> str:
        """Title and description, for a screen reader."""
        ranges = [_range(name, column) for name, column in self.columns.items()]
        return f"{self.title}. {self.description or '; '.join(filter(None, ranges))}"


def _range(name: str, column: Sequence[Any] | np.ndarray) -> str:
    """Which values a column has, in words."""
    values = list(map(_plain, column))
    numbers = [value for value in values if isinstance(value, int | float) and math.isfinite(value)]
    if numbers:
        return f"{name.replace('_', ' ')} from {min(numbers):.3g} to {max(numbers):.3g}"
    texts = list(dict.fromkeys(str(value) for value in values if value not in ("", None)))
    if not texts:
        return ""
    return f"{name.replace('_', ' ')}: {', '.join(texts)}" if len(texts) <= 6 else f"{len(texts)} of {name}"


def _within_page(svg: str, prefix: str) -> str:
    """A figure as part of a page: without its prolog and size, its ids unique, its colors the page's."""
    body = svg[svg.index("<svg") :]
    body = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", body, count=1)
    body = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", body, count=1)
    body = re.sub(r'\bid="([^"]+)"', rf'id="{prefix}-\1"', body)
    body = re.sub(r'href="#([^"]+)"', rf'href="#{prefix}-\1"', body)
    body = re.sub(r"url\(#([^)]+)\)", rf"url(#{prefix}-\1)", body)
    return re.sub(r'style="[^"]*"', _in_page_colors, body)


def _in_page_colors(style: re.Match[str]) -> str:
    return re.sub(r"#[0-9a-f]{6}\b", lambda color: _page_color(color[0]), style[0])


def _page_color(color: str) -> str:
    return f"var(--{_PAGE_COLORS[color]})" if color in _PAGE_COLORS else color


def render_drawing(
    name: str,
    figure: Figure,
    columns: Mapping[str, Sequence[Any] | np.ndarray],
    *,
    title: str,
    caption: str,
    description: str = "",
) -> Drawing:
    """The figure as SVG, once wide and once for a phone, with its data; call it within `figure_style`.

    Parameters
    ----------
    description : what it shows in words, for those who cannot see it.
    """
    _rewrite_labels(figure, partial(escape_controls, keep="\n"))
    wide = _saved(figure)
    _narrow(figure)
    return Drawing(name, title, caption, wide, columns, _saved(figure), description)


def _saved(figure: Figure) -> str:
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata=_NO_METADATA)
    return text.getvalue()


def _narrow(figure: Figure) -> None:
    """Make a figure as narrow as a phone: panels side by side go below each other, long labels are wrapped."""
    height, specs = figure.get_figheight(), [axes.get_subplotspec() for axes in figure.axes]
    grids = {(spec.get_gridspec().nrows, spec.get_gridspec().ncols) for spec in specs if spec is not None}
    rows, columns = max(grids, default=(1, 1))
    if columns > 1:
        grid = GridSpec(rows * columns, 1, figure=figure)
        for axes, spec in zip(figure.axes, specs, strict=True):
            if spec is not None:
                axes.set_subplotspec(grid[spec.rowspan.start * columns + spec.colspan.start])
                if axes.yaxis.get_label_position() == "left":
                    axes.tick_params(labelleft=True, labelbottom=True)
        height *= 0.85 * columns
    for legend in list(figure.legends):
        texts = [text.get_text() for text in legend.get_texts()]
        legend.remove()
        columns = 2 if max(map(len, texts), default=0) <= _LABEL else 1
        figure.legend(legend.legend_handles, texts, loc="outside upper center", ncols=columns)
    _rewrite_labels(figure, _wrapped)
    figure.set_size_inches(NARROW, max([height, *map(_label_height, figure.axes)]))
    for axes in figure.axes:
        axes.title.set_wrap(True)
        _thin_out(axes)
        if axes.get_xscale() == "linear" and not isinstance(axes.xaxis.get_major_formatter(), FuncFormatter):
            axes.locator_params(axis="x", nbins=5)


def _label_height(axes: Axes) -> float:
    """Height [inch] at which the names along the vertical axis do not overlap; 0 where it has none."""
    formatter, ticks = axes.yaxis.get_major_formatter(), axes.get_yticks()
    if not isinstance(formatter, FuncFormatter):
        return 0.0
    lines = max((formatter(tick, place).count("\n") + 1 for place, tick in enumerate(ticks)), default=0)
    return _MARGIN + _LINE * lines * len(ticks)


def _thin_out(axes: Axes) -> None:
    """Leave out names along the horizontal axis that stand upright and would overlap."""
    labels = axes.get_xticklabels()
    if axes.get_xscale() != "linear" or not any(label.get_rotation() == 90 for label in labels):
        return
    left, right = axes.get_xlim()
    nearest, ticks = _UPRIGHT * (right - left), list[float]()
    for tick in axes.get_xticks():
        if not ticks or tick - ticks[-1] >= nearest:
            ticks.append(tick)
    formatter = axes.xaxis.get_major_formatter()
    names = [formatter(tick, place) for place, tick in enumerate(axes.get_xticks()) if tick in ticks]
    axes.set_xticks(ticks, names, rotation=90, fontsize=labels[0].get_fontsize())


def _wrapped(text: str) -> str:
    if len(text) <= _LABEL or "\n" in text:
        return text
    return textwrap.fill(text, _LABEL, break_long_words=False, break_on_hyphens=False)


def _rewrite_labels(figure: Figure, rewrite: Callable[[str], str]) -> None:
    """Rewrite the texts of a figure; where they are wrapped, those beside and along its axes only.

    Control characters of names are shown as codes: XML does not allow them, and a lone surrogate has no glyph.
    """
    is_wrapping = rewrite is _wrapped
    for text in figure.findobj(Text):
        if not is_wrapping or isinstance(text, Annotation):
            text.set_text(rewrite(text.get_text()))
    for axis in figure.findobj(Axis):
        if is_wrapping:
            axis.label.set_text(textwrap.fill(axis.label.get_text(), 2 * _LABEL))
        if is_wrapping and isinstance(axis, XAxis):
            continue
        if isinstance(formatter := axis.get_major_formatter(), FuncFormatter):  # which set_ticks makes of its labels
            formatter.func = partial(_rewritten_label, formatter.func, rewrite)


def _rewritten_label(label_of: Callable[..., str], rewrite: Callable[[str], str], *position: Any) -> str:
    return rewrite(label_of(*position))


def tabulate(rows: Iterable[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Columns of rows that all have the same names."""
    rows = list(rows)
    return {name: [row[name] for row in rows] for name in (rows[0] if rows else ())}


def _plain(value: Any) -> Any:
    if value is None:
        return ""
    return value.item() if isinstance(value, np.generic) else value
