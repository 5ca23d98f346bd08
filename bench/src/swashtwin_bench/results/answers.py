"""The answer of a study of classifiers in sentences, whichever way it went.

`answer_of` compares the rows of any study. `case_answer` is that of the paper's cases: whether calibrated twins beat
nominal ones, and these measured windows alone.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

import numpy as np

from swashtwin.foundation import plural
from swashtwin.learning import LEVELS
from swashtwin.report import score
from swashtwin_bench.results.contrasts import Contrast
from swashtwin_bench.results.naming import classifier_words, training_set_words
from swashtwin_bench.results.result import StudyResult
from swashtwin_bench.results.runs import Outcome

MOST_CONTRASTS = 4
"""Contrasts in the answer for each level, of classifiers the nearest ones; the table has all."""


def answer_of(study: StudyResult) -> tuple[str, ...]:
    """For each test the best row of those of as many seeds as any, and what the study compares, paired by seed."""
    rows = study.rows()
    tests = list(dict.fromkeys((row["level"], row.get("perturbation", "")) for row in rows))
    return tuple(_level_sentence(study, level, perturbation) for level, perturbation in tests)


def _level_sentence(study: StudyResult, level: str, perturbation: str) -> str:
    rows = [row for row in study.rows() if (row["level"], row.get("perturbation", "")) == (level, perturbation)]
    most = max(len(row["accuracy"]["values"]) for row in rows)
    of_all = [row for row in rows if len(row["accuracy"]["values"]) == most]
    best = max(of_all, key=lambda row: row["accuracy"]["mean"] or 0.0)
    where = f"{level}{f', {perturbation}' if perturbation else ''}"
    among = "" if len(of_all) == len(rows) else f" of those of {most} seeds"
    text = f"{where}: highest accuracy{among} {best['accuracy']['mean']:.3f} ({_row_words(study, best)})"
    matching = [
        contrast
        for contrast in study.contrasts
        if (contrast.first["level"], contrast.first.get("perturbation", "")) == (level, perturbation)
    ]
    if all(contrast.first["classifier"] != contrast.second["classifier"] for contrast in matching):
        matching.sort(key=lambda contrast: contrast.mean)
    words = [_contrast_words(contrast, matching) for contrast in matching[:MOST_CONTRASTS]]
    return f"{text}. {' '.join(words)}".strip()


def _row_words(study: StudyResult, row: Mapping[str, object]) -> str:
    return ", ".join(_words(name, str(row[name])) for name in study.factors if name not in ("level", "perturbation"))


def _words(factor: str, value: str) -> str:
    """A factor's value in words."""
    if factor == "classifier":
        return classifier_words(value)
    return training_set_words(value) if factor == "training_set" else value.replace("_", " ")


def _contrast_words(contrast: Contrast, others: Sequence[Contrast]) -> str:
    """A difference in points, with its interval, and which factor makes it."""
    factor = next(name for name in contrast.first if contrast.first[name] != contrast.second[name])
    fixed = [
        _words(name, contrast.first[name])
        for name in contrast.first
        if name not in (factor, "level", "perturbation") and len({other.first[name] for other in others}) > 1
    ]
    where = f" ({', '.join(fixed)})" if fixed else ""
    low, high = (100 * value for value in contrast.interval)
    first, second = (_words(factor, row[factor]) for row in (contrast.first, contrast.second))
    if low != low:
        return f"{first} less {second}{where}: {100 * contrast.mean:+.1f} points, one seed."
    clear = "" if contrast.is_clear else ", which may be chance"
    return f"{first} less {second}{where}: {100 * contrast.mean:+.1f} points ({low:+.1f} to {high:+.1f}){clear}."


EXPECTED = ("measured", "nominal", "calibrated")
"""Training sets in the order in which the paper's scores rise."""

_DESCRIBED = {
    "measured": "on measured windows only",
    "nominal": "with windows of a nominal (handbook) twin added",
    "calibrated": "with windows of a calibrated twin added",
}


def case_answer(study: StudyResult) -> tuple[str, ...]:
    """Answer in sentences: first the comparison and its result, then each level, the nearest first.

    That of any study where none of the `EXPECTED` training sets was trained.
    """
    sets = [name for name in EXPECTED if any(outcome.training_set == name for outcome in study.outcomes)]
    if not sets:
        return study.answer
    levels = sorted({outcome.level for outcome in study.outcomes})
    name = classifier_words(study.outcomes[0].classifier)
    lead = [f"{name} was trained {_enumerate([_DESCRIBED[name] for name in sets])}."]
    if {"calibrated", "measured"} <= set(sets):
        sentences = [f"at {level} calibrated {_comparison(study, level, 'calibrated', 'measured')}" for level in levels]
        lead += [f"Accuracy: {'; '.join(sentences)}."]
    lead += _better_rivals(study, levels, name)
    how = (
        "All tests are on measured recordings that had no part in training or calibration. Means over "
        f"{plural(len(study.seeds), 'seed')}, each with its own split, weights and synthesis; points are of accuracy, "
        "paired by seed."
    )
    return (" ".join(lead), *(_at_level(study, level) for level in levels), how)


def case_verdict(study: StudyResult) -> str:
    """What calibrated twins add to measured windows alone, in a few words; empty where one of both was not trained."""
    points = {
        contrast.first["level"]: contrast
        for contrast in study.contrasts
        if (contrast.first["training_set"], contrast.second["training_set"]) == ("calibrated", "measured")
        and contrast.first["classifier"] == contrast.second["classifier"] == study.main_classifier
    }
    if not points:
        return ""
    words = " and ".join(f"{100 * points[level].mean:+.1f} points at {level}" for level in sorted(points))
    return f"With calibrated twins {words}, {plural(len(study.seeds), 'seed')}"


def _at_level(study: StudyResult, level: str) -> str:
    mean, recall = (
        _means(study.outcomes, level, value) for value in (_accuracy, lambda outcome: outcome.scarce_recall)
    )
    sentences = [f"{level}, {LEVELS.get(level, 'not described')}: accuracy {_accuracy_words(mean)}."]
    if len(mean) == len(EXPECTED):
        sentences += [_order(study, level, mean), f"Calibrated {_comparison(study, level, 'calibrated', 'nominal')}."]
    if recall:
        sentences.append(f"Recall of the measured windows of the scarce cell: {_accuracy_words(recall)}.")
    if best := _best_rival(study, level):
        rival = f"{classifier_words(best[0])}, {training_set_words(best[1])}"
        sentences.append(f"Best rival: {rival}, accuracy {score(best[2])}.")
    return " ".join(sentences)


def _accuracy_words(means: dict[str, float]) -> str:
    return _enumerate([f"{score(value)} ({training_set_words(name)})" for name, value in means.items()])


def _comparison(study: StudyResult, level: str, first: str, second: str) -> str:
    """By how much `first` is above `second`, paired by seed, and whether its interval leaves that to chance."""
    contrast, reference = _contrast(study, level, first, second), "measured only" if second == "measured" else second
    if not contrast.pairs:
        return f"has no seed in common with {reference}"
    mean = 100 * contrast.mean
    if abs(mean) < 0.05 and not contrast.is_clear:
        return f"scored the same as {reference}"
    if contrast.pairs < 2:
        verb = "scored higher than" if mean > 0 else "scored lower than"
        return f"{verb} {reference} by {abs(mean):.1f} points (one seed: it may be chance)"
    if contrast.interval[0] == contrast.interval[1]:
        return f"differed from {reference} by {mean:+.1f} points under every seed (no spread to judge it by)"
    interval = " to ".join(f"{100 * value:+.1f}" for value in contrast.interval)
    if contrast.is_clear:
        verb = "beat" if mean > 0 else "fell behind"
        return f"{verb} {reference} by {abs(mean):.1f} points (95 % interval {interval})"
    return f"differed from {reference} by {mean:+.1f} points, which may be chance (95 % interval {interval})"


def _contrast(study: StudyResult, level: str, first: str, second: str) -> Contrast:
    """How much the study's own classifier gains by one training set over another."""
    rows = [{"classifier": study.main_classifier, "training_set": name, "level": level} for name in (first, second)]
    return study.contrast(*rows)


def _order(study: StudyResult, level: str, mean: dict[str, float]) -> str:
    """Whether the means rise as the paper's do, and whether each step is more than chance."""
    order = sorted(EXPECTED, key=lambda name: mean[name])
    signs = ["=" if mean[a] == mean[b] else "<" for a, b in pairwise(order)]
    paper = "measured only < nominal < calibrated"
    if tuple(order) != EXPECTED or "=" in signs:
        return (
            f"The paper's order, {paper}, was NOT found: it is {order[0]} {signs[0]} {order[1]} {signs[1]} {order[2]}."
        )
    if all(_contrast(study, level, b, a).is_clear for a, b in pairwise(EXPECTED)):
        return f"The order is the paper's, {paper}, and each step's interval excludes zero."
    return f"The means are in the paper's order, {paper}, but not every step's interval excludes zero."


def _better_rivals(study: StudyResult, levels: Sequence[str], name: str) -> list[str]:
    """Rivals that score higher than the study's own network ever does."""
    sentences = []
    for level in levels:
        best_mean, best = max(_means(study.outcomes, level, _accuracy).values()), _best_rival(study, level)
        if best is not None and best[2] > best_mean:
            sentences.append(f"at {level} by {classifier_words(best[0])} ({score(best[2])} against {score(best_mean)})")
    return [f"{name} was beaten {_enumerate(sentences)}."] if sentences else []


def _best_rival(study: StudyResult, level: str) -> tuple[str, str, float] | None:
    """Classifier, training set and mean accuracy of the best rival of all seeds: means of others do not compare."""
    seeds = {name: {rival.seed for rival in study.rivals if rival.classifier == name} for name in study.rival_names}
    scored = [
        (name, training_set, value)
        for name in study.rival_names
        if seeds[name] >= set(study.seeds)
        for training_set, value in _means(
            [rival for rival in study.rivals if rival.classifier == name], level, _accuracy
        ).items()
    ]
    return max(scored, key=lambda entry: entry[2], default=None)


def _accuracy(outcome: Outcome) -> float:
    return outcome.scores.accuracy


def _means(outcomes: Sequence[Outcome], level: str, value: Callable[[Outcome], float]) -> dict[str, float]:
    """Mean over the seeds for each training set that has any, in the expected order."""
    means = {}
    for name in EXPECTED:
        values = [value(outcome) for outcome in outcomes if outcome.level == level and outcome.training_set == name]
        if finite := [number for number in values if math.isfinite(number)]:
            means[name] = float(np.mean(finite))
    return means


def _enumerate(texts: Sequence[str]) -> str:
    return texts[0] if len(texts) == 1 else f"{', '.join(texts[:-1])} and {texts[-1]}"
