"""`evaluate`: a classifier, a test set it must not have seen, and what it scores."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from sklearn.metrics import confusion_matrix, f1_score

from swashtwin.foundation import DataError, InputError, LeakError, finite_values, plural, to_table
from swashtwin.learning.evaluation import metrics
from swashtwin.learning.evaluation.pooling import likeliest_class, pooled_probabilities
from swashtwin.learning.evaluation.protocols import LEVELS, Classifier, refuse_seen
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.pump import is_healthy


@dataclass(frozen=True)
class CellScore:
    """Recall in one cell of the test set: one class at one discharge pressure."""

    label: str
    """Class."""
    discharge_pressure: float | None
    """Discharge pressure [Pa], of the operating point; None where none is stated."""
    n_windows: int
    """Test windows in the cell."""
    recall: float
    """Share of them classified right."""


@dataclass(frozen=True, eq=False)
class Scores:
    """What a classifier scored on one test set. A number that the test set cannot give is NaN, with a reason."""

    level: str | None
    """Level of generalization, ``"L0"`` to ``"L5"`` (`LEVELS`), or None where the caller did not state it."""
    classes: tuple[str, ...]
    """Declared classes; `recall` and `confusion` follow their order."""
    n_windows: int
    """Test windows."""
    n_recordings: int
    """Test recordings; the number of independent trials."""
    accuracy: float
    """Share of the windows classified right."""
    accuracy_interval: tuple[float, float]
    """95 % interval of the accuracy, by bootstrap over the recordings, and no narrower than Wilson's interval for as
    many independent trials as there are recordings: few recordings without an error do not prove that there is none."""
    recording_accuracy: float
    """Share of the recordings classified right, each by the mean log-probability of its windows."""
    macro_recall: float
    """Mean recall of the classes that have test windows (balanced accuracy)."""
    macro_f1: float
    """Mean F1 of the classes that have test windows."""
    g_mean: float
    """Geometric mean of the recalls of all declared classes: 0 where a recall is 0."""
    g_mean_laplace: float
    """G_ε, the same with Laplace recalls (tp + 0.5) / (n + 1)."""
    false_alarm_rate: float
    """Share of the normal windows called faulty, or without a verdict."""
    missed_fault_rate: float
    """Share of the faulty windows called normal, or without a verdict."""
    macro_auroc: float
    """Mean area under the curve of each class against the rest."""
    calibration_error: float
    """Expected calibration error (15 bins)."""
    recall: Mapping[str, float]
    """Recall of each class; NaN where it has no test window."""
    confusion: Int[np.ndarray, "actual predicted"]
    """Windows of each class (row) that were given each class (column); where some have no verdict, a last column
    counts these."""
    cells: tuple[CellScore, ...]
    """Recall by class and discharge pressure."""
    reasons: Mapping[str, str]
    """Why a number is NaN or rests on fewer classes than declared, by its name."""

    def __repr__(self) -> str:
        level = f" at {self.level}" if self.level else ""
        return (
            f"<Scores{level}: accuracy {self.accuracy:.3f} over {plural(self.n_windows, 'window')}, "
            f"{self.recording_accuracy:.3f} over {plural(self.n_recordings, 'recording')}, "
            f"macro recall {self.macro_recall:.3f}, "
            f"classes {', '.join(self.classes)}>"
        )

    def to_dict(self) -> dict[str, Any]:
        """The same as JSON can hold it; NaN becomes None."""
        return {**finite_values(to_table(self)), "level_meaning": LEVELS.get(self.level or "")}


def evaluate(classifier: Classifier, test: WindowSet, *, level: str | None = None, seed: int = 0) -> Scores:
    """Scores on measured recordings that had no part in the classifier.

    Parameters
    ----------
    classifier : fitted network or baseline.
    test : test windows with labels.
    level : level of generalization of the test set, ``"L0"`` to ``"L5"``; only the caller knows it.
    seed : seed of the bootstrap.

    A window without a verdict, because a number of the classifier is not finite, counts as an error; `Scores.reasons`
    says how many.

    Raises
    ------
    LeakError
        A test window is synthetic, or its recording stands in the classifier's manifest, under whatever name.
    DataError
        No test window, or one without label.
    InputError
        A class that the classifier does not know, an unknown level, or windows of another layout.
    """
    _require_honest(classifier, test, level)
    probability = np.asarray(classifier.predict_proba(test), dtype=np.float64)
    classes = classifier.classes
    target = np.array([classes.index(name) for name in test.classes], dtype=np.int64)[test.target]
    predicted = likeliest_class(probability)
    finite = np.where(predicted[:, None] < 0, 0.0, probability)
    right = predicted == target
    recording, group = np.unique(test.recording_id, return_inverse=True)
    confusion = _confusion(target, predicted, len(classes))
    normal = [index for index, name in enumerate(classes) if is_healthy(name)]
    present = np.unique(target)
    recall = metrics.recalls(confusion)
    values = {
        "macro_recall": float(np.nanmean(recall)),
        "macro_f1": float(f1_score(target, predicted, labels=present, average="macro", zero_division=0)),
        "g_mean": metrics.g_mean(confusion),
        "g_mean_laplace": metrics.g_mean_laplace(confusion),
        "false_alarm_rate": metrics.false_alarm_rate(confusion, normal) if normal else math.nan,
        "missed_fault_rate": metrics.missed_fault_rate(confusion, normal) if normal else math.nan,
        "macro_auroc": metrics.macro_auroc(target, finite),
        "calibration_error": metrics.expected_calibration_error(right, finite.max(axis=1)),
    }
    interval = metrics.accuracy_interval(right, group, seed=seed)
    return Scores(
        level=level,
        classes=classes,
        n_windows=len(test),
        n_recordings=int(recording.size),
        accuracy=float(right.mean()),
        accuracy_interval=interval,
        recording_accuracy=_recording_accuracy(target, probability, group),
        recall=dict(zip(classes, recall.tolist(), strict=True)),
        confusion=confusion,
        cells=_cells(test, right),
        reasons=_reasons(classes, confusion, values),
        **values,
    )


def _require_honest(classifier: Classifier, test: WindowSet, level: str | None) -> None:
    if level is not None and level not in LEVELS:
        raise InputError(f"level {level!r} is none of {', '.join(LEVELS)}.")
    if len(test) == 0:
        raise DataError("no window to test on.")
    test.require_labels("an evaluation")
    if test.synthetic.any():
        raise LeakError(f"{test.recording_id[test.synthetic][0]} is synthetic; scores are of measured windows only.")
    refuse_seen(classifier, test.recordings)
    foreign = [name for name in test.classes if name not in classifier.classes]
    if foreign:
        raise InputError(
            f"the classifier does not know {foreign[0]!r}; its classes are {', '.join(classifier.classes)}."
        )


def _confusion(
    target: Int[np.ndarray, " window"], predicted: Int[np.ndarray, " window"], n_classes: int
) -> Int[np.ndarray, "actual predicted"]:
    confusion: np.ndarray = confusion_matrix(target, predicted, labels=np.arange(n_classes))
    without = np.bincount(target[predicted < 0], minlength=n_classes)
    return np.column_stack([confusion, without]) if without.any() else confusion


def _recording_accuracy(
    target: Int[np.ndarray, " window"],
    probability: Float[np.ndarray, "window class"],
    group: Int[np.ndarray, " window"],
) -> float:
    hits = []
    for index in range(int(group.max()) + 1):
        members = group == index
        hits.append(int(likeliest_class(pooled_probabilities(probability[members]))) == int(target[members][0]))
    return float(np.mean(hits))


def _cells(test: WindowSet, right: np.ndarray) -> tuple[CellScore, ...]:
    scores = []
    for (label, pressure), count in test.counts().items():
        at_pressure = np.isnan(test.cell_pressure) if pressure is None else test.cell_pressure == pressure
        if count:
            scores.append(CellScore(label, pressure, count, float(right[(test.label == label) & at_pressure].mean())))
    return tuple(scores)


def _reasons(
    classes: tuple[str, ...],
    confusion: Int[np.ndarray, "actual predicted"],
    values: dict[str, float],
) -> dict[str, str]:
    absent = [name for name, count in zip(classes, confusion.sum(axis=1), strict=True) if not count]
    reasons = {}
    if absent:
        missing = f"no test window of {', '.join(absent)}"
        names = ("macro_recall", "macro_f1", "macro_auroc", "g_mean", "g_mean_laplace")
        reasons = dict.fromkeys(names, missing)
    for name in ("false_alarm_rate", "missed_fault_rate"):
        if math.isnan(values[name]):
            kind = "normal" if name == "false_alarm_rate" else "faulty"
            has_normal = any(is_healthy(label) for label in classes)
            rate = name.replace("_", "-").removesuffix("-rate") + " rate"
            reasons[name] = f"no {kind} test window" if has_normal else f"no healthy class, so no {rate}"
    if math.isnan(values["macro_auroc"]):
        reasons["macro_auroc"] = "every test window is of one class"
    without = int(confusion[:, len(classes) :].sum())
    if without:
        reasons["accuracy"] = f"{without} of {int(confusion.sum())} windows have no verdict and count as errors"
    return reasons
