"""Tables of the paper's figures beside ours, a row for each figure or claim; ours are read from runs."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from swashtwin.plot import words
from swashtwin.report import Cell, Table, score
from swashtwin_bench.paper.plans import MAIN
from swashtwin_bench.results.contrasts import paired_interval
from swashtwin_bench.results.naming import classifier_words, training_set_words
from swashtwin_bench.results.reported import paper_figures
from swashtwin_bench.results.result import METRICS, StudyResult

Key = Mapping[str, str]


def beside_table(
    study: StudyResult, random: StudyResult | None = None, metrics: Sequence[str] = ("accuracy",)
) -> Table:
    """Each row of a study: the paper's figure, and ours at each level.

    Parameters
    ----------
    study : split by recording.
    random : the same study on random windows; with it the leak stands in the last column, else the points less the
        paper's BiTCN where several networks were trained.
    metrics : names in `METRICS`.
    """
    near, far = sorted({outcome.level for outcome in study.outcomes})
    several = random is None and len({outcome.classifier for outcome in study.outcomes}) > 1
    rows = []
    for row in (row for row in study.rows() if row["level"] == near):
        key = {name: str(row[name]) for name in study.factors}
        printed = paper_figures(study, key)
        for metric in metrics:
            cells = [_cell(study, key, metric), _cell(study, {**key, "level": far}, metric)]
            if random is not None:
                at_random = {**key, "level": "L0"}
                cells = [_cell(random, at_random, metric), *cells, _leak(study, key, random, at_random, metric)]
            elif several:
                cells.append(_points(study, key, metric))
            name = _row_words(study, key) + (f": {METRICS[metric]}" if len(metrics) > 1 else "")
            count = Cell(str(len(_values(study, key, metric))))
            rows.append((Cell(name), Cell(printed.get(metric, "not printed")), *cells, count))
    last = ("leak (L0 less L2), points",) if random is not None else ("points less BiTCN, L2",) if several else ()
    ours = (*(("L0, random windows",) if random is not None else ()), "L2, other recordings", "L4, other pumps")
    return Table(
        "Ours: mean ± standard deviation over n. A single accuracy has its 95 % interval over the test's recordings. "
        "Differences are paired, with Student's 95 % interval. n counts "
        f"{_counted(study)}.",
        ("row", "the paper, its rig", *ours, *last, "n"),
        tuple(rows),
    )


def level_sentence(study: StudyResult, random: StudyResult | None = None) -> str:
    """The last row of the paper's network that the paper prints a figure for, in a sentence.

    Its accuracy at each level, and the points that other networks of the same training set and test are above it.
    """
    near, far = sorted({outcome.level for outcome in study.outcomes})
    for row in reversed(study.rows()):
        key = {name: str(row[name]) for name in study.factors}
        figure = paper_figures(study, key).get("accuracy", "") if row["classifier"] == MAIN else ""
        if row["level"] == near and figure:
            tests = [f"{_accuracy(study, key)} on other recordings (L2)"]
            tests.append(f"{_accuracy(study, {**key, 'level': far})} on other pumps (L4)")
            if random is not None:
                tests.append(f"{_accuracy(random, {**key, 'level': 'L0'})} on random windows (L0)")
            named = [training_set_words(key["training_set"])]
            named += [words(key[name]) for name in key if name not in ("classifier", "training_set", "level")]
            count = len(_values(study, key, "accuracy"))
            first = f"{', '.join(named)}: accuracy {', '.join(tests)}; n = {count}; the paper: {figure}."
            others = [_other(study, {**key, "classifier": name}) for name in _other_classifiers(study)]
            return " ".join((first, *([f"Points less BiTCN at L2: {'; '.join(others)}."] if others else [])))
    return ""


def _other_classifiers(study: StudyResult) -> list[str]:
    return [name for name in dict.fromkeys(trial.factors["classifier"] for trial in study.trials) if name != MAIN]


def _other(study: StudyResult, key: Key) -> str:
    claim = paper_figures(study, key).get("accuracy", "")
    return f"{classifier_words(key['classifier'])} {_points(study, key, 'accuracy').text}" + (
        f", the paper: {claim}" if claim else ""
    )


def _counted(study: StudyResult) -> str:
    return "trainings on the same data" if "split_seed" in study.runs[0].task.settings else "fleets of pumps"


def _row_words(study: StudyResult, key: Key) -> str:
    parts = [classifier_words(key["classifier"]), training_set_words(key["training_set"])]
    parts += [words(value) for name, value in key.items() if name not in ("classifier", "training_set", "level")]
    varied = [len({trial.factors[name] for trial in study.trials}) > 1 for name in key if name != "level"]
    return ", ".join(part for part, differs in zip(parts, varied, strict=True) if differs) or parts[0]


def _values(study: StudyResult, key: Key, metric: str) -> dict[int, float]:
    """Value under each seed."""
    return {trial.seed: trial.values[metric] for trial in study.of(**key)}


def _accuracy(study: StudyResult, key: Key) -> str:
    return _cell(study, key, "accuracy").text


def _cell(study: StudyResult, key: Key, metric: str) -> Cell:
    values = [value for value in _values(study, key, metric).values() if math.isfinite(value)]
    if not values:
        return Cell("—", "not run, or not defined for this test")
    mean = float(np.mean(values))
    if len(values) == 1:
        low, high = _test_interval(study, key) if metric == "accuracy" else (math.nan, math.nan)
        return Cell(score(mean) + (f" ({low:.2f} to {high:.2f})" if low == low else ""), "one training")
    low, high = paired_interval(values)
    single = ", ".join(map(score, values))
    return Cell(f"{score(mean)} ± {score(float(np.std(values, ddof=1)))}", f"95 % {low:.3f} to {high:.3f}; {single}")


def _test_interval(study: StudyResult, key: Key) -> tuple[float, float]:
    """Of the accuracy of one test without draws of noise, over its recordings; NaN otherwise."""
    outcomes = [outcome for outcome in study.outcomes if dict(outcome.factors) == dict(key)]
    return outcomes[0].scores.accuracy_interval if len(outcomes) == 1 else (math.nan, math.nan)


def _leak(study: StudyResult, key: Key, random: StudyResult, at_random: Key, metric: str) -> Cell:
    honest, leaky = _values(study, key, metric), _values(random, at_random, metric)
    return _difference([leaky[seed] - honest[seed] for seed in honest if seed in leaky])


def _points(study: StudyResult, key: Key, metric: str) -> Cell:
    if key["classifier"] == MAIN:
        return Cell("")
    whole, part = _values(study, {**key, "classifier": MAIN}, metric), _values(study, key, metric)
    return _difference([part[seed] - whole[seed] for seed in part if seed in whole])


def _difference(differences: Sequence[float]) -> Cell:
    finite = [value for value in differences if math.isfinite(value)]
    if not finite:
        return Cell("—", "one of both was not run, or is not defined")
    low, high = (100 * value for value in paired_interval(finite))
    interval = f" ({low:+.1f} to {high:+.1f})" if low == low else ""
    return Cell(f"{100 * float(np.mean(finite)):+.1f}{interval}", f"{len(finite)} pairs")
