"""Windows that a `FaultClassifier` is trained on, from recordings, arrays and synthetic sets."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from swashtwin.diagnosis.recording_arguments import as_recordings, relabel_recordings
from swashtwin.foundation import DataError, InputError
from swashtwin.learning import WindowSet, cut_windows
from swashtwin.pump import canonical_label, is_healthy, propose_class
from swashtwin.recordings import Recording, default_window

# Samples per window of a network that has its own default: the paper's.
_NETWORK_WINDOWS = {"bitcn": 2048}

# Index of the class of a window without a label.
_UNLABELED = -1


def measured_classes(X: Any, y: Any, classes: Sequence[str] | None) -> set[str]:
    """Return the classes of recordings or of a window set; an empty set for an array.

    Raises
    ------
    InputError
        `y` or `classes` is not a list of classes.
    """
    if isinstance(y, WindowSet):
        raise InputError(
            "y takes classes, but is a window set; give synthetic windows as synthetic=."
        )
    if isinstance(classes, str):
        raise InputError(f"classes is the text {classes!r}; give a list of class names.")

    if isinstance(X, WindowSet):
        return set(X.classes)
    recordings = as_recordings(X)
    if recordings is None:
        return set()
    return {
        str(recording.label) for recording in relabel_recordings(recordings, y) if recording.label
    }


def require_array_arguments(y: Any, groups: Any, reason: str) -> None:
    """Raise an `InputError` if `y` or `groups`, which only arrays take, is given."""
    for name, value in (("y", y), ("groups", groups)):
        if value is not None:
            raise InputError(
                f"{name} belongs to arrays: {reason}. Synthetic windows are given as synthetic=."
            )


def list_synthetic_sets(synthetic: WindowSet | Iterable[WindowSet] | None) -> list[WindowSet]:
    """Return one set of synthetic windows, several or none, as a list."""
    if synthetic is None:
        return []
    if isinstance(synthetic, WindowSet):
        synthetic = [synthetic]

    synthetic_sets = list(synthetic)
    for windows in synthetic_sets:
        if not isinstance(windows, WindowSet):
            raise InputError(
                f"synthetic holds a {type(windows).__name__}; it takes the window sets of "
                "synthesize."
            )
        windows.require_any("in synthetic")
        if not windows.synthetic.all():
            measured_name = windows.recording_id[~windows.synthetic][0]
            raise DataError(f"{measured_name} is measured; give it in X.")
    return synthetic_sets


def unify_class_names(
    synthetic_sets: Sequence[WindowSet], measured: Collection[str], fault_of: Mapping[str, str]
) -> tuple[list[WindowSet], tuple[str, ...]]:
    """Give synthetic windows the class names of the measured recordings.

    Healthy synthetic windows get the name of the measured healthy class if there is just one.

    Parameters
    ----------
    measured : classes of the recordings.
    fault_of : fault that a measured class stands for.

    Returns
    -------
    The synthetic sets, and notes on classes that may be the same.

    Raises
    ------
    InputError
        A class of `fault_of` was not measured, or its fault cannot be simulated.
    """
    # A diagnosis imports this module too, but does not need the faults of the model.
    from swashtwin.pump import FAULT_KINDS

    for label, fault in fault_of.items():
        if label not in measured:
            raise InputError(
                f"No recording is of the class {label!r}, which is to stand for {fault}; the "
                f"recordings are of {', '.join(sorted(measured))}.",
                field="fault_of",
            )

    synthetic_names: list[str] = []
    for windows in synthetic_sets:
        for label in np.unique(windows.label):
            if str(label) not in synthetic_names:
                synthetic_names.append(str(label))

    new_names = {
        canonical_label(fault, tuple(FAULT_KINDS)): label for label, fault in fault_of.items()
    }
    healthy_classes = [label for label in measured if is_healthy(label)]
    if len(healthy_classes) == 1:
        healthy_names = filter(is_healthy, synthetic_names)
        new_names.update(dict.fromkeys(healthy_names, healthy_classes[0]))

    renamed_sets = [_rename_classes(windows, new_names) for windows in synthetic_sets]
    return renamed_sets, _similar_class_notes(synthetic_names, measured, new_names)


def _similar_class_notes(
    synthetic_names: Sequence[str], measured: Collection[str], new_names: Mapping[str, str]
) -> tuple[str, ...]:
    """Return a note on each synthetic class that may be a measured class of another name."""
    unified_names = {new_names.get(name, name) for name in synthetic_names}
    unmatched_faults = [
        label for label in sorted(measured) if label not in unified_names and not is_healthy(label)
    ]
    if not unmatched_faults:
        return ()

    notes = []
    for name in synthetic_names:
        if new_names.get(name, name) in measured:
            continue
        likely_classes = [label for label in unmatched_faults if propose_class(label) == name]
        candidates = likely_classes or unmatched_faults
        condition = "By their names they are" if likely_classes else "If they are"
        notes.append(
            f"The synthetic class {name} and the measured {', '.join(candidates)} are trained as "
            f"different classes. {condition} the same: train with fault_of, so that "
            f"{candidates[0]!r} stands for {name!r}."
        )
    return tuple(notes)


def _rename_classes(windows: WindowSet, new_names: Mapping[str, str]) -> WindowSet:
    """Return the windows with other class names; two classes may become one."""
    classes = tuple(dict.fromkeys(new_names.get(name, name) for name in windows.classes))
    target = []
    for label in windows.label.tolist():
        target.append(classes.index(new_names.get(label, label)) if label else _UNLABELED)
    return replace(windows, classes=classes, target=np.array(target, dtype=np.int64))


def cut_training_windows(
    recordings: Sequence[Recording],
    synthetic_sets: Sequence[WindowSet],
    *,
    network: str | None,
    length: int | None,
    stride: int | None,
    classes: Sequence[str] | None,
    allow_partial_revolution: bool,
) -> WindowSet:
    """Cut labeled recordings into windows.

    Parameters
    ----------
    synthetic_sets : sets whose length and classes are the defaults.
    network : name of the network, which may have a default length.
    length : samples per window; None for the default.
    stride, allow_partial_revolution : see `FaultClassifier`.
    classes : class names in their order; None for those of the synthetic windows or of the
        recordings, sorted.
    """
    if synthetic_sets and classes is None:
        labels = {str(recording.label) for recording in recordings if recording.label}
        synthetic_classes = synthetic_sets[0].classes
        classes = synthetic_classes if labels <= set(synthetic_classes) else sorted(labels)

    if not length and synthetic_sets:
        length = synthetic_sets[0].length
    elif not length:
        length = _NETWORK_WINDOWS.get(network or "") or default_window(recordings)

    return cut_windows(
        recordings,
        length=length,
        stride=stride,
        classes=classes,
        allow_partial_revolution=allow_partial_revolution,
    )


def require_plain_array(X: Any) -> None:
    """Refuse what scikit-learn's check of arrays takes for something else, or describes poorly.

    Raises
    ------
    InputError
        Samples are masked, or the windows differ in length.
    """
    if np.ma.isMaskedArray(X):
        # The check would drop the mask, and the samples below it would be learned from.
        n_masked = int(np.ma.getmaskarray(X).sum())
        if n_masked:
            raise InputError(
                f"X has {n_masked} masked samples; leave out the windows that hold them, or fill "
                "them with X.filled()."
            )
    if not isinstance(X, (list, tuple)):
        return

    shapes = _shapes_of(X)
    if len(shapes) > 1:
        listed = " and ".join(str(shape) for shape in sorted(shapes)[:2])
        raise InputError(
            f"X holds windows of different shapes, such as {listed}; cut all of them to one length."
        )


def _shapes_of(windows: Sequence[Any]) -> set[tuple[int, ...]]:
    """Return the shapes of windows; that of a ragged one is its number of channels and samples."""
    shapes: set[tuple[int, ...]] = set()
    for window in windows:
        try:
            shapes.add(np.shape(window))
        except ValueError:
            shapes.update((len(window), *shape) for shape in _shapes_of(window))
    return shapes


def windows_of_array(
    X: np.ndarray, target: np.ndarray, classes: tuple[str, ...], groups: Any, sample_rate: float
) -> WindowSet:
    """Return the windows of an array ``(window, channel, sample)`` or ``(window, sample)``.

    Parameters
    ----------
    target : index of each window's class, -1 if it has no label.
    groups : recording of each window; None if each window is a recording.
    sample_rate : samples per second [Hz].
    """
    signal = X[:, None] if X.ndim == 2 else X
    if signal.ndim != 3:
        raise InputError(
            f"X has {X.ndim} dimensions; an array is (window, channel, sample) or (window, sample)."
        )
    n_windows, n_channels, n_samples = signal.shape
    if n_samples < 2:
        raise InputError(
            f"X has n_features = {n_samples}: a window of one sample cannot be learned from."
        )

    if groups is None:
        recording_ids = [f"window {index}" for index in range(n_windows)]
    else:
        group_names = np.asarray(groups)
        if group_names.shape != (n_windows,):
            raise InputError(
                f"groups has shape {group_names.shape} for {n_windows} windows; name the recording "
                "of each."
            )
        recording_ids = [str(name) for name in group_names]

    unspecified = np.full(n_windows, np.nan)
    return WindowSet(
        signal=signal.astype(np.float32),
        target=target.astype(np.int64),
        classes=classes,
        recording_id=np.array(recording_ids, dtype=np.str_),
        specimen=np.full(n_windows, "", dtype=np.str_),
        discharge_pressure=unspecified,
        speed=unspecified,
        start=np.arange(n_windows, dtype=np.int64) * n_samples,
        synthetic=np.zeros(n_windows, dtype=np.bool_),
        sample_rate=sample_rate,
        channels=tuple(f"channel {index + 1}" for index in range(n_channels)),
        unit="1",
    )
