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
from swashtwin.signals import LineSpectrum, LineSpectrumKind, spectrum_of


@figure_style()
def confusion(
    counts: np.ndarray | Mapping[tuple[str, str], np.ndarray], classes: Sequence[str]
) -> Figure:
    """Share of each actual class (row) that was given each class (column), in percent; rows add up
    to 100.

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
    matrices = counts if isinstance(counts, Mapping) else {("", ""): np.asarray(counts)}
    for matrix in matrices.values():
        if (
            np.ndim(matrix) != 2
            or len(matrix) != len(classes)
            or np.shape(matrix)[1] < len(classes)
        ):
            raise InputError(
                f"a matrix of the shape {np.shape(matrix)} does not fit {len(classes)} classes; its rows are the "
                "actual classes, its columns the predicted ones."
            )
    down, across = (
        list(dict.fromkeys(key[0] for key in matrices)),
        list(dict.fromkeys(key[1] for key in matrices)),
    )
    figure, axes = create_panels(
        len(down), len(across), 1.1 + 2.9 * len(down), sharex=True, sharey=True
    )
    for (row, column), matrix in matrices.items():
        panel = axes[down.index(row), across.index(column)]
        _draw_matrix(panel, np.asarray(matrix))
        panel.set_title(", ".join(part for part in (row, column) if part))
    n_columns = max(np.shape(matrix)[1] for matrix in matrices.values())
    names = [format_label(label) for label in classes]
    columns = [*names, *["no verdict"] * (n_columns - len(classes))]
    axes[0, 0].set(xticks=range(n_columns), yticks=range(len(classes)), yticklabels=names)
    for panel in axes[:, 0]:
        panel.set_ylabel("actual class")
    for panel in axes[-1]:
        panel.set_xlabel("predicted class")
        panel.set_xticks(
            range(len(columns)), columns, rotation=45, ha="right", rotation_mode="anchor"
        )
    return figure


def _draw_matrix(panel: Axes, counts: Num[np.ndarray, "actual predicted"]) -> None:
    """Shares of each row as shades, and percent written into them."""
    total = counts.sum(axis=1, keepdims=True)
    share = counts / np.maximum(total, 1)
    edges = np.arange(len(counts) + 1) - 0.5
    panel.pcolormesh(
        np.arange(counts.shape[1] + 1) - 0.5, edges, share, cmap="Blues", vmin=0, vmax=1.1
    )
    panel.set(aspect="equal", ylim=(edges[-1], edges[0]))
    panel.grid(False)
    for i, row in enumerate(counts):
        for j, count in enumerate(row):
            if count:
                color = ON_DARK if share[i, j] > 0.6 else ON_SHADE
                text = f"{100 * share[i, j]:.0f}" if share[i, j] >= 0.01 else "<1"
                panel.text(j, i, text, ha="center", va="center", color=color, fontsize=9)
        if not total[i, 0]:
            panel.text(
                len(row) / 2 - 0.5, i, "none", ha="center", va="center", fontsize=8, color=ON_SHADE
            )


MOST_POINTS = 3000
"""Most points drawn of one spectrum; each is the greatest line of its group."""

_PISTONS, _SHAFT = CALIBRATED, "#009e73"
_MARK_KINDS = {False: (_SHAFT, "shaft"), True: (_PISTONS, "piston pass")}
"""Color and name of a mark, by whether it is of the pistons."""


@figure_style()
def spectrum(
    source: Recording | LineSpectrum,
    kind: LineSpectrumKind = "amplitude",
    *,
    pistons: int | None = None,
) -> Figure:
    """A spectrum of each channel, with the lines that are expected of the shaft and of the pistons.

    The axis ends a little beyond the last line of the pistons; where their number is not known,
    with the spectrum.

    Parameters
    ----------
    source : recording, or what `swashtwin.signals.spectrum_of` gave.
    kind : of a recording: ``amplitude`` or ``envelope`` over frequency, ``order`` over multiples of
        the shaft's frequency.
    pistons : of a recording: number of pistons, to mark their lines.

    Raises
    ------
    InputError
        Orders of a recording that states no speed.

    Examples
    --------
    >>> wave = np.sin(np.arange(4000) / 10)[None]
    >>> spectrum(Recording(wave, 1000.0, "a")).axes[0].get_xlabel()
    'frequency [Hz]'
    """
    spectrum = (
        spectrum_of(source, kind, pistons=pistons) if isinstance(source, Recording) else source
    )
    start, last = spectrum.position[1], float(spectrum.position[-1])
    end = min(
        1.1 * max((mark.position for mark in spectrum.marks if mark.of_pistons), default=last), last
    )
    is_shown = (spectrum.position >= start) & (spectrum.position <= end)
    count = len(spectrum.channels)
    figure, axes = create_panels(count, 1, 1.0 + 1.9 * count, sharex=True)
    marks = [mark for mark in spectrum.marks if start <= mark.position <= end]
    for panel, name, row, number in zip(
        axes[:, 0], spectrum.channels, spectrum.amplitude, range(count), strict=True
    ):
        x, y = _thin_out(spectrum.position[is_shown], row[is_shown])
        panel.plot(x, y, color=MEASURED, linewidth=0.8)
        _level_axis(panel, spectrum, y)
        title = format_label(name)
        if spectrum.bands:
            low, high = spectrum.bands[number]
            title += f", envelope of {low:.0f} to {high:.0f} Hz"
        panel.set_title(title, loc="left")
        for mark in marks:
            color, _ = _MARK_KINDS[mark.of_pistons]
            panel.axvline(
                mark.position, color=color, linewidth=0.9, linestyle="--", alpha=0.7, zorder=0
            )
    axes[0, 0].set_xlim(0, end)
    spots = spread_labels([mark.position for mark in marks], gap=0.035 * end)
    for mark, spot in zip(marks, spots, strict=True):
        axes[0, 0].annotate(
            mark.name, (spot, 1.0), (0, 2), xycoords=("data", "axes fraction"), textcoords="offset points",
            ha="center", va="bottom", fontsize=8, color=_MARK_KINDS[mark.of_pistons][0], annotation_clip=False,
        )  # fmt: skip
    if marks:
        axes[0, 0].set_title(axes[0, 0].get_title(loc="left"), loc="left", pad=16)
    axes[-1, 0].set_xlabel(f"{spectrum.axis} [{spectrum.axis_unit or '1'}]")
    if looks := [
        _MARK_KINDS[of_pistons] for of_pistons in sorted({mark.of_pistons for mark in marks})
    ]:
        lines = [Line2D([], [], color=color, linestyle="--", linewidth=0.9) for color, _ in looks]
        figure.legend(lines, [name for _, name in looks], loc="outside upper right", ncols=2)
    return figure


def format_unit(unit: str) -> str:
    """Unit as figures show it."""
    return unit.replace("^2", "²") or "1"


def _thin_out(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Greatest of each group of neighbors, so that no line is lost."""
    size = math.ceil(len(x) / MOST_POINTS)
    if size == 1:
        return x, y
    whole = len(x) // size * size
    best = y[:whole].reshape(-1, size).argmax(axis=1) + size * np.arange(whole // size)
    return x[best], y[best]


def _level_axis(panel: Axes, spectrum: LineSpectrum, amplitudes: np.ndarray) -> None:
    panel.set_ylabel(f"peak amplitude\n[{format_unit(spectrum.unit)}]")
    if spectrum.kind == "envelope":
        panel.set_ylim(bottom=0)
        return
    positive = amplitudes[amplitudes > 0]
    panel.set_yscale("log")
    if positive.size:
        panel.set_ylim(
            max(float(np.median(positive)) / 5, float(positive.max()) * 1e-5),
            float(positive.max()) * 2,
        )
        label_log_axis(panel.yaxis)
