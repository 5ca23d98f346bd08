"""Result of a study of classifiers: rows of scores, and the runs that they come from.

Its JSON is that of a `StudyTable` with ``size``, ``differences``, ``cells``, ``splits``,
``fingerprints``, ``calibrations`` and ``runs`` in addition. A row contains its factors
(``classifier``, ``training_set``, ``split``, ...) and, for each metric, ``{"mean", "std",
"values"}`` over the seeds.
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
"""Heading of each metric; the recall of each class and the values of the runs follow."""

RUN_METRICS = {"discriminator": "AUROC measured/synthetic", "wall_s": "time of one run [s]"}
"""Headings of the values of a run, which do not depend on the test."""

MIN_INTERVAL_WIDTH = 1e-9
"""Width of an interval that is more than a rounding error."""

MAX_DIFFERENCES = 4
"""Maximum number of differences in the answer for each test; the table has all.

Of classifiers they are the best ones.
"""

TEST_FACTORS = ("split", "perturbation")
"""Factors that identify a test."""

Row = Mapping[str, str]
"""Factors of a row."""

Contrasts = Mapping[str, Sequence[tuple[str, str]]]
"""Pairs of training sets, of which the second is subtracted from the first, by their question."""


def build_score_row(scores: Scores, scarce_recall: float) -> dict[str, Any]:
    """Return the row of one test in a run's file: scores, confusion, interval and reasons.

    Parameters
    ----------
    scarce_recall : recall of the measured windows in the scarce cells; NaN if the test has none.
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
    """Return one trial for each row and seed: the mean over the draws of a perturbation."""
    values_by_trial: dict[tuple[tuple[tuple[str, str], ...], int], list[dict[str, float]]] = {}
    for run in runs:
        for row in run["rows"]:
            factors = {**run["factors"], **factors_of_test(row)}
            scores = {name: value for name, value in row.items() if isinstance(value, float)}
            values = {**scores, **run["values"], "wall_s": run["wall_s"]}
            values_by_trial.setdefault((tuple(factors.items()), run["seed"]), []).append(values)

    trials = []
    for (key, seed), draws in values_by_trial.items():
        means: dict[str, float] = {}
        for name in draws[0]:
            means[name] = float(np.mean([draw[name] for draw in draws]))
        trials.append(Trial(dict(key), seed, means))

    return tuple(trials)


def factors_of_test(row: Mapping[str, Any]) -> dict[str, str]:
    """Return the factors of a row that identify its test."""
    return {name: row[name] for name in TEST_FACTORS if name in row}


@dataclass(frozen=True)
class Difference:
    """Difference of a metric between two rows, averaged over the seeds that both have."""

    first: Row
    """Factors of the first row."""
    second: Row
    """Factors of the second row."""
    factor: str
    """Factor in which they differ."""
    mean: float
    """Mean of first minus second; NaN if no seed has both."""
    interval: tuple[float, float]
    """95 % interval of the mean (`paired_interval`); NaN for one seed."""
    pairs: int
    """Number of seeds that both have."""
    metric: str = "accuracy"
    """Name in `METRICS`."""

    @property
    def is_clear(self) -> bool:
        """Whether the interval excludes zero."""
        low, high = self.interval
        # Equal differences have no width: the tests were then too small to differ.
        has_width = high - low > MIN_INTERVAL_WIDTH
        return has_width and (low > 0 or high < 0)

    @property
    def _comparison(self) -> str:
        first = format_factor(self.factor, self.first[self.factor])
        second = format_factor(self.factor, self.second[self.factor])
        quantity = METRICS[self.metric]
        capitalized = quantity[0].upper() + quantity[1:]
        if self.factor == "classifier":
            return f"{capitalized} of {first} minus {quantity} of {second}"

        classifier = format_factor("classifier", self.first["classifier"])
        return f"{capitalized} of {classifier} {_with(first)} minus {quantity} {_with(second)}"

    @property
    def points(self) -> str:
        """The first value of the factor and the difference in percentage points, in short.

        Examples
        --------
        >>> first = {"classifier": "svm", "training_set": "calibrated"}
        >>> second = {"classifier": "svm", "training_set": "nominal"}
        >>> Difference(first, second, "training_set", 0.018, (0.008, 0.028), 5).points
        'with calibrated twin +1.8 (+0.8 to +2.8)'
        """
        label = format_factor(self.factor, self.first[self.factor])
        if self.pairs < 2:
            return f"{label} {100 * self.mean:+.1f} (one seed)"

        low, high = (100 * limit for limit in self.interval)
        return f"{label} {100 * self.mean:+.1f} ({low:+.1f} to {high:+.1f})"

    @property
    def sentence(self) -> str:
        """The difference in percentage points, as a sentence.

        Examples
        --------
        >>> first = {"classifier": "svm", "training_set": "calibrated"}
        >>> second = {"classifier": "tcn", "training_set": "calibrated"}
        >>> Difference(first, second, "classifier", 0.018, (0.008, 0.028), 5).sentence
        'Accuracy of SVM minus accuracy of TCN: +1.8 points (95 % interval +0.8 to +2.8).'
        """
        points = f"{100 * self.mean:+.1f} points"
        if self.pairs < 2:
            return f"{self._comparison}: {points} (one seed)."

        low, high = (100 * limit for limit in self.interval)
        significance = "" if self.is_clear else "; not significant"
        return (
            f"{self._comparison}: {points} (95 % interval {low:+.1f} to {high:+.1f}{significance})."
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the difference as JSON can hold it."""
        return {
            "first": dict(self.first),
            "second": dict(self.second),
            "mean": _nan_to_none(self.mean),
            "interval": [_nan_to_none(limit) for limit in self.interval],
            "pairs": self.pairs,
            "metric": self.metric,
        }


def _with(label: str) -> str:
    return label if label.startswith("with ") else f"with {label}"


def _nan_to_none(value: float) -> float | None:
    return None if math.isnan(value) else value


@dataclass(frozen=True, eq=False, kw_only=True)
class StudyResult(StudyTable):
    """Table of a study together with its runs."""

    size: str
    """Name of the settings, such as ``"quick"``."""
    runs: tuple[Run, ...]
    """Each training with its tests, in the order of the rows."""
    reference_values: Mapping[str, str] = field(default_factory=dict)
    """Value of a factor that its other values are compared with, by factor."""
    unfilled_variant: str | None = None
    """Variant of the rows without synthetic windows, which are compared with all variants."""
    metric: str = "accuracy"
    """Metric of the differences, a name in `METRICS`."""
    contrasts: Contrasts = field(default_factory=dict)
    """Pairs of training sets that are compared besides those with a reference value."""
    calibrations: tuple[Calibration, ...] = ()
    """Calibrations of the first seed, if their files exist."""

    @property
    def main_classifier(self) -> str:
        """Classifier that the study is about: the first."""
        return str(self.runs[0]["factors"]["classifier"])

    @property
    def main_metric(self) -> str:
        """Name of the metric of the differences."""
        return self.metric

    @property
    def hardest_split(self) -> str:
        """Split whose test data are the farthest from the training data."""
        return max(trial.factors["split"] for trial in self.trials)

    def summary_rows(self) -> list[dict[str, Any]]:
        """Return the rows of the hardest split that define the main metric."""
        split = self.hardest_split
        return [row for row in super().summary_rows() if row["split"] == split]

    @property
    def headline(self) -> str:
        """The best row of the hardest split in a few words.

        Rows of fewer seeds than others are left out, as in `sentences`.
        """
        rows = self.summary_rows()
        if not rows:
            return ""

        max_seeds = max(len(row[self.metric]["values"]) for row in rows)
        complete = [row for row in rows if len(row[self.metric]["values"]) == max_seeds]
        best = max(complete, key=lambda row: float(row[self.metric]["mean"]))
        return (
            f"Highest {METRICS[self.metric]} at {self.hardest_split}: "
            f"{best[self.metric]['mean']:.3f}, {self.label_row(best, without='split')}"
        )

    @property
    def classes(self) -> tuple[str, ...]:
        """Class names."""
        return tuple(self.runs[0]["classes"])

    @property
    def first_runs(self) -> list[Run]:
        """Runs of the first seed."""
        return [run for run in self.runs if run["seed"] == self.seeds[0]]

    def tests(self, **factors: str) -> list[tuple[Run, dict[str, Any]]]:
        """Return (run, row of its file) of each test with these factors."""
        tests = []
        for run in self.runs:
            for row in run["rows"]:
                row_factors = {**run["factors"], **factors_of_test(row)}
                if factors.items() <= row_factors.items():
                    tests.append((run, row))

        return tests

    def difference(
        self, first: Row, second: Row, factor: str, metric: str = "accuracy"
    ) -> Difference:
        """Return the difference of a metric between two rows, paired by seed."""
        first_values = {trial.seed: trial.values[metric] for trial in self.select(**first)}
        second_values = {trial.seed: trial.values[metric] for trial in self.select(**second)}

        differences = []
        for seed, value in first_values.items():
            # A seed in which either value is undefined makes no pair.
            if seed in second_values and math.isfinite(value - second_values[seed]):
                differences.append(value - second_values[seed])

        mean = float(np.mean(differences)) if differences else math.nan
        interval = paired_interval(differences, self._test_share(first))
        return Difference(first, second, factor, mean, interval, len(differences), metric)

    def _test_share(self, row: Row) -> float | None:
        """Return the ratio of test to training recordings; None if each seed has other recordings.

        Seeds that split the same recordings are correlated (`paired_interval`).
        """
        if len({run["data"] for run in self.runs}) > 1:
            return None

        roles = next(run["roles"] for run in self.runs if run["factors"].items() <= row.items())
        return len(roles[row["split"]]) / max(1, len(roles["train"]))

    def differences(self) -> list[Difference]:
        """Return the differences between each reference value and the other values of its factor.

        All other factors of the two rows are equal, except that a row without synthetic windows is
        compared with every variant.
        """
        # Each row has a trial for every seed.
        keys = dict.fromkeys(tuple(trial.factors.items()) for trial in self.trials)
        rows = [dict(key) for key in keys]

        differences = []
        for factor, reference_value in self.reference_values.items():
            references = [row for row in rows if row.get(factor) == reference_value]
            others = [row for row in rows if row.get(factor, reference_value) != reference_value]
            for first, second in product(references, others):
                if self._differ_only_in(factor, first, second):
                    differences.append(self.difference(first, second, factor, self.metric))

        # Two questions may share a pair.
        pairs = dict.fromkeys(pair for group in self.contrasts.values() for pair in group)
        for first_set, second_set in pairs:
            differences += self._contrast(first_set, second_set)

        return [difference for difference in differences if difference.pairs]

    def _contrast(self, first_set: str, second_set: str) -> list[Difference]:
        """Return the difference between two training sets for each classifier and test."""
        differences = []
        for row in dict.fromkeys(tuple(trial.factors.items()) for trial in self.trials):
            first = dict(row)
            if first["training_set"] == first_set:
                second = {**first, "training_set": second_set}
                differences.append(self.difference(first, second, "training_set", self.metric))

        return [difference for difference in differences if difference.pairs]

    def _differ_only_in(self, factor: str, first: Row, second: Row) -> bool:
        for name in first:
            if name == factor or first[name] == second[name]:
                continue

            is_variant = name not in ("classifier", "training_set", *TEST_FACTORS)
            if not (is_variant and self.unfilled_variant in (first[name], second[name])):
                return False

        return True

    def sentences(self) -> tuple[str, ...]:
        """Return a text for each test: its best row, and the differences that the study compares.

        Rows of fewer seeds than others are not compared for the best: they may be lucky. A study of
        contrasts has a text for each question instead.
        """
        if self.contrasts:
            return tuple(self._contrast_sentences())

        rows = self.rows()
        differences = self.differences()

        texts = []
        for test in dict.fromkeys(_test_key(row) for row in rows):
            test_rows = [row for row in rows if _test_key(row) == test]
            max_seeds = max(len(row["accuracy"]["values"]) for row in test_rows)
            complete = [row for row in test_rows if len(row["accuracy"]["values"]) == max_seeds]
            scope = "" if len(complete) == len(test_rows) else f" (rows of {max_seeds} seeds)"

            # A row without a defined accuracy cannot be the best.
            best = max(complete, key=lambda row: row["accuracy"]["mean"] or 0.0)
            labels = [
                format_factor(name, best[name]) for name in self.factors if name not in TEST_FACTORS
            ]
            text = (
                f"{', '.join(filter(None, test))}: highest accuracy{scope} "
                f"{best['accuracy']['mean']:.3f}, {', '.join(labels)}."
            )

            pairs = [pair for pair in differences if _test_key(pair.first) == test]
            # The smallest differences from the reference are those of the best classifiers.
            if all(pair.factor == "classifier" for pair in pairs):
                pairs.sort(key=lambda pair: pair.mean)
            texts.append(" ".join([text, *(pair.sentence for pair in pairs[:MAX_DIFFERENCES])]))

        return tuple(texts)

    def _contrast_sentences(self) -> list[str]:
        """Return a text for each question of the contrasts, and each classifier and test."""
        sentences = []
        for question, pairs in self.contrasts.items():
            points_by_test: dict[str, list[str]] = {}
            for first_set, second_set in pairs:
                for difference in self._contrast(first_set, second_set):
                    labels = [
                        format_factor(name, value)
                        for name, value in difference.first.items()
                        if name != "training_set"
                    ]
                    points_by_test.setdefault(", ".join(labels), []).append(difference.points)

            for test, points in points_by_test.items():
                sentences.append(
                    f"{test}: {question}, in points of {METRICS[self.metric]} "
                    f"(95 % interval): {'; '.join(points)}."
                )

        return sentences

    @property
    def cells(self) -> dict[str, dict[str, int]]:
        """Windows by class and pressure in each training and test set of the first seed.

        A test set that is the same in all runs is listed once.
        """
        training_sets = {}
        test_sets: dict[str, dict[str, int]] = {}
        for run in self.first_runs:
            training_sets[name_run(run, "classifier")] = run["cells"]["train"]
            for name in run["cells"].keys() - {"train"}:
                counts = run["cells"][name]
                if test_sets.setdefault(name, counts) != counts:
                    test_sets[f"{name}, {name_run(run, 'classifier', 'training_set')}"] = counts

        return {**training_sets, **dict(sorted(test_sets.items()))}

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON of the study."""
        splits: dict[str, dict[str, Any]] = {}
        fingerprints: dict[str, dict[str, str]] = {}
        for run in self.runs:
            variant = name_run(run, "classifier", "training_set")
            name = ", ".join(filter(None, (str(run["seed"]), variant)))
            splits[name] = dict(run["roles"])

            hashes = fingerprints.setdefault(name, {})
            for role, sha256 in run["sha256"].items():
                # Training windows differ between training sets, test windows do not.
                hashes[name_run(run, "classifier") if role == "train" else role] = sha256

        runs = [
            {name: run[name] for name in ("key", "wall_s", "cpu_s", "device")} for run in self.runs
        ]
        return {
            **super().to_dict(),
            "size": self.size,
            "differences": [difference.to_dict() for difference in self.differences()],
            "cells": self.cells,
            "splits": splits,
            "fingerprints": fingerprints,
            "calibrations": [_summarize_calibration(c) for c in self.calibrations],
            "runs": runs,
        }


def _summarize_calibration(calibration: Calibration) -> dict[str, Any]:
    return {
        "pump": calibration.twin.pump.name,
        "recording_ids": list(calibration.recording_ids),
        "nominal_agreement": asdict(calibration.nominal_agreement),
        "calibrated_agreement": asdict(calibration.calibrated_agreement),
        "estimates": [asdict(estimate) for estimate in calibration.estimates],
    }


def _test_key(row: Mapping[str, Any]) -> tuple[str, ...]:
    return tuple(row.get(name, "") for name in TEST_FACTORS)


def name_run(run: Run, *excluded_factors: str) -> str:
    """Return the values of a run's factors, without some of them, as its name."""
    return ", ".join(
        value for name, value in run["factors"].items() if name not in excluded_factors
    )
