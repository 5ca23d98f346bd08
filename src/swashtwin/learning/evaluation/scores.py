"""Scores of a classifier on recordings that had no part in it."""

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
    data_frame,
    finite_values,
    plural,
    random_stream,
    shorten,
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
    """Return the measured recordings that had no part in a model, and those that had.

    The latter are a mapping as `find_copies` returns it.

    Raises
    ------
    DataError
        Every recording had a part in it.
    """
    measured = [recording for recording in recordings if not recording.synthetic]
    copies = find_copies(manifest, build_manifest(measured))
    unseen = [recording for recording in measured if recording.recording_id not in copies]
    if not unseen:
        raise DataError(
            f"All {len(recordings)} recordings had a part in the model (its manifest). Test on "
            "others, or train with a share held out."
        )
    return unseen, copies


def refuse_seen(classifier: Classifier, recordings: Manifest) -> None:
    """Raise a `LeakError` that names a recording with a part in the classifier, if there is one."""
    copies = find_copies(classifier.manifest, recordings)
    if copies:
        raise LeakError(
            f"{describe_copies(copies)} had a part in the classifier (its manifest). Test on "
            "others."
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
    """Return the split of recordings that had no part in the training.

    That is ``"L2"``, ``"L3"`` or ``"L4"``; None if they are of several splits, or the machine of a
    recording is not specified.
    """
    splits = set()
    for recording in recordings:
        if recording.specimen is None or not any(reference.specimen):
            return None
        splits.add(_split_of(reference, recording))
    return splits.pop() if len(splits) == 1 else None


def _split_of(reference: TrainingReference, recording: Recording) -> str:
    same_machine = np.array(reference.specimen) == recording.specimen
    if not same_machine.any():
        return "L4"
    condition = recording.condition
    if condition is None:
        return "L2"

    speed, pressure = reference.condition[same_machine].T
    is_trained = values_match(speed, condition.speed, SPEED_TOLERANCE) & values_match(
        pressure, condition.discharge_pressure, PRESSURE_TOLERANCE
    )
    return "L2" if is_trained.any() else "L3"


def recalls(confusion: Int[np.ndarray, "actual predicted"]) -> Float[np.ndarray, " actual"]:
    """Return the share of each class that was classified right; NaN without a test window."""
    # A column without a verdict, if any, counts in the sum: such a window is an error.
    count = confusion.sum(axis=1)
    return np.where(count > 0, np.diag(confusion) / np.maximum(count, 1), np.nan)


def g_mean(confusion: Int[np.ndarray, "actual predicted"]) -> float:
    """Return the geometric mean of the recalls of all declared classes.

    It is 0 if one is 0, and NaN if a class has no test window. If defined, it equals
    imbalanced-learn's ``geometric_mean_score(average="multiclass")``.
    """
    recall = recalls(confusion)
    with np.errstate(divide="ignore"):
        return float(np.exp(np.mean(np.log(recall))))


def g_mean_laplace(confusion: Int[np.ndarray, "actual predicted"]) -> float:
    """Return G_ε, the geometric mean of the Laplace recalls (tp + 0.5) / (n + 1).

    It is NaN if a class has no test window.
    """
    count = confusion.sum(axis=1)
    if not count.all():
        return math.nan
    laplace_recall = (np.diag(confusion) + 0.5) / (count + 1)
    return float(np.exp(np.mean(np.log(laplace_recall))))


def false_alarm_rate(
    confusion: Int[np.ndarray, "actual predicted"], normal: Sequence[int]
) -> float:
    """Return the share of the windows of the `normal` classes that were called faulty.

    It is NaN if there is no such window.
    """
    rows = confusion[list(normal)]
    n_windows = rows.sum()
    if not n_windows:
        return math.nan
    return float(1 - rows[:, list(normal)].sum() / n_windows)


def missed_fault_rate(
    confusion: Int[np.ndarray, "actual predicted"], normal: Sequence[int]
) -> float:
    """Return the share of the faulty windows that were called normal, or have no verdict.

    It is NaN if there is no faulty window.
    """
    faulty = np.delete(confusion, normal, axis=0)
    n_windows = faulty.sum()
    if not n_windows:
        return math.nan
    n_classes = len(confusion)
    missed = faulty[:, normal].sum() + faulty[:, n_classes:].sum()
    return float(missed / n_windows)


def macro_auroc(
    target: Int[np.ndarray, " window"], probability: Float[np.ndarray, "window class"]
) -> float:
    """Return the mean AUROC of each class with test windows against the others.

    It is NaN if there is only one class.
    """
    present = np.unique(target)
    if present.size < 2:
        return math.nan
    areas = [roc_auc_score(target == index, probability[:, index]) for index in present]
    return float(np.mean(areas))


def expected_calibration_error(
    right: Bool[np.ndarray, " window"], confidence: Float[np.ndarray, " window"], n_bins: int = 15
) -> float:
    """Return the ECE: the mean over the windows of |accuracy - confidence| of their bin.

    There are `n_bins` equal bins of confidence.
    """
    bins = np.minimum((confidence * n_bins).astype(np.int64), n_bins - 1)
    gap = np.bincount(bins, weights=right.astype(np.float64) - confidence, minlength=n_bins)
    return float(np.abs(gap).sum() / right.size)


# Draws of the bootstrap: the limits of a 95 % interval then rest on 50 draws each.
_BOOTSTRAP_DRAWS = 2000


def accuracy_interval(
    right: Bool[np.ndarray, " window"], group: Int[np.ndarray, " window"], *, seed: int = 0
) -> tuple[float, float]:
    """Return the 95 % interval of the accuracy by bootstrap over the groups.

    The groups are recordings, since windows are not independent. The bootstrap is too narrow with
    few groups, and has no width without an error; so the interval also contains Wilson's (1927, DOI
    10.1080/01621459.1927.10502953) for as many independent trials as there are groups.
    """
    n_right = np.bincount(group, weights=right)
    n_windows = np.bincount(group)
    n_groups = n_windows.size
    equal_shares = np.full(n_groups, 1 / n_groups)
    rng = random_stream(seed, "bootstrap")
    times = rng.multinomial(n_groups, equal_shares, size=_BOOTSTRAP_DRAWS)
    low, high = np.percentile((times @ n_right) / (times @ n_windows), [2.5, 97.5])

    wilson_low, wilson_high = wilson_interval(float(right.mean()), n_groups)
    return min(float(low), wilson_low), max(float(high), wilson_high)


def wilson_interval(share: float, n: int) -> tuple[float, float]:
    """Return the 95 % interval of a share in `n` independent trials."""
    z = 1.959964  # 97.5 % quantile of the normal distribution
    middle = (share + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * math.sqrt(share * (1 - share) / n + z**2 / (4 * n**2))
    return max(0.0, middle - half), min(1.0, middle + half)


@dataclass(frozen=True)
class CellScore:
    """Recall in one cell of the test set: one class at one discharge pressure."""

    label: str
    discharge_pressure: float | None
    """Discharge pressure [Pa] of the operating point; None if not specified."""
    n_windows: int
    """Test windows in the cell."""
    recall: float
    """Share of them classified right."""


@dataclass(frozen=True, eq=False)
class Scores:
    """Scores of a classifier on one test set.

    A number that the test set cannot give is NaN, with a reason.
    """

    split: str | None
    """Split of the test set, ``"L0"`` to ``"L5"`` (`SPLITS`); None if not specified."""
    classes: tuple[str, ...]
    """Declared classes; `recall` and `confusion` follow their order."""
    n_windows: int
    n_recordings: int
    """Test recordings; the number of independent trials."""
    accuracy: float
    accuracy_interval: tuple[float, float]
    """95 % interval of the accuracy by bootstrap over the recordings, at least as wide as Wilson's
    interval for as many independent trials: few recordings without an error do not prove that there
    is none.
    """
    recording_accuracy: float
    """Share of the recordings classified right, each by the mean log-probability of its windows."""
    macro_recall: float
    """Mean recall of the classes that have test windows (balanced accuracy)."""
    macro_f1: float
    """Mean F1 of the classes that have test windows."""
    g_mean: float
    """Geometric mean of the recalls of all declared classes: 0 if a recall is 0."""
    g_mean_laplace: float
    """G_ε, the geometric mean of the Laplace recalls (tp + 0.5) / (n + 1)."""
    false_alarm_rate: float
    """Share of the normal windows called faulty, or without a verdict."""
    missed_fault_rate: float
    """Share of the faulty windows called normal, or without a verdict."""
    macro_auroc: float
    """Mean AUROC of each class against the others."""
    calibration_error: float
    """Expected calibration error (15 bins)."""
    recall: Mapping[str, float]
    """Recall of each class; NaN without a test window."""
    confusion: Int[np.ndarray, "actual predicted"]
    """Windows of each class (row) by the predicted class (column); a last column counts windows
    without a verdict, if there are any.
    """
    cells: tuple[CellScore, ...]
    reasons: Mapping[str, str]
    """Why a number is NaN or rests on fewer classes than declared, by its name."""

    def __repr__(self) -> str:
        split = f" at {self.split}" if self.split else ""
        windows = plural(self.n_windows, "window")
        recordings = plural(self.n_recordings, "recording")
        return shorten(
            f"<Scores{split}: accuracy {self.accuracy:.3f} over {windows}, "
            f"{self.recording_accuracy:.3f} over {recordings}, "
            f"macro recall {self.macro_recall:.3f}, classes {', '.join(self.classes)}>"
        )

    def to_pandas(self) -> Any:
        """Return the scores as a ``pandas.DataFrame`` of one row, with the keys of `to_dict`.

        Raises
        ------
        MissingExtraError
            pandas is not installed.
        """
        return data_frame([self.to_dict()])

    def to_dict(self) -> dict[str, Any]:
        """Return the scores as JSON can hold them; NaN becomes None."""
        table: dict[str, Any] = finite_values(to_table(self))
        table["split_meaning"] = SPLITS.get(self.split or "")
        return table


def evaluate(
    classifier: Classifier, test: WindowSet, *, split: str | None = None, seed: int = 0
) -> Scores:
    """Score a classifier on measured recordings that had no part in it.

    A window without a verdict, because a number of the classifier is not finite, counts as an
    error; `Scores.reasons` states how many.

    Parameters
    ----------
    split : split of the test set, ``"L0"`` to ``"L5"``; only the caller knows it.
    seed : seed of the bootstrap.

    Raises
    ------
    LeakError
        A test window is synthetic, or its recording stands in the classifier's manifest, under
        any name.
    DataError
        No test window, or one without a label.
    InputError
        A class that the classifier does not know, an unknown split, or windows of another layout.
    """
    _require_valid(classifier, test, split)
    classes = classifier.classes
    probability = np.asarray(classifier.predict_proba(test), dtype=np.float64)
    predicted = likeliest_class(probability)
    class_index = np.array([classes.index(name) for name in test.classes], dtype=np.int64)
    target = class_index[test.target]
    is_right = predicted == target

    recordings, first, group = np.unique(test.recording_id, return_index=True, return_inverse=True)
    pooled = np.stack(
        [pooled_probabilities(probability[group == index]) for index in range(recordings.size)]
    )
    is_recording_right = likeliest_class(pooled) == target[first]

    confusion = _confusion(target, predicted, len(classes))
    finite_probability = np.where(predicted[:, None] < 0, 0.0, probability)
    values = _class_scores(classes, confusion, target, predicted, finite_probability)
    return Scores(
        split=split,
        classes=classes,
        n_windows=len(test),
        n_recordings=int(recordings.size),
        accuracy=float(is_right.mean()),
        accuracy_interval=accuracy_interval(is_right, group, seed=seed),
        recording_accuracy=float(np.mean(is_recording_right)),
        calibration_error=expected_calibration_error(is_right, finite_probability.max(axis=1)),
        recall=dict(zip(classes, recalls(confusion).tolist(), strict=True)),
        confusion=confusion,
        cells=_cells(test, is_right),
        reasons=_reasons(classes, confusion, values),
        **values,
    )


def _class_scores(
    classes: tuple[str, ...],
    confusion: Int[np.ndarray, "actual predicted"],
    target: Int[np.ndarray, " window"],
    predicted: Int[np.ndarray, " window"],
    probability: Float[np.ndarray, "window class"],
) -> dict[str, float]:
    """Return the scores that a test set may be unable to give, by the field's name."""
    normal = [index for index, name in enumerate(classes) if is_healthy(name)]
    false_alarms = math.nan
    missed_faults = math.nan
    if normal:
        false_alarms = false_alarm_rate(confusion, normal)
        missed_faults = missed_fault_rate(confusion, normal)

    present = np.unique(target)
    macro_f1 = f1_score(target, predicted, labels=present, average="macro", zero_division=0)
    return {
        "macro_recall": float(np.nanmean(recalls(confusion))),
        "macro_f1": float(macro_f1),
        "g_mean": g_mean(confusion),
        "g_mean_laplace": g_mean_laplace(confusion),
        "false_alarm_rate": false_alarms,
        "missed_fault_rate": missed_faults,
        "macro_auroc": macro_auroc(target, probability),
    }


def _require_valid(classifier: Classifier, test: WindowSet, split: str | None) -> None:
    if split is not None and split not in SPLITS:
        raise InputError(f"Invalid split {split!r}: it must be one of {', '.join(SPLITS)}.")
    test.require_any("to test on")
    test.require_labels("an evaluation")
    if test.synthetic.any():
        name = test.recording_id[test.synthetic][0]
        raise LeakError(f"{name} is synthetic; scores are of measured windows only.")
    refuse_seen(classifier, test.recordings)

    unknown = [name for name in test.classes if name not in classifier.classes]
    if unknown:
        raise InputError(
            f"The classifier does not know the class {unknown[0]!r}; its classes are "
            f"{', '.join(classifier.classes)}."
        )


def _confusion(
    target: Int[np.ndarray, " window"], predicted: Int[np.ndarray, " window"], n_classes: int
) -> Int[np.ndarray, "actual predicted"]:
    confusion: np.ndarray = confusion_matrix(target, predicted, labels=np.arange(n_classes))
    without_verdict = np.bincount(target[predicted < 0], minlength=n_classes)
    if not without_verdict.any():
        return confusion
    return np.column_stack([confusion, without_verdict])


def _cells(test: WindowSet, is_right: Bool[np.ndarray, " window"]) -> tuple[CellScore, ...]:
    scores = []
    for (label, pressure), count in test.counts().items():
        if not count:
            continue
        if pressure is None:
            is_at_pressure = np.isnan(test.cell_pressure)
        else:
            is_at_pressure = test.cell_pressure == pressure
        recall = float(is_right[(test.label == label) & is_at_pressure].mean())
        scores.append(CellScore(label, pressure, count, recall))
    return tuple(scores)


# Scores that count fewer classes than declared, or are NaN, if a class has no test window.
_NEED_ALL_CLASSES = ("macro_recall", "macro_f1", "macro_auroc", "g_mean", "g_mean_laplace")


def _reasons(
    classes: tuple[str, ...],
    confusion: Int[np.ndarray, "actual predicted"],
    values: dict[str, float],
) -> dict[str, str]:
    """Return why scores are NaN or rest on fewer classes than declared, by the field's name."""
    reasons: dict[str, str] = {}
    counts = confusion.sum(axis=1)
    absent = [name for name, count in zip(classes, counts, strict=True) if not count]
    if absent:
        reasons = dict.fromkeys(_NEED_ALL_CLASSES, f"no test window of {', '.join(absent)}")

    has_healthy_class = any(map(is_healthy, classes))
    if math.isnan(values["false_alarm_rate"]):
        reasons["false_alarm_rate"] = (
            "no normal test window"
            if has_healthy_class
            else "no healthy class, so no false-alarm rate"
        )
    if math.isnan(values["missed_fault_rate"]):
        reasons["missed_fault_rate"] = (
            "no faulty test window"
            if has_healthy_class
            else "no healthy class, so no missed-fault rate"
        )
    if math.isnan(values["macro_auroc"]):
        reasons["macro_auroc"] = "every test window is of one class"

    n_without_verdict = int(confusion[:, len(classes) :].sum())
    if n_without_verdict:
        reasons["accuracy"] = (
            f"{n_without_verdict} of {int(confusion.sum())} windows have no verdict and count as "
            "errors"
        )
    return reasons
