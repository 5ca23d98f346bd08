"""Recordings in our own HDF5 form: one in a file, many in a store, and many files in a folder."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from swashtwin.foundation import (
    ArtifactError,
    DataError,
    InputError,
    open_pieces,
    replacing,
    require_disk_space,
)
from swashtwin.recordings.formats.isolation import read_in_subprocess
from swashtwin.recordings.formats.raw import STORE_KIND, Options, RawFile, require_plausible_rates
from swashtwin.recordings.recording import Recording, require_distinct
from swashtwin.recordings.samples import Columns, Samples

_SUFFIXES = (".h5", ".hdf5")
_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_MANIFEST = "series.json"


def write_store(
    recordings: Iterable[Recording], path: str | Path, *, progress: Callable[[int, int], None] | None = None
) -> Path:
    """Path of the store that now holds the recordings, in their order.

    Samples are copied block by block in the number type of their file, with the factor that makes them the recording's
    unit beside them, so nothing is rounded and no recording is ever whole in memory. The old file stays as it is until
    the new one is complete.

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
    from swashtwin.recordings.formats.hdf5 import write_many

    path = Path(path)
    if path.suffix.lower() not in _SUFFIXES:
        raise InputError(f"{path} must end in .h5 or .hdf5: a store is an HDF5 file.")
    recordings = recordings if isinstance(recordings, Sequence) else list(recordings)
    if not recordings:
        raise DataError("no recording to store.")
    require_distinct((recording.recording_id for recording in recordings), "a store")
    size = sum(
        recording.samples.dtype.itemsize * recording.n_channels * recording.n_samples for recording in recordings
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    require_disk_space(path.parent, 1, size)
    done = 0

    def written(count: int) -> None:
        nonlocal done
        done += count
        if progress:
            progress(done // 1_000_000, size // 1_000_000)

    with replacing(path) as partial_file:
        write_many(list(recordings), partial_file, written)
    return path


def stored_recordings(path: Path) -> list[Recording]:
    """Every recording of a store.

    Raises
    ------
    ArtifactError
        The file is damaged or of another version.
    """
    try:
        contents = read_in_subprocess("hdf5", path, Options(), "read_store")
        return [_recording(path, raw) for raw in contents.values()]
    except ArtifactError:
        raise
    except (DataError, InputError) as cause:
        raise ArtifactError(f"{path} is damaged: {cause}" if isinstance(cause, InputError) else str(cause)) from cause


def read_header(path: Path) -> Recording:
    """Recording of a file of its own; its samples are read when they are asked for."""
    return _recording(path, read_in_subprocess("hdf5", path, Options())[""])


def is_store(path: Path) -> bool:
    """Whether a file is a store, damaged or of another version or not."""
    if path.suffix.lower() not in _SUFFIXES or not path.is_file():
        return False
    with path.open("rb") as file:
        if file.read(9)[:8] != _SIGNATURE:
            return False
        file.seek(0)
        return STORE_KIND.encode() in file.read(1 << 16)


def write_series(
    folder: str | Path,
    count: int,
    blocks_of: Callable[[int], Iterable[Recording]],
    *,
    settings: Mapping[str, Any],
    bytes_each: int,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Path, list[str]]:
    """Index of a folder of recordings, and the ids of those made now; what an earlier run left whole is kept.

    The files are ``NAME-0000.h5``, ``NAME-0001.h5``, ..., where NAME is the folder's, and each recording has the id of
    its file, which appears when it is whole.

    Parameters
    ----------
    folder : new or empty folder, or one that an earlier run with equal `settings` left; `count` may
        have grown; a smaller one leaves all that are there.
    blocks_of : the blocks of recording i, from 0. They must depend on i and `settings` only: then a run that was
        interrupted and taken up again gives the same files as one that was not.
    settings : whatever the recordings depend on, as JSON can hold it; kept in ``series.json`` beside the version.
    bytes_each : size of one recording; the folder's disk must have room for those still to be made.
    progress : called with recordings done and in all.

    Raises
    ------
    InputError
        The folder holds something else, or was made with other settings or by another version; or it has no room.
    """
    from swashtwin.recordings.formats.registry import write_blocks
    from swashtwin.recordings.index import INDEX_NAME, write_index

    folder = Path(folder).resolve()
    open_pieces(folder, _MANIFEST, settings)
    count = max(count, len(list(folder.glob(f"{folder.name}-[0-9][0-9][0-9][0-9].h5"))))
    files = [folder / f"{folder.name}-{number:04d}.h5" for number in range(count)]
    missing = [number for number, file in enumerate(files) if not file.is_file()]
    require_disk_space(folder, len(missing), bytes_each)
    for written, number in enumerate(missing):
        if progress:
            progress(count - len(missing) + written, count)
        named = (block.replace(recording_id=files[number].stem) for block in blocks_of(number))
        write_blocks(named, files[number])
    if progress:
        progress(count, count)
    index = write_index([read_header(file) for file in files], [file.name for file in files], folder / INDEX_NAME)
    return index, [files[number].stem for number in missing]


def _recording(path: Path, raw: RawFile) -> Recording:
    facts = raw.facts
    if "recording_id" not in facts or raw.sample_rate is None:
        raise DataError(f"{path} is no recording of swashtwin.")
    require_plausible_rates(path, raw)
    columns = Columns(tuple(raw.columns.values()), tuple(facts["factors"]), raw.speeds, tuple(facts["hashes"]))
    name = facts["recording_id"]
    return Recording(
        samples=Samples.from_columns(name, columns, partial(replace, columns)).unopened(),
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
