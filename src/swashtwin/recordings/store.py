"""A store: one HDF5 file of many recordings, in chunks, each with its facts as attributes."""

import json
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from swashtwin.foundation import ArtifactError, DataError, InputError, replacing, require_disk_space
from swashtwin.recordings.columns import BLOCK
from swashtwin.recordings.formats.hdf5_kinds import SIGNATURE, STORE_FORMAT, STORE_KIND
from swashtwin.recordings.formats.lossless import read_headers
from swashtwin.recordings.recording import Recording, require_distinct

if TYPE_CHECKING:
    import h5py

    from swashtwin.recordings.formats.hdf5_writer import PatientFile

_SUFFIXES = (".h5", ".hdf5")


def write_store(
    recordings: Iterable[Recording], path: str | Path, *, progress: Callable[[int, int], None] | None = None
) -> Path:
    """Path of the store that now holds the recordings, in their order.

    Samples are copied block by block in the number type of their file, with the factor that makes them the recording's
    unit beside them, so nothing is rounded and no recording is ever whole in memory. The old file stays as it is until
    the new one is complete. The groups ``000000``, ``000001``, ... each hold ``signal`` (channel by time) and, where it
    was measured, ``speed`` [rad/s]; the attributes are ``sample_rate`` [Hz], ``unit``, ``channels``, ``factor``,
    ``recording_id``, ``label``, ``specimen``, ``synthetic``, ``condition.*`` (SI) and ``attributes``, which holds all
    else as JSON, the groups of a split and a speed without a pressure among it.

    Parameters
    ----------
    recordings : in memory or in their files.
    path : file to write, ``.h5`` or ``.hdf5``.
    progress : called with megabytes written and in all.

    Raises
    ------
    InputError
        Another suffix, two recordings of one id, or too little space on the disk.
    DataError
        There is no recording, or a file is damaged.
    """
    import h5py

    from swashtwin.recordings.formats.hdf5_writer import LAYOUT, PatientFile

    path = Path(path)
    if path.suffix.lower() not in _SUFFIXES:
        raise InputError(f"{path} must end in .h5 or .hdf5: a store is an HDF5 file.")
    recordings = recordings if isinstance(recordings, Sequence) else list(recordings)
    if not recordings:
        raise DataError("no recording to store.")
    require_distinct((recording.recording_id for recording in recordings), "a store")
    size = sum(recording.sample_type.itemsize * recording.n_channels * recording.n_samples for recording in recordings)
    path.parent.mkdir(parents=True, exist_ok=True)
    require_disk_space(path.parent, 1, size)
    counter = _ByteCounter(size, progress)
    with replacing(path) as partial_file, partial_file.open("wb+", buffering=0) as file:
        target = PatientFile(file)
        with h5py.File(target, "w", libver=LAYOUT) as store:
            store.attrs["format"] = np.bytes_(STORE_FORMAT.encode())
            for number, recording in enumerate(recordings):
                _write(recording, store.create_group(f"{number:06d}"), target, counter)
        if target.error is not None:
            raise target.error
    return path


def stored_recordings(path: Path) -> list[Recording]:
    """Every recording of a store.

    Raises
    ------
    ArtifactError
        The file is damaged or of another version.
    """
    try:
        return read_headers(path)
    except ArtifactError:
        raise
    except DataError as cause:
        raise ArtifactError(str(cause)) from cause


def is_store(path: Path) -> bool:
    """Whether a file is a store, damaged or of another version or not."""
    if path.suffix.lower() not in _SUFFIXES or not path.is_file():
        return False
    with path.open("rb") as file:
        if file.read(9)[:8] != SIGNATURE:
            return False
        file.seek(0)
        return STORE_KIND.encode() in file.read(1 << 16)


class _ByteCounter:
    """Bytes that are written, reported as progress."""

    def __init__(self, total: int, progress: Callable[[int, int], None] | None) -> None:
        self._total = total
        self._written = 0
        self._progress = progress

    def add(self, count: int) -> None:
        self._written += count
        if self._progress:
            self._progress(self._written // 1_000_000, self._total // 1_000_000)


def _write(recording: Recording, group: "h5py.Group", target: "PatientFile", counter: _ByteCounter) -> None:
    from swashtwin.recordings.formats.hdf5_writer import CHUNK, write_facts

    count = recording.n_samples
    shape, chunk = (recording.n_channels, count), (recording.n_channels, min(CHUNK, count))
    signal = group.create_dataset("signal", shape, recording.sample_type, chunks=chunk, fletcher32=True)
    speed = None
    if recording.has_speed:
        speed = group.create_dataset("speed", (count,), np.float64, chunks=(chunk[1],), fletcher32=True)
    for start in range(0, count, BLOCK):
        if target.error is not None:
            raise target.error
        block = recording.raw(start, start + BLOCK)
        signal[:, start : start + BLOCK] = block
        if speed is not None:
            speed[start : start + BLOCK] = recording.speed_part(start, start + BLOCK)
        counter.add(block.nbytes)
    write_facts(group, recording)
    group.attrs["factor"] = np.array(recording.factors)
    if hashes := recording.samples.original_hashes():
        group.attrs["hashes"] = np.bytes_(json.dumps(hashes).encode())
