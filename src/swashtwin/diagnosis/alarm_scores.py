"""How well an anomaly detector does on recordings with labels: false alarms, and alarms for each fault."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from sklearn.metrics import roc_auc_score

from swashtwin.diagnosis.anomaly_detector import AnomalyDetector, AnomalyVerdict
from swashtwin.foundation import DataError, LeakError
from swashtwin.learning import wilson_interval
from swashtwin.pump import is_healthy
from swashtwin.recordings import Recording, manifest_of, say_seen, seen_recordings


@dataclass(frozen=True)
class ClassAlarms:
    """Alarms on the recordings of one class."""

    label: str
    """Class."""
    n_recordings: int
    """Recordings with a verdict."""
    n_no_verdict: int
    """Recordings without one."""
    n_alarms: int
    """Recordings with an alarm."""
    auroc: float
    """Area under the curve of this class against the healthy ones, by the nonconformity score; NaN for these, and
    where one of both has no verdict."""

    @property
    def share(self) -> float:
        """Share of the recordings with an alarm; NaN where none has a verdict."""
        return self.n_alarms / self.n_recordings if self.n_recordings else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the share (Wilson 1927); 0 to 1 where none has a verdict."""
        return wilson_interval(self.share, self.n_recordings) if self.n_recordings else (0.0, 1.0)


@dataclass(frozen=True)
class AlarmScores:
    """Scores of an anomaly detector by class, the healthy class first."""

    error_rate: float
    """False-alarm rate that the detector states."""
    classes: tuple[ClassAlarms, ...]
    """Alarms of each class."""

    def to_dict(self) -> dict[str, Any]:
        """Numbers, words and lists that JSON can hold."""
        return {
            "error_rate": self.error_rate,
            "classes": [
                {
                    "label": item.label,
                    "is_healthy": is_healthy(item.label),
                    "n_recordings": item.n_recordings,
                    "n_no_verdict": item.n_no_verdict,
                    "n_alarms": item.n_alarms,
                    "share": item.share,
                    "interval": list(item.interval),
                    "auroc": item.auroc,
                }
                for item in self.classes
            ],
        }


def score_alarms(detector: AnomalyDetector, recordings: Sequence[Recording]) -> AlarmScores:
    """Alarms on recordings with labels, all healthy names as one class.

    Raises
    ------
    LeakError
        A recording had a part in the detector.
    DataError
        None has a label.
    """
    labeled = [recording for recording in recordings if recording.label is not None and not recording.synthetic]
    if not labeled:
        raise DataError("no measured recording has a label; label them in the index.")
    if seen := seen_recordings(detector.manifest, manifest_of(labeled)):
        raise LeakError(f"{say_seen(seen)} had a part in the detector (its manifest); test on others.")
    pairs = [(str(recording.label), detector.diagnose(recording)) for recording in labeled]
    return alarm_scores(pairs, detector.error_rate)


def alarm_scores(pairs: Iterable[tuple[str, AnomalyVerdict]], error_rate: float) -> AlarmScores:
    """Alarms by class of (label, verdict) pairs of one machine's detector."""
    by_class: dict[str, list[AnomalyVerdict]] = {}
    healthy_label = ""
    for label, verdict in pairs:
        if is_healthy(label):
            healthy_label = label = healthy_label or label
        by_class.setdefault(label, []).append(verdict)
    scores = {
        label: [verdict.deviation.score for verdict in verdicts if verdict.deviation is not None]
        for label, verdicts in by_class.items()
    }
    healthy = scores.get(healthy_label, [])
    classes = [
        ClassAlarms(
            label,
            len(scores[label]),
            len(verdicts) - len(scores[label]),
            sum(verdict.alarm is True for verdict in verdicts),
            math.nan if label == healthy_label else _auroc(healthy, scores[label]),
        )
        for label, verdicts in by_class.items()
    ]
    return AlarmScores(error_rate, tuple(sorted(classes, key=lambda item: (item.label != healthy_label, item.label))))


def _auroc(healthy: list[float], faulty: list[float]) -> float:
    if not healthy or not faulty:
        return math.nan
    return float(roc_auc_score([False] * len(healthy) + [True] * len(faulty), healthy + faulty))
