"""Draw the figures of the page as SVG.

The style sheet colors them, and the page's script adds zoom and the value at the pointer. The
field of a figure is stretched to the width of the page. Horizontal positions are therefore shares
of the width, vertical ones are pixels, and texts stand outside the field.
"""

import math
from collections.abc import Iterable, Sequence
from datetime import datetime
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Shaped
from markupsafe import Markup, escape

from swashtwin.monitoring.history.reading import ScoredRecording, Trend
from swashtwin.monitoring.history.schema import Alarm
from swashtwin.monitoring.page.axis import Axis

HEIGHT = 240.0
"""Height of a field [px]."""
BAND_SPREADS = 3.0
"""Half width of the baseline's band, in spreads of the healthy recordings."""

MIN_SPARK_SCORE = 5.0
"""Deviation at the top of a small line [healthy scatters], unless a recording deviates more."""
SPARK_WIDTH = 240
SPARK_HEIGHT = 40
"""Size of a small line, in units that are stretched."""
_SPARK_MARGIN = 4

WIDTH = 1000.0
"""Width of a field, in units that are stretched."""

# Height of one line of text above a field.
_LINE_PX = 16.0

# Space below a field for the texts of its axis.
_BOTTOM_PX = 22.0

# Distance of the names of two marks, as a share of the width; closer ones would overlap.
_MIN_NAME_DISTANCE = 0.05

# Distance of a tick's text from both sides, as a share of the width; otherwise it is cut off.
_TICK_MARGIN = 0.02


class Mark(NamedTuple):
    """A vertical line with a name above the field."""

    share: float
    """Position as a share of the width."""
    name: str
    """Text above it."""
    role: str = "mark"
    """Class of the line in the style sheet."""


def draw_figure(
    x: Axis,
    y: Axis,
    parts: Iterable[str],
    *,
    title: str,
    marks: Sequence[Mark] = (),
    y_ticks: Sequence[tuple[float, str]] | None = None,
    **data: str,
) -> Markup:
    """Return a figure as an SVG element.

    Parameters
    ----------
    parts : content of the field, from `draw_band`, `draw_curve`, `draw_horizontal` and
        `draw_vertical`; escaped already.
    title : text above the vertical axis; it also describes the figure to a screen reader.
    marks : marks whose names stand above the field, unless one is too close to a previous one.
    y_ticks : positions of the vertical axis that are marked, as shares, each with its text; by
        default round values.
    data : values for the page's script: ``ids`` of the recordings, ``shaft`` [Hz], ``unit``.
    """
    top = _LINE_PX
    if marks:
        top += _LINE_PX
    bottom = top + HEIGHT
    texts = [
        f'<text class="title" x="4" y="12">{escape(title)}</text>',
        *_draw_y_ticks(y.ticks() if y_ticks is None else y_ticks, top, bottom),
        *_draw_x_ticks(x, bottom),
        *_draw_mark_names(marks, top),
    ]

    attributes = {
        "x": f"{x.low!r} {x.high!r}",
        "x-kind": x.kind,
        "y": f"{y.low!r} {y.high!r}",
        "y-kind": y.kind,
        **data,
    }
    attribute_text = " ".join(
        f'data-{name}="{escape(value)}"' for name, value in attributes.items()
    )
    field = (
        f'<svg class="field" y="{top:.0f}" height="{HEIGHT:.0f}"'
        f' viewBox="0 0 {WIDTH:.0f} {HEIGHT:.0f}" preserveAspectRatio="none">'
        f"{''.join(parts)}</svg>"
    )
    return Markup(
        f'<svg class="drawing" role="img" aria-label="{escape(title)}"'
        f' height="{bottom + _BOTTOM_PX:.0f}" {attribute_text}>{field}{"".join(texts)}</svg>'
    )


def _draw_y_ticks(ticks: Iterable[tuple[float, str]], top: float, bottom: float) -> list[str]:
    texts = []
    for share, text in ticks:
        height = bottom - share * HEIGHT
        texts.append(f'<line class="grid" x1="0" x2="100%" y1="{height:.1f}" y2="{height:.1f}"/>')
        # At the top the text would run into the title.
        if height > top + _LINE_PX:
            texts.append(f'<text class="value" x="4" y="{height - 3:.1f}">{escape(text)}</text>')
    return texts


def _draw_x_ticks(x: Axis, bottom: float) -> list[str]:
    return [
        f'<text class="tick" x="{100 * share:.2f}%" y="{bottom + 16:.0f}">{escape(text)}</text>'
        for share, text in x.ticks()
        if _TICK_MARGIN < share < 1 - _TICK_MARGIN
    ]


def _draw_mark_names(marks: Sequence[Mark], top: float) -> list[str]:
    texts = []
    named_shares: list[float] = []
    for share, name, _ in marks:
        if any(abs(share - named_share) < _MIN_NAME_DISTANCE for named_share in named_shares):
            continue
        position = f'data-share="{share:.4f}" x="{100 * share:.2f}%" y="{top - 4:.0f}"'
        texts.append(f'<text class="name" {position}>{escape(name)}</text>')
        named_shares.append(share)
    return texts


def draw_curve(
    x: Float[np.ndarray, " point"], y: Float[np.ndarray, " point"], *, has_dots: bool = False
) -> str:
    """Return a line through points, given as shares; it is interrupted at NaN."""
    line = ""
    dots = ""
    command = "M"
    for x_share, y_share in zip(x, y, strict=True):
        if math.isnan(y_share):
            command = "M"  # move to the next point without a line
            continue
        point = _point(x_share, y_share)
        line += f"{command}{point}"
        dots += f"M{point}h0"
        command = "L"

    curve = f'<path class="main" d="{line}"/>'
    if has_dots and dots:
        curve += f'<path class="dots" d="{dots}"/>'
    return curve


def draw_band(
    x: Float[np.ndarray, " point"],
    low: Float[np.ndarray, " point"],
    high: Float[np.ndarray, " point"],
) -> str:
    """Return the area between two lines, given as shares.

    Points with a missing value are skipped.
    """
    is_finite = np.isfinite(low) & np.isfinite(high)
    if not is_finite.any():
        return ""

    finite_x = np.asarray(x)[is_finite]
    lower_edge = [_point(*point) for point in zip(finite_x, low[is_finite], strict=True)]
    upper_edge = [_point(*point) for point in zip(finite_x, high[is_finite], strict=True)]
    outline = "L".join(lower_edge + upper_edge[::-1])
    return f'<path class="band" d="M{outline}Z"/>'


def _point(x_share: float, y_share: float) -> str:
    return f"{WIDTH * x_share:.1f} {(1 - y_share) * HEIGHT:.1f}"


def draw_horizontal(share: float, role: str) -> str:
    """Return a horizontal line at a share of the height."""
    y = f"{(1 - share) * HEIGHT:.1f}"
    return f'<line class="{role}" x1="0" x2="{WIDTH:.0f}" y1="{y}" y2="{y}"/>'


def draw_vertical(share: float, role: str) -> str:
    """Return a vertical line at a share of the width."""
    x = f"{WIDTH * share:.1f}"
    return f'<line class="{role}" x1="{x}" x2="{x}" y1="0" y2="{HEIGHT:.0f}"/>'


def draw_alarms(x: Axis, alarms: Iterable[Alarm]) -> list[str]:
    """Return vertical lines at the times at which alarms were raised."""
    lines = []
    for alarm in alarms:
        role = "alarm"
        if alarm.kind in ("sensor", "delivery"):
            role = "sensor"
        share = float(x.share(alarm.opened.timestamp()))
        if 0 <= share <= 1:
            lines.append(draw_vertical(share, role))
    return lines


def seconds_of(times: Shaped[np.ndarray, " recording"]) -> Float[np.ndarray, " recording"]:
    """Return times of a trend as seconds since 1970, which an axis of time counts."""
    return times.astype("datetime64[ms]").astype(np.float64) / 1000


def draw_trend(
    trend: Trend,
    title: str,
    unit: str,
    alarms: Sequence[Alarm],
    *,
    baseline: tuple[float, float] | None = None,
    limit: float | None = None,
) -> Markup:
    """Return one indicator over time, with its baseline and the times at which alarms were raised.

    Parameters
    ----------
    title : name of the indicator.
    unit : unit of the indicator; empty if it has none.
    baseline : (median, spread) of the healthy baseline.
    limit : value at which an alarm is raised; the axis is then logarithmic.
    """
    edges: list[float] = []
    if baseline is not None:
        median, spread = baseline
        edges = [median - BAND_SPREADS * spread, median + BAND_SPREADS * spread]

    times = seconds_of(trend.times)
    x = Axis.around(times, kind="time")
    y = Axis.around(trend.values, edges)

    parts = []
    if limit is not None:
        y = Axis.around(trend.values, edges, [limit], kind="log")
        parts.append(draw_horizontal(float(y.share(limit)), "alarm"))
    if baseline is not None:
        low, high = (np.full(2, y.share(edge)) for edge in edges)
        parts.append(draw_band(np.array([0.0, 1.0]), low, high))
        parts.append(draw_horizontal(float(y.share(median)), "median"))
    parts += draw_alarms(x, alarms)

    heights = y.share(trend.values)
    parts.append(draw_curve(x.share(times), heights, has_dots=True))

    ids = " ".join(str(number) for number in trend.ids[np.isfinite(heights)])
    return draw_figure(x, y, parts, title=with_unit(title, unit), ids=ids, unit=unit)


def draw_spark(scores: Sequence[ScoredRecording], alarms: Iterable[datetime]) -> Markup:
    """Return a small line of the deviation over time, with the times at which alarms were raised.

    Recordings that deviate far are marked by dots. The line is interrupted if a recording was not
    compared with a baseline. Its height is at least `MIN_SPARK_SCORE`, so that the scatter of a
    healthy machine does not look like a change.
    """
    times = np.array([recording.time.timestamp() for recording in scores])
    values = np.array([recording.score for recording in scores], np.float64)
    is_large = np.array([recording.state in ("alarm", "unusual") for recording in scores])

    x = Axis(times[0], max(times[-1], times[0] + 1))
    y = Axis(0.0, max(MIN_SPARK_SCORE, float(np.nanmax(values))))
    points = [_spark_point(*shares) for shares in zip(x.share(times), y.share(values), strict=True)]
    line = ""
    command = "M"
    for point, value in zip(points, values, strict=True):
        if math.isnan(value):
            command = "M"
            continue
        line += f"{command}{point}"
        command = "L"

    parts = []
    for alarm in alarms:
        share = float(x.share(alarm.timestamp()))
        if 0 <= share <= 1:
            position = f"{SPARK_WIDTH * share:.0f}"
            parts.append(
                f'<line class="alarm" x1="{position}" x2="{position}" y1="0" y2="{SPARK_HEIGHT}"/>'
            )
    parts.append(f'<path class="main" d="{line}"/>')
    marked = zip(points, is_large & ~np.isnan(values), strict=True)
    dots = "".join(f"M{point}h0" for point, is_marked in marked if is_marked)
    if dots:
        parts.append(f'<path class="large" d="{dots}"/>')
    return Markup(
        f'<svg class="spark" viewBox="0 0 {SPARK_WIDTH} {SPARK_HEIGHT}" aria-hidden="true"'
        f' preserveAspectRatio="none">{"".join(parts)}</svg>'
    )


def _spark_point(x_share: float, y_share: float) -> str:
    # The margins keep lines and dots at the ends from being cut off.
    height = SPARK_HEIGHT - 2 * _SPARK_MARGIN
    return f"{SPARK_WIDTH * x_share:.0f} {_SPARK_MARGIN + (1 - y_share) * height:.0f}"


def with_unit(quantity: str, unit: str) -> str:
    """Return a title with its unit."""
    if not unit:
        return quantity
    return f"{quantity} [{unit.replace('^2', '²')}]"
