"""A store: one HDF5 file of many recordings, in chunks, each with what is known of it as attributes."""

from collections.abc import Callable, Iterable
from pathlib import Path

import h5py
import numpy as np

from swashtwin.foundation import ArtifactError, DataError, InputError, MissingFileError, replacing
from swashtwin.recordings.disk_space import require_room
from swashtwin.recordings.formats.hdf5 import CHUNK, LAYOUT, STORE_FORMAT, PatientFile, stored_in, write_facts
from swashtwin.recordings.formats.subprocess_reader import HDF5_SIGNATURE
from swashtwin.recordings.recording import Recording
from swashtwin.recordings.stored import BLOCK, StoredRecording, opened

_SUFFIXES = (".h5", ".hdf5")


def write_store(
    recordings: Iterable[Recording | StoredRecording],
    path: str | Path,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Path of the store that now holds the recordings, in their order.

    Readings are copied block by block in the number type of their file, with the factor that makes them the recording's
    unit beside them, so nothing is rounded and no recording is ever whole in memory. The old file stays as it is until
    the new one is complete. The groups ``000000``, ``000001``, ... each hold ``signal`` (channel by time) and, where it
    was measured, ``speed`` [rad/s]; the attributes are ``sample_rate`` [Hz], ``unit``, ``channels``, ``factor``,
    ``recording_id``, ``label``, ``specimen``, ``synthetic``, ``condition.*`` (SI) and ``attributes``, which holds all
    else as JSON, the groups of a split and a speed without a pressure among it.

    Parameters
    ----------
    recordings : in memory or opened from their files.
    path : file to write, ``.h5`` or ``.hdf5``.
    progress : called with megabytes done and in all.

    Raises
    ------
    InputError
        Another suffix, two recordings of one id, or no room on the disk.
    DataError
        There is no recording, or a file is damaged.
    """
    path = Path(path)
    if path.suffix.lower() not in _SUFFIXES:
        raise InputError(f"{path} must end in .h5 or .hdf5: a store is an HDF5 file.")
    kept = [opened(recording) for recording in recordings]
    if not kept:
        raise DataError("no recording to store.")
    ids = [recording.recording_id for recording in kept]
    twice = next((name for name in ids if ids.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"two recordings have the id {twice!r}; ids must be unique within a store.")
    sizes = [recording.raw(0, 1).nbytes * recording.n_readings for recording in kept]
    path.parent.mkdir(parents=True, exist_ok=True)
    require_room(path.parent, 1, sum(sizes))
    watch = _Watch(sum(sizes), progress)
    with replacing(path) as partial, partial.open("wb+", buffering=0) as file:
        target = PatientFile(file)
        with h5py.File(target, "w", libver=LAYOUT) as store:
            store.attrs["format"] = np.bytes_(STORE_FORMAT.encode())
            for number, recording in enumerate(kept):
                _write(recording, store.create_group(f"{number:06d}"), target, watch)
        if target.error is not None:
            raise target.error
    return path


def open_store(path: str | Path) -> list[StoredRecording]:
    """Every recording of a store, whose readings are read when asked for.

    Raises
    ------
    MissingFileError
        There is no such file.
    DataError
        The file is damaged, or no store.
    """
    path = Path(path)
    if not path.is_file():
        raise MissingFileError(f"{path} does not exist; write one with: swashtwin convert")
    if not is_store(path):
        raise DataError(f"{path} is no store of recordings; one file alone is read by read_recording.")
    try:
        file = h5py.File(path, "r", rdcc_nbytes=0)  # slices are of whole chunks, and no chunk is read twice
        return [stored_in(file[name]) for name in sorted(file)]
    except (OSError, KeyError, ValueError, TypeError, RuntimeError) as cause:
        reason = (str(cause).splitlines() or [""])[0][:160]
        raise ArtifactError(f"{path} is damaged or cut off ({type(cause).__name__}: {reason}).") from cause


def is_store(path: Path) -> bool:
    """Whether a file is a store, damaged or not."""
    if path.suffix.lower() not in _SUFFIXES or not path.is_file():
        return False
    with path.open("rb") as file:
        if file.read(9)[:8] != HDF5_SIGNATURE:
            return False
        file.seek(0)
        return STORE_FORMAT.encode() in file.read(1 << 16)


class _Watch:
    """What is done of what there is to do."""

    def __init__(self, total: int, progress: Callable[[int, int], None] | None) -> None:
        self._total = total
        self._done = 0
        self._progress = progress

    def add(self, done: int) -> None:
        self._done += done
        if self._progress:
            self._progress(self._done // 1_000_000, self._total // 1_000_000)


def _write(recording: StoredRecording, group: h5py.Group, target: PatientFile, watch: _Watch) -> None:
    readings = recording.n_readings
    kind = recording.raw(0, 1).dtype
    shape, chunk = (len(recording.columns), readings), (len(recording.columns), min(CHUNK, readings))
    signal = group.create_dataset("signal", shape, kind, chunks=chunk, fletcher32=True)
    speed = None
    if recording.speeds is not None:
        speed = group.create_dataset("speed", (readings,), np.float64, chunks=(chunk[1],), fletcher32=True)
    for start in range(0, readings, BLOCK):
        if target.error is not None:
            raise target.error
        block = recording.raw(start, start + BLOCK)
        signal[:, start : start + BLOCK] = block
        if speed is not None and recording.speeds is not None:
            speed[start : start + BLOCK] = recording.speeds[start : start + BLOCK]
        watch.add(block.nbytes)
    write_facts(group, recording.facts)
    group.attrs["factor"] = np.array(recording.factors)
