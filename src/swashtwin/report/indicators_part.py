"""Part of the page about a table of indicators."""

import math

import numpy as np
from matplotlib.axes import Axes

from swashtwin.foundation import plural
from swashtwin.plot import LIGHT, class_colors, figure_style, panels, unit_words, words
from swashtwin.report.drawing import Drawing, render_drawing
from swashtwin.report.page import Bullets, Cell, Group, Part, Picture, Section, SectionOrder, Table
from swashtwin.report.wording import indicator_words, number
from swashtwin.signals import Indicator, IndicatorTable

_SHOWN = ("rms", "velocity_rms", "crest_factor", "kurtosis")
_MOST_ROWS, _FEW_ROWS = 60, 24
"""Rows that the page lists, and of these how many are not folded away; the figure's data hold all."""
_NOT_CHECKED = (
    "The page does not say whether a value is too high: no limit of a standard is made for axial piston pumps. "
    "Compare each machine with itself, at the same speed and pressure (swashtwin signal trend).",
)


def indicators_part(table: IndicatorTable, key: str) -> Part:
    """Part of the page about one table."""
    names = list(dict.fromkeys(row.recording_id for row in table.rows))
    channels = list(dict.fromkeys(row.channel for row in table.rows))
    shown = [index for index, column in enumerate(table.columns) if column.name in _SHOWN]
    shown += [index for index, column in enumerate(table.columns) if column.name.startswith("order_amplitude")]
    meanings = tuple(f"{indicator_words(column.name)}: {column.meaning}." for column in table.columns)
    rows = _table(table, shown)
    blocks = (
        rows if len(rows.rows) <= _FEW_ROWS else Group("Values of each recording", (rows,), is_open=False),
        Group(f"What each of the {len(table.columns)} indicators means", (Bullets("", meanings),), is_open=False),
    )
    return Part(
        title="Indicators of the recordings",
        answer=(f"{plural(len(names), 'recording')}, {plural(len(channels), 'channel')} each.",),
        notice="",
        sections=(Section(SectionOrder.SCORES, "The indicators", blocks),),
        results={"indicators": [table.to_dict()]},
        verdict=f"{len(table.columns)} indicators of {plural(len(names), 'recording')}",
        certainty=_NOT_CHECKED,
        actions=(
            "Follow one of them over time, with the healthy range drawn: swashtwin signal trend.",
            "Look at single lines: swashtwin signal spectrum.",
        ),
        glance=(Picture(indicators_drawing(table, shown, key)),) if shown else (),
    )


@figure_style()
def indicators_drawing(table: IndicatorTable, shown: list[int], key: str) -> Drawing:
    """Values of the main indicators by channel, one dot for each recording, colored by class."""
    channels = list(dict.fromkeys(row.channel for row in table.rows))
    classes = list(dict.fromkeys(row.label or "no class" for row in table.rows))
    colors = class_colors(classes)
    figure, axes = panels(math.ceil(len(shown) / 2), 2, 0.9 + 1.75 * math.ceil(len(shown) / 2))
    for panel, index in zip(axes.flat, shown, strict=False):
        column = table.columns[index]
        _draw_dots(panel, table, index, channels, classes, colors)
        panel.set_title(_name(column), loc="left")
        panel.set_xticks(range(len(channels)), [words(name) for name in channels])
        panel.set_xlim(-0.6, len(channels) - 0.4)
    for panel in axes.flat[len(shown) :]:
        panel.set_visible(False)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=min(5, len(labels)))
    keys = {
        "recording": [row.recording_id for row in table.rows],
        "channel": [row.channel for row in table.rows],
        "class": [row.label or "" for row in table.rows],
    }
    values = {f"{column.name} [{column.unit or '1'}]": table.values[:, i] for i, column in enumerate(table.columns)}
    caption = "One dot for each recording. The data hold every indicator of every recording and channel."
    medians = [f"median {_name(table.columns[i])} {number(_median(table, i))}" for i in shown]
    return render_drawing(
        f"{key}_dots",
        figure,
        {**keys, **values},
        title="The main indicators",
        caption=caption,
        description=f"{', '.join(medians)}.",
    )


def _median(table: IndicatorTable, index: int) -> float:
    values = table.values[:, index] * table.columns[index].shown[0]
    return float(np.median(values[np.isfinite(values)])) if np.isfinite(values).any() else math.nan


def _draw_dots(
    panel: Axes, table: IndicatorTable, index: int, channels: list[str], classes: list[str], colors: dict[str, str]
) -> None:
    factor = table.columns[index].shown[0]
    for rank, label in enumerate(classes):
        rows = [i for i, row in enumerate(table.rows) if (row.label or "no class") == label]
        spot = [channels.index(table.rows[i].channel) + 0.7 * ((rank + 0.5) / len(classes) - 0.5) for i in rows]
        panel.plot(spot, factor * table.values[rows, index], ".", color=colors[label], markersize=5, label=words(label))
    panel.grid(axis="x", visible=False)
    for edge in range(1, len(channels)):
        panel.axvline(edge - 0.5, color=LIGHT, linewidth=0.8)


def _name(column: Indicator) -> str:
    name = column.name.replace("order_amplitude", "amplitude at order")
    unit = unit_words(column.shown[1])
    return f"{indicator_words(name)}{f' [{unit}]' if unit != '1' else ''}"


def _table(table: IndicatorTable, shown: list[int]) -> Table:
    rows = tuple(
        (
            Cell(row.recording_id),
            Cell(words(row.channel)),
            Cell(words(row.label or "—")),
            *(Cell(number(float(values[i]) * table.columns[i].shown[0])) for i in shown),
        )
        for row, values in list(zip(table.rows, table.values, strict=True))[:_MOST_ROWS]
    )
    rest = len(table.rows) - len(rows)
    more = f" {rest} more rows are in the data of the figure." if rest > 0 else ""
    header = ("recording", "channel", "class", *(_name(table.columns[i]) for i in shown))
    return Table(f"The main indicators.{more}", header, rows)
