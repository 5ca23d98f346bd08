"""What a classifier does at a speed and pressure that it was never trained on, and what helps against it.

Each operating condition is held out in turn, with all its recordings; the classifiers learn from the others (level L3:
the same machines, another condition). Beside each honest score stands that of the same classifier where recordings of
every condition are known (L2), so that the price of a new condition can be read off.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Int
from joblib import delayed

from swashtwin.bench.results.table import StudyTable, Trial, origin_of
from swashtwin.foundation import VERSION, DataError, parallel
from swashtwin.learning import (
    BiTCN,
    Classifier,
    Scores,
    TrainingSettings,
    WindowSet,
    cut_windows,
    evaluate,
    fit,
    fit_extra_trees,
    group_folds,
    window_groups,
)
from swashtwin.recordings import Recording

REMEDIES: dict[str, dict[str, Any]] = {
    "bitcn": {},
    "bitcn, windows scaled one by one": {"normalization": "window"},
}
"""What differs from the plain training, by the classifier's name in the table."""

TREES = "extra trees"

METRICS = {
    "accuracy": "accuracy",
    "recall": "macro recall",
    "g_mean": "G-mean",
    "recording_accuracy": "accuracy by recording",
}


@dataclass(frozen=True)
class ConditionStudySettings:
    """What is trained, and on how much."""

    length: int = 2048
    """Readings per window."""
    windows: int = 8
    """Windows taken from each recording, evenly spaced."""
    training: TrainingSettings = field(
        default_factory=lambda: TrainingSettings(epochs=12, learning_rate=2e-3, decay="cosine", normalization="set")
    )
    """How the network is trained, before a remedy changes it."""
    network: dict[str, Any] = field(default_factory=lambda: {"stride": 16, "channels": (32,) * 6})
    """Settings of BiTCN that differ from the paper's."""


@dataclass(frozen=True, eq=False)
class _Task:
    """One classifier on one split, its windows named by number: many tasks share them."""

    name: str
    level: str
    held_out: str
    seed: int
    train: Int[np.ndarray, " train"]
    test: Int[np.ndarray, " test"]


def run_conditions(
    recordings: Sequence[Recording],
    *,
    seeds: Sequence[int] = (0,),
    settings: ConditionStudySettings | None = None,
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
    command: str = "",
) -> StudyTable:
    """Scores of each classifier at conditions never trained on (L3) and at known ones (L2).

    Parameters
    ----------
    recordings : measured, with labels and at least two operating conditions.
    seeds : each draws weights, trees and the folds of L2 anew.
    settings : what is trained.
    jobs : processes that train side by side.
    progress : called with trainings done and in all.
    command : command line that repeats the study, kept with the result.

    Raises
    ------
    DataError
        Fewer than two conditions, or one without which a class is never seen.
    """
    started, settings = time.perf_counter(), settings or ConditionStudySettings()
    windows = _thin_out(cut_windows(recordings, length=settings.length), settings.windows)
    tasks = [task for seed in seeds for task in _tasks(windows, seed)]
    results: list[tuple[Trial, str]] = []
    running = parallel(jobs, return_as="generator")(delayed(_score)(windows, task, settings) for task in tasks)
    for result in running:
        results.append(result)
        if progress is not None:
            progress(len(results), len(tasks))
    order = {(name, level): position for position, (name, level) in enumerate(_rows())}
    results.sort(key=lambda result: order[result[0].factors["classifier"], result[0].factors["level"]])
    table = StudyTable(
        study="conditions",
        title="What a condition that was never trained on costs, and what helps",
        metrics=METRICS,
        trials=tuple(trial for trial, _ in results),
        answer=(),
        settings=asdict(settings),
        origin=origin_of(recordings),
        wall_s=time.perf_counter() - started,
        version=VERSION,
        command=command,
        notes=(
            "L3: every condition held out in turn, a trial each; L2: recordings of known conditions held out. "
            "Remedies and their strengths were fixed beforehand; none was chosen by these scores.",
        ),
        details={
            "single": [
                {**trial.factors, "held_out": held_out, "seed": trial.seed, **trial.values}
                for trial, held_out in results
            ]
        },
    )
    return replace(table, answer=_answer(table))


def _rows() -> list[tuple[str, str]]:
    return [(name, level) for level in ("L3", "L2") for name in (*REMEDIES, TREES)]


def _thin_out(windows: WindowSet, count: int) -> WindowSet:
    """At most so many windows of each recording, evenly spaced."""
    indices = []
    for name in dict.fromkeys(windows.recording_id.tolist()):
        of_recording = np.flatnonzero(windows.recording_id == name)
        indices.append(
            of_recording[np.unique(np.linspace(0, len(of_recording) - 1, min(count, len(of_recording))).astype(int))]
        )
    return windows.subset(np.concatenate(indices))


def _tasks(windows: WindowSet, seed: int) -> list[_Task]:
    conditions = window_groups(windows, "condition")
    names = np.unique(conditions)
    if names.size < 2:
        raise DataError(
            f"all recordings are of one condition ({', '.join(names)}); holding one out takes two. Give recordings at "
            "another speed or pressure, and state both in the index."
        )
    splits = [
        ("L3", str(conditions[tested[0]]), trained, tested)
        for trained, tested in group_folds(windows, group="condition", dealing="each")
    ]
    folds = min(len(splits), 5)
    dealt = group_folds(windows, group="recording", n_folds=max(folds, 2), seed=seed)
    splits += [("L2", f"fold {number}", *pair) for number, pair in enumerate(dealt, 1)]
    return [
        _Task(name, level, held_out, seed, trained, tested)
        for level, held_out, trained, tested in splits
        for name in (*REMEDIES, TREES)
    ]


def _score(windows: WindowSet, task: _Task, settings: ConditionStudySettings) -> tuple[Trial, str]:
    fitted = _fit(task, windows.subset(task.train), settings)
    scores = evaluate(fitted, windows.subset(task.test), level=task.level)
    return Trial({"classifier": task.name, "level": task.level}, task.seed, _values(scores)), task.held_out


def _fit(task: _Task, train: WindowSet, settings: ConditionStudySettings) -> Classifier:
    if task.name == TREES:
        return fit_extra_trees(train, seed=task.seed)
    network = BiTCN(train.n_channels, len(train.classes), **settings.network)
    training = replace(settings.training, **REMEDIES[task.name])
    return fit(network, train, settings=training, seed=task.seed)


def _values(scores: Scores) -> dict[str, float]:
    return {
        "accuracy": scores.accuracy,
        "recall": scores.macro_recall,
        "g_mean": scores.g_mean,
        "recording_accuracy": scores.recording_accuracy,
    }


def _answer(table: StudyTable) -> tuple[str, ...]:
    mean = {
        (name, level): float(np.mean(table.values("recall", classifier=name, level=level))) for name, level in _rows()
    }
    plain, familiar = mean["bitcn", "L3"], mean["bitcn", "L2"]
    best = max((*REMEDIES, TREES), key=lambda name: mean[name, "L3"])
    return (
        f"Macro recall of BiTCN falls from {familiar:.3f} on recordings of known conditions to {plain:.3f} at a "
        f"condition that it was never trained on; extra trees from {mean[TREES, 'L2']:.3f} to {mean[TREES, 'L3']:.3f}.",
        f"Highest at a new condition: {best} ({mean[best, 'L3']:.3f}).",
    )
