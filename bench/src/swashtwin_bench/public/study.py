"""Every public set that is there: the honest score, the leaky one, and those of the usual trees."""

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from joblib import delayed

from swashtwin.foundation import VERSION, DataError, InputError, parallel
from swashtwin.recordings import Recording
from swashtwin_bench.public.bearing_faults import bearing_questions
from swashtwin_bench.public.cavitation import cavitation_questions
from swashtwin_bench.public.hydraulic import hydraulic_questions
from swashtwin_bench.public.plant_motors import motor_questions
from swashtwin_bench.public.question import Question, Setting
from swashtwin_bench.public.readers.registry import read_public_set
from swashtwin_bench.public.validation import FoldScore, leaky_scores, score_fold
from swashtwin_bench.results.table import StudyTable, Trial

QUESTIONS: dict[str, Callable[[Sequence[Recording], int], list[Question]]] = {
    "pump_cavitation": cavitation_questions,
    "uci_hydraulic": hydraulic_questions,
    "cwru": bearing_questions,
    "motor_pump_industrial": motor_questions,
}
"""Questions asked of each set, made from its recordings with a number of processes."""

METRICS = {
    "balanced_accuracy": "honest split, chosen method",
    "random_window": "random split, chosen method",
    "extra_trees": "honest split, extra trees on windows",
    "extra_trees_random_window": "random split, extra trees on windows",
}
"""Heading of each balanced accuracy."""

_NOTES = (
    "Honest: the groups named by the split are kept apart, folds averaged, one decision for each recording (cycle). "
    "Random: five folds of windows dealt at random, one decision for each window, as in most papers.",
    "Settings are chosen by inner folds of whole groups within each training side; details.folds lists each choice.",
    "A seed draws four fifths of the training units, the inner folds, the random split and the trees.",
    "The folds are kept clean; the ideas are not blind: what to look at was found with labels in view, on the same "
    "public sets, and docs/bench/evidence.md logs everything that was tried with its test score.",
    "pump_cavitation is told by the motor's slip, which is the pump's load: what the labels grade is the flow taken "
    "away, and no ear for cavitation is shown by it.",
    "motor_pump_industrial has one block of each class on a training side, so training cannot tell class from machine; "
    "textbook signs of faults that may only grow do, and four blocks are too few to prove that they would elsewhere.",
)


def run_public(
    folder: Path | str,
    *,
    seeds: Sequence[int] = (0,),
    jobs: int = 1,
    sets: Sequence[str] = (),
    progress: Callable[[str, int, int], None] | None = None,
    command: str = "",
) -> StudyTable:
    """Scores of classifiers on the sets in `folder`, on splits that keep machines, speeds or runs apart.

    Parameters
    ----------
    folder : a folder with one folder for each public set, named as in `QUESTIONS`; missing sets are left out.
    seeds : of the training draws, inner folds, random splits and trees.
    jobs : processes that work side by side.
    sets : names of the sets to ask; all that are there by default.
    progress : called with what is done, how much of it, and of how much.
    command : command line that repeats it.

    Raises
    ------
    InputError
        There is no such set, or no seed.
    DataError
        `folder` holds none of them.
    """
    began = time.perf_counter()
    if not seeds:
        raise InputError("no seed was given; one is enough: seeds=(0,).")
    there = sets_there(Path(folder), sets)
    tell = progress or (lambda what, count, total: None)
    trials: list[Trial] = []
    details: dict[str, list[dict]] = {}
    for number, name in enumerate(there):
        tell(name, number, len(there))
        for question in QUESTIONS[name](read_public_set(name, Path(folder) / name), jobs):
            rows, settings = _score_question(question, seeds, jobs)
            trials += rows
            details[question.split] = settings
    tell("done", len(there), len(there))
    table = StudyTable(
        study="public",
        title="Real recordings: what an honest split leaves of a score",
        metrics=METRICS,
        trials=tuple(trials),
        answer=(),
        settings={"sets": there, "jobs": jobs},
        origin="Public recordings of real machines; none of them is an axial piston pump with known faults.",
        wall_s=time.perf_counter() - began,
        version=VERSION,
        command=command,
        notes=(
            *_NOTES,
            *(f"{name} is not in {Path(folder).name} and was left out." for name in missing_sets(there, sets)),
        ),
        details={"folds": details},
    )
    return _answer(table)


def sets_there(folder: Path, sets: Sequence[str]) -> list[str]:
    """Sets asked for, or all, that `folder` holds; a `DataError` where it holds none."""
    unknown = [name for name in sets if name not in QUESTIONS]
    if unknown:
        raise InputError(f"{unknown[0]!r} is none of the sets asked about: {', '.join(QUESTIONS)}.")
    there = [name for name in sets or QUESTIONS if (folder / name).is_dir()]
    if not there:
        raise DataError(
            f"{folder} holds no folder called {' or '.join(sets or QUESTIONS)}; name the folder that holds them."
        )
    return there


def missing_sets(there: Sequence[str], sets: Sequence[str]) -> list[str]:
    """Sets asked for, or all, that are not there."""
    return [name for name in sets or QUESTIONS if name not in there]


def _score_question(question: Question, seeds: Sequence[int], jobs: int) -> tuple[list[Trial], list[dict]]:
    """(a trial for each seed, each fold's choice and scores)."""
    pairs = [(fold, seed) for seed in seeds for fold in question.folds]
    scores = parallel(jobs)(delayed(score_fold)(question, *pair) for pair in pairs)
    of_seed = {
        seed: [score for (_, pair_seed), score in zip(pairs, scores, strict=True) if pair_seed == seed]
        for seed in seeds
    }
    usual = [(_commonest(question, of_seed[seed]), seed) for seed in seeds]
    leaky = parallel(jobs)(delayed(leaky_scores)(question, *pair) for pair in usual)
    trials = [
        Trial({"split": question.split}, seed, _values(of_seed[seed], *scores_at_random))
        for seed, scores_at_random in zip(seeds, leaky, strict=True)
    ]
    return trials, [_fold_row(seed, score) for (_, seed), score in zip(pairs, scores, strict=True)]


def _commonest(question: Question, scores: Sequence[FoldScore]) -> Setting:
    """Setting that most folds chose."""
    name = Counter(score.setting for score in scores).most_common(1)[0][0]
    return next(setting for setting in question.settings if str(setting) == name)


def _values(scores: Sequence[FoldScore], balanced: float, trees: float) -> dict[str, float]:
    return {
        "balanced_accuracy": float(np.mean([score.balanced_accuracy for score in scores])),
        "random_window": balanced,
        "extra_trees": float(np.mean([score.rival for score in scores])),
        "extra_trees_random_window": trees,
    }


def _fold_row(seed: int, score: FoldScore) -> dict:
    return {
        "seed": seed,
        "tested": score.fold,
        "setting": score.setting,
        "inner": score.inner,
        "balanced_accuracy": score.balanced_accuracy,
        "extra_trees": score.rival,
    }


def _answer(table: StudyTable) -> StudyTable:
    """The table with its answer in sentences."""
    sentences = []
    for row in table.rows():
        honest, trees, leaky = (
            row[name]["mean"] for name in ("balanced_accuracy", "extra_trees", "extra_trees_random_window")
        )
        sentences.append(
            f"{row['split']}: {honest:.2f} on the honest split; extra trees on windows {trees:.2f}, and {leaky:.2f} "
            "where windows are dealt at random."
        )
    return replace(table, answer=tuple(sentences))
