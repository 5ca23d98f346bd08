"""Figures laid out again for a phone: panels below each other, and long texts in several lines."""

import textwrap
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import FixedLocator

PHONE_WIDTH = 4.2
"""Width of a figure [inch] whose text of 10 points is as large as that of the page on a phone of
390 pixels."""

# Characters that fit across a panel, into a name left of it, and into half of a legend.
_PANEL_CHARACTERS = 44
_NAME_CHARACTERS = 20
_HALF_CHARACTERS = 18

# Heights [inch]: of a line of text, of the names below a panel, and of a figure without its panels.
_LINE_HEIGHT = 0.18
_NAMES_HEIGHT = 0.6
_MARGIN = 1.0


def fit_to_phone(figure: Figure) -> None:
    """Lay a figure of `create_panels` out again at `PHONE_WIDTH`.

    Its panels stand in one column, its legends have at most two, and long names several lines.
    """
    panels = [panel for panel in figure.axes if panel.axison and panel.get_visible()]
    rows, columns = _grid_of(panels)
    panel_height = (figure.get_figheight() - _MARGIN) / rows
    if columns > 1:
        _stack(figure, panels, columns)
        panel_height += _NAMES_HEIGHT

    height = _MARGIN + panel_height * len(panels)
    for panel in panels:
        further_lines = _wrap_names(panel.yaxis)
        height += _LINE_HEIGHT * further_lines
        _wrap_texts([panel.xaxis.label, *panel.get_children()])
    for legend in figure.legends[:]:
        labels = [text.get_text() for text in legend.get_texts()]
        handles = [handle for handle in legend.legend_handles if handle is not None]
        legend.remove()
        n_columns = 2 if max(map(len, labels)) <= _HALF_CHARACTERS else 1
        figure.legend(handles, labels, loc="outside upper left", ncols=n_columns)
        height += _LINE_HEIGHT * (len(labels) / n_columns - 1)
    figure.set_size_inches(PHONE_WIDTH, height)


def _grid_of(panels: Sequence[Axes]) -> tuple[int, int]:
    """Return the numbers of rows and columns of the panels."""
    for panel in panels:
        spec = panel.get_subplotspec()
        if spec is not None:
            rows, columns, *_ = spec.get_geometry()
            return rows, columns
    return 1, 1


def _stack(figure: Figure, panels: Sequence[Axes], columns: int) -> None:
    """Put the panels below each other, each with the names of its axes."""
    positions = [panel.get_subplotspec().num1 for panel in panels]  # type: ignore[union-attr]
    y_labels = {
        position // columns: panel.get_ylabel()
        for panel, position in zip(panels, positions, strict=True)
        if panel.get_ylabel()
    }
    x_labels = {
        position % columns: panel.get_xlabel()
        for panel, position in zip(panels, positions, strict=True)
        if panel.get_xlabel()
    }

    grid = figure.add_gridspec(len(panels), 1)
    for row, (panel, position) in enumerate(zip(panels, positions, strict=True)):
        panel.set_subplotspec(grid[row])
        panel.tick_params(labelbottom=True, labelleft=True)
        panel.set_ylabel(y_labels.get(position // columns, ""))
        panel.set_xlabel(x_labels.get(position % columns, ""))


def _wrap_names(axis: Axis) -> int:
    """Break the names of an axis of classes or rows, and return the number of further lines."""
    names = [label.get_text() for label in axis.get_ticklabels()]
    is_fixed = isinstance(axis.get_major_locator(), FixedLocator)
    if not is_fixed or max(map(len, names), default=0) <= _NAME_CHARACTERS:
        return 0
    wrapped = [textwrap.fill(" ".join(name.split()), _NAME_CHARACTERS) for name in names]
    axis.set_ticks(axis.get_ticklocs(), wrapped)
    return sum(name.count("\n") for name in wrapped)


def _wrap_texts(artists: Sequence[object]) -> None:
    """Break titles and labels that are wider than a panel."""
    for artist in artists:
        if isinstance(artist, Text) and len(artist.get_text()) > _PANEL_CHARACTERS:
            artist.set_text(textwrap.fill(artist.get_text(), _PANEL_CHARACTERS))
