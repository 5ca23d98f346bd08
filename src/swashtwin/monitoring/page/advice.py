"""What to check at a machine, by its alarm or by one of its recordings."""

from collections.abc import Mapping, Sequence
from typing import Any

from swashtwin.diagnosis import Check, next_checks
from swashtwin.monitoring.history.schema import Alarm, Judgment
from swashtwin.pump import is_healthy

# Verdicts of a model that name no fault.
_UNNAMED_CLASSES = ("abnormal", "unknown")


def suspected_label(evidence: Mapping[str, Any]) -> str | None:
    """Return the class that an alarm or a recording suspects, sure or not; `None` without one.

    Parameters
    ----------
    evidence : `Alarm.evidence` or `Judgment.reasons`.
    """
    suspect = evidence.get("suspect")
    if not suspect or suspect["certainty"] not in ("sure", "unsure"):
        return None
    label: str = suspect["label"]
    return label


def checks_of_alarm(alarm: Alarm, newest: Judgment | None) -> Sequence[Check]:
    """Return what to check at a machine with an alarm of its pump, in this order.

    Parameters
    ----------
    newest : newest recording of the machine; the verdict of a model counts if the alarm names no
        suspect.
    """
    label = suspected_label(alarm.evidence)
    if label is None and newest is not None and not is_healthy(newest.label):
        label = newest.label
    if label is None or label in _UNNAMED_CLASSES:
        return next_checks(unknown=True)
    return next_checks(label)


def checks_of_recording(judgment: Judgment) -> Sequence[Check]:
    """Return what to check at a machine after one of its recordings, in this order."""
    suspect = suspected_label(judgment.reasons)
    if judgment.label is None and suspect is not None:
        return next_checks(suspect)
    if judgment.label in (None, "abnormal"):
        return next_checks(unknown=True)

    is_unknown = bool(judgment.reasons["verdict"].get("unknown"))
    return next_checks(judgment.label, unknown=is_unknown)
