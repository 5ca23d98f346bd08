"""Figures of studies: rows of scores, curves, training, confusion matrices, t-SNE, excitation."""

import math
import textwrap
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
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
from swashtwin_bench.results.result import METRICS, StudyResult, factors_of_test, name_run
from swashtwin_bench.results.runs import Run
from swashtwin_bench.results.table import StudyTable

DRAWN_METRICS = ("accuracy", "scarce_recall")
"""Metrics that are drawn for a study of classifiers; the table has all."""

MAX_ROWS = 40
"""Maximum number of rows in a figure; the first ones are drawn."""

MAX_MATRICES = 12
"""Maximum number of confusion matrices of a split."""

MAX_POINTS = 1200
"""Maximum number of windows in one t-SNE panel, taken evenly.

It is a third if there are several rows of panels.
"""

MAX_PANELS = 20
"""Maximum number of t-SNE panels."""

MIN_EMBEDDED_WINDOWS = 10
"""Minimum number of test windows for t-SNE: a layout of fewer has no meaning."""

# t-SNE panels in a row of panels.
_PANELS_PER_ROW = 4

_SPLIT_MARKERS = {"L0": "x", "L1": "s", "L2": "o", "L3": "D", "L4": "^", "L5": "P"}
_SPLIT_COLOR = "#888888"
_MARKERS = "osD^vP*XhpdH<>8"
_DASHES = ("-", "--", ":", "-.")


@figure_style()
def draw_rows(study: StudyTable, key: str) -> Drawing:
    """Draw each metric in a panel: the mean of each row as a bar, its trials as points."""
    metrics = {name: study.metrics[name] for name in DRAWN_METRICS if name in study.metrics}
    metrics = metrics or dict(study.metrics)

    # Stable: within a split, rows keep the order of the study.
    rows = sorted(study.rows(), key=lambda row: str(row.get("split", "")))[:MAX_ROWS]
    labels = [study.label_row(row) for row in rows]
    colors = _bar_colors(rows)

    n_columns = min(2, len(metrics))
    n_lines = math.ceil(len(metrics) / n_columns)
    height = n_lines * (1.1 + 0.24 * len(rows))
    figure, axes = create_panels(n_lines, n_columns, height, sharey=True)
    for ax, (metric, heading) in zip(axes.flat, metrics.items(), strict=False):
        _draw_bars(ax, [row[metric]["values"] for row in rows], colors)
        ax.set(title=heading, yticks=range(len(rows)), yticklabels=labels)
        # The first row stands at the top, as in the table.
        ax.set_ylim(len(rows) - 0.5, -0.5)

    for unused_ax in axes.flat[len(metrics) :]:
        unused_ax.set_visible(False)

    table = []
    for metric in metrics:
        for trial in study.trials:
            value = trial.values.get(metric)
            table.append({**trial.factors, "seed": trial.seed, "metric": metric, "value": value})

    caption = f"Bars: mean over {plural(len(study.seeds), 'seed')}; points: single trials."
    return render_drawing(
        f"{key}_rows", figure, tabulate(table), title=study.title, caption=caption
    )


@figure_style()
def draw_summary(study: StudyTable, key: str) -> Drawing:
    """Draw the main metric of the rows of the summary: means as bars, trials as points."""
    metric = study.main_metric
    rows = study.summary_rows()[:MAX_ROWS]
    figure, axes = create_panels(1, 1, 0.9 + 0.3 * len(rows))
    ax = axes.flat[0]
    _draw_bars(ax, [row[metric]["values"] for row in rows], _bar_colors(rows))
    for position, row in enumerate(rows):
        spread = row[metric]
        # Right of the points, which would hide it.
        end = max(value for value in (spread["mean"], *spread["values"]) if value is not None)
        ax.annotate(
            f"{spread['mean']:.3g}",
            (end, position),
            xytext=(6, 0),
            textcoords="offset points",
            va="center",
        )
    ax.margins(x=0.12)
    # The rows of classifiers are those of one split, which the page states.
    labels = [study.label_row(row, without="split") for row in rows]
    ax.set(yticks=range(len(rows)), yticklabels=labels)
    # The first row stands at the top, as in the table.
    ax.set_ylim(len(rows) - 0.5, -0.5)

    heading = METRICS.get(metric) or study.metrics[metric]
    ax.set_xlabel(heading)
    table = [
        {**trial.factors, "seed": trial.seed, metric: trial.values.get(metric)}
        for trial in study.trials
    ]
    return render_drawing(
        f"{key}_summary",
        figure,
        tabulate(table),
        title=f"{heading[0].upper()}{heading[1:]}",
        caption=f"Bars: mean over {plural(len(study.seeds), 'seed')}; points: single trials.",
    )


def _bar_colors(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the color of each row's training set."""
    training_sets = [str(row.get("training_set", "")) for row in rows]
    color_by_set = {**series_colors(training_sets), "": MEASURED}
    return [color_by_set[name] for name in training_sets]


def _draw_bars(
    ax: Axes, values_by_row: Sequence[Sequence[float | None]], colors: Sequence[str]
) -> None:
    """Draw the mean of each row as a bar in its color, and its values as points."""
    for position, (row_values, color) in enumerate(zip(values_by_row, colors, strict=True)):
        values = [value for value in row_values if value is not None]
        if not values:
            continue
        ax.barh(position, np.mean(values), height=0.62, color=color, alpha=0.45)
        positions = [position] * len(values)
        ax.plot(values, positions, "o", color=MEASURED, markersize=3, alpha=0.5)


def draw_curves(study: StudyResult, key: str) -> list[Drawing]:
    """Draw accuracy and recall in the scarce cell over what is varied; empty if nothing is.

    With many training sets there is one figure for each classifier.
    """
    varied = [name for name in study.factors if name not in ("classifier", "training_set", "split")]
    if not varied:
        return []

    factor = varied[-1]
    rows = study.rows()
    if len({row["training_set"] for row in rows}) <= len(_DASHES):
        return [_draw_curves_of(study, rows, factor, f"{key}_{factor}")]

    drawings = []
    for classifier in dict.fromkeys(row["classifier"] for row in rows):
        classifier_rows = [row for row in rows if row["classifier"] == classifier]
        drawing = _draw_curves_of(study, classifier_rows, factor, f"{key}_{factor}_{classifier}")
        drawings.append(drawing)

    return drawings


@figure_style()
def _draw_curves_of(
    study: StudyResult, rows: Sequence[dict[str, Any]], factor: str, name: str
) -> Drawing:
    values = list(dict.fromkeys(row[factor] for row in rows))
    splits = sorted({row["split"] for row in rows})
    series = list(dict.fromkeys((row["classifier"], row["training_set"]) for row in rows))
    looks = _style_series(series)

    n_metrics = len(DRAWN_METRICS)
    figure, axes = create_panels(
        n_metrics, len(splits), 1.2 + 2.7 * n_metrics, sharex=True, sharey=True
    )
    for line, metric in zip(axes, DRAWN_METRICS, strict=True):
        for panel, split in zip(line, splits, strict=True):
            for (classifier, training_set), look in zip(series, looks, strict=True):
                curve_rows = [
                    row
                    for row in rows
                    if row["classifier"] == classifier
                    and row["training_set"] == training_set
                    and row["split"] == split
                ]
                _draw_curve(panel, curve_rows, metric, factor, values, look)
            panel.set(title=split, xticks=range(len(values)), xticklabels=values, ylim=(0, 1.03))
        line[0].set_ylabel(f"{study.metrics[metric]} [1]")

    for panel in axes[-1]:
        panel.set_xlabel(format_label(factor))
    figure.legend(
        [Line2D([], [], markersize=4, **look) for look in looks],
        _label_series(series),
        loc="outside lower center",
        ncols=2,
    )

    table = _list_spreads(study, rows)
    caption = f"Mean over {plural(len(study.seeds), 'seed')}; bars: one standard deviation."
    return render_drawing(
        name, figure, tabulate(table), title=f"Scores by {format_label(factor)}", caption=caption
    )


def _list_spreads(study: StudyResult, rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return mean and deviation of each drawn metric of each row."""
    table = []
    for row in rows:
        factors = {name: row[name] for name in study.factors}
        for metric in DRAWN_METRICS:
            spread = {"mean": row[metric]["mean"], "std": row[metric]["std"]}
            table.append({**factors, "metric": metric, **spread})

    return table


def _draw_curve(
    panel: Axes,
    rows: Sequence[Mapping[str, Any]],
    metric: str,
    factor: str,
    factor_values: Sequence[str],
    look: Mapping[str, Any],
) -> None:
    """Draw mean and deviation of a metric over the positions of a factor's values."""
    points = []
    for row in rows:
        spread = row[metric]
        if spread["mean"] is not None:
            position = factor_values.index(row[factor])
            points.append((position, spread["mean"], spread["std"] or 0.0))
    if not points:
        return

    positions, means, deviations = np.array(points).T
    panel.errorbar(
        positions, means, yerr=deviations, markersize=4, linewidth=1.3, elinewidth=0.8, **look
    )


def _style_series(series: Sequence[tuple[str, str]]) -> list[dict[str, Any]]:
    """Return color, marker and dashes of each series of (classifier, training set).

    Colors distinguish the training sets, and markers the classifiers; of one training set or
    classifier, both distinguish the other. Series of one color differ in their dashes.
    """
    classifiers = list(dict.fromkeys(classifier for classifier, _ in series))
    training_sets = list(dict.fromkeys(training_set for _, training_set in series))
    colored = training_sets if len(training_sets) > 1 else classifiers
    marked = classifiers if len(classifiers) > 1 else training_sets
    colors = series_colors(colored)

    n_by_color: Counter[str] = Counter()
    looks = []
    for classifier, training_set in series:
        color = colors[training_set if colored is training_sets else classifier]
        mark = marked.index(classifier if marked is classifiers else training_set)
        looks.append(
            {
                "color": color,
                "marker": _MARKERS[mark % len(_MARKERS)],
                "linestyle": _DASHES[n_by_color[color] % len(_DASHES)],
            }
        )
        n_by_color[color] += 1

    return looks


def _label_series(series: Sequence[tuple[str, str]]) -> list[str]:
    """Return the label of each series of (classifier, training set): what differs between them."""
    n_classifiers = len({classifier for classifier, _ in series})
    n_training_sets = len({training_set for _, training_set in series})

    labels = []
    for classifier, training_set in series:
        parts = []
        if n_classifiers > 1 or n_training_sets == 1:
            parts.append(format_factor("classifier", classifier))
        if n_training_sets > 1:
            parts.append(format_factor("training_set", training_set))
        labels.append(", ".join(parts))

    return labels


@figure_style()
def draw_training(study: StudyResult, key: str) -> Drawing:
    """Draw loss and accuracy of each training over the epochs, and over the CPU time if known."""
    runs = [run for run in study.runs if run["history"]]
    factor = "classifier"
    if len({run["factors"]["training_set"] for run in runs}) > 1:
        factor = "training_set"
        runs = [run for run in runs if run["factors"]["classifier"] == study.main_classifier]
    names = list(dict.fromkeys(run["factors"][factor] for run in runs))
    looks = _style_lines(names)

    figure, axes = create_panels(2, 2, 5.6, sharex="col", sharey="row")
    rows: list[dict[str, Any]] = []
    for run in runs:
        epochs = run["history"]
        numbers = np.array([epoch["number"] for epoch in epochs])
        # Without a measured time, NaN leaves the panels on the right empty.
        seconds = numbers * run["values"].get("epoch_cpu_s", math.nan)
        for line, quantity in zip(axes, ("loss", "accuracy"), strict=True):
            values = [epoch[quantity] for epoch in epochs]
            look = looks[run["factors"][factor]]
            line[0].plot(numbers, values, linewidth=1, alpha=0.8, **look)
            line[1].plot(seconds, values, linewidth=1, alpha=0.8, **look)

        for epoch, cpu_s in zip(epochs, seconds.tolist(), strict=True):
            rows.append(
                {
                    **run["factors"],
                    "seed": run["seed"],
                    "epoch": epoch["number"],
                    "cpu_s": cpu_s,
                    "loss": epoch["loss"],
                    "accuracy": epoch["accuracy"],
                }
            )

    axes[0, 0].set(ylabel="cross-entropy [1]", yscale="log")
    label_log_axis(axes[0, 0].yaxis)
    axes[1, 0].set(ylabel="accuracy", xlabel="epoch", ylim=(0, 1.03))
    axes[1, 0].xaxis.set_major_locator(MaxNLocator(integer=True))
    axes[1, 0].yaxis.set_major_formatter(PercentFormatter(1, symbol=" %"))
    axes[1, 1].set(xlabel="CPU time of the training [s]")

    marks = [Line2D([], [], linewidth=2, **looks[name]) for name in names]
    labels = [format_factor(factor, name) for name in names]
    figure.legend(marks, labels, loc="outside upper center", ncols=2)
    caption = (
        "One line for each seed: scores on the training windows, synthetic ones included, while "
        "the weights change. The time of an epoch is the mean CPU time of the epochs of its "
        "training. These are not test scores."
    )
    return render_drawing(
        f"{key}_training", figure, tabulate(rows), title="Training curves", caption=caption
    )


def _style_lines(names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return the color of each line, and dashes if several lines have it."""
    colors = series_colors(names)
    n_by_color: Counter[str] = Counter()
    looks: dict[str, dict[str, Any]] = {}
    for name, color in colors.items():
        looks[name] = {"color": color, "linestyle": _DASHES[n_by_color[color] % len(_DASHES)]}
        n_by_color[color] += 1
    return looks


def draw_confusions(study: StudyResult, key: str) -> Drawing:
    """Draw the confusion matrices of all rows, or of the first and the best ones, by split.

    They are summed over the seeds.
    """
    factors = [name for name in study.factors if name != "split"]
    by_accuracy = sorted(study.rows(), key=lambda row: -(row["accuracy"]["mean"] or 0.0))

    first = tuple(study.trials[0].factors[name] for name in factors)
    ranked = [tuple(row[name] for name in factors) for row in by_accuracy]
    selected = list(dict.fromkeys([first, *ranked]))[:MAX_MATRICES]
    titles = dict(zip(selected, _label_differences(factors, selected), strict=True))

    matrices: dict[tuple[str, str], np.ndarray] = {}
    for run, row in sorted(study.tests(), key=lambda test: test[1]["split"]):
        run_factors = {**run["factors"], **factors_of_test(row)}
        title = titles.get(tuple(run_factors[name] for name in factors))
        if title is not None:
            cell = (row["split"], title)
            matrices[cell] = matrices.get(cell, 0) + np.array(row["confusion"])

    n_rows = len(set(ranked))
    selection_note = ""
    if n_rows > len(selected):
        n_others = len(selected) - 1
        selection_note = f" Shown are the first row and the {n_others} most accurate of {n_rows}."
    caption = (
        "Windows of each actual class in percent, summed over "
        f"{plural(len(study.seeds), 'seed')}; rows add up to 100.{selection_note}"
    )
    return draw_confusion(f"{key}_confusion", matrices, study.classes, caption=caption)


def _label_differences(factors: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the label of each row: the factors that differ between rows, or the second one."""
    varied = []
    for index in range(len(factors)):
        values = {row[index] for row in rows}
        if len(values) > 1:
            varied.append(index)
    if not varied:
        # The training set, which follows the classifier.
        varied = [min(1, len(factors) - 1)]

    labels = []
    for row in rows:
        parts = [format_factor(factors[index], row[index]) for index in varied]
        labels.append(", ".join(parts))

    return labels


def select_embedded_runs(study: StudyResult) -> list[Run]:
    """Return the runs of the first seed whose features are drawn by t-SNE.

    They are those of the main network on each training set, or of all networks if there is one
    training set; without runs that have too few test windows, or constant features.
    """
    runs = [run for run in study.first_runs if run["features"]]
    if len({name_run(run, "classifier") for run in runs}) > 1:
        runs = [run for run in runs if run["factors"]["classifier"] == study.main_classifier]

    return [
        run
        for run in runs
        if len(run["features"]["label"]) >= MIN_EMBEDDED_WINDOWS
        and np.ptp(run["features"]["values"], axis=0).any()
    ]


@figure_style()
def draw_embedding(study: StudyResult, key: str) -> Drawing:
    """Draw t-SNE of the features of the test windows, a panel for each of the embedded runs."""
    runs = select_embedded_runs(study)
    runs = [runs[i] for i in _spread_evenly(len(runs), MAX_PANELS)]
    titles = _label_differences(
        list(runs[0]["factors"]), [tuple(run["factors"].values()) for run in runs]
    )
    classes = list(study.classes)
    colors = series_colors(classes)
    splits = sorted(set().union(*(run["features"]["split"] for run in runs)))

    n_lines = math.ceil(len(runs) / _PANELS_PER_ROW)
    height = 3.9 if n_lines == 1 else 0.9 + 2.6 * n_lines
    figure, axes = create_panels(n_lines, min(len(runs), _PANELS_PER_ROW), height)
    for unused_ax in axes.flat[len(runs) :]:
        unused_ax.set_axis_off()

    max_points = MAX_POINTS if n_lines == 1 else MAX_POINTS // 3
    rows: list[dict[str, Any]] = []
    for ax, run, title in zip(axes.flat, runs, titles, strict=False):
        for point in _draw_features(ax, run["features"], max_points, colors):
            rows.append({**run["factors"], **point})
        ax.set(title=textwrap.fill(title, 28), xticks=[], yticks=[])

    marks = [_legend_mark("o", colors[name]) for name in classes]
    marks += [_legend_mark(_SPLIT_MARKERS.get(split, "o"), _SPLIT_COLOR) for split in splits]
    legend = [format_label(name) for name in classes] + splits
    figure.legend(marks, legend, loc="outside lower center", ncols=len(legend))
    caption = (
        f"Features of the network's last layer for the test windows under seed {study.seeds[0]}, "
        "laid out in two dimensions by t-SNE (fixed seed). Neighborhoods are meaningful; axes, "
        "sizes of groups and distances between them are not."
    )
    return render_drawing(
        f"{key}_tsne",
        figure,
        tabulate(rows),
        title="Features of the test windows (t-SNE)",
        caption=caption,
    )


def _draw_features(
    ax: Axes, features: Mapping[str, Any], max_points: int, colors: Mapping[str, str]
) -> list[dict[str, Any]]:
    """Draw windows laid out by t-SNE, and return split, label and position of each.

    Each class has its color, each split its marker.
    """
    selected = _spread_evenly(len(features["label"]), max_points)
    labels = np.array(features["label"])[selected]
    splits = np.array(features["split"])[selected]
    points = _compute_tsne(np.array(features["values"])[selected])

    for name, color in colors.items():
        for split in np.unique(splits):
            is_shown = (labels == name) & (splits == split)
            ax.plot(
                *points[is_shown].T,
                _SPLIT_MARKERS.get(split, "o"),
                color=color,
                markersize=4,
                alpha=0.75,
                markeredgewidth=0.3,
            )

    return [
        {"split": split, "label": label, "x": x, "y": y}
        for (x, y), label, split in zip(points, labels, splits, strict=True)
    ]


def _legend_mark(marker: str, color: str) -> Line2D:
    return Line2D([], [], marker=marker, linestyle="", color=color)


def _spread_evenly(count: int, max_count: int) -> np.ndarray:
    """Return at most `max_count` of `count` indices, evenly spaced."""
    indices = np.linspace(0, count - 1, min(count, max_count)).round()
    return np.unique(indices.astype(int))


def _compute_tsne(features: np.ndarray) -> np.ndarray:
    # The usual perplexity, and less for few points: scikit-learn requires it to be below their
    # number. Started from PCA, so that the layout is reproducible.
    perplexity = min(30.0, (len(features) - 1) / 3)
    layout = TSNE(perplexity=perplexity, init="pca", random_state=0, n_jobs=1)
    points: np.ndarray = layout.fit_transform(features)
    return points.astype(np.float64)


@figure_style()
def draw_excitation(twin: Twin, key: str) -> list[Drawing]:
    """Draw the displacement of each slipper in the recess, and their sum, over one revolution.

    The list is empty if the fault of the twin is not a recess.
    """
    recess = find_recess(twin.fault)
    if recess is None:
        return []

    period = twin.condition.period
    time = np.linspace(0, period, 701)
    slippers = slipper_displacements(twin.pump, twin.condition, recess, time)
    total = slippers.sum(axis=0)

    figure, axes = create_panels(2, 1, 4.8, sharex=True)
    slipper_ax = axes[0, 0]
    total_ax = axes[1, 0]
    time_ms = time * 1e3

    shaft_phasor = np.exp(2j * np.pi * time / period)
    for index, displacement in enumerate(slippers):
        gray = f"{0.15 + 0.5 * index / max(1, len(slippers) - 1):.2f}"
        slipper_ax.plot(time_ms, displacement * 1e3, color=gray)

        # The label stands at the center of the pulse, also of one that wraps around the period.
        center_angle = np.angle(np.sum(displacement * shaft_phasor)) % (2 * np.pi)
        slipper_ax.text(
            center_angle / (2 * np.pi) * period * 1e3,
            slippers.max() * 1.04e3,
            str(index + 1),
            ha="center",
            va="bottom",
            fontsize=9,
        )
    slipper_ax.set(
        ylabel="each slipper [mm]",
        ylim=(0, slippers.max() * 1.2e3),
        title="Slippers, by their number",
    )

    total_ax.plot(time_ms, total * 1e3, color=CALIBRATED)
    total_ax.set(
        xlabel="time [ms], from top dead center of piston 1",
        ylabel="total [mm]",
        xlim=(0, time_ms[-1]),
        ylim=(0, total.max() * 1e3 * 1.15),
    )

    columns = {"time_s": time}
    for index, displacement in enumerate(slippers):
        columns[f"slipper_{index + 1}_m"] = displacement
    columns["total_m"] = total

    size = f"{recess.length * 1e3:g} × {recess.width * 1e3:g} × {recess.depth * 1e3:g} mm"
    caption = (
        f"Displacement of the slippers in a recess of {size} (length × width × depth) over one "
        "revolution, before any gain. If neighbors overlap, the total never returns to zero; it "
        "repeats once per slipper."
    )
    return [
        render_drawing(
            f"{key}_excitation", figure, columns, title="Excitation by the defect", caption=caption
        )
    ]
