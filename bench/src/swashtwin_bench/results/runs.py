"""One task of a study, its result, and the folder it lies in.

A task is study × seed × training set × classifier. Its key is a hash of everything that decides its result: seed,
settings and the data themselves. A finished task lies in ``OUT/STUDY/KEY/result.json``, whole or not at all; so a
re-run finds what is done, whatever else was changed meanwhile, and an interruption loses the running task only.
"""

import hashlib
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from operator import attrgetter
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from jaxtyping import Float, Shaped

from swashtwin.foundation import ArtifactError, read_text, replacing, write_text
from swashtwin.learning import Epoch, Scores
from swashtwin.recordings import Recording

FORMAT = "swashtwin run 2"
"""Of a run's file and of its key; changes whenever the same settings would give another result."""


class OtherFormatError(ArtifactError):
    """A run that another version of swashtwin wrote, whose numbers this one may not put beside its own."""


@dataclass(frozen=True)
class Task:
    """What is to be done once."""

    study: str
    """Study it belongs to, such as ``"case1"``."""
    size: str
    """Name of the study's settings, such as ``"quick"``; no part of the key, which holds the settings themselves."""
    seed: int
    """Seed of split, weights and synthesis."""
    factors: Mapping[str, str]
    """What names its rows, such as training set and classifier."""
    settings: Mapping[str, Any]
    """Everything that decides its result, as JSON can hold it: ``scenario``, ``training_set``, ``model``, ``tests``."""
    data: str
    """SHA-256 of the recordings (`fingerprint_of`)."""

    @property
    def key(self) -> str:
        """Name of its folder: seed and factors to be read, and the hash that counts."""
        parts = [FORMAT, self.study, self.seed, dict(self.factors), dict(self.settings), self.data]
        digest = hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()[:16]
        words = "-".join("".join(c if c.isalnum() else "_" for c in word) for word in self.factors.values())
        return f"seed{self.seed}-{words[:80]}-{digest}"


@dataclass(frozen=True, eq=False)
class Outcome:
    """One classifier, trained on one training set, scored on one test."""

    factors: Mapping[str, str]
    """What names its row: ``classifier``, ``training_set``, ``level``, and what else a study varies."""
    seed: int
    """Seed of split, weights and synthesis."""
    scores: Scores
    """What it scored."""
    scarce_recall: float
    """Recall of the measured windows of the cells that were scarce; NaN where the test has none."""
    repeat: int = 0
    """Which draw of the noise, where the test is noisy."""

    @property
    def classifier(self) -> str:
        """Kind of classifier: ``"bitcn"``, or a rival such as ``"extra_trees"``."""
        return self.factors["classifier"]

    @property
    def training_set(self) -> str:
        """``"measured"``, ``"nominal"``, ``"calibrated"``, or another training set."""
        return self.factors["training_set"]

    @property
    def level(self) -> str:
        """Level of generalization of the test set."""
        return self.factors["level"]


@dataclass(frozen=True, eq=False)
class Embedding:
    """Last features of the test windows, for t-SNE."""

    factors: Mapping[str, str]
    """What names the network that made them: ``classifier``, ``training_set``, and what else a study varies."""
    features: Float[np.ndarray, "window feature"]
    """Features before the last layer."""
    label: Shaped[np.ndarray, " window"]
    """True class of each window."""
    level: Shaped[np.ndarray, " window"]
    """Level of generalization of each window."""


@dataclass(frozen=True, eq=False)
class Run:
    """Result of one task."""

    task: Task
    """The task."""
    outcomes: tuple[Outcome, ...]
    """Scores on each of its tests."""
    history: tuple[Epoch, ...]
    """Loss and accuracy of each epoch; empty where nothing is trained in epochs."""
    values: Mapping[str, float]
    """Further numbers of the training set and of the training, such as the discriminator's area under the curve."""
    roles: Mapping[str, Sequence[str]]
    """Recording ids by role: ``train``, ``reference``, ``calibration``, and each level tested."""
    fingerprints: Mapping[str, str]
    """SHA-256 of the training set, and of each test set by its level."""
    cells: Mapping[str, Mapping[str, int]]
    """Windows by class and pressure in the training set, and in each test set by its level."""
    calibrations: tuple[str, ...]
    """Names of the calibrations it rests on, in ``OUT/calibrations``."""
    origin: str
    """Where the recordings come from, in words."""
    wall_s: float
    """Time of training and tests [s]."""
    cpu_s: float
    """CPU time of training and tests [s]."""
    device: str
    """What it was trained on."""
    version: str
    """Version of swashtwin."""
    command: str
    """Command that repeats the study."""
    embedding: Embedding | None = field(default=None)
    """Features of the test windows, where a network was trained."""

    def to_dict(self) -> dict[str, Any]:
        """All of it but the embedding, as JSON can hold it."""
        outcomes = [
            {
                "factors": dict(outcome.factors),
                "repeat": outcome.repeat,
                "scarce_recall": None if math.isnan(outcome.scarce_recall) else outcome.scarce_recall,
                "scores": outcome.scores.to_dict(),
            }
            for outcome in self.outcomes
        ]
        names = ("roles", "fingerprints", "cells", "calibrations", "origin", "wall_s", "cpu_s", "device", "version")
        return {
            "format": FORMAT,
            "key": self.task.key,
            "task": asdict(self.task),
            "outcomes": outcomes,
            "history": [asdict(epoch) for epoch in self.history],
            "values": {name: None if math.isnan(value) else value for name, value in self.values.items()},
            **{name: getattr(self, name) for name in (*names, "command")},
        }


def save_run(run: Run, out: Path) -> Path:
    """Folder of the run under `out`, after everything was written to it; its ``result.json`` comes last, and whole."""
    folder = Path(out) / run.task.study / run.task.key
    if run.embedding is not None:
        arrays = {name: getattr(run.embedding, name) for name in ("features", "label", "level")}
        with replacing(folder / "embedding.npz") as temporary:
            np.savez_compressed(temporary, **{**arrays, "features": run.embedding.features.astype(np.float32)})
    write_text(folder / "result.json", json.dumps(run.to_dict(), indent=1, ensure_ascii=False, allow_nan=False) + "\n")
    return folder


def load_run(folder: Path) -> Run:
    """The run that `save_run` put into `folder`.

    Raises
    ------
    ArtifactError
        The file is damaged, was edited so that its key no longer fits, or is of another version
        (`OtherFormatError`).
    """
    path = Path(folder) / "result.json"
    try:
        table = json.loads(read_text(path))
        if table["format"] != FORMAT:
            raise OtherFormatError(
                f"{path} has the format {table['format']!r}, this version reads {FORMAT!r}; delete its folder to run "
                "the task anew."
            )
        run = _run(table, Path(folder))
    except ArtifactError:
        raise
    except (OSError, ValueError, KeyError, TypeError, AttributeError, BadZipFile) as cause:
        raise ArtifactError(
            f"{path} is damaged ({type(cause).__name__}); delete its folder to run the task again."
        ) from cause
    if run.task.key != Path(folder).name or table["key"] != run.task.key:
        raise ArtifactError(
            f"{path} says other settings than its folder's name; delete the folder to run the task again."
        )
    return run


def fingerprint_of(recordings: Iterable[Recording]) -> str:
    """SHA-256 over the samples and the facts of recordings, whatever their order, hexadecimal."""
    digest = hashlib.sha256()
    for recording in sorted(recordings, key=attrgetter("recording_id")):
        facts = (
            recording.recording_id,
            recording.label,
            recording.specimen,
            repr(recording.condition),
            recording.fingerprint(),
        )
        digest.update(repr(facts).encode())
    return digest.hexdigest()


def _run(table: Mapping[str, Any], folder: Path) -> Run:
    task = Task(**{entry.name: table["task"][entry.name] for entry in fields(Task)})
    outcomes = tuple(
        Outcome(
            factors=outcome["factors"],
            seed=task.seed,
            scores=Scores.from_dict(outcome["scores"]),
            scarce_recall=math.nan if outcome["scarce_recall"] is None else outcome["scarce_recall"],
            repeat=outcome["repeat"],
        )
        for outcome in table["outcomes"]
    )
    return Run(
        task=task,
        outcomes=outcomes,
        history=tuple(Epoch(**epoch) for epoch in table["history"]),
        values={name: math.nan if value is None else value for name, value in table["values"].items()},
        calibrations=tuple(table["calibrations"]),
        embedding=_embedding(folder / "embedding.npz", task),
        **{
            name: table[name]
            for name in ("roles", "fingerprints", "cells", "origin", "wall_s", "cpu_s", "device", "version", "command")
        },
    )


def _embedding(path: Path, task: Task) -> Embedding | None:
    if not path.is_file():
        return None
    with np.load(path, allow_pickle=False) as arrays:
        features = arrays["features"].astype(np.float64)
        return Embedding(task.factors, features, arrays["label"], arrays["level"])
