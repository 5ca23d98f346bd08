"""The models of the machines: loaded once, with a fingerprint that the history keeps beside each verdict."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swashtwin.foundation import SwashTwinError, sha256_of
from swashtwin.monitoring.config import Machine
from swashtwin.recordings import Recording

if TYPE_CHECKING:
    from swashtwin.diagnosis import AnomalyDetector, AnomalyVerdict, Diagnosis
    from swashtwin.learning import FittedClassifier

_DIGITS = 16
"""Hexadecimal digits of a fingerprint."""


@dataclass(frozen=True)
class Verdict:
    """What a model says of a recording, as the history keeps it."""

    model: str | None = None
    """Fingerprint of the model; None where the machine has none."""
    label: str | None = None
    """Likeliest class, or ``normal`` and ``abnormal`` of a detector; None without a verdict."""
    probability: float | None = None
    """Probability of the class; of a detector its p-value."""
    confidence: float | None = None
    """Share of the windows that say the same."""
    ood_p: float | None = None
    """Chance that a recording like those of the training is as strange."""
    answer: dict[str, Any] | None = None
    """The whole answer, as JSON can hold it."""
    note: str | None = None
    """Why there is no verdict, where a machine has a model."""

    @property
    def probabilities(self) -> dict[str, float]:
        """Probability of each class; none of a detector."""
        return dict((self.answer or {}).get("probabilities", {}))

    @property
    def is_unknown(self) -> bool:
        """Whether the recording does not resemble those of the training."""
        return bool(((self.answer or {}).get("trust") or {}).get("unknown"))


class Models:
    """Models of machines by path, each loaded when it is first needed."""

    def __init__(self) -> None:
        self._models: dict[Path, tuple[FittedClassifier | AnomalyDetector, str] | str] = {}

    def diagnose(self, machine: Machine, recording: Recording) -> Verdict:
        """Verdict of the machine's model; one without label where there is no model, or none that fits."""
        if machine.model is None:
            return Verdict()
        model = self._model(machine.model)
        if isinstance(model, str):
            return Verdict(note=model)
        loaded, fingerprint = model
        try:
            return _verdict(loaded, recording, fingerprint)
        except SwashTwinError as cause:
            return Verdict(model=fingerprint, note=str(cause))

    def problem(self, machine: Machine) -> str | None:
        """Why the machine's model cannot be used; None where it can, or there is none."""
        model = None if machine.model is None else self._model(machine.model)
        return f"model of {machine.name}: {model}" if isinstance(model, str) else None

    def _model(self, path: Path) -> "tuple[FittedClassifier | AnomalyDetector, str] | str":
        if path not in self._models:
            from swashtwin.diagnosis import load_model

            try:
                self._models[path] = load_model(path), sha256_of(path)[:_DIGITS]
            except (SwashTwinError, OSError) as cause:
                self._models[path] = str(cause)
        return self._models[path]


def _verdict(model: "FittedClassifier | AnomalyDetector", recording: Recording, fingerprint: str) -> Verdict:
    from swashtwin.diagnosis import AnomalyDetector, diagnose

    if isinstance(model, AnomalyDetector):
        return _of_detector(model.diagnose(recording), fingerprint)
    return _of_classifier(diagnose(model, recording), fingerprint)


def _of_detector(verdict: "AnomalyVerdict", fingerprint: str) -> Verdict:
    answer = verdict.to_dict()
    if verdict.alarm is None:
        return Verdict(fingerprint, answer=answer, note=verdict.no_verdict)
    return Verdict(fingerprint, "abnormal" if verdict.alarm else "normal", verdict.p_value, answer=answer)


def _of_classifier(diagnosis: "Diagnosis", fingerprint: str) -> Verdict:
    answer = diagnosis.to_dict()
    if diagnosis.label is None:
        return Verdict(fingerprint, answer=answer, note=diagnosis.no_verdict)
    answer.pop("window_labels")
    trust = diagnosis.trust
    return Verdict(
        fingerprint,
        diagnosis.label,
        diagnosis.probabilities[diagnosis.label],
        diagnosis.agreement,
        None if trust is None else trust.ood_p_value,
        answer,
    )
