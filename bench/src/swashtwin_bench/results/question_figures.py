"""Figures of single questions: estimated against true severities, and which parameters move with which fault."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from swashtwin.plot import CALIBRATED, LIGHT, MEASURED, figure_style, panels, ratio_axis, words
from swashtwin.report import Drawing, render_drawing, tabulate
from swashtwin_bench.results.table import StudyTable


@figure_style()
def severity_drawing(study: StudyTable, key: str) -> Drawing:
    """Estimated against true dimensions with their intervals, a panel for each."""
    cases = [case for case in study.details["cases"] if case["truth"] > 0]
    kinds = list(dict.fromkeys((case["kind"], case["dimension"]) for case in cases))
    per_line = min(2, len(kinds))
    lines = math.ceil(len(kinds) / per_line)
    figure, axes = panels(lines, per_line, 0.3 + 3.0 * lines)
    for ax, (kind, dimension) in zip(axes.flat, kinds, strict=False):
        matching = [case for case in cases if (case["kind"], case["dimension"]) == (kind, dimension)]
        _severity_panel(ax, matching)
        unit = f" [{matching[0]['unit']}]" if matching[0]["unit"] else ""
        ax.set_title(f"{words(kind)}: {words(dimension)}")
        ratio_axis(ax, "x", f"truth{unit}")
        ratio_axis(ax, "y", f"estimate{unit}")
    for ax in axes.flat[len(kinds) :]:
        ax.set_visible(False)
    return render_drawing(
        f"{key}_found",
        figure,
        tabulate(cases),
        title="Estimated against true severity",
        caption="Each point is one recording, bars are 90 % intervals, gray the truth. Open points may be zero; bars "
        "that begin below the panel hold zero. Both axes logarithmic; in SI in the data.",
    )


def _severity_panel(ax: Axes, cases: Sequence[dict[str, Any]]) -> None:
    truth, estimated, low, high = (
        np.array([case[name] / case["per_unit"] for case in cases]) for name in ("truth", "estimate", "low", "high")
    )
    least, most = 0.15 * truth.min(), 6 * truth.max()
    ax.plot([least, most], [least, most], color=LIGHT, linewidth=2, zorder=1)
    shown = np.clip(estimated, 1.1 * least, most)
    bars = [shown - np.clip(low, least, shown), np.clip(high, shown, most) - shown]
    ax.errorbar(truth, shown, yerr=bars, fmt="none", ecolor=MEASURED, elinewidth=0.8, alpha=0.5, zorder=2)
    sure = np.array([case["detected"] for case in cases])
    for part, fill in ((sure, CALIBRATED), (~sure, "white")):
        ax.plot(truth[part], shown[part], "o", color=fill, markeredgecolor=CALIBRATED, markersize=4, zorder=3)
    ax.set(xscale="log", yscale="log", xlim=(0.7 * truth.min(), 1.4 * truth.max()), ylim=(least, most))


FULL_COLOR = 1.5
"""Move (a logarithm) at which the color is full."""


@figure_style()
def fault_map_drawing(study: StudyTable, key: str) -> Drawing:
    """Mean move of each parameter with each kind of fault, one panel for each model."""
    rows = [row for row in study.rows() if row["parameter"] != "all"]
    models = list(dict.fromkeys(row["model"] for row in rows))
    kinds = list(dict.fromkeys(row["fault"] for row in rows))
    figure, axes = panels(len(models), 1, 0.6 + (0.7 + 0.36 * len(kinds)) * len(models))
    for ax, model in zip(axes[:, 0], models, strict=True):
        _map_panel(ax, [row for row in rows if row["model"] == model])
        ax.set_title(f"{words(model)} model")
    table = [
        {
            **{name: row[name] for name in ("fault", "model", "parameter")},
            **{name: row[name]["mean"] for name in ("move", "width", "significant")},
        }
        for row in rows
    ]
    return render_drawing(
        f"{key}_map",
        figure,
        tabulate(table),
        title="What moves with which fault",
        caption="Mean of ln(value / the pump's healthy value) ± half of its 90 % interval; framed where the interval "
        "excludes no move in at least half of the recordings. Red rises, blue falls.",
    )


def _map_panel(ax: Axes, rows: list[dict]) -> None:
    kinds, names = (list(dict.fromkeys(row[factor] for row in rows)) for factor in ("fault", "parameter"))
    moves = np.full((len(kinds), len(names)), np.nan)
    for row in rows:
        line, column = kinds.index(row["fault"]), names.index(row["parameter"])
        moves[line, column] = row["move"]["mean"]
        text = f"{row['move']['mean']:+.2f}\n±{row['width']['mean']:.2f}"
        ax.text(column, line, text, ha="center", va="center", fontsize=7)
        if row["significant"]["mean"] >= 0.5:
            corners = [column - 0.47, column + 0.47], [line - 0.45, line + 0.45]
            (left, right), (low, high) = corners
            ax.plot([left, right, right, left, left], [low, low, high, high, low], color="black", linewidth=1.2)
    ax.imshow(moves, cmap="coolwarm", vmin=-FULL_COLOR, vmax=FULL_COLOR, aspect="auto", alpha=0.75)
    ax.set_xticks(range(len(names)), names)
    ax.set_yticks(range(len(kinds)), [words(kind) for kind in kinds])
    ax.grid(visible=False)
