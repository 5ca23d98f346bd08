"""What a fitted classifier says of one recording."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np

from swashtwin.diagnosis.trust import Trust, trust_in
from swashtwin.foundation import DataError, InputError
from swashtwin.learning import DiagnosingClassifier, WindowLayout, WindowSet, pooled_probabilities, window_batches
from swashtwin.pump import PRESSURE_TOLERANCE, values_match
from swashtwin.recordings import Recording

_SPEED_TOLERANCE = 0.05
"""Relative difference up to which a speed was trained at: more than elsewhere, since it only decides over a note."""
_TOGETHER = 1024
"""Windows in memory together; a multiple of what the network takes at once, so that no result depends on it."""


@dataclass(frozen=True)
class Diagnosis:
    """The class of one recording, and how sure the classifier is of it."""

    recording_id: str
    """The recording that was diagnosed."""
    label: str
    """Likeliest class of the whole recording."""
    probabilities: Mapping[str, float]
    """Probability of each class, from the mean log-probability over the windows, at the temperature that validation
    recordings gave. Without `trust` it is a score between classes rather than a calibrated chance, since the windows of
    one recording are not independent."""
    window_labels: tuple[str, ...]
    """Likeliest class of each window, in order of time."""
    agreement: float
    """Share of the windows that say the same as `label`."""
    notes: tuple[str, ...]
    """What a reader should know before trusting it, such as a condition that was never trained."""
    trust: Trust | None = None
    """Which classes cannot be ruled out, and whether it is like any known recording; None where the classifier's
    confidence was not calibrated (`learn_confidence`, ``swashtwin train --validation-fraction``)."""

    def __repr__(self) -> str:
        classes = sorted(self.probabilities, key=lambda name: -self.probabilities[name])
        probabilities = ", ".join(f"{name} {self.probabilities[name]:.3f}" for name in classes)
        notes = f", {len(self.notes)} note(s)" if self.notes else ""
        return f"<Diagnosis of {self.recording_id}: {self.label} ({probabilities}), {self.n_windows} windows{notes}>"

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
        }


def diagnose(classifier: DiagnosingClassifier, recording: Recording, *, error_rate: float | None = None) -> Diagnosis:
    """The class of a recording, labeled or not, from windows cut as in training and without overlap.

    A recording that was loaded from its file is never whole in memory.

    Parameters
    ----------
    error_rate : of the prediction set and of calling a recording unknown; the classifier's own by default.

    Raises
    ------
    DataError
        The recording has another sample rate, other channels or another unit, is too short for one window, or is unfit.
    InputError
        An error rate that the classifier's validation recordings are too few for, or that it knows none of.
    """
    if error_rate is not None and classifier.confidence is None:
        raise InputError(
            f"error_rate ({error_rate:g}) needs a classifier whose confidence was calibrated; train it with "
            "--validation-fraction 0.2, or learn_confidence(classifier, validation)."
        )
    scaled_classifier, parts = fit_to_recording(classifier, recording)
    answers = [scaled_classifier.answer(windows) for windows in parts()]
    probability, features = (np.concatenate(part) for part in zip(*answers, strict=True))
    pooled = pooled_probabilities(probability)
    trust = trust_in(classifier, pooled, features, error_rate)
    if classifier.confidence is not None:
        pooled = classifier.confidence.temperature_scaled(pooled)
    label = classifier.classes[int(pooled.argmax())]
    window_labels = tuple(classifier.classes[index] for index in probability.argmax(axis=1))
    return Diagnosis(
        recording_id=recording.recording_id,
        label=label,
        probabilities=dict(zip(classifier.classes, pooled.tolist(), strict=True)),
        window_labels=window_labels,
        agreement=float(np.mean([name == label for name in window_labels])),
        notes=tuple(_notes(classifier, recording)),
        trust=trust,
    )


C = TypeVar("C", bound=DiagnosingClassifier)


def fit_to_recording(classifier: C, recording: Recording) -> tuple[C, Callable[[], Iterator[WindowSet]]]:
    """(the classifier with the scaling of this recording, what gives the recording's windows in parts).

    Raises
    ------
    DataError
        The recording does not fit the classifier.
    """
    layout = WindowLayout(float(recording.sample_rate), recording.channels, recording.unit, classifier.layout.length)
    if difference := classifier.layout.difference(layout):
        raise DataError(
            f"{recording.recording_id} does not fit the classifier (what it was trained on against this recording): "
            f"{difference}; {_advice(difference)}."
        )
    parts = partial(
        window_batches,
        recording.relabeled(None),
        length=classifier.layout.length,
        classes=classifier.classes,
        allow_partial_revolution=True,
        batch=_TOGETHER,
    )
    return classifier.scaled_for(parts), parts


def _advice(difference: str) -> str:
    """What to do about a difference of layouts."""
    if difference.startswith("sample rate"):
        return 'bring it to the classifier\'s rate: index the file, and give resample = "..." in the index'
    if difference.startswith("unit"):
        return 'state what a sample is: --calibration-factor with its unit, such as "50 m/s^2", or --unit'
    return (
        "say what the channels of the file are with --names, once for each, or take some of them with --channels, once "
        "for each"
    )


def _notes(classifier: DiagnosingClassifier, recording: Recording) -> list[str]:
    notes = []
    if recording.recording_id in classifier.manifest:
        notes.append("The classifier was made with this very recording; the answer proves nothing about new ones.")
    condition = recording.condition
    if condition is None:
        return notes
    if _is_new(condition.discharge_pressure, classifier.pressures, PRESSURE_TOLERANCE):
        trained = _listed([pressure / 1e6 for pressure in classifier.pressures])
        notes.append(
            f"Discharge pressure {condition.discharge_pressure / 1e6:.3g} MPa was never trained ({trained} MPa were)."
        )
    if _is_new(condition.speed, classifier.speeds, _SPEED_TOLERANCE):
        trained = _listed([speed * 30 / math.pi for speed in classifier.speeds])
        notes.append(f"Speed {condition.speed * 30 / math.pi:.4g} rev/min was never trained ({trained} rev/min were).")
    if classifier.layout.length / classifier.layout.sample_rate < condition.period * (1 - 1e-9):
        notes.append("At this speed a window is shorter than one revolution and sees some pistons only.")
    return notes


def _is_new(value: float, trained: tuple[float, ...], tolerance: float) -> bool:
    return bool(trained) and not values_match(value, np.array(trained), tolerance).any()


def _listed(values: list[float]) -> str:
    words = [f"{value:.4g}" for value in values]
    return ", ".join(words) if len(words) <= 6 else f"{len(words)} values from {words[0]} to {words[-1]}"
