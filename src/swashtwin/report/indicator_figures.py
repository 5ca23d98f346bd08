"""Figures of indicators with their data: a spectrum with its expected lines, and a trend against
its baseline.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from swashtwin import plot
from swashtwin.foundation import plural
from swashtwin.plot import (
    LIGHT,
    MEASURED,
    create_panels,
    figure_style,
    format_label,
    format_unit,
)
from swashtwin.report.drawing import Drawing, render_drawing, tabulate
from swashtwin.report.wording import capitalize_sentence
from swashtwin.signals import LineSpectrum, Trend

# Marker, color and label of each status.
_STATUS_STYLES = {
    "within": ("o", MEASURED, "within its baseline"),
    "above": ("^", "#d55e00", "above"),
    "below": ("v", "#aa4499", "below"),
    "no baseline": ("X", "#888888", "no baseline"),
}

# Names of recordings that fit under the axis.
_MAX_NAMES = 40

# Longer names are shortened in the middle.
_MAX_NAME_LENGTH = 26


@figure_style()
def draw_spectrum(spectrum: LineSpectrum) -> Drawing:
    """Draw a spectrum of each channel with the expected lines of the shaft and the pistons."""
    figure = plot.spectrum(spectrum)
    columns = {f"{spectrum.axis} [{spectrum.axis_unit or '1'}]": spectrum.position}
    for name, row in zip(spectrum.channels, spectrum.amplitude, strict=True):
        columns[f"{name} [{spectrum.unit or '1'}]"] = row

    caption = "One-sided peak amplitudes, corrected for the Hann taper."
    if spectrum.angle_from:
        caption += f" Along the shaft's angle, from {spectrum.angle_from}."
    if any(mark.position <= spectrum.position[-1] for mark in spectrum.marks):
        caption += " Dashed: where lines of the shaft and of the pistons are expected."
    caption += " The CSV file contains every line."
    title = f"{spectrum.kind.capitalize()} spectrum of {spectrum.recording_id}"
    return render_drawing(
        f"{spectrum.kind}_spectrum", figure, columns, title=title, caption=caption
    )


@figure_style()
def draw_trend(trend: Trend) -> Drawing:
    """Draw an indicator over recordings, each with the range of its baseline."""
    factor, unit = trend.indicator.display_unit
    name = format_label(trend.indicator.name).replace("rms", "RMS")
    values = factor * np.array([point.value for point in trend.points])

    figure, axes = create_panels(1, 1, 4.6)
    panel = axes[0, 0]
    _draw_baseline(panel, trend, factor)
    for status, (marker, color, label) in _STATUS_STYLES.items():
        members = [index for index, point in enumerate(trend.points) if point.status == status]
        if members:
            face = ["white" if trend.points[index].healthy else color for index in members]
            panel.scatter(
                members,
                values[members],
                25,
                face,
                marker=marker,
                edgecolors=color,
                label=label,
                zorder=3,
            )
    figure.legend(loc="outside upper center", ncols=len(_STATUS_STYLES) + 1)
    _label_recordings(panel, [point.row.recording_id for point in trend.points])
    panel.set_ylabel(f"{name} [{format_unit(unit)}]")

    return render_drawing(
        "trend",
        figure,
        tabulate(_trend_rows(trend)),
        title=f"{name} of {format_label(trend.channel)}",
        caption=_caption_trend(trend),
    )


def _draw_baseline(panel: Axes, trend: Trend, factor: float) -> None:
    """Draw median and range of the baseline of each recording that has one."""
    median = factor * np.array([point.median for point in trend.points])
    reach = trend.k * factor * np.array([point.spread for point in trend.points])
    positions = np.flatnonzero(np.isfinite(median))
    if not len(positions):
        return

    median = median[positions]
    reach = reach[positions]
    panel.bar(
        positions,
        2 * reach,
        bottom=median - reach,
        color=LIGHT,
        linewidth=0,
        label=f"baseline ± {trend.k:g} spreads",
    )
    panel.hlines(median, positions - 0.4, positions + 0.4, color="#888888", linewidth=1)


def _label_recordings(panel: Axes, recording_ids: Sequence[str]) -> None:
    """Write as many names under the axis as fit, shortened in the middle."""
    names = []
    for name in recording_ids:
        if len(name) > _MAX_NAME_LENGTH:
            # both ends stay: names of one series often differ in their last digits alone
            name = f"{name[:13]}…{name[-12:]}"
        names.append(name)
    step = math.ceil(len(names) / _MAX_NAMES)
    panel.set_xticks(range(0, len(names), step), names[::step], rotation=90, fontsize=7.5)
    panel.set_xlim(-0.8, len(names) - 0.2)
    panel.grid(axis="x", visible=False)


def _trend_rows(trend: Trend) -> list[dict[str, Any]]:
    """Return the data of a trend."""
    rows = []
    for point in trend.points:
        speed, pressure = point.row.point
        rows.append(
            {
                "recording": point.row.recording_id,
                "class": point.row.label,
                "specimen": point.row.specimen,
                "date": point.row.date,
                "speed [rpm]": _empty_if_nan(speed),
                "pressure [MPa]": _empty_if_nan(pressure),
                f"{trend.indicator.name} [{trend.indicator.unit or '1'}]": _empty_if_nan(
                    point.value
                ),
                "healthy": point.healthy,
                "baseline median": _empty_if_nan(point.median),
                "baseline spread": _empty_if_nan(point.spread),
                "baseline recordings": point.count,
                "status": point.status,
            }
        )

    return rows


def _caption_trend(trend: Trend) -> str:
    """Return the caption of a trend."""
    min_count = min(
        (point.count for point in trend.points if point.status != "no baseline"), default=0
    )
    baseline = ""
    if min_count:
        baseline = (
            f"Gray: median and {trend.k:g} spreads (1.4826 MAD) of the same machine's other "
            "healthy recordings at the same speed and pressure, if there are at least "
            f"{plural(min_count, 'recording')}. "
        )
    return (
        f"{capitalize_sentence(trend.indicator.meaning)}. {baseline}Hollow: specified as healthy. "
        "No limit of a standard is drawn: there is no such standard for axial piston pumps."
    )


def _empty_if_nan(value: float) -> float | None:
    if math.isnan(value):
        return None
    return value
