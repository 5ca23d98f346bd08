"""Figures together with the data they show."""

import base64
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure

from swashtwin.foundation import csv_text, escape_controls

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

    kind: ClassVar[str] = "picture"
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
    description: str = ""
    """What it shows, for those who cannot see it."""

    @property
    def csv(self) -> str:
        """The data as text, every number with all its digits."""
        columns = (map(_plain, column) for column in self.columns.values())
        return csv_text(tuple(self.columns), zip(*columns, strict=True))

    @property
    def link(self) -> str:
        """The data as an address that holds them, so that a page alone is enough."""
        content = base64.b64encode(self.csv.encode("utf-8", "backslashreplace"))
        return f"data:text/csv;charset=utf-8;base64,{content.decode()}"

    @property
    def within_page(self) -> str:
        """The figure as part of a page: without its prolog and size, its ids unique, its colors the page's."""
        body = self.svg[self.svg.index("<svg") :]
        for size in ("width", "height"):
            body = re.sub(rf'(<svg[^>]*?) {size}="[^"]*"', r"\1", body, count=1)
        body = re.sub(r'\bid="([^"]+)"', rf'id="{self.name}-\1"', body)
        body = re.sub(r'href="#([^"]+)"', rf'href="#{self.name}-\1"', body)
        body = re.sub(r"url\(#([^)]+)\)", rf"url(#{self.name}-\1)", body)
        colors = re.compile("|".join(rf"{color}\b" for color in _PAGE_COLORS))
        return re.sub(
            r'style="[^"]*"', lambda style: colors.sub(lambda color: f"var(--{_PAGE_COLORS[color[0]]})", style[0]), body
        )


def render_drawing(
    name: str,
    figure: Figure,
    columns: Mapping[str, Sequence[Any] | np.ndarray],
    *,
    title: str,
    caption: str,
    description: str = "",
) -> Drawing:
    """The figure as SVG with its data; call it within `figure_style`.

    Parameters
    ----------
    description : what it shows in words, for those who cannot see it.
    """
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata=_NO_METADATA)
    svg = text.getvalue().replace("<svg", "<!-- figure of swashtwin -->\n<svg", 1)
    # XML allows no control characters, which names of recordings may have
    svg = escape_controls(svg, keep="\n")
    return Drawing(name, title, caption, svg, columns, description)


def tabulate(rows: Iterable[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Columns of rows that all have the same names."""
    rows = list(rows)
    return {name: [row[name] for row in rows] for name in (rows[0] if rows else ())}


def _plain(value: Any) -> Any:
    if value is None:
        return ""
    return value.item() if isinstance(value, np.generic) else value
