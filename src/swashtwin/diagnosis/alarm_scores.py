"""Scores of a detector or a pump prior on labeled recordings: alarm rates by class."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from swashtwin.diagnosis.progress import Progress, ignore_progress, iterate
from swashtwin.diagnosis.recording_arguments import relabel_recordings, require_recordings
from swashtwin.diagnosis.verdict import Diagnosis
from swashtwin.foundation import DataError, LeakError, data_frame, short_repr, to_table
from swashtwin.pump import is_healthy, is_same_class
from swashtwin.recordings import Manifest, Recording, build_manifest, describe_copies, find_copies


@dataclass(frozen=True)
class ClassAlarms:
    """Alarms on the recordings of one class."""

    label: str
    """Class."""
    is_healthy: bool
    """Whether the class is the healthy one."""
    n_recordings: int
    """Recordings with a verdict."""
    n_no_verdict: int
    """Recordings without a verdict."""
    n_alarms: int
    """Recordings with an alarm."""
    n_correct: int | None
    """Recordings whose class was recognized; None of a detector, which names no class."""
    alarm_rate: float | None
    """Share of the recordings with an alarm; None if none has a verdict."""
    interval: tuple[float, float]
    """95 % interval of the alarm rate (Wilson 1927); 0 to 1 if no recording has a verdict."""
    auroc: float | None
    """Area under the curve of this class against the healthy class, by `Diagnosis.score`; None for
    the healthy class, and if no recording of one of both has a verdict."""
    no_verdict: str | None = None
    """Why the first recording without a verdict has none."""


@dataclass(frozen=True)
class AlarmScores:
    """Scores of a model by class, the healthy class first."""

    error_rate: float | None
    """Specified false-alarm rate of a detector; None of a prior."""
    classes: tuple[ClassAlarms, ...]
    """Alarms of each class."""

    __repr__ = short_repr

    def to_pandas(self) -> Any:
        """Return the scores as a ``pandas.DataFrame``, one row for each class.

        Raises
        ------
        MissingExtraError
            pandas is not installed.
        """
        return data_frame(self.to_dict()["classes"])

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON can hold."""
        table: dict[str, Any] = to_table(self)
        return table


def evaluate_alarms(
    diagnose: Callable[[Recording], Diagnosis],
    manifest: Manifest,
    X: Any,
    y: Any,
    error_rate: float | None,
    progress: Progress = ignore_progress,
) -> AlarmScores:
    """Return alarms by class on measured recordings that had no part in a model.

    All healthy labels count as one class.

    Parameters
    ----------
    diagnose : returns the model's answer.
    manifest : recordings that had a part in the model.
    X, y : recordings, and their classes; None for their own labels.
    error_rate : specified false-alarm rate of the model.
    progress : reports the diagnosed recordings.

    Raises
    ------
    LeakError
        A recording had a part in the model.
    DataError
        No recording has a label.
    """
    recordings = relabel_recordings(require_recordings(X), y)
    labeled = [
        recording
        for recording in recordings
        if recording.label is not None and not recording.synthetic
    ]
    if not labeled:
        raise DataError("No measured recording has a label; label them in the index.")
    copies = find_copies(manifest, build_manifest(labeled))
    if copies:
        raise LeakError(
            f"{describe_copies(copies)} had a part in the model (its manifest); test on others."
        )

    labels = [str(recording.label) for recording in labeled]
    healthy_label = next((label for label in labels if is_healthy(label)), "")
    by_class: dict[str, list[Diagnosis]] = {}
    reported = iterate(labeled, progress, "diagnosing")
    for recording, label in zip(reported, labels, strict=True):
        name = healthy_label if is_healthy(label) else label
        by_class.setdefault(name, []).append(diagnose(recording))

    healthy_scores = _scores(by_class.get(healthy_label, []))
    names = sorted(by_class, key=lambda name: (name != healthy_label, name))
    classes = []
    for name in names:
        is_healthy_class = name == healthy_label
        baseline_scores = [] if is_healthy_class else healthy_scores
        classes.append(_score_class(name, is_healthy_class, by_class[name], baseline_scores))
    return AlarmScores(error_rate, tuple(classes))


def _score_class(
    label: str,
    is_healthy_class: bool,
    diagnoses: Sequence[Diagnosis],
    healthy_scores: list[float],
) -> ClassAlarms:
    """Return the alarms of one class; its AUROC only if there are `healthy_scores`."""
    from sklearn.metrics import roc_auc_score

    from swashtwin.learning import wilson_interval

    judged = [diagnosis for diagnosis in diagnoses if diagnosis.label is not None]
    reasons = [diagnosis.no_verdict for diagnosis in diagnoses if diagnosis.label is None]
    n_alarms = sum(bool(diagnosis.alarm) for diagnosis in judged)

    alarm_rate = None
    interval = (0.0, 1.0)
    if judged:
        alarm_rate = n_alarms / len(judged)
        interval = wilson_interval(alarm_rate, len(judged))

    auroc = None
    scores = _scores(judged)
    if healthy_scores and scores:
        is_faulty = [False] * len(healthy_scores) + [True] * len(scores)
        auroc = float(roc_auc_score(is_faulty, healthy_scores + scores))

    n_correct = None
    if not any(diagnosis.kind == "detector" for diagnosis in diagnoses):
        n_correct = sum(is_same_class(diagnosis.verdict, label) for diagnosis in judged)

    return ClassAlarms(
        label=label,
        is_healthy=is_healthy_class,
        n_recordings=len(judged),
        n_no_verdict=len(reasons),
        n_alarms=n_alarms,
        n_correct=n_correct,
        alarm_rate=alarm_rate,
        interval=interval,
        auroc=auroc,
        no_verdict=reasons[0] if reasons else None,
    )


def _scores(diagnoses: Sequence[Diagnosis]) -> list[float]:
    return [diagnosis.score for diagnosis in diagnoses if diagnosis.score is not None]
