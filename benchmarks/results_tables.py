"""Tables and intervals of docs/bench/results.md, from the finished runs that its commands leave.

    python benchmarks/results_tables.py studies

`studies` is the folder that was given to ``swashtwin bench ... --out``. Every study that is found there is printed in
Markdown: its table, and the differences that the text beside it quotes, in points, paired by seed, with 95 %
intervals; bold where an interval excludes zero. Nothing is computed anew.
"""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.bench import StudyResult, collect_studies
from swashtwin.bench.results.naming import classifier_words, training_set_words
from swashtwin.bench.rivals.models import CHOSEN, DEFAULT

LEVELS = ("L2", "L3", "L4")
LONG = {
    "case1": ("accuracy", "f1", "g_mean", "scarce_recall", "recording_accuracy"),
    "case2": ("accuracy", "f1", "g_mean", "scarce_recall", "recording_accuracy"),
    "unseen-pressure": ("accuracy", "g_mean"),
    "calibrators": ("accuracy", "g_mean", "scarce_recall"),
    "noise": ("accuracy", "recording_accuracy"),
}
"""Studies with one line a row, and the metrics that stand there."""

CURVES = {"few-shot": "real_windows", "unseen-specimen": "pumps", "shaft-angle": "domain"}
"""Studies with one column for each value of what they vary: accuracy."""

AGAINST = {"algorithms": (DEFAULT,), "ablation": (DEFAULT, "bitcn")}
"""Studies whose rows are differences from one of these, those of the paper's network from that."""

CHOSEN_AGAINST = [({"classifier": CHOSEN}, {"classifier": name}) for name in (DEFAULT, "levels", "extra_trees")]
"""The default training against the default network so far, its own kind of network alone, and trees."""

CALIBRATED, MEASURED, NOMINAL = ({"training_set": name} for name in ("calibrated", "measured", "nominal"))
Change = Mapping[str, str]


def at_budget(training_set: str, budget: str) -> Change:
    """A row of the augmentation."""
    return {"training_set": training_set, "synthetic": budget}


FURTHER: Mapping[str, Sequence[tuple[Change, Change]]] = {
    "case1": [
        (CALIBRATED, MEASURED),
        (CALIBRATED, NOMINAL),
        ({"training_set": "posterior"}, CALIBRATED),
        *CHOSEN_AGAINST,
    ],
    "case2": [(CALIBRATED, MEASURED), (CALIBRATED, NOMINAL)],
    "algorithms": [
        ({"classifier": "bitcn"}, {"classifier": name}) for name in ("tcn", "lstm", "bilstm", "bigru", "resnet1d")
    ],
    "shaft-angle": [({"domain": "angle"}, {"domain": "time"})],
    "noise": [
        ({"classifier": "spectral_noise", **CALIBRATED}, {"classifier": DEFAULT, "training_set": name})
        for name in ("calibrated", "calibrated_noise")
    ]
    + CHOSEN_AGAINST,
    "few-shot": [
        (CALIBRATED, MEASURED),
        (CALIBRATED, NOMINAL),
        *(({**CALIBRATED, "real_windows": "0"}, {**MEASURED, "real_windows": count}) for count in ("50", "100", "200")),
    ],
    "augmentation": [
        *(
            (at_budget(name, "150"), at_budget(*other))
            for name in ("every_class", "calibrated", "posterior", "nominal", "wgan_gp", "cvae", "jitter")
            for other in (("measured", "0"), ("nominal", "150"), ("wgan_gp", "150"))
            if name != other[0]
        ),
        (at_budget("class_weights", "0"), at_budget("measured", "0")),
    ],
    "unseen-pressure": [
        (CALIBRATED, MEASURED),
        (CALIBRATED, NOMINAL),
        ({"training_set": "posterior"}, CALIBRATED),
        ({"training_set": "every_class"}, CALIBRATED),
    ],
    "unseen-specimen": [(CALIBRATED, MEASURED)],
    "calibrators": [
        ({"calibrator": "gauss_newton"}, {"calibrator": "ipinn"}),
        ({"calibrator": "healthy"}, {"calibrator": "ipinn"}),
        ({"calibrator": "healthy"}, {"calibrator": "gauss_newton"}),
        *(
            ({"training_set": name, "calibrator": way}, {**MEASURED, "calibrator": "none"})
            for name in ("calibrated", "every_class")
            for way in ("ipinn", "gauss_newton", "healthy")
        ),
    ],
}
"""Differences that are told: what the first row has in place of what the second has, all else alike."""

FURTHER_METRICS = {
    "case1": ("recording_accuracy", "scarce_recall"),
    "noise": ("recording_accuracy",),
    "augmentation": ("scarce_recall",),
}


def rows_of(study: StudyResult) -> list[dict[str, Any]]:
    """Every row, the rivals' among them, by level and classifier."""
    rows = [*study.rows(), *study.rows(rivals=True)]
    classifiers = list(dict.fromkeys(row["classifier"] for row in rows))
    return sorted(rows, key=lambda row: (LEVELS.index(row["level"]), classifiers.index(row["classifier"])))


def named(row: Mapping[str, Any], factors: Sequence[str]) -> list[str]:
    """The row's factors in words."""
    words = {"classifier": classifier_words, "training_set": training_set_words}
    return [words.get(name, lambda value: value.replace("_", " "))(row[name]) for name in factors]


def mean_std(spread: Mapping[str, Any]) -> str:
    """Mean ± standard deviation."""
    if spread["mean"] is None:
        return "–"
    return f"{spread['mean']:.3f}" + ("" if spread["std"] is None else f" ± {spread['std']:.3f}")


def difference(study: StudyResult, first: Mapping[str, str], second: Mapping[str, str], metric: str) -> str:
    """Difference of two rows in points, with its interval."""
    contrast = study.contrast(first, second, metric=metric)
    low, high = contrast.interval
    words = f"{100 * contrast.mean:+.1f} ({100 * low:+.1f} to {100 * high:+.1f})"
    return f"**{words}**" if contrast.is_clear else words


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table."""
    names = [name.replace("_", " ") for name in header]
    return "\n".join("| " + " | ".join(line) + " |" for line in (names, ["---"] * len(names), *rows))


def seeds(row: Mapping[str, Any]) -> str:
    """Seeds behind a row."""
    return str(len(row["accuracy"]["values"]))


def long_table(study: StudyResult) -> str:
    """One line a row."""
    metrics = LONG[study.study]
    factors = ("level", "classifier", "training_set", *_varied(study))
    lines = [
        [*named(row, factors), *(mean_std(row[metric]) for metric in metrics), seeds(row)] for row in rows_of(study)
    ]
    return markdown([*factors, *(study.metrics[metric] for metric in metrics), "n"], lines)


def curve_table(study: StudyResult) -> str:
    """Accuracy along what is varied."""
    factor, rows = CURVES[study.study], rows_of(study)
    values = list(dict.fromkeys(row[factor] for row in rows))
    if all(value.isdigit() for value in values):
        values.sort(key=int)
    factors = ("level", "classifier", "training_set")
    by_line: dict[tuple[str, ...], dict[str, dict[str, Any]]] = {}
    for row in rows:
        by_line.setdefault(tuple(named(row, factors)), {})[row[factor]] = row
    lines = [
        [
            *line,
            *(mean_std(rows_of_line[value]["accuracy"]) if value in rows_of_line else "" for value in values),
            seeds(next(iter(rows_of_line.values()))),
        ]
        for line, rows_of_line in by_line.items()
    ]
    return markdown([*factors, *values, "n"], lines)


def against_table(study: StudyResult) -> str:
    """One line a classifier: scores at both levels, how it differs from the whole one, and medians of the times."""
    rows = {(row["classifier"], row["level"]): row for row in rows_of(study)}
    levels = [level for level in LEVELS if any(key[1] == level for key in rows)]
    rivals = study.study == "algorithms"  # rivals stand below ours, ablations differ from the whole network
    lines = []
    for name in dict.fromkeys(key[0] for key in rows):
        whole = next(
            (rival for rival in reversed(AGAINST[study.study]) if name.startswith(f"{rival}_")),
            DEFAULT,
        )
        line = [classifier_words(name), seeds(rows[name, levels[0]])]
        for level in levels:
            pair = [{"classifier": classifier, **CALIBRATED, "level": level} for classifier in (name, whole)]
            differs = name not in (DEFAULT, whole) and (rivals or name not in AGAINST[study.study])
            other = difference(study, *(reversed(pair) if rivals else pair), "accuracy") if differs else ""
            line += [mean_std(rows[name, level]["accuracy"]), mean_std(rows[name, level]["g_mean"]), other]
        runs = [run for run in study.runs if run.task.factors["classifier"] == name]
        times = [np.median([getattr(run, unit) for run in runs]) for unit in ("cpu_s", "wall_s")]
        mean = rows[name, levels[0]]["accuracy"]["mean"]
        lines.append((-mean if rivals and name != DEFAULT else -1.0, [*line, *(f"{time:.0f}" for time in times)]))
    header = ["classifier", "n"]
    for level in levels:
        header += [f"accuracy, {level}", f"G-mean, {level}", "ours less it" if rivals else "less the whole one"]
    ordered = [line for _, line in sorted(lines, key=lambda line: line[0])]
    return markdown([*header, "processor [s]", "clock [s]"], ordered)


def budget_table(study: StudyResult) -> str:
    """Mean accuracy by training set and number of synthetic windows, and what is known of the windows themselves."""
    rows = rows_of(study)
    budgets = [value for value in dict.fromkeys(row["synthetic"] for row in rows) if value != "0"]
    lines = []
    for kind, name in dict.fromkeys((row["classifier"], row["training_set"]) for row in rows):
        rows_by_cell = {
            (row["level"], row["synthetic"]): row
            for row in rows
            if (row["classifier"], row["training_set"]) == (kind, name)
        }
        line = [classifier_words(kind), training_set_words(name)]
        for level in ("L2", "L4"):
            line += [
                f"{rows_by_cell.get((level, budget), rows_by_cell.get((level, '0')))['accuracy']['mean']:.3f}"
                for budget in budgets
            ]
        middle = rows_by_cell.get(("L4", budgets[len(budgets) // 2]), rows_by_cell.get(("L4", "0")))
        further = [middle["scarce_recall"], middle.get("discriminator", {"mean": None})]
        lines.append(
            [*line, *("" if spread["mean"] is None else f"{spread['mean']:.3f}" for spread in further), seeds(middle)]
        )
    columns = [f"{level}, {budget}" for level in ("L2", "L4") for budget in budgets]
    return markdown(["classifier", "training set", *columns, "recall in the cell, L4", "AUROC", "n"], lines)


def differences(study: StudyResult) -> Iterator[str]:
    """The differences that are quoted, one a line."""
    rows = [{name: row[name] for name in study.factors} for row in rows_of(study)]
    for first, second in FURTHER.get(study.study, ()):
        for row in rows:
            other = {**row, **second}
            if not first.items() <= row.items() or other == row or other not in rows:
                continue
            fixed = ", ".join(named(row, [name for name in study.factors if name not in second]))
            left, right = (", ".join(named(factors, list(second))) for factors in (row, other))
            for metric in ("accuracy", *FURTHER_METRICS.get(study.study, ())):
                points = difference(study, row, other, metric)
                yield f"- {fixed}: {left} less {right}, {study.metrics[metric]}: {points}"


def _varied(study: StudyResult) -> list[str]:
    return [name for name in study.factors if name not in ("level", "classifier", "training_set")]


def summary(study: StudyResult) -> str:
    """Title, table and differences of a study."""
    if study.study in LONG:
        table = long_table(study)
    elif study.study in CURVES:
        table = curve_table(study)
    elif study.study in AGAINST:
        table = against_table(study)
    else:
        table = budget_table(study)
    return "\n\n".join([f"## {study.title}", table, "\n".join(differences(study))])


def main() -> None:
    """Read the folder and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="Folder of finished runs.")
    arguments = parser.parse_args()
    studies = {*LONG, *CURVES, *AGAINST, "augmentation"}
    for study in collect_studies(arguments.folder):
        if study.study in studies:
            print(summary(study), end="\n\n")


if __name__ == "__main__":
    main()
