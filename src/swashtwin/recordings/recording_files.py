"""Files that recordings are written to: one recording at once or in blocks, or a folder of them."""

from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from swashtwin.foundation import InputError, atomic_write, require_disk_space, resume_folder
from swashtwin.recordings.file_formats import FORMAT_MODULES, WRITABLE_SUFFIXES, suffix_of
from swashtwin.recordings.hdf5_store import HDF5_SUFFIXES, load_written_recording
from swashtwin.recordings.index_reading import INDEX_NAME
from swashtwin.recordings.index_writing import write_index
from swashtwin.recordings.recording import Recording

_SETTINGS_NAME = "series.json"


def write_recording(recording: Recording, path: str | Path) -> Path:
    """Write a recording into a file, and return the path.

    ``.h5`` holds the whole recording; the others lack label, operating point and specimen, and
    ``.wav`` also the unit, which `write_index` adds. Only ``.h5`` holds the speed at each sample: a
    column of another unit besides the channels would be read back as one of them. The previous
    file stays until the new one is complete.

    Raises
    ------
    InputError
        The suffix cannot be written, or the recording does not fit the format.
    """
    path = Path(path)
    suffix = suffix_of(path)
    if suffix not in WRITABLE_SUFFIXES:
        raise InputError(
            f"{path}: {suffix or 'no suffix'!r} cannot be written; supported are "
            f"{', '.join(WRITABLE_SUFFIXES)}."
        )

    with atomic_write(path) as temporary:
        _import_writer(suffix).write(recording, temporary)
    return path


def write_blocks(blocks: Iterable[Recording], path: str | Path) -> Recording:
    """Write a recording block by block, and return it as the file holds it.

    It equals that of `join_blocks`, but only one block is in memory at a time: for recordings that
    are longer than memory allows. The previous file stays until the new one is complete.

    Parameters
    ----------
    blocks : consecutive parts of one recording, all with the facts of the first.
    path : file to write, ``.h5``.

    Raises
    ------
    InputError
        Another suffix.
    DataError
        There is no block, or a block does not continue the first.
    """
    path = Path(path)
    suffix = suffix_of(path)
    if suffix not in HDF5_SUFFIXES:
        raise InputError(
            f"{path}: {suffix or 'no suffix'!r} cannot be written block by block; supported are "
            f"{', '.join(HDF5_SUFFIXES)}."
        )

    with atomic_write(path) as temporary:
        _import_writer(suffix).write_stream(iter(blocks), temporary)
    return load_written_recording(path)


def _import_writer(suffix: str) -> Any:
    return import_module(f"swashtwin.recordings.formats.{FORMAT_MODULES[suffix]}")


def write_series(
    folder: str | Path,
    count: int,
    blocks_of: Callable[[int], Iterable[Recording]],
    *,
    settings: Mapping[str, Any],
    bytes_each: int,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Path, list[str]]:
    """Write a folder of recordings; return its index and the ids of those written by this call.

    The files are ``NAME-0000.h5``, ``NAME-0001.h5``, ..., where NAME is the folder's, and each
    recording has the id of its file, which appears when it is complete. Complete files of an
    earlier run stay.

    Parameters
    ----------
    folder : new or empty folder, or one that an earlier run with equal `settings` left; `count` may
        have grown; a smaller one removes no file.
    blocks_of : returns the blocks of recording i, from 0. They must depend on i and `settings`
        only: then a run that was interrupted and continued writes the same files as one that was
        not.
    settings : everything that the recordings depend on, as JSON can hold it; it is written to
        ``series.json`` with the version.
    bytes_each : size of one recording; the folder's disk must have room for those to be written.
    progress : called with the number of recordings that are done, and of all.

    Raises
    ------
    InputError
        The folder holds something else, or was made with other settings or by another version; or
        its disk has no room.
    """
    folder = Path(folder).resolve()
    resume_folder(folder, _SETTINGS_NAME, settings)
    existing = list(folder.glob(f"{folder.name}-[0-9][0-9][0-9][0-9].h5"))
    count = max(count, len(existing))
    files = [folder / f"{folder.name}-{number:04d}.h5" for number in range(count)]
    missing = [number for number, file in enumerate(files) if not file.is_file()]
    require_disk_space(folder, len(missing), bytes_each)

    done = count - len(missing)
    for number in missing:
        if progress:
            progress(done, count)
        name = files[number].stem
        write_blocks(
            (block.replace(recording_id=name) for block in blocks_of(number)), files[number]
        )
        done += 1
    if progress:
        progress(count, count)

    recordings = [load_written_recording(file) for file in files]
    index = write_index(recordings, [file.name for file in files], folder / INDEX_NAME)
    return index, [files[number].stem for number in missing]
