"""Verdicts on many recordings, by several processes or a cluster."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from swashtwin.diagnosis.anomaly_detector import AnomalyDetector
from swashtwin.diagnosis.fault_classifier import FaultClassifier
from swashtwin.diagnosis.prior_classifier import PriorClassifier
from swashtwin.diagnosis.verdict import Diagnosis
from swashtwin.foundation import parallel
from swashtwin.recordings import Recording


def diagnose_recordings(
    model: FaultClassifier | AnomalyDetector | PriorClassifier,
    recordings: Sequence[Recording],
    *,
    error_rate: float | None = None,
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> list[Diagnosis]:
    """Return the diagnosis of each recording, in their order.

    The verdicts do not depend on the number of processes.

    Parameters
    ----------
    error_rate : see `diagnose` of the model; the model's own by default.
    jobs : number of processes, unless a cluster does the work (`swashtwin.foundation.parallel`).
    progress : called with the number of finished recordings, 0 at first, and the total.

    Raises
    ------
    SwashTwinError
        See `diagnose` of the model.
    ClusterError
        The cluster is gone, or a worker of it cannot do the work, such as one that does not see the
        file of a recording.
    """
    options: dict[str, Any] = {} if error_rate is None else {"error_rate": error_rate}
    results = parallel(
        partial(_diagnose, model, options),
        [(recording,) for recording in recordings],
        jobs=jobs,
        files=[recording.samples.file for recording in recordings],
    )

    if progress is not None:
        progress(0, len(recordings))
    diagnoses: list[Diagnosis] = []
    for diagnosis in results:
        diagnoses.append(diagnosis)
        if progress is not None:
            progress(len(diagnoses), len(recordings))
    return diagnoses


def _diagnose(
    model: FaultClassifier | AnomalyDetector | PriorClassifier,
    options: dict[str, Any],
    recording: Recording,
) -> Diagnosis:
    return model.diagnose(recording, **options)
