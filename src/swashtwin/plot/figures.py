"""Confusion matrices, and spectra with their expected lines."""

import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import get_args

import numpy as np
from jaxtyping import Num
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from swashtwin.foundation import InputError
from swashtwin.plot.labels import format_label
from swashtwin.plot.style import (
    CALIBRATED,
    MEASURED,
    ON_DARK,
    ON_SHADE,
    WIDTH,
    create_panels,
    figure_style,
    label_log_axis,
    spread_labels,
)
from swashtwin.pump import SPEED_TOLERANCE
from swashtwin.recordings import Recording, specified_speed, summarize_recordings
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

    positions = _arrange_matrices(list(matrices))
    n_lines = 1 + max(line for line, _ in positions.values())
    n_panel_columns = 1 + max(column for _, column in positions.values())
    titles = _wrap_titles(list(matrices), n_panel_columns)
    title_lines = max(title.count("\n") for title in titles.values())
    height = (
        1.1 + (2.5 if n_panel_columns > 2 else 2.9) * n_lines + _TITLE_LINE * title_lines * n_lines
    )
    figure, axes = create_panels(n_lines, n_panel_columns, height, sharex=True, sharey=True)
    for key, matrix in matrices.items():
        panel = axes[positions[key]]
        _draw_matrix(panel, np.asarray(matrix))
        panel.set_title(titles[key])

    actual = [format_label(label) for label in classes]
    n_columns = max(np.shape(matrix)[1] for matrix in matrices.values())
    predicted = [*actual, *["no verdict"] * (n_columns - len(classes))]
    axes[0, 0].set(yticks=range(len(classes)), yticklabels=actual)
    for panel in axes[:, 0]:
        panel.set_ylabel("actual class")
    used = set(positions.values())
    for (line, column), panel in np.ndenumerate(axes):
        panel.set_xticks(
            range(n_columns), predicted, rotation=45, ha="right", rotation_mode="anchor"
        )
        if (line, column) not in used:
            panel.set_axis_off()
        # also above a panel that is empty in the last line
        elif (line + 1, column) not in used:
            panel.tick_params(labelbottom=True)
            panel.set_xlabel("predicted class")
    return figure


# Matrices side by side, height of a line of a title [inch], and characters of one that fit into an
# inch.
_MAX_MATRICES_PER_LINE = 4
_TITLE_LINE = 0.17
_CHARACTERS_PER_INCH = 12


def _arrange_matrices(keys: Sequence[tuple[str, str]]) -> dict[tuple[str, str], tuple[int, int]]:
    """Return (line, column of panels) of each matrix by its (row, column).

    A row of matrices begins a line, and a long row takes several.
    """
    columns = list(dict.fromkeys(column for _, column in keys))
    lines_per_row = math.ceil(len(columns) / _MAX_MATRICES_PER_LINE)
    per_line = math.ceil(len(columns) / lines_per_row)

    positions = {}
    rows = list(dict.fromkeys(row for row, _ in keys))
    for row, column in keys:
        line, panel_column = divmod(columns.index(column), per_line)
        positions[row, column] = (rows.index(row) * lines_per_row + line, panel_column)
    return positions


def _wrap_titles(
    keys: Sequence[tuple[str, str]], n_panel_columns: int
) -> dict[tuple[str, str], str]:
    """Return the title of each matrix in lines that fit above it."""
    width = int(_CHARACTERS_PER_INCH * (WIDTH - 1) / max(n_panel_columns, 2))
    return {key: textwrap.fill(", ".join(part for part in key if part), width) for key in keys}


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

SpectrumSource = Recording | LineSpectrum | np.ndarray
"""What `spectrum` draws."""

# End of an axis of orders without known pistons: the fifth multiple of eleven of them, and a little
# beyond.
_END_ORDER = 60.0

# Colors of the second and further spectra of one figure.
_OVERLAY_COLORS = ("#d55e00", "#56b4e9", "#aa4499", "#a89a1d", "#000000")

# Color and name of a mark, by whether it is of the pistons.
_MARK_STYLES = {False: ("#009e73", "shaft"), True: (CALIBRATED, "piston pass")}


@figure_style()
def spectrum(
    source: SpectrumSource | Sequence[SpectrumSource],
    kind: LineSpectrumKind | None = None,
    *,
    pistons: int | None = None,
    sample_rate: float | None = None,
) -> Figure:
    """Return a figure of the spectrum of each channel, with the lines that are expected of the
    shaft and of the pistons.

    Several sources are drawn over each other. The axis ends a little beyond the last line of the
    pistons. If their number is not known, an axis of orders ends at 60, others with the spectrum.

    Parameters
    ----------
    source : recording, array (channel, time) or (time,), or the result of
        `swashtwin.signals.spectrum_of`; or a list of these. Channels that all of them have are
        drawn.
    kind : of recordings: ``amplitude`` or ``envelope`` over frequency, ``order`` over multiples of
        the shaft's frequency; by default ``order`` if all of them specify a speed.
    pistons : of recordings: number of pistons, to mark their lines; by default the attribute
        ``pistons``.
    sample_rate : of arrays: samples per second [Hz].

    Raises
    ------
    InputError
        An array without a sample rate, orders without a speed, or sources without a common channel,
        unit or axis.

    Examples
    --------
    >>> wave = np.sin(np.arange(4000) / 10)
    >>> spectrum([wave, 2 * wave], sample_rate=1000.0).axes[0].get_xlabel()
    'frequency [Hz]'
    """
    spectra = _spectra_of(source, kind, pistons, sample_rate)
    first = spectra[0]
    channels = _shared_channels(spectra)

    # the first line, at 0, is the mean of the samples and no vibration
    start = first.position[1]
    end = max(_axis_end(lines) for lines in spectra)
    marks = [mark for mark in _shared_marks(spectra) if start <= mark.position <= end]

    figure, axes = create_panels(len(channels), 1, 1.0 + 1.9 * len(channels), sharex=True)
    colors = [MEASURED, *_OVERLAY_COLORS]
    for channel, panel in zip(channels, axes[:, 0], strict=True):
        greatest = np.array([])
        for number, lines in enumerate(spectra):
            is_shown = (lines.position >= start) & (lines.position <= end)
            amplitude = lines.amplitude[lines.channels.index(channel)][is_shown]
            x, y = _thin_out(lines.position[is_shown], amplitude)
            color = colors[number % len(colors)]
            panel.plot(x, y, color=color, linewidth=0.8, label=format_label(lines.recording_id))
            greatest = np.concatenate([greatest, y])
        _set_amplitude_axis(panel, first, greatest)
        panel.set_title(_channel_title(spectra, channel), loc="left")
        for mark in marks:
            color, _ = _MARK_STYLES[mark.of_pistons]
            panel.axvline(
                mark.position, color=color, linewidth=0.9, linestyle="--", alpha=0.7, zorder=0
            )

    axes[0, 0].set_xlim(0, end)
    # An order counts turns of the shaft, and has no unit.
    x_label = f"{first.axis} [{first.axis_unit}]" if first.axis_unit else f"shaft {first.axis}"
    axes[-1, 0].set_xlabel(x_label)
    if marks:
        _name_marks(figure, axes[0, 0], marks, gap=0.035 * end)
    if len(spectra) > 1:
        handles, names = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower left", ncols=3)
    return figure


def _spectra_of(
    source: SpectrumSource | Sequence[SpectrumSource],
    kind: LineSpectrumKind | None,
    pistons: int | None,
    sample_rate: float | None,
) -> list[LineSpectrum]:
    """Return the spectra of all sources, which must be over one axis and in one unit."""
    sources = source if isinstance(source, Sequence) else [source]
    if not sources:
        raise InputError("There is no recording to draw; give at least one.")

    named = [_as_recording(entry, number, sample_rate) for number, entry in enumerate(sources, 1)]
    recordings = [entry for entry in named if isinstance(entry, Recording)]
    if kind not in (None, *get_args(LineSpectrumKind)):
        raise InputError(
            f"Invalid kind {kind!r}: must be one of {', '.join(get_args(LineSpectrumKind))}."
        )
    if kind is None:
        speeds = [specified_speed(recording) for recording in recordings]
        kind = "amplitude" if np.isnan(speeds).any() else "order"
    if pistons is None and recordings:
        pistons = summarize_recordings(recordings).pistons

    spectra = [
        spectrum_of(entry, kind, pistons=pistons) if isinstance(entry, Recording) else entry
        for entry in named
    ]
    for lines in spectra[1:]:
        for name in ("kind", "unit"):
            if getattr(lines, name) != getattr(spectra[0], name):
                raise InputError(
                    f"{lines.recording_id} and {spectra[0].recording_id} differ in {name} "
                    f"({getattr(lines, name)}, {getattr(spectra[0], name)}); draw them apart."
                )
    return spectra


def _as_recording(
    source: SpectrumSource, number: int, sample_rate: float | None
) -> Recording | LineSpectrum:
    """Return an array as a recording; other sources as they came."""
    if isinstance(source, Recording | LineSpectrum):
        return source
    signal = np.atleast_2d(np.asarray(source))
    # an array (time, channel) has more rows than columns
    if signal.dtype.kind not in "fiu" or signal.ndim != 2 or signal.shape[0] >= signal.shape[1]:
        raise InputError(
            f"Source {number} is a {type(source).__name__} of the shape {signal.shape}; a spectrum "
            "is of a recording, a spectrum_of it, or an array (channel, time)."
        )
    if sample_rate is None:
        raise InputError("An array has no sample rate; give sample_rate in Hz.")

    channels = tuple(f"channel {row}" for row in range(len(signal)))
    return Recording(signal, sample_rate, f"array {number}", channels=channels, unit="1")


def _shared_channels(spectra: Sequence[LineSpectrum]) -> list[str]:
    channels = [
        name for name in spectra[0].channels if all(name in lines.channels for lines in spectra)
    ]
    if not channels:
        names = "; ".join(", ".join(lines.channels) for lines in spectra)
        raise InputError(
            f"The sources have no channel in common ({names}); rename them with "
            "recording.replace(channels=...)."
        )
    return channels


def _shared_marks(spectra: Sequence[LineSpectrum]) -> tuple[Mark, ...]:
    """Return the marks of the first spectrum if they are those of all; else none."""
    marks = spectra[0].marks
    for lines in spectra[1:]:
        if len(lines.marks) != len(marks):
            return ()
        for mark, other in zip(marks, lines.marks, strict=True):
            if not math.isclose(mark.position, other.position, rel_tol=SPEED_TOLERANCE):
                return ()
    return marks


def _channel_title(spectra: Sequence[LineSpectrum], channel: str) -> str:
    """Return the name of a channel, and the band of its envelope if there is one spectrum."""
    title = format_label(channel)
    if len(spectra) == 1 and spectra[0].bands:
        low, high = spectra[0].bands[spectra[0].channels.index(channel)]
        title += f", envelope of {low:.0f} to {high:.0f} Hz"
    return title


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
    if piston_lines:
        return min(1.1 * max(piston_lines), highest_position)
    return min(_END_ORDER, highest_position) if lines.kind == "order" else highest_position


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
