"""Figure of the study of severities: what was found against the truth."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from swashtwin.bench.results.table import StudyTable
from swashtwin.report import (
    CALIBRATED,
    LIGHT,
    MEASURED,
    Drawing,
    figure_style,
    panels,
    ratio_axis,
    render_drawing,
    tabulate,
    words,
)


@figure_style()
def severity_drawing(study: StudyTable, key: str) -> Drawing:
    """Found against true dimensions with their intervals, a panel for each."""
    cases = [one for one in study.details["cases"] if one["truth"] > 0]
    kinds = list(dict.fromkeys((one["kind"], one["dimension"]) for one in cases))
    per_line = min(2, len(kinds))
    lines = math.ceil(len(kinds) / per_line)
    figure, axes = panels(lines, per_line, 0.3 + 3.0 * lines)
    for place, (kind, dimension) in zip(axes.flat, kinds, strict=False):
        own = [one for one in cases if (one["kind"], one["dimension"]) == (kind, dimension)]
        _panel(place, own)
        unit = f" [{own[0]['unit']}]" if own[0]["unit"] else ""
        place.set_title(f"{words(kind)}: {words(dimension)}")
        ratio_axis(place, "x", f"truth{unit}")
        ratio_axis(place, "y", f"found{unit}")
    for place in axes.flat[len(kinds) :]:
        place.set_visible(False)
    return render_drawing(
        f"{key}_found",
        figure,
        tabulate(cases),
        title="Found against true severity",
        caption="Each point is one recording, bars are 90 % intervals, gray the truth. Open points may be zero; bars "
        "that begin below the panel hold zero. Both axes logarithmic; in SI in the data.",
    )


def _panel(place: Axes, cases: Sequence[dict[str, Any]]) -> None:
    truth, found, low, high = (
        np.array([one[name] / one["per_unit"] for one in cases]) for name in ("truth", "found", "low", "high")
    )
    least, most = 0.15 * truth.min(), 6 * truth.max()
    place.plot([least, most], [least, most], color=LIGHT, linewidth=2, zorder=1)
    shown = np.clip(found, 1.1 * least, most)
    bars = [shown - np.clip(low, least, shown), np.clip(high, shown, most) - shown]
    place.errorbar(truth, shown, yerr=bars, fmt="none", ecolor=MEASURED, elinewidth=0.8, alpha=0.5, zorder=2)
    sure = np.array([one["detected"] for one in cases])
    for part, fill in ((sure, CALIBRATED), (~sure, "white")):
        place.plot(truth[part], shown[part], "o", color=fill, markeredgecolor=CALIBRATED, markersize=4, zorder=3)
    place.set(xscale="log", yscale="log", xlim=(0.7 * truth.min(), 1.4 * truth.max()), ylim=(least, most))
