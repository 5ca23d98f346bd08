"""Figures of a study: scores by training set, training curves, confusion matrices, t-SNE."""

import math
import textwrap
from collections.abc import Callable, Sequence
from typing import TypeGuard

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, PercentFormatter
from sklearn.manifold import TSNE

from swashtwin.foundation import plural
from swashtwin.learning import LEVELS
from swashtwin.plot import class_colors, figure_style, name_decades, panels, series_colors, words
from swashtwin.report import Drawing, confusion_drawing, render_drawing, tabulate
from swashtwin_bench.results.comparison_figures import LEGEND_WIDTH
from swashtwin_bench.results.naming import classifier_words, training_set_words
from swashtwin_bench.results.result import StudyResult
from swashtwin_bench.results.runs import Embedding, Outcome

_LEVEL_MARKERS = {"L0": "x", "L1": "s", "L2": "o", "L3": "D", "L4": "^", "L5": "P"}
"""Marker of each level of generalization."""

MOST_MATRICES = 4
"""Confusion matrices drawn beside each other at most."""

MOST_POINTS = 1200
"""Windows drawn in one t-SNE panel at most, taken evenly; a third of it where there is more than one row of panels."""

MOST_PANELS = 20
"""t-SNE panels drawn at most, taken evenly, in rows of `_ACROSS`."""

_ACROSS = 4


_MARK_WIDTH = 7
"""Letters that a legend's mark takes."""


def accuracy_drawing(study: StudyResult, key: str) -> Drawing:
    """Accuracy and G-mean by level and training set."""
    metrics = {"accuracy": lambda outcome: outcome.scores.accuracy, "G-mean": lambda outcome: outcome.scores.g_mean}
    return _bars(study, f"{key}_scores", metrics, title="Accuracy and G-mean by training set")


def scarce_drawing(study: StudyResult, key: str) -> Drawing:
    """Recall in the scarce cell by level and training set."""
    metrics = {"recall in the scarce cell": lambda outcome: outcome.scarce_recall}
    return _bars(study, f"{key}_scarce_recall", metrics, title="Recall of the measured windows of the scarce cell")


@figure_style()
def _bars(study: StudyResult, name: str, metrics: dict[str, Callable[[Outcome], float]], *, title: str) -> Drawing:
    sets = list(dict.fromkeys(outcome.training_set for outcome in study.outcomes))
    levels, marks = sorted({outcome.level for outcome in study.outcomes}), _marks(study)
    figure, axes = panels(len(metrics), 1, 0.8 + 2.5 * len(metrics), sharex=True)
    rows, step = [], 0.78 / max(3, len(sets))
    for ax, (metric, value) in zip(axes[:, 0], metrics.items(), strict=True):
        for i, level in enumerate(levels):
            for j, training_set in enumerate(sets):
                for mark in ("", *marks):
                    bars = [
                        outcome
                        for outcome in (study.rivals if mark else study.outcomes)
                        if (outcome.level, outcome.training_set) == (level, training_set)
                        and outcome.classifier == (mark or study.main_classifier)
                    ]
                    rows += [
                        {
                            "metric": metric,
                            "level": level,
                            "training_set": training_set,
                            "classifier": outcome.classifier,
                            "seed": outcome.seed,
                            "value": value(outcome),
                        }
                        for outcome in bars
                    ]
                    position = i + step * (j - (len(sets) - 1) / 2)
                    color = series_colors(sets)[training_set]
                    _column(ax, position, 0.9 * step, bars, value, color, marks.get(mark, ""))
        chance = metric == "accuracy"
        _score_axis(ax, metric, levels, 1 / len(study.outcomes[0].scores.classes) if chance else None)
    _bar_legend(axes[0, 0], study, sets)
    caption = (
        f"Bars: mean of {classifier_words(study.main_classifier)} over {plural(len(study.seeds), 'seed')}; "
        "points: single seeds; whiskers: one standard deviation, cut at 0 and 1."
    )
    if study.rivals:
        rivals = ", ".join(dict.fromkeys(classifier_words(rival.classifier) for rival in study.rivals))
        caption += f" Open marks: means of {rivals}, trained on the same windows."
    return render_drawing(name, figure, tabulate(rows), title=title, caption=caption)


def _marks(study: StudyResult) -> dict[str, str]:
    """Marker of each rival."""
    return dict(zip(dict.fromkeys(rival.classifier for rival in study.rivals), "Ds^vP*X", strict=False))


def _column(
    ax: Axes,
    position: float,
    width: float,
    outcomes: Sequence[Outcome],
    value: Callable[[Outcome], float],
    color: str,
    rival_mark: str,
) -> None:
    values = np.array([value(outcome) for outcome in outcomes if math.isfinite(value(outcome))])
    if not values.size:
        if not rival_mark:
            ax.text(position, 0.02, "—", ha="center")
        return
    mean = values.mean()
    if rival_mark:
        ax.plot(position + 0.35 * width, mean, rival_mark, color="white", mec="black", ms=6, zorder=4)
        return
    ax.bar(position, mean, width=width, color=color, alpha=0.85)
    deviation = values.std(ddof=1) if values.size > 1 else 0.0
    if values.size > 1:
        whisker = [[min(deviation, mean)], [min(deviation, 1 - mean)]]
        ax.errorbar(position, mean, yerr=whisker, color="black", capsize=3, linewidth=1.2, zorder=3)
        aside = position - 0.25 * width + 0.08 * width * np.linspace(-1, 1, values.size)
        ax.plot(aside, values, "o", color="white", markeredgecolor="black", markersize=4, zorder=3, clip_on=False)
    ax.text(position, max(min(mean + deviation, 1), values.max()) + 0.04, f"{mean:.2f}", ha="center", fontsize=9)


def _score_axis(ax: Axes, metric: str, levels: Sequence[str], chance: float | None) -> None:
    ax.set(ylim=(0, 1.16), ylabel=f"{metric} [1]")
    meanings = [textwrap.fill(f"{level}: {LEVELS.get(level, 'not described')}", 42) for level in levels]
    ax.set_xticks(range(len(levels)), meanings)
    ax.set_yticks([0, 0.2, 0.4, 0.6, 0.8, 1])
    ax.set_xlim(-0.55, len(levels) - 0.45 + 0.14)
    ax.grid(axis="x", visible=False)
    if chance is not None:
        ax.axhline(chance, color="black", linewidth=0.8, linestyle=":")
        ax.text(len(levels) - 0.32, chance + 0.01, "guessing", ha="right", va="bottom", fontsize=8)


def _bar_legend(ax: Axes, study: StudyResult, sets: Sequence[str]) -> None:
    colors = series_colors(sets)
    entries = [Line2D([], [], marker="s", linestyle="", markersize=9, color=colors[name]) for name in sets]
    names = [training_set_words(name) for name in sets]
    for rival, mark in _marks(study).items():
        entries.append(Line2D([], [], marker=mark, linestyle="", color="white", markeredgecolor="black"))
        names.append(classifier_words(rival))
    widths = [len(name) + _MARK_WIDTH for name in names]
    across = len(names) if sum(widths) <= LEGEND_WIDTH else max(1, LEGEND_WIDTH // max(widths))
    ax.figure.legend(entries, names, loc="outside upper center", ncols=across)


@figure_style()
def training_drawing(study: StudyResult, key: str) -> Drawing:
    """Loss and accuracy over the epochs, for each training set or classifier, and seed."""
    by = "training_set" if len({curve.training_set for curve in study.curves}) > 1 else "classifier"
    curves = [curve for curve in study.curves if by == "classifier" or curve.classifier == study.main_classifier]
    sets = list(dict.fromkeys(curve.factors[by] for curve in curves))
    colors = series_colors(sets)
    figure, axes = panels(1, 2, 3.4, sharex=True)
    validated = False
    for curve in curves:
        number = [epoch.number for epoch in curve.epochs]
        for ax, name in zip(axes[0], ("loss", "accuracy"), strict=True):
            color = colors[curve.factors[by]]
            ax.plot(number, [getattr(epoch, name) for epoch in curve.epochs], color=color, linewidth=1, alpha=0.8)
            validation = [getattr(epoch, f"validation_{name}") for epoch in curve.epochs]
            if None not in validation:
                validated = True
                ax.plot(number, validation, ":", color=color, linewidth=1, alpha=0.8)
    axes[0, 0].set(xlabel="epoch", ylabel="cross-entropy [1]", yscale="log")
    axes[0, 0].xaxis.set_major_locator(MaxNLocator(integer=True))
    name_decades(axes[0, 0])
    axes[0, 1].set(xlabel="epoch", ylabel="accuracy", ylim=(0, 1.03))
    axes[0, 1].yaxis.set_major_formatter(PercentFormatter(1, symbol=" %"))
    entries = [Line2D([], [], color=colors[name], linewidth=2) for name in sets]
    named = training_set_words if by == "training_set" else classifier_words
    figure.legend(entries, [named(name) for name in sets], loc="outside upper center", ncols=min(len(sets), 4))
    rows = [
        {"classifier": curve.classifier, "training_set": curve.training_set, "seed": curve.seed,
         "epoch": e.number, "loss": e.loss,
         "accuracy": e.accuracy, "validation_loss": e.validation_loss, "validation_accuracy": e.validation_accuracy}
        for curve in curves
        for e in curve.epochs
    ]  # fmt: skip
    caption = (
        f"One line for each of {plural(len(study.seeds), 'seed')}: the training windows, synthetic ones included, "
        "while the weights move. These are no test scores." + (" Dotted: validation windows." if validated else "")
    )
    return render_drawing(f"{key}_training", figure, tabulate(rows), title="Training curves", caption=caption)


def confusion_of(study: StudyResult, key: str) -> Drawing:
    """Confusion matrix of the study's network for each level and training set, all seeds added."""
    matrices: dict[tuple[str, str], np.ndarray] = {}
    columns = _confusion_names(study)
    for outcome in sorted(study.outcomes, key=lambda outcome: outcome.level):
        column = _column_of(outcome)
        if column in columns:
            cell = (outcome.level, columns[column])
            matrices[cell] = matrices.get(cell, 0) + outcome.scores.confusion
    seeds = plural(len(study.seeds), "seed")
    caption = f"Windows of each actual class in percent, over {seeds} together; rows add up to 100."
    return confusion_drawing(f"{key}_confusion", matrices, study.outcomes[0].scores.classes, caption=caption)


def _column_of(outcome: Outcome) -> tuple[str, ...]:
    return tuple(value for name, value in outcome.factors.items() if name != "level")


def _confusion_names(study: StudyResult) -> dict[tuple[str, ...], str]:
    """Rows whose confusions are drawn, and what they are called: all of a few, else the first one and the best."""
    names = list(dict.fromkeys(_column_of(outcome) for outcome in study.outcomes))
    if len(names) > MOST_MATRICES:
        accuracy = {
            name: np.mean([outcome.scores.accuracy for outcome in study.outcomes if _column_of(outcome) == name])
            for name in names
        }
        names = list(dict.fromkeys([names[0], *sorted(names, key=lambda name: -accuracy[name])]))[:MOST_MATRICES]
    return _distinct_titles(names)


def _distinct_titles(names: Sequence[tuple[str, ...]]) -> dict[tuple[str, ...], str]:
    """Rows by (classifier, training set, what else is varied), in words that say only what differs between them."""
    name_words = {
        name: (classifier_words(name[0]), training_set_words(name[1]), *map(words, name[2:])) for name in names
    }
    varying = [i for i in range(len(names[0])) if len({name[i] for name in names}) > 1] or [1]
    return {name: ", ".join(values[i] for i in varying) for name, values in name_words.items()}


@figure_style()
def embedding_drawing(study: StudyResult, key: str) -> Drawing:
    """t-SNE of the test windows' features, for each training set, or for each network where there is one only."""
    titles = _distinct_titles([tuple(run.task.factors.values()) for run in study.embedded_runs])
    embeddings = [embedding for embedding in (run.embedding for run in study.embedded_runs) if can_embed(embedding)]
    selected_embeddings = [embeddings[i] for i in _spread_evenly(len(embeddings), MOST_PANELS)]
    classes = list(study.outcomes[0].scores.classes)
    colors = class_colors(classes)
    levels = sorted({str(level) for embedding in selected_embeddings for level in embedding.level})
    down = math.ceil(len(selected_embeddings) / _ACROSS)
    figure, axes = panels(down, min(len(selected_embeddings), _ACROSS), 3.9 if down == 1 else 0.9 + 2.6 * down)
    most = MOST_POINTS if down == 1 else MOST_POINTS // 3
    rows = []
    for ax in axes.flat[len(selected_embeddings) :]:
        ax.set_axis_off()
    for ax, embedding in zip(axes.flat, selected_embeddings, strict=False):
        named = dict(embedding.factors)
        picked = _spread_evenly(len(embedding.label), most)
        points = _tsne(embedding.features[picked])
        label, level = embedding.label[picked].astype(str), embedding.level[picked].astype(str)
        for name in classes:
            for level_name in levels:
                selected = (label == name) & (level == level_name)
                marker = _LEVEL_MARKERS.get(level_name, "o")
                ax.plot(*points[selected].T, marker, color=colors[name], markersize=4, alpha=0.75, markeredgewidth=0.3)
        ax.set(title=textwrap.fill(titles[tuple(named.values())], 28), xticks=[], yticks=[])
        rows += [{**named, "level": level[i], "label": label[i], "x": x, "y": y} for i, (x, y) in enumerate(points)]
    marks = [Line2D([], [], marker="o", linestyle="", color=colors[name]) for name in classes]
    kinds = [Line2D([], [], marker=_LEVEL_MARKERS.get(level, "o"), linestyle="", color="#888888") for level in levels]
    names = [words(name) for name in classes] + levels
    figure.legend(marks + kinds, names, loc="outside lower center", ncols=len(names))
    caption = (
        f"Test windows under seed {study.seeds[0]} as the network's last layer sees them, laid out in two dimensions "
        "by t-SNE (fixed seed). Neighborhoods mean something; distances between groups, their sizes and axes do not."
    )
    if len(selected_embeddings) < len(titles):
        caption += f" {len(selected_embeddings)} of {len(titles)} trainings" + (
            "." if len(embeddings) == len(titles) else "; of the others no features were kept, or all are the same."
        )
    return render_drawing(
        f"{key}_tsne", figure, tabulate(rows), title="Features of the test windows (t-SNE)", caption=caption
    )


def can_embed(embedding: Embedding | None) -> TypeGuard[Embedding]:
    """Whether there is enough for a layout to mean anything."""
    return embedding is not None and len(embedding.label) >= 10 and bool(np.ptp(embedding.features, axis=0).any())


def _spread_evenly(count: int, most: int) -> np.ndarray:
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))


def _tsne(features: np.ndarray) -> np.ndarray:
    perplexity = min(30.0, (len(features) - 1) / 3)
    points: np.ndarray = TSNE(perplexity=perplexity, init="pca", random_state=0, n_jobs=1).fit_transform(features)
    return points.astype(np.float64)
