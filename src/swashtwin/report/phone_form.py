"""The form of a figure for a phone: one column of panels, short lines of text, no names that overlap."""

import textwrap
from functools import partial
from typing import Any

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.text import Annotation
from matplotlib.ticker import FuncFormatter

NARROW = 4.3
"""Width [inch]: 10 points are about 12 pixels on a screen 390 pixels wide."""

_BESIDE, _ACROSS = 18, 44
"""Characters beside the vertical axis, and along the horizontal one for all names together."""
_LINE, _MARGIN = 0.155, 1.1
"""Height of a line of a label, and of what stands above and below the axes [inch]."""
_UPRIGHT = 0.042
"""Width of an upright label over that of the axis."""
_STACKED = 0.85
"""Height of a panel below the others over that beside them."""


def fit_to_phone(figure: Figure) -> None:
    """Give a finished figure the form for a phone."""
    height = figure.get_figheight() * _stack_panels(figure)
    for legend in list(figure.legends):
        texts = [text.get_text() for text in legend.get_texts()]
        legend.remove()
        columns = 2 if max(map(len, texts), default=0) <= _BESIDE else 1
        handles = [handle for handle in legend.legend_handles if handle is not None]
        figure.legend(handles, texts, loc="outside upper center", ncols=columns)
    for axes in figure.axes:
        axes.set_aspect("auto")
        _wrap_texts(axes)
        _thin_out(axes)
    figure.set_size_inches(NARROW, max([height, *map(_label_height, figure.axes)]))


def _stack_panels(figure: Figure) -> float:
    """How much higher the figure becomes, after its panels were put below each other, row by row."""
    specs = [axes.get_subplotspec() for axes in figure.axes]
    grids = [(spec.get_gridspec().nrows, spec.get_gridspec().ncols) for spec in specs if spec is not None]
    rows, columns = max(grids, default=(1, 1))
    if columns == 1:
        return 1.0
    grid = GridSpec(rows * columns, 1, figure=figure)
    for axes, spec in zip(figure.axes, specs, strict=True):
        if spec is not None:
            axes.set_subplotspec(grid[spec.rowspan.start * columns + spec.colspan.start])
            if axes.yaxis.get_label_position() == "left":
                axes.tick_params(labelleft=True)
    return _STACKED * columns


def _wrap_texts(axes: Axes) -> None:
    """Wrap the names along both axes, their labels, and what stands beside a panel."""
    axes.title.set_wrap(True)
    for text in axes.texts:
        if isinstance(text, Annotation):
            text.set_text(_wrapped(_BESIDE, text.get_text()))
    for axis in (axes.xaxis, axes.yaxis):
        axis.label.set_text(_wrapped(2 * _BESIDE, axis.label.get_text()))
    _wrap_names(axes.yaxis, _BESIDE)
    shared = axes.get_shared_x_axes().get_siblings(axes)  # which have one formatter, and names below one of them only
    if not any(label.get_rotation() for panel in shared for label in panel.get_xticklabels()):
        _wrap_names(axes.xaxis, max(6, _ACROSS // max(1, len(axes.get_xticks()))))
    if axes.get_xscale() == "linear" and not _has_names(axes.xaxis):
        axes.locator_params(axis="x", nbins=5)


def _has_names(axis: Axis) -> bool:
    """Whether words stand along an axis, or numbers in a form of their own."""
    return isinstance(axis.get_major_formatter(), FuncFormatter)


def _wrap_names(axis: Axis, width: int) -> None:
    """Wrap them once, however many panels share their formatter."""
    formatter = axis.get_major_formatter()
    if isinstance(formatter, FuncFormatter) and getattr(formatter.func, "func", None) is not _wrapped_name:
        formatter.func = partial(_wrapped_name, formatter.func, width)


def _wrapped_name(name_of: Any, width: int, *position: Any) -> str:
    return _wrapped(width, name_of(*position))


def _wrapped(width: int, text: str) -> str:
    if len(text) <= width:
        return text
    return textwrap.fill(text, width, break_long_words=False, break_on_hyphens=False)


def _label_height(axes: Axes) -> float:
    """Height [inch] at which the names along the vertical axis do not overlap; 0 where it has none."""
    if not _has_names(axes.yaxis):
        return 0.0
    name_of, ticks = axes.yaxis.get_major_formatter(), axes.get_yticks()
    lines = max((name_of(tick, index).count("\n") + 1 for index, tick in enumerate(ticks)), default=0)
    return _MARGIN + _LINE * lines * len(ticks)


def _thin_out(axes: Axes) -> None:
    """Leave out names along the horizontal axis that stand upright and would overlap."""
    labels = axes.get_xticklabels()
    if axes.get_xscale() != "linear" or not any(label.get_rotation() == 90 for label in labels):
        return
    left, right = axes.get_xlim()
    ticks: list[float] = []
    for tick in axes.get_xticks():
        if not ticks or tick - ticks[-1] >= _UPRIGHT * (right - left):
            ticks.append(tick)
    name_of = axes.xaxis.get_major_formatter()
    names = [name_of(tick, index) for index, tick in enumerate(axes.get_xticks()) if tick in ticks]
    axes.set_xticks(ticks, names, rotation=90, fontsize=labels[0].get_fontsize())
