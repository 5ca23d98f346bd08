"""Figures of studies: rows of scores, curves along what is varied, training, confusion matrices,
t-SNE.
"""

import math
import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, PercentFormatter
from sklearn.manifold import TSNE

from swashtwin.foundation import plural
from swashtwin.physics import Twin, find_recess, slipper_displacements
from swashtwin.plot import (
    CALIBRATED,
    MEASURED,
    create_panels,
    figure_style,
    format_label,
    label_log_axis,
    series_colors,
)
from swashtwin.report import Drawing, draw_confusion, render_drawing, tabulate
from swashtwin_bench.results.naming import format_factor
from swashtwin_bench.results.result import TESTS, StudyResult, name_run
from swashtwin_bench.results.runs import Run
from swashtwin_bench.results.table import StudyTable

SHOWN = ("accuracy", "scarce_recall")
"""Metrics of a study of classifiers that are drawn; the table has all."""

MAX_ROWS = 40
"""Rows that are drawn; a longer table is drawn up to there."""

MAX_MATRICES = 4
"""Confusion matrices drawn beside each other at most."""

MAX_POINTS = 1200
"""Windows drawn in one t-SNE panel at most, taken evenly; a third of it where there is more than
one row of panels.
"""

MAX_PANELS = 20
"""t-SNE panels drawn at most, in rows of `_ACROSS`."""

_ACROSS = 4
_SPLIT_MARKERS = {"L0": "x", "L1": "s", "L2": "o", "L3": "D", "L4": "^", "L5": "P"}
_MARKERS = "osD^vP*XhpdH<>8"
_DASHES = ("-", "--", ":", "-.")


@figure_style()
def draw_rows(study: StudyTable, key: str) -> Drawing:
    """Each metric in a panel, each row on a line of it: its mean as a bar, trials as points."""
    shown = {name: label for name, label in study.metrics.items() if name in SHOWN} or study.metrics
    varying = [
        name for name in study.factors if len({trial.factors[name] for trial in study.trials}) > 1
    ]
    rows = sorted(study.rows(), key=lambda row: str(row.get("split", "")))[:MAX_ROWS]
    names = [
        ", ".join(format_factor(name, row[name]) for name in varying or study.factors[:1])
        for row in rows
    ]
    across = min(2, len(shown))
    down = math.ceil(len(shown) / across)
    figure, axes = create_panels(down, across, down * (1.1 + 0.24 * len(rows)), sharey=True)
    for ax, (metric, heading) in zip(axes.flat, shown.items(), strict=False):
        for line, row in enumerate(rows):
            values = [value for value in row[metric]["values"] if value is not None]
            if values:
                ax.barh(line, np.mean(values), height=0.62, color=CALIBRATED, alpha=0.35)
                ax.plot(values, [line] * len(values), "o", color=MEASURED, markersize=3, alpha=0.5)
        ax.set(
            title=heading, yticks=range(len(rows)), yticklabels=names, ylim=(len(rows) - 0.5, -0.5)
        )
    for ax in axes.flat[len(shown) :]:
        ax.set_visible(False)
    table = [
        {**trial.factors, "seed": trial.seed, "metric": metric, "value": trial.values.get(metric)}
        for metric in shown
        for trial in study.trials
    ]
    caption = f"Bars: mean over {plural(len(study.seeds), 'seed')}; points: single trials."
    return render_drawing(
        f"{key}_rows", figure, tabulate(table), title=study.title, caption=caption
    )


def draw_curves(study: StudyResult, key: str) -> list[Drawing]:
    """Accuracy and recall in the scarce cell along what is varied, a figure for each classifier of
    many training sets; none where nothing is varied.
    """
    further = [
        name for name in study.factors if name not in ("classifier", "training_set", "split")
    ]
    if not further:
        return []
    rows = study.rows()
    if len({row["training_set"] for row in rows}) <= len(_DASHES):
        return [_curves(study, rows, further[-1], f"{key}_{further[-1]}")]
    return [
        _curves(
            study,
            [row for row in rows if row["classifier"] == name],
            further[-1],
            f"{key}_{further[-1]}_{name}",
        )
        for name in dict.fromkeys(row["classifier"] for row in rows)
    ]


@figure_style()
def _curves(study: StudyResult, rows: Sequence[dict[str, Any]], factor: str, name: str) -> Drawing:
    values, splits = (
        list(dict.fromkeys(row[factor] for row in rows)),
        sorted({row["split"] for row in rows}),
    )
    series = list(dict.fromkeys((row["classifier"], row["training_set"]) for row in rows))
    classifiers, sets = (list(dict.fromkeys(pair[i] for pair in series)) for i in (0, 1))
    leading, other = (
        (classifiers, sets)
        if len(classifiers) > 1 and len(sets) <= len(_DASHES)
        else (sets, classifiers)
    )
    colors = series_colors(leading)
    figure, axes = create_panels(
        len(SHOWN), len(splits), 1.2 + 2.7 * len(SHOWN), sharex=True, sharey=True
    )
    looks: list[dict[str, Any]] = []
    titles: list[str] = []
    for pair in series:
        first, second = pair if leading is classifiers else pair[::-1]
        looks.append({"color": colors[first], "marker": _MARKERS[leading.index(first) % len(_MARKERS)],
                      "linestyle": _DASHES[other.index(second) % len(_DASHES)]})  # fmt: skip
        parts = zip(("classifier", "training_set"), pair, (classifiers, sets), strict=True)
        named = [format_factor(kind, value) for kind, value, choices in parts if len(choices) > 1]
        titles.append(", ".join(named) or format_factor("classifier", pair[0]))
    for line, metric in zip(axes, SHOWN, strict=True):
        for panel, split in zip(line, splits, strict=True):
            for pair, look in zip(series, looks, strict=True):
                spreads = [
                    (values.index(row[factor]), row[metric]["mean"], row[metric]["std"] or 0.0)
                    for row in rows
                    if (row["classifier"], row["training_set"], row["split"]) == (*pair, split)
                    if row[metric]["mean"] is not None
                ]
                if spreads:
                    at, mean, deviation = np.array(spreads).T
                    panel.errorbar(
                        at,
                        mean,
                        yerr=deviation,
                        markersize=4,
                        linewidth=1.3,
                        elinewidth=0.8,
                        **look,
                    )
            panel.set(title=split, xticks=range(len(values)), xticklabels=values, ylim=(0, 1.03))
        line[0].set_ylabel(f"{study.metrics[metric]} [1]")
    for panel in axes[-1]:
        panel.set_xlabel(format_label(factor))
    figure.legend(
        [Line2D([], [], markersize=4, **look) for look in looks],
        titles,
        loc="outside lower center",
        ncols=2,
    )
    table = [
        {
            **{n: row[n] for n in study.factors},
            "metric": metric,
            "mean": row[metric]["mean"],
            "std": row[metric]["std"],
        }
        for row in rows
        for metric in SHOWN
    ]
    caption = f"Mean over {plural(len(study.seeds), 'seed')}; bars: one standard deviation."
    return render_drawing(
        name, figure, tabulate(table), title=f"Scores by {format_label(factor)}", caption=caption
    )


@figure_style()
def draw_training(study: StudyResult, key: str) -> Drawing:
    """Loss and accuracy over the epochs, and over the CPU time where epochs were timed: a line for
    each training.
    """
    curves = [run for run in study.runs if run["history"]]
    sets = {run["factors"]["training_set"] for run in curves}
    by = "training_set" if len(sets) > 1 else "classifier"
    curves = [
        run
        for run in curves
        if by == "classifier" or run["factors"]["classifier"] == study.main_classifier
    ]
    names = list(dict.fromkeys(run["factors"][by] for run in curves))
    colors = series_colors(names)
    figure, axes = create_panels(2, 2, 5.6, sharex="col", sharey="row")
    rows: list[dict[str, Any]] = []
    for run in curves:
        number = np.array([epoch["number"] for epoch in run["history"]])
        seconds = number * run["values"].get("epoch_cpu_s", math.nan)
        for line, quantity in zip(axes, ("loss", "accuracy"), strict=True):
            for panel, along in zip(line, (number, seconds), strict=True):
                values = [epoch[quantity] for epoch in run["history"]]
                panel.plot(along, values, color=colors[run["factors"][by]], linewidth=1, alpha=0.8)
        rows += [
            {**run["factors"], "seed": run["seed"], "epoch": epoch["number"], "cpu_s": at, "loss": epoch["loss"],
             "accuracy": epoch["accuracy"]}
            for epoch, at in zip(run["history"], seconds.tolist(), strict=True)
        ]  # fmt: skip
    axes[0, 0].set(ylabel="cross-entropy [1]", yscale="log")
    label_log_axis(axes[0, 0].yaxis)
    axes[1, 0].set(ylabel="accuracy", xlabel="epoch", ylim=(0, 1.03))
    axes[1, 0].xaxis.set_major_locator(MaxNLocator(integer=True))
    axes[1, 0].yaxis.set_major_formatter(PercentFormatter(1, symbol=" %"))
    axes[1, 1].set(xlabel="CPU time of the training [s]")
    marks = [Line2D([], [], color=colors[name], linewidth=2) for name in names]
    figure.legend(
        marks, [format_factor(by, name) for name in names], loc="outside upper center", ncols=2
    )
    caption = (
        "One line for each seed: the training windows, synthetic ones included, while the weights move. An epoch "
        "counts the mean CPU time of its training's epochs. These are no test scores."
    )
    return render_drawing(
        f"{key}_training", figure, tabulate(rows), title="Training curves", caption=caption
    )


def draw_confusions(study: StudyResult, key: str) -> Drawing:
    """Confusion matrices of a few rows, the first and the best, for each split; all seeds added."""
    rows = {tuple(value for name, value in row.items() if name in study.factors and name != "split"): row
            for row in sorted(study.rows(), key=lambda row: -(row["accuracy"]["mean"] or 0.0))}  # fmt: skip
    first = tuple(value for name, value in study.trials[0].factors.items() if name != "split")
    chosen = list(dict.fromkeys([first, *rows]))[:MAX_MATRICES]
    titles = dict(
        zip(
            chosen,
            _distinct([name for name in study.factors if name != "split"], chosen),
            strict=True,
        )
    )
    matrices: dict[tuple[str, str], np.ndarray] = {}
    for run, row in sorted(study.tests(), key=lambda test: test[1]["split"]):
        factors = {**run["factors"], **{name: row[name] for name in TESTS if name in row}}
        column = titles.get(tuple(value for name, value in factors.items() if name != "split"))
        if column is not None:
            cell = (row["split"], column)
            matrices[cell] = matrices.get(cell, 0) + np.array(row["confusion"])
    seeds = plural(len(study.seeds), "seed")
    caption = f"Windows of each actual class in percent, over {seeds} together; rows add up to 100."
    return draw_confusion(f"{key}_confusion", matrices, study.classes, caption=caption)


def _distinct(factors: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows in words that say only what differs between them."""
    varying = [i for i in range(len(factors)) if len({row[i] for row in rows}) > 1] or [
        min(1, len(factors) - 1)
    ]
    return [", ".join(format_factor(factors[i], row[i]) for i in varying) for row in rows]


def embedded_runs(study: StudyResult) -> list[Run]:
    """Networks under the first seed whose features stand beside each other: the study's own on each
    training set, or all of them where there is one training set only; as far as there is enough for
    a layout to mean anything.
    """
    first = [run for run in study.first_runs if run["features"]]
    several = len({name_run(run, "classifier") for run in first}) > 1
    chosen = [
        run for run in first if not several or run["factors"]["classifier"] == study.main_classifier
    ]
    return [
        run
        for run in chosen
        if len(run["features"]["label"]) >= 10 and np.ptp(run["features"]["values"], axis=0).any()
    ]


@figure_style()
def draw_embedding(study: StudyResult, key: str) -> Drawing:
    """t-SNE of the test windows' features, for each training set, or for each network where there
    is one only.
    """
    runs = embedded_runs(study)
    runs = [runs[i] for i in _spread_evenly(len(runs), MAX_PANELS)]
    titles = _distinct(list(runs[0]["factors"]), [tuple(run["factors"].values()) for run in runs])
    classes = list(study.classes)
    colors = series_colors(classes)
    splits = sorted({split for run in runs for split in run["features"]["split"]})
    down = math.ceil(len(runs) / _ACROSS)
    figure, axes = create_panels(
        down, min(len(runs), _ACROSS), 3.9 if down == 1 else 0.9 + 2.6 * down
    )
    rows: list[dict[str, Any]] = []
    for ax in axes.flat[len(runs) :]:
        ax.set_axis_off()
    for ax, run, title in zip(axes.flat, runs, titles, strict=False):
        features = {name: np.array(values) for name, values in run["features"].items()}
        picked = _spread_evenly(
            len(features["label"]), MAX_POINTS if down == 1 else MAX_POINTS // 3
        )
        points, label, split = (
            _tsne(features["values"][picked]),
            features["label"][picked],
            features["split"][picked],
        )
        for name in classes:
            for split_name in splits:
                selected = (label == name) & (split == split_name)
                marker = _SPLIT_MARKERS.get(split_name, "o")
                ax.plot(
                    *points[selected].T,
                    marker,
                    color=colors[name],
                    markersize=4,
                    alpha=0.75,
                    markeredgewidth=0.3,
                )
        ax.set(title=textwrap.fill(title, 28), xticks=[], yticks=[])
        rows += [{**run["factors"], "split": split[i], "label": label[i], "x": x, "y": y}
                 for i, (x, y) in enumerate(points)]  # fmt: skip
    marks = [Line2D([], [], marker="o", linestyle="", color=colors[name]) for name in classes]
    marks += [
        Line2D([], [], marker=_SPLIT_MARKERS.get(split, "o"), linestyle="", color="#888888")
        for split in splits
    ]
    names = [format_label(name) for name in classes] + splits
    figure.legend(marks, names, loc="outside lower center", ncols=len(names))
    caption = (
        f"Test windows under seed {study.seeds[0]} as the network's last layer sees them, laid out in two dimensions "
        "by t-SNE (fixed seed). Neighborhoods mean something; distances between groups, their sizes and axes do not."
    )
    return render_drawing(
        f"{key}_tsne",
        figure,
        tabulate(rows),
        title="Features of the test windows (t-SNE)",
        caption=caption,
    )


def _spread_evenly(count: int, most: int) -> np.ndarray:
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))


def _tsne(features: np.ndarray) -> np.ndarray:
    perplexity = min(30.0, (len(features) - 1) / 3)
    points: np.ndarray = TSNE(
        perplexity=perplexity, init="pca", random_state=0, n_jobs=1
    ).fit_transform(features)
    return points.astype(np.float64)


@figure_style()
def draw_excitation(twin: Twin, key: str) -> list[Drawing]:
    """Displacement of each slipper in the recess and their sum, over one revolution; an empty list
    for other faults.
    """
    recess = find_recess(twin.fault)
    if recess is None:
        return []
    time = np.linspace(0, twin.condition.period, 701)
    each = slipper_displacements(twin.pump, twin.condition, recess, time)
    columns = {
        "time_s": time,
        **{f"slipper_{j + 1}_m": row for j, row in enumerate(each)},
        "total_m": each.sum(axis=0),
    }
    figure, axes = create_panels(2, 1, 4.8, sharex=True)
    (above,), (below,) = axes
    turn = np.exp(2j * np.pi * time / twin.condition.period)
    for j, row in enumerate(each):
        above.plot(time * 1e3, row * 1e3, color=f"{0.15 + 0.5 * j / max(1, len(each) - 1):.2f}")
        middle = np.angle(np.sum(row * turn)) % (2 * np.pi) / (2 * np.pi) * twin.condition.period
        above.text(
            middle * 1e3, each.max() * 1.04e3, str(j + 1), ha="center", va="bottom", fontsize=9
        )
    total = each.sum(axis=0) * 1e3
    below.plot(time * 1e3, total, color=CALIBRATED)
    above.set(
        ylabel="each slipper [mm]", ylim=(0, each.max() * 1.2e3), title="Slippers, by their number"
    )
    below.set(
        xlabel="time [ms], from top dead center of piston 1",
        ylabel="total [mm]",
        xlim=(0, time[-1] * 1e3),
    )
    below.set_ylim(0, total.max() * 1.15)
    size = f"{recess.length * 1e3:g} × {recess.width * 1e3:g} × {recess.depth * 1e3:g} mm"
    caption = (
        f"Displacement of the slippers in a recess of {size} (length × width × depth) over one revolution, before any "
        "gain. Where neighbors overlap the total never returns to zero, and it repeats once per slipper."
    )
    name, title = f"{key}_excitation", "Excitation by the defect"
    return [render_drawing(name, figure, columns, title=title, caption=caption)]
