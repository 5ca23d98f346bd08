"""What models say of the recordings of machines."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from swashtwin.foundation import SwashTwinError, sha256_of
from swashtwin.monitoring.config.settings import Machine
from swashtwin.recordings import Recording

if TYPE_CHECKING:
    from swashtwin.diagnosis import AnomalyDetector, FaultClassifier, PriorClassifier

    Model = FaultClassifier | AnomalyDetector | PriorClassifier


class Models:
    """Models of machines by path, each loaded when it is first needed."""

    def __init__(self) -> None:
        self._models: dict[Path, tuple[Model, str] | str] = {}

    def diagnose(self, machine: Machine, recording: Recording) -> dict[str, Any]:
        """What the machine's model says: fields of a `Judgment`, the whole ``answer``, and why there is ``no_verdict``.

        Empty where the machine has no model.
        """
        model = None if machine.model is None else self._model(machine.model)
        if model is None or isinstance(model, str):
            return {"no_verdict": model}
        loaded, fingerprint = model
        try:
            return {"model": fingerprint, **_verdict(loaded, recording)}
        except SwashTwinError as cause:
            return {"model": fingerprint, "no_verdict": str(cause)}

    def problem(self, machine: Machine) -> str | None:
        """Why the machine's model cannot be used; None where it can, or there is none."""
        model = None if machine.model is None else self._model(machine.model)
        return f"model of {machine.name}: {model}" if isinstance(model, str) else None

    def _model(self, path: Path) -> "tuple[Model, str] | str":
        if path not in self._models:
            from swashtwin.diagnosis import load_model

            try:
                self._models[path] = load_model(path), sha256_of(path)[:16]
            except (SwashTwinError, OSError) as cause:
                self._models[path] = str(cause)
        return self._models[path]


def _verdict(model: "Model", recording: Recording) -> dict[str, Any]:
    verdict = model.diagnose(recording)
    answer = verdict.to_dict()
    answer.pop("window_labels")
    if verdict.label is None:
        return {"answer": answer, "no_verdict": verdict.no_verdict}
    named = {} if verdict.unknown else {"probability": verdict.probabilities.get(verdict.label)}
    if verdict.n_windows and not verdict.unknown:
        named["confidence"] = verdict.agreement
    return {"answer": answer, "label": verdict.verdict, **named, "ood_p": verdict.p_value}
