"""How much of a score is memory? Windows drawn at random beside whole groups held out, on the user's own recordings."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int, Shaped
from joblib import delayed
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.metrics import f1_score
from sklearn.model_selection import StratifiedKFold

from swashtwin.bench.results.table import StudyTable, Trial, origin_of
from swashtwin.foundation import VERSION, DataError, InputError, derive_seed, parallel, stream
from swashtwin.learning import (
    Fold,
    WindowSet,
    cut_windows,
    extract_features,
    group_folds,
    window_groups,
)
from swashtwin.recordings import GROUPS, Recording, recording_groups

_METRICS = {
    "balanced_accuracy": "balanced accuracy",
    "random_window": "of random windows",
    "premium": "leak premium",
    "macro_f1": "macro F1",
    "recording_accuracy": "per recording",
}
_RESAMPLES = 2000
_FEW = 8
"""Groups below which an interval is called coarse."""


@dataclass(frozen=True, eq=False)
class _Plan:
    """One grouping, and in how many folds it can be held out."""

    name: str
    groups: Shaped[np.ndarray, " window"]
    by_recording: Mapping[str, str]
    n_folds: int


def run_leakage(
    recordings: Sequence[Recording],
    *,
    length: int,
    groups: Sequence[str] | None = None,
    seeds: Sequence[int] = (0, 1, 2, 3, 4),
    n_folds: int = 5,
    n_trees: int = 200,
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
    command: str = "",
) -> StudyTable:
    """Score of extra trees on features where whole groups are held out, beside that of random windows (level L0).

    Every window is tested once under each seed, by trees that saw no window of its group. Beside it stand random folds
    of the same windows in the same number, so that both train on as much. Windows do not overlap; with the overlap that
    many papers cut with, the premium is larger. The intervals (95 %) resample groups, never windows.

    Parameters
    ----------
    recordings : with labels, of one rate.
    length : samples per window.
    groups : what to hold out; by default recording, specimen, condition and every attribute, as far as each class
        stands in two groups or more.
    seeds : seeds of folds and trees.
    n_folds : folds at most; a class of fewer groups lowers them.
    n_trees : trees.
    jobs : processes.
    progress : called with (fits done, fits in all).
    command : command line that repeats it.

    Raises
    ------
    DataError
        No grouping can be held out, or the recordings do not fit together.
    """
    began = time.perf_counter()
    recordings, notes = _usable(recordings)
    windows = cut_windows(recordings, length=length, allow_partial_revolution=True)
    windows.require_labels("a study of leaks")
    plans, left_out = _plans(recordings, windows, groups, n_folds, seeds)
    features = extract_features(windows).values
    tasks: list[tuple[_Plan | None, int, int]] = [
        (None, count, seed) for count in sorted({plan.n_folds for plan in plans}) for seed in seeds
    ]
    tasks += [(plan, plan.n_folds, seed) for plan in plans for seed in seeds]
    running = parallel(jobs, return_as="generator")(
        delayed(_probabilities)(features, windows.target, _dealt(windows, *task), n_trees, task[2]) for task in tasks
    )
    probabilities: dict[tuple[str | None, int, int], Float[np.ndarray, "window class"]] = {}
    for (plan, count, seed), probability in zip(tasks, running, strict=True):
        probabilities[plan.name if plan else None, count, seed] = probability
        if progress is not None:
            progress(len(probabilities), len(tasks))
    trials, intervals, answer = [], {}, []
    for plan in plans:
        held_out = [probabilities[plan.name, plan.n_folds, seed] for seed in seeds]
        free = [probabilities[None, plan.n_folds, seed] for seed in seeds]
        trials += [_trial(plan, windows, *three) for three in zip(seeds, held_out, free, strict=True)]
        intervals[plan.name] = _intervals(plan, windows, held_out, free)
        answer.append(_sentence(plan, intervals[plan.name]))
    return StudyTable(
        study="leakage",
        title="How much of the score is memory?",
        metrics=_METRICS,
        trials=tuple(trials),
        answer=tuple(answer),
        settings={"length": length, "n_folds": n_folds, "n_trees": n_trees, "classifier": "extra trees on features"},
        origin=origin_of(recordings),
        wall_s=time.perf_counter() - began,
        version=VERSION,
        command=command,
        notes=(*notes, *left_out),
        details={
            "windows": len(windows),
            "classes": list(windows.classes),
            "intervals": intervals,
        },
    )


def _usable(recordings: Sequence[Recording]) -> tuple[list[Recording], list[str]]:
    """Recordings with a label, without channels that stand still in one of them."""
    labeled = [recording for recording in recordings if recording.label and not recording.synthetic]
    if not labeled:
        raise DataError("no measured recording has a label; classes come from the index.")
    notes = []
    if len(labeled) < len(recordings):
        notes.append(f"{len(recordings) - len(labeled)} recordings without a label, or synthetic, were left out.")
    still = {
        name
        for recording in labeled
        for name, row in zip(recording.channels, recording.signal, strict=True)
        if np.ptp(row) == 0
    }
    moving = [name for name in labeled[0].channels if name not in still]
    if still and moving:
        notes.append(f"{', '.join(sorted(still))} stand still in some recordings and were left out.")
        labeled = [recording.picked(moving) for recording in labeled]
    return labeled, notes


def _plans(
    recordings: Sequence[Recording],
    windows: WindowSet,
    names: Sequence[str] | None,
    n_folds: int,
    seeds: Sequence[int],
) -> tuple[list[_Plan], list[str]]:
    """Groupings that can be held out, and why others cannot."""
    shared = set.intersection(*({*recording.attributes} for recording in recordings))
    plans: list[_Plan] = []
    reasons: list[str] = []
    partitions: dict[bytes, str] = {}
    for name in names or [*GROUPS, *sorted(shared - {"speed"})]:
        try:
            by_recording = recording_groups(recordings, name)
            groups = window_groups(windows, by_recording)
            plan = _Plan(name, groups, by_recording, _fold_count(windows, groups, by_recording, n_folds, seeds, name))
        except (DataError, InputError) as cause:
            if names is not None:
                raise
            reasons += [f"Not held out: {name}. {cause}"] if name in GROUPS else []
            continue
        mark = np.unique(groups, return_index=True, return_inverse=True)
        same = partitions.setdefault(mark[1][mark[2]].tobytes(), name)
        if same == name:
            plans.append(plan)
        elif names is not None or name in GROUPS:
            reasons.append(f"{name} groups the recordings as {same} does.")
    if not plans:
        raise DataError(f"nothing can be held out. {' '.join(reasons)}")
    return plans, reasons


def _fold_count(
    windows: WindowSet,
    groups: Shaped[np.ndarray, " window"],
    by_recording: Mapping[str, str],
    n_folds: int,
    seeds: Sequence[int],
    name: str,
) -> int:
    """Most folds, up to `n_folds`, of which each leaves every class to train on under every seed."""
    fewest = min(np.unique(groups[windows.target == index]).size for index in range(len(windows.classes)))
    for count in range(min(n_folds, fewest), 1, -1):
        try:
            for seed in seeds:
                group_folds(windows, group=by_recording, n_folds=count, seed=seed)
        except DataError:
            continue
        return count
    raise DataError(
        f"a class stands in {fewest} {name}(s) only; if one is held out, nothing of the class is left to learn."
    )


def _dealt(windows: WindowSet, plan: _Plan | None, n_folds: int, seed: int) -> Sequence[Fold]:
    if plan is not None:
        return group_folds(windows, group=plan.by_recording, n_folds=n_folds, seed=seed)
    return list(StratifiedKFold(n_folds, shuffle=True, random_state=seed).split(windows.target, windows.target))


def _probabilities(
    features: Float[np.ndarray, "window feature"],
    target: Int[np.ndarray, " window"],
    folds: Sequence[Fold],
    n_trees: int,
    seed: int,
) -> Float[np.ndarray, "window class"]:
    """Of each window, by trees of the fold that tests it."""
    probabilities = np.zeros((len(target), int(target.max()) + 1))
    for number, (trained, tested) in enumerate(folds):
        state = derive_seed(seed, "leakage trees", number) % 2**32
        trees = ExtraTreesClassifier(n_trees, random_state=state, n_jobs=1)
        probabilities[tested] = trees.fit(features[trained], target[trained]).predict_proba(features[tested])
    return probabilities


def _trial(
    plan: _Plan,
    windows: WindowSet,
    seed: int,
    held_out: Float[np.ndarray, "window class"],
    free: Float[np.ndarray, "window class"],
) -> Trial:
    ids, inverse = np.unique(windows.recording_id, return_inverse=True)
    votes = np.zeros((len(ids), held_out.shape[1]))
    np.add.at(votes, inverse, held_out)
    truth = np.zeros(len(ids), dtype=np.int64)
    truth[inverse] = windows.target
    honest, random_window = (
        _recall(windows.target, probabilities.argmax(axis=1)).mean() for probabilities in (held_out, free)
    )
    values = {
        "balanced_accuracy": float(honest),
        "random_window": float(random_window),
        "premium": float(random_window - honest),
        "macro_f1": float(f1_score(windows.target, held_out.argmax(axis=1), average="macro", zero_division=0.0)),
        "recording_accuracy": float(_recall(truth, votes.argmax(axis=1)).mean()),
    }
    factors = {"split": plan.name, "groups": str(np.unique(plan.groups).size), "folds": str(plan.n_folds)}
    return Trial(factors, seed, values)


def _recall(target: Int[np.ndarray, " n"], predicted: Int[np.ndarray, " n"]) -> Float[np.ndarray, " class"]:
    hit = np.bincount(target, weights=(target == predicted).astype(np.float64))
    recall: np.ndarray = hit / np.bincount(target)
    return recall


def _intervals(
    plan: _Plan,
    windows: WindowSet,
    held_out: Sequence[Float[np.ndarray, "window class"]],
    free: Sequence[Float[np.ndarray, "window class"]],
) -> dict[str, Any]:
    """Means over the seeds with 95 % intervals by resampling groups; the premium's is paired."""
    names, inverse = np.unique(plan.groups, return_inverse=True)
    shape = (len(names), len(windows.classes))
    counts = [np.zeros(shape) for _ in range(3)]
    np.add.at(counts[0], (inverse, windows.target), 1.0)
    for table, draws in zip(counts[1:], (held_out, free), strict=True):
        hits = np.mean([probabilities.argmax(axis=1) == windows.target for probabilities in draws], axis=0)
        np.add.at(table, (inverse, windows.target), hits)
    random = stream(0, "leakage intervals", plan.name)
    resamples = random.multinomial(len(names), np.full(len(names), 1 / len(names)), size=_RESAMPLES)
    weights = np.concatenate([np.ones((1, len(names)), dtype=np.int64), resamples])
    total, honest, memory = (weights @ table for table in counts)
    with np.errstate(invalid="ignore"):
        scores = {
            "balanced_accuracy": np.nanmean(honest / total, axis=1),
            "random_window": np.nanmean(memory / total, axis=1),
        }
    scores["premium"] = scores["random_window"] - scores["balanced_accuracy"]
    return {
        name: {"mean": float(values[0]), "interval": np.quantile(values[1:], (0.025, 0.975)).tolist()}
        for name, values in scores.items()
    } | {"groups": len(names)}


def _sentence(plan: _Plan, values: Mapping[str, Any]) -> str:
    honest, random_window, premium = (values[name] for name in ("balanced_accuracy", "random_window", "premium"))
    coarse = f" With {values['groups']} groups the interval is coarse." if values["groups"] < _FEW else ""
    return (
        f"{plan.name} held out: {honest['mean']:.2f} ({honest['interval'][0]:.2f} to {honest['interval'][1]:.2f}), "
        f"random windows {random_window['mean']:.2f}; the leak premium is {premium['mean']:+.2f} "
        f"({premium['interval'][0]:+.2f} to {premium['interval'][1]:+.2f}).{coarse}"
    )
