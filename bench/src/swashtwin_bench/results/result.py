"""What a study of classifiers found: a table of scores, and the runs that it is made from.

Its JSON is a `StudyTable`'s with ``size``, ``rivals``, ``contrasts``, ``cells``, ``splits``, ``fingerprints``,
``calibrations`` and ``runs`` beside; rows hold the factors that name them (``classifier``, ``training_set``, ``level``,
...) and ``{"mean", "std", "values"}`` over the seeds under each metric.
"""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from swashtwin.calibration import Calibration
from swashtwin.foundation import holm_correction
from swashtwin.learning import Epoch
from swashtwin_bench.results.contrasts import Contrast, paired_interval, signed_rank_p
from swashtwin_bench.results.runs import Outcome, Run
from swashtwin_bench.results.table import StudyTable, Trial

METRICS = {
    "accuracy": "accuracy",
    "recall": "macro recall",
    "f1": "macro F1",
    "g_mean": "G-mean",
    "g_mean_laplace": "G_ε",
    "recording_accuracy": "accuracy by recording",
    "scarce_recall": "recall in the scarce cell",
}
"""Heading of each metric; the recall of each class and further values of a study follow."""


@dataclass(frozen=True, eq=False)
class TrainingCurve:
    """How one training went."""

    factors: Mapping[str, str]
    """Which training set and classifier."""
    seed: int
    """Seed."""
    epochs: tuple[Epoch, ...]
    """One entry an epoch."""

    @property
    def training_set(self) -> str:
        """Name of the training set."""
        return self.factors["training_set"]

    @property
    def classifier(self) -> str:
        """Name of the classifier."""
        return self.factors["classifier"]


@dataclass(frozen=True, eq=False, kw_only=True)
class StudyResult(StudyTable):
    """A study's table together with its runs."""

    size: str
    """Name of the settings, such as ``"quick"``."""
    runs: tuple[Run, ...]
    """Runs of all finished tasks."""
    main_classifier: str
    """Classifier that the study is about; others are its rivals."""
    rival_names: tuple[str, ...] = ()
    """Classifiers whose rows stand beside the study's, not among them."""
    contrasts: tuple[Contrast, ...] = ()
    """Which rows beat which."""
    calibrations: tuple[Calibration, ...] = ()
    """Calibrations of the first seed, as far as there are files of them."""

    @property
    def commands(self) -> tuple[str, ...]:
        """Command lines that repeat it: its own, or those of its runs where it was collected from several commands."""
        commands = (self.command,) if self.command else (run.command for run in self.runs)
        return tuple(dict.fromkeys(command for command in commands if command))

    @property
    def outcomes(self) -> tuple[Outcome, ...]:
        """Every score of the study's rows."""
        return tuple(
            outcome for run in self.runs for outcome in run.outcomes if outcome.classifier not in self.rival_names
        )

    @property
    def rivals(self) -> tuple[Outcome, ...]:
        """Every score of the rivals beside them."""
        return tuple(outcome for run in self.runs for outcome in run.outcomes if outcome.classifier in self.rival_names)

    @property
    def classes(self) -> tuple[str, ...]:
        """Class names."""
        return self.runs[0].outcomes[0].scores.classes

    @property
    def curves(self) -> tuple[TrainingCurve, ...]:
        """Every training in epochs."""
        return tuple(TrainingCurve(run.task.factors, run.task.seed, run.history) for run in self.runs if run.history)

    @property
    def embedded_runs(self) -> tuple[Run, ...]:
        """Networks under the first seed whose features stand beside each other: the study's own on each training set,
        or all of them where there is one training set only."""
        first = [run for run in self.runs if run.task.seed == self.seeds[0] and run.history]
        several = len({trained_on(run) for run in first}) > 1
        return tuple(run for run in first if not several or run.task.factors["classifier"] == self.main_classifier)

    @property
    def cells(self) -> dict[str, dict[str, int]]:
        """Windows by class and pressure in each training set and test set, first seed; a test set that what the study
        varies does not change appears once."""
        first = [run for run in self.runs if run.task.seed == self.seeds[0]]
        trained = {trained_on(run): dict(run.cells["train"]) for run in first}
        tested: dict[str, dict[str, int]] = {}
        for run in first:
            for name in run.cells.keys() - {"train"}:
                counts = dict(run.cells[name])
                if tested.setdefault(name, counts) != counts:
                    tested[", ".join([name, *varied_of(run)])] = counts
        return {**trained, **dict(sorted(tested.items()))}

    def contrast(self, first: Mapping[str, str], second: Mapping[str, str], *, metric: str = "accuracy") -> Contrast:
        """How much the row of some factors is above the row of others, whether or not the study sets out to compare
        them; its p-value is not corrected for others, and therefore left out."""
        return _contrast(self.trials, self.runs, tuple(first.items()), tuple(second.items()), metric)[0]

    def rows(self, *, rivals: bool = False) -> list[dict[str, Any]]:
        """One row for each set of factors; those of the rivals beside the study's own on demand."""
        return [row for row in super().rows() if (row["classifier"] in self.rival_names) is rivals]

    def to_dict(self) -> dict[str, Any]:
        """The study's JSON."""
        splits: dict[str, dict[str, Any]] = {}
        fingerprints: dict[str, dict[str, str]] = {}
        for run in self.runs:
            name = ", ".join([str(run.task.seed), *varied_of(run)])
            splits[name] = dict(run.roles)
            names = {name: trained_on(run) if name == "train" else name for name in run.fingerprints}
            named = {names[name]: value for name, value in run.fingerprints.items()}
            fingerprints[name] = {**fingerprints.get(name, {}), **named}
        return {
            **super().to_dict(),
            "command": " && ".join(self.commands),
            "size": self.size,
            "rivals": self.rows(rivals=True),
            "contrasts": [contrast.to_dict() for contrast in self.contrasts],
            "cells": self.cells,
            "splits": splits,
            "fingerprints": fingerprints,
            "calibrations": [_calibration_row(calibration) for calibration in self.calibrations],
            "runs": [
                {
                    "key": run.task.key,
                    "wall_s": round(run.wall_s, 3),
                    "cpu_s": round(run.cpu_s, 3),
                    "device": run.device,
                }
                for run in self.runs
            ],
        }


def trained_on(run: Run) -> str:
    """Name of a run's training set, with whatever else than the classifier names the run."""
    return ", ".join(value for name, value in run.task.factors.items() if name != "classifier")


def varied_of(run: Run) -> tuple[str, ...]:
    """What a study varies besides training set and classifier."""
    return tuple(value for name, value in run.task.factors.items() if name not in ("classifier", "training_set"))


def trials_of(runs: Sequence[Run]) -> tuple[Trial, ...]:
    """One trial for each row and seed: the mean over draws of noise."""
    grouped: dict[tuple[tuple[tuple[str, str], ...], int], list[dict[str, float]]] = {}
    for run in runs:
        for outcome in run.outcomes:
            key = (tuple(outcome.factors.items()), outcome.seed)
            grouped.setdefault(key, []).append({**values_of(outcome), **run.values, "wall_s": run.wall_s})
    return tuple(
        Trial(dict(factors), seed, {name: float(np.mean([value[name] for value in values])) for name in values[0]})
        for (factors, seed), values in grouped.items()
    )


def values_of(outcome: Outcome) -> dict[str, float]:
    """Number under each metric of one score."""
    scores = outcome.scores
    return {
        "accuracy": scores.accuracy,
        "recall": scores.macro_recall,
        "f1": scores.macro_f1,
        "g_mean": scores.g_mean,
        "g_mean_laplace": scores.g_mean_laplace,
        "recording_accuracy": scores.recording_accuracy,
        "scarce_recall": outcome.scarce_recall,
        **{f"recall_{name}": value for name, value in scores.recall.items()},
    }


def contrasts_of(
    trials: Sequence[Trial],
    runs: Sequence[Run],
    compared: Mapping[str, str | Mapping[str, Sequence[str]]],
    bare: str | None = None,
) -> tuple[Contrast, ...]:
    """Differences of accuracy between the row that holds a factor's compared value and those that hold another.

    Parameters
    ----------
    compared : factor and the value that all its others are compared with, all else alike, or several values, each with
        those that it is compared with.
    bare : value of the varied factor for rows of no synthetic window, which are compared with those of every value.
    """
    rows = list(dict.fromkeys(_row(trial) for trial in trials))
    contrasts: list[Contrast] = []
    for factor, value, others in _families(rows, compared):
        for key in (row for row in rows if dict(row).get(factor) == value):
            compared_rows = [
                row for row in rows if dict(row).get(factor) in others and _alike(dict(key), dict(row), factor, bare)
            ]
            family = [pair for row in compared_rows if (pair := _contrast(trials, runs, key, row))[1]]
            raw = [math.nan if contrast.is_corrected else signed_rank_p(points) for contrast, points in family]
            contrasts += [
                replace(contrast, p_value=round(float(p_value), 12))
                for (contrast, _), p_value in zip(family, holm_correction(np.array(raw)), strict=True)
            ]
    return tuple(contrasts)


Row = tuple[tuple[str, str], ...]


def _families(
    rows: Sequence[Row], compared: Mapping[str, str | Mapping[str, Sequence[str]]]
) -> Iterator[tuple[str, str, Collection[str]]]:
    """Factor, value, and the values that it is compared with."""
    for factor, target in compared.items():
        if isinstance(target, str):
            yield factor, target, {dict(row)[factor] for row in rows if factor in dict(row)} - {target}
        else:
            yield from ((factor, value, others) for value, others in target.items())


def _alike(first: Mapping[str, str], second: Mapping[str, str], factor: str, bare: str | None) -> bool:
    """Whether rows differ in a factor only; what has no synthetic window belongs to every value of what is varied."""
    return all(
        first[name] == second[name]
        or (name not in ("classifier", "training_set", "level") and bare in (first[name], second[name]))
        for name in first
        if name != factor
    )


def _row(trial: Trial) -> Row:
    return tuple(trial.factors.items())


def _contrast(
    trials: Sequence[Trial], runs: Sequence[Run], first: Row, second: Row, metric: str = "accuracy"
) -> tuple[Contrast, list[float]]:
    value = {(_row(trial), trial.seed): trial.values[metric] for trial in trials if _row(trial) in (first, second)}
    seeds = [seed for row, seed in value if row == first and (second, seed) in value]
    points = [value[first, seed] - value[second, seed] for seed in seeds]
    share = _test_share(runs, dict(first))
    mean = float(np.mean(points)) if points else float("nan")
    interval = paired_interval(points, share)
    contrast = Contrast(dict(first), dict(second), metric, mean, interval, len(points), float("nan"), share is not None)
    return contrast, points


def _test_share(runs: Sequence[Run], row: Mapping[str, str]) -> float | None:
    """Test recordings over training recordings of a row; None where each seed has recordings of its own."""
    if len({run.task.data for run in runs}) > 1:
        return None
    roles = next(run.roles for run in runs if run.task.factors.items() <= row.items())
    return len(roles[row["level"]]) / max(1, len(roles["train"]))


def _calibration_row(calibration: Calibration) -> dict[str, Any]:
    return {
        "pump": calibration.twin.pump.name,
        "recording_ids": list(calibration.recording_ids),
        "fit_before": asdict(calibration.fit_before),
        "fit_after": asdict(calibration.fit_after),
        "estimates": [asdict(estimate) for estimate in calibration.estimates],
    }
