"""What a fitted classifier says of one recording."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar

import numpy as np

from swashtwin.diagnosis.healthy_spectrum import HealthySpectrum, classifier_spectrum
from swashtwin.diagnosis.layout import require_layout
from swashtwin.diagnosis.observation import observe
from swashtwin.diagnosis.reasons import reasons_of
from swashtwin.diagnosis.trust import Trust, trust_in
from swashtwin.foundation import DataError, InputError, plural
from swashtwin.learning import (
    Choice,
    DiagnosingClassifier,
    FittedClassifier,
    WindowSet,
    likeliest_class,
    pooled_probabilities,
    require_verdicts,
    window_batches,
)
from swashtwin.recordings import Recording, RecordingFacts, facts_of, manifest_of, seen_recordings, stated_speed

_TOGETHER = 1024
"""Windows in memory together; a multiple of what the network takes at once, so that no result depends on it."""


@dataclass(frozen=True)
class Diagnosis:
    """The class of one recording, and how sure the classifier is of it."""

    recording_id: str
    """The recording that was diagnosed."""
    label: str | None
    """Likeliest class of the whole recording; None where there is no verdict."""
    probabilities: Mapping[str, float]
    """Probability of each class, pooled over the windows with the temperature and the dependence that validation
    recordings gave; empty where there is no verdict. Without `trust` it is a score between classes rather than a
    calibrated chance: the windows of one recording are not independent, and count as a single one."""
    window_labels: tuple[str | None, ...]
    """Likeliest class of each window, in order of time; None where a number of it is not finite."""
    agreement: float
    """Share of the windows that say the same as `label`; 0 where there is no verdict."""
    notes: tuple[str, ...]
    """What a reader should know before trusting it, such as a condition that was never trained."""
    trust: Trust | None = None
    """Which classes cannot be ruled out, and whether it is like any known recording; None where the classifier's
    confidence was not calibrated (`fit_chosen`, `learn_confidence`)."""
    no_verdict: str | None = None
    """Why there is no verdict: the recording cannot be used, or a number of the answer is not finite; None where there
    is one."""
    choice: Choice | None = None
    """How the classifier was chosen; None where its network was named."""
    reference: str = ""
    """Healthy recordings with which a pump prior compared it, in words; empty where windows were classified."""
    facts: RecordingFacts = field(default_factory=RecordingFacts)
    """Machine, date, condition and file of the recording, as far as it states them."""
    spectrum: HealthySpectrum | None = field(default=None, compare=False)
    """Its levels over those of healthy recordings; None without a verdict, or where the training had no healthy one."""

    def __repr__(self) -> str:
        if self.no_verdict is not None:
            return f"<Diagnosis of {self.recording_id}: no verdict ({self.no_verdict})>"
        classes = sorted(self.probabilities, key=lambda name: -self.probabilities[name])
        probabilities = ", ".join(f"{name} {self.probabilities[name]:.3f}" for name in classes)
        notes = f", {plural(len(self.notes), 'note')}" if self.notes else ""
        windows = plural(self.n_windows, "window")
        return f"<Diagnosis of {self.recording_id}: {self.label} ({probabilities}), {windows}{notes}>"

    @property
    def n_windows(self) -> int:
        """Windows that the recording gave."""
        return len(self.window_labels)

    def to_dict(self) -> dict[str, Any]:
        """Numbers, words and lists that JSON can hold."""
        return {
            "recording_id": self.recording_id,
            "label": self.label,
            "probabilities": dict(self.probabilities),
            "window_labels": list(self.window_labels),
            "n_windows": self.n_windows,
            "agreement": self.agreement,
            "notes": list(self.notes),
            "trust": None if self.trust is None else self.trust.to_dict(),
            "no_verdict": self.no_verdict,
        }


def diagnose(classifier: DiagnosingClassifier, recording: Recording, *, error_rate: float | None = None) -> Diagnosis:
    """The class of a recording, labeled or not, from windows cut as in training and without overlap.

    A recording that was loaded from its file is never whole in memory. One that cannot be used (NaN, a dead channel,
    too short, a damaged file) or whose answer is no finite number, such as one with a sample of 1e20, has no verdict:
    `Diagnosis.no_verdict` says why.

    Parameters
    ----------
    error_rate : of the prediction set and of calling a recording unknown; the classifier's own by default.

    Raises
    ------
    DataError
        The recording has another sample rate, other channels or another unit.
    InputError
        An error rate that the classifier's validation recordings are too few for, or that it knows none of.
    """
    if error_rate is not None and classifier.confidence is None:
        raise InputError(
            f"error_rate ({error_rate:g}) needs a classifier whose confidence was calibrated; train it without "
            "--network, with --validation-fraction 0.2."
        )
    require_layout(classifier.layout, recording)
    facts = facts_of([recording])
    try:
        scaled_classifier, parts = fit_to_recording(classifier, recording)
        observation = observe(scaled_classifier, parts())
        reasons = reasons_of(classifier, observation.condition, observation.facts)
        notes = (*_notes(classifier, recording), *reasons)
    except DataError as cause:
        return Diagnosis(recording.recording_id, None, {}, (), 0.0, (), no_verdict=str(cause), facts=facts)
    probability, features = observation.probability, observation.features
    likeliest = likeliest_class(probability)
    window_labels = tuple(None if index < 0 else classifier.classes[index] for index in likeliest.tolist())
    judged = classifier.confidence is not None
    has_verdict = (likeliest >= 0) & (np.isfinite(features).all(axis=1) if judged else True)
    if not has_verdict.all():
        reason = _not_finite(recording, classifier.layout.length, has_verdict)
        return Diagnosis(recording.recording_id, None, {}, window_labels, 0.0, notes, no_verdict=reason, facts=facts)
    pooled = pooled_probabilities(probability, classifier.confidence)
    trust = trust_in(classifier, observation, reasons, error_rate)
    if not np.isfinite(pooled).all() or (trust is not None and not math.isfinite(trust.ood_score)):
        reason = "the numbers that the model's confidence rests on are not finite; train it again."
        return Diagnosis(recording.recording_id, None, {}, window_labels, 0.0, notes, no_verdict=reason, facts=facts)
    label = classifier.classes[int(pooled.argmax())]
    return Diagnosis(
        recording_id=recording.recording_id,
        label=label,
        probabilities=dict(zip(classifier.classes, pooled.tolist(), strict=True)),
        window_labels=window_labels,
        agreement=float(np.mean([name == label for name in window_labels])),
        notes=notes,
        trust=trust,
        choice=classifier.choice if isinstance(classifier, FittedClassifier) else None,
        facts=facts,
        spectrum=classifier_spectrum(classifier, observation),
    )


def _not_finite(recording: Recording, length: int, has_verdict: np.ndarray) -> str:
    """Why windows have no finite answer: where the first is, and how large its samples are."""
    first, count = int(has_verdict.argmin()), int(np.count_nonzero(~has_verdict))
    peak = float(np.abs(recording.slice(first * length, (first + 1) * length).signal).max())
    which = "its only window" if has_verdict.size == 1 else f"{count} of {has_verdict.size} windows"
    return (
        f"the model's answer to {which} is no finite number, first at {first * length / recording.sample_rate:.4g} s, "
        f"where samples reach {peak:.3g} {recording.unit}; if that is far too large, cut it out or repair the file, "
        "else the model is damaged: train it again."
    )


C = TypeVar("C", bound=DiagnosingClassifier)


def fit_to_recording(classifier: C, recording: Recording) -> tuple[C, Callable[[], Iterator[WindowSet]]]:
    """(the classifier with the scaling of this recording, what gives the recording's windows in parts).

    Raises
    ------
    DataError
        The recording does not fit the classifier.
    """
    require_layout(classifier.layout, recording)
    parts = partial(
        window_batches,
        recording.relabeled(None),
        length=classifier.layout.length,
        classes=classifier.classes,
        allow_partial_revolution=True,
        batch=_TOGETHER,
    )
    return classifier.scaled_for(parts), parts


def _notes(classifier: DiagnosingClassifier, recording: Recording) -> list[str]:
    notes = []
    if seen := seen_recordings(classifier.manifest, manifest_of([recording])):
        listed = seen[recording.recording_id]
        under = "" if listed == recording.recording_id else f", under the name {listed}"
        notes.append(
            f"The classifier was made with this very recording{under}; the answer proves nothing about new ones."
        )
    condition = recording.condition
    layout = classifier.layout
    if condition is not None and layout.length / layout.sample_rate < condition.period * (1 - 1e-9):
        notes.append("At this speed a window is shorter than one revolution and sees some pistons only.")
    if isinstance(classifier, FittedClassifier) and classifier.network.uses_speed and not stated_speed(recording):
        usual = float(classifier.network.settings["turns"]) * layout.sample_rate * 60
        notes.append(
            f"It does not state its speed, and the model counts orders of the shaft: {usual:.4g} rev/min was assumed, "
            "as is usual in the training."
        )
    return notes


def recording_probability(fitted: FittedClassifier, recording: Recording) -> np.ndarray:
    """Probability of each class, pooled over the windows; a `DataError` where the recording has no verdict."""
    classifier, parts = fit_to_recording(fitted, recording)
    probability = np.concatenate([classifier.predict_proba(windows) for windows in parts()])
    pooled = pooled_probabilities(probability, classifier.confidence)
    require_verdicts(pooled[None], np.array([recording.recording_id]))
    return pooled
