"""Where a seed's recordings come from: the same ones for every seed, or a fleet of the virtual rig for each."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol, runtime_checkable

from swashtwin.foundation import DataError
from swashtwin.recordings import Recording, load_recordings
from swashtwin_bench.results.runs import fingerprint_of
from swashtwin_bench.rigs.writing import RIG_VERSION, SIZES, RigSize, build_rig


@runtime_checkable
class Source(Protocol):
    """Recordings for each seed."""

    def recordings_for(self, seed: int) -> tuple[Sequence[Recording], str]:
        """(recordings of a seed, their SHA-256)."""
        ...


@dataclass(frozen=True, eq=False)
class SameRecordings:
    """The same recordings under every seed, which then draws the split anew."""

    recordings: Sequence[Recording]
    """The recordings."""

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of them."""
        return fingerprint_of(self.recordings)

    def recordings_for(self, seed: int) -> tuple[Sequence[Recording], str]:
        """The recordings, whatever the seed."""
        return self.recordings, self.fingerprint


@dataclass(frozen=True, eq=False)
class Fleets:
    """A fleet of the virtual rig for each seed, built once and kept."""

    folder: Path
    """Where they lie, as ``rig-SIZE-SEED``, or ``rigVERSION-SIZE-SEED`` where the version is not 1."""
    size: str = "small"
    """Name in `rig.SIZES`."""
    version: str = RIG_VERSION
    """Name in `rig.VERSIONS`."""
    jobs: int = 1
    """Processes that build one."""
    progress: Callable[[int, int], None] | None = None
    """Called with recordings built and in all."""

    def recordings_for(self, seed: int) -> tuple[Sequence[Recording], str]:
        """The fleet of that seed, of which is built what does not lie there yet."""
        name = "rig" if self.version == RIG_VERSION else f"rig{self.version}"
        folder = Path(self.folder) / f"{name}-{self.size}-{seed}"
        if not (folder / "recordings.toml").is_file():
            build_rig(folder, seed=seed, size=self.size, version=self.version, jobs=self.jobs, progress=self.progress)
        recordings = list(load_recordings(folder))
        require_rig(folder, recordings, SIZES[self.size], self.version)
        return recordings, fingerprint_of(recordings)


def require_rig(folder: Path, recordings: Sequence[Recording], size: RigSize, version: str = RIG_VERSION) -> None:
    """Refuse a folder that holds other recordings than a whole rig of that size and version.

    Raises
    ------
    DataError
        It does.
    """
    origin = recordings[0].attributes.get("origin", "")
    is_whole = len(recordings) == size.specimens * size.repeats * 15
    if not (origin.endswith(f"version {version}") and is_whole):
        raise DataError(f"{folder} holds other recordings than this rig; delete it, or name another --out.")
