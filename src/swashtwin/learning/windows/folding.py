"""Folds that share no group: every window is tested once (or some are, again and again) by what never saw its group."""

import warnings
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from jaxtyping import Int
from sklearn.model_selection import GroupKFold, GroupShuffleSplit, LeaveOneGroupOut, StratifiedGroupKFold

from swashtwin.foundation import DataError, InputError
from swashtwin.learning.windows.grouping import group_name, require_measured, window_groups
from swashtwin.learning.windows.window_set import WindowSet

Dealing = Literal["stratified", "plain", "each", "shuffled"]
Fold = tuple[Int[np.ndarray, " _trained"], Int[np.ndarray, " _tested"]]


def group_folds(
    windows: WindowSet,
    *,
    group: str | Mapping[str, str] = "recording",
    n_folds: int = 5,
    dealing: Dealing = "stratified",
    test_fraction: float = 0.2,
    seed: int = 0,
) -> tuple[Fold, ...]:
    """Pairs (indices to train on, indices to test on) that share no group, and so no recording.

    Windows may overlap: overlapping ones are of one recording, so they stay on one side. `without_overlap` thins a test
    set, where overlapping windows would count one moment twice.

    Parameters
    ----------
    windows : measured windows with labels.
    group : as in `split_by_recording`.
    n_folds : number of folds; ``dealing="each"`` does not look at it.
    dealing : ``"stratified"`` deals groups so that classes are alike in every fold, drawn anew by each seed
        (scikit-learn's `StratifiedGroupKFold`); ``"plain"`` makes folds of like size (`GroupKFold`, no draw);
        ``"each"`` holds out one group after the other (`LeaveOneGroupOut`); ``"shuffled"`` draws `test_fraction` of the
        groups `n_folds` times (`GroupShuffleSplit`).
    test_fraction : share of groups that ``"shuffled"`` holds out.
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
    groups = window_groups(windows, group)
    count = np.unique(groups).size
    if not 2 <= n_folds <= count and dealing in ("stratified", "plain"):
        raise InputError(f"n_folds ({n_folds}) must be 2 to {count}, the number of {group_name(group)}s.")
    splitter = _splitter(dealing, n_folds, test_fraction, seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a class of fewer groups than folds is dealt as far as it goes
        try:
            folds = tuple(splitter.split(np.zeros(len(windows)), windows.target, groups))
        except ValueError as cause:
            raise InputError(f"{count} {group_name(group)}(s) cannot be dealt so: {cause}") from cause
    for trained, tested in folds:
        _require_every_class(windows, trained, tested, groups)
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


def _splitter(dealing: Dealing, n_folds: int, test_fraction: float, seed: int) -> Any:
    if dealing == "stratified":
        return StratifiedGroupKFold(n_splits=n_folds, shuffle=True, random_state=seed)
    if dealing == "plain":
        return GroupKFold(n_splits=n_folds)
    if dealing == "each":
        return LeaveOneGroupOut()
    if dealing == "shuffled":
        return GroupShuffleSplit(n_splits=n_folds, test_size=test_fraction, random_state=seed)
    raise InputError(f"dealing {dealing!r} is none of stratified, plain, each, shuffled.")


def _require_every_class(
    windows: WindowSet,
    trained: Int[np.ndarray, " trained"],
    tested: Int[np.ndarray, " tested"],
    groups: np.ndarray,
) -> None:
    present = np.bincount(windows.target[trained], minlength=len(windows.classes))
    if not present.all():
        names = ", ".join(np.unique(groups[tested]).tolist()[:3])
        raise DataError(
            f"with {names} held out nothing of class {windows.classes[int(present.argmin())]} is left to train on; "
            "take fewer folds, another group, or record the class in more groups."
        )
