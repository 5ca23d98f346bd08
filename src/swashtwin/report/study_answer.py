"""A study's answer in plain words, whichever way it went."""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from swashtwin.evaluation import LEVELS
from swashtwin.report.wording import classifier_words, number, plural, training_set_words
from swashtwin.studies.result import Outcome, StudyResult

EXPECTED = ("measured", "nominal", "calibrated")
"""Training sets in the order in which the paper's scores rise."""


def study_answer(study: StudyResult) -> tuple[str, ...]:
    """What was compared, and what came out at each level, nearest first."""
    name = classifier_words(study.outcomes[0].classifier)
    present = [one for one in EXPECTED if any(outcome.training_set == one for outcome in study.outcomes)]
    opening = (
        f"{name} was trained on {_listed([_described(one) for one in present])}, and tested on measured recordings "
        f"that had no part in training or calibration ({plural(len(study.seeds), 'seed')}; each draws the split, the "
        "weights and the synthesis anew)."
    )
    levels = sorted({one.level for one in study.outcomes})
    return (opening, *(" ".join(_at_level(study, level)) for level in levels))


def _described(training_set: str) -> str:
    return {
        "measured": "measured windows only",
        "nominal": "the same and windows simulated with nominal (handbook) values",
        "calibrated": "the same and windows simulated with calibrated values",
    }[training_set]


def _at_level(study: StudyResult, level: str) -> list[str]:
    outcomes = [one for one in study.outcomes if one.level == level]
    mean = {name: _mean([o.scores.accuracy for o in outcomes if o.training_set == name]) for name in EXPECTED}
    mean = {name: value for name, value in mean.items() if math.isfinite(value)}
    told = _listed([f"{number(value)} ({training_set_words(name)})" for name, value in mean.items()])
    sentences = [f"At {level} ({LEVELS.get(level, 'level not described')}) the accuracy was {told}."]
    for other in ("measured", "nominal"):
        if "calibrated" in mean and other in mean:
            sentences.append(_difference(outcomes, "calibrated", other))
    if len(mean) == len(EXPECTED):
        sentences.append(_order(mean))
    return [*sentences, *_scarce(outcomes), *_rivals(study, level, mean)]


def _difference(outcomes: Sequence[Outcome], first: str, second: str) -> str:
    """How far `first` is above `second`, paired by seed."""
    by_seed = {(one.training_set, one.seed): one.scores.accuracy for one in outcomes}
    seeds = [seed for name, seed in by_seed if name == first and (second, seed) in by_seed]
    points = 100 * np.array([by_seed[first, seed] - by_seed[second, seed] for seed in seeds])
    if not points.size:
        return ""
    mean, this, that = float(points.mean()), training_set_words(first), training_set_words(second)
    if abs(mean) < 0.05:
        return f"“{this}” scored the same as “{that}”."
    said = f"“{this}” {'beat' if mean > 0 else 'fell behind'} “{that}” by {abs(mean):.1f} points"
    if points.size < 2:
        return f"{said}; with one seed nobody can say whether that is chance."
    spread = float(points.std(ddof=1))
    verdict = "more than" if abs(mean) > spread else "within"
    return (
        f"{said} on average, {verdict} the spread over the seeds (standard deviation of the difference, paired by "
        f"seed: {spread:.1f} points)."
    )


def _order(mean: dict[str, float]) -> str:
    found = sorted(EXPECTED, key=lambda name: mean[name])
    if tuple(found) == EXPECTED and len(set(mean.values())) == len(EXPECTED):
        return "The order is the paper's: measured only < nominal < calibrated."
    signs = ["=" if mean[a] == mean[b] else "<" for a, b in pairwise(found)]
    written = f"{found[0]} {signs[0]} {found[1]} {signs[1]} {found[2]}"
    return f"The paper's order, measured only < nominal < calibrated, was NOT found here: it is {written}."


def _scarce(outcomes: Sequence[Outcome]) -> list[str]:
    recall = {name: _mean([o.scarce_recall for o in outcomes if o.training_set == name]) for name in EXPECTED}
    told = [f"{number(value)} ({training_set_words(name)})" for name, value in recall.items() if math.isfinite(value)]
    return [f"Recall of the measured windows of the scarce cell: {_listed(told)}."] if told else []


def _rivals(study: StudyResult, level: str, mean: dict[str, float]) -> list[str]:
    """The best score of a classifier that is not the study's own, where it reaches the study's best."""
    scored: dict[tuple[str, str], list[float]] = {}
    for one in study.rivals:
        if one.level == level:
            scored.setdefault((one.classifier, one.training_set), []).append(one.scores.accuracy)
    if not scored:
        return []
    (rival, training_set), values = max(scored.items(), key=lambda entry: _mean(entry[1]))
    own = max(mean.values(), default=math.nan)
    reached = _mean(values)
    comparison = "better than" if reached > own else "as good as" if reached == own else "below"
    return [
        f"The best rival, {classifier_words(rival)} ({training_set_words(training_set)}), reached {number(reached)}, "
        f"{comparison} the network's best."
    ]


def _mean(values: Sequence[float]) -> float:
    finite = [value for value in values if math.isfinite(value)]
    return float(np.mean(finite)) if finite else math.nan


def _listed(texts: Sequence[str]) -> str:
    return texts[0] if len(texts) == 1 else f"{', '.join(texts[:-1])} and {texts[-1]}"
