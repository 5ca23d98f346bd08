"""Training and test sets, and folds, that share no recording.

There is no split by window: neighboring windows of one recording are nearly the same window, so a
random split of windows measures memory. Three roles need two calls: split off the test set first,
then split the rest into training and validation.
"""

import warnings
from collections.abc import Iterable, Mapping

import numpy as np
from jaxtyping import Bool, Int, Shaped

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
"""Indices of the windows to train on, and of those to test on."""

MAX_TEST_FRACTION = 0.5
"""Largest share to test on: beyond it, training and test should change places."""


def require_measured(windows: WindowSet) -> None:
    """Raise a `LeakError` that names a synthetic window, if there is one.

    No split may deal synthetic windows: those made from a recording must stay on its side.
    """
    if windows.synthetic.any():
        name = windows.recording_id[windows.synthetic][0]
        raise LeakError(
            f"{name} is synthetic. Split the measured windows first, then add synthetic ones to "
            "the training set."
        )


def window_groups(
    windows: WindowSet, group: str | Mapping[str, str]
) -> Shaped[np.ndarray, " window"]:
    """Return the name of each window's group.

    Parameters
    ----------
    group : one of `GROUPS`, or the group of each recording by its id (`recording_groups`).

    Raises
    ------
    DataError
        A recording has no group.
    InputError
        No such group.
    """
    n_recordings = np.unique(windows.recording_id).size
    if isinstance(group, Mapping):
        names = np.unique(windows.recording_id).tolist()
        ungrouped = [name for name in names if name not in group]
        if ungrouped:
            raise DataError(missing_group_message(ungrouped, n_recordings, "group"))
        group_names = [str(group[name]) for name in windows.recording_id.tolist()]
        return np.array(group_names, dtype=np.str_)

    if group == "recording":
        return windows.recording_id
    if group == "condition":
        ids = windows.recording_id.tolist()
        names = name_conditions(ids, windows.speed, windows.discharge_pressure)
        return np.array(names, dtype=np.str_)
    if group != "specimen":
        raise InputError(
            f"Invalid group {group!r}: it must be one of {', '.join(GROUPS)}, or an attribute that "
            "all recordings have."
        )

    has_specimen = windows.specimen != ""
    if not has_specimen.all():
        ungrouped = np.unique(windows.recording_id[~has_specimen]).tolist()
        raise DataError(missing_group_message(ungrouped, n_recordings, group))
    return windows.specimen


def split_by_recording(
    windows: WindowSet,
    *,
    test_fraction: float = 0.2,
    seed: int = 0,
    group: str | Mapping[str, str] = "recording",
    keep_in_training: Iterable[str] = (),
) -> tuple[WindowSet, WindowSet]:
    """Return a training set and a test set that share no recording, each with every class.

    The groups are dealt into k folds of similar composition by class and discharge pressure
    (scikit-learn's `StratifiedGroupKFold`), one of which is the test set. k starts at
    1/`test_fraction` and falls until every class stands on both sides, so with few recordings the
    test set may be larger than requested.

    Parameters
    ----------
    windows : measured windows with labels.
    test_fraction : share of the windows to test on, above 0 and at most 0.5.
    seed : seed of the draw.
    group : what is kept whole: ``"recording"``, ``"specimen"`` (a machine is on one side only),
        ``"condition"`` (a speed and pressure is on one side only), or any group by recording id
        (`recording_groups`). A recording is never on both sides.
    keep_in_training : recordings (a manifest, or ids) that must not be tested on, such as the
        manifest of synthetic windows that the training set will get. Their groups stay in the
        training set, and the others are split.

    Raises
    ------
    DataError
        A class cannot be on both sides, or a fact that the split needs is missing.
    LeakError
        Some windows are synthetic. Add these to the training set afterwards.
    """
    if not 0 < test_fraction <= MAX_TEST_FRACTION:
        raise InputError(
            f"test_fraction ({test_fraction:g}) must be above 0 and at most "
            f"{MAX_TEST_FRACTION:g}; a fifth is 0.2."
        )
    require_measured(windows)
    windows.require_labels("a split by class")
    groups = window_groups(windows, group)
    group_name = group if isinstance(group, str) else "group"
    _require_two_groups(windows, groups, f"{group_name}(s)")

    # A recording that synthetic windows were made from ties its whole group to the training set.
    tied_names = sorted(find_copies(join_manifests([keep_in_training]), windows.recordings))
    tied_groups = groups[np.isin(windows.recording_id, tied_names)]
    is_free = ~np.isin(groups, tied_groups)
    if not is_free.all():
        _require_two_groups(
            windows.subset(is_free),
            groups[is_free],
            f"{group_name}(s) without a part in synthetic ones",
        )

    rows = np.flatnonzero(is_free)
    cell_pressure = np.unique(windows.cell_pressure, return_inverse=True)[1]
    cells = windows.target * (int(cell_pressure.max()) + 1) + cell_pressure
    test_rows = select_test_rows(
        windows.target[rows], cells[rows], groups[rows], test_fraction, seed
    )
    if test_rows is None:
        raise DataError(
            f"No split by {group_name} keeps every class on both sides. Name the recordings of the "
            "test, or record more."
        )

    is_test = np.zeros(len(windows), dtype=np.bool_)
    is_test[rows[test_rows]] = True
    return windows.subset(~is_test), windows.subset(is_test)


def check_disjoint(train: WindowSet, test: WindowSet) -> None:
    """Raise a `LeakError` if the test set was, or could have been, seen in training.

    That is: a recording is on both sides, a test window is byte for byte a training window (one
    measurement under two ids), or a test window is synthetic.
    """
    if test.synthetic.any():
        name = test.recording_id[test.synthetic][0]
        raise LeakError(f"{name} is synthetic; a test set holds measured windows only.")

    shared = find_copies(train.recordings, test.recordings)
    if shared:
        raise LeakError(
            f"{describe_copies(shared)} is in training and in test. Split by recording, and keep "
            "one of two copies."
        )

    name_by_content = {
        window.tobytes(): name
        for window, name in zip(train.signal, train.recording_id, strict=True)
    }
    for window, name in zip(test.signal, test.recording_id, strict=True):
        original = name_by_content.get(window.tobytes())
        if original is not None:
            raise LeakError(
                f"The test recording {name} holds a window of the training recording {original}; "
                "one is a copy of the other. Keep one of them."
            )


def _require_two_groups(
    windows: WindowSet, groups: Shaped[np.ndarray, " window"], group_description: str
) -> None:
    for index, name in enumerate(windows.classes):
        count = np.unique(groups[windows.target == index]).size
        if count < 2:
            raise DataError(
                f"The class {name} has windows of {count} {group_description}, and needs 2 to be "
                "in training and in test. Record another, or name the recordings of the test."
            )


def group_folds(
    windows: WindowSet,
    *,
    group: str | Mapping[str, str] = "recording",
    n_folds: int = 5,
    seed: int = 0,
) -> tuple[Fold, ...]:
    """Return folds that share no group, and so no recording, with similar classes in each.

    Each fold is a pair (indices to train on, indices to test on), dealt by scikit-learn's
    `StratifiedGroupKFold`. Windows may overlap: overlapping ones are of one recording, so they stay
    on one side. `without_overlap` thins a test set, in which overlapping windows would count one
    moment twice.

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
    groups = window_groups(windows, group)
    group_name = group if isinstance(group, str) else "group"
    n_groups = np.unique(groups).size
    if not 2 <= n_folds <= n_groups:
        raise InputError(
            f"n_folds ({n_folds}) must be 2 to {n_groups}, the number of {group_name}s."
        )

    # Imported here, because a diagnosis needs no folds and the import takes longer than one.
    from sklearn.model_selection import StratifiedGroupKFold

    splitter = StratifiedGroupKFold(n_splits=n_folds, shuffle=True, random_state=seed)
    with warnings.catch_warnings():
        # It warns of a class with fewer groups than folds; `_require_all_classes` decides.
        warnings.simplefilter("ignore", UserWarning)
        try:
            folds = tuple(splitter.split(np.zeros(len(windows)), windows.target, groups))
        except ValueError as cause:
            raise InputError(
                f"{n_groups} {group_name}(s) cannot be dealt into {n_folds} folds: {cause}"
            ) from cause

    for trained, tested in folds:
        _require_all_classes(windows, trained, np.unique(groups[tested]).tolist())
    return folds


def _require_all_classes(
    windows: WindowSet, trained: Int[np.ndarray, " _trained"], held_out_groups: list[str]
) -> None:
    counts = np.bincount(windows.target[trained], minlength=len(windows.classes))
    if not counts.all():
        names = ", ".join(held_out_groups[:3])
        raise DataError(
            f"With {names} held out, nothing of the class {windows.classes[int(counts.argmin())]} "
            "is left to train on. Use fewer folds or another group, or record the class in more "
            "groups."
        )


def without_overlap(windows: WindowSet) -> WindowSet:
    """Return windows of each recording that do not overlap: the first, then each next free one."""
    rows: list[int] = []
    end_by_recording: dict[str, int] = {}
    for row in np.lexsort((windows.start, windows.recording_id)):
        name = str(windows.recording_id[row])
        start = int(windows.start[row])
        if start >= end_by_recording.get(name, start):
            rows.append(int(row))
            end_by_recording[name] = start + windows.length
    return windows.subset(np.array(sorted(rows), dtype=np.int64))


TWIN_OF = "twin of "
"""Prefix of the specimen of windows that a twin simulated: the twin of a machine, or, if it is of
none or of one that was not recorded, of a type of pump.
"""


def fold_training_rows(
    target: Int[np.ndarray, " row"],
    specimen: Shaped[np.ndarray, " row"],
    is_synthetic: Bool[np.ndarray, " row"],
    tested: Int[np.ndarray, " _tested"],
) -> Int[np.ndarray, " _trained"]:
    """Return the rows (windows or recordings) to train on if some measured rows are tested.

    These are the other measured rows, and the synthetic rows that were made without the tested
    ones (`is_made_without`). A class that would be missing, because no machine recorded it, has all
    its synthetic rows: no tested row is of that class.

    Parameters
    ----------
    target : index of the class of each row.
    specimen : machine of each row.
    tested : indices of the measured rows that the fold tests on.
    """
    is_tested = np.zeros(len(target), dtype=bool)
    is_tested[tested] = True
    is_measured = ~is_synthetic & ~is_tested
    is_independent = is_synthetic & is_made_without(
        specimen, trained=specimen[is_measured], tested=specimen[is_tested]
    )

    is_trained = is_measured | is_independent
    missing_classes = np.setdiff1d(target, target[is_trained])
    is_trained |= is_synthetic & np.isin(target, missing_classes)
    return np.flatnonzero(is_trained)


def is_made_without(
    synthetic: Shaped[np.ndarray, " synthetic"],
    *,
    trained: Shaped[np.ndarray, " trained"],
    tested: Shaped[np.ndarray, " tested"],
) -> Bool[np.ndarray, " synthetic"]:
    """Return whether each synthetic specimen was made without the tested recordings.

    A specimen "twin of NAME" has the fitted values, the noise and the gains of machine NAME. It
    depends on the test if the whole machine is held out, which then stands for a new one. If other
    recordings of the machine are trained on, the test is of a known machine, and its twin may
    train. Any other "... of NAME" is made from windows of NAME, which may be the tested ones.

    Parameters
    ----------
    synthetic : specimens of the synthetic windows.
    trained, tested : specimens of the measured windows that are trained and tested on.

    Examples
    --------
    >>> specimens = np.array(["twin of A", "copies of A", "twin of 25scy14-1b"])
    >>> is_made_without(specimens, trained=np.array(["B"]), tested=np.array(["A"])).tolist()
    [False, False, True]
    >>> is_made_without(specimens, trained=np.array(["A"]), tested=np.array(["A"])).tolist()
    [True, False, True]
    """
    tested_names = set(tested.tolist()) - {""}
    held_out_machines = tested_names - set(trained.tolist())
    dependent = {
        *tested_names,
        *(f"{TWIN_OF}{name}" for name in held_out_machines),
    }
    endings = tuple(f" of {name}" for name in tested_names)

    names, index = np.unique(synthetic, return_inverse=True)
    is_independent = []
    for name in names.tolist():
        is_copy = not name.startswith(TWIN_OF) and name.endswith(endings)
        is_independent.append(name not in dependent and not is_copy)
    return np.array(is_independent, dtype=bool)[index]
