"""What a study of classifiers found: rows of scores, and the runs that they are of.

Its JSON is a `StudyTable`'s with ``size``, ``differences``, ``cells``, ``splits``,
``fingerprints``, ``calibrations`` and ``runs`` beside; rows hold the factors that name them
(``classifier``, ``training_set``, ``split``,
...) and ``{"mean", "std", "values"}`` over the seeds under each metric.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import product
from typing import Any

import numpy as np

from swashtwin.calibration import Calibration
from swashtwin.learning import Scores
from swashtwin_bench.results.naming import format_factor
from swashtwin_bench.results.runs import Run
from swashtwin_bench.results.table import StudyTable, Trial, paired_interval

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

FURTHER = {"discriminator": "AUROC measured/synthetic", "wall_s": "time of one run [s]"}
"""Headings of the figures of a training, whatever it is tested on."""

MAX_DIFFERENCES = 4
"""Differences in the answer for each test, of classifiers the nearest ones; the table has all."""

TESTS = ("split", "perturbation")
"""Factors that name a test."""

Row = Mapping[str, str]
"""Factors that name a row."""


def build_score_row(scores: Scores, scarce_recall: float) -> dict[str, Any]:
    """Numbers of one test as a run's file holds them, with confusion, interval and reasons.

    Parameters
    ----------
    scarce_recall : recall of the measured windows of the cells that were scarce; NaN where the test
        has none.
    """
    return {
        "accuracy": scores.accuracy,
        "recall": scores.macro_recall,
        "f1": scores.macro_f1,
        "g_mean": scores.g_mean,
        "g_mean_laplace": scores.g_mean_laplace,
        "recording_accuracy": scores.recording_accuracy,
        "scarce_recall": scarce_recall,
        **{f"recall_{name}": value for name, value in scores.recall.items()},
        "confusion": scores.confusion.tolist(),
        "accuracy_interval": list(scores.accuracy_interval),
        "reasons": dict(scores.reasons),
    }


def build_trials(runs: Sequence[Run]) -> tuple[Trial, ...]:
    """One trial for each row and seed: the mean over draws of noise."""
    grouped: dict[tuple[tuple[tuple[str, str], ...], int], list[dict[str, float]]] = {}
    for run in runs:
        for row in run["rows"]:
            factors = {**run["factors"], **{name: row[name] for name in TESTS if name in row}}
            numbers = {name: value for name, value in row.items() if isinstance(value, float)}
            values = {**numbers, **run["values"], "wall_s": run["wall_s"]}
            grouped.setdefault((tuple(factors.items()), run["seed"]), []).append(values)
    return tuple(
        Trial(
            dict(factors),
            seed,
            {name: float(np.mean([each[name] for each in values])) for name in values[0]},
        )
        for (factors, seed), values in grouped.items()
    )


@dataclass(frozen=True)
class Difference:
    """How much the accuracy of one row is above that of another, in the mean over the seeds that
    both have.
    """

    first: Row
    """Factors of the one."""
    second: Row
    """Factors of the other."""
    factor: str
    """Factor in which they differ."""
    mean: float
    """Mean of the differences, first less second; NaN where no seed has both."""
    interval: tuple[float, float]
    """95 % interval of it, NaN for one seed: Student's where each seed is a fleet of its own, that
    of the corrected resampled t where the seeds split the same recordings.
    """
    pairs: int
    """Seeds that both have."""

    @property
    def is_clear(self) -> bool:
        """Whether the interval excludes zero; one without width says only that too little was
        tested to differ.
        """
        low, high = self.interval
        return high - low > 1e-9 and (low > 0 or high < 0)

    @property
    def sentence(self) -> str:
        """The difference in points."""
        first = format_factor(self.factor, self.first[self.factor])
        second = format_factor(self.factor, self.second[self.factor])
        text = f"{first} less {second}"
        if self.factor != "classifier":
            text += f" ({format_factor('classifier', self.first['classifier'])})"
        points = f"{text}: {100 * self.mean:+.1f} points"
        if self.pairs < 2:
            return f"{points}, one seed."
        low, high = (100 * end for end in self.interval)
        return f"{points} ({low:+.1f} to {high:+.1f}){'' if self.is_clear else ', which may be chance'}."

    def to_dict(self) -> dict[str, Any]:
        """The difference as JSON can hold it."""
        interval = [None if math.isnan(end) else end for end in self.interval]
        mean = None if math.isnan(self.mean) else self.mean
        return {"first": dict(self.first), "second": dict(self.second), "mean": mean, "interval": interval,
                "pairs": self.pairs}  # fmt: skip


@dataclass(frozen=True, eq=False, kw_only=True)
class StudyResult(StudyTable):
    """A study's table together with its runs."""

    size: str
    """Name of the settings, such as ``"quick"``."""
    runs: tuple[Run, ...]
    """Every training with its tests, in the order of the rows."""
    reference_values: Mapping[str, str] = field(default_factory=dict)
    """Factor and the value that all its others are compared with."""
    unfilled_variant: str | None = None
    """Value of what is varied for rows of no synthetic window, which are compared with those of
    every value.
    """
    calibrations: tuple[Calibration, ...] = ()
    """Calibrations of the first seed, as far as there are files of them."""

    @property
    def main_classifier(self) -> str:
        """Classifier that the study is about."""
        return str(self.runs[0]["factors"]["classifier"])

    @property
    def classes(self) -> tuple[str, ...]:
        """Class names."""
        return tuple(self.runs[0]["classes"])

    @property
    def first_runs(self) -> list[Run]:
        """Runs of the first seed."""
        return [run for run in self.runs if run["seed"] == self.seeds[0]]

    def tests(self, **factors: str) -> list[tuple[Run, dict[str, Any]]]:
        """(run, row of its file) of each test of those factors."""
        return [
            (run, row)
            for run in self.runs
            for row in run["rows"]
            if all({**run["factors"], **row}[name] == value for name, value in factors.items())
        ]

    def difference(
        self, first: Row, second: Row, factor: str, metric: str = "accuracy"
    ) -> Difference:
        """How much the row of some factors is above the row of others, paired by seed."""
        values = [
            {trial.seed: trial.values[metric] for trial in self.of(**row)}
            for row in (first, second)
        ]
        pairs = [value - values[1][seed] for seed, value in values[0].items() if seed in values[1]]
        pairs = [pair for pair in pairs if math.isfinite(pair)]
        mean = float(np.mean(pairs)) if pairs else math.nan
        return Difference(
            first, second, factor, mean, paired_interval(pairs, self._test_share(first)), len(pairs)
        )

    def _test_share(self, row: Row) -> float | None:
        """Test recordings over training recordings of a row; None where each seed has recordings of
        its own.
        """
        if len({run["data"] for run in self.runs}) > 1:
            return None
        roles = next(run["roles"] for run in self.runs if run["factors"].items() <= row.items())
        return len(roles[row["split"]]) / max(1, len(roles["train"]))

    def differences(self) -> list[Difference]:
        """Differences between the row that holds a factor's compared value and those that hold
        another, all else alike; rows of no synthetic window belong to every value of what is
        varied.
        """
        rows = [
            dict(key)
            for key in dict.fromkeys(tuple(trial.factors.items()) for trial in self.trials)
        ]

        def alike(first: Row, second: Row, factor: str) -> bool:
            return all(
                first[name] == second[name]
                or (
                    name not in ("classifier", "training_set", *TESTS)
                    and self.unfilled_variant in (first[name], second[name])
                )
                for name in first
                if name != factor
            )

        pairs = [
            self.difference(first, second, factor)
            for factor, value in self.reference_values.items()
            for first, second in product(rows, rows)
            if first.get(factor) == value
            and second.get(factor, value) != value
            and alike(first, second, factor)
        ]
        return [pair for pair in pairs if pair.pairs]

    def sentences(self) -> tuple[str, ...]:
        """For each test the best row of those of as many seeds as any, and what the study
        compares.
        """
        sentences = []
        rows, differences = self.rows(), self.differences()
        for test in dict.fromkeys(tuple(row.get(name, "") for name in TESTS) for row in rows):
            of_test = [row for row in rows if tuple(row.get(name, "") for name in TESTS) == test]
            most = max(len(row["accuracy"]["values"]) for row in of_test)
            of_all = [row for row in of_test if len(row["accuracy"]["values"]) == most]
            among = "" if len(of_all) == len(of_test) else f" of those of {most} seeds"
            best = max(of_all, key=lambda row: row["accuracy"]["mean"] or 0.0)
            named = ", ".join(
                format_factor(name, best[name]) for name in self.factors if name not in TESTS
            )
            pairs = [
                pair
                for pair in differences
                if tuple(pair.first.get(name, "") for name in TESTS) == test
            ]
            if all(pair.factor == "classifier" for pair in pairs):
                pairs.sort(key=lambda pair: pair.mean)
            text = f"{', '.join(filter(None, test))}: highest accuracy{among} {best['accuracy']['mean']:.3f} ({named})."
            sentences.append(" ".join([text, *(pair.sentence for pair in pairs[:MAX_DIFFERENCES])]))
        return tuple(sentences)

    @property
    def cells(self) -> dict[str, dict[str, int]]:
        """Windows by class and pressure in each training set and test set, first seed; a test set
        that what the study varies does not change stands once.
        """
        trained = {name_run(run, "classifier"): run["cells"]["train"] for run in self.first_runs}
        tested: dict[str, dict[str, int]] = {}
        for run in self.first_runs:
            for name in run["cells"].keys() - {"train"}:
                counts = run["cells"][name]
                if tested.setdefault(name, counts) != counts:
                    tested[f"{name}, {name_run(run, 'classifier', 'training_set')}"] = counts
        return {**trained, **dict(sorted(tested.items()))}

    def to_dict(self) -> dict[str, Any]:
        """The study's JSON."""
        splits: dict[str, dict[str, Any]] = {}
        fingerprints: dict[str, dict[str, str]] = {}
        for run in self.runs:
            name = ", ".join(
                filter(None, (str(run["seed"]), name_run(run, "classifier", "training_set")))
            )
            splits[name] = dict(run["roles"])
            named = {
                part if part != "train" else name_run(run, "classifier"): v
                for part, v in run["sha256"].items()
            }
            fingerprints.setdefault(name, {}).update(named)
        return {
            **super().to_dict(),
            "size": self.size,
            "differences": [difference.to_dict() for difference in self.differences()],
            "cells": self.cells,
            "splits": splits,
            "fingerprints": fingerprints,
            "calibrations": [
                {
                    "pump": calibration.twin.pump.name,
                    "recording_ids": list(calibration.recording_ids),
                    "nominal_agreement": asdict(calibration.nominal_agreement),
                    "calibrated_agreement": asdict(calibration.calibrated_agreement),
                    "estimates": [asdict(estimate) for estimate in calibration.estimates],
                }
                for calibration in self.calibrations
            ],
            "runs": [
                {name: run[name] for name in ("key", "wall_s", "cpu_s", "device")}
                for run in self.runs
            ],
        }


def name_run(run: Run, *others: str) -> str:
    """What names a run besides `others`."""
    return ", ".join(value for name, value in run["factors"].items() if name not in others)
