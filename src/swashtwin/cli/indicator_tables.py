"""What features and trend show on the screen: each recording, or many in few lines."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from swashtwin.cli.console import say, table
from swashtwin.cli.summaries import condition_words, grouped, median_of, spread_of

if TYPE_CHECKING:
    from swashtwin.signals import Row, Trend

_STATUS = ("within", "above", "below", "no baseline")
_FURTHEST = 3


def show_medians(rows: "Sequence[Row]", values: list[list[float]], names: list[str]) -> None:
    """Print the median of each column by class, condition and channel."""
    words = _words(rows)
    told = [
        (group[0][0].label, group[0][1], group[0][0].channel, len(group),
         *(median_of(column) for column in zip(*(one for _, _, one in group), strict=True)))
        for group in grouped(
            zip(rows, words, values, strict=True), lambda one: (one[0].label, one[1], one[0].channel)
        )
    ]  # fmt: skip
    header = ("class", "condition", "channel", "recordings", *names)
    table(f"{len(rows)} rows, medians by class and condition (--all shows each)", header, told)


def show_points(found: "Trend") -> None:
    """Print each recording of a trend."""
    factor, unit = found.indicator.shown
    rows = []
    for point in found.points:
        shown = (number_or_none(factor * value) for value in (point.value, point.median, point.spread))
        rows.append((point.row.recording_id, point.row.label, *shown, point.count, point.status))
    name = f"{found.indicator.name} [{unit or '1'}]"
    header = ("recording", "class", name, "baseline", "spread", "healthy", "status")
    table(f"{found.indicator.name} of {found.channel}", header, rows)


def show_trend_summary(found: "Trend") -> None:
    """Print how many recordings lie within their baseline by class and condition, and which are furthest off."""
    factor, unit = found.indicator.shown
    rows = [point.row for point in found.points]
    words = _words(rows)
    told = []
    for group in grouped(zip(found.points, words, strict=True), lambda one: (one[0].row.label, one[1])):
        own = [point for point, _ in group]
        status: list[str] = [point.status for point in own]
        told.append(
            (own[0].row.label, group[0][1], len(own), spread_of(factor * point.value for point in own),
             spread_of(factor * point.median for point in own), *(status.count(one) for one in _STATUS))
        )  # fmt: skip
    header = ("class", "condition", "recordings", f"{found.indicator.name} [{unit or '1'}]", "baseline", *_STATUS)
    table(f"{found.indicator.name} of {found.channel} by class and condition (--all shows each)", header, told)
    far = sorted(found.flagged, key=lambda point: -abs(point.value - point.median) / point.spread)[:_FURTHEST]
    if far:
        named = [f"{one.row.recording_id} ({abs(one.value - one.median) / one.spread:.3g} spreads)" for one in far]
        say(f"Furthest off: {', '.join(named)}")


def _words(rows: "Sequence[Row]") -> list[str]:
    return condition_words(
        [row.recording_id for row in rows], [row.speed for row in rows], [row.pressure for row in rows]
    )


def number_or_none(value: float) -> float | None:
    """The value, or None where it is no number."""
    return value if math.isfinite(value) else None
