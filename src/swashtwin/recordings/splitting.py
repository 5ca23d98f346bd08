"""Which rows are tested, so that no group is on both sides and the classes are alike on both."""

import warnings

import numpy as np
from jaxtyping import Int, Shaped


def best_test_rows(
    classes: Int[np.ndarray, " row"],
    cells: Int[np.ndarray, " row"],
    groups: Shaped[np.ndarray, " row"],
    test_fraction: float,
    seed: int,
) -> Int[np.ndarray, " _tested"] | None:
    """Rows of a test set that shares no group with the rest and has every class on both sides, or None.

    The groups are dealt into k folds (scikit-learn's `StratifiedGroupKFold`), from k = 1/`test_fraction` down. Of the
    first k that gives such a fold, it is the one with most cells on both sides and the size nearest to the fraction.

    Parameters
    ----------
    classes : class of each row.
    cells : finer strata, such as class and pressure together.
    groups : what is kept whole.
    """
    for n_folds in _fold_counts(groups, test_fraction):
        for strata in (cells, classes):
            ranks = [
                (one_sided(cells, rows), abs(rows.size / len(classes) - test_fraction), position, rows)
                for position, rows in enumerate(_folds(strata, groups, n_folds, seed))
                if not one_sided(classes, rows)
            ]
            if ranks:
                return min(ranks, key=lambda rank: rank[:3])[3]
    return None


def nearest_test_rows(
    classes: Int[np.ndarray, " row"],
    cells: Int[np.ndarray, " row"],
    groups: Shaped[np.ndarray, " row"],
    test_fraction: float,
    seed: int,
) -> Int[np.ndarray, " _tested"] | None:
    """As `best_test_rows`; where no fold has every class on both sides, fewest classes miss in the test set.

    None where every fold would take a class out of training altogether.
    """
    rows = best_test_rows(classes, cells, groups, test_fraction, seed)
    if rows is not None:
        return rows
    ranks: list[tuple[int, int, float, int, Int[np.ndarray, " _tested"]]] = []
    for n_folds in _fold_counts(groups, test_fraction):
        for strata in (cells, classes, np.zeros_like(classes)):
            for rows in _folds(strata, groups, n_folds, seed):
                rest = np.delete(classes, rows)
                if set(classes[rows].tolist()) <= set(rest.tolist()):
                    size = abs(rows.size / len(classes) - test_fraction)
                    ranks.append((one_sided(classes, rows), one_sided(cells, rows), size, len(ranks), rows))
    return min(ranks, key=lambda rank: rank[:4])[4] if ranks else None


def one_sided(strata: Int[np.ndarray, " row"], rows: Int[np.ndarray, " _tested"]) -> int:
    """Number of strata that are on one side only."""
    counts = np.bincount(strata)
    tested = np.bincount(strata[rows], minlength=counts.size)
    return int(np.sum((counts > 0) & ((tested == 0) | (tested == counts))))


def _fold_counts(groups: Shaped[np.ndarray, " row"], test_fraction: float) -> range:
    return range(min(round(1 / test_fraction), np.unique(groups).size), 1, -1)


def _folds(
    strata: Int[np.ndarray, " row"], groups: Shaped[np.ndarray, " row"], n_folds: int, seed: int
) -> list[Int[np.ndarray, " _tested"]]:
    from sklearn.model_selection import StratifiedGroupKFold

    if np.bincount(strata).max() < n_folds:
        return []
    splitter = StratifiedGroupKFold(n_splits=n_folds, shuffle=True, random_state=seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a cell smaller than n_folds is dealt as far as it goes
        return [rows for _, rows in splitter.split(np.zeros(len(strata)), strata, groups)]
