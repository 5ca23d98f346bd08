"""Calibration of a classifier's confidence on recordings it was not trained on, and its test."""

import math
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Float64, Int64, Shaped

from swashtwin.foundation import DataError, InputError, LeakError
from swashtwin.learning.evaluation.scores import expected_calibration_error, refuse_seen
from swashtwin.learning.training.classifier import FittedClassifier
from swashtwin.learning.training.confidence import (
    DEFAULT_ERROR_RATE,
    Confidence,
    allowed_error_rate,
    fit_pooling,
    nonconformity_scores,
    pooled_probabilities,
    window_counts,
)
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.recordings import describe_copies, find_copies, join_manifests

# Bins of the expected calibration error over recordings, which are fewer than windows.
_N_CALIBRATION_BINS = 10


@dataclass(frozen=True, eq=False)
class RecordingPredictions:
    """Answers of a classifier to whole recordings, before any temperature."""

    recording_id: tuple[str, ...]
    """The recordings, in the order of their ids."""
    target: Int64[np.ndarray, " recording"]
    """Index of the true class; -1 without a label."""
    probability: Float64[np.ndarray, "recording class"]
    """Probability of each class, from the mean log-probability of the windows."""
    n_windows: Int64[np.ndarray, " recording"]
    ood_score: Float64[np.ndarray, " recording"]
    """Out-of-distribution score of each; NaN if the classifier has no training reference."""

    def with_verdict(self) -> "RecordingPredictions":
        """Return the answers whose numbers are all finite, so that there is a verdict."""
        is_finite = np.isfinite(self.probability).all(axis=1) & np.isfinite(self.ood_score)
        names = np.array(self.recording_id, dtype=np.str_)[is_finite]
        return RecordingPredictions(
            recording_id=tuple(names.tolist()),
            target=self.target[is_finite],
            probability=self.probability[is_finite],
            n_windows=self.n_windows[is_finite],
            ood_score=self.ood_score[is_finite],
        )


def predict_recordings(classifier: FittedClassifier, windows: WindowSet) -> RecordingPredictions:
    """Return the classifier's answer to each recording among `windows`."""
    probability, features = classifier.answer(windows)
    return _pool(classifier, windows, probability, features)


def _pool(
    classifier: FittedClassifier,
    windows: WindowSet,
    probability: Float[np.ndarray, "window class"],
    features: Float[np.ndarray, "window feature"],
) -> RecordingPredictions:
    """Pool the answers to windows into answers to recordings."""
    names = np.unique(windows.recording_id)
    reference = classifier.training_reference
    targets = []
    pooled = []
    counts = []
    ood_scores = []
    for name in names:
        rows = np.flatnonzero(windows.recording_id == name)
        targets.append(windows.target[rows[0]])
        pooled.append(pooled_probabilities(probability[rows]))
        counts.append(rows.size)
        ood_score = math.nan
        if reference is not None:
            ood_score = reference.ood_score(
                features[rows].mean(axis=0),
                specimen=str(windows.specimen[rows[0]]),
                condition=windows.condition(int(rows[0])),
            )
        ood_scores.append(ood_score)

    return RecordingPredictions(
        recording_id=tuple(names.tolist()),
        target=np.array(targets, dtype=np.int64),
        probability=np.stack(pooled).astype(np.float64),
        n_windows=np.array(counts, dtype=np.int64),
        ood_score=np.array(ood_scores, dtype=np.float64),
    )


def learn_confidence(
    classifier: FittedClassifier, validation: WindowSet, *, error_rate: float = DEFAULT_ERROR_RATE
) -> FittedClassifier:
    """Return the classifier with its confidence calibrated by validation recordings.

    These join its manifest.

    Parameters
    ----------
    validation : measured windows with labels, without overlap, of recordings it was not trained on.
        They should differ from the training as the recordings to come will: by specimen for pumps
        that were never measured.
    error_rate : see `Confidence`.

    Raises
    ------
    LeakError
        A validation window is synthetic, or the classifier was trained on its recording.
    InputError
        Other classes than the classifier's, or too few recordings for the error rate.
    DataError
        The classifier was trained on no measured recording, or a window has no label.
    """
    validation.require_labels("validation")
    _require_valid(classifier, validation)
    probability, features = classifier.answer(validation)
    predictions = _pool(classifier, validation, probability, features)
    without_verdict = {*predictions.recording_id} - {*predictions.with_verdict().recording_id}
    if without_verdict:
        raise DataError(
            f"{min(without_verdict)}: no verdict, because the classifier's numbers are not finite. "
            "Leave the recording out."
        )

    confidence = _build_confidence(
        [probability[validation.recording_id == name] for name in predictions.recording_id],
        predictions.target,
        predictions.ood_score,
        error_rate,
        cross_fitted=False,
    )
    manifest = join_manifests([classifier.manifest, validation.recordings])
    return replace(classifier, confidence=confidence, manifest=manifest)


def _require_valid(classifier: FittedClassifier, validation: WindowSet) -> None:
    reference = classifier.training_reference
    if reference is None:
        raise DataError(
            "The classifier was trained on synthetic windows only, so it cannot recognize unknown "
            "recordings. Train it with measured recordings."
        )
    if validation.classes != classifier.classes:
        raise InputError(
            f"The validation windows have the classes {', '.join(validation.classes)}, the "
            f"classifier has {', '.join(classifier.classes)}. Cut them for the classes of the "
            "classifier."
        )
    if validation.synthetic.any():
        name = validation.recording_id[validation.synthetic][0]
        raise LeakError(
            f"{name} is synthetic; confidence is calibrated on measured recordings only."
        )

    # Recordings in the manifest that were not trained on, such as those of a calibrated twin, may
    # validate.
    manifest = join_manifests([classifier.manifest])
    trained = {name: manifest.get(name, ()) for name in reference.recording_id}
    copies = find_copies(trained, validation.recordings)
    if copies:
        raise LeakError(
            f"{describe_copies(copies)} was trained on. Calibrate the confidence on others."
        )


def cross_fitted_confidence(
    probability: Float[np.ndarray, "window class"],
    recording_id: Shaped[np.ndarray, " window"],
    target: Int64[np.ndarray, " window"],
    ood_score: Float[np.ndarray, " recording"],
    *,
    error_rate: float | None = None,
    n_machines: int = 0,
) -> Confidence:
    """Return a confidence from out-of-fold answers to the recordings of the training itself.

    So no recording needs to be held out. Each recording is answered by a model of the same kind
    that was trained without it (grouped folds); the final model's answers to new recordings are
    compared with these. If the recordings are exchangeable with new ones and the model hardly
    changes when a fold is left out, a set misses the true class in about the share `error_rate` of
    the recordings, rather fewer, since the final model saw more. There is no bound for every model:
    cross-conformal prediction (Vovk 2015, DOI 10.1007/s10472-013-9368-4) and CV+ (Barber, Candès,
    Ramdas and Tibshirani 2021, DOI 10.1214/20-AOS1965), with about twice the rate, ask the models
    of all folds about each new recording. `learn_confidence`, with recordings held out, has the
    exact bound.

    Folds by specimen give answers to pumps that were never measured, folds by recording to further
    recordings of the same pumps: the confidence holds for what the folds left out.

    Parameters
    ----------
    probability : out-of-fold probability of each class of each window, those of a recording in
        order of time.
    target : index of the true class of each window.
    ood_score : out-of-fold out-of-distribution score of each recording, in the order of
        ``np.unique(recording_id)``.
    error_rate : see `Confidence`. By default 0.1, or the lowest rate that the recordings allow
        (`allowed_error_rate`).
    n_machines : number of machines that the folds left out, all of whose recordings are given; 0 if
        folds did not leave machines out.

    Raises
    ------
    InputError
        Arrays of different lengths, or too few recordings for the error rate.
    DataError
        An answer is not finite.
    """
    names, first, index = np.unique(recording_id, return_index=True, return_inverse=True)
    n_windows = len(probability)
    has_equal_lengths = n_windows == len(recording_id) == len(target) > 0
    if not has_equal_lengths or len(ood_score) != len(names):
        raise InputError(
            f"probability, recording_id and target have {n_windows}, {len(recording_id)} and "
            f"{len(target)} windows of {len(names)} recordings, ood_score has {len(ood_score)}; "
            "one value is needed for each."
        )
    is_finite = np.isfinite(probability).all(axis=1) & np.isfinite(ood_score)[index]
    if not is_finite.all():
        raise DataError(
            f"{recording_id[~is_finite][0]}: its out-of-fold answer is not finite. Leave the "
            "recording out."
        )

    if error_rate is None:
        error_rate = allowed_error_rate(len(names), DEFAULT_ERROR_RATE)
    by_recording = [probability[index == number] for number in range(len(names))]
    confidence = _build_confidence(
        by_recording, target[first], np.asarray(ood_score), error_rate, cross_fitted=True
    )
    return replace(confidence, n_machines=n_machines)


def _build_confidence(
    probability: list[Float[np.ndarray, "window class"]],
    target: Int64[np.ndarray, " recording"],
    ood_score: Float[np.ndarray, " recording"],
    error_rate: float,
    *,
    cross_fitted: bool,
) -> Confidence:
    """Build a confidence from the windows of each recording, in order of time."""
    temperature, dependence = fit_pooling(probability, target)
    shortest = min(len(part) for part in probability)
    counts = window_counts(shortest)
    scores = np.empty((len(counts), len(probability)))
    for row, count in enumerate(counts):
        # The last row pools whole recordings, also the longer ones.
        length = count if count < shortest else None
        for column, (part, label) in enumerate(zip(probability, target, strict=True)):
            pooled = pooled_probabilities(part[:length])
            scores[row, column] = nonconformity_scores(pooled)[label]

    return Confidence(
        temperature=temperature,
        dependence=dependence,
        listening_windows=counts,
        nonconformity_score=scores,
        target=np.asarray(target, dtype=np.int64),
        ood_score=np.sort(ood_score).astype(np.float64),
        error_rate=error_rate,
        cross_fitted=cross_fitted,
    )


@dataclass(frozen=True)
class ConfidenceScores:
    """How well a classifier's confidence holds on test recordings, counted by recording."""

    n_recordings: int
    accuracy: float
    """Share of recordings classified right."""
    ece_before: float
    """Expected calibration error (10 bins) of the probabilities from the mean log-probability of
    the windows.
    """
    ece_after: float
    """The same at the temperature and dependence."""
    log_loss_before: float
    """Mean -log p of the true class [nat] from the mean log-probability of the windows."""
    log_loss_after: float
    """The same at the temperature and dependence [nat]."""
    coverage: float
    """Share of the prediction sets that hold the true class; the target is 1 - error rate."""
    set_size: float
    """Mean number of classes in a prediction set."""
    called_unknown: float
    """Share called unknown although their class was trained."""
    unknown: tuple[str, ...]
    """Ids of these recordings."""

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers as JSON can hold them."""
        return asdict(self)


def score_confidence(classifier: FittedClassifier, test: WindowSet) -> ConfidenceScores:
    """Test the classifier's confidence on recordings that had no part in it.

    Recordings without a verdict are left out; `evaluate` counts them as errors.

    Raises
    ------
    InputError
        The classifier has no confidence, or the windows are of other classes.
    LeakError
        A recording had a part in the classifier.
    """
    confidence = classifier.confidence
    if confidence is None:
        raise InputError(
            "The classifier has no confidence yet. Calibrate it on recordings held out for it."
        )
    if test.classes != classifier.classes:
        raise InputError(
            "The test windows have other classes. Cut them for the classes of the classifier."
        )
    test.require_labels("a test of confidence")
    refuse_seen(classifier, test.recordings)
    predictions = predict_recordings(classifier, test).with_verdict()
    if not predictions.recording_id:
        raise DataError(
            "No test recording has a verdict. Is the model damaged, or every recording?"
        )

    target = predictions.target
    rows = np.arange(target.size)
    probability = predictions.probability
    scaled = confidence.temperature_scaled(probability, predictions.n_windows)
    is_right = probability.argmax(axis=1) == target
    in_set = confidence.prediction_set(probability, predictions.n_windows)
    is_unknown = confidence.ood_p_value(predictions.ood_score) <= confidence.error_rate
    return ConfidenceScores(
        n_recordings=rows.size,
        accuracy=float(is_right.mean()),
        ece_before=_calibration_error(is_right, probability),
        ece_after=_calibration_error(is_right, scaled),
        log_loss_before=float(nonconformity_scores(probability)[rows, target].mean()),
        log_loss_after=float(nonconformity_scores(scaled)[rows, target].mean()),
        coverage=float(in_set[rows, target].mean()),
        set_size=float(in_set.sum(axis=1).mean()),
        called_unknown=float(np.mean(is_unknown)),
        unknown=tuple(np.array(predictions.recording_id)[is_unknown].tolist()),
    )


def _calibration_error(is_right: np.ndarray, probability: np.ndarray) -> float:
    return expected_calibration_error(is_right, probability.max(axis=1), _N_CALIBRATION_BINS)
