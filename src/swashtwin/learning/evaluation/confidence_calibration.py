"""`learn_confidence` and `cross_fitted_confidence` calibrate a classifier's confidence,
`score_confidence` tests it.
"""

import math
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Float64, Int64, Shaped

from swashtwin.foundation import DataError, InputError, LeakError
from swashtwin.learning.evaluation.scores import expected_calibration_error, refuse_seen
from swashtwin.learning.training.classifier import FittedClassifier
from swashtwin.learning.training.confidence import (
    Confidence,
    allowed_error_rate,
    fit_pooling,
    nonconformity_scores,
    pooled_probabilities,
    window_counts,
)
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.recordings import describe_copies, find_copies, join_manifests

_ERROR_RATE = 0.1
"""Error rate of a cross-fitted confidence that has recordings enough."""


@dataclass(frozen=True, eq=False)
class RecordingPredictions:
    """What a classifier says of whole recordings, before any temperature."""

    recording_id: tuple[str, ...]
    """The recordings, in the order of their ids."""
    target: Int64[np.ndarray, " recording"]
    """Index of the true class; -1 where there is no label."""
    probability: Float64[np.ndarray, "recording class"]
    """Probability of each class, from the mean log-probability of the windows."""
    n_windows: Int64[np.ndarray, " recording"]
    ood_score: Float64[np.ndarray, " recording"]
    """Out-of-distribution score of each; NaN where the classifier has no training reference."""

    def with_verdict(self) -> "RecordingPredictions":
        """The answers to recordings that have a verdict, since all numbers of it are finite."""
        finite = np.isfinite(self.probability).all(axis=1) & np.isfinite(self.ood_score)
        names = tuple(
            name for name, is_finite in zip(self.recording_id, finite, strict=True) if is_finite
        )
        values = (self.target, self.probability, self.n_windows, self.ood_score)
        return RecordingPredictions(names, *(value[finite] for value in values))


def predict_recordings(classifier: FittedClassifier, windows: WindowSet) -> RecordingPredictions:
    """The classifier's answer to each recording among `windows`."""
    return _pooled(classifier, windows, *classifier.answer(windows))


def _pooled(
    classifier: FittedClassifier,
    windows: WindowSet,
    probability: Float[np.ndarray, "window class"],
    features: Float[np.ndarray, "window feature"],
) -> RecordingPredictions:
    names = np.unique(windows.recording_id)
    masks = [windows.recording_id == name for name in names]
    reference = classifier.training_reference
    ood_score = [
        math.nan
        if reference is None
        else reference.ood_score(
            features[mask].mean(axis=0),
            specimen=str(windows.specimen[mask][0]),
            condition=windows.condition(int(mask.argmax())),
        )
        for mask in masks
    ]
    return RecordingPredictions(
        recording_id=tuple(names.tolist()),
        target=np.array([windows.target[mask][0] for mask in masks], dtype=np.int64),
        probability=np.stack([pooled_probabilities(probability[mask]) for mask in masks]).astype(
            np.float64
        ),
        n_windows=np.array([np.count_nonzero(mask) for mask in masks], dtype=np.int64),
        ood_score=np.array(ood_score, dtype=np.float64),
    )


def learn_confidence(
    classifier: FittedClassifier, validation: WindowSet, *, error_rate: float = 0.1
) -> FittedClassifier:
    """The same classifier with its confidence calibrated by validation recordings, which join its
    manifest.

    Parameters
    ----------
    validation : measured windows with labels, without overlap, of recordings it was not trained on.
        Draw them as the recordings to come will differ from the training: by specimen for pumps
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
    _require_fitting(classifier, validation)
    probability, features = classifier.answer(validation)
    answers = _pooled(classifier, validation, probability, features)
    if without := sorted({*answers.recording_id} - {*answers.with_verdict().recording_id}):
        raise DataError(
            f"{without[0]}: no verdict, since the classifier's numbers are not finite; leave it out."
        )
    confidence = _confidence(
        [probability[validation.recording_id == name] for name in answers.recording_id],
        answers.target,
        answers.ood_score,
        error_rate,
        cross_fitted=False,
    )
    manifest = join_manifests([classifier.manifest, validation.recordings])
    return replace(classifier, confidence=confidence, manifest=manifest)


def _require_fitting(classifier: FittedClassifier, validation: WindowSet) -> None:
    if classifier.training_reference is None:
        raise DataError(
            "the classifier was trained on synthetic windows alone, so it cannot tell what is unknown; train it with "
            "measured recordings."
        )
    if validation.classes != classifier.classes:
        raise InputError(
            f"the validation windows are cut for the classes {', '.join(validation.classes)}, the classifier knows "
            f"{', '.join(classifier.classes)}; cut them for those of the classifier."
        )
    if validation.synthetic.any():
        name = validation.recording_id[validation.synthetic][0]
        raise LeakError(
            f"{name} is synthetic; confidence is calibrated on measured recordings only."
        )
    listed, trained = (
        join_manifests([classifier.manifest]),
        classifier.training_reference.recording_id,
    )
    if seen := find_copies({name: listed.get(name, ()) for name in trained}, validation.recordings):
        raise LeakError(
            f"{describe_copies(seen)} was trained on; calibrate the confidence on others."
        )


def cross_fitted_confidence(
    probability: Float[np.ndarray, "window class"],
    recording_id: Shaped[np.ndarray, " window"],
    target: Int64[np.ndarray, " window"],
    ood_score: Float[np.ndarray, " recording"],
    *,
    error_rate: float | None = None,
) -> Confidence:
    """Confidence from out-of-fold answers to the recordings of the training itself, so that none
    need be held out.

    Each recording is answered by a model of the same kind that was trained without it (grouped
    folds); the final model's answers to new recordings are compared with these. Where the
    recordings are exchangeable with new ones and the model hardly changes when a fold is left out,
    a set misses the true class in about the share `error_rate` of the recordings, rather fewer,
    since the final model saw more. There is no bound for any model whatever: cross-conformal
    prediction (Vovk 2015, DOI 10.1007/s10472-013-9368-4) and CV+ (Barber, Candès, Ramdas and
    Tibshirani 2021, DOI 10.1214/20-AOS1965), with about twice the rate, ask the models of all folds
    about each new recording. `learn_confidence`, with recordings held out, has the exact bound.

    Folds by specimen give answers to pumps that were never measured, folds by recording to further
    recordings of the same pumps: the confidence holds for what the folds left out.

    Parameters
    ----------
    probability : out-of-fold probability of each class of each window, those of a recording in
        order of time.
    target : index of the true class of each window.
    ood_score : out-of-fold out-of-distribution score of each recording, in the order of
        ``np.unique(recording_id)``.
    error_rate : see `Confidence`. By default 0.1, or the least that so many recordings allow
        (`allowed_error_rate`).

    Raises
    ------
    InputError
        Arrays that do not fit together, or too few recordings for the error rate.
    DataError
        An answer is not finite.
    """
    names, first, index = np.unique(recording_id, return_index=True, return_inverse=True)
    if not len(probability) == len(recording_id) == len(target) > 0 or len(ood_score) != len(names):
        raise InputError(
            f"probability, recording_id and target have {len(probability)}, {len(recording_id)} and {len(target)} "
            f"windows of {len(names)} recordings, ood_score has {len(ood_score)}; one value is needed for each."
        )
    finite = np.isfinite(probability).all(axis=1) & np.isfinite(ood_score)[index]
    if not finite.all():
        raise DataError(
            f"{recording_id[~finite][0]}: its out-of-fold answer is not finite; leave it out."
        )
    rate = allowed_error_rate(len(names), _ERROR_RATE) if error_rate is None else error_rate
    parts = [probability[index == number] for number in range(len(names))]
    return _confidence(parts, target[first], np.asarray(ood_score), rate, cross_fitted=True)


def _confidence(
    probability: list[Float[np.ndarray, "window class"]],
    target: Int64[np.ndarray, " recording"],
    ood_score: Float[np.ndarray, " recording"],
    error_rate: float,
    *,
    cross_fitted: bool,
) -> Confidence:
    """Confidence from the windows of each recording, in order of time."""
    temperature, dependence = fit_pooling(probability, target)
    shortest = min(len(part) for part in probability)
    counts = window_counts(shortest)
    score = np.array(
        [
            [
                nonconformity_scores(
                    pooled_probabilities(part[: count if count < shortest else None])
                )[index]
                for part, index in zip(probability, target, strict=True)
            ]
            for count in counts
        ]
    )
    return Confidence(
        temperature=temperature,
        dependence=dependence,
        listening_windows=counts,
        nonconformity_score=score,
        target=np.asarray(target, dtype=np.int64),
        ood_score=np.sort(ood_score).astype(np.float64),
        error_rate=error_rate,
        cross_fitted=cross_fitted,
    )


@dataclass(frozen=True)
class ConfidenceScores:
    """How well a classifier's confidence holds on test recordings; every figure counts
    recordings.
    """

    n_recordings: int
    accuracy: float
    """Share told right."""
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
    """Share of the prediction sets that hold the true class; 1 - error rate was asked for."""
    set_size: float
    """Mean number of classes in a prediction set."""
    called_unknown: float
    """Share called unknown although their class was trained."""

    def to_dict(self) -> dict[str, Any]:
        """Numbers that JSON can hold."""
        return asdict(self)


def score_confidence(classifier: FittedClassifier, test: WindowSet) -> ConfidenceScores:
    """How well the classifier's confidence holds on recordings that had no part in it.

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
            "the classifier has no confidence yet; calibrate it on recordings held out for it."
        )
    if test.classes != classifier.classes:
        raise InputError(
            "the test windows have other classes; cut them for those of the classifier."
        )
    test.require_labels("a test of confidence")
    refuse_seen(classifier, test.recordings)
    answers = predict_recordings(classifier, test).with_verdict()
    if not answers.recording_id:
        raise DataError(
            "no test recording has a verdict; is the model damaged, or every recording?"
        )
    rows, scaled = (
        np.arange(answers.target.size),
        confidence.temperature_scaled(answers.probability, answers.n_windows),
    )
    right = answers.probability.argmax(axis=1) == answers.target
    in_set = confidence.prediction_set(answers.probability, answers.n_windows)
    covered = in_set[rows, answers.target]
    return ConfidenceScores(
        n_recordings=rows.size,
        accuracy=float(right.mean()),
        ece_before=expected_calibration_error(right, answers.probability.max(axis=1), 10),
        ece_after=expected_calibration_error(right, scaled.max(axis=1), 10),
        log_loss_before=float(
            nonconformity_scores(answers.probability)[rows, answers.target].mean()
        ),
        log_loss_after=float(nonconformity_scores(scaled)[rows, answers.target].mean()),
        coverage=float(covered.mean()),
        set_size=float(in_set.sum(axis=1).mean()),
        called_unknown=float(
            np.mean(confidence.ood_p_value(answers.ood_score) <= confidence.error_rate)
        ),
    )
