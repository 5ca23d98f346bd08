"""Runs: one training and its tests, or one case of a study; each is a dict, kept in a file as soon
as it is done.

A task's key is a hash of everything that decides its result: seed, settings and the data
themselves. So a re-run finds what is done, whatever else was changed meanwhile, and an interruption
loses the running tasks only. The files are JSON (with NaN as Python writes it); no change of the
code deletes them.
"""

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import Any

import torch
from joblib import delayed

from swashtwin.foundation import (
    ArtifactError,
    InputError,
    keep_freed_memory,
    parallel,
    read_text,
    write_text,
)
from swashtwin.recordings import Recording

FORMAT = "swashtwin run 3"
"""Of a run's file and of its key; changes whenever the same settings would give another result."""

Run = Mapping[str, Any]
"""A finished task: what names it, as `Task` does, and what came out."""

Progress = Callable[[str, int, int], None]
"""Called with (activity, finished, in all)."""


@dataclass(frozen=True)
class Task:
    """What is to be done once."""

    study: str
    """Study it belongs to, such as ``"case1"``."""
    seed: int
    """Seed of all that is drawn."""
    factors: Mapping[str, str]
    """What names its rows, such as training set and classifier."""
    settings: Mapping[str, Any]
    """Everything that decides its result, as JSON can hold it."""
    data: str
    """SHA-256 of the recordings (`fingerprint_recordings`), or what they are in words."""
    size: str = ""
    """Name of the study's settings, such as ``"quick"``; no part of the key, which holds the
    settings themselves.
    """

    @property
    def key(self) -> str:
        """Name of its folder: seed and factors to be read, and the hash that counts."""
        parts = [FORMAT, self.study, self.seed, dict(self.factors), dict(self.settings), self.data]
        digest = hashlib.sha256(
            json.dumps(parts, sort_keys=True, default=str).encode()
        ).hexdigest()[:16]
        words = "-".join(
            "".join(c if c.isalnum() else "_" for c in word) for word in self.factors.values()
        )
        return f"seed{self.seed}-{words[:80]}-{digest}"

    def folder(self, out: Path) -> Path:
        """Where its files lie under `out`."""
        return Path(out) / self.study / self.key

    def is_finished(self, out: Path | None) -> bool:
        """Whether its result lies under `out`."""
        return out is not None and (self.folder(out) / "result.json").is_file()

    def run(self, out: Path | None, compute: Callable[[], Mapping[str, Any]]) -> dict[str, Any]:
        """Its run: read from ``OUT/STUDY/KEY/result.json`` where it lies there, else computed and
        written there.

        Parameters
        ----------
        out : folder of the studies; None writes nothing.
        compute : gives what came out, as JSON can hold it.

        Raises
        ------
        ArtifactError
            The file is damaged, or of another version.
        """
        if out is not None and self.is_finished(out):
            return load_run(self.folder(out))
        run = {"format": FORMAT, "key": self.key, **asdict(self), **compute()}
        if out is not None:
            text = json.dumps(run, indent=1, ensure_ascii=False, default=str) + "\n"
            write_text(self.folder(out) / "result.json", text)
        return run


def load_run(folder: Path) -> dict[str, Any]:
    """The run whose ``result.json`` lies in `folder`.

    Raises
    ------
    ArtifactError
        The file is damaged, lies in another task's folder, or is of another version.
    """
    path = Path(folder) / "result.json"
    try:
        run: dict[str, Any] = json.loads(read_text(path))
        form, key = run["format"], run["key"]
    except (OSError, ValueError, KeyError, TypeError) as cause:
        raise ArtifactError(
            f"{path} is damaged ({type(cause).__name__}); delete its folder to run the task again."
        ) from cause
    if form != FORMAT:
        raise ArtifactError(
            f"{path} has the format {form!r}, this version reads {FORMAT!r}; delete its folder to run the task anew."
        )
    if key != Path(folder).name:
        raise ArtifactError(
            f"{path} is another task's than its folder's; delete the folder to run the task again."
        )
    return run


def fingerprint_recordings(recordings: Iterable[Recording]) -> str:
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


def _silent(activity: str, finished: int, total: int) -> None:
    pass


@dataclass(frozen=True)
class Work:
    """Under which seeds a study runs, on how many processes, and what it keeps."""

    seeds: Sequence[int] = (0,)
    """Seeds; on the virtual rig each is a fleet."""
    jobs: int = 1
    """Tasks side by side."""
    out: Path | None = None
    """Folder of finished tasks, which a later run reads; None writes nothing."""
    progress: Progress = field(default=_silent)
    """Called with (activity, finished, in all)."""
    device: str = "cpu"
    """Where networks are trained."""
    command: str = ""
    """Command line that repeats the study."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "seeds", tuple(dict.fromkeys(self.seeds)))
        if not self.seeds:
            raise InputError("a study needs a seed; one is enough.")

    def map(
        self, activity: str, function: Callable[..., Any], cases: Sequence[tuple[Any, ...]]
    ) -> list[Any]:
        """Result of `function` for the arguments of each case, in their order, `jobs` of them side
        by side.

        Parameters
        ----------
        activity : what is done, for `progress`.
        """
        results = []
        for result in parallel(self.jobs, return_as="generator")(
            delayed(_on_one_thread)(function, *c) for c in cases
        ):
            results.append(result)
            self.progress(activity, len(results), len(cases))
        return results


def _on_one_thread(function: Callable[..., Any], *arguments: Any) -> Any:
    torch.set_num_threads(1)
    keep_freed_memory()  # a training asks for the same large tensors in each step
    return function(*arguments)
