"""Faults that a classifier's training did not hold: what a pump prior says of a recording that may
be one of them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float64

from swashtwin.diagnosis.prior_classifier import PriorClassifier
from swashtwin.diagnosis.recording_arguments import as_recordings, relabeled
from swashtwin.diagnosis.verdict import Diagnosis
from swashtwin.foundation import DataError, InputError, plural
from swashtwin.learning import WindowSet
from swashtwin.pump import is_healthy
from swashtwin.recordings import Recording

LEAST = 9
"""Training recordings that a rate is taken from, at least."""
SURE = 0.8
"""Probability of the only plausible class from which a classifier is believed and no prior; chosen
on fleets 100 and 101 of version 2 of the rig.
"""
NO_CONFIDENCE = (
    "The pump prior was left out: it is asked at the error rate of a confidence, and this training has none; leave out "
    "--network, or hold recordings back (--validation-fraction 0.2)."
)


@dataclass(frozen=True, eq=False)
class Resemblance:
    """A pump prior that is adapted to the healthy recordings of a training, for the faults that
    this did not hold.
    """

    prior: PriorClassifier
    classes: tuple[str, ...]
    """Classes of the prior that the training did not hold."""
    score: Float64[np.ndarray, " recording"]
    """Probability of these together for each recording of the training, ascending."""

    def __post_init__(self) -> None:
        if self.prior.head is None or not set(self.classes) < set(self.prior.classes):
            raise ValueError("the prior is of no machine, or does not know the classes")
        if self.score.size < LEAST or (np.diff(self.score) < 0).any():
            raise ValueError(f"the scores must ascend, and be {LEAST} at least")

    def with_healthy(self, healthy: Sequence[Recording]) -> "Resemblance":
        """The same that compares recordings of further machines with these healthy ones."""
        return replace(self, prior=self.prior.with_healthy(healthy))

    def joined(self, answer: Diagnosis, recording: Recording) -> Diagnosis:
        """A classifier's answer, unknown too where the prior takes the recording for a fault that
        was never trained.

        Each of both may err in the error rate, so that together they err in twice of it at most.
        The prior's p-value is
        conformal: the share of the training's recordings whose probability of such a fault is as
        high. Where the classifier is sure of a class, it is believed.
        """
        if answer.label is None or answer.error_rate is None or answer.p_value is None:
            return answer
        try:
            change, _ = self.prior.change(recording)
        except DataError as cause:
            note = f"The pump prior was not asked of faults that were never trained: {cause}"
            return replace(answer, notes=(*answer.notes, note))
        assert self.prior.head is not None
        shares = dict(
            zip(
                self.prior.classes,
                self.prior.head.predict_proba(change[None])[0].tolist(),
                strict=True,
            )
        )
        missing = {name: shares[name] for name in self.classes}
        likeliest, total = max(missing, key=missing.__getitem__), sum(missing.values())
        as_high, n = self.score.size - int(np.searchsorted(self.score, total)), self.score.size
        is_sure = len(answer.prediction_set) == 1 and answer.probabilities[answer.label] >= SURE
        is_new = (as_high + 1) / (n + 1) <= answer.error_rate and not is_sure
        reasons = answer.reasons
        if is_new or (answer.unknown and shares[likeliest] > 0.5):
            reasons = (
                f"It resembles {likeliest.replace('_', ' ')}, which was never trained: the pump prior gives that "
                f"{shares[likeliest]:.2f}, and {as_high or 'none'} of {n} recordings that it was compared on look as "
                "much like a fault that was not trained.",
                *reasons,
            )
        return replace(
            answer,
            unknown=is_new or answer.unknown,
            reasons=reasons,
            notes=(*answer.notes, *(text for text in reasons if text not in answer.notes)),
        )


def find_resemblance(
    prior: PriorClassifier | str | Path,
    X: Any,
    y: Any,
    training: WindowSet,
    fault_of: Mapping[str, str],
) -> tuple[Resemblance | None, str]:
    """(what the prior says of faults that recordings of a training do not hold, or None; a note
    that says so).

    A prior, or its file, that is of no machine yet is adapted to the healthy recordings. Of `X` the
    measured recordings of the training are taken. An `InputError` where a fault of the training is
    none of the prior's, or `X` is of windows; a `DataError` where the prior cannot be adapted.
    """
    if (given := as_recordings(X)) is None:
        raise InputError(
            "a pump prior needs recordings; windows and arrays are too short.", field="prior"
        )
    prior, classes = (
        prior if isinstance(prior, PriorClassifier) else PriorClassifier.load(prior),
        training.classes,
    )
    trained = set(training.recording_id[~training.synthetic].tolist())
    recordings = [item for item in relabeled(given, y) if item.recording_id in trained]
    names = {
        name: prior.class_of(fault_of.get(name, name)) for name in classes if not is_healthy(name)
    }
    if foreign := [name for name, known in names.items() if known is None]:
        raise InputError(
            f"the prior knows the faults {', '.join(prior.classes[1:-1])}, and no {foreign[0]}, so that it cannot tell "
            "which of them were never trained; say which fault a class is, such as --fault-of "
            f'"{foreign[0]}=piston", or leave the prior out.',
            field="prior",
        )
    missing = tuple(name for name in prior.classes[1:-1] if name not in names.values())
    if not missing:
        return None, "The training holds every class of the prior, which adds nothing."
    if prior.head is None:
        prior = prior.fit(
            [item for item in recordings if is_healthy(str(item.label))], fault_of=dict(fault_of)
        )
    assert prior.head is not None
    changes = list[Float[np.ndarray, "channel level"]](prior.healthy_changes())
    for recording in recordings:
        if not is_healthy(str(recording.label)):
            try:
                changes.append(prior.change(recording)[0])
            except DataError:
                continue
    if len(changes) < LEAST:
        return None, (
            f"The prior can be compared on {plural(len(changes), 'recording')} of the training only; its rate "
            f"needs {LEAST}. Record more healthy ones of each machine at the same pressure and speed."
        )
    columns = [prior.classes.index(name) for name in missing]
    score = np.sort(prior.head.predict_proba(np.stack(changes))[:, columns].sum(axis=1))
    listed = ", ".join(name.replace("_", " ") for name in missing)
    return Resemblance(
        prior, missing, score
    ), f"Of {listed}, never trained, the pump prior tells unknown recordings."
