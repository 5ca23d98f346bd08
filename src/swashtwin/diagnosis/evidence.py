"""Which spectral lines and training recordings speak for a verdict."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Float64

from swashtwin.diagnosis.attribution import Band, attribute_answer
from swashtwin.diagnosis.recording_arguments import require_recording
from swashtwin.diagnosis.recording_diagnosis import recording_windows
from swashtwin.diagnosis.verdict import Check, Diagnosis, next_checks
from swashtwin.foundation import InputError, to_table
from swashtwin.learning import FittedClassifier
from swashtwin.recordings import Recording, specified_shaft_frequency

MAX_WINDOWS = 24
"""Consecutive windows that evidence is computed from; of more, those that speak most for the
verdict."""

# Share of the score that contributions may miss and still be reported as shares of it.
_MAX_COMPLETENESS_ERROR = 0.1

_N_NEIGHBORS = 5
_N_SENTENCE_LINES = 3
_N_JSON_LINES = 10

# Keeps the logarithm of a probability finite.
_MIN_PROBABILITY = 1e-12


@dataclass(frozen=True)
class Neighbor:
    """A training recording that resembles the one diagnosed."""

    recording_id: str
    """Its id."""
    label: str
    """Its class."""
    distance: float
    """Distance of its mean features (`TrainingReference.distances`)."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the network's answer rests on; scores are log-odds."""

    recording_id: str
    """The recording."""
    label: str
    """The diagnosed class."""
    rival: str
    """The second likeliest class: evidence is for the one against the other."""
    unknown: bool
    """Whether the recording does not resemble the training, so that neither class holds."""
    baseline: str
    """What the samples are compared with: silence, or the mean of the training for a network on
    band powers."""
    margin: float
    """Score of `label` less that of `rival`, less the same for `baseline`; mean over the
    windows."""
    completeness_error: float
    """Share of `margin` that the sum of `contributions` misses, since gradients are computed at
    finitely many points."""
    start: float
    """Time of the first sample used [s]."""
    duration: float
    """Length of the samples used [s]."""
    channels: tuple[str, ...]
    """Channels."""
    bands: tuple[Band, ...]
    """Orders and third octaves, ascending; of a network on band powers also those of the envelope,
    and the whole channel."""
    contributions: Float64[np.ndarray, "channel band"]
    """What each band adds; their sum is `margin`."""
    pistons: int | None
    """Number of pistons, if specified."""
    nearest: tuple[Neighbor, ...]
    """Most similar training recordings, nearest first; empty if the classifier stores none."""
    checks: tuple[Check, ...]
    """What to check on the machine."""

    @property
    def total(self) -> float:
        """Sum of all contributions over `margin`: 1 if they add up."""
        return float(self.contributions.sum()) / self.margin if self.margin else math.nan

    @property
    def adds_up(self) -> bool:
        """Whether the contributions miss at most 10 % of the score.

        Otherwise they are not shares of it: only the order of the lines is reported.
        """
        return self.completeness_error <= _MAX_COMPLETENESS_ERROR

    @property
    def remark(self) -> str:
        """Why no shares are reported, if the contributions do not add up; else empty."""
        if self.adds_up:
            return ""
        if math.isfinite(self.total):
            total = f"add to {100 * self.total:.0f} % of the score"
        else:
            total = "do not add to the score, which is 0"
        return f"No shares are shown: the contributions of all lines together {total}."

    def strongest(self, count: int = _N_SENTENCE_LINES) -> list[tuple[str, Band, float]]:
        """Return channel, band and share of the lines that speak most for the verdict.

        Shares are of all magnitudes together.
        """
        magnitude = float(np.abs(self.contributions).sum())
        shares = self.contributions / max(magnitude, 1e-300)

        strongest = []
        for flat_index in np.argsort(-shares, axis=None)[:count]:
            channel, band = np.unravel_index(flat_index, shares.shape)
            share = float(shares[channel, band])
            if share > 0:
                strongest.append((self.channels[channel], self.bands[band], share))
        return strongest

    def describe(self, band: Band) -> str:
        """Return the band's name with what a maintenance engineer calls its line."""
        if band.order is None:
            return band.name

        frequency = f"{(band.low + band.high) / 2:.4g} Hz"
        line_name = "shaft" if band.order == 1 else ""
        if self.pistons and band.order % self.pistons == 0:
            multiple = band.order // self.pistons
            prefix = "" if multiple == 1 else f"{multiple}× the "
            line_name = f"{prefix}piston-pass line"
        details = f"{frequency}, {line_name}" if line_name else frequency
        return f"{band.name} ({details})"

    def sentences(self) -> tuple[str, ...]:
        """Return the evidence as sentences."""
        label = self.label.replace("_", " ")
        sentences = [self._line_sentence()]
        if self.remark:
            sentences.append(self.remark)
        if self.margin <= 0:
            sentences.append(
                f"The samples as a whole speak against {label}: for {self.baseline} the network "
                f"answers {label} even more firmly. So the lines say little about this verdict; "
                "rely on the nearest recordings and on the checks."
            )
        if self.nearest:
            sentences.append(self._neighbor_sentence())
        return tuple(sentences)

    def _line_sentence(self) -> str:
        label = self.label.replace("_", " ")
        rival = self.rival.replace("_", " ")
        lines = []
        for channel, band, share in self.strongest():
            percentage = f" ({100 * share:.0f} %)" if self.adds_up else ""
            lines.append(f"{self.describe(band)} on {channel}{percentage}")

        line_list = "; ".join(lines) or "no single line"
        if self.unknown:
            return (
                "The recording is unknown. Among the trained classes, the strongest evidence for "
                f"{label} against {rival} is: {line_list}."
            )
        return f"Strongest evidence for {label} against {rival}: {line_list}."

    def _neighbor_sentence(self) -> str:
        neighbors = [
            f"{neighbor.recording_id} ({neighbor.label.replace('_', ' ')})"
            for neighbor in self.nearest[:_N_SENTENCE_LINES]
        ]
        sentence = f"Nearest training recordings: {', '.join(neighbors)}"
        if self.unknown:
            return f"{sentence}."

        n_same = sum(neighbor.label == self.label for neighbor in self.nearest)
        label = self.label.replace("_", " ")
        return f"{sentence}; {n_same} of the {len(self.nearest)} nearest are {label}."

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON can hold."""
        strongest = [
            {
                "channel": channel,
                "band": band.name,
                "low_hz": band.low,
                "high_hz": band.high,
                "share": share if self.adds_up else None,
            }
            for channel, band, share in self.strongest(_N_JSON_LINES)
        ]
        names = (
            "recording_id",
            "unknown",
            "label",
            "rival",
            "margin",
            "completeness_error",
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
    """Return the evidence for a verdict, by integrated gradients.

    It shows which lines the network uses, which is not yet why the pump vibrates so: see the limits
    in docs/explanation/diagnosis.md.

    Parameters
    ----------
    diagnosis : of this recording, by this classifier. If its `facts` specify the number of pistons,
        lines are named.

    Raises
    ------
    InputError
        The diagnosis is of another recording or without a verdict, or there is a single class.
    """
    require_recording(recording)
    _require_explainable(classifier, recording, diagnosis)

    answers = [classifier.answer(windows) for windows in recording_windows(classifier, recording)]
    probability, features = (np.concatenate(arrays) for arrays in zip(*answers, strict=True))

    # The verdict comes first, even if the pooled probability of another class is higher.
    ranked = sorted(
        diagnosis.probabilities,
        key=lambda name: (name != diagnosis.label, -diagnosis.probabilities[name]),
    )
    label, rival = (classifier.classes.index(name) for name in ranked[:2])

    log_probability = np.log(np.maximum(probability, _MIN_PROBABILITY))
    margin = log_probability[:, label] - log_probability[:, rival]
    first_window = _strongest_stretch(margin)
    n_windows = min(MAX_WINDOWS, len(probability))

    length = classifier.layout.length
    stretch = recording.replace(label=None).slice(
        first_window * length, (first_window + n_windows) * length
    )
    windows = classifier.cut_windows([stretch])
    attribution = attribute_answer(
        classifier, windows, label, rival, specified_shaft_frequency(recording)
    )

    likely_labels: Sequence[str] = diagnosis.prediction_set[:2] or ranked[:1]
    likely_faults = [diagnosis.fault_of.get(name, name) for name in likely_labels]
    return Evidence(
        **attribution,
        recording_id=recording.recording_id,
        label=ranked[0],
        rival=ranked[1],
        unknown=diagnosis.unknown,
        start=first_window * length / classifier.layout.sample_rate,
        duration=len(windows) * length / classifier.layout.sample_rate,
        channels=classifier.layout.channels,
        pistons=diagnosis.facts.pistons,
        nearest=_nearest_recordings(classifier, features),
        checks=next_checks(*likely_faults, unknown=diagnosis.unknown),
    )


def _require_explainable(
    classifier: FittedClassifier, recording: Recording, diagnosis: Diagnosis
) -> None:
    if diagnosis.label is None:
        raise InputError(
            f"{diagnosis.recording_id} has no verdict to explain: {diagnosis.no_verdict}"
        )
    is_same_recording = diagnosis.recording_id == recording.recording_id
    if not is_same_recording or set(diagnosis.probabilities) != set(classifier.classes):
        raise InputError(
            f"The diagnosis is of {diagnosis.recording_id}, or by another classifier; diagnose "
            "this recording by this classifier."
        )
    if len(classifier.classes) < 2:
        raise InputError("A classifier of one class has nothing to decide.")


def _strongest_stretch(margin: Float[np.ndarray, " window"]) -> int:
    """Return the first of `MAX_WINDOWS` consecutive windows with the largest total margin."""
    if margin.size <= MAX_WINDOWS:
        return 0
    return int(np.convolve(margin, np.ones(MAX_WINDOWS), mode="valid").argmax())


def _nearest_recordings(
    classifier: FittedClassifier, features: Float[np.ndarray, "window feature"]
) -> tuple[Neighbor, ...]:
    reference = classifier.training_reference
    if reference is None:
        return ()
    distance = reference.distances(features.mean(axis=0))
    nearest = np.argsort(distance, kind="stable")[:_N_NEIGHBORS]
    return tuple(
        Neighbor(reference.recording_id[index], reference.label[index], float(distance[index]))
        for index in nearest
        if math.isfinite(distance[index])
    )
