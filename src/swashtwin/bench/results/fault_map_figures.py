"""Figure of the study of moved parameters: a map of kinds of fault and parameters."""

import numpy as np
from matplotlib.axes import Axes

from swashtwin.bench.results.table import StudyTable
from swashtwin.report import Drawing, figure_style, panels, render_drawing, tabulate, words

FULL = 1.5
"""Move (a logarithm) at which the color is full."""


@figure_style()
def fault_map_drawing(study: StudyTable, key: str) -> Drawing:
    """Mean move of each parameter with each kind of fault, one panel for each model."""
    rows = [row for row in study.rows() if row["parameter"] != "all"]
    models = list(dict.fromkeys(row["model"] for row in rows))
    kinds = list(dict.fromkeys(row["fault"] for row in rows))
    figure, axes = panels(len(models), 1, 0.6 + (0.7 + 0.36 * len(kinds)) * len(models))
    for ax, model in zip(axes[:, 0], models, strict=True):
        _panel(ax, [row for row in rows if row["model"] == model])
        ax.set_title(f"{words(model)} model")
    matching = [
        {
            **{name: row[name] for name in ("fault", "model", "parameter")},
            **{name: row[name]["mean"] for name in ("move", "width", "significant")},
        }
        for row in rows
    ]
    return render_drawing(
        f"{key}_map",
        figure,
        tabulate(matching),
        title="What moves with which fault",
        caption="Mean of ln(value / the pump's healthy value) ± half of its 90 % interval; framed where the interval "
        "excludes no move in at least half of the recordings. Red rises, blue falls.",
    )


def _panel(ax: Axes, rows: list[dict]) -> None:
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
    ax.imshow(moves, cmap="coolwarm", vmin=-FULL, vmax=FULL, aspect="auto", alpha=0.75)
    ax.set_xticks(range(len(names)), names)
    ax.set_yticks(range(len(kinds)), [words(kind) for kind in kinds])
    ax.grid(visible=False)
