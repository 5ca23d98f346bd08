"""What a study in the form of a table adds to the page."""

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from swashtwin.foundation import plural
from swashtwin.plot import CALIBRATED, MEASURED, figure_style, panels, words
from swashtwin.report import (
    Bullets,
    Cell,
    Drawing,
    Group,
    Part,
    Picture,
    Section,
    SectionOrder,
    Table,
    confusion_drawing,
    facts_table,
    flatten_settings,
    number,
    render_drawing,
)
from swashtwin_bench.results.question_figures import severity_drawing
from swashtwin_bench.results.table import StudyTable

MOST_ROWS = 40
"""Rows that are drawn; a longer table is drawn up to there."""


def table_part(study: StudyTable, key: str) -> Part:
    """Part of one study."""
    return Part(
        title=study.title,
        answer=study.answer,
        notice=study.origin,
        sections=(
            Section(SectionOrder.SCORES, study.title, _blocks(study, key)),
            Section(SectionOrder.PROVENANCE, "Where this comes from, and how to repeat it", _provenance(study)),
        ),
        results={"studies": [study.to_dict()]},
    )


def _blocks(study: StudyTable, key: str) -> tuple:
    drawings = (draw(study, key) for draw in QUESTION_DRAWINGS.get(study.study, ()))
    pictures = map(Picture, (*drawings, rows_drawing(study, key), *confusions(study, key)))
    return (rows_table(study), *pictures, Bullets("To be read with it", study.notes))


QUESTION_DRAWINGS: Mapping[str, tuple[Callable[[StudyTable, str], Drawing], ...]] = MappingProxyType(
    {"severity": (severity_drawing,)}
)
"""Figures of a study besides those of its rows, by the study's name."""


def confusions(study: StudyTable, key: str) -> list[Drawing]:
    """Confusion matrices that a study kept in its details, first factor down, last factor across, a figure for each
    value of those between.

    ``details["confusion"]`` holds the factors and, under ``windows``, rows by actual class; those with ``drawn`` are
    drawn. ``details["classes"]`` holds the classes' names.
    """
    if "confusion" not in study.details:
        return []
    first, *between, last = study.factors
    figures: dict[str, dict[tuple[str, str], np.ndarray]] = {}
    for detail in study.details["confusion"]:
        if detail["drawn"]:
            figure = figures.setdefault(", ".join(words(detail[name]) for name in between), {})
            figure[words(detail[first]), words(detail[last])] = np.array(detail["windows"])
    return [
        confusion_drawing(
            f"{key}_confusion_{number}",
            matrices,
            study.details["classes"],
            caption=f"{name}: percent of each actual class's windows, all seeds together.",
        )
        for number, (name, matrices) in enumerate(figures.items(), 1)
    ]


def rows_table(study: StudyTable) -> Table:
    """Mean and standard deviation of each metric for each row."""
    rows = []
    for row in study.rows():
        named = [Cell(words(row[factor])) for factor in study.factors]
        rows.append((*named, *(_spread_cell(row[metric]) for metric in study.metrics)))
    return Table(
        f"Mean ± standard deviation over the trials of {plural(len(study.seeds), 'seed')}.",
        (*map(words, study.factors), *study.metrics.values()),
        tuple(rows),
    )


def _spread_cell(spread: dict) -> Cell:
    if spread["mean"] is None:
        return Cell("—", "no number for this row")
    text = number(spread["mean"]) + (f" ± {number(spread['std'])}" if spread["std"] is not None else "")
    count = sum(value is not None for value in spread["values"])
    return Cell(text, f"{plural(count, 'trial')}: " + ", ".join(number(value) for value in spread["values"][:20]))


@figure_style()
def rows_drawing(study: StudyTable, key: str) -> Drawing:
    """Each metric in a panel, each row on a line of it: trials as points, their mean as a bar across."""
    rows = study.rows()[:MOST_ROWS]
    names = [", ".join(words(row[factor]) for factor in study.factors) for row in rows]
    per_line = min(2, len(study.metrics))
    lines = math.ceil(len(study.metrics) / per_line)
    figure, axes = panels(lines, per_line, lines * (1.1 + 0.24 * len(rows)), sharey=True)
    for ax, (metric, heading) in zip(axes.flat, study.metrics.items(), strict=False):
        points = [
            (float(value), line)
            for line, row in enumerate(rows)
            for value in row[metric]["values"]
            if value is not None
        ]
        value, lines_of = np.array(points or np.empty((0, 2))).T
        ax.plot(value, lines_of, "o", color=MEASURED, markersize=3, alpha=0.35)
        filled = np.unique(lines_of)
        means = [value[lines_of == line].mean() for line in filled]
        ax.vlines(means, filled - 0.32, filled + 0.32, color=CALIBRATED, linewidth=2.5)
        ax.set(title=heading, yticks=range(len(rows)), yticklabels=names, ylim=(len(rows) - 0.5, -0.5))
    for ax in axes.flat[len(study.metrics) :]:
        ax.set_visible(False)
    table = [
        {**trial.factors, "seed": trial.seed, "metric": metric, "value": trial.values.get(metric)}
        for trial in study.trials
        for metric in study.metrics
    ]
    columns = {name: [row[name] for row in table] for name in table[0]}
    return render_drawing(
        f"{key}_rows",
        figure,
        columns,
        title=study.title,
        caption="Points: single trials; blue bars: their mean.",
    )


def _provenance(study: StudyTable) -> tuple:
    entries = [
        ("command", study.command or "not recorded"),
        ("study", study.study),
        ("seeds", list(study.seeds)),
        ("swashtwin version", study.version),
        ("device", study.device),
        ("time taken", f"{number(study.wall_s)} s"),
        ("recordings", study.origin),
    ]
    settings = facts_table("Settings of the study.", flatten_settings(study.settings))
    return (facts_table("The run.", entries), Group("Settings", (settings,), is_open=False))
