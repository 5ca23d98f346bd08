"""Faults that a classifier was not trained on: whether a pump prior recognizes one of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float64

from swashtwin.diagnosis.prior_classifier import LOOKALIKES, PriorClassifier
from swashtwin.diagnosis.recording_arguments import as_recordings, relabel_recordings
from swashtwin.diagnosis.verdict import MIN_CERTAIN_PROBABILITY, Diagnosis
from swashtwin.foundation import DataError, InputError, plural, propose_setting
from swashtwin.learning import WindowSet
from swashtwin.pump import is_healthy
from swashtwin.recordings import Recording

MIN_RECORDINGS = 9
"""Minimum number of training recordings: with 9, the smallest conformal p-value is 0.1, which is
the default error rate."""
MIN_LIKELY_PROBABILITY = 0.5
"""Probability of a fault from which the reasons of an unknown recording mention it."""
NO_CONFIDENCE_NOTE = (
    "The pump prior was left out: it is compared at the error rate of a confidence, and this "
    "training has none. Name no network, or hold recordings out (validation_fraction=0.2)."
)


@dataclass(frozen=True, eq=False)
class Resemblance:
    """A pump prior for faults that a training lacks, adapted to its healthy recordings."""

    prior: PriorClassifier
    classes: tuple[str, ...]
    """Classes of the prior that the training lacks."""
    score: Float64[np.ndarray, " recording"]
    """Total probability of these classes for each recording of the training, ascending."""

    def __post_init__(self) -> None:
        if self.prior.head is None or not set(self.classes) < set(self.prior.classes):
            raise ValueError("the prior is not adapted to a machine, or does not know the classes")
        if self.score.size < MIN_RECORDINGS or (np.diff(self.score) < 0).any():
            raise ValueError(f"the scores must ascend, and be at least {MIN_RECORDINGS}")

    def with_healthy(self, healthy: Sequence[Recording]) -> "Resemblance":
        """Return the same that also compares with healthy recordings of further machines."""
        return replace(self, prior=self.prior.with_healthy(healthy))

    def extend_diagnosis(self, diagnosis: Diagnosis, recording: Recording) -> Diagnosis:
        """Return a classifier's diagnosis, unknown if the prior recognizes a fault not trained.

        The classifier and the prior may each err in the error rate, so together in at most twice
        of it. The prior's p-value is conformal: the share of the training recordings whose
        probability of such a fault is as high. If the classifier is certain of a class, the prior
        is overruled.
        """
        if diagnosis.label is None or diagnosis.error_rate is None or diagnosis.p_value is None:
            return diagnosis
        try:
            change, _ = self.prior.change(recording)
        except DataError as cause:
            note = f"The pump prior was not asked for faults that were not trained: {cause}"
            return replace(diagnosis, notes=(*diagnosis.notes, note))

        assert self.prior.head is not None
        probabilities = self.prior.head.predict_proba(change[None])[0].tolist()
        by_class = dict(zip(self.prior.classes, probabilities, strict=True))
        likeliest = max(self.classes, key=by_class.__getitem__)
        total = sum(by_class[name] for name in self.classes)

        n = self.score.size
        n_as_high = n - int(np.searchsorted(self.score, total))
        is_certain = (
            len(diagnosis.prediction_set) == 1
            and diagnosis.probabilities[diagnosis.label] >= MIN_CERTAIN_PROBABILITY
        )
        is_new = (n_as_high + 1) / (n + 1) <= diagnosis.error_rate and not is_certain

        reasons = diagnosis.reasons
        is_likely = by_class[likeliest] > MIN_LIKELY_PROBABILITY
        if is_new or (diagnosis.unknown and is_likely):
            reason = (
                f"It resembles {likeliest.replace('_', ' ')}, which was not trained: the pump "
                f"prior gives this fault a probability of {by_class[likeliest]:.2f}. "
                f"{n_as_high or 'None'} of {n} training recordings resemble faults that were not "
                "trained as much."
            )
            if likeliest in LOOKALIKES:
                reason = f"{reason} {LOOKALIKES[likeliest]}"
            reasons = (reason, *reasons)

        new_notes = [reason for reason in reasons if reason not in diagnosis.notes]
        return replace(
            diagnosis,
            unknown=is_new or diagnosis.unknown,
            reasons=reasons,
            notes=(*diagnosis.notes, *new_notes),
        )


def find_resemblance(
    prior: PriorClassifier | str | Path,
    X: Any,
    y: Any,
    training: WindowSet,
    fault_of: Mapping[str, str],
) -> tuple[Resemblance | None, str]:
    """Return the prior for faults that a training lacks, or None, and a note about it.

    Parameters
    ----------
    prior : pump prior, or its file or design. One that is not adapted to a machine yet is adapted
        to the healthy recordings of the training.
    X, y : recordings and their classes, of which the measured ones of the training are used.
    training : windows that the classifier is trained on.
    fault_of : fault that a class stands for.

    Raises
    ------
    InputError
        The prior does not know a fault of the training, or `X` holds windows.
    DataError
        The prior cannot be adapted.
    """
    given_recordings = as_recordings(X)
    if given_recordings is None:
        raise InputError(
            "A pump prior needs recordings; windows and arrays are too short.", field="prior"
        )
    if not isinstance(prior, PriorClassifier):
        prior = PriorClassifier.load(prior)

    missing_classes = _missing_classes(prior, training.classes, fault_of)
    if not missing_classes:
        return None, "The training holds every class of the prior, which adds nothing."

    training_ids = set(training.recording_id[~training.synthetic].tolist())
    recordings = [
        recording
        for recording in relabel_recordings(given_recordings, y)
        if recording.recording_id in training_ids
    ]
    healthy = [recording for recording in recordings if is_healthy(str(recording.label))]
    faulty = [recording for recording in recordings if not is_healthy(str(recording.label))]

    if prior.head is None:
        prior = prior.fit(healthy, fault_of=dict(fault_of))
    assert prior.head is not None

    changes = list[Float[np.ndarray, "channel level"]](prior.healthy_changes())
    for recording in faulty:
        try:
            changes.append(prior.change(recording)[0])
        except DataError:
            # Its machine has no healthy recording at this operating point.
            continue
    if len(changes) < MIN_RECORDINGS:
        return None, (
            f"The prior can only be compared on {plural(len(changes), 'training recording')}; it "
            f"needs {MIN_RECORDINGS}. Record more healthy ones of each machine at the same "
            "pressure and speed."
        )

    columns = [prior.classes.index(name) for name in missing_classes]
    probability = prior.head.predict_proba(np.stack(changes))[:, columns]
    score = np.sort(probability.sum(axis=1))
    names = ", ".join(name.replace("_", " ") for name in missing_classes)
    note = f"The pump prior recognizes faults that were not trained: {names}."
    return Resemblance(prior, missing_classes, score), note


def _missing_classes(
    prior: PriorClassifier, classes: tuple[str, ...], fault_of: Mapping[str, str]
) -> tuple[str, ...]:
    """Return the faults of a prior that a training lacks."""
    # The first class of a prior is healthy, the last one stands for any other fault.
    prior_faults = prior.classes[1:-1]

    trained_faults = set()
    for name in classes:
        if is_healthy(name):
            continue
        fault = prior.class_of(fault_of.get(name, name))
        if fault is None:
            raise InputError(
                f"The prior does not know the class {name!r}, so it cannot recognize which faults "
                f"were not trained; it knows {', '.join(prior_faults)}.",
                field="prior",
                remedy=(
                    f"Specify the fault of a class, such as "
                    f"{propose_setting('fault_of', f'{name}=piston')}, or omit {{prior}}."
                ),
            )
        trained_faults.add(fault)
    return tuple(name for name in prior_faults if name not in trained_faults)
