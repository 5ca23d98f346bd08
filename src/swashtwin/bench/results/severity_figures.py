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
    cases = [case for case in study.details["cases"] if case["truth"] > 0]
    kinds = list(dict.fromkeys((case["kind"], case["dimension"]) for case in cases))
    per_line = min(2, len(kinds))
    lines = math.ceil(len(kinds) / per_line)
    figure, axes = panels(lines, per_line, 0.3 + 3.0 * lines)
    for ax, (kind, dimension) in zip(axes.flat, kinds, strict=False):
        matching = [case for case in cases if (case["kind"], case["dimension"]) == (kind, dimension)]
        _panel(ax, matching)
        unit = f" [{matching[0]['unit']}]" if matching[0]["unit"] else ""
        ax.set_title(f"{words(kind)}: {words(dimension)}")
        ratio_axis(ax, "x", f"truth{unit}")
        ratio_axis(ax, "y", f"found{unit}")
    for ax in axes.flat[len(kinds) :]:
        ax.set_visible(False)
    return render_drawing(
        f"{key}_found",
        figure,
        tabulate(cases),
        title="Found against true severity",
        caption="Each point is one recording, bars are 90 % intervals, gray the truth. Open points may be zero; bars "
        "that begin below the panel hold zero. Both axes logarithmic; in SI in the data.",
    )


def _panel(ax: Axes, cases: Sequence[dict[str, Any]]) -> None:
    truth, estimated, low, high = (
        np.array([case[name] / case["per_unit"] for case in cases]) for name in ("truth", "estimate", "low", "high")
    )
    least, most = 0.15 * truth.min(), 6 * truth.max()
    ax.plot([least, most], [least, most], color=LIGHT, linewidth=2, zorder=1)
    shown = np.clip(estimated, 1.1 * least, most)
    bars = [shown - np.clip(low, least, shown), np.clip(high, shown, most) - shown]
    ax.errorbar(truth, shown, yerr=bars, fmt="none", ecolor=MEASURED, elinewidth=0.8, alpha=0.5, zorder=2)
    sure = np.array([case["detected"] for case in cases])
    for part, fill in ((sure, CALIBRATED), (~sure, "white")):
        ax.plot(truth[part], shown[part], "o", color=fill, markeredgecolor=CALIBRATED, markersize=4, zorder=3)
    ax.set(xscale="log", yscale="log", xlim=(0.7 * truth.min(), 1.4 * truth.max()), ylim=(least, most))
