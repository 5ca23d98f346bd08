"""The ordinary training on every public set, on splits that keep groups apart, beside windows dealt
at random.
"""

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
    "floor": "floor (reference trees)",
    "window": "samples per window",
    "cpu_s": "processor time of a training and its test [s]",
}

AT_RANDOM = "extra trees, random windows"
"""Row of the score that a leaky split would print."""

_NOTES = (
    "The groups named by the split are kept apart; balanced accuracy, folds averaged. Nothing is set but the "
    "recordings and the seed: window, scaling, gain and noise in training are the training's to choose, from the "
    "training side alone. Other classifiers take the default's window.",
    f"{AT_RANDOM}: five folds of windows dealt at random, as in many papers, so that windows of one recording are on "
    "both sides.",
    "Channels that are constant in any recording of a set are left out of it (PS4 of uci_hydraulic).",
    "A seed draws the training anew; the sides are always whole, but for test recordings that hold the same samples as "
    "a training recording under another name (details.folds counts them as copies).",
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
        settings = {name: str(value) for name, value in self.estimator(()).get_params().items()}
        settings |= Model(BEST_CANDIDATE).describe() if self.classifier == BEST_CANDIDATE else {}
        sides = {"train": sorted(self.fold.train), "test": sorted(self.fold.test)}
        factors = {"classifier": self.classifier, "split": self.split.name, "fold": self.fold.name}
        return Task("public", self.seed, factors, {"model": settings, **sides}, self.data)

    def estimator(self, train: Sequence[Recording]) -> FaultClassifier:
        """The classifier before its training; others than the default take the default's
        windows.
        """
        if self.classifier == BEST_CANDIDATE:
            return FaultClassifier(seed=self.seed)
        window = default_window(train) if train else None
        scaling = "none" if self.classifier in ON_FEATURES else RECOMMENDED_TRAINING.normalization
        return FaultClassifier(
            self.classifier, window=window, normalization=scaling, seed=self.seed
        )

    def run(self, out: Path | None) -> dict[str, Any]:
        """Its run, read or done."""
        return self.task.run(out, self.values)

    def values(self) -> dict[str, Any]:
        """Scores on the test side, and what they cost."""
        begun = time.process_time()
        train, test = (
            [
                recording
                for recording in self.split.recordings
                if self.split.group(recording) in side
            ]
            for side in (self.fold.train, self.fold.test)
        )
        try:
            classifier = self.estimator(train).fit(train)
            unseen, _ = unseen_recordings(classifier.fitted_.manifest, test)
            by_window = classifier.evaluate(unseen).macro_recall
            predicted = classifier.predict(unseen)
        except (DataError, InputError) as cause:
            return {"refused": str(cause)}
        label = np.array([recording.label for recording in unseen])
        return {
            "balanced_accuracy": by_window,
            "recording_balanced_accuracy": float(balanced_accuracy_score(label, predicted)),
            "copies": len(test) - len(unseen),
            "choice": ""
            if (choice := getattr(classifier.fitted_, "choice", None)) is None
            else choice.sentence(),
            "window": classifier.fitted_.layout.length,
            "cpu_s": time.process_time() - begun,
        }


@dataclass(frozen=True)
class PublicSettings:
    """What is asked of which sets."""

    classifiers: tuple[str, ...] = (BEST_CANDIDATE, "extra_trees")
    """``"chosen"``, what `FaultClassifier` trains by itself, or names that it takes."""
    sets: tuple[str, ...] = ()
    """Names of the sets to ask; all that are there by default."""


def public(work: Work, settings: PublicSettings, folder: Path) -> StudyTable:
    """Scores of classifiers with default settings on splits that keep machines, speeds or runs
    apart.

    Parameters
    ----------
    work : its seeds are of the trainings.
    folder : a folder with one folder for each public set, named as in `SPLITS`; missing sets are
        left out.

    Raises
    ------
    InputError
        There is no such set or classifier.
    DataError
        `folder` holds none of them.
    """
    for name in settings.classifiers:
        if name not in (BEST_CANDIDATE, *NETWORKS):
            raise InputError(
                f"no classifier is called {name!r}; there are {BEST_CANDIDATE}, {', '.join(NETWORKS)}."
            )
    there = _sets_there(Path(folder), settings.sets)
    rows: list[tuple[_Case, dict[str, Any]]] = []
    leaky: list[Trial] = []
    for name in there:
        recordings = _live(read_public_set(name, Path(folder) / name))
        data, splits = fingerprint_recordings(recordings), SPLITS[name](recordings)
        cases = [
            _Case(split, fold, classifier, seed, data)
            for split in splits
            for classifier in settings.classifiers
            for seed in work.seeds
            for fold in split.folds
        ]
        rows += zip(
            cases, work.map(name, _Case.run, [(case, work.out) for case in cases]), strict=True
        )
        leaky += [trial_at_random(split, seed) for split in splits for seed in work.seeds]
    trials = _trials(rows)
    refused = {
        f"{case.split.name}, {case.classifier}: {row['refused']}"
        for case, row in rows
        if "refused" in row
    }
    missing = [name for name in settings.sets or SPLITS if name not in there]
    absent = (f"{name} is not in {Path(folder).name} and was left out." for name in missing)
    shown = (
        "balanced_accuracy",
        "recording_balanced_accuracy",
        "copies",
        "choice",
        "window",
        "cpu_s",
        "refused",
    )
    return StudyTable(
        study="public",
        title="Real recordings, honest splits: the training of somebody who sets nothing",
        metrics=METRICS,
        trials=(*trials, *leaky),
        answer=_answer(trials, settings.classifiers),
        settings={"sets": there},
        origin="Public recordings of real machines; none of them is an axial piston pump with known faults.",
        notes=(*_NOTES, *sorted(refused), *absent),
        details={
            "folds": [
                {
                    **case.task.factors,
                    "seed": case.seed,
                    **{name: row[name] for name in shown if name in row},
                }
                for case, row in rows
            ]
        },
    )


def _sets_there(folder: Path, sets: Sequence[str]) -> list[str]:
    """Sets asked for, or all, that `folder` holds."""
    unknown = [name for name in sets if name not in SPLITS]
    if unknown:
        raise InputError(f"{unknown[0]!r} is none of the sets asked about: {', '.join(SPLITS)}.")
    there = [name for name in sets or SPLITS if (folder / name).is_dir()]
    if not there:
        raise DataError(
            f"{folder} holds no folder called {' or '.join(sets or SPLITS)}; name the folder that holds them."
        )
    return there


def trial_at_random(split: Split, seed: int) -> Trial:
    """Balanced accuracy of extra trees over five folds of windows dealt at random."""
    groups = frozenset().union(*(fold.train | fold.test for fold in split.folds))
    recordings = [recording for recording in split.recordings if split.group(recording) in groups]
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


def _live(recordings: Sequence[Recording]) -> list[Recording]:
    """The recordings without channels that are constant in any of them, which no training takes."""
    is_live = np.all([np.ptp(recording.signal, axis=1) > 0 for recording in recordings], axis=0)
    channels = [name for name, live in zip(recordings[0].channels, is_live, strict=True) if live]
    return [recording.select_channels(channels) for recording in recordings]


def _trials(rows: Sequence[tuple[_Case, Mapping[str, Any]]]) -> tuple[Trial, ...]:
    """One trial for each split, classifier and seed: the mean over the folds, NaN where one was
    refused.
    """
    grouped: dict[tuple[str, str, int], list[Mapping[str, Any]]] = {}
    floors = {case.split.name: case.split.floor for case, _ in rows}
    for case, row in rows:
        grouped.setdefault((case.split.name, case.classifier, case.seed), []).append(row)
    trials = []
    for (split, classifier, seed), folds in grouped.items():
        means = {
            name: float(np.mean([fold.get(name, np.nan) for fold in folds]))
            for name in METRICS
            if name != "floor"
        }
        trials.append(
            Trial(
                {"split": split, "classifier": classifier}, seed, {**means, "floor": floors[split]}
            )
        )
    return tuple(trials)


def _answer(trials: Sequence[Trial], classifiers: Sequence[str]) -> tuple[str, ...]:
    """Means over the splits of vibration, against the floor."""
    sentences = []
    for classifier in classifiers:
        of_split: dict[str, list[float]] = {}
        for trial in trials:
            if trial.factors["classifier"] == classifier and not trial.factors["split"].startswith(
                "uci_hydraulic"
            ):
                of_split.setdefault(trial.factors["split"], []).append(
                    trial.values["recording_balanced_accuracy"]
                )
        if means := {split: float(np.mean(values)) for split, values in of_split.items()}:
            floors = {trial.factors["split"]: trial.values["floor"] for trial in trials}
            above = sum(mean >= floors[split] for split, mean in means.items())
            floor = np.mean([floors[split] for split in means])
            sentences.append(
                f"{classifier}: {np.mean(list(means.values())):.2f} by recording in the mean of "
                f"{plural(len(means), 'split')} of vibration (floor {floor:.2f}); at or above the floor on {above}."
            )
    return tuple(sentences)
