"""Which module reads and writes which suffix; the checks that every file passes."""

import warnings
from collections.abc import Callable, Iterable
from errno import EMFILE, ENFILE, ENOSPC
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from swashtwin.foundation import DataError, InputError, MissingFileError, SwashTwinError, replacing
from swashtwin.recordings.formats.isolation import read_in_subprocess
from swashtwin.recordings.formats.raw import Options, RawFile, require_plausible_rates
from swashtwin.recordings.recording import Recording

_FORMATS = {
    **{f".{name}{packed}": "csv" for packed in ("", ".gz") for name in ("csv", "txt", "dat", "lvm", "tsv", "asc")},
    ".mat": "mat", ".wav": "wav", ".tdms": "tdms", ".uff": "uff", ".unv": "uff", ".h5": "hdf5", ".hdf5": "hdf5",
    ".parquet": "parquet", ".npz": "npz", ".mf4": "mdf", ".mdf": "mdf",
}  # fmt: skip
_registered: dict[str, "Callable[[Path, Options], RawFile]"] = {}
_ENTRY_POINTS = "swashtwin.formats"
WRITABLE = (".h5", ".hdf5", ".mat", ".wav", ".csv", ".tdms", ".parquet", ".npz", ".mf4")
"""Suffixes of the files that a recording can be written to."""


def suffixes() -> tuple[str, ...]:
    """Suffixes that can be read."""
    installed = (f".{point.name}" for point in entry_points(group=_ENTRY_POINTS))
    return tuple(dict.fromkeys((*_FORMATS, *_registered, *installed)))


def register_format(suffix: str, read: Callable[[Path, Options], RawFile]) -> None:
    """Let files that end in `suffix` be read by `read`, in indexes and by `load_recording`.

    An installed package does the same without a call by an entry point of the group ``swashtwin.formats``, whose name
    is the suffix without its point.

    Parameters
    ----------
    suffix : such as ``".acq"``, in any case of letters.
    read : called with the path of a file and the `Options` of its index entry; returns its content. It may raise
        anything: a file that it cannot read is reported as damaged.

    Raises
    ------
    InputError
        The suffix has no point, or belongs to another format.

    Examples
    --------
    >>> register_format(".counts", lambda path, options: RawFile({"x": ...}, 1000.0, {"x": "g"}))
    >>> ".counts" in suffixes()
    True
    """
    suffix = suffix.lower()
    if not suffix.startswith(".") or len(suffix) < 2:
        raise InputError(f"suffix {suffix!r} must begin with a point, such as '.acq'.")
    if suffix in _FORMATS:
        raise InputError(f"{suffix!r} is read by swashtwin itself; choose another suffix.")
    _registered[suffix] = read


def suffix_of(path: Path) -> str:
    """Suffix in small letters, with the one before it where the file is gzipped."""
    parts = [part.lower() for part in path.suffixes]
    return "".join(parts[-2:]) if parts[-1:] == [".gz"] else "".join(parts[-1:])


def stem_of(path: Path) -> str:
    """File name without its suffix, or both suffixes where it is gzipped."""
    suffix = suffix_of(path)
    return path.name[: -len(suffix)] if suffix else path.name


def open_raw(path: Path, options: Options) -> RawFile:
    """Content of a file; its columns stay in the file until they are sliced, where the format allows it.

    Raises
    ------
    MissingFileError
        No such file.
    DataError
        The file is empty, of an unknown format, damaged or cut off.
    OSError
        The computer has too many open files or no space.
    """
    if not path.is_file():
        raise MissingFileError(f"{path} does not exist, or is no file.")
    read = _reader(path)
    if path.stat().st_size == 0:
        raise DataError(f"{path} is empty (0 bytes).")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # readers warn about parts of a file that are not used here
            raw = read(path, options)
    except (SwashTwinError, PermissionError):
        raise
    except Exception as cause:  # what a damaged file makes a parser raise has no bounds
        if isinstance(cause, OSError) and cause.errno in (EMFILE, ENFILE, ENOSPC):
            raise  # of the computer and not of the file
        reason = (str(cause).splitlines() or [""])[0][:160]
        raise DataError(
            f"{path} is damaged, cut off, or no {suffix_of(path)} file ({type(cause).__name__}: {reason})."
        ) from cause
    if not raw.columns:
        left_out = f"; left out: {raw.attributes['left_out']}" if "left_out" in raw.attributes else ""
        raise DataError(f"{path} holds no vector of numbers{left_out}.")
    require_plausible_rates(path, raw)
    return raw


def _reader(path: Path) -> Callable[[Path, Options], RawFile]:
    """What reads a file: our own formats in another process, registered ones in this."""
    suffix = suffix_of(path)
    if suffix in _FORMATS:
        return lambda path, options: read_in_subprocess(_FORMATS[suffix], path, options)[""]
    if suffix not in _registered:
        for point in entry_points(group=_ENTRY_POINTS, name=suffix[1:]):
            register_format(suffix, point.load())
    if suffix not in _registered:
        raise DataError(f"{path}: {suffix or 'no suffix'!r} cannot be read; supported are {', '.join(suffixes())}.")
    return _registered[suffix]


def write_recording(recording: Recording, path: str | Path) -> Path:
    """Path of the file that now holds the recording.

    ``.h5`` holds the whole recording; the others lack label, condition and specimen and ``.wav`` also the unit, which
    `write_index` adds. The speed at each sample is lost by all but ``.h5``: a column of another
    unit beside the channels would be read back as one of them. The old file stays as it is until the new one is
    complete.

    Raises
    ------
    InputError
        The suffix cannot be written, or the recording does not fit the format.
    """
    path = Path(path)
    suffix = _require_suffix(path, WRITABLE, "written")
    with replacing(path) as partial_file:
        _writer(suffix).write(recording, partial_file)
    return path


def write_blocks(blocks: Iterable[Recording], path: str | Path) -> Recording:
    """The recording that `path` now holds, written block by block.

    It is that of `join_blocks`, but only one block is in memory at a time: for recordings that are longer than memory
    allows. The old file stays as it is until the new one is complete.

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
    path = Path(path)
    writer = _writer(_require_suffix(path, (".h5", ".hdf5"), "written block by block"))
    with replacing(path) as partial_file:
        writer.write_stream(iter(blocks), partial_file)
    from swashtwin.recordings.store import read_header

    return read_header(path)


def _require_suffix(path: Path, allowed: tuple[str, ...], verb: str) -> str:
    """Suffix of `path`, refused where it is none of those `allowed`."""
    suffix = suffix_of(path)
    if suffix not in allowed:
        raise InputError(f"{path}: {suffix or 'no suffix'!r} cannot be {verb}; supported are {', '.join(allowed)}.")
    return suffix


def _writer(suffix: str) -> Any:
    """Module that writes files of a suffix."""
    return import_module(f"swashtwin.recordings.formats.{_FORMATS[suffix]}")
