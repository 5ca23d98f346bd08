"""Selection of test rows that keeps groups whole and classes on both sides."""

import warnings
from operator import itemgetter

import numpy as np
from jaxtyping import Int, Shaped

# Classes on one side only, cells on one side only, and distance from the wanted size.
_Rank = tuple[int, int, float]


def select_test_rows(
    classes: Int[np.ndarray, " row"],
    cells: Int[np.ndarray, " row"],
    groups: Shaped[np.ndarray, " row"],
    test_fraction: float,
    seed: int,
    *,
    every_class: bool = True,
) -> Int[np.ndarray, " _tested"] | None:
    """Return rows of a test set that shares no group with the rest, or None.

    Every class is on both sides. The groups are dealt into k folds (scikit-learn's
    `StratifiedGroupKFold`), from k = 1/`test_fraction` down. Of the first k that gives such a fold,
    it is the one with most cells on both sides and the size nearest to the fraction.

    Parameters
    ----------
    classes : class of each row.
    cells : finer strata, such as class and pressure together.
    groups : what is kept whole.
    every_class : False: if no fold has every class on both sides, take the one whose test set
        lacks fewest classes and whose training set lacks none.
    """
    strata_choices = [cells, classes]
    if not every_class:
        strata_choices.append(np.zeros_like(classes))

    incomplete: list[tuple[_Rank, Int[np.ndarray, " _tested"]]] = []
    max_folds = min(round(1 / test_fraction), np.unique(groups).size)
    for n_folds in range(max_folds, 1, -1):
        for choice, strata in enumerate(strata_choices):
            ranked = [
                (_rank(classes, cells, rows, test_fraction), rows)
                for rows in _folds(strata, groups, n_folds, seed)
            ]
            complete = [pair for pair in ranked if pair[0][0] == 0]
            # A fold without strata has its classes by chance: prefer a stratified one of fewer
            # folds.
            if complete and choice < 2:
                return min(complete, key=itemgetter(0))[1]
            for rank, rows in ranked:
                if np.isin(classes[rows], np.delete(classes, rows)).all():
                    incomplete.append((rank, rows))

    if incomplete and not every_class:
        return min(incomplete, key=itemgetter(0))[1]
    return None


def _rank(
    classes: Int[np.ndarray, " row"],
    cells: Int[np.ndarray, " row"],
    rows: Int[np.ndarray, " _tested"],
    test_fraction: float,
) -> _Rank:
    size_error = abs(rows.size / len(classes) - test_fraction)
    return _count_one_sided(classes, rows), _count_one_sided(cells, rows), size_error


def _count_one_sided(strata: Int[np.ndarray, " row"], rows: Int[np.ndarray, " _tested"]) -> int:
    """Return the number of strata whose rows are all in the test set, or all out of it."""
    counts = np.bincount(strata)
    test_counts = np.bincount(strata[rows], minlength=counts.size)
    is_one_sided = (test_counts == 0) | (test_counts == counts)
    return int(np.sum((counts > 0) & is_one_sided))


def _folds(
    strata: Int[np.ndarray, " row"], groups: Shaped[np.ndarray, " row"], n_folds: int, seed: int
) -> list[Int[np.ndarray, " _tested"]]:
    from sklearn.model_selection import StratifiedGroupKFold

    if np.bincount(strata).max() < n_folds:
        return []

    splitter = StratifiedGroupKFold(n_splits=n_folds, shuffle=True, random_state=seed)
    with warnings.catch_warnings():
        # Cells of fewer rows than folds are expected: they are in some folds only.
        warnings.simplefilter("ignore", UserWarning)
        folds = splitter.split(np.zeros(len(strata)), strata, groups)
        return [test_rows for _, test_rows in folds]
