"""Many recordings in one folder, written one by one, so that a run that ends early can go on."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from swashtwin.foundation import open_pieces, require_disk_space
from swashtwin.recordings.formats.registry import write_blocks
from swashtwin.recordings.index import INDEX_NAME, write_index
from swashtwin.recordings.recording import Recording

MANIFEST_NAME = "series.json"


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
    from swashtwin.recordings.formats.lossless import read_header

    folder = Path(folder).resolve()
    open_pieces(folder, MANIFEST_NAME, settings)
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
