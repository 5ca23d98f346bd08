"""Figures of indicators with their data: a spectrum with its expected lines, and a trend against
its baseline.
"""

import math

import numpy as np

from swashtwin import plot
from swashtwin.foundation import plural
from swashtwin.plot import LIGHT, MEASURED, create_panels, figure_style, format_label, format_unit
from swashtwin.report.drawing import Drawing, render_drawing, tabulate
from swashtwin.report.wording import end_sentence
from swashtwin.signals import LineSpectrum, Trend

_ABOVE, _BELOW = "#d55e00", "#aa4499"


@figure_style()
def draw_spectrum(spectrum: LineSpectrum) -> Drawing:
    """A spectrum of each channel with the expected lines of the shaft and the pistons."""
    figure = plot.spectrum(spectrum)
    rows = zip(spectrum.channels, spectrum.amplitude, strict=True)
    columns = {f"{spectrum.axis} [{spectrum.axis_unit or '1'}]": spectrum.position}
    columns |= {f"{name} [{spectrum.unit or '1'}]": row for name, row in rows}
    caption = "One-sided peak amplitudes, Hann taper corrected."
    if spectrum.angle_from:
        caption += f" Along the shaft's angle, from {spectrum.angle_from}."
    if any(mark.position <= spectrum.position[-1] for mark in spectrum.marks):
        caption += " Dashed: where lines of the shaft and of the pistons are expected."
    caption += " The CSV file holds every line."
    title = f"{spectrum.kind.capitalize()} spectrum of {spectrum.recording_id}"
    return render_drawing(
        f"{spectrum.kind}_spectrum", figure, columns, title=title, caption=caption
    )


_STATUS = {
    "within": ("o", MEASURED, "within its baseline"),
    "above": ("^", _ABOVE, "above"),
    "below": ("v", _BELOW, "below"),
    "no baseline": ("X", "#888888", "no baseline"),
}


@figure_style()
def draw_trend(trend: Trend) -> Drawing:
    """An indicator over recordings, each with the range of its baseline."""
    (factor, unit), name = (
        trend.indicator.shown,
        format_label(trend.indicator.name).replace("rms", "RMS"),
    )
    figure, axes = create_panels(1, 1, 4.6)
    panel = axes[0, 0]
    value, median, reach = (
        factor * np.array([getattr(point, name) for point in trend.points])
        for name in ("value", "median", "spread")
    )
    x, reach = np.arange(value.size), trend.k * reach
    if (has := np.isfinite(median)).any():
        label = f"baseline ± {trend.k:g} spreads"
        panel.bar(
            x[has],
            2 * reach[has],
            bottom=(median - reach)[has],
            color=LIGHT,
            linewidth=0,
            label=label,
        )
        panel.hlines(median[has], x[has] - 0.4, x[has] + 0.4, color="#888888", linewidth=1)
    for status, (marker, color, meaning) in _STATUS.items():
        members = [n for n, point in enumerate(trend.points) if point.status == status]
        if members:
            face = ["white" if trend.points[n].healthy else color for n in members]
            panel.scatter(
                members,
                value[members],
                25,
                face,
                marker=marker,
                edgecolors=color,
                label=meaning,
                zorder=3,
            )
    figure.legend(loc="outside upper center", ncols=len(_STATUS) + 1)
    every = math.ceil(
        len(trend.points) / 40
    )  # names under the axis, as many as fit, shortened in the middle
    ids = [point.row.recording_id for point in trend.points]
    ids = [text if len(text) <= 26 else f"{text[:13]}…{text[-12:]}" for text in ids]
    panel.set_xticks(range(0, len(ids), every), ids[::every], rotation=90, fontsize=7.5)
    panel.set_xlim(-0.8, len(ids) - 0.2)
    panel.grid(axis="x", visible=False)
    panel.set_ylabel(f"{name} [{format_unit(unit)}]")
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
        f"{end_sentence(trend.indicator.meaning)}. {baseline if least else ''}Hollow: stated healthy. "
        "No limit of a standard is drawn: none is made for axial piston pumps."
    )
    title = f"{name} of {format_label(trend.channel)}"
    return render_drawing("trend", figure, tabulate(rows), title=title, caption=caption)


def _empty(value: float) -> float | None:
    return value if math.isfinite(value) else None
