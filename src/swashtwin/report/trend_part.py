"""Part of the page about an indicator over recordings."""

import math

from swashtwin.foundation import plural
from swashtwin.plot import words
from swashtwin.report.indicator_figures import trend_drawing
from swashtwin.report.page import Bullets, Cell, Part, Picture, Section, SectionOrder, Table, Tone
from swashtwin.report.wording import indicator_words, number
from swashtwin.signals import Trend, TrendPoint

_SMALL = 12
"""Healthy recordings of a baseline below which it flags some healthy ones."""
_NOT_CHECKED = (
    "Whether the change comes from a fault: speed, pressure, oil temperature and the sensor's mounting change "
    "levels too.",
    "Limits of a standard: none is made for axial piston pumps, so the machine is compared with itself.",
)


def trend_part(trend: Trend, key: str) -> Part:
    """Part of the page about one trend."""
    flagged, total = len(trend.flagged), len(trend.points)
    counts = [point.count for point in trend.points if point.status != "no baseline"]
    without = total - len(counts)
    name = f"{indicator_words(trend.indicator.name)} of {words(trend.channel)}"
    certainty = [
        f"A recording is flagged {trend.k:g} spreads or more from the median of its baseline: the same machine's other "
        "healthy recordings at the same speed and pressure."
    ]
    if counts:
        small = "; so few flag some healthy ones too" if min(counts) < _SMALL else ""
        certainty.append(f"The smallest baseline has {plural(min(counts), 'recording')}{small}.")
    if without:
        certainty.append(f"{plural(without, 'recording')} without a baseline: it takes five other healthy ones.")
    table = Table(
        "Flagged recordings, furthest first: value, its baseline, and how many spreads they are apart.",
        ("recording", "class", "machine", f"value [{trend.indicator.shown[1] or '1'}]", "baseline", "spreads"),
        tuple(_row(trend, point) for point in sorted(trend.flagged, key=lambda point: -abs(_distance(point)))),
    )
    return Part(
        title=f"Trend of {name}",
        answer=(f"{trend.indicator.meaning[:1].upper()}{trend.indicator.meaning[1:]}.",),
        notice="",
        sections=(
            Section(
                SectionOrder.SCORES,
                "What was flagged, and what was not checked",
                (table, Bullets("What was not checked", _NOT_CHECKED)),
            ),
        ),
        results={"trends": [trend.to_dict()]},
        verdict=_verdict(flagged, len(counts), total),
        tone=_tone(flagged, len(counts)),
        certainty=tuple(certainty),
        actions=_actions(flagged, len(counts)),
        glance=(Picture(trend_drawing(trend)),),
    )


def _verdict(flagged: int, judged: int, total: int) -> str:
    if not judged:
        return f"None of {plural(total, 'recording')} has a baseline"
    return f"{flagged} of {judged} recordings flagged" if flagged else f"None of {judged} recordings flagged"


def _tone(flagged: int, judged: int) -> Tone:
    return "unsure" if not judged else "bad" if flagged else "good"


def _actions(flagged: int, judged: int) -> tuple[str, ...]:
    if not judged:
        return ("Record five or more healthy recordings of each machine at each speed and pressure, and index them.",)
    if not flagged:
        return ("Nothing now. Record again at the same speed and pressure.",)
    return (
        "Check speed, pressure, oil temperature and mounting of the flagged recordings first.",
        "Then look at their spectra (swashtwin signal spectrum), or have a model name the fault (swashtwin diagnose).",
    )


def _distance(point: TrendPoint) -> float:
    return (point.value - point.median) / point.spread if point.spread else math.inf


def _row(trend: Trend, point: TrendPoint) -> tuple[Cell, ...]:
    factor = trend.indicator.shown[0]
    return (
        Cell(point.row.recording_id),
        Cell(words(point.row.label or "—")),
        Cell(point.row.specimen or "—"),
        Cell(number(factor * point.value)),
        Cell(number(factor * point.median)),
        Cell(f"{_distance(point):+.1f}"),
    )
