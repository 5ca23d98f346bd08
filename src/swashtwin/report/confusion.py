"""Confusion matrices with their data."""

from collections.abc import Mapping, Sequence

import numpy as np

from swashtwin.plot import confusion, figure_style, words
from swashtwin.report.drawing import Drawing, render_drawing, tabulate


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
    n_columns = max(np.shape(matrix)[1] for matrix in matrices.values())
    predictions = [*classes, *["no verdict"] * (n_columns - len(classes))]
    rows = [
        {"row": row, "column": column, "actual": actual, "predicted": predicted, "windows": matrix[i][j]}
        for (row, column), matrix in matrices.items()
        for i, actual in enumerate(classes)
        for j, predicted in enumerate(predictions[: np.shape(matrix)[1]])
    ]
    title = "Confusion matrix" if len(matrices) == 1 else "Confusion matrices"
    figure = confusion(matrices, classes)
    description = ". ".join(filter(None, (_in_words(key, matrix, classes) for key, matrix in matrices.items())))
    return render_drawing(name, figure, tabulate(rows), title=title, caption=caption, description=description)


def _in_words(key: tuple[str, str], counts: np.ndarray, classes: Sequence[str]) -> str:
    """Share of each class that was told right, as a screen reader says it."""
    total = np.asarray(counts).sum(axis=1)
    shares = [
        f"{words(label)} {100 * counts[index][index] / total[index]:.0f} %"
        for index, label in enumerate(classes)
        if total[index]
    ]
    where = ", ".join(part for part in key if part)
    return f"Classified correctly{f' ({where})' if where else ''}: {', '.join(shares)}" if shares else ""
