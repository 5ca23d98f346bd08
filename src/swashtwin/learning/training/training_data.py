"""Windows that a classifier is trained on, and those held out of its training."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

from swashtwin.foundation import DataError, LeakError
from swashtwin.learning.training.confidence import (
    DEFAULT_ERROR_RATE,
    allowed_error_rate,
    min_validation_recordings,
    require_validation_recordings,
    validation_share,
)
from swashtwin.learning.windows.splitting import (
    check_disjoint,
    split_by_recording,
    without_overlap,
)
from swashtwin.learning.windows.window_set import WindowSet, require_shared_speed
from swashtwin.recordings import (
    Manifest,
    Recording,
    describe_copies,
    describe_duplicates,
    find_copies,
    find_duplicates,
    join_manifests,
)


@runtime_checkable
class TrainingFiller(Protocol):
    """Maker of synthetic windows for a training set (`synthesis.Filling`).

    It is called after the test and validation recordings were held out, and knows none of them.
    """

    @property
    def manifest(self) -> Manifest:
        """Recordings that it was made from, which stay in training."""
        ...

    def check(self, recordings: Sequence[Recording]) -> tuple[str, ...]:
        """Require that it suits these recordings; return what cannot be checked, as sentences."""
        ...

    def fill_training(self, training: WindowSet) -> tuple[WindowSet, tuple[str, ...]]:
        """Return synthetic windows that join these training windows, and notes on them."""
        ...


@dataclass(frozen=True, eq=False)
class TrainingData:
    """Windows to train a classifier on, and measured windows that are held out.

    No recording stands in two of the three sets, and no synthetic window was made from a recording
    of the test set (`prepare_training_data`).
    """

    training: WindowSet
    """Measured and synthetic windows to train on, with the classes of both."""
    test: WindowSet
    """Measured windows held out to test the classifier; empty if no test set was requested."""
    validation: WindowSet | None
    """Measured windows, without overlap, held out to calibrate the confidence; None if no
    validation set was requested.
    """
    error_rate: float
    """Error rate that the validation recordings allow; the requested one if there are none."""
    notes: tuple[str, ...] = ()
    """Duplicate recordings, and deviations from what was requested, as sentences."""

    @property
    def test_recordings(self) -> tuple[str, ...]:
        """Ids of the recordings of the test set, sorted."""
        return tuple(np.unique(self.test.recording_id).tolist())

    @property
    def validation_recordings(self) -> tuple[str, ...]:
        """Ids of the recordings of the validation set, sorted."""
        if self.validation is None:
            return ()
        return tuple(np.unique(self.validation.recording_id).tolist())


def prepare_training_data(
    measured: WindowSet,
    synthetic: Sequence[WindowSet] = (),
    *,
    filler: TrainingFiller | None = None,
    test_fraction: float = 0.0,
    validation_fraction: float = 0.0,
    group: str | Mapping[str, str] = "recording",
    error_rate: float | None = None,
    seed: int = 0,
) -> TrainingData:
    """Hold out test and validation recordings, and add synthetic windows to the others.

    Parameters
    ----------
    measured : measured windows with labels.
    synthetic : sets of synthetic windows, which join the training set.
    filler : maker of further synthetic windows, from the training set alone. The recordings that it
        was made from are not held out.
    test_fraction : share of the windows whose recordings are held out as test set; 0 for none.
    validation_fraction : share of the remaining recordings that is held out as validation set; 0
        for none. More are taken if the error rate needs more.
    group : what a split keeps whole, see `split_by_recording`.
    error_rate : target miscoverage of the prediction sets. By default 0.1, or the lowest rate that
        the validation recordings allow.
    seed : seed of both splits.

    Raises
    ------
    DataError
        A split cannot keep every class on both sides.
    InputError
        Too few validation recordings for the error rate, or synthetic windows at a speed that was
        not measured.
    LeakError
        Synthetic windows were made from a recording of the test set.
    """
    synthetic_manifest = join_manifests([windows.manifest for windows in synthetic])
    filler_manifest = {} if filler is None else filler.manifest
    training = measured
    test = measured.subset(np.zeros(len(measured), dtype=np.bool_))
    if test_fraction:
        training, test = split_by_recording(
            measured,
            test_fraction=test_fraction,
            seed=seed,
            group=group,
            keep_in_training=filler_manifest,
        )

    requested_rate = DEFAULT_ERROR_RATE if error_rate is None else error_rate
    data = TrainingData(training, test, None, requested_rate)
    if validation_fraction:
        data = _hold_out_validation(
            data,
            validation_fraction,
            group=group,
            synthetic_manifest=join_manifests([synthetic_manifest, filler_manifest]),
            is_rate_required=error_rate is not None,
            seed=seed,
        )

    # Checked before synthetic windows are added: one made from a test recording would leak it.
    _require_untouched(test, synthetic_manifest)
    filler_notes: tuple[str, ...] = ()
    if filler is not None:
        windows, filler_notes = filler.fill_training(data.training)
        synthetic = [*synthetic, windows]
    training = _add_synthetic(data.training, synthetic)
    check_disjoint(training, test)

    validation = data.validation
    if validation is not None:
        validation = validation.with_classes(training.classes)
    duplicates = find_duplicates(measured.recordings)
    advice = "keep one of them, or it counts twice."
    notes = (*data.notes, *filler_notes, *describe_duplicates(duplicates, advice))
    return replace(data, training=training, validation=validation, notes=notes)


def _hold_out_validation(
    data: TrainingData,
    fraction: float,
    *,
    group: str | Mapping[str, str],
    synthetic_manifest: Manifest,
    is_rate_required: bool,
    seed: int,
) -> TrainingData:
    """Return the data with a validation set taken from the training set.

    Recordings that synthetic windows were made from stay in training.
    """
    recordings = data.training.recordings
    n_free = len(recordings.keys() - find_copies(synthetic_manifest, recordings).keys())
    share, _ = validation_share(n_free, data.error_rate, fraction)
    try:
        training, validation = split_by_recording(
            data.training,
            test_fraction=share,
            seed=seed,
            group=group,
            keep_in_training=synthetic_manifest,
        )
    except DataError as cause:
        raise DataError(
            f"No validation set can be held out with every class on both sides: {cause.message}",
            field="validation_fraction",
            remedy="To train without this split, set {validation_fraction=0} or {test_fraction=0}.",
        ) from cause

    n_validation = np.unique(validation.recording_id).size
    if is_rate_required:
        require_validation_recordings(n_validation, data.error_rate)

    allowed_rate = allowed_error_rate(n_validation, data.error_rate)
    notes: tuple[str, ...] = ()
    if allowed_rate != data.error_rate or share != fraction:
        needed = min_validation_recordings(data.error_rate)
        note = (
            f"An error rate of {data.error_rate:g} needs {needed} validation recordings, and a "
            f"share of {fraction:g} is about {round(fraction * n_free)}; {n_validation} of "
            f"{n_free} recordings are held out for it"
        )
        if allowed_rate != data.error_rate:
            note += f"; they allow an error rate of {allowed_rate:g}"
        notes = (f"{note}.",)

    return TrainingData(training, data.test, without_overlap(validation), allowed_rate, notes)


def _require_untouched(test: WindowSet, synthetic_manifest: Manifest) -> None:
    """Raise a `LeakError` if synthetic windows were made from a recording of the test set."""
    copies = find_copies(synthetic_manifest, test.recordings)
    if copies:
        raise LeakError(
            f"{describe_copies(copies)} had a part in the synthetic windows and would be tested "
            "on. Split the recordings first, then calibrate, synthesize and train on the training "
            "side.",
            field="test_fraction",
            remedy="There, set {test_fraction=0}.",
        )


def _add_synthetic(measured: WindowSet, synthetic: Sequence[WindowSet]) -> WindowSet:
    """Return measured and synthetic windows together, with the classes of both."""
    synthetic_classes = {name for windows in synthetic for name in windows.classes}
    classes = (*measured.classes, *sorted(synthetic_classes - set(measured.classes)))

    combined = measured.with_classes(classes)
    for windows in synthetic:
        require_shared_speed(measured, windows)
        combined = combined + windows.with_classes(classes)
    return combined
