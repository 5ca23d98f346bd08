"""Recordings in HDF5 files of swashtwin itself: one in a file, or many in a store."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path

from swashtwin.foundation import (
    ArtifactError,
    DataError,
    InputError,
    atomic_write,
    require_disk_space,
)
from swashtwin.recordings.formats.isolation import read_in_subprocess
from swashtwin.recordings.formats.raw_file import (
    STORE_KIND,
    RawFile,
    ReadOptions,
    require_plausible_rates,
)
from swashtwin.recordings.recording import Recording, require_unique_ids
from swashtwin.recordings.samples import Columns, Samples

HDF5_SUFFIXES = (".h5", ".hdf5")
_SIGNATURE = b"\x89HDF\r\n\x1a\n"

# Bytes at the beginning of a store that hold its format name.
_MAX_HEADER_BYTES = 1 << 16


def write_store(
    recordings: Iterable[Recording],
    path: str | Path,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Write recordings into one file, in their order, and return its path.

    Samples are copied block by block in the number type of their file, with the factor that makes
    them the recording's unit, so that memory holds one block at a time. Resampled ones are written
    in double precision. The previous file stays until the new one is complete.

    Parameters
    ----------
    recordings : in memory or in their files.
    path : file to write, ``.h5`` or ``.hdf5``.
    progress : called with the megabytes that are written, and of all.

    Raises
    ------
    InputError
        Another suffix, two recordings of one id, or too little space on the disk.
    DataError
        There is no recording, or a file is damaged.
    """
    from swashtwin.recordings.formats.hdf5 import write_many

    path = Path(path)
    if path.suffix.lower() not in HDF5_SUFFIXES:
        raise InputError(f"{path} must end in .h5 or .hdf5: a store is an HDF5 file.")
    recordings = recordings if isinstance(recordings, Sequence) else list(recordings)
    if not recordings:
        raise DataError("There is no recording to store.")
    require_unique_ids((recording.recording_id for recording in recordings), "a store")

    sizes = [
        recording.samples.dtype.itemsize * recording.n_channels * recording.n_samples
        for recording in recordings
    ]
    total_bytes = sum(sizes)
    path.parent.mkdir(parents=True, exist_ok=True)
    require_disk_space(path.parent, 1, total_bytes)

    written_bytes = 0

    def report_written(count: int) -> None:
        nonlocal written_bytes
        written_bytes += count
        if progress:
            progress(written_bytes // 1_000_000, total_bytes // 1_000_000)

    with atomic_write(path) as temporary:
        write_many(list(recordings), temporary, report_written)
    return path


def load_store(path: Path) -> list[Recording]:
    """Return every recording of a store."""
    try:
        contents = read_in_subprocess("hdf5", path, ReadOptions(), "read_store")
        return [_recording_from_raw(path, raw) for raw in contents.values()]
    except ArtifactError:
        raise
    except InputError as cause:
        raise ArtifactError(f"{path} is damaged: {cause}") from cause
    except DataError as cause:
        raise ArtifactError(str(cause)) from cause


def load_written_recording(path: Path) -> Recording:
    """Return the recording of a file that swashtwin wrote; its samples stay in the file."""
    return _recording_from_raw(path, read_in_subprocess("hdf5", path, ReadOptions())[""])


def is_store(path: Path) -> bool:
    """Return whether a file is a store, of any version, even if damaged."""
    if path.suffix.lower() not in HDF5_SUFFIXES or not path.is_file():
        return False

    with path.open("rb") as file:
        header = file.read(_MAX_HEADER_BYTES)
    return header.startswith(_SIGNATURE) and STORE_KIND.encode() in header


def _recording_from_raw(path: Path, raw: RawFile) -> Recording:
    facts = raw.facts
    if "recording_id" not in facts or raw.sample_rate is None:
        raise DataError(f"{path} is not a recording of swashtwin.")
    require_plausible_rates(path, raw)

    name = facts["recording_id"]
    columns = Columns(
        channels=tuple(raw.columns.values()),
        factors=tuple(facts["factors"]),
        speed=raw.speeds,
        hashes=tuple(facts["hashes"]),
    )
    return Recording(
        samples=Samples.from_columns(
            name, columns, partial(_return_columns, columns), path.resolve()
        ),
        sample_rate=raw.sample_rate,
        recording_id=name,
        channels=tuple(facts["channels"]),
        unit=facts["unit"],
        label=facts["label"],
        condition=raw.condition,
        specimen=facts["specimen"],
        synthetic=facts["synthetic"],
        attributes=raw.attributes,
    )


def _return_columns(columns: Columns) -> Columns:
    """Return columns that need no opening: each reads from the file when it is sliced."""
    return columns
