"""Figures together with the data they show."""

import base64
import io
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axis import Axis
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import FuncFormatter

from swashtwin.foundation import csv_text, escape_controls
from swashtwin.report.phone_form import fit_to_phone

_NO_METADATA = {"Date": None, "Creator": None, "Format": None, "Type": None}
_POINTS = 72
"""Dots per inch of an SVG."""
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
    _escape_texts(figure)
    wide = _saved(figure)
    fit_to_phone(figure)
    return Drawing(name, title, caption, wide, columns, _saved(figure), description)


def _saved(figure: Figure) -> str:
    """What `Figure.savefig` writes, without the first of its two drawings, which only serves to find the layout."""
    text, canvas, engine = io.StringIO(), FigureCanvasSVG(figure), figure.get_layout_engine()
    figure.set_dpi(_POINTS)
    if engine is not None:
        engine.execute(figure)
    figure.set_layout_engine("none")
    canvas.print_svg(text, metadata=_NO_METADATA)
    figure.set_layout_engine(engine)
    return text.getvalue()


def _escape_texts(figure: Figure) -> None:
    """Show control characters of names as codes: XML does not allow them, and a lone surrogate has no glyph."""
    for text in figure.findobj(Text):
        text.set_text(escape_controls(text.get_text(), keep="\n"))
    formatters = {
        id(formatter): formatter for formatter in (axis.get_major_formatter() for axis in figure.findobj(Axis))
    }
    for formatter in formatters.values():  # which panels may share
        if isinstance(formatter, FuncFormatter):  # which set_ticks makes of its labels
            formatter.func = partial(_escaped_label, formatter.func)


def _escaped_label(label_of: Callable[..., str], *position: Any) -> str:
    return escape_controls(label_of(*position), keep="\n")


def tabulate(rows: Iterable[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Columns of rows that all have the same names."""
    rows = list(rows)
    return {name: [row[name] for row in rows] for name in (rows[0] if rows else ())}


def _plain(value: Any) -> Any:
    if value is None:
        return ""
    return value.item() if isinstance(value, np.generic) else value
