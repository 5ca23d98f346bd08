"""Diagnosis of one recording by a fitted classifier, and healthy recordings to compare with."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Float64

from swashtwin.diagnosis.healthy_spectrum import classifier_spectrum
from swashtwin.diagnosis.reasons import (
    describe_absent_baseline,
    describe_basis,
    describe_deviations,
    describe_missing_comparison,
    describe_untrained_machine,
)
from swashtwin.diagnosis.recording_arguments import require_layout
from swashtwin.diagnosis.verdict import Diagnosis
from swashtwin.foundation import DataError, InputError, plural, spell_in_words
from swashtwin.learning import (
    Confidence,
    FittedClassifier,
    WindowSet,
    likeliest_class,
    pooled_probabilities,
    reference_features,
    require_verdicts,
    signal_statistics,
    window_batches,
    window_powers,
)
from swashtwin.pump import is_healthy
from swashtwin.recordings import (
    Recording,
    describe_sensor_doubts,
    find_exact_copies,
    specified_shaft_frequency,
    summarize_recordings,
)

# Windows in memory together; a multiple of what the network takes at once, so that no result
# depends on it.
_BATCH_WINDOWS = 1024

# Share of a machine's healthy recordings called faulty above which a note reports it.
_MAX_FALSE_SHARE = 0.25

# Keeps a product such as 0.1 * 30 from being rounded below the integer that it stands for.
_RATE_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class _WindowAnswers:
    """What a classifier computes from the windows of one recording."""

    probability: Float[np.ndarray, "window class"]
    features: Float64[np.ndarray, "window feature"]
    mean_statistics: Float64[np.ndarray, "channel statistic"]
    specimen: str
    """Machine; empty if it is not specified."""
    condition: Float64[np.ndarray, " quantity"]
    """Speed [rad/s] and discharge pressure [Pa]; NaN if not specified."""


def diagnose(
    classifier: FittedClassifier, recording: Recording, *, error_rate: float | None = None
) -> Diagnosis:
    """Return the class of a recording, labeled or not, from windows without overlap.

    A long recording that was loaded from its file is never in memory as a whole
    (`Recording.loaded`). A recording has no verdict (`Diagnosis.no_verdict` gives the reason) if it
    cannot be used (NaN, a dead channel, too short, a damaged file), or if the answer is not finite,
    as for a sample of 1e20.

    Parameters
    ----------
    error_rate : of the prediction set and of calling a recording unknown; the classifier's own by
        default.

    Raises
    ------
    DataError
        The recording has another sample rate, other channels or another unit.
    InputError
        The classifier's validation recordings are too few for the error rate, or its confidence
        was not calibrated.
    """
    require_layout(classifier.layout, recording)
    confidence = classifier.confidence_of(recording.specimen or "")
    if error_rate is not None and confidence is None:
        raise InputError(
            f"error_rate ({error_rate!r}) needs a classifier whose confidence was calibrated.",
            field="error_rate",
            remedy="Train it without {network}, or with {validation_fraction=0.2}.",
        )

    diagnosis = Diagnosis(
        recording.recording_id,
        facts=summarize_recordings([recording]),
        fault_of=classifier.fault_of,
    )
    try:
        # The windows and the hashes of the content are computed from one reading of the file.
        with recording.loaded():
            answers = _answer_windows(classifier, recording)
            notes = _recording_notes(classifier, recording)
            notes += describe_sensor_doubts(recording)
    except DataError as cause:
        return replace(diagnosis, no_verdict=cause.describe(spell_in_words))

    class_indices = likeliest_class(answers.probability)
    diagnosis = replace(
        diagnosis,
        window_labels=tuple(
            None if index < 0 else classifier.classes[index] for index in class_indices.tolist()
        ),
        notes=tuple(notes),
        reasons=describe_deviations(classifier, answers.condition, answers.mean_statistics),
    )

    has_verdict = class_indices >= 0
    if confidence is not None:
        has_verdict &= np.isfinite(answers.features).all(axis=1)
    if not has_verdict.all():
        reason = _describe_missing_verdict(classifier, recording, has_verdict)
        return _without_verdict(diagnosis, reason)
    return _judge_answers(classifier, confidence, diagnosis, answers, error_rate)


def _without_verdict(diagnosis: Diagnosis, reason: str) -> Diagnosis:
    """Return a diagnosis without verdict, whose reasons for an unknown recording become notes."""
    notes = (*diagnosis.notes, *diagnosis.reasons)
    return replace(diagnosis, no_verdict=reason, notes=notes, reasons=())


def _judge_answers(
    classifier: FittedClassifier,
    confidence: Confidence | None,
    diagnosis: Diagnosis,
    answers: _WindowAnswers,
    error_rate: float | None,
) -> Diagnosis:
    """Return the diagnosis with class, confidence, reasons and spectrum.

    `diagnosis` holds the reasons of the recording, and its notes without the reasons.
    """
    reference = classifier.training_reference
    mean_features = answers.features.mean(axis=0)
    pooled = pooled_probabilities(answers.probability, confidence)
    ood_score = 0.0
    if confidence is not None and reference is not None:
        ood_score = reference.ood_score(
            mean_features, specimen=answers.specimen, condition=answers.condition
        )
    if not (np.isfinite(pooled).all() and math.isfinite(ood_score)):
        reason = "the numbers behind the model's confidence are not finite; train it again."
        return _without_verdict(diagnosis, reason)

    if confidence is not None and reference is not None:
        diagnosis = _add_confidence(
            diagnosis, classifier.classes, confidence, answers.probability, ood_score, error_rate
        )
        basis = describe_basis(classifier, confidence, diagnosis.error_rate)
        diagnosis = replace(diagnosis, basis=basis)

    machine_reason = describe_untrained_machine(
        reference, answers.specimen, always=diagnosis.unknown
    )
    healthy_reason = describe_absent_baseline(classifier, answers.specimen)
    if answers.specimen:
        reasons = (machine_reason, *diagnosis.reasons, healthy_reason)
    else:
        reasons = (*diagnosis.reasons, machine_reason, healthy_reason)
    reasons = tuple(reason for reason in reasons if reason)

    return replace(
        diagnosis,
        label=classifier.classes[int(pooled.argmax())],
        probabilities=dict(zip(classifier.classes, pooled.tolist(), strict=True)),
        reasons=reasons,
        notes=(*diagnosis.notes, *reasons),
        choice=classifier.choice,
        spectrum=classifier_spectrum(
            reference, classifier.layout, mean_features, answers.specimen, answers.condition
        ),
    )


def _answer_windows(classifier: FittedClassifier, recording: Recording) -> _WindowAnswers:
    """Run the classifier over the windows of a recording, a batch at a time."""
    probability = []
    features = []
    statistics = []
    for windows in recording_windows(classifier, recording):
        # Features and statistics come from the same spectrum, which is computed once.
        powers = window_powers(windows)
        features.append(reference_features(windows, powers))
        statistics.append(signal_statistics(windows, powers))
        probability.append(classifier.predict_proba(windows))

    return _WindowAnswers(
        probability=np.concatenate(probability),
        features=np.concatenate(features),
        mean_statistics=np.concatenate(statistics).mean(axis=0),
        specimen=str(windows.specimen[0]),
        condition=windows.condition(0),
    )


def _describe_missing_verdict(
    classifier: FittedClassifier, recording: Recording, has_verdict: Bool[np.ndarray, " window"]
) -> str:
    """Describe which windows have no finite answer, and the largest sample of the first one."""
    length = classifier.layout.length
    first = int(has_verdict.argmin())
    first_window = recording.samples.signal_part(first * length, (first + 1) * length)
    peak = float(np.abs(first_window).max())
    start_s = first * length / recording.sample_rate

    if has_verdict.size == 1:
        subject = "its only window"
    else:
        subject = f"{np.count_nonzero(~has_verdict)} of {has_verdict.size} windows"
    return (
        f"the model's answer to {subject} is not a finite number, first at {start_s:.4g} s, where "
        f"samples reach {peak:.3g} {recording.unit}. If that is far too large, cut it out or "
        "repair the file; otherwise the model is damaged: train it again."
    )


def _add_confidence(
    diagnosis: Diagnosis,
    classes: tuple[str, ...],
    confidence: Confidence,
    probability: Float[np.ndarray, "window class"],
    ood_score: float,
    error_rate: float | None,
) -> Diagnosis:
    """Return the diagnosis with its prediction set, and whether it resembles the training."""
    rate = confidence.error_rate if error_rate is None else error_rate
    n_windows = len(probability)
    pooled = pooled_probabilities(probability)

    in_set = confidence.prediction_set(pooled, n_windows, rate)
    plausibility = confidence.plausibility(pooled, n_windows, rate)
    groups = confidence.class_groups(len(classes), rate)
    p_value = float(confidence.ood_p_value(np.array(ood_score)))

    # The largest score whose p-value is above the rate: the k-th highest of the n recordings.
    n = confidence.n_recordings
    k = max(1, math.floor(rate * (n + 1) + _RATE_TOLERANCE))
    return replace(
        diagnosis,
        unknown=p_value <= rate,
        error_rate=rate,
        prediction_set=tuple(classes[index] for index in np.argsort(-pooled) if in_set[index]),
        plausibility=dict(zip(classes, plausibility.tolist(), strict=True)),
        scarce_classes=tuple(
            name for name, group in zip(classes, groups, strict=True) if group < 0
        ),
        p_value=p_value,
        score=ood_score,
        threshold=float(confidence.ood_score[n - k]),
        n_basis=n,
    )


def recording_windows(classifier: FittedClassifier, recording: Recording) -> Iterator[WindowSet]:
    """Yield the windows of a recording in batches."""
    return window_batches(
        recording.replace(label=None),
        length=classifier.layout.length,
        classes=classifier.classes,
        allow_partial_revolution=True,
        batch=_BATCH_WINDOWS,
    )


def _recording_notes(classifier: FittedClassifier, recording: Recording) -> list[str]:
    """Return notes on a recording that had a part in the training, and on its speed."""
    notes = []
    copies = find_exact_copies(
        classifier.manifest, {recording.recording_id: recording.content_hashes()}
    )
    if copies:
        trained_id = copies[recording.recording_id]
        is_renamed = trained_id != recording.recording_id
        name = f", under the name {trained_id}" if is_renamed else ""
        notes.append(
            f"The classifier was trained with this very recording{name}; the answer proves nothing "
            "about new ones."
        )

    condition = recording.condition
    layout = classifier.layout
    duration = layout.length / layout.sample_rate
    if condition is not None and duration < condition.period * (1 - 1e-9):
        notes.append(
            "At this speed a window is shorter than one revolution and covers some pistons only."
        )

    if classifier.network.uses_speed and not specified_shaft_frequency(recording):
        turns_per_sample = float(classifier.network.settings["turns"])
        assumed_rpm = turns_per_sample * layout.sample_rate * 60
        notes.append(
            "The recording does not specify its speed, and the model counts orders of the shaft: "
            f"{assumed_rpm:.4g} rev/min was assumed, which is typical of the training."
        )
    return notes


def recording_probability(
    classifier: FittedClassifier, recording: Recording
) -> Float64[np.ndarray, " class"]:
    """Return the probability of each class, pooled over the windows.

    Raises
    ------
    DataError
        The recording does not fit the classifier or has no verdict.
    """
    require_layout(classifier.layout, recording)
    batches = recording_windows(classifier, recording)
    probability = np.concatenate([classifier.predict_proba(windows) for windows in batches])

    pooled = pooled_probabilities(probability, classifier.confidence)
    require_verdicts(pooled[None], np.array([recording.recording_id]))
    return pooled


def add_healthy_recordings(
    classifier: FittedClassifier, healthy: Sequence[Recording]
) -> tuple[FittedClassifier, tuple[str, ...]]:
    """Return a classifier that also compares with these healthy recordings, and notes.

    A note reports each machine whose healthy recordings it would call faulty without comparing.

    Raises
    ------
    InputError
        The model compares with no healthy recordings, or a recording does not specify its machine
        or is labeled faulty.
    DataError
        A machine has a single recording; or a recording has another sample rate, other channels or
        another unit, or cannot be used.
    """
    recording_model = classifier.recordings
    if recording_model is None or recording_model.on_changes is None:
        raise InputError(
            describe_missing_comparison(classifier),
            field="healthy",
            remedy="Train it again, or omit {healthy}.",
        )
    for recording in healthy:
        _require_healthy(classifier, recording)

    unlabeled = [recording.replace(label=None) for recording in healthy]
    extended_model = recording_model.with_healthy(classifier.cut_windows(unlabeled))
    without_comparison = replace(classifier, recordings=replace(recording_model, on_changes=None))

    notes = []
    machines = dict.fromkeys(str(recording.specimen) for recording in unlabeled)
    for machine in machines:
        recordings = [recording for recording in unlabeled if recording.specimen == machine]
        if not extended_model.knows(machine):
            raise DataError(
                f"{recordings[0].recording_id} is the only healthy recording of {machine}; at "
                "least two are needed to compare with."
            )

        n_faulty = 0
        for recording in recordings:
            probability = recording_probability(without_comparison, recording)
            n_faulty += not is_healthy(classifier.classes[int(probability.argmax())])
        if n_faulty > _MAX_FALSE_SHARE * len(recordings):
            notes.append(
                f"Without comparing, {n_faulty} of {plural(len(recordings), 'healthy recording')} "
                f"of {machine} would be called faulty: the machine differs from those of the "
                "training as a fault does."
            )
    return replace(classifier, recordings=extended_model), tuple(notes)


def _require_healthy(classifier: FittedClassifier, recording: Recording) -> None:
    """Raise an error if a recording cannot be compared with as a healthy one of its machine."""
    require_layout(classifier.layout, recording)
    if not recording.specimen:
        raise InputError(
            f"{recording.recording_id} does not specify its machine, so nothing can be compared "
            "with it.",
            field="healthy",
            remedy="Specify its machine (specimen), in the index or for the file.",
        )
    if recording.label is not None and not is_healthy(recording.label):
        raise InputError(
            f"{recording.recording_id} is labeled {recording.label} and is not healthy; leave it "
            "out.",
            field="healthy",
        )
