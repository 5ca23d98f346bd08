"""Which lines and training recordings speak for a verdict."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64

from swashtwin.diagnosis.attribution import Band, contributions
from swashtwin.diagnosis.recording_arguments import require_recording
from swashtwin.diagnosis.recording_diagnosis import recording_windows
from swashtwin.diagnosis.verdict import Check, Diagnosis, next_checks
from swashtwin.foundation import InputError, to_table
from swashtwin.learning import FittedClassifier
from swashtwin.recordings import Recording, specified_shaft_frequency

MOST_WINDOWS = 24
"""Windows in a row that evidence is taken from; of more, those that speak most for the verdict."""
_MOST_GAP = 0.1
"""Share of the score that contributions may miss and still be called shares of it."""
_NEIGHBORS = 5


@dataclass(frozen=True)
class Neighbor:
    """A recording of the training that resembles the one diagnosed."""

    recording_id: str
    """Its id."""
    label: str
    """Its class."""
    distance: float
    """Distance of its mean features (`TrainingReference.distances`)."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the network's answer rests on; all figures are in the unit of its scores (log-odds)."""

    recording_id: str
    """The recording."""
    label: str
    """The class that was named."""
    rival: str
    """The next likeliest class: evidence is for the one against the other."""
    unknown: bool
    """Whether the recording is unlike the training, so that neither class is named."""
    baseline: str
    """What the samples are compared with, in words: silence, or the mean of the training for a
    network on levels.
    """
    margin: float
    """Score of `label` less that of `rival`, less the same for `baseline`; mean over the windows
    looked at.
    """
    gap: float
    """Share of `margin` that the sum of `lines` misses, since gradients were taken at finitely many
    points.
    """
    start: float
    """Time of the first sample looked at [s]."""
    duration: float
    """Length of what was looked at [s]."""
    channels: tuple[str, ...]
    """Channels."""
    bands: tuple[Band, ...]
    """Orders and third octaves, ascending; of a network on levels also those of the envelope, and
    the whole.
    """
    lines: Float64[np.ndarray, "channel band"]
    """What each band adds; their sum is `margin`."""
    pistons: int | None
    """Number of pistons, where it was said."""
    nearest: tuple[Neighbor, ...]
    """Most similar recordings of the training, nearest first; none where the classifier keeps
    none.
    """
    checks: tuple[Check, ...]
    """What to check on the machine."""

    @property
    def total(self) -> float:
        """Sum of all contributions over `margin`: 1 where they add up."""
        return float(self.lines.sum()) / self.margin if self.margin else math.nan

    @property
    def adds_up(self) -> bool:
        """Whether the contributions miss at most 10 % of the score. Otherwise they are no shares of
        it: only the order of the lines is shown, no figure.
        """
        return self.gap <= _MOST_GAP

    @property
    def remark(self) -> str:
        """Why no shares are shown, where the contributions do not add up; else empty."""
        if self.adds_up:
            return ""
        total = (
            f"{100 * self.total:.0f} % of the score"
            if math.isfinite(self.total)
            else "something, the score is 0"
        )
        return f"No shares are shown: the contributions of all lines together add to {total}."

    def strongest(self, count: int = 3) -> list[tuple[str, Band, float]]:
        """(channel, band, share) of what speaks most for the verdict; shares are of all magnitudes
        together.
        """
        share = self.lines / max(float(np.abs(self.lines).sum()), 1e-300)
        indices = np.argsort(-share, axis=None)[:count]
        picked = [np.unravel_index(index, share.shape) for index in indices]
        return [
            (self.channels[c], self.bands[b], float(share[c, b]))
            for c, b in picked
            if share[c, b] > 0
        ]

    def describe(self, band: Band) -> str:
        """The band in words, with what a maintenance engineer calls its line."""
        if band.order is None:
            return band.name
        frequency = f"{(band.low + band.high) / 2:.4g} Hz"
        kind = "shaft" if band.order == 1 else ""
        if self.pistons and band.order % self.pistons == 0:
            times = band.order // self.pistons
            kind = "piston-pass line" if times == 1 else f"{times}× the piston-pass line"
        return f"{band.name} ({frequency}{', ' + kind if kind else ''})"

    def sentences(self) -> tuple[str, ...]:
        """The evidence in words."""
        label, rival = self.label.replace("_", " "), self.rival.replace("_", " ")
        lines = [
            f"{self.describe(band)} on {channel}{f' ({100 * share:.0f} %)' if self.adds_up else ''}"
            for channel, band, share in self.strongest()
        ]
        about = "No class is named. Of those trained, what" if self.unknown else "What"
        sentences = [
            f"{about} speaks most for {label} rather than {rival}: {'; '.join(lines) or 'no single line'}."
        ]
        if self.remark:
            sentences.append(self.remark)
        if self.margin <= 0:
            sentences.append(
                f"The samples as a whole take away from {label}: to {self.baseline} the network answers {label} even "
                f"more firmly. Lines against {self.baseline} say little of this verdict; lean on the nearest "
                "recordings and on the checks."
            )
        if self.nearest:
            neighbors = [
                f"{near.recording_id} ({near.label.replace('_', ' ')})" for near in self.nearest[:3]
            ]
            same = sum(near.label == self.label for near in self.nearest)
            count = (
                "" if self.unknown else f"; {same} of the {len(self.nearest)} nearest are {label}"
            )
            sentences.append(f"Nearest training recordings: {', '.join(neighbors)}{count}.")
        return tuple(sentences)

    def to_dict(self) -> dict[str, Any]:
        """Numbers, words and lists that JSON can hold."""
        strongest = [
            {"channel": channel, "band": band.name, "low_hz": band.low, "high_hz": band.high,
             "share": share if self.adds_up else None}
            for channel, band, share in self.strongest(10)
        ]  # fmt: skip
        names = (
            "recording_id",
            "unknown",
            "label",
            "rival",
            "margin",
            "gap",
            "adds_up",
            "nearest",
            "checks",
        )
        return {
            **to_table({name: getattr(self, name) for name in names}),
            "total": self.total if math.isfinite(self.total) else None,
            "strongest": strongest,
            "sentences": list(self.sentences()),
        }


def explain(classifier: FittedClassifier, recording: Recording, diagnosis: Diagnosis) -> Evidence:
    """What the verdict on a recording rests on, by integrated gradients over the windows that speak
    most for it.

    It says what the network looks at, which is not yet why the pump vibrates so:
    docs/explanation/diagnosis.md has the limits.

    Parameters
    ----------
    diagnosis : of this recording, by this classifier. Where its `facts` state the number of
        pistons, lines are named.

    Raises
    ------
    InputError
        The diagnosis is of another recording or without a verdict, or there is one class only.
    """
    require_recording(recording)
    if diagnosis.label is None:
        raise InputError(
            f"{diagnosis.recording_id} has no verdict to explain: {diagnosis.no_verdict}"
        )
    if diagnosis.recording_id != recording.recording_id or set(diagnosis.probabilities) != set(
        classifier.classes
    ):
        raise InputError(
            f"the diagnosis is of {diagnosis.recording_id}, or by another classifier; diagnose this one."
        )
    if len(classifier.classes) < 2:
        raise InputError("a classifier of one class has nothing to decide.")
    answers = [classifier.answer(windows) for windows in recording_windows(classifier, recording)]
    probability, features = (np.concatenate(part) for part in zip(*answers, strict=True))
    ranked = sorted(
        diagnosis.probabilities,
        key=lambda name: (name != diagnosis.label, -diagnosis.probabilities[name]),
    )
    label, rival = (classifier.classes.index(name) for name in ranked[:2])
    logarithm = np.log(np.maximum(probability, 1e-12))
    first, margin = 0, logarithm[:, label] - logarithm[:, rival]
    if margin.size > MOST_WINDOWS:  # those in a row with the greatest margin together
        first = int(np.convolve(margin, np.ones(MOST_WINDOWS), mode="valid").argmax())
    count, length = min(MOST_WINDOWS, len(probability)), classifier.length
    piece = recording.replace(label=None).slice(first * length, (first + count) * length)
    windows = classifier.cut_windows([piece])
    adds = contributions(classifier, windows, label, rival, specified_shaft_frequency(recording))
    return Evidence(
        **adds,
        recording_id=recording.recording_id,
        label=ranked[0],
        rival=ranked[1],
        unknown=diagnosis.unknown,
        start=first * length / classifier.sample_rate,
        duration=len(windows) * length / classifier.sample_rate,
        channels=classifier.channels,
        pistons=diagnosis.facts.pistons,
        nearest=_nearest(classifier, features),
        checks=next_checks(
            *(
                diagnosis.fault_of.get(name, name)
                for name in diagnosis.prediction_set[:2] or ranked[:1]
            ),
            unknown=diagnosis.unknown,
        ),
    )


def _nearest(classifier: FittedClassifier, features: np.ndarray) -> tuple[Neighbor, ...]:
    reference = classifier.training_reference
    if reference is None:
        return ()
    distance = reference.distances(features.mean(axis=0))
    return tuple(
        Neighbor(reference.recording_id[index], reference.label[index], float(distance[index]))
        for index in np.argsort(distance, kind="stable")[:_NEIGHBORS]
        if math.isfinite(distance[index])
    )
