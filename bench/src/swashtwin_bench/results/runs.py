"""Runs: one training with its tests, or one case of a study, saved as soon as it is finished.

The key of a task is a hash of everything that decides its result: seed, settings and the data
themselves. A later run therefore reuses finished tasks whatever else has changed, and an
interruption loses only the running tasks. The files are JSON (with NaN as Python writes it).
"""

import hashlib
import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from operator import attrgetter
from pathlib import Path
from typing import Any

import torch

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
"""Format of a run's file, and part of its key; changes if equal settings give another result."""

MAX_FACTORS_LENGTH = 80
"""Characters of the factors in a folder's name; the hash alone identifies the task."""

Run = Mapping[str, Any]
"""A finished task: the fields of `Task`, and its results."""

Progress = Callable[[str, int, int], None]
"""Called with (activity, finished, total)."""


@dataclass(frozen=True)
class Task:
    """One training with its tests, or one case of a study."""

    study: str
    """Name of its study, such as ``"case1"``."""
    seed: int
    """Seed of all random draws."""
    factors: Mapping[str, str]
    """Factors of its rows, such as training set and classifier."""
    settings: Mapping[str, Any]
    """All settings that decide its result, as JSON can hold them."""
    data: str
    """SHA-256 of the recordings (`fingerprint_recordings`), or a description of them."""
    size: str = ""
    """Name of the settings, such as ``"quick"``; not in the key, which holds the settings."""

    @property
    def key(self) -> str:
        """Name of its folder: seed and factors for the reader, and a hash that identifies it."""
        contents = [
            FORMAT,
            self.study,
            self.seed,
            dict(self.factors),
            dict(self.settings),
            self.data,
        ]
        # The order of settings must not change the key.
        text = json.dumps(contents, sort_keys=True, default=str)
        digest = hashlib.sha256(text.encode()).hexdigest()[:16]

        factors = "-".join(re.sub(r"[^\w]", "_", value) for value in self.factors.values())
        return f"seed{self.seed}-{factors[:MAX_FACTORS_LENGTH]}-{digest}"

    def folder(self, out: Path) -> Path:
        """Return the folder of its files in `out`."""
        return Path(out) / self.study / self.key

    def is_finished(self, out: Path | None) -> bool:
        """Return whether its result is in `out`."""
        return out is not None and (self.folder(out) / "result.json").is_file()

    def run(self, out: Path | None, compute: Callable[[], Mapping[str, Any]]) -> dict[str, Any]:
        """Return the run, which is read from ``OUT/STUDY/KEY/result.json`` if it is finished.

        Parameters
        ----------
        out : folder of the studies; None writes nothing.
        compute : returns the results, as JSON can hold them.

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
    """Return the run whose ``result.json`` is in `folder`.

    Raises
    ------
    ArtifactError
        The file is damaged, belongs to another task, or is of another version.
    """
    path = Path(folder) / "result.json"
    try:
        run: dict[str, Any] = json.loads(read_text(path))
        file_format = run["format"]
        key = run["key"]
    # TypeError: the file holds JSON that is not an object.
    except (OSError, ValueError, KeyError, TypeError) as cause:
        raise ArtifactError(
            f"{path} is damaged ({type(cause).__name__}). Delete its folder to run the task again."
        ) from cause

    if file_format != FORMAT:
        raise ArtifactError(
            f"{path} has the format {file_format!r}; this version reads {FORMAT!r}. Delete its "
            "folder to run the task again."
        )
    if key != Path(folder).name:
        raise ArtifactError(
            f"{path} belongs to another task than its folder. Delete the folder to run the task "
            "again."
        )

    return run


def fingerprint_recordings(recordings: Iterable[Recording]) -> str:
    """Return the SHA-256 of samples and facts of recordings, independent of their order."""
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


def _show_nothing(activity: str, finished: int, total: int) -> None:
    pass


@dataclass(frozen=True)
class Work:
    """Seeds, processes, device and folder of a study."""

    seeds: Sequence[int] = (0,)
    """Seeds; on the virtual rig each is a fleet."""
    jobs: int = 1
    """Number of parallel processes, unless a cluster does the work."""
    out: Path | None = None
    """Folder of finished tasks, which a later run reuses; None writes nothing."""
    progress: Progress = field(default=_show_nothing)
    """Called with (activity, finished, total)."""
    device: str = "cpu"
    """Device on which networks are trained."""
    command: str = ""
    """Command line that repeats the study."""

    def __post_init__(self) -> None:
        # A repeated seed would count as a further trial.
        object.__setattr__(self, "seeds", tuple(dict.fromkeys(self.seeds)))
        if not self.seeds:
            raise InputError("A study needs at least one seed.")
        if self.out is not None:
            # Processes and workers of a cluster may have started in another folder.
            object.__setattr__(self, "out", self.out.absolute())

    def part(self, name: str) -> "Work":
        """Return the same work, whose progress names the part of the study that is done."""

        def show_part(activity: str, finished: int, total: int) -> None:
            self.progress(f"{name}: {activity}", finished, total)

        return replace(self, progress=show_part)

    def map(
        self, activity: str, function: Callable[..., Any], cases: Sequence[tuple[Any, ...]]
    ) -> list[Any]:
        """Return the result of `function` for the arguments of each case, in their order.

        Parameters
        ----------
        activity : name of the work, for `progress`.
        """
        calls = [(function, *arguments) for arguments in cases]

        results: list[Any] = []
        if cases:
            self.progress(activity, 0, len(cases))
        # A generator, so that progress is reported while later cases still run.
        for result in parallel(_run_on_one_thread, calls, jobs=self.jobs, folder=self.out):
            results.append(result)
            self.progress(activity, len(results), len(cases))

        return results


def _run_on_one_thread(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call `function` on one thread: the processes share the cores."""
    torch.set_num_threads(1)
    keep_freed_memory()  # a training asks for the same large tensors in each step
    return function(*arguments)
