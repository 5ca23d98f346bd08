"""What `FaultClassifier` takes: recordings with their classes, and synthetic windows; and what it
holds out.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

import swashtwin.learning as learning
from swashtwin.diagnosis.recording_arguments import as_recordings, relabeled
from swashtwin.foundation import DataError, InputError, LeakError
from swashtwin.learning import WindowSet
from swashtwin.pump import FAULT_KINDS, canonical_label, is_healthy, propose_class
from swashtwin.recordings import (
    Manifest,
    Recording,
    default_window,
    describe_copies,
    find_copies,
    find_duplicates,
    recording_groups,
)

_ERROR_RATE = 0.1
OWN_PARAMETERS = ("epochs", "batch_size", "learning_rate", "decay", "normalization")
"""Settings of the training that the constructor of a `FaultClassifier` names."""


def classes_of(X: Any, y: Any, named: Sequence[str] | None) -> set[str]:
    """Classes of recordings or of a window set; none of an array. An `InputError` where `y` or
    `named` is no list.
    """
    if isinstance(y, WindowSet):
        raise InputError(
            "y is a window set, and takes classes; give synthetic windows as synthetic=."
        )
    if isinstance(named, str):
        raise InputError(f"classes is the one text {named!r}; give a list of class names.")
    if isinstance(X, WindowSet):
        return set(X.classes)
    recordings = as_recordings(X)
    return (
        set()
        if recordings is None
        else {str(item.label) for item in relabeled(recordings, y) if item.label}
    )


def network_parameters(fitted: learning.FittedClassifier) -> dict[str, Any]:
    """Parameters of a `FaultClassifier` that trains a network like this one."""
    training, usual = asdict(fitted.settings), asdict(learning.RECOMMENDED_TRAINING)
    plain = learning.default_settings(learning.network_class(fitted.network.name))
    shape = ("n_channels", "n_classes", "length")
    other = {
        name: training[name]
        for name in usual
        if name not in OWN_PARAMETERS and training[name] != usual[name]
    }
    network = {
        name: value
        for name, value in fitted.network.settings.items()
        if name not in shape and value != plain.get(name)
    }
    return {
        "network": fitted.network.name,
        **{name: training[name] for name in OWN_PARAMETERS},
        "training_settings": other or None,
        "network_settings": network or None,
    }


def checked_settings(classifier: Any) -> learning.TrainingSettings:
    """Settings of the training by the parameters of a `FaultClassifier`.

    An `InputError` where one belongs to a network that is not named, or there is none of that name.
    """
    if classifier.network is None:
        usual = type(classifier)()
        for name in (*OWN_PARAMETERS, "training_settings", "network_settings", "device"):
            if getattr(classifier, name) != getattr(usual, name):
                raise InputError(f"{name} belongs to a network; name it, such as network='bitcn'.")
    values = {name: getattr(classifier, name) for name in OWN_PARAMETERS}
    other = dict(classifier.training_settings or {})
    unknown = [
        name
        for name in other
        if name not in asdict(learning.RECOMMENDED_TRAINING) or name in values
    ]
    if unknown:
        raise InputError(
            f"training_settings has no field {unknown[0]!r}; it takes fields of TrainingSettings other than "
            f"{', '.join(values)}, which are parameters of FaultClassifier."
        )
    return learning.TrainingSettings(**values, **other)


def require_none(y: Any, groups: Any, reason: str) -> None:
    """Raise an `InputError` where `y` or `groups` is given, which only arrays take."""
    for name, value in (("y", y), ("groups", groups)):
        if value is not None:
            raise InputError(
                f"{name} belongs to arrays: {reason}. Synthetic windows are given as synthetic=."
            )


def synthetic_sets(synthetic: WindowSet | Iterable[WindowSet] | None) -> list[WindowSet]:
    """One set of synthetic windows, several or none, as a list."""
    sets = (
        []
        if synthetic is None
        else [synthetic]
        if isinstance(synthetic, WindowSet)
        else list(synthetic)
    )
    for windows in sets:
        if not isinstance(windows, WindowSet):
            raise InputError(
                f"synthetic holds a {type(windows).__name__}; it takes the window sets of synthesize."
            )
        windows.require_any("in synthetic")
        if not windows.synthetic.all():
            raise DataError(
                f"{windows.recording_id[~windows.synthetic][0]} is measured; give it in X."
            )
    return sets


def name_alike(
    sets: Sequence[WindowSet], measured: Collection[str], fault_of: Mapping[str, str]
) -> tuple[list[WindowSet], tuple[str, ...]]:
    """(synthetic windows with the names of the measured classes, notes on classes that may be the
    same).

    Parameters
    ----------
    measured : classes of the recordings; where one of them is healthy, healthy synthetic windows
        get its name.
    fault_of : fault that a measured class stands for.
        An `InputError` where nobody measured the class, or simulated the fault.
    """
    synthetic = dict.fromkeys(str(label) for windows in sets for label in np.unique(windows.label))
    for label, fault in fault_of.items():
        if label not in measured:
            raise InputError(
                f"no recording is of the class {label!r}, which is to stand for {fault}; there are "
                f"{', '.join(sorted(measured))}.",
                field="fault_of",
            )
    names = {canonical_label(fault, tuple(FAULT_KINDS)): label for label, fault in fault_of.items()}
    healthy = [label for label in measured if is_healthy(label)]
    if len(healthy) == 1:
        names |= {name: healthy[0] for name in synthetic if is_healthy(name)}
    renamed = {names.get(name, name) for name in synthetic}
    lone = [label for label in sorted(measured) if label not in renamed and not is_healthy(label)]
    notes = []
    for name in synthetic:
        if names.get(name, name) in measured or not lone:
            continue
        likely = [label for label in lone if propose_class(label) == name]
        other = (likely or lone)[0]
        notes.append(
            f"The synthetic class {name} and the measured {', '.join(likely or lone)} are trained as different ones. "
            f"{'By their names they are the same' if likely else 'If they are the same'}: train with "
            f'--fault-of "{other}={name}", or fault_of.'
        )
    return [_renamed(windows, names) for windows in sets], tuple(notes)


def _renamed(windows: WindowSet, names: Mapping[str, str]) -> WindowSet:
    """The windows with other names of classes, of which two may become one."""
    classes = tuple(dict.fromkeys(names.get(name, name) for name in windows.classes))
    target = [
        classes.index(names.get(label, label)) if label else -1 for label in windows.label.tolist()
    ]
    return replace(windows, classes=classes, target=np.array(target, dtype=np.int64))


_WINDOWS = {"bitcn": 2048}
"""Samples per window of a network that has its own by default: the paper's."""


def windows_to_train(
    classifier: Any,
    recordings: Sequence[Recording],
    further: Sequence[WindowSet],
    classes: Sequence[str] | None,
) -> tuple[WindowSet, Mapping[str, str]]:
    """(windows of labeled recordings by the parameters of a `FaultClassifier`, group of each
    recording).

    Parameters
    ----------
    further : synthetic windows, whose length and classes are taken where nothing else is said.
    classes : class names in the order wanted, or None.
    """
    group = classifier.group
    if not isinstance(group, Mapping):
        group = recording_groups(recordings, group)
    if further and classes is None:
        labels = {str(item.label) for item in recordings if item.label}
        classes = further[0].classes if labels <= set(further[0].classes) else sorted(labels)
    length = classifier.window or (
        further[0].length if further else _WINDOWS.get(classifier.network or "")
    )
    windows = learning.cut_windows(
        recordings,
        length=length or default_window(recordings),
        stride=classifier.stride,
        classes=classes,
        allow_partial_revolution=classifier.allow_partial_revolution,
    )
    return windows, group


def windows_of_array(
    X: np.ndarray, target: np.ndarray, classes: tuple[str, ...], groups: Any, sample_rate: float
) -> WindowSet:
    """Windows of an array ``(window, channel, sample)`` or ``(window, sample)``, each a recording
    without `groups`.

    `target` is the index of each window's class, -1 for none; `sample_rate` is in Hz.
    """
    signal = X[:, None] if X.ndim == 2 else X
    if signal.ndim != 3:
        raise InputError(
            f"X has {X.ndim} dimensions; an array is (window, channel, sample) or (window, sample)."
        )
    if signal.shape[2] < 2:
        raise InputError(
            f"X has n_features = {signal.shape[2]}: a window of one sample cannot be learned from."
        )
    names = np.arange(len(signal)) if groups is None else np.asarray(groups)
    if names.shape != (len(signal),):
        raise InputError(
            f"groups has shape {names.shape} for {len(signal)} windows; name the recording of each."
        )
    nan = np.full(len(signal), np.nan)
    return WindowSet(
        signal=signal.astype(np.float32),
        target=target.astype(np.int64),
        classes=classes,
        recording_id=np.array(
            [f"window {name}" if groups is None else str(name) for name in names], dtype=np.str_
        ),
        specimen=np.full(len(signal), "", dtype=np.str_),
        discharge_pressure=nan,
        speed=nan,
        start=np.arange(len(signal), dtype=np.int64) * signal.shape[2],
        synthetic=np.zeros(len(signal), dtype=np.bool_),
        sample_rate=sample_rate,
        channels=tuple(f"channel {index + 1}" for index in range(signal.shape[1])),
        unit="1",
    )


def with_synthetic(measured: WindowSet, sets: Sequence[WindowSet]) -> WindowSet:
    """Measured and synthetic windows together, with the classes of both."""
    further = sorted({name for windows in sets for name in windows.classes} - set(measured.classes))
    classes = (*measured.classes, *further)
    together = measured.with_classes(classes)
    for windows in sets:
        learning.require_shared_speed(measured, windows)
        together = together + windows.with_classes(classes)
    return together


def hold_out_validation(
    training: WindowSet,
    group: str | Mapping[str, str],
    manifest: Manifest,
    *,
    fraction: float,
    error_rate: float | None,
    seed: int,
) -> tuple[WindowSet, WindowSet | None, float, tuple[str, ...]]:
    """(training windows, validation windows or None, error rate that these allow, notes).

    Parameters
    ----------
    group : what a split keeps whole.
    manifest : recordings that stay in training.
    fraction : share of the recordings that is held out; 0 for none.
    error_rate : that which the validation recordings should allow; 0.1 if None, and then as far as
        they go.
    """
    aim = _ERROR_RATE if error_rate is None else error_rate
    if not fraction:
        return training, None, aim, ()
    n_left = len(training.recordings.keys() - find_copies(manifest, training.recordings).keys())
    share, _ = learning.validation_share(n_left, aim, fraction)
    try:
        training, validation = learning.split_by_recording(
            training, test_fraction=share, seed=seed, group=group, keep_in_training=manifest
        )
    except DataError as cause:
        raise DataError(
            f"no validation set can be held out with every class on both sides: {cause} Otherwise "
            "a validation or a test fraction of 0 trains without this split."
        ) from cause
    count = np.unique(validation.recording_id).size
    if error_rate is not None:
        learning.require_validation_recordings(count, error_rate)
    allowed, notes = learning.allowed_error_rate(count, aim), tuple[str, ...]()
    if allowed != aim or share != fraction:
        rate = f"; they allow an error rate of {allowed:g}" if allowed != aim else ""
        notes = (
            f"An error rate of {aim:g} needs {learning.min_validation_recordings(aim)} validation recordings, and a share "
            f"of {fraction:g} is about {round(fraction * n_left)}; {count} of {n_left} recordings are held out for "
            f"it{rate}.",
        )
    return training, learning.without_overlap(validation), allowed, notes


def refuse_seen(held_out: WindowSet, manifest: Manifest) -> None:
    if seen := find_copies(manifest, held_out.recordings):
        raise LeakError(
            f"{describe_copies(seen)} had a part in the synthetic windows and would be tested on; split first (swashtwin "
            "data split), then calibrate, synthesize and train on the training side with a test fraction of 0.",
            field="test_fraction",
        )


def copy_notes(windows: WindowSet) -> list[str]:
    copies = find_duplicates(windows.recordings)
    return [
        f"{name} holds the same samples as {first}; keep one of them, or it counts twice."
        for name, first in copies.items()
    ]
