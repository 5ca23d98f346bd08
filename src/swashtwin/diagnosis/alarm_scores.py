"""How well a detector or a pump prior does on recordings with labels: false alarms, and alarms for
each fault.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from swashtwin.diagnosis.recording_arguments import relabel_recordings, require_recordings
from swashtwin.diagnosis.verdict import Diagnosis
from swashtwin.foundation import DataError, LeakError, to_table
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
    """Recordings without one."""
    n_alarms: int
    """Recordings with an alarm."""
    n_named: int | None
    """Recordings whose class was named; None of a detector, which names none."""
    share: float | None
    """Share of the recordings with an alarm; None where none has a verdict."""
    interval: tuple[float, float]
    """95 % interval of the share (Wilson 1927); 0 to 1 where none has a verdict."""
    auroc: float | None
    """Area under the curve of this class against the healthy ones, by `Diagnosis.score`; None for
    these, and where one of both has no verdict.
    """
    no_verdict: str | None = None
    """Why the first recording without a verdict has none."""


@dataclass(frozen=True)
class AlarmScores:
    """Scores of a model by class, the healthy class first."""

    error_rate: float | None
    """False-alarm rate that a detector states; None of a prior."""
    classes: tuple[ClassAlarms, ...]
    """Alarms of each class."""

    def to_dict(self) -> dict[str, Any]:
        """Numbers, words and lists that JSON can hold."""
        table: dict[str, Any] = to_table(self)
        return table


def evaluate_alarms(
    diagnose: Callable[[Recording], Diagnosis],
    manifest: Manifest,
    X: Any,
    y: Any,
    error_rate: float | None,
) -> AlarmScores:
    """Alarms by class on measured recordings that had no part in a model, all healthy names as one
    class.

    Parameters
    ----------
    diagnose, manifest, error_rate : the model's answer, the recordings in it, and the false-alarm
    rate that it states.
    X, y : recordings, and their classes; None for their own labels. A `LeakError` where one had a
        part in the model, a `DataError` where none has a label.
    """
    from sklearn.metrics import roc_auc_score

    from swashtwin.learning import wilson_interval

    recordings = relabel_recordings(require_recordings(X), y)
    labeled = [
        recording
        for recording in recordings
        if recording.label is not None and not recording.synthetic
    ]
    if not labeled:
        raise DataError("no measured recording has a label; label them in the index.")
    if seen := find_copies(manifest, build_manifest(labeled)):
        raise LeakError(
            f"{describe_copies(seen)} had a part in the model (its manifest); test on others."
        )
    labels, answers = (
        [str(recording.label) for recording in labeled],
        [diagnose(item) for item in labeled],
    )
    healthy = next((label for label in labels if is_healthy(label)), "")
    by_class: dict[str, list[Diagnosis]] = {}
    for label, answer in zip(labels, answers, strict=True):
        by_class.setdefault(healthy if is_healthy(label) else label, []).append(answer)
    usual = [answer.score for answer in by_class.get(healthy, []) if answer.score is not None]
    classes = []
    for label, members in sorted(by_class.items(), key=lambda item: (item[0] != healthy, item[0])):
        judged = [answer for answer in members if answer.label is not None]
        scores = [answer.score for answer in judged if answer.score is not None]
        n_alarms = sum(bool(answer.alarm) for answer in judged)
        share = n_alarms / len(judged) if judged else None
        auroc = None
        if label != healthy and usual and scores:
            auroc = float(
                roc_auc_score([False] * len(usual) + [True] * len(scores), usual + scores)
            )
        is_detector = any(answer.kind == "detector" for answer in members)
        classes.append(
            ClassAlarms(
                label=label,
                is_healthy=label == healthy,
                n_recordings=len(judged),
                n_no_verdict=len(members) - len(judged),
                no_verdict=next(
                    (answer.no_verdict for answer in members if answer.label is None), None
                ),
                n_alarms=n_alarms,
                n_named=None
                if is_detector
                else sum(is_same_class(answer.verdict, label) for answer in judged),
                share=share,
                interval=(0.0, 1.0) if share is None else wilson_interval(share, len(judged)),
                auroc=auroc,
            )
        )
    return AlarmScores(error_rate, tuple(classes))
