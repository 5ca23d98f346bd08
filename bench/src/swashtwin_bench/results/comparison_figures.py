"""Figures of studies that compare more than training sets: curves, bars of classifiers, time against score."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, NullFormatter

from swashtwin.foundation import plural
from swashtwin.plot import figure_style, panels, series_colors, spread_labels, words
from swashtwin.report import Drawing, render_drawing, tabulate
from swashtwin_bench.results.naming import classifier_words, training_set_words
from swashtwin_bench.results.result import StudyResult

NAMING = ("classifier", "training_set", "level")
"""Factors that every study has; a further one is what curves run along."""

MOST_TOGETHER = 4
"""Training sets that are drawn in one figure for all classifiers; with more, each classifier has its own figure."""

LEGEND_WIDTH = 120
"""Letters that a legend holds side by side."""

_MARKERS = "osD^vP*XhpdH<>8"
_DASHES = ("-", "--", ":", "-.")


def curve_factor(study: StudyResult) -> str | None:
    """The factor that curves run along, such as ``"perturbation"``; None where there is none."""
    further = [name for name in study.factors if name not in NAMING]
    return further[-1] if further else None


def curve_drawings(study: StudyResult, key: str) -> list[Drawing]:
    """Accuracy and recall in the scarce cell along a factor, one figure or one for each classifier."""
    factor = curve_factor(study)
    if factor is None:
        return []
    rows = [*study.rows(), *study.rows(rivals=True)]
    classifiers = list(dict.fromkeys(row["classifier"] for row in rows))
    if len({row["training_set"] for row in rows}) <= MOST_TOGETHER:
        return [_curves(study, rows, factor, f"{key}_{factor}", title="")]
    return [
        _curves(
            study,
            [row for row in rows if row["classifier"] == classifier],
            factor,
            f"{key}_{factor}_{classifier}",
            title=f"{classifier_words(classifier)}: ",
        )
        for classifier in classifiers
    ]


@figure_style()
def _curves(study: StudyResult, rows: Sequence[dict], factor: str, name: str, *, title: str) -> Drawing:
    values = list(dict.fromkeys(row[factor] for row in rows))
    levels = sorted({row["level"] for row in rows})
    metrics = {"accuracy": "accuracy", "scarce_recall": "recall in the scarce cell"}
    series = list(dict.fromkeys((row["classifier"], row["training_set"]) for row in rows))
    figure, axes = panels(len(metrics), len(levels), 1.2 + 2.7 * len(metrics), sharex=True, sharey=True)
    looks = _looks(series)
    for ax, (metric, heading) in zip(axes, metrics.items(), strict=True):
        for panel, level in zip(ax, levels, strict=True):
            for pair in series:
                rows_by_value = {
                    row[factor]: row[metric]
                    for row in rows
                    if (row["classifier"], row["training_set"], row["level"]) == (*pair, level)
                }
                _curve(panel, [rows_by_value.get(at) for at in values], looks[pair])
            panel.set(title=level, xticks=range(len(values)), xticklabels=values, ylim=(0, 1.03))
        ax[0].set_ylabel(f"{heading} [1]")
    for panel in axes[-1]:
        panel.set_xlabel(words(factor))
    marks = [Line2D([], [], markersize=4, **looks[pair]) for pair in series]
    names = [_series_words(pair, series) for pair in series]
    across = max(1, min(4, LEGEND_WIDTH // (max(map(len, names)) + 7)))
    figure.legend(marks, names, loc="outside lower center", ncols=across)
    columns = tabulate(
        {**{n: row[n] for n in study.factors}, "metric": metric, "mean": row[metric]["mean"], "std": row[metric]["std"]}
        for row in rows
        for metric in metrics
    )
    counts = _one_row_each(series, rows, factor)
    caption = f"Mean over {plural(len(study.seeds), 'seed')}; bars: one standard deviation. {counts}"
    return render_drawing(name, figure, columns, title=f"{title}scores by {words(factor)}", caption=caption)


def _curve(panel: Axes, spreads: Sequence[dict | None], look: dict) -> None:
    points = [
        (i, spread["mean"], spread["std"] or 0.0)
        for i, spread in enumerate(spreads)
        if spread and spread["mean"] is not None
    ]
    if not points:
        return
    at, mean, deviation = (np.array(column, dtype=float) for column in zip(*points, strict=True))
    if len(points) == 1 and len(spreads) > 1:
        panel.axhline(float(mean[0]), color=look["color"], linestyle=":", linewidth=1)
    panel.errorbar(at, mean, yerr=deviation, markersize=4, linewidth=1.3, elinewidth=0.8, **look)


def _looks(series: Sequence[tuple[str, str]]) -> dict[tuple[str, str], dict]:
    """Color, marker and line of each (classifier, training set)."""
    classifiers, sets = ([pair[i] for pair in series] for i in (0, 1))
    first, second = list(dict.fromkeys(classifiers)), list(dict.fromkeys(sets))
    colors = series_colors(first if len(second) <= MOST_TOGETHER and len(first) > 1 else second)
    return {
        (classifier, name): {
            "color": colors.get(classifier) or colors[name],
            "marker": _MARKERS[(first.index(classifier) if len(first) > 1 else second.index(name)) % len(_MARKERS)],
            "linestyle": _DASHES[second.index(name) % 4] if len(first) > 1 else "-",
        }
        for classifier, name in series
    }


def _series_words(pair: tuple[str, str], series: Sequence[tuple[str, str]]) -> str:
    parts = (classifier_words(pair[0]), training_set_words(pair[1]))
    words = [part for part, i in zip(parts, (0, 1), strict=True) if len({each[i] for each in series}) > 1]
    return ", ".join(words) or parts[0]


def _one_row_each(series: Sequence[tuple[str, str]], rows: Sequence[dict], factor: str) -> str:
    counts = {pair: len({r[factor] for r in rows if (r["classifier"], r["training_set"]) == pair}) for pair in series}
    most = max(counts.values())
    return "Dotted: training sets that the factor does not change." if 1 in counts.values() and most > 1 else ""


@figure_style()
def classifier_drawing(study: StudyResult, key: str) -> Drawing:
    """Accuracy of each classifier as a bar, best first at the nearest level, single seeds as points."""
    rows = study.rows()
    levels = sorted({row["level"] for row in rows})
    score = {row["classifier"]: row["accuracy"]["mean"] for row in rows if row["level"] == levels[0]}
    names = sorted(score, key=lambda name: -(score[name] or 0.0))
    figure, axes = panels(1, len(levels), 1.1 + 0.28 * len(names), sharey=True)
    for panel, level in zip(axes[0], levels, strict=True):
        for line, name in enumerate(names):
            spread = next(row["accuracy"] for row in rows if (row["classifier"], row["level"]) == (name, level))
            color = "#0072b2" if name == study.main_classifier else "#9aa3ad"
            panel.barh(
                line, spread["mean"] or 0.0, xerr=spread["std"], color=color, height=0.7, ecolor="black", capsize=2
            )
            values = [value for value in spread["values"] if value is not None]
            panel.plot(values, [line] * len(values), "o", color="white", markeredgecolor="black", markersize=3)
        ticks = {"yticks": range(len(names)), "yticklabels": [_with_count(name, study) for name in names]}
        panel.set(title=level, xlabel="accuracy [1]", xlim=(0, 1.02), ylim=(len(names) - 0.4, -0.6), **ticks)
    columns = tabulate(
        {"classifier": trial.factors["classifier"], "level": trial.factors["level"], "seed": trial.seed,
         "accuracy": trial.values["accuracy"]}
        for trial in study.trials
    )  # fmt: skip
    caption = f"Bars: mean over {plural(len(study.seeds), 'seed')}; points: single seeds; whiskers: standard deviation."
    return render_drawing(f"{key}_classifiers", figure, columns, title="Accuracy of the classifiers", caption=caption)


def _with_count(classifier: str, study: StudyResult) -> str:
    """Name of a classifier, with the number of its seeds where others have more: their means are of other fleets."""
    count = len({trial.seed for trial in study.trials if trial.factors["classifier"] == classifier})
    return classifier_words(classifier) + (f" (n = {count})" if count < len(study.seeds) else "")


@figure_style()
def time_drawing(study: StudyResult, key: str) -> Drawing:
    """Accuracy of each classifier over the time that training and tests took."""
    rows = [row for row in study.rows() if row["accuracy"]["mean"] is not None and math.isfinite(row["wall_s"]["mean"])]
    levels = sorted({row["level"] for row in study.rows()})
    lowest, highest = min((row["accuracy"]["mean"] for row in rows), default=0.0) - 0.02, 1.02
    gap = (highest - lowest) / max(30, len(rows) / len(levels))
    figure, axes = panels(1, len(levels), 4.6, sharey=True)
    for panel, level in zip(axes[0], levels, strict=True):
        level_rows = [row for row in rows if row["level"] == level]
        points = [(row["wall_s"]["mean"], row["accuracy"]["mean"]) for row in level_rows]
        heights = spread_labels([accuracy for _, accuracy in points], gap, lowest, highest)
        for row, point, height in zip(level_rows, points, heights, strict=True):
            color = "#0072b2" if row["classifier"] == study.main_classifier else "#5b6470"
            panel.plot(*point, "o", color=color, markersize=5)
            panel.annotate(
                _with_count(row["classifier"], study),
                point,
                (1.04, height),
                textcoords=panel.get_yaxis_transform(),
                arrowprops={"arrowstyle": "-", "color": color, "linewidth": 0.4, "relpos": (0, 0.5)},
                fontsize=7,
                va="center",
            )
        panel.set(title=level, xlabel="training and tests, one thread [s]", xscale="log", ylim=(lowest, highest))
        panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        panel.xaxis.set_minor_formatter(NullFormatter())
    axes[0, 0].set_ylabel("accuracy [1]")
    columns = tabulate(
        {"classifier": row["classifier"], "level": row["level"], "wall_s": row["wall_s"]["mean"],
         "accuracy": row["accuracy"]["mean"], "device": study.device}
        for row in rows
    )  # fmt: skip
    caption = "Mean over the seeds. Times are of one machine under whatever load it had: read ratios, not seconds."
    return render_drawing(f"{key}_time", figure, columns, title="Accuracy against time", caption=caption)
