"""Opening HDF5 files whose samples are sound and local, and writing files that survive a full
disk.
"""

from collections.abc import Callable
from math import prod
from pathlib import Path
from typing import Any, BinaryIO

import h5py

from swashtwin.foundation import DataError, require_memory
from swashtwin.recordings.formats.raw_file import require_plausible_size

# Oldest and newest layout of files that are written: it has checksums.
#
# A damaged file of an older layout can send the HDF5 library into an endless loop.
_LAYOUT = ("v110", "v110")


def open_file(path: Path, cache_bytes: int) -> h5py.File:
    """Return a file that is open for reading and has no links to other files.

    Parameters
    ----------
    cache_bytes : unpacked chunks that are kept for the next slices [byte].
    """
    # Without locking, the parent process can write a file that this one still has open.
    file = h5py.File(path, "r", rdcc_nbytes=cache_bytes, locking=False)
    require_local_links(path, file)
    return file


def require_local_links(path: Path, file: h5py.File) -> None:
    """Refuse a file with links to other files, which would read what nobody named."""

    def external_link(name: str, link: Any) -> str | None:
        if isinstance(link, h5py.ExternalLink):
            return f"{name!r} is a link to another file ({link.filename})"
        return None

    problem = file.visititems_links(external_link)
    if problem:
        raise DataError(f"{path}: {problem}; put its data into this file, for example with h5copy.")


def require_local_data(path: Path, dataset: h5py.Dataset) -> None:
    """Refuse a data set whose samples are not all in this file, or do not fit in memory in blocks.

    That is a virtual or external data set, one of which parts were never written, one with too
    large chunks, or one that is packed beyond what is plausible.
    """
    if not dataset.size:
        return

    name = dataset.name
    if dataset.is_virtual or dataset.external:
        kind = "virtual" if dataset.is_virtual else "external"
        raise DataError(
            f"{path}: the data set {name} is {kind}: its samples are in other files; "
            "copy them into this file."
        )

    size = prod(dataset.shape) * dataset.dtype.itemsize
    require_plausible_size(path, size, f"{name}, {dataset.shape}")

    if dataset.chunks is None:
        stored_count = dataset.id.get_storage_size()
        expected_count = size
        parts = "bytes"
    else:
        chunk_size = prod(dataset.chunks) * dataset.dtype.itemsize
        # A chunk is in memory twice: as it is stored, and unpacked.
        require_memory(path, 2 * chunk_size, reason=f"has chunks of {name} that take")
        stored_count = dataset.id.get_num_chunks()
        expected_count = prod(
            -(-length // chunk_length)
            for length, chunk_length in zip(dataset.shape, dataset.chunks, strict=True)
        )
        parts = "chunks"

    if stored_count < expected_count:
        raise DataError(
            f"{path}: of the data set {name} only {stored_count} of {expected_count} {parts} were "
            "written; the rest would be read as zeros that nobody measured."
        )


def create_file(path: Path, fill: Callable[[h5py.File, "ErrorKeepingFile"], None]) -> None:
    """Create a file and let `fill` write it.

    Raises
    ------
    OSError
        Of the disk, such as that it is full.
    """
    with path.open("wb+", buffering=0) as stream:
        target = ErrorKeepingFile(stream)
        with h5py.File(target, "w", libver=_LAYOUT) as file:
            fill(file, target)
        target.raise_error()


class ErrorKeepingFile:
    """File that keeps its first error, and then pretends to write.

    If writing fails on a full disk, the HDF5 library leaves its file open and complains past any
    handler; so it must never learn of the error.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.error: OSError | None = None
        self.seek = file.seek
        self.tell = file.tell
        self.read = file.read

    def write(self, data: Any) -> int:
        """Return the number of bytes of `data` (a buffer), whether they were written or not."""
        remaining = memoryview(data)
        try:
            while self.error is None and remaining.nbytes:
                remaining = remaining[self._file.write(remaining) :]
        except OSError as cause:
            self.error = cause
        return len(data)

    def truncate(self, size: int) -> int:
        """Return `size`, to which the file was cut or extended."""
        try:
            if self.error is None:
                self._file.truncate(size)
        except OSError as cause:
            self.error = cause
        return size

    def flush(self) -> None:
        """Do nothing: the file is not buffered."""

    def raise_error(self) -> None:
        """Raise the first error, if there was one."""
        if self.error is not None:
            raise self.error
