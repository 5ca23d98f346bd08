"""Confusion matrices."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Num
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from swashtwin.foundation import InputError
from swashtwin.plot.style import ON_DARK, ON_SHADE, figure_style, panels, words


@figure_style()
def confusion(counts: np.ndarray | Mapping[tuple[str, str], np.ndarray], classes: Sequence[str]) -> Figure:
    """Share of each actual class (row) that was given each class (column), in percent; rows add up to 100.

    Parameters
    ----------
    counts : windows, or recordings, by actual (row) and predicted class (column), such as `Scores.confusion`; or
        several such arrays by (row of the grid, column of the grid). A column beyond the classes counts those without
        a verdict.
    classes : name of each class, in the order of the rows.

    Raises
    ------
    InputError
        An array has other rows than there are classes, or fewer columns.

    Examples
    --------
    >>> figure = confusion(np.array([[9, 1], [0, 10]]), ("normal", "piston"))
    >>> [text.get_text() for text in figure.axes[0].texts]
    ['90', '10', '100']
    """
    matrices = counts if isinstance(counts, Mapping) else {("", ""): np.asarray(counts)}
    for matrix in matrices.values():
        if np.ndim(matrix) != 2 or len(matrix) != len(classes) or np.shape(matrix)[1] < len(classes):
            raise InputError(
                f"a matrix of the shape {np.shape(matrix)} does not fit {len(classes)} classes; its rows are the "
                "actual classes, its columns the predicted ones."
            )
    down, across = list(dict.fromkeys(key[0] for key in matrices)), list(dict.fromkeys(key[1] for key in matrices))
    figure, axes = panels(len(down), len(across), 1.1 + 2.9 * len(down), sharex=True, sharey=True)
    for (row, column), matrix in matrices.items():
        panel = axes[down.index(row), across.index(column)]
        _draw_matrix(panel, np.asarray(matrix))
        panel.set_title(", ".join(part for part in (row, column) if part))
    n_columns = max(np.shape(matrix)[1] for matrix in matrices.values())
    names = [words(label) for label in classes]
    columns = [*names, *["no verdict"] * (n_columns - len(classes))]
    axes[0, 0].set(xticks=range(n_columns), yticks=range(len(classes)), yticklabels=names)
    for panel in axes[:, 0]:
        panel.set_ylabel("actual class")
    for panel in axes[-1]:
        panel.set_xlabel("predicted class")
        panel.set_xticks(range(len(columns)), columns, rotation=45, ha="right", rotation_mode="anchor")
    return figure


def _draw_matrix(panel: Axes, counts: Num[np.ndarray, "actual predicted"]) -> None:
    """Shares of each row as shades, and percent written into them."""
    total = counts.sum(axis=1, keepdims=True)
    share = counts / np.maximum(total, 1)
    edges = np.arange(len(counts) + 1) - 0.5
    panel.pcolormesh(np.arange(counts.shape[1] + 1) - 0.5, edges, share, cmap="Blues", vmin=0, vmax=1.1)
    panel.set(aspect="equal", ylim=(edges[-1], edges[0]))
    panel.grid(False)
    for i, row in enumerate(counts):
        for j, count in enumerate(row):
            if count:
                color = ON_DARK if share[i, j] > 0.6 else ON_SHADE
                text = f"{100 * share[i, j]:.0f}" if share[i, j] >= 0.01 else "<1"
                panel.text(j, i, text, ha="center", va="center", color=color, fontsize=9)
        if not total[i, 0]:
            panel.text(len(row) / 2 - 0.5, i, "none", ha="center", va="center", fontsize=8, color=ON_SHADE)
