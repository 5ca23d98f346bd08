"""NumPy archives of arrays."""

from pathlib import Path
from zipfile import ZipFile

import numpy as np

from swashtwin.foundation import require_memory
from swashtwin.recordings.formats.clock import timed
from swashtwin.recordings.formats.mat import sorted_variables
from swashtwin.recordings.formats.raw import Options, RawFile
from swashtwin.recordings.recording import Recording


def read(path: Path, options: Options) -> RawFile:
    """Vectors of an archive as columns, its single numbers and texts as attributes; an array of objects is refused."""
    with ZipFile(path) as members:
        require_memory(path, 2 * sum(member.file_size for member in members.infolist()))
    with np.load(path, allow_pickle=False) as archive:
        raw = sorted_variables(path, [(name, archive[name]) for name in archive.files], options)
    return timed(path, raw, options)


def write(recording: Recording, path: Path) -> None:
    """Write ``signal`` (time by channel), ``sample_rate``, ``unit`` and ``channels``."""
    with path.open("wb") as file:
        np.savez_compressed(
            file,
            allow_pickle=False,
            signal=recording.signal.T,
            sample_rate=recording.sample_rate,
            unit=recording.unit,
            channels=np.array(recording.channels),
        )
