"""Which module reads and writes which suffix, and what every file must pass before and after."""

import warnings
from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path
from typing import Any

from swashtwin.foundation import DataError, InputError, MissingFileError, SwashTwinError, replacing
from swashtwin.recordings.formats.raw import Options, RawFile
from swashtwin.recordings.recording import Recording

_FORMATS = {
    ".csv": "csv",
    ".txt": "csv",
    ".dat": "csv",
    ".tsv": "csv",
    ".asc": "csv",
    ".csv.gz": "csv",
    ".txt.gz": "csv",
    ".dat.gz": "csv",
    ".tsv.gz": "csv",
    ".mat": "mat",
    ".wav": "wav",
    ".tdms": "tdms",
    ".uff": "uff",
    ".unv": "uff",
    ".h5": "hdf5",
    ".hdf5": "hdf5",
    ".parquet": "parquet",
    ".npz": "npz",
    ".mf4": "mdf",
    ".mdf": "mdf",
}
SUFFIXES = tuple(_FORMATS)
"""Suffixes that can be read."""
_RATES = (1e-3, 1e9)
"""Sample rates that anything measures at [Hz]."""
WRITABLE = (".h5", ".hdf5", ".mat", ".wav", ".csv", ".tdms", ".parquet", ".npz", ".mf4")
"""Suffixes of the files that a recording can be written to."""


def suffix_of(path: Path) -> str:
    """Suffix in small letters, with the one before it where the file is gzipped."""
    parts = [part.lower() for part in path.suffixes]
    return "".join(parts[-2:]) if parts[-1:] == [".gz"] else "".join(parts[-1:])


def stem_of(path: Path) -> str:
    """File name without its suffix, or both suffixes where it is gzipped."""
    suffix = suffix_of(path)
    return path.name[: -len(suffix)] if suffix else path.name


def read_raw(path: Path, options: Options) -> RawFile:
    """Columns of the file, as arrays, and what it says of them.

    Raises
    ------
    MissingFileError
        No such file.
    DataError
        The file is empty, of an unknown format, damaged or cut off.
    """
    return _checked(path, lambda module: module.read(path, options))


def open_raw(path: Path, options: Options) -> RawFile:
    """As `read_raw`, but the columns stay in the file until they are sliced, where the format allows it."""
    return _checked(path, lambda module: getattr(module, "open_columns", module.read)(path, options))


def _checked(path: Path, read: Callable[[Any], RawFile]) -> RawFile:
    if not path.is_file():
        raise MissingFileError(f"{path} does not exist, or is no file.")
    module = _module(path, SUFFIXES, "read")
    if path.stat().st_size == 0:
        raise DataError(f"{path} is empty (0 bytes).")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # readers warn about parts of a file that are not used here
            raw = read(module)
    except (SwashTwinError, PermissionError):
        raise
    except Exception as cause:  # what a damaged file makes a parser raise has no bounds
        reason = (str(cause).splitlines() or [""])[0][:160]
        raise DataError(
            f"{path} is damaged, cut off, or no {suffix_of(path)} file ({type(cause).__name__}: {reason})."
        ) from cause
    if not raw.columns:
        raise DataError(f"{path} holds no vector of numbers.")
    for rate in (raw.sample_rate, *raw.rates.values()):
        if rate is not None and not _RATES[0] <= rate <= _RATES[1]:
            raise DataError(f"{path} states a sample rate of {rate:g} Hz; the file is damaged, or its time no time.")
    return raw


def write_recording(recording: Recording, path: str | Path) -> Path:
    """Path of the file that now holds the recording.

    ``.h5`` holds the whole recording; the others lack label, condition and specimen and ``.wav`` also the unit, which
    `write_index` adds. The speed of each reading is lost by all but ``.h5``: a column of another
    unit beside the channels would be read back as one of them. The old file stays as it is until the new one is
    complete.

    Raises
    ------
    InputError
        The suffix cannot be written, or the recording does not fit the format.
    """
    path = Path(path)
    module = _module(path, WRITABLE, "written")
    with replacing(path) as partial:
        module.write(recording, partial)
    return path


def write_blocks(blocks: Iterable[Recording], path: str | Path) -> Recording:
    """What is known of the recording that `path` now holds, with its first reading only.

    The recording is that of `recording.joined`, but only one block is in memory at a time: for recordings that are
    longer than memory allows. The old file stays as it is until the new one is complete.

    Parameters
    ----------
    blocks : parts of one recording that follow each other without a gap, all with the facts of the first.
    path : file to write, ``.h5``.

    Raises
    ------
    InputError
        Another suffix.
    DataError
        There is no block, or a block does not continue the first.
    """
    path, left = Path(path), iter(blocks)
    module = _module(path, (".h5", ".hdf5"), "written block by block")
    with replacing(path) as partial:
        facts: Recording = module.write_stream(left, partial)
    return facts


def _module(path: Path, suffixes: tuple[str, ...], verb: str) -> Any:
    suffix = suffix_of(path)
    if suffix not in suffixes:
        kind = DataError if verb == "read" else InputError
        raise kind(f"{path}: {suffix or 'no suffix'!r} cannot be {verb}; supported are {', '.join(suffixes)}.")
    return import_module(f"swashtwin.recordings.formats.{_FORMATS[suffix]}")
