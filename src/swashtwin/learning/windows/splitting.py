"""Training and test sets, and folds, that share no recording. Splitting by window does not exist
here.

Neighboring windows of one recording are nearly the same window; a random split of windows measures
memory. Three roles need two calls: split off the test set first, then split the rest into training
and validation.
"""

import warnings
from collections.abc import Iterable, Mapping

import numpy as np
from jaxtyping import Int, Shaped

from swashtwin.foundation import DataError, InputError, LeakError
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.recordings import (
    GROUPS,
    describe_copies,
    find_copies,
    join_manifests,
    missing_group_message,
    name_conditions,
    select_test_rows,
)

Fold = tuple[Int[np.ndarray, " _trained"], Int[np.ndarray, " _tested"]]


def require_measured(windows: WindowSet) -> None:
    """Raise a `LeakError` that names a synthetic window, if there is one: no split may deal these
    out.
    """
    if windows.synthetic.any():
        name = windows.recording_id[windows.synthetic][0]
        raise LeakError(
            f"{name} is synthetic; split the measured windows first, then add synthetic ones to training."
        )


def window_groups(
    windows: WindowSet, group: str | Mapping[str, str]
) -> Shaped[np.ndarray, " window"]:
    """Name of each window's group: by one of `GROUPS`, or by its recording's id as
    `recording_groups` gives it.
    """
    if isinstance(group, Mapping):
        missing = [name for name in np.unique(windows.recording_id).tolist() if name not in group]
        if missing:
            raise DataError(
                missing_group_message(missing, np.unique(windows.recording_id).size, "group")
            )
        return np.array([str(group[name]) for name in windows.recording_id.tolist()], dtype=np.str_)
    if group == "recording":
        return windows.recording_id
    if group == "condition":
        ids = windows.recording_id.tolist()
        return np.array(
            name_conditions(ids, windows.speed, windows.discharge_pressure), dtype=np.str_
        )
    if group != "specimen":
        raise InputError(
            f"group {group!r} is none of {', '.join(GROUPS)}; an attribute of the recordings gives groups of its own."
        )
    if (windows.specimen == "").any():
        missing = sorted(set(windows.recording_id[windows.specimen == ""].tolist()))
        raise DataError(missing_group_message(missing, np.unique(windows.recording_id).size, group))
    return windows.specimen


def split_by_recording(
    windows: WindowSet,
    *,
    test_fraction: float = 0.2,
    seed: int = 0,
    group: str | Mapping[str, str] = "recording",
    keep_in_training: Iterable[str] = (),
) -> tuple[WindowSet, WindowSet]:
    """(training set, test set) that share no recording, with every class on both sides.

    The groups are dealt into k folds of like composition by class and discharge pressure
    (scikit-learn's `StratifiedGroupKFold`), one of which is the test set. k starts at
    1/`test_fraction` and falls until every class stands on both sides, so with few recordings the
    test set may be larger than asked.

    Parameters
    ----------
    windows : measured windows with labels.
    test_fraction : share of the windows to test on, above 0 and at most 0.5.
    seed : seed of the draw.
    group : what is kept whole: ``"recording"``, ``"specimen"`` (one machine on one side only),
        ``"condition"`` (one speed and pressure on one side only), or any group by recording id
        (`recording_groups`). A recording never stands on both sides, whichever it is.
    keep_in_training : recordings (a manifest, or ids) that must not be tested on, such as the
        manifest of synthetic windows that the training set will get. Their groups stay in the
        training set, and the rest is split.

    Raises
    ------
    DataError
        Some class cannot stand on both sides, or a fact the split needs was not recorded.
    LeakError
        Some windows are synthetic. Add these to the training set afterwards.
    """
    if not 0 < test_fraction <= 0.5:
        raise InputError(
            f"test_fraction ({test_fraction:g}) must be above 0 and at most 0.5; a fifth is 0.2."
        )
    require_measured(windows)
    windows.require_labels("a split by class")
    groups, name = window_groups(windows, group), group if isinstance(group, str) else "group"
    _require_two_groups(windows, groups, f"{name}(s)")
    names = sorted(find_copies(join_manifests([keep_in_training]), windows.recordings))
    is_kept = np.isin(groups, groups[np.isin(windows.recording_id, names)])
    if is_kept.any():
        _require_two_groups(
            windows.subset(~is_kept),
            groups[~is_kept],
            f"{name}(s) without a part in synthetic ones",
        )
    rows = np.flatnonzero(~is_kept)
    pressures = np.unique(windows.cell_pressure, return_inverse=True)[1]
    cells = windows.target * (int(pressures.max()) + 1) + pressures
    test = select_test_rows(windows.target[rows], cells[rows], groups[rows], test_fraction, seed)
    if test is None:
        raise DataError(
            f"no split by {name} keeps every class on both sides; name the recordings of the test."
        )
    mask = np.zeros(len(windows), dtype=np.bool_)
    mask[rows[test]] = True
    return windows.subset(~mask), windows.subset(mask)


def check_disjoint(train: WindowSet, test: WindowSet) -> None:
    """Raise a `LeakError` if the test set was, or could have been, seen in training.

    That is: a recording stands on both sides, a test window is byte for byte a training window (one
    measurement under two ids), or a test window is synthetic.
    """
    if test.synthetic.any():
        raise LeakError(
            f"{test.recording_id[test.synthetic][0]} is synthetic; a test set holds measured windows only."
        )
    if shared := find_copies(train.recordings, test.recordings):
        raise LeakError(
            f"{describe_copies(shared)} stands in training and in test; split by recording, and keep one of two copies."
        )
    trained = {
        window.tobytes(): name
        for window, name in zip(train.signal, train.recording_id, strict=True)
    }
    for window, name in zip(test.signal, test.recording_id, strict=True):
        twin = trained.get(window.tobytes())
        if twin is not None:
            raise LeakError(
                f"test recording {name} holds a window of training recording {twin}; one copies the other."
            )


def _require_two_groups(
    windows: WindowSet, groups: Shaped[np.ndarray, " window"], group: str
) -> None:
    for index, name in enumerate(windows.classes):
        count = np.unique(groups[windows.target == index]).size
        if count < 2:
            raise DataError(
                f"class {name} has windows of {count} {group}, and needs 2 to stand in training and in test; record "
                "another, or name the recordings of the test."
            )


def group_folds(
    windows: WindowSet,
    *,
    group: str | Mapping[str, str] = "recording",
    n_folds: int = 5,
    seed: int = 0,
) -> tuple[Fold, ...]:
    """Pairs (indices to train on, indices to test on) that share no group, and so no recording,
    with classes alike in each (scikit-learn's `StratifiedGroupKFold`).

    Windows may overlap: overlapping ones are of one recording, so they stay on one side.
    `without_overlap` thins a test set, where overlapping windows would count one moment twice.

    Parameters
    ----------
    windows : measured windows with labels.
    group : as in `split_by_recording`.
    n_folds : number of folds.
    seed : seed of the draw.

    Raises
    ------
    InputError
        More folds than groups, or fewer than two.
    LeakError
        Some windows are synthetic. Add these to the training sides afterwards.
    DataError
        A fold leaves nothing of a class to train on, or a window has no label or no group.
    """
    windows.require_labels("a split by class")
    require_measured(windows)
    groups, name = window_groups(windows, group), group if isinstance(group, str) else "group"
    count = np.unique(groups).size
    if not 2 <= n_folds <= count:
        raise InputError(f"n_folds ({n_folds}) must be 2 to {count}, the number of {name}s.")
    from sklearn.model_selection import StratifiedGroupKFold

    splitter = StratifiedGroupKFold(n_splits=n_folds, shuffle=True, random_state=seed)
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", UserWarning
        )  # a class of fewer groups than folds is dealt as far as it goes
        try:
            folds = tuple(splitter.split(np.zeros(len(windows)), windows.target, groups))
        except ValueError as cause:
            raise InputError(f"{count} {name}(s) cannot be dealt so: {cause}") from cause
    for trained, tested in folds:
        present = np.bincount(windows.target[trained], minlength=len(windows.classes))
        if not present.all():
            names = ", ".join(np.unique(groups[tested]).tolist()[:3])
            raise DataError(
                f"with {names} held out nothing of class {windows.classes[int(present.argmin())]} is left to train on; "
                "take fewer folds, another group, or record the class in more groups."
            )
    return folds


def without_overlap(windows: WindowSet) -> WindowSet:
    """The windows of each recording that begin no sooner than the one kept before them ends."""
    indices, ends = [], dict[str, int]()
    for index in np.lexsort((windows.start, windows.recording_id)):
        name, start = str(windows.recording_id[index]), int(windows.start[index])
        if start >= ends.get(name, start):
            indices.append(int(index))
            ends[name] = start + windows.length
    return windows.subset(np.array(sorted(indices), dtype=np.int64))
