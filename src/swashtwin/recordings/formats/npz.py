"""NumPy archives of arrays."""

from math import prod
from pathlib import Path
from typing import BinaryIO
from zipfile import ZipFile

import numpy as np
from numpy.lib import format

from swashtwin.foundation import DataError, require_memory
from swashtwin.recordings.formats.clock import timed
from swashtwin.recordings.formats.mat import sorted_variables
from swashtwin.recordings.formats.raw import Options, RawFile
from swashtwin.recordings.recording import Recording


def read(path: Path, options: Options) -> RawFile:
    """Vectors of an archive as columns, its single numbers and texts as attributes; an array of objects is refused.

    A vector called ``time`` or ``t`` that is as long as the others [s] gives the rate, or must agree with it.
    """
    with path.open("rb") as stream:
        require_memory(path, _stated_size(path, stream))
        stream.seek(0)
        with np.load(stream, allow_pickle=False) as archive:
            raw = sorted_variables(path, [(name, archive[name]) for name in archive.files])
    return timed(path, raw, options)


def _stated_size(path: Path, stream: BinaryIO) -> int:
    """Bytes of all arrays, in their number type and as columns of doubles, as their headers state them."""
    size = 0
    with ZipFile(stream) as archive:
        for member in archive.infolist():
            with archive.open(member) as file:
                version = format.read_magic(file)
                read = format.read_array_header_1_0 if version == (1, 0) else format.read_array_header_2_0
                shape, _, dtype = read(file)
                stated = prod(shape) * dtype.itemsize
                if stated + file.tell() != member.file_size and not dtype.hasobject:
                    raise DataError(
                        f"{path} is damaged: {member.filename} states {shape} samples of {dtype.itemsize} bytes, and "
                        f"has {member.file_size} bytes."
                    )
            size += stated + 8 * prod(shape)
    return size


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
