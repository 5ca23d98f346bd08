"""Numbers from predictions. Each takes its classes as declared, also where the test set lacks one."""

import math
from collections.abc import Sequence

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


def false_alarm_rate(confusion: Int[np.ndarray, "actual predicted"], normal: Sequence[int]) -> float:
    """Share of the windows of the `normal` classes that were called none of them; NaN where there is none."""
    rows = confusion[list(normal)]
    return float(1 - rows[:, list(normal)].sum() / rows.sum()) if rows.sum() else float("nan")


def missed_fault_rate(confusion: Int[np.ndarray, "actual predicted"], normal: Sequence[int]) -> float:
    """Share of the faulty windows that were called normal, or have no verdict; NaN where there is none."""
    faulty = np.delete(confusion, normal, axis=0)
    missed = faulty[:, normal].sum() + faulty[:, len(confusion) :].sum()
    return float(missed / faulty.sum()) if faulty.sum() else float("nan")


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

    The bootstrap is too narrow with few groups, and has no width without an error; so the interval holds Wilson's
    (1927, DOI 10.1080/01621459.1927.10502953) too, for as many independent trials as there are groups.

    Examples
    --------
    >>> [round(bound, 3) for bound in accuracy_interval(np.ones(60, dtype=bool), np.repeat(np.arange(20), 3))]
    [0.839, 1.0]
    """
    correct, total = np.bincount(group, weights=right), np.bincount(group)
    wilson = wilson_interval(float(right.mean()), total.size)
    times = stream(seed, "bootstrap").multinomial(total.size, np.full(total.size, 1 / total.size), size=draws)
    low, high = np.percentile((times @ correct) / (times @ total), [2.5, 97.5])
    return min(float(low), wilson[0]), max(float(high), wilson[1])


def wilson_interval(share: float, n: int) -> tuple[float, float]:
    """95 % interval of a share in `n` independent trials."""
    z = 1.959964
    middle = (share + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * math.sqrt(share * (1 - share) / n + z**2 / (4 * n**2))
    return max(0.0, middle - half), min(1.0, middle + half)
