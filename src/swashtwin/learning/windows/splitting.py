"""Training and test sets that share no recording. Splitting by window does not exist here.

Neighboring windows of one recording are nearly the same window; a random split of windows measures memory. Three roles
need two calls: split off the test set first, then split the rest into training and validation.
"""

from collections.abc import Iterable, Mapping

import numpy as np
from jaxtyping import Shaped

from swashtwin.foundation import DataError, InputError, LeakError
from swashtwin.learning.windows.grouping import group_name, require_measured, window_groups
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.recordings import best_test_rows, join_manifests, say_seen, seen_recordings


def split_by_recording(
    windows: WindowSet,
    *,
    test_fraction: float = 0.2,
    seed: int = 0,
    group: str | Mapping[str, str] = "recording",
    keep_in_training: Iterable[str] = (),
) -> tuple[WindowSet, WindowSet]:
    """(training set, test set) that share no recording, with every class on both sides.

    The groups are dealt into k folds of like composition by class and discharge pressure (scikit-learn's
    `StratifiedGroupKFold`), one of which is the test set. k starts at 1/`test_fraction` and falls until every class
    stands on both sides, so with few recordings the test set may be larger than asked.

    Parameters
    ----------
    windows : measured windows with labels.
    test_fraction : share of the windows to test on, above 0 and at most 0.5.
    seed : seed of the draw.
    group : what is kept whole: ``"recording"``, ``"specimen"`` (one machine on one side only), ``"condition"`` (one
        speed and pressure on one side only), or any group by recording id (`recording_groups`). A recording never
        stands on both sides, whichever it is.
    keep_in_training : recordings (a manifest, or ids) that must not be tested on, such as the manifest of synthetic
        windows that the training set will get. Their groups stay in the training set, and the rest is split.

    Raises
    ------
    DataError
        Some class cannot stand on both sides, or a fact the split needs was not recorded.
    LeakError
        Some windows are synthetic. Add these to the training set afterwards.
    """
    if not 0 < test_fraction <= 0.5:
        raise InputError(f"test_fraction ({test_fraction:g}) must be above 0 and at most 0.5; a fifth is 0.2.")
    require_measured(windows)
    windows.require_labels("a split by class")
    groups = window_groups(windows, group)
    _require_two_groups(windows, groups, f"{group_name(group)}(s)")
    names = sorted(seen_recordings(join_manifests([keep_in_training]), windows.recordings))
    is_kept = np.isin(groups, groups[np.isin(windows.recording_id, names)])
    if is_kept.any():
        _require_two_groups(
            windows.subset(~is_kept), groups[~is_kept], f"{group_name(group)}(s) without a part in synthetic ones"
        )
    rows = np.flatnonzero(~is_kept)
    pressures = np.unique(windows.cell_pressure, return_inverse=True)[1]
    cells = windows.target * (int(pressures.max()) + 1) + pressures
    test = best_test_rows(windows.target[rows], cells[rows], groups[rows], test_fraction, seed)
    if test is None:
        raise DataError(
            f"no split by {group_name(group)} keeps every class on both sides; name the recordings of the test."
        )
    mask = np.zeros(len(windows), dtype=np.bool_)
    mask[rows[test]] = True
    return windows.subset(~mask), windows.subset(mask)


def hold_out(windows: WindowSet, recording_ids: Iterable[str]) -> tuple[WindowSet, WindowSet]:
    """(training set, test set), the test set being the recordings named.

    A class may be missing on either side; training and the scores then say so.

    Raises
    ------
    InputError
        No id, an id that no window has, or every id.
    LeakError
        A recording of the test set is synthetic.
    """
    chosen = sorted({str(name) for name in recording_ids})
    missing = [name for name in chosen if name not in windows.recording_id]
    if missing or not chosen:
        raise InputError(f"no window is of the recording {missing[0]!r}." if missing else "no recording was named.")
    mask = np.isin(windows.recording_id, chosen)
    if mask.all():
        raise InputError("every recording was held out; nothing is left to train on.")
    if windows.synthetic[mask].any():
        raise LeakError(f"{windows.recording_id[mask & windows.synthetic][0]} is synthetic; a test set is measured.")
    return windows.subset(~mask), windows.subset(mask)


def check_disjoint(train: WindowSet, test: WindowSet) -> None:
    """Raise a `LeakError` if the test set was, or could have been, seen in training.

    That is: a recording stands on both sides, a test window is byte for byte a training window (one measurement under
    two ids), or a test window is synthetic.
    """
    if test.synthetic.any():
        raise LeakError(f"{test.recording_id[test.synthetic][0]} is synthetic; a test set holds measured windows only.")
    if shared := seen_recordings(train.recordings, test.recordings):
        raise LeakError(
            f"{say_seen(shared)} stands in training and in test; split by recording, and keep one of two copies."
        )
    trained = {window.tobytes(): name for window, name in zip(train.signal, train.recording_id, strict=True)}
    for window, name in zip(test.signal, test.recording_id, strict=True):
        twin = trained.get(window.tobytes())
        if twin is not None:
            raise LeakError(f"test recording {name} holds a window of training recording {twin}; one copies the other.")


def _require_two_groups(windows: WindowSet, groups: Shaped[np.ndarray, " window"], group: str) -> None:
    for index, name in enumerate(windows.classes):
        count = np.unique(groups[windows.target == index]).size
        if count < 2:
            raise DataError(
                f"class {name} has windows of {count} {group}, and needs 2 to stand in training and in test; record "
                "another, or name the recordings of the test."
            )
