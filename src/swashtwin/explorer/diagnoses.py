"""Verdicts of one model on the recordings of a workspace, with their evidence."""

import tempfile
from collections import OrderedDict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fastapi import Body

from swashtwin.explorer.excerpts import describe_excerpts, excerpts
from swashtwin.explorer.workspace import Name, RecordingVersion, Workspace
from swashtwin.foundation import (
    DataError,
    InputError,
    PressureUnit,
    SwashTwinError,
    convert_pressures,
    plural,
    to_table,
)

if TYPE_CHECKING:
    from swashtwin.diagnosis import AnomalyDetector, Diagnosis, FaultClassifier, PriorClassifier
    from swashtwin.recordings import Recording

    Model = AnomalyDetector | FaultClassifier | PriorClassifier

PRIOR = "25scy14-1b"
"""Design whose prior is shipped."""
MARKED_BANDS = 8
"""Bands of the evidence that are marked in the spectrum; more would hide it."""
_MAX_CACHED_ANSWERS = 64

Content = Annotated[bytes, Body(media_type="application/octet-stream")]


class Diagnoses:
    """Verdicts of one model on the recordings of a workspace.

    Parameters
    ----------
    model : file of the model; `None` until one is dropped on the page. A prior is adapted to the
        healthy recordings.
    pressure_unit : unit in which pressures are shown.
    """

    def __init__(
        self, workspace: Workspace, model: Path | None, pressure_unit: PressureUnit = "MPa"
    ) -> None:
        self._workspace = workspace
        self._pressure_unit = pressure_unit
        self._answers: OrderedDict[RecordingVersion, dict[str, Any]] = OrderedDict()
        self._model: Model | None = None
        # A prior before it was adapted, its name, and its healthy recordings.
        self._prior: PriorClassifier | None = None
        self._prior_name = ""
        self._healthy: list[RecordingVersion] = []
        self.name = ""
        if model is not None:
            self._load(model, model.name)

    def _load(self, path: Path, name: str) -> None:
        from swashtwin.diagnosis import PriorClassifier, load_model

        model = load_model(path)
        if isinstance(model, PriorClassifier) and not model.specimen:
            self._adapt(model, name)
        else:
            self._model = model
            self._prior = None
            self.name = name
            self._answers.clear()

    def _adapt(self, prior: "PriorClassifier", name: str) -> None:
        """Diagnose with a prior of this name that is adapted to the healthy recordings."""
        versions = self._workspace.healthy_versions()
        recordings = []
        for version in versions:
            try:
                recording = self._workspace.recording(version.name).unloaded()
            except (SwashTwinError, OSError):
                continue  # the table reports why it cannot be opened
            recordings.append(excerpts(recording, 1)[0])

        if not recordings:
            raise DataError(
                "The prior needs healthy recordings of the machine, and there are none. Assign the "
                "class 'normal' to those that are healthy."
            )
        self._model = prior.fit(recordings)
        self._prior = prior
        self._prior_name = name
        self._healthy = versions
        self.name = f"{name}, adapted to {plural(len(recordings), 'healthy recording')} here"
        self._answers.clear()

    def _renew_adaptation(self) -> None:
        """Adapt a prior again if the healthy recordings, or their facts or files, changed."""
        if self._prior is not None and self._healthy != self._workspace.healthy_versions():
            self._adapt(self._prior, self._prior_name)

    def model(self) -> dict[str, Any]:
        """Return the model's name."""
        return {"model": self.name}

    def load_prior(self) -> dict[str, Any]:
        """Load the shipped pump prior, adapted to the healthy recordings."""
        self._load(Path(PRIOR), f"prior of {PRIOR}")
        return self.model()

    def drop(self, content: Content, name: Name) -> dict[str, Any]:
        """Load a model that was dropped on the page; it is kept in memory only.

        Raises
        ------
        ArtifactError
            The file is not a model, or is damaged.
        """
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "model.safetensors"
            path.write_bytes(content)
            try:
                self._load(path, name)
            except SwashTwinError as cause:
                # The reader knows the name of the dropped file, not of our copy.
                raise type(cause)(str(cause).replace(str(path), name)) from None
        return self.model()

    def diagnosis(self, name: Name) -> dict[str, Any]:
        """Return the verdict on a recording, its uncertainty, and its evidence."""
        self._renew_adaptation()
        if self._model is None:
            raise InputError(
                "There is no model yet.",
                field="model",
                remedy="Drop one on the page, or start with {model='MODEL'}.",
            )

        key = self._workspace.version(name)
        if key not in self._answers:
            recording = self._workspace.recording(name)
            self._answers[key] = self._diagnose(self._model, recording)
            while len(self._answers) > _MAX_CACHED_ANSWERS:
                self._answers.popitem(last=False)
        return {"model": self.name, **self._answers[key]}

    def _diagnose(self, model: "Model", recording: "Recording") -> dict[str, Any]:
        from swashtwin.diagnosis import next_checks

        parts = excerpts(recording, 1)
        verdict = model.diagnose(parts[0])
        notes = list(verdict.notes)
        if source := describe_excerpts(parts, recording):
            notes.insert(0, f"The verdict is on {source}.")

        labels = verdict.candidates[:2]
        spectrum_sentence = ""
        if verdict.spectrum is not None:
            spectrum_sentence = verdict.spectrum.sentence()
        return {
            **verdict.to_dict(),
            "sentence": self._in_unit(verdict.sentence()),
            "checks": to_table(next_checks(*labels, unknown=verdict.unknown)),
            "spectrum": self._in_unit(spectrum_sentence),
            "notes": [self._in_unit(note) for note in notes],
            **self._evidence(model, parts[0], verdict),
        }

    def _in_unit(self, text: str) -> str:
        return convert_pressures(text, self._pressure_unit)

    def _evidence(
        self, model: "Model", recording: "Recording", verdict: "Diagnosis"
    ) -> dict[str, Any]:
        """Return bands [Hz] that support the verdict, and the nearest training recordings."""
        from swashtwin.diagnosis import FaultClassifier, explain

        content: dict[str, Any] = {
            "bands": [],
            "nearest": [],
            "evidence": [change.sentence for change in verdict.changes],
        }
        if verdict.label is None or not isinstance(model, FaultClassifier):
            return content

        fitted = model.fitted_
        if not fitted.network.has_gradients or len(verdict.probabilities) < 2:
            return content

        evidence = explain(fitted, recording, verdict)
        names = {
            candidate.recording_id: name for name, candidate in self._workspace.ready_recordings()
        }
        return {
            "evidence": evidence.sentences(),
            "nearest": [
                {**to_table(neighbor), "name": names.get(neighbor.recording_id)}
                for neighbor in evidence.nearest
            ],
            "bands": [
                {
                    "channel": channel,
                    "description": evidence.describe(band),
                    "low": band.low,
                    "high": band.high,
                }
                for channel, band, _ in evidence.strongest(MARKED_BANDS)
                if band.part == "signal"
            ],
        }
