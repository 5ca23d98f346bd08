"""What can be evaluated, on which recordings, and what it scores."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int
from sklearn.metrics import confusion_matrix, f1_score, roc_auc_score

from swashtwin.foundation import (
    DataError,
    InputError,
    LeakError,
    finite_values,
    plural,
    random_stream,
    to_table,
)
from swashtwin.learning.training.confidence import likeliest_class, pooled_probabilities
from swashtwin.learning.training.training_reference import TrainingReference
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.pump import PRESSURE_TOLERANCE, SPEED_TOLERANCE, is_healthy, values_match
from swashtwin.recordings import Manifest, Recording, build_manifest, describe_copies, find_copies


@runtime_checkable
class Classifier(Protocol):
    """What can be evaluated: a fitted network, or anything that answers like one."""

    @property
    def classes(self) -> tuple[str, ...]:
        """Class names, in the order of the probabilities."""

    @property
    def manifest(self) -> Manifest | tuple[str, ...]:
        """Every recording that had a part in it: by id with the hashes of its content, or ids
        alone.
        """

    def predict_proba(self, windows: WindowSet) -> np.ndarray:
        """Probability of each class for each window."""


def unseen_recordings(
    manifest: Manifest | Iterable[str], recordings: Sequence[Recording]
) -> tuple[list[Recording], dict[str, str]]:
    """Measured recordings that had no part in a model, in their order, and those that had
    (`find_copies`).

    Raises
    ------
    DataError
        Every recording had a part in it.
    """
    measured = [recording for recording in recordings if not recording.synthetic]
    seen = find_copies(manifest, build_manifest(measured))
    unseen = [recording for recording in measured if recording.recording_id not in seen]
    if not unseen:
        raise DataError(
            f"all {len(recordings)} recordings had a part in the model (its manifest); test on others, or train "
            "with a share held out."
        )
    return unseen, seen


def refuse_seen(classifier: Classifier, recordings: Manifest) -> None:
    """Raise a `LeakError` that names a recording that had a part in the classifier, if there is
    one.
    """
    if seen := find_copies(classifier.manifest, recordings):
        raise LeakError(
            f"{describe_copies(seen)} had a part in the classifier (its manifest); test on others."
        )


SPLITS = {
    "L0": "random windows of known recordings: a diagnosis of the leak, never a headline",
    "L1": "later time of the same recording, behind a guard gap: optimistic",
    "L2": "another recording of the same specimen and condition",
    "L3": "another condition: a pressure or speed that was held out",
    "L4": "another specimen: a pump, bearing or actuator that was held out",
    "L5": "synthetic to measured: no measured window of that class (and condition) in training",
}
"""Meaning of each split, nearest first."""


def split_between(reference: TrainingReference, recordings: Iterable[Recording]) -> str | None:
    """Level of whole recordings that had no part in the training: ``"L2"``, ``"L3"`` or ``"L4"``.

    None where they are of several splits, or the machine of a recording is not stated.
    """
    splits = set()
    for recording in recordings:
        if recording.specimen is None or not any(reference.specimen):
            return None
        same = [
            number for number, name in enumerate(reference.specimen) if name == recording.specimen
        ]
        condition = recording.condition
        if not same:
            splits.add("L4")
        elif condition is None:
            splits.add("L2")
        else:
            speed, pressure = reference.condition[same].T
            is_trained = values_match(speed, condition.speed, SPEED_TOLERANCE) & values_match(
                pressure, condition.discharge_pressure, PRESSURE_TOLERANCE
            )
            splits.add("L2" if is_trained.any() else "L3")
    return splits.pop() if len(splits) == 1 else None


def recalls(confusion: Int[np.ndarray, "actual predicted"]) -> Float[np.ndarray, " actual"]:
    """Share of each class that was told right; NaN for a class without a test window."""
    count = confusion.sum(axis=1)
    return np.where(count > 0, np.diag(confusion) / np.maximum(count, 1), np.nan)


def g_mean(confusion: Int[np.ndarray, "actual predicted"]) -> float:
    """Geometric mean of the recalls of all declared classes: 0 where one is 0, NaN where a class
    has no test window.

    Where it is defined it equals imbalanced-learn's ``geometric_mean_score(average="multiclass")``.
    """
    recall = recalls(confusion)
    with np.errstate(divide="ignore"):
        return float(np.exp(np.mean(np.log(recall))))


def g_mean_laplace(confusion: Int[np.ndarray, "actual predicted"]) -> float:
    """G_ε: geometric mean of the Laplace recalls (tp + 0.5) / (n + 1); NaN where a class has no
    test window.
    """
    count = confusion.sum(axis=1)
    if not count.all():
        return float("nan")
    return float(np.exp(np.mean(np.log((np.diag(confusion) + 0.5) / (count + 1)))))


def false_alarm_rate(
    confusion: Int[np.ndarray, "actual predicted"], normal: Sequence[int]
) -> float:
    """Share of the windows of the `normal` classes that were called none of them; NaN where there
    is none.
    """
    rows = confusion[list(normal)]
    return float(1 - rows[:, list(normal)].sum() / rows.sum()) if rows.sum() else float("nan")


def missed_fault_rate(
    confusion: Int[np.ndarray, "actual predicted"], normal: Sequence[int]
) -> float:
    """Share of the faulty windows that were called normal, or have no verdict; NaN where there is
    none.
    """
    faulty = np.delete(confusion, normal, axis=0)
    missed = faulty[:, normal].sum() + faulty[:, len(confusion) :].sum()
    return float(missed / faulty.sum()) if faulty.sum() else float("nan")


def macro_auroc(
    target: Int[np.ndarray, " window"], probability: Float[np.ndarray, "window class"]
) -> float:
    """Mean area under the curve of each class with test windows against the rest; NaN where there
    is one class only.
    """
    present = np.unique(target)
    if present.size < 2:
        return float("nan")
    return float(
        np.mean([roc_auc_score(target == index, probability[:, index]) for index in present])
    )


def expected_calibration_error(
    right: Bool[np.ndarray, " window"], confidence: Float[np.ndarray, " window"], n_bins: int = 15
) -> float:
    """ECE: mean over the windows of |accuracy - confidence| of their bin, with `n_bins` equal bins
    of confidence.
    """
    bins = np.minimum((confidence * n_bins).astype(np.int64), n_bins - 1)
    gap = np.bincount(bins, weights=right.astype(np.float64) - confidence, minlength=n_bins)
    return float(np.abs(gap).sum() / right.size)


def accuracy_interval(
    right: Bool[np.ndarray, " window"],
    group: Int[np.ndarray, " window"],
    *,
    draws: int = 2000,
    seed: int = 0,
) -> tuple[float, float]:
    """95 % interval of the accuracy by bootstrap over the groups (recordings), since windows are
    not independent.

    The bootstrap is too narrow with few groups, and has no width without an error; so the interval
    holds Wilson's (1927, DOI 10.1080/01621459.1927.10502953) too, for as many independent trials as
    there are groups.
    """
    correct, total = np.bincount(group, weights=right), np.bincount(group)
    wilson = wilson_interval(float(right.mean()), total.size)
    times = random_stream(seed, "bootstrap").multinomial(
        total.size, np.full(total.size, 1 / total.size), size=draws
    )
    low, high = np.percentile((times @ correct) / (times @ total), [2.5, 97.5])
    return min(float(low), wilson[0]), max(float(high), wilson[1])


def wilson_interval(share: float, n: int) -> tuple[float, float]:
    """95 % interval of a share in `n` independent trials."""
    z = 1.959964
    middle = (share + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * math.sqrt(share * (1 - share) / n + z**2 / (4 * n**2))
    return max(0.0, middle - half), min(1.0, middle + half)


@dataclass(frozen=True)
class CellScore:
    """Recall in one cell of the test set: one class at one discharge pressure."""

    label: str
    discharge_pressure: float | None
    """Discharge pressure [Pa], of the operating point; None where none is stated."""
    n_windows: int
    """Test windows in the cell."""
    recall: float
    """Share of them classified right."""


@dataclass(frozen=True, eq=False)
class Scores:
    """What a classifier scored on one test set. A number that the test set cannot give is NaN, with
    a reason.
    """

    split: str | None
    """Split, ``"L0"`` to ``"L5"`` (`SPLITS`), or None where the caller did not
    state it.
    """
    classes: tuple[str, ...]
    """Declared classes; `recall` and `confusion` follow their order."""
    n_windows: int
    n_recordings: int
    """Test recordings; the number of independent trials."""
    accuracy: float
    accuracy_interval: tuple[float, float]
    """95 % interval of the accuracy, by bootstrap over the recordings, and no narrower than
    Wilson's interval for as many independent trials as there are recordings: few recordings without
    an error do not prove that there is none.
    """
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
    """Windows of each class (row) that were given each class (column); where some have no verdict,
    a last column counts these.
    """
    cells: tuple[CellScore, ...]
    reasons: Mapping[str, str]
    """Why a number is NaN or rests on fewer classes than declared, by its name."""

    def __repr__(self) -> str:
        split = f" at {self.split}" if self.split else ""
        return (
            f"<Scores{split}: accuracy {self.accuracy:.3f} over {plural(self.n_windows, 'window')}, "
            f"{self.recording_accuracy:.3f} over {plural(self.n_recordings, 'recording')}, "
            f"macro recall {self.macro_recall:.3f}, "
            f"classes {', '.join(self.classes)}>"
        )

    def to_dict(self) -> dict[str, Any]:
        """The same as JSON can hold it; NaN becomes None."""
        return {**finite_values(to_table(self)), "split_meaning": SPLITS.get(self.split or "")}


def evaluate(
    classifier: Classifier, test: WindowSet, *, split: str | None = None, seed: int = 0
) -> Scores:
    """Scores on measured recordings that had no part in the classifier.

    A window without a verdict, because a number of the classifier is not finite, counts as an
    error; `Scores.reasons` says how many.

    Parameters
    ----------
    split : split of the test set, ``"L0"`` to ``"L5"``; only the caller knows it.
    seed : seed of the bootstrap.

    Raises
    ------
    LeakError
        A test window is synthetic, or its recording stands in the classifier's manifest, under
        whatever name.
    DataError
        No test window, or one without label.
    InputError
        A class that the classifier does not know, an unknown split, or windows of another layout.
    """
    _require_honest(classifier, test, split)
    probability = np.asarray(classifier.predict_proba(test), dtype=np.float64)
    classes = classifier.classes
    target = np.array([classes.index(name) for name in test.classes], dtype=np.int64)[test.target]
    predicted = likeliest_class(probability)
    finite = np.where(predicted[:, None] < 0, 0.0, probability)
    right = predicted == target
    recording, first, group = np.unique(test.recording_id, return_index=True, return_inverse=True)
    rows = [pooled_probabilities(probability[group == index]) for index in range(recording.size)]
    confusion = _confusion(target, predicted, len(classes))
    normal = [index for index, name in enumerate(classes) if is_healthy(name)]
    present = np.unique(target)
    recall = recalls(confusion)
    values = {
        "macro_recall": float(np.nanmean(recall)),
        "macro_f1": float(
            f1_score(target, predicted, labels=present, average="macro", zero_division=0)
        ),
        "g_mean": g_mean(confusion),
        "g_mean_laplace": g_mean_laplace(confusion),
        "false_alarm_rate": false_alarm_rate(confusion, normal) if normal else math.nan,
        "missed_fault_rate": missed_fault_rate(confusion, normal) if normal else math.nan,
        "macro_auroc": macro_auroc(target, finite),
        "calibration_error": expected_calibration_error(right, finite.max(axis=1)),
    }
    interval = accuracy_interval(right, group, seed=seed)
    return Scores(
        split=split,
        classes=classes,
        n_windows=len(test),
        n_recordings=int(recording.size),
        accuracy=float(right.mean()),
        accuracy_interval=interval,
        recording_accuracy=float(np.mean(likeliest_class(np.stack(rows)) == target[first])),
        recall=dict(zip(classes, recall.tolist(), strict=True)),
        confusion=confusion,
        cells=_cells(test, right),
        reasons=_reasons(classes, confusion, values),
        **values,
    )


def _require_honest(classifier: Classifier, test: WindowSet, split: str | None) -> None:
    if split is not None and split not in SPLITS:
        raise InputError(f"split {split!r} is none of {', '.join(SPLITS)}.")
    test.require_any("to test on")
    test.require_labels("an evaluation")
    if test.synthetic.any():
        raise LeakError(
            f"{test.recording_id[test.synthetic][0]} is synthetic; scores are of measured windows only."
        )
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


def _cells(test: WindowSet, right: np.ndarray) -> tuple[CellScore, ...]:
    scores = []
    for (label, pressure), count in test.counts().items():
        at_pressure = (
            np.isnan(test.cell_pressure) if pressure is None else test.cell_pressure == pressure
        )
        if count:
            scores.append(
                CellScore(
                    label, pressure, count, float(right[(test.label == label) & at_pressure].mean())
                )
            )
    return tuple(scores)


def _reasons(
    classes: tuple[str, ...],
    confusion: Int[np.ndarray, "actual predicted"],
    values: dict[str, float],
) -> dict[str, str]:
    absent = [name for name, count in zip(classes, confusion.sum(axis=1), strict=True) if not count]
    names = (
        ("macro_recall", "macro_f1", "macro_auroc", "g_mean", "g_mean_laplace") if absent else ()
    )
    reasons = dict.fromkeys(names, f"no test window of {', '.join(absent)}")
    has_normal = any(map(is_healthy, classes))
    rates = {
        "false_alarm_rate": ("normal", "false-alarm"),
        "missed_fault_rate": ("faulty", "missed-fault"),
    }
    for name, (kind, rate) in rates.items():
        if math.isnan(values[name]):
            reasons[name] = (
                f"no {kind} test window" if has_normal else f"no healthy class, so no {rate} rate"
            )
    if math.isnan(values["macro_auroc"]):
        reasons["macro_auroc"] = "every test window is of one class"
    without = int(confusion[:, len(classes) :].sum())
    if without:
        reasons["accuracy"] = (
            f"{without} of {int(confusion.sum())} windows have no verdict and count as errors"
        )
    return reasons
