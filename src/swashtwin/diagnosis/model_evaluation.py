"""Evaluation of a saved model on recordings, of which each that is not scored has a reason."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from jaxtyping import Float

# Through the room, whose door imports a scoring function only when it is called.
import swashtwin.learning as learning
from swashtwin.diagnosis.alarm_scores import AlarmScores
from swashtwin.diagnosis.anomaly_detector import AnomalyDetector
from swashtwin.diagnosis.fault_classifier import FaultClassifier
from swashtwin.diagnosis.prior_classifier import PriorClassifier
from swashtwin.diagnosis.progress import Progress, ignore_progress, iterate
from swashtwin.diagnosis.recording_arguments import require_layout
from swashtwin.foundation import DataError, InputError, to_table
from swashtwin.learning import (
    ConfidenceScores,
    FittedClassifier,
    Scores,
    WindowLayout,
    WindowSet,
)
from swashtwin.recordings import Recording, build_manifest, find_copies

# What follows the number of excluded recordings in a sentence, by reason.
_DESCRIPTIONS = {
    "synthetic": "made by a model",
    "in training": "that the model was trained on",
    "no class": "without a class",
    "untrained class": "of classes that the model was not trained on",
    "unusable": "that cannot be used",
}


@dataclass(frozen=True)
class Exclusion:
    """Recordings that are not scored, for one reason."""

    reason: str
    """``"synthetic"``, ``"in training"``, ``"no class"``, ``"untrained class"`` or
    ``"unusable"``."""
    recordings: Mapping[str, str]
    """By id: the name in the training, the class, or why it is unusable; else empty."""

    @property
    def description(self) -> str:
        """The reason in words that follow a number of recordings, such as ``"without a class"``."""
        return _DESCRIPTIONS[self.reason]

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON can hold."""
        table: dict[str, Any] = to_table(self)
        return table


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Scores of a model, and the recordings that they do and do not rest on."""

    scores: Scores | AlarmScores
    """Scores on `recordings`."""
    confidence: ConfidenceScores | None
    """How well the confidence of a classifier holds; None if it has none."""
    recordings: tuple[Recording, ...]
    """Recordings that are scored."""
    excluded: tuple[Exclusion, ...]
    """Recordings that are not scored, each for the first reason that applies."""


def evaluate_model(
    model: FaultClassifier | AnomalyDetector | PriorClassifier,
    recordings: Sequence[Recording],
    progress: Progress = ignore_progress,
) -> Evaluation:
    """Return the scores of a model on those of some recordings that it can be scored on.

    Parameters
    ----------
    progress : reports the read recordings, and then the classified windows or the diagnosed
        recordings.

    Raises
    ------
    DataError
        No recording is left to score.
    """
    candidates, exclusions = _partition_by_facts(model, recordings, progress)
    unusable: dict[str, str] = {}
    windows: WindowSet | None = None
    if not isinstance(model, PriorClassifier):
        # A pump prior gives a recording of another layout no verdict, and counts it.
        candidates, unusable = _select_layout(model.fitted_.layout, candidates)
    if isinstance(model, FaultClassifier) and candidates:
        candidates, windows, refused = _cut_usable(model, candidates)
        unusable |= refused
    exclusions.append(Exclusion("unusable", unusable))
    excluded = tuple(exclusion for exclusion in exclusions if exclusion.recordings)
    if not candidates:
        raise DataError(_describe_nothing_to_score(excluded))

    if not isinstance(model, FaultClassifier):
        alarms = model.evaluate(candidates, progress=progress)
        return Evaluation(alarms, None, tuple(candidates), excluded)

    assert windows is not None
    classifier = _ReportingClassifier.of(model.fitted_, progress)
    reference = classifier.training_reference
    split = None if reference is None else learning.split_between(reference, candidates)
    scores = learning.evaluate(classifier, windows, split=split)
    confidence = None
    if classifier.confidence is not None:
        confidence = learning.score_confidence(classifier, windows)
    return Evaluation(scores, confidence, tuple(candidates), excluded)


@dataclass(frozen=True, eq=False, kw_only=True)
class _ReportingClassifier(FittedClassifier):
    """A classifier that reports how many windows it has classified."""

    progress: Progress

    @classmethod
    def of(cls, classifier: FittedClassifier, progress: Progress) -> "_ReportingClassifier":
        """Return a classifier that reports to `progress`."""
        state = {field.name: getattr(classifier, field.name) for field in fields(classifier)}
        return cls(**state, progress=progress)

    def _map_blocks(
        self, windows: WindowSet, function: Callable[[np.ndarray, np.ndarray], np.ndarray]
    ) -> Float[np.ndarray, "window value"]:
        n_finished = 0

        def report_block(samples: np.ndarray, turns: np.ndarray) -> np.ndarray:
            nonlocal n_finished
            values = function(samples, turns)
            n_finished += len(samples)
            self.progress(n_finished, len(windows), "classifying windows")
            return values

        return super()._map_blocks(windows, report_block)


def _partition_by_facts(
    model: FaultClassifier | AnomalyDetector | PriorClassifier,
    recordings: Sequence[Recording],
    progress: Progress,
) -> tuple[list[Recording], list[Exclusion]]:
    """Return the recordings to score by their facts alone, and the others by reason."""
    measured = [recording for recording in recordings if not recording.synthetic]
    manifest = build_manifest(iterate(measured, progress, "reading"))
    in_training = find_copies(model.manifest, manifest)
    synthetic: dict[str, str] = {}
    without_class: dict[str, str] = {}
    of_untrained_class: dict[str, str] = {}
    candidates: list[Recording] = []
    for recording in recordings:
        name = recording.recording_id
        if recording.synthetic:
            synthetic[name] = ""
        elif name in in_training:
            continue
        elif recording.label is None:
            without_class[name] = ""
        elif isinstance(model, FaultClassifier) and recording.label not in model.fitted_.classes:
            of_untrained_class[name] = recording.label
        else:
            candidates.append(recording)

    return candidates, [
        Exclusion("synthetic", synthetic),
        Exclusion("in training", in_training),
        Exclusion("no class", without_class),
        Exclusion("untrained class", of_untrained_class),
    ]


def _select_layout(
    layout: WindowLayout, recordings: list[Recording]
) -> tuple[list[Recording], dict[str, str]]:
    """Return the recordings that fit a model, and why others do not, by id."""
    fitting: list[Recording] = []
    misfits: dict[str, str] = {}
    for recording in recordings:
        try:
            require_layout(layout, recording)
            fitting.append(recording)
        except DataError as cause:
            misfits[recording.recording_id] = str(cause)
    return fitting, misfits


def _cut_usable(
    model: FaultClassifier, recordings: list[Recording]
) -> tuple[list[Recording], WindowSet | None, dict[str, str]]:
    """Return the usable recordings, their windows, and why others are unusable, by id."""
    unusable: dict[str, str] = {}
    with suppress(DataError, InputError):
        return recordings, model.cut_windows(recordings), unusable

    # Rare, so that recordings are read a second time only to find which ones are unusable.
    usable: list[Recording] = []
    for recording in recordings:
        try:
            model.cut_windows([recording])
            usable.append(recording)
        except (DataError, InputError) as cause:
            unusable[recording.recording_id] = str(cause)
    return usable, model.cut_windows(usable) if usable else None, unusable


def _describe_nothing_to_score(excluded: Sequence[Exclusion]) -> str:
    parts = []
    for exclusion in excluded:
        name, detail = next(iter(exclusion.recordings.items()))
        example = f"{name}: {detail}" if detail and detail != name else name
        parts.append(f"{len(exclusion.recordings)} {exclusion.description} ({example})")

    text = f"No recording can be scored. Excluded: {'; '.join(parts)}."
    if any(exclusion.reason == "in training" for exclusion in excluded):
        text += " Test on recordings that the model was not trained on."
    return text
