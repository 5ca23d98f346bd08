"""Confusion matrices."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Int
from matplotlib.axes import Axes

from swashtwin.report.drawing import Drawing, panels, render_drawing, tabulate
from swashtwin.report.style import figure_style
from swashtwin.report.wording import words


@figure_style()
def confusion_drawing(
    name: str, matrices: Mapping[tuple[str, str], np.ndarray], classes: Sequence[str], *, caption: str
) -> Drawing:
    """Grid of confusion matrices.

    Parameters
    ----------
    matrices : windows by actual (row) and predicted class (column), by (row of the grid, column of the grid). A column
        beyond the classes counts the windows without a verdict.
    """
    down, across = list(dict.fromkeys(key[0] for key in matrices)), list(dict.fromkeys(key[1] for key in matrices))
    figure, axes = panels(len(down), len(across), 1.1 + 2.9 * len(down), sharex=True, sharey=True)
    for (row, column), confusion in matrices.items():
        panel = axes[down.index(row), across.index(column)]
        _draw_matrix(panel, np.asarray(confusion))
        panel.set_title(", ".join(part for part in (row, column) if part))
    n_columns = max(np.shape(confusion)[1] for confusion in matrices.values())
    predictions = [*classes, *["no verdict"] * (n_columns - len(classes))]
    columns = [words(label) for label in predictions]
    ticks, names = range(len(classes)), [words(label) for label in classes]
    axes[0, 0].set(xticks=range(n_columns), yticks=ticks, yticklabels=names)
    for panel in axes[:, 0]:
        panel.set_ylabel("actual class")
    for panel in axes[-1]:
        panel.set_xlabel("predicted class")
        panel.set_xticks(range(len(columns)), columns, rotation=45, ha="right", rotation_mode="anchor")
    rows = [
        {"row": row, "column": column, "actual": actual, "predicted": predicted, "windows": confusion[i][j]}
        for (row, column), confusion in matrices.items()
        for i, actual in enumerate(classes)
        for j, predicted in enumerate(predictions[: np.shape(confusion)[1]])
    ]
    title = "Confusion matrix" if len(matrices) == 1 else "Confusion matrices"
    return render_drawing(name, figure, tabulate(rows), title=title, caption=caption)


def _draw_matrix(panel: Axes, confusion: Int[np.ndarray, "actual predicted"]) -> None:
    """Shares of each row as shades, and percent written into them."""
    count = confusion.sum(axis=1, keepdims=True)
    share = confusion / np.maximum(count, 1)
    edges = np.arange(len(confusion) + 1) - 0.5
    panel.pcolormesh(np.arange(confusion.shape[1] + 1) - 0.5, edges, share, cmap="Blues", vmin=0, vmax=1.1)
    panel.set(aspect="equal", ylim=(edges[-1], edges[0]))
    panel.grid(False)
    for i, row in enumerate(confusion):
        for j, windows in enumerate(row):
            if windows:
                color = "white" if share[i, j] > 0.6 else "black"
                text = f"{100 * share[i, j]:.0f}" if share[i, j] >= 0.01 else "<1"
                panel.text(j, i, text, ha="center", va="center", color=color, fontsize=9)
        if not count[i, 0]:
            panel.text(len(row) / 2 - 0.5, i, "no test window", ha="center", va="center", fontsize=8)
