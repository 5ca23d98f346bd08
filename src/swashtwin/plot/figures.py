"""Confusion matrices, and spectra with their expected lines."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Num
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from swashtwin.foundation import InputError
from swashtwin.plot.style import (
    CALIBRATED,
    MEASURED,
    ON_DARK,
    ON_SHADE,
    create_panels,
    figure_style,
    format_label,
    label_log_axis,
    spread_labels,
)
from swashtwin.recordings import Recording
from swashtwin.signals import LineSpectrum, LineSpectrumKind, Mark, spectrum_of


@figure_style()
def confusion(
    counts: np.ndarray | Mapping[tuple[str, str], np.ndarray], classes: Sequence[str]
) -> Figure:
    """Return a figure of the share of each actual class (row) that was given each class (column),
    in percent; rows add up to 100.

    Parameters
    ----------
    counts : windows, or recordings, by actual (row) and predicted class (column), such as
        `Scores.confusion`; or several such arrays by (row of the grid, column of the grid). A
        column beyond the classes counts those without a verdict.
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
    matrices = counts
    if not isinstance(matrices, Mapping):
        matrices = {("", ""): np.asarray(counts)}
    for matrix in matrices.values():
        _check_matrix(matrix, classes)

    grid_rows = list(dict.fromkeys(row for row, _ in matrices))
    grid_columns = list(dict.fromkeys(column for _, column in matrices))
    height = 1.1 + 2.9 * len(grid_rows)
    figure, axes = create_panels(
        len(grid_rows), len(grid_columns), height, sharex=True, sharey=True
    )
    for (row, column), matrix in matrices.items():
        panel = axes[grid_rows.index(row), grid_columns.index(column)]
        _draw_matrix(panel, np.asarray(matrix))
        panel.set_title(", ".join(part for part in (row, column) if part))

    actual = [format_label(label) for label in classes]
    n_columns = max(np.shape(matrix)[1] for matrix in matrices.values())
    predicted = [*actual, *["no verdict"] * (n_columns - len(classes))]
    axes[0, 0].set(xticks=range(n_columns), yticks=range(len(classes)), yticklabels=actual)
    for panel in axes[:, 0]:
        panel.set_ylabel("actual class")
    for panel in axes[-1]:
        panel.set_xlabel("predicted class")
        panel.set_xticks(
            range(n_columns), predicted, rotation=45, ha="right", rotation_mode="anchor"
        )
    return figure


def _check_matrix(matrix: np.ndarray, classes: Sequence[str]) -> None:
    """Refuse a matrix that does not fit the classes."""
    shape = np.shape(matrix)
    if len(shape) != 2 or shape[0] != len(classes) or shape[1] < len(classes):
        raise InputError(
            f"A matrix of the shape {shape} does not fit {len(classes)} classes: its rows must be "
            "the actual classes, its columns the predicted ones."
        )


def _draw_matrix(panel: Axes, counts: Num[np.ndarray, "actual predicted"]) -> None:
    """Draw the shares of each row as shades, with the percentages."""
    total = counts.sum(axis=1, keepdims=True)
    share = counts / np.maximum(total, 1)
    row_edges = np.arange(len(counts) + 1) - 0.5
    column_edges = np.arange(counts.shape[1] + 1) - 0.5
    panel.pcolormesh(column_edges, row_edges, share, cmap="Blues", vmin=0, vmax=1.1)
    panel.set(aspect="equal", ylim=(row_edges[-1], row_edges[0]))
    panel.grid(False)

    for i, row in enumerate(counts):
        for j, count in enumerate(row):
            if count:
                color = ON_DARK if share[i, j] > 0.6 else ON_SHADE
                text = f"{100 * share[i, j]:.0f}" if share[i, j] >= 0.01 else "<1"
                panel.text(j, i, text, ha="center", va="center", color=color, fontsize=9)
        if not total[i, 0]:
            middle = len(row) / 2 - 0.5
            panel.text(middle, i, "none", ha="center", va="center", fontsize=8, color=ON_SHADE)


MAX_POINTS = 3000
"""Maximum number of points drawn of one spectrum; each is the greatest line of its group."""

# Color and name of a mark, by whether it is of the pistons.
_MARK_STYLES = {False: ("#009e73", "shaft"), True: (CALIBRATED, "piston pass")}


@figure_style()
def spectrum(
    source: Recording | LineSpectrum,
    kind: LineSpectrumKind = "amplitude",
    *,
    pistons: int | None = None,
) -> Figure:
    """Return a figure of the spectrum of each channel, with the lines that are expected of the
    shaft and of the pistons.

    The axis ends a little beyond the last line of the pistons, or with the spectrum if their number
    is not known.

    Parameters
    ----------
    source : recording, or the result of `swashtwin.signals.spectrum_of`.
    kind : of a recording: ``amplitude`` or ``envelope`` over frequency, ``order`` over multiples of
        the shaft's frequency.
    pistons : of a recording: number of pistons, to mark their lines.

    Raises
    ------
    InputError
        Orders of a recording that specifies no speed.

    Examples
    --------
    >>> wave = np.sin(np.arange(4000) / 10)[None]
    >>> spectrum(Recording(wave, 1000.0, "a")).axes[0].get_xlabel()
    'frequency [Hz]'
    """
    if isinstance(source, Recording):
        lines = spectrum_of(source, kind, pistons=pistons)
    else:
        lines = source

    # the first line, at 0, is the mean of the samples and no vibration
    start = lines.position[1]
    end = _axis_end(lines)
    is_shown = (lines.position >= start) & (lines.position <= end)
    marks = [mark for mark in lines.marks if start <= mark.position <= end]

    count = len(lines.channels)
    figure, axes = create_panels(count, 1, 1.0 + 1.9 * count, sharex=True)
    for row, panel in enumerate(axes[:, 0]):
        x, y = _thin_out(lines.position[is_shown], lines.amplitude[row][is_shown])
        panel.plot(x, y, color=MEASURED, linewidth=0.8)
        _set_amplitude_axis(panel, lines, y)
        title = format_label(lines.channels[row])
        if lines.bands:
            low, high = lines.bands[row]
            title += f", envelope of {low:.0f} to {high:.0f} Hz"
        panel.set_title(title, loc="left")
        for mark in marks:
            color, _ = _MARK_STYLES[mark.of_pistons]
            panel.axvline(
                mark.position, color=color, linewidth=0.9, linestyle="--", alpha=0.7, zorder=0
            )

    axes[0, 0].set_xlim(0, end)
    axes[-1, 0].set_xlabel(f"{lines.axis} [{lines.axis_unit or '1'}]")
    if marks:
        _name_marks(figure, axes[0, 0], marks, gap=0.035 * end)
    return figure


def _name_marks(figure: Figure, top: Axes, marks: Sequence[Mark], gap: float) -> None:
    """Write the names of the marks above the top panel, at least `gap` apart, and their legend."""
    positions = spread_labels([mark.position for mark in marks], gap)
    for mark, position in zip(marks, positions, strict=True):
        color, _ = _MARK_STYLES[mark.of_pistons]
        top.annotate(
            mark.name,
            (position, 1.0),
            (0, 2),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=8,
            color=color,
            annotation_clip=False,
        )
    # the title needs room above it for the names
    top.set_title(top.get_title(loc="left"), loc="left", pad=16)
    styles = [_MARK_STYLES[kind] for kind in sorted({mark.of_pistons for mark in marks})]
    handles = [Line2D([], [], color=color, linestyle="--", linewidth=0.9) for color, _ in styles]
    figure.legend(handles, [name for _, name in styles], loc="outside upper right", ncols=2)


def _axis_end(lines: LineSpectrum) -> float:
    """Return the end of the axis: a little beyond the last line of the pistons if it is known."""
    highest_position = float(lines.position[-1])
    piston_lines = [mark.position for mark in lines.marks if mark.of_pistons]
    return min(1.1 * max(piston_lines, default=highest_position), highest_position)


def format_unit(unit: str) -> str:
    """Return a unit as figures show it."""
    return unit.replace("^2", "²") or "1"


def _thin_out(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the greatest of each group of neighbors, so that no line is lost."""
    group_size = math.ceil(len(x) / MAX_POINTS)
    if group_size == 1:
        return x, y
    n_groups = len(x) // group_size
    groups = y[: n_groups * group_size].reshape(n_groups, group_size)
    greatest = groups.argmax(axis=1) + group_size * np.arange(n_groups)
    return x[greatest], y[greatest]


def _set_amplitude_axis(panel: Axes, lines: LineSpectrum, amplitudes: np.ndarray) -> None:
    """Scale and label the axis of amplitudes: logarithmic, but for envelopes."""
    panel.set_ylabel(f"peak amplitude\n[{format_unit(lines.unit)}]")
    if lines.kind == "envelope":
        panel.set_ylim(bottom=0)
        return

    panel.set_yscale("log")
    positive = amplitudes[amplitudes > 0]
    if positive.size:
        greatest = float(positive.max())
        bottom = max(float(np.median(positive)) / 5, greatest * 1e-5)
        panel.set_ylim(bottom, greatest * 2)
        label_log_axis(panel.yaxis)
