"""NumPy archives."""

from pathlib import Path
from zipfile import ZipFile

import numpy as np

from swashtwin.foundation import require_memory
from swashtwin.recordings.formats.clock import extract_time
from swashtwin.recordings.formats.named_arrays import sort_variables
from swashtwin.recordings.formats.raw_file import RawFile, ReadOptions
from swashtwin.recordings.recording import Recording


def read(path: Path, options: ReadOptions) -> RawFile:
    """Return the vectors of an archive as columns, and its single numbers and texts as attributes.

    An array of objects is refused: unpickling it would run code of the file.
    """
    with ZipFile(path) as archive_members:
        size = sum(member.file_size for member in archive_members.infolist())
    require_memory(path, 2 * size)  # as stored, and in double precision

    with np.load(path, allow_pickle=False) as archive:
        arrays = [(name, archive[name]) for name in archive.files]
        raw = sort_variables(path, arrays, options)
    return extract_time(path, raw, options)


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
