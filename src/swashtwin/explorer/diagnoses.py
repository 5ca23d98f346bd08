"""Verdicts of one model on the recordings of a workspace, with their evidence."""

import tempfile
from collections import OrderedDict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fastapi import Body

from swashtwin.explorer.workspace import Name, Workspace
from swashtwin.foundation import InputError, SwashTwinError, plural, to_table
from swashtwin.pump import is_healthy

if TYPE_CHECKING:
    from swashtwin.diagnosis import AnomalyDetector, Diagnosis, FaultClassifier, PriorClassifier
    from swashtwin.recordings import Recording


PRIOR = "25scy14-1b"
"""Design whose prior is shipped."""
Content = Annotated[bytes, Body(media_type="application/octet-stream")]
_KEPT = 64


class Diagnoses:
    """Verdicts of one model on the recordings of a workspace.

    Parameters
    ----------
    model : file of the model; None until one is dropped on the page. A prior is adapted to the
        healthy recordings.
    """

    def __init__(self, workspace: Workspace, model: Path | None) -> None:
        self._workspace = workspace
        self._answers: OrderedDict[tuple[str, str], dict[str, Any]] = OrderedDict()
        self._model: FaultClassifier | AnomalyDetector | PriorClassifier | None = None
        self.name = ""
        if model is not None:
            self._take(model, model.name)

    def _take(self, path: Path, name: str) -> None:
        from swashtwin.diagnosis import PriorClassifier, load_model

        model = load_model(path)
        if isinstance(model, PriorClassifier) and not model.specimen:
            rows = [
                row.recording
                for row in self._workspace.rows.values()
                if row.state == "ready" and row.recording
            ]
            healthy = [
                recording for recording in rows if recording.label and is_healthy(recording.label)
            ]
            model, name = (
                model.fit(healthy),
                f"{name}, adapted to {plural(len(healthy), 'healthy recording')} here",
            )
        self._model, self.name = model, name
        self._answers.clear()

    def model(self) -> dict[str, Any]:
        """The model's name."""
        return {"model": self.name}

    def take_prior(self) -> dict[str, Any]:
        """Take the shipped pump prior, adapted to the healthy recordings."""
        self._take(Path(PRIOR), f"the prior of {PRIOR}")
        return self.model()

    def drop(self, content: Content, name: Name) -> dict[str, Any]:
        """Take a model that was dropped on the page; it is kept in memory only.

        Raises
        ------
        ArtifactError
            It is no model, or a damaged one.
        """
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "model.safetensors"
            path.write_bytes(content)
            try:
                self._take(path, name)
            except SwashTwinError as cause:
                raise type(cause)(str(cause).replace(str(path), name)) from None
        return self.model()

    def diagnosis(self, name: Name) -> dict[str, Any]:
        """Verdict on a recording, how sure it is, and its evidence."""
        from swashtwin.diagnosis import next_checks

        if self._model is None:
            raise InputError(
                "there is no model yet; drop one on the page, or start with --model MODEL."
            )
        recording = self._workspace.recording(name)
        key = name, repr(self._workspace.rows[name].stated)
        if key not in self._answers:
            verdict = self._model.diagnose(recording)
            labels = verdict.prediction_set[:2] or filter(None, [verdict.label])
            checks = next_checks(*labels, unknown=verdict.unknown)
            self._answers[key] = {
                **verdict.to_dict(), "sentence": verdict.sentence(), "checks": to_table(checks),
                "spectrum": "" if verdict.spectrum is None else verdict.spectrum.sentence(),
                **self._evidence(recording, verdict),
            }  # fmt: skip
            while len(self._answers) > _KEPT:
                self._answers.popitem(last=False)
        return {"model": self.name, **self._answers[key]}

    def _evidence(self, recording: "Recording", verdict: "Diagnosis") -> dict[str, Any]:
        """Bands [Hz] that speak for the verdict, and the nearest recordings of the training."""
        from swashtwin.diagnosis import FaultClassifier, explain

        found: dict[str, Any] = {
            "bands": [],
            "nearest": [],
            "evidence": [item.sentence for item in verdict.changes],
        }
        if verdict.label is None or not isinstance(self._model, FaultClassifier):
            return found
        fitted = self._model.fitted_
        if not fitted.network.has_gradients or len(verdict.probabilities) < 2:
            return found
        evidence = explain(fitted, recording, verdict)
        rows = [row for row in self._workspace.rows.values() if row.recording is not None]
        names = {row.recording.recording_id: row.name for row in rows if row.recording is not None}
        found["evidence"] = evidence.sentences()
        found["nearest"] = [
            {**to_table(item), "name": names.get(item.recording_id)} for item in evidence.nearest
        ]
        found["bands"] = [
            {
                "channel": channel,
                "words": evidence.describe(band),
                "low": band.low,
                "high": band.high,
            }
            for channel, band, _ in evidence.strongest(8)
            if band.part == "signal"
        ]
        return found
