"""Figures of indicators with their data: a spectrum with its expected lines, and a trend against its baseline."""

import math

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from swashtwin.foundation import plural
from swashtwin.plot import LIGHT, MEASURED, figure_style, marked_spectrum, panels, unit_words, words
from swashtwin.report.drawing import Drawing, render_drawing, tabulate
from swashtwin.report.wording import indicator_words, sentence
from swashtwin.signals import LineSpectrum, Trend

_ABOVE, _BELOW = "#d55e00", "#aa4499"


@figure_style()
def spectrum_drawing(spectrum: LineSpectrum) -> Drawing:
    """A spectrum of each channel with the expected lines of the shaft and the pistons."""
    figure, marks = marked_spectrum(spectrum, None)
    rows = zip(spectrum.channels, spectrum.amplitude, strict=True)
    columns = {f"{spectrum.axis} [{spectrum.axis_unit or '1'}]": spectrum.position}
    columns |= {f"{name} [{spectrum.unit or '1'}]": row for name, row in rows}
    caption = "One-sided peak amplitudes, Hann taper corrected."
    if spectrum.angle_from:
        caption += f" Along the shaft's angle, from {spectrum.angle_from}."
    if marks:
        caption += " Dashed: where lines of the shaft and of the pistons are expected."
    caption += " The CSV file holds every line."
    title = f"{spectrum.kind.capitalize()} spectrum of {spectrum.recording_id}"
    return render_drawing(f"{spectrum.kind}_spectrum", figure, columns, title=title, caption=caption)


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
    every = math.ceil(len(trend.points) / 40)  # names under the axis, as many as fit, shortened in the middle
    names = [point.row.recording_id for point in trend.points]
    names = [name if len(name) <= 26 else f"{name[:13]}…{name[-12:]}" for name in names]
    panel.set_xticks(range(0, len(names), every), names[::every], rotation=90, fontsize=7.5)
    panel.set_xlim(-0.8, len(names) - 0.2)
    panel.grid(axis="x", visible=False)
    panel.set_ylabel(f"{indicator_words(trend.indicator.name)} [{unit_words(unit)}]")
    _trend_legend(panel, trend)
    rows = [
        {
            "recording": point.row.recording_id, "class": point.row.label, "specimen": point.row.specimen,
            "date": point.row.date, "speed [rpm]": _empty(point.row.point[0]),
            "pressure [MPa]": _empty(point.row.point[1]),
            f"{trend.indicator.name} [{trend.indicator.unit or '1'}]": _empty(point.value), "healthy": point.healthy,
            "baseline median": _empty(point.median), "baseline spread": _empty(point.spread),
            "baseline recordings": point.count, "status": point.status,
        }
        for point in trend.points
    ]  # fmt: skip
    least = min((point.count for point in trend.points if point.status != "no baseline"), default=0)
    baseline = (
        f"Gray: median and {trend.k:g} spreads (1.4826 MAD) of the same machine's other healthy recordings at the same "
        f"speed and pressure, from {plural(least, 'recording')} on. "
    )
    caption = (
        f"{sentence(trend.indicator.meaning)}. {baseline if least else ''}"
        "No limit of a standard is drawn: none is made for axial piston pumps."
    )
    title = f"{indicator_words(trend.indicator.name)} of {words(trend.channel)}"
    return render_drawing("trend", figure, tabulate(rows), title=title, caption=caption)


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
