"""Figures of indicators: a spectrum with its expected lines, and a trend against its baseline."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from swashtwin.foundation import InputError, plural
from swashtwin.report.drawing import Drawing, name_decades, panels, render_drawing, spread_labels, tabulate
from swashtwin.report.style import CALIBRATED, LIGHT, MEASURED, figure_style
from swashtwin.report.wording import words
from swashtwin.signals import LineSpectrum, Mark, Trend, TrendPoint

MOST_POINTS = 3000
"""Most points drawn of one spectrum; each is the greatest line of its group."""

_PISTONS, _SHAFT, _ABOVE, _BELOW = CALIBRATED, "#009e73", "#d55e00", "#aa4499"
_MARK_KINDS = ((False, _SHAFT, "shaft"), (True, _PISTONS, "piston pass"))
_TITLES = {
    "amplitude": "Amplitude spectrum",
    "envelope": "Envelope spectrum",
    "order": "Order spectrum",
    "cepstrum": "Real cepstrum",
}


@figure_style()
def spectrum_drawing(spectrum: LineSpectrum, *, top: float | None = None) -> Drawing:
    """A spectrum of each channel with the expected lines of the shaft and the pistons.

    Parameters
    ----------
    top : end of the axis, in its unit; by default a little beyond the last marked line, or the whole axis.

    Raises
    ------
    InputError
        A `top` that leaves nothing to draw.
    """
    end = _end(spectrum, top)
    start = spectrum.position[1] if spectrum.kind != "cepstrum" else end / 50
    is_shown = (spectrum.position >= start) & (spectrum.position <= end)
    if top is not None and not (end > 0 and is_shown.any()):
        raise InputError(
            f"top ({top:g}{' ' * bool(spectrum.axis_unit)}{spectrum.axis_unit}) leaves nothing to draw; "
            f"the {spectrum.axis} has lines from {spectrum.position[1]:.4g} to {spectrum.position[-1]:.4g}."
        )
    count = len(spectrum.channels)
    figure, axes = panels(count, 1, 1.0 + 1.9 * count, sharex=True)
    scale = 1000.0 if spectrum.axis_unit == "s" else 1.0
    marks = [mark for mark in spectrum.marks if start <= mark.at <= end]
    for panel, name, row, number in zip(axes[:, 0], spectrum.channels, spectrum.amplitude, range(count), strict=True):
        x, y = _thin_out(spectrum.position[is_shown] * scale, row[is_shown])
        panel.plot(x, y, color=MEASURED, linewidth=0.8)
        _level_axis(panel, spectrum, y)
        title = words(name)
        if spectrum.bands:
            low, high = spectrum.bands[number]
            title += f", envelope of {low:.0f} to {high:.0f} Hz"
        panel.set_title(title, loc="left")
        for mark in marks:
            color = _PISTONS if mark.of_pistons else _SHAFT
            panel.axvline(mark.at * scale, color=color, linewidth=0.9, linestyle="--", alpha=0.7, zorder=0)
    axes[0, 0].set_xlim(0, end * scale)
    _name_marks(axes[0, 0], marks, scale, end * scale)
    unit = "ms" if spectrum.axis_unit == "s" else spectrum.axis_unit or "turns of the shaft"
    label = "order" if spectrum.kind == "order" else spectrum.axis
    axes[-1, 0].set_xlabel(f"{label} [{'1' if spectrum.kind == 'order' else unit}]")
    _mark_legend(axes[0, 0], marks)
    columns: dict[str, Sequence[float] | np.ndarray] = {
        f"{spectrum.axis} [{spectrum.axis_unit or '1'}]": spectrum.position,
        **{
            f"{name} [{spectrum.unit or '1'}]": row
            for name, row in zip(spectrum.channels, spectrum.amplitude, strict=True)
        },
    }
    title = f"{_TITLES[spectrum.kind]} of {spectrum.recording_id}"
    return render_drawing(
        f"{spectrum.kind}_spectrum", figure, columns, title=title, caption=_spectrum_caption(spectrum, marks)
    )


def _end(spectrum: LineSpectrum, top: float | None) -> float:
    last = float(spectrum.position[-1])
    if top is not None:
        return min(top, last)
    if not spectrum.marks:
        return last
    return min(last, max(mark.at for mark in spectrum.marks) * (1.1 if spectrum.kind != "cepstrum" else 2.5))


def _unit(unit: str) -> str:
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
    if spectrum.kind == "cepstrum":
        panel.set_ylabel("cepstrum [1]")
        return
    panel.set_ylabel(f"peak amplitude\n[{_unit(spectrum.unit)}]")
    if spectrum.kind == "envelope":
        panel.set_ylim(bottom=0)
        return
    positive = amplitudes[amplitudes > 0]
    panel.set_yscale("log")
    if positive.size:
        panel.set_ylim(max(float(np.median(positive)) / 5, float(positive.max()) * 1e-5), float(positive.max()) * 2)
        name_decades(panel)


def _name_marks(panel: Axes, marks: Sequence[Mark], scale: float, width: float) -> None:
    spots = spread_labels([mark.at * scale for mark in marks], gap=0.035 * width)
    for mark, spot in zip(marks, spots, strict=True):
        color = _PISTONS if mark.of_pistons else _SHAFT
        panel.annotate(
            mark.name, (spot, 1.0), (0, 2), xycoords=("data", "axes fraction"), textcoords="offset points",
            ha="center", va="bottom", fontsize=8, color=color, annotation_clip=False,
        )  # fmt: skip
    if marks:
        panel.set_title(panel.get_title(loc="left"), loc="left", pad=16)


def _mark_legend(panel: Axes, marks: Sequence[Mark]) -> None:
    kinds = {mark.of_pistons for mark in marks}
    names = [(color, name) for pistons, color, name in _MARK_KINDS if pistons in kinds]
    if names:
        lines = [Line2D([], [], color=color, linestyle="--", linewidth=0.9) for color, _ in names]
        panel.figure.legend(lines, [name for _, name in names], loc="outside upper right", ncols=2)


def _spectrum_caption(spectrum: LineSpectrum, marks: Sequence[Mark]) -> str:
    if spectrum.kind == "cepstrum":
        caption = "Inverse transform of the log magnitude: a family of equally spaced lines is one peak at its period."
    else:
        caption = "One-sided peak amplitudes, Hann taper corrected."
    if spectrum.angle_from:
        caption += f" Along the shaft's angle, from {spectrum.angle_from}."
    if marks:
        caption += " Dashed: where lines of the shaft and of the pistons are expected."
    return f"{caption} The CSV file holds every line."


_STATUS = {
    "within": ("o", MEASURED, "within its baseline"),
    "above": ("^", _ABOVE, "above"),
    "below": ("v", _BELOW, "below"),
    "no baseline": ("x", "#888888", "no baseline"),
}


@figure_style()
def trend_drawing(trend: Trend) -> Drawing:
    """An indicator over recordings, each with the range of its baseline."""
    factor, unit = trend.indicator.shown
    figure, axes = panels(1, 1, 4.6)
    panel = axes[0, 0]
    for x, point in enumerate(trend.points):
        if math.isfinite(point.median):
            middle, reach = factor * point.median, factor * trend.k * point.spread
            panel.bar(x, 2 * reach, bottom=middle - reach, width=0.8, color=LIGHT, linewidth=0, zorder=1)
            panel.plot([x - 0.4, x + 0.4], [middle, middle], color="#888888", linewidth=1, zorder=2)
        marker, color, _ = _STATUS[point.status]
        face = "white" if point.healthy and marker != "x" else color
        panel.plot(x, factor * point.value, marker, color=face, markeredgecolor=color, markersize=5, zorder=3)
    _name_recordings(panel, trend.points)
    panel.grid(axis="x", visible=False)
    panel.set_ylabel(f"{words(trend.indicator.name)} [{_unit(unit)}]")
    _trend_legend(panel, trend)
    rows = [
        {
            "recording": point.row.recording_id,
            "class": point.row.label,
            "specimen": point.row.specimen,
            "date": point.row.date,
            "speed [rpm]": _empty(point.row.point[0]),
            "pressure [MPa]": _empty(point.row.point[1]),
            f"{trend.indicator.name} [{trend.indicator.unit or '1'}]": _empty(point.value),
            "healthy": point.healthy,
            "baseline median": _empty(point.median),
            "baseline spread": _empty(point.spread),
            "baseline recordings": point.count,
            "status": point.status,
        }
        for point in trend.points
    ]
    least = min((point.count for point in trend.points if point.status != "no baseline"), default=0)
    caption = (
        f"{trend.indicator.meaning}. Gray: median and {trend.k:g} spreads (1.4826 MAD) of the same machine's other "
        "healthy recordings at the same speed and pressure"
        + (f", from {plural(least, 'recording')} on" if least else "")
        + ". No limit of a standard is drawn: none is made for axial piston pumps."
    )
    title = f"{words(trend.indicator.name)} of {words(trend.channel)}"
    return render_drawing("trend", figure, tabulate(rows), title=title, caption=caption)


def _name_recordings(panel: Axes, points: Sequence[TrendPoint]) -> None:
    """Names under the axis, as many as fit, long ones shortened in the middle."""
    every = math.ceil(len(points) / 40)
    names = [_short(point.row.recording_id) for point in points]
    panel.set_xticks(range(0, len(points), every), names[::every], rotation=90, fontsize=7.5)
    panel.set_xlim(-0.8, len(points) - 0.2)


def _short(name: str, most: int = 26) -> str:
    return name if len(name) <= most else f"{name[: most // 2]}…{name[-(most // 2 - 1) :]}"


def _trend_legend(panel: Axes, trend: Trend) -> None:
    entries: list[tuple[Line2D | Patch, str]] = []
    if any(math.isfinite(point.median) for point in trend.points):
        entries.append((Patch(color=LIGHT), f"baseline ± {trend.k:g} spreads"))
    for status, (marker, color, name) in _STATUS.items():
        if any(point.status == status for point in trend.points):
            entries.append((Line2D([], [], marker=marker, linestyle="", color=color), name))
    if any(point.healthy and point.status != "no baseline" for point in trend.points):
        mark = Line2D([], [], marker="o", linestyle="", color="white", markeredgecolor=MEASURED)
        entries.append((mark, "hollow: stated healthy"))
    handles, names = zip(*entries, strict=True)
    panel.figure.legend(handles, names, loc="outside upper center", ncols=len(names))


def _empty(value: float) -> float | None:
    return value if math.isfinite(value) else None
