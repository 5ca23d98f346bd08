"""A library of changes: how faults of other machines changed their vibration.

It holds numbers and no waveforms, so that plants and makers can share it. `measure_library` makes
one of recordings, `join_libraries` joins several, and `weigh_library` decides how much a machine's
classifier learns from it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from jaxtyping import Float64

from swashtwin.foundation import DataError, InputError, load_artifact, plural, save_artifact
from swashtwin.pump import Nameplate
from swashtwin.recordings import (
    Manifest,
    describe_copies,
    find_copies,
    is_store,
    join_manifests,
)

_VERSION = 1


@dataclass(frozen=True, eq=False)
class LibraryPump:
    """Changes of one machine's recordings against its own healthy ones [log10 of the power].

    The bands are those of `signals.OrderBands` for the machine's number of pistons. A band beyond
    half the sample rate is NaN.
    """

    name: str
    """Machine."""
    nameplate: Nameplate
    """Its number of pistons, displacement, rated speed and rated pressure, for readers of
    ``model library --json``; `weigh_library` compares healthy spectra instead."""
    channels: tuple[str, ...]
    """Names of its sensors."""
    spectrum: Float64[np.ndarray, "channel band"]
    """Mean band powers of its healthy recordings [log10 of the squared unit]."""
    healthy: Float64[np.ndarray, "healthy channel band"]
    """Changes of its healthy recordings among each other, as `PriorClassifier.healthy_changes`;
    their root mean square is its scatter."""
    change: Float64[np.ndarray, "recording channel band"]
    """Change of each recording of a fault."""
    label: tuple[str, ...]
    """Its fault."""
    severity: tuple[str, ...]
    """Its severity, as the attribute `severity` of the recording specifies it; may be empty. For
    readers of ``model library --json``; it does not count in `weigh_library`."""
    manifest: Manifest
    """All recordings, by id and content."""

    def __post_init__(self) -> None:
        n_recordings = len(self.change)
        n_channels = len(self.channels)
        is_paired = len(self.label) == len(self.severity) == n_recordings
        shapes = {self.spectrum.shape, self.healthy.shape[1:], self.change.shape[1:]}
        if not is_paired or len(shapes) != 1 or len(self.spectrum) != n_channels:
            raise InputError(f"the recordings of {self.name!r} do not fit its faults and channels.")
        for values in (self.spectrum, self.healthy, self.change):
            if np.isinf(values).any():
                raise InputError(f"a band power of {self.name!r} is infinite.")


@dataclass(frozen=True, eq=False)
class ChangeLibrary:
    """Changes by measured faults of several machines."""

    KIND: ClassVar[str] = "change library"
    """Kind of its file."""

    pumps: tuple[LibraryPump, ...]
    """Its machines."""

    def __post_init__(self) -> None:
        if not self.pumps:
            raise InputError("a library needs at least one machine.")

    def __repr__(self) -> str:
        n_faults = sum(len(pump.label) for pump in self.pumps)
        machines = plural(len(self.pumps), "machine")
        return f"<ChangeLibrary: {plural(n_faults, 'recording')} of faults of {machines}>"

    @property
    def manifest(self) -> Manifest:
        """All recordings of all machines, by id and content."""
        return join_manifests([pump.manifest for pump in self.pumps])

    def save(self, path: Path | str) -> Path:
        """Write the library to `path` as a complete file and return the path."""
        return save_artifact(path, self.KIND, _VERSION, self, may_be_nan=None)

    @classmethod
    def load(cls, path: Path | str) -> "ChangeLibrary":
        """Return the library that `save` wrote. No code of the file is executed.

        Errors: see `load_model`.
        """
        if _is_index(Path(path)):
            raise InputError(
                f"{path} is an index of recordings, not a library; make a library of it first with "
                "swashtwin model library."
            )
        advice = "make it with swashtwin model library"
        return load_artifact(path, cls, cls.KIND, _VERSION, advice=advice, may_be_nan=None)


def _is_index(path: Path) -> bool:
    if path.is_dir():
        return True
    return path.is_file() and (path.suffix == ".toml" or is_store(path))


def join_libraries(libraries: Sequence[ChangeLibrary]) -> ChangeLibrary:
    """Return one library of several. Machines of different libraries may have the same name.

    Raises
    ------
    DataError
        Two machines have the same recording.
    """
    pumps: list[LibraryPump] = []
    for library in libraries:
        for pump in library.pumps:
            previous = join_manifests([other.manifest for other in pumps])
            copies = find_copies(previous, pump.manifest)
            if copies:
                raise DataError(
                    f"The libraries hold a recording twice ({describe_copies(copies)}), here of "
                    f"the machine {pump.name}. Each machine must be in one library only."
                )
            pumps.append(pump)
    return ChangeLibrary(tuple(pumps))
