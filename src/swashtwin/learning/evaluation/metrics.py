"""Numbers from predictions. Each takes its classes as declared, also where the test set lacks one."""

import numpy as np
from jaxtyping import Bool, Float, Int
from sklearn.metrics import roc_auc_score

from swashtwin.foundation import stream


def recalls(confusion: Int[np.ndarray, "actual predicted"]) -> Float[np.ndarray, " actual"]:
    """Share of each class that was told right; NaN for a class without a test window."""
    count = confusion.sum(axis=1)
    return np.where(count > 0, np.diag(confusion) / np.maximum(count, 1), np.nan)


def g_mean(confusion: Int[np.ndarray, "actual predicted"]) -> float:
    """Geometric mean of the recalls of all declared classes, (∏ recall_c)^(1/C).

    0 where a recall is 0, NaN where a class has no test window. Where it is defined it equals imbalanced-learn's
    ``geometric_mean_score(average="multiclass")``.

    Examples
    --------
    >>> round(g_mean(np.array([[8, 2], [5, 5]])), 4)
    0.6325
    """
    recall = recalls(confusion)
    with np.errstate(divide="ignore"):
        return float(np.exp(np.mean(np.log(recall))))


def g_mean_laplace(confusion: Int[np.ndarray, "actual predicted"]) -> float:
    """G_ε: geometric mean of the Laplace recalls (tp + 0.5) / (n + 1), which no single class can bring to 0.

    NaN where a class has no test window: its 0.5 / 1 would be a number without data.
    """
    count = confusion.sum(axis=1)
    if not count.all():
        return float("nan")
    return float(np.exp(np.mean(np.log((np.diag(confusion) + 0.5) / (count + 1)))))


def false_alarm_rate(confusion: Int[np.ndarray, "actual predicted"], normal: int) -> float:
    """Share of the normal windows that were called faulty; NaN where there is none."""
    count = confusion[normal].sum()
    return float(1 - confusion[normal, normal] / count) if count else float("nan")


def missed_fault_rate(confusion: Int[np.ndarray, "actual predicted"], normal: int) -> float:
    """Share of the faulty windows that were called normal; NaN where there is none."""
    faulty = np.delete(confusion, normal, axis=0)
    return float(faulty[:, normal].sum() / faulty.sum()) if faulty.sum() else float("nan")


def macro_auroc(target: Int[np.ndarray, " window"], probability: Float[np.ndarray, "window class"]) -> float:
    """Mean over the classes with test windows of the area under the curve of that class against the rest.

    NaN where every test window is of one class.
    """
    present = np.unique(target)
    if present.size < 2:
        return float("nan")
    return float(np.mean([roc_auc_score(target == index, probability[:, index]) for index in present]))


def expected_calibration_error(
    right: Bool[np.ndarray, " window"], confidence: Float[np.ndarray, " window"], n_bins: int = 15
) -> float:
    """ECE: mean over the windows of |accuracy - confidence| of their bin, with `n_bins` equal bins of confidence."""
    bins = np.minimum((confidence * n_bins).astype(np.int64), n_bins - 1)
    gap = np.bincount(bins, weights=right.astype(np.float64) - confidence, minlength=n_bins)
    return float(np.abs(gap).sum() / right.size)


def accuracy_interval(
    right: Bool[np.ndarray, " window"], group: Int[np.ndarray, " window"], *, draws: int = 2000, seed: int = 0
) -> tuple[float, float]:
    """95 % interval of the accuracy by bootstrap over the groups (recordings), since windows are not independent.

    NaN where there is one group only. With fewer than about ten groups it is too narrow.
    """
    correct, total = np.bincount(group, weights=right), np.bincount(group)
    if total.size < 2:
        return float("nan"), float("nan")
    times = stream(seed, "bootstrap").multinomial(total.size, np.full(total.size, 1 / total.size), size=draws)
    low, high = np.percentile((times @ correct) / (times @ total), [2.5, 97.5])
    return float(low), float(high)
