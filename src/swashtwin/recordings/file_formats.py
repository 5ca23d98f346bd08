"""Formats of files by their suffix, and how a file of any of them is opened."""

import warnings
from collections.abc import Callable
from errno import EMFILE, ENFILE, ENOSPC
from importlib.metadata import entry_points
from pathlib import Path

from swashtwin.foundation import DataError, InputError, MissingFileError, SwashTwinError
from swashtwin.recordings.formats.isolation import read_in_subprocess
from swashtwin.recordings.formats.raw_file import RawFile, ReadOptions, require_plausible_rates
from swashtwin.recordings.formats.signatures import describe_content, require_content
from swashtwin.recordings.formats.trailing_units import with_trailing_units

Reader = Callable[[Path, ReadOptions], RawFile]
"""Reads a file with the options of its index entry."""

_TEXT_SUFFIXES = (".csv", ".txt", ".dat", ".lvm", ".tsv", ".asc")
FORMAT_MODULES = {
    **dict.fromkeys(_TEXT_SUFFIXES, "csv"),
    **{f"{suffix}.gz": "csv" for suffix in _TEXT_SUFFIXES},
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
"""Module of `recordings.formats` that reads a suffix."""
WRITABLE_SUFFIXES = (".h5", ".hdf5", ".mat", ".wav", ".csv", ".tdms", ".parquet", ".npz", ".mf4")
"""Suffixes of the files that a recording can be written to."""
_ENTRY_POINTS = "swashtwin.formats"

# Characters of a library's error that a message repeats.
_MAX_REASON_LENGTH = 160

# Errors of the computer, not of the file: too many open files, or no space.
_COMPUTER_ERRORS = (EMFILE, ENFILE, ENOSPC)

_registered_readers: dict[str, Reader] = {}


def suffixes() -> tuple[str, ...]:
    """Return the suffixes that can be read."""
    installed = [f".{point.name}" for point in entry_points(group=_ENTRY_POINTS)]
    return tuple(dict.fromkeys((*FORMAT_MODULES, *_registered_readers, *installed)))


def register_format(suffix: str, read: Reader) -> None:
    """Register a function that reads files of a suffix, for indexes and for `load_recording`.

    An installed package does the same without a call by an entry point of the group
    ``swashtwin.formats``, whose name is the suffix without its point.

    Parameters
    ----------
    suffix : such as ``".acq"``; its case does not matter.
    read : called with the path of a file and the `ReadOptions` of its index entry; returns its
        content. It may raise any exception: a file that it cannot read is reported as damaged.

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
        raise InputError(f"Invalid suffix {suffix!r}: it must begin with a point, such as '.acq'.")
    if suffix in FORMAT_MODULES:
        raise InputError(f"{suffix!r} is a format of swashtwin itself; choose another suffix.")
    _registered_readers[suffix] = read


def suffix_of(path: Path) -> str:
    """Return the suffix in small letters; of a gzipped file with the one before it."""
    parts = [part.lower() for part in path.suffixes]
    is_gzipped = parts[-1:] == [".gz"]
    return "".join(parts[-2:] if is_gzipped else parts[-1:])


def stem_of(path: Path) -> str:
    """Return the file name without its suffix (`suffix_of`)."""
    suffix = suffix_of(path)
    return path.name[: -len(suffix)] if suffix else path.name


def find_readable_files(folder: Path) -> list[Path]:
    """Return the files below a folder whose suffix can be read, in order, without hidden ones."""
    readable_suffixes = suffixes()
    files = []
    for path in sorted(folder.rglob("*")):
        is_visible_file = path.is_file() and not path.name.startswith(".")
        if is_visible_file and suffix_of(path) in readable_suffixes:
            files.append(path)
    return files


def open_raw(path: Path, options: ReadOptions) -> RawFile:
    """Return the content of a file; columns are read when sliced, if the format allows it.

    Raises
    ------
    MissingFileError
        The file does not exist.
    DataError
        The file is empty, of an unknown format, damaged or cut off.
    OSError
        The computer has too many open files or no space.
    """
    if not path.is_file():
        raise MissingFileError(f"{path} does not exist, or is not a file.")
    read = _find_reader(path)
    if path.stat().st_size == 0:
        raise DataError(f"{path} is empty (0 bytes).")

    try:
        with warnings.catch_warnings():
            # Libraries warn about parts of a file that are not used here.
            warnings.simplefilter("ignore")
            raw = read(path, options)
    except (SwashTwinError, PermissionError):
        raise
    except Exception as cause:  # a damaged file can make a parser raise anything
        if isinstance(cause, OSError) and cause.errno in _COMPUTER_ERRORS:
            raise
        first_line = (str(cause).splitlines() or [""])[0][:_MAX_REASON_LENGTH]
        raise DataError(
            f"{path} is damaged, cut off, or not a {suffix_of(path)} file "
            f"({type(cause).__name__}: {first_line})."
        ) from cause

    if not raw.columns:
        skipped = raw.attributes.get("left_out")
        hint = f"; left out: {skipped}" if skipped else ""
        raise DataError(f"{path} holds no vector of numbers{hint}.")
    require_plausible_rates(path, raw)
    return with_trailing_units(raw)


def _find_reader(path: Path) -> Reader:
    """Return what reads a file: our formats in another process, registered ones in this."""
    suffix = suffix_of(path)
    if suffix in FORMAT_MODULES:
        module = FORMAT_MODULES[suffix]

        def read_isolated(path: Path, options: ReadOptions) -> RawFile:
            require_content(path, module)
            return read_in_subprocess(module, path, options)[""]

        return read_isolated

    if suffix not in _registered_readers:
        for point in entry_points(group=_ENTRY_POINTS, name=suffix[1:]):
            register_format(suffix, point.load())
    if suffix not in _registered_readers:
        kind, remedy = describe_content(path)
        raise DataError(
            f"{path}{f' is {kind}' if kind else ''}: {suffix or 'no suffix'!r} cannot be read; "
            f"supported are {', '.join(suffixes())}.",
            remedy=remedy,
        )
    return _registered_readers[suffix]
