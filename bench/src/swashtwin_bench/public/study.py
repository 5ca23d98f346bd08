"""Default training on every public set, by splits that keep groups apart.

For comparison, one row has windows assigned at random.
"""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.metrics import balanced_accuracy_score
from sklearn.model_selection import StratifiedKFold, cross_val_predict

from swashtwin.diagnosis import FaultClassifier
from swashtwin.foundation import DataError, InputError, plural
from swashtwin.learning import (
    NETWORKS,
    RECOMMENDED_TRAINING,
    cut_windows,
    feature_values,
    unseen_recordings,
)
from swashtwin.recordings import Recording, default_window
from swashtwin_bench.public.sets import SPLITS, Fold, Split, read_public_set
from swashtwin_bench.results.runs import Task, Work, fingerprint_recordings
from swashtwin_bench.results.table import StudyTable, Trial
from swashtwin_bench.rivals.baselines import ON_FEATURES
from swashtwin_bench.rivals.models import BEST_CANDIDATE, Model

METRICS = {
    "balanced_accuracy": "by window",
    "recording_balanced_accuracy": "by recording",
    "grade_distance": "distance in grades",
    "floor": "floor (reference trees)",
    "window": "samples per window",
    "cpu_s": "processor time of a training and its test [s]",
}

# Figures of each fold in the details of the study.
FOLD_FIGURES = (
    "balanced_accuracy",
    "recording_balanced_accuracy",
    "grade_distance",
    "copies",
    "choice",
    "window",
    "cpu_s",
    "refused",
)

AT_RANDOM = "extra trees, random windows"
"""Row of the score that a leaky split would give."""

_NOTES = (
    "Groups named by the split are kept apart; balanced accuracy, mean over the folds. Only the "
    "recordings and the seed are given: the training selects window, scaling, gain and noise from "
    "the training side alone. Other classifiers use the default window.",
    f"{AT_RANDOM}: five folds of windows assigned at random, as in many papers, so that both sides "
    "have windows of one recording.",
    "Throttle positions of pump_cavitation are grades of one fault, not kinds: a neighboring grade "
    "is nearly right. So their score is the mean distance from the right grade, and the mean over "
    "the splits excludes them. An answer that is always the middle of five grades has 1.2.",
    "Channels that are constant in any recording of a set are excluded (PS4 of uci_hydraulic).",
    "Each seed repeats the training. The sides are always whole, except for test recordings that "
    "hold the same samples as a training recording under another name (details.folds counts them "
    "as copies).",
)


@dataclass(frozen=True, eq=False)
class _Case:
    """One classifier trained on one side of a split and tested on the other."""

    split: Split
    fold: Fold
    classifier: str
    seed: int
    data: str

    @property
    def task(self) -> Task:
        """Run of this case, which a folder of earlier runs may hold."""
        model = {name: str(value) for name, value in self.estimator(()).get_params().items()}
        # The candidates decide the result, and are no parameters of the classifier.
        if self.classifier == BEST_CANDIDATE:
            model |= Model(BEST_CANDIDATE).describe()

        factors = {"classifier": self.classifier, "split": self.split.name, "fold": self.fold.name}
        settings = {
            "model": model,
            "train": sorted(self.fold.train),
            "test": sorted(self.fold.test),
        }
        return Task("public", self.seed, factors, settings, self.data)

    def estimator(self, train: Sequence[Recording]) -> FaultClassifier:
        """Return the classifier before its training.

        Classifiers other than the default one use its windows.
        """
        if self.classifier == BEST_CANDIDATE:
            return FaultClassifier(seed=self.seed)

        window = default_window(train) if train else None
        scaling = "none" if self.classifier in ON_FEATURES else RECOMMENDED_TRAINING.normalization
        return FaultClassifier(
            self.classifier, window=window, normalization=scaling, seed=self.seed
        )

    def run(self, out: Path | None) -> dict[str, Any]:
        """Return the run of this case, read from `out` if it is finished there."""
        return self.task.run(out, self.values)

    def values(self) -> dict[str, Any]:
        """Return the scores on the test side and their cost, or the reason of a refusal."""
        start_s = time.process_time()
        train = self.split.select(self.fold.train)
        test = self.split.select(self.fold.test)

        try:
            classifier = self.estimator(train).fit(train)
            # Some sets hold the same samples under two names, which would leak into the test.
            unseen, _ = unseen_recordings(classifier.fitted_.manifest, test)
            by_window = classifier.evaluate(unseen).macro_recall
            predicted = classifier.predict(unseen)
        except (DataError, InputError) as cause:
            return {"refused": str(cause)}

        labels = np.array([recording.label for recording in unseen])
        # Only the default training compares models and reports which one it selected.
        choice = getattr(classifier.fitted_, "choice", None)

        values = {
            "balanced_accuracy": by_window,
            "recording_balanced_accuracy": float(balanced_accuracy_score(labels, predicted)),
            "copies": len(test) - len(unseen),
            "choice": "" if choice is None else choice.sentence(),
            "window": classifier.fitted_.layout.length,
            "cpu_s": time.process_time() - start_s,
        }
        if self.split.grades:
            values["grade_distance"] = _grade_distance(self.split.grades, labels, predicted)
        return values


def _grade_distance(grades: Sequence[str], labels: np.ndarray, predicted: np.ndarray) -> float:
    """Return the mean distance between labels and answers in grades."""
    rank = {name: number for number, name in enumerate(grades)}
    pairs = zip(labels.tolist(), predicted.tolist(), strict=True)
    return float(np.mean([abs(rank[label] - rank[answer]) for label, answer in pairs]))


@dataclass(frozen=True)
class PublicSettings:
    """Classifiers and sets of the study."""

    classifiers: tuple[str, ...] = (BEST_CANDIDATE, "extra_trees")
    """``"chosen"`` for the default training of `FaultClassifier`, or names that it accepts."""
    sets: tuple[str, ...] = ()
    """Names of the sets; all in the folder by default."""


def public(work: Work, settings: PublicSettings, folder: Path) -> StudyTable:
    """Return scores of classifiers with default settings, by splits that keep groups apart.

    Parameters
    ----------
    work : its seeds are those of the trainings.
    folder : folder with one folder for each public set, named as in `SPLITS`; missing sets are
        skipped.

    Raises
    ------
    InputError
        A set or a classifier is unknown.
    DataError
        `folder` holds no set.
    """
    for name in settings.classifiers:
        if name not in (BEST_CANDIDATE, *NETWORKS):
            raise InputError(
                f"Invalid classifier {name!r}: must be one of {BEST_CANDIDATE}, "
                f"{', '.join(NETWORKS)}."
            )
    folder = Path(folder)
    sets = _available_sets(folder, settings.sets)

    rows: list[tuple[_Case, dict[str, Any]]] = []
    leaky: list[Trial] = []
    for name in sets:
        recordings = _drop_constant_channels(read_public_set(name, folder / name))
        splits = SPLITS[name](recordings)
        cases = _list_cases(
            splits, settings.classifiers, work.seeds, fingerprint_recordings(recordings)
        )
        runs = work.map(name, _Case.run, [(case, work.out) for case in cases])
        rows += zip(cases, runs, strict=True)
        for split in splits:
            leaky += [trial_at_random(split, seed) for seed in work.seeds]

    trials = _trials(rows)
    refusals = set()
    for case, row in rows:
        if "refused" in row:
            refusals.add(f"{case.split.name}, {case.classifier}: {row['refused']}")
    missing = [name for name in settings.sets or SPLITS if name not in sets]
    skipped = [f"{name} is not in {folder.name} and was skipped." for name in missing]

    return StudyTable(
        study="public",
        title="Real recordings, honest splits: the training of somebody who sets nothing",
        metrics=METRICS,
        trials=(*trials, *leaky),
        answer=_answer(trials, settings.classifiers),
        settings={"sets": sets},
        origin=(
            "Public recordings of real machines; none of them is an axial piston pump with known "
            "faults."
        ),
        notes=(*_NOTES, *sorted(refusals), *skipped),
        details={"folds": [_describe_fold(case, row) for case, row in rows]},
    )


def _available_sets(folder: Path, sets: Sequence[str]) -> list[str]:
    """Return the requested sets, or all, that `folder` holds."""
    unknown = [name for name in sets if name not in SPLITS]
    if unknown:
        raise InputError(f"Invalid set {unknown[0]!r}: must be one of {', '.join(SPLITS)}.")

    available = [name for name in sets or SPLITS if (folder / name).is_dir()]
    if not available:
        raise DataError(
            f"{folder} holds no folder called {' or '.join(sets or SPLITS)}. "
            "Give the folder that holds them."
        )

    return available


def _list_cases(
    splits: Sequence[Split], classifiers: Sequence[str], seeds: Sequence[int], data: str
) -> list[_Case]:
    cases = []
    for split in splits:
        for classifier in classifiers:
            for seed in seeds:
                cases += [_Case(split, fold, classifier, seed, data) for fold in split.folds]

    return cases


def _describe_fold(case: _Case, row: Mapping[str, Any]) -> dict[str, Any]:
    """Return the factors and figures of one fold."""
    figures = {name: row[name] for name in FOLD_FIGURES if name in row}
    return {**case.task.factors, "seed": case.seed, **figures}


def trial_at_random(split: Split, seed: int) -> Trial:
    """Return the balanced accuracy of extra trees on windows assigned at random to five folds."""
    groups: set[str] = set()
    for fold in split.folds:
        groups |= fold.train | fold.test
    recordings = split.select(groups)

    windows = cut_windows(
        recordings, length=default_window(recordings), allow_partial_revolution=True
    )
    trees = ExtraTreesClassifier(100, random_state=seed, class_weight="balanced", n_jobs=1)
    folds = StratifiedKFold(5, shuffle=True, random_state=seed)
    predicted = cross_val_predict(trees, feature_values(windows.signal), windows.label, cv=folds)

    values = dict.fromkeys(METRICS, np.nan) | {
        "balanced_accuracy": float(balanced_accuracy_score(windows.label, predicted)),
        "floor": split.floor,
        "window": float(windows.length),
    }
    return Trial({"split": split.name, "classifier": AT_RANDOM}, seed, values)


def _drop_constant_channels(recordings: Sequence[Recording]) -> list[Recording]:
    """Return the recordings without channels that are constant in any of them.

    No training accepts a constant channel.
    """
    # All recordings need the same channels, so one constant signal excludes its channel.
    varies = np.all([np.ptp(recording.signal, axis=1) > 0 for recording in recordings], axis=0)
    channels = np.array(recordings[0].channels)[varies].tolist()

    return [recording.select_channels(channels) for recording in recordings]


def _trials(rows: Sequence[tuple[_Case, Mapping[str, Any]]]) -> tuple[Trial, ...]:
    """Return a trial for each split, classifier and seed.

    Its values are means over the folds, NaN if a fold was refused.
    """
    folds_by_factors: dict[tuple[str, str, int], list[Mapping[str, Any]]] = {}
    floors: dict[str, float] = {}
    for case, row in rows:
        floors[case.split.name] = case.split.floor
        factors = (case.split.name, case.classifier, case.seed)
        folds_by_factors.setdefault(factors, []).append(row)

    trials = []
    for (split, classifier, seed), folds in folds_by_factors.items():
        values: dict[str, float] = {}
        for name in METRICS:
            if name == "floor":
                continue
            values[name] = float(np.mean([fold.get(name, np.nan) for fold in folds]))
        values["floor"] = floors[split]
        trials.append(Trial({"split": split, "classifier": classifier}, seed, values))

    return tuple(trials)


def _answer(trials: Sequence[Trial], classifiers: Sequence[str]) -> tuple[str, ...]:
    """Return means over the splits of kinds of vibration, compared with the floor."""
    floors = {trial.factors["split"]: trial.values["floor"] for trial in trials}
    sentences = []

    for classifier in classifiers:
        accuracies: dict[str, list[float]] = {}
        distances: list[float] = []
        for trial in trials:
            split = trial.factors["split"]
            # The hydraulic rig has no vibration signal.
            if trial.factors["classifier"] != classifier or split.startswith("uci_hydraulic"):
                continue
            distance = trial.values["grade_distance"]
            if not math.isnan(distance):
                distances.append(distance)
                continue
            accuracy = trial.values["recording_balanced_accuracy"]
            accuracies.setdefault(split, []).append(accuracy)
        if distances:
            sentences.append(f"{classifier}: {np.mean(distances):.2f} grades from the right one.")
        if not accuracies:
            continue

        means = {split: float(np.mean(values)) for split, values in accuracies.items()}
        above = sum(mean >= floors[split] for split, mean in means.items())
        floor = np.mean([floors[split] for split in means])
        sentences.append(
            f"{classifier}: {np.mean(list(means.values())):.2f} by recording in the mean of "
            f"{plural(len(means), 'split')} of vibration (floor {floor:.2f}); "
            f"at or above the floor on {above}."
        )

    return tuple(sentences)
