"""What a fitted classifier says of one recording, and healthy recordings of machines made known to
it.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from swashtwin.diagnosis.healthy_spectrum import classifier_spectrum
from swashtwin.diagnosis.reasons import another_machine, own_healthy_would_help, reasons_of
from swashtwin.diagnosis.recording_arguments import require_layout, require_recording
from swashtwin.diagnosis.verdict import Diagnosis
from swashtwin.foundation import DataError, InputError, plural
from swashtwin.learning import (
    Confidence,
    FittedClassifier,
    WindowSet,
    likeliest_class,
    pooled_probabilities,
    reference_features,
    require_verdicts,
    signal_facts,
    window_batches,
    window_powers,
)
from swashtwin.pump import is_healthy
from swashtwin.recordings import (
    Recording,
    find_exact_copies,
    specified_shaft_frequency,
    summarize_recordings,
)

_TOGETHER = 1024
"""Windows in memory together; a multiple of what the network takes at once, so that no result
depends on it.
"""


def diagnose(
    classifier: FittedClassifier, recording: Recording, *, error_rate: float | None = None
) -> Diagnosis:
    """The class of a recording, labeled or not, from windows cut as in training and without
    overlap.

    A recording that was loaded from its file is never whole in memory. One that cannot be used
    (NaN, a dead channel, too short, a damaged file) or whose answer is no finite number, such as
    one with a sample of 1e20, has no verdict: `Diagnosis.no_verdict` says why.

    Parameters
    ----------
    error_rate : of the prediction set and of calling a recording unknown; the classifier's own by
        default.

    Raises
    ------
    DataError
        The recording has another sample rate, other channels or another unit.
    InputError
        An error rate that the classifier's validation recordings are too few for, or that it knows
        none of.
    """
    require_recording(recording)
    recording, reference = (
        recording.unloaded(),
        classifier.training_reference,
    )  # what is read here is not kept
    confidence = classifier.confidence_of(recording.specimen or "")
    if error_rate is not None and confidence is None:
        raise InputError(
            f"error_rate ({error_rate!r}) needs a classifier whose confidence was calibrated; train it without "
            "--network, or with --validation-fraction 0.2."
        )
    require_layout(classifier.layout, recording)
    result = Diagnosis(
        recording.recording_id,
        facts=summarize_recordings([recording]),
        fault_of=classifier.fault_of,
    )
    answers = []
    try:
        for windows in recording_windows(classifier, recording):
            powers = window_powers(windows)
            band_powers, facts = reference_features(windows, powers), signal_facts(windows, powers)
            answers.append((classifier.predict_proba(windows), band_powers, facts))
        notes = _notes(classifier, recording)
    except DataError as cause:
        return replace(result, no_verdict=str(cause))
    probability, features, facts = (np.concatenate(part) for part in zip(*answers, strict=True))
    condition, specimen, mean = (
        windows.condition(0),
        str(windows.specimen[0]),
        features.mean(axis=0),
    )
    reasons = reasons_of(classifier, condition, facts.mean(axis=0))
    likeliest = likeliest_class(probability)
    result = replace(
        result,
        window_labels=tuple(
            None if index < 0 else classifier.classes[index] for index in likeliest.tolist()
        ),
        notes=(*notes, *reasons),
    )
    has_verdict = (likeliest >= 0) & (
        np.isfinite(features).all(axis=1) if confidence is not None else True
    )
    if not has_verdict.all():
        length = classifier.layout.length
        first, count = int(has_verdict.argmin()), int(np.count_nonzero(~has_verdict))
        peak = float(np.abs(recording.slice(first * length, (first + 1) * length).signal).max())
        which = (
            "its only window" if has_verdict.size == 1 else f"{count} of {has_verdict.size} windows"
        )
        reason = (
            f"the model's answer to {which} is no finite number, first at {first * length / recording.sample_rate:.4g} "
            f"s, where samples reach {peak:.3g} {recording.unit}; if that is far too large, cut it out or repair the "
            "file, else the model is damaged: train it again."
        )
        return replace(result, no_verdict=reason)
    pooled = pooled_probabilities(probability, confidence)
    score = 0.0
    if confidence is not None and reference is not None:
        score = reference.ood_score(mean, specimen=specimen, condition=condition)
    if not (np.isfinite(pooled).all() and math.isfinite(score)):
        reason = "the numbers that the model's confidence rests on are not finite; train it again."
        return replace(result, no_verdict=reason)
    if confidence is not None and reference is not None:
        result = _with_trust(result, classifier.classes, confidence, probability, score, error_rate)
    if machine := another_machine(reference, specimen, always=result.unknown):
        reasons = (machine, *reasons) if specimen else (*reasons, machine)
    if own := own_healthy_would_help(classifier, specimen):
        reasons = (*reasons, own)
    return replace(
        result,
        label=classifier.classes[int(pooled.argmax())],
        probabilities=dict(zip(classifier.classes, pooled.tolist(), strict=True)),
        reasons=reasons,
        notes=(*notes, *reasons),
        choice=classifier.choice,
        spectrum=classifier_spectrum(reference, classifier.layout, mean, specimen, condition),
    )


def _with_trust(
    result: Diagnosis,
    classes: tuple[str, ...],
    confidence: Confidence,
    probability: Float[np.ndarray, "window class"],
    score: float,
    error_rate: float | None,
) -> Diagnosis:
    """The diagnosis with the classes that cannot be ruled out, and whether the recording resembles
    the training.
    """
    rate, n = confidence.error_rate if error_rate is None else error_rate, confidence.n_recordings
    pooled = pooled_probabilities(probability)
    in_set = confidence.prediction_set(pooled, len(probability), rate)
    plausible = confidence.plausibility(pooled, len(probability), rate)
    group = confidence.class_groups(len(classes), rate)
    p_value = float(confidence.ood_p_value(np.array(score)))
    return replace(
        result,
        unknown=p_value <= rate,
        error_rate=rate,
        prediction_set=tuple(classes[index] for index in np.argsort(-pooled) if in_set[index]),
        plausibility=dict(zip(classes, plausible.tolist(), strict=True)),
        scarce_classes=tuple(name for name, index in zip(classes, group, strict=True) if index < 0),
        p_value=p_value,
        score=score,
        # the greatest score whose p-value is above the rate: the k-th highest of the validation
        # recordings
        threshold=float(confidence.ood_score[n - max(1, math.floor(rate * (n + 1) + 1e-9))]),
        basis=confidence.basis,
        n_basis=n,
    )


def recording_windows(classifier: FittedClassifier, recording: Recording) -> Iterator[WindowSet]:
    """The recording's windows, in parts."""
    return window_batches(
        recording.replace(label=None),
        length=classifier.layout.length,
        classes=classifier.classes,
        allow_partial_revolution=True,
        batch=_TOGETHER,
    )


def _notes(classifier: FittedClassifier, recording: Recording) -> list[str]:
    notes = []
    if seen := find_exact_copies(
        classifier.manifest, {recording.recording_id: recording.content_hashes()}
    ):
        listed = seen[recording.recording_id]
        under = "" if listed == recording.recording_id else f", under the name {listed}"
        notes.append(
            f"The classifier was made with this very recording{under}; the answer proves nothing about new ones."
        )
    condition = recording.condition
    layout = classifier.layout
    if condition is not None and layout.length / layout.sample_rate < condition.period * (1 - 1e-9):
        notes.append(
            "At this speed a window is shorter than one revolution and sees some pistons only."
        )
    if classifier.network.uses_speed and not specified_shaft_frequency(recording):
        usual = float(classifier.network.settings["turns"]) * layout.sample_rate * 60
        notes.append(
            f"It does not state its speed, and the model counts orders of the shaft: {usual:.4g} rev/min was assumed, "
            "as is usual in the training."
        )
    return notes


def recording_probability(fitted: FittedClassifier, recording: Recording) -> np.ndarray:
    """Probability of each class, pooled over the windows; a `DataError` where the recording has no
    verdict.
    """
    require_layout(fitted.layout, recording)
    probability = np.concatenate(
        [fitted.predict_proba(windows) for windows in recording_windows(fitted, recording)]
    )
    pooled = pooled_probabilities(probability, fitted.confidence)
    require_verdicts(pooled[None], np.array([recording.recording_id]))
    return pooled


_SEVERAL = 0.25
"""Share of a machine's healthy recordings called faulty from which a note says so."""


def make_known(
    classifier: FittedClassifier, healthy: Sequence[Recording]
) -> tuple[FittedClassifier, tuple[str, ...]]:
    """(the classifier that compares with these healthy recordings too, notes on machines that it
    takes for faulty).

    Raises
    ------
    InputError
        The model compares with no healthy recordings, or one states no machine or is labeled
        faulty.
    DataError
        A machine has a single one; or they have another sample rate, other channels or another
        unit, or are unfit.
    """
    if classifier.recordings is None or classifier.recordings.on_changes is None:
        raise InputError(
            "the model compares with no healthy recordings: its network was named, its recordings were short, or a "
            "machine of its training has not two healthy ones; train it again, or leave the healthy recordings out.",
            field="healthy",
        )
    for recording in healthy:
        require_layout(classifier.layout, recording)
        if not recording.specimen:
            raise InputError(
                f"{recording.recording_id} states no machine, so nothing can be compared with it; state it (specimen) "
                "in the index.",
                field="healthy",
            )
        if recording.label is not None and not is_healthy(recording.label):
            raise InputError(
                f"{recording.recording_id} is labeled {recording.label} and is no healthy recording; leave it out.",
                field="healthy",
            )
    sound = [recording.replace(label=None) for recording in healthy]
    informed = classifier.with_healthy(classifier.cut_windows(sound))
    notes = []
    for name in dict.fromkeys(str(recording.specimen) for recording in sound):
        of_machine = [recording for recording in sound if recording.specimen == name]
        if informed.recordings is None or not informed.recordings.knows(name):
            raise DataError(
                f"{of_machine[0].recording_id} is the only healthy recording of {name}; two are needed at least to "
                "compare with."
            )
        alone = replace(classifier, recordings=replace(classifier.recordings, on_changes=None))
        labels = [
            classifier.classes[int(np.argmax(recording_probability(alone, recording)))]
            for recording in of_machine
        ]
        faulty = sum(not is_healthy(label) for label in labels)
        if faulty > _SEVERAL * len(labels):
            notes.append(
                f"{faulty} of {plural(len(labels), 'recording')} of {name} that are healthy would be called faulty "
                "without comparing: the machine differs from the training's as a fault does."
            )
    return informed, tuple(notes)
