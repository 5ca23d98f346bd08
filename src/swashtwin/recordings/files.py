"""Files of recordings: read and written by their suffix, one by one, many in a store, or many in a
folder.
"""

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from errno import EMFILE, ENFILE, ENOSPC
from functools import partial
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from swashtwin.foundation import (
    ArtifactError,
    DataError,
    InputError,
    MissingFileError,
    SwashTwinError,
    atomic_write,
    require_disk_space,
    resume_folder,
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

_FORMATS = {
    **{f".{name}{packed}": "csv" for packed in ("", ".gz") for name in ("csv", "txt", "dat", "lvm", "tsv", "asc")},
    ".mat": "mat", ".wav": "wav", ".tdms": "tdms", ".uff": "uff", ".unv": "uff", ".h5": "hdf5", ".hdf5": "hdf5",
    ".parquet": "parquet", ".npz": "npz", ".mf4": "mdf", ".mdf": "mdf",
}  # fmt: skip
_registered: dict[str, "Callable[[Path, ReadOptions], RawFile]"] = {}
_ENTRY_POINTS = "swashtwin.formats"
WRITABLE_SUFFIXES = (".h5", ".hdf5", ".mat", ".wav", ".csv", ".tdms", ".parquet", ".npz", ".mf4")
"""Suffixes of the files that a recording can be written to."""


def suffixes() -> tuple[str, ...]:
    """Suffixes that can be read."""
    installed = (f".{point.name}" for point in entry_points(group=_ENTRY_POINTS))
    return tuple(dict.fromkeys((*_FORMATS, *_registered, *installed)))


def register_format(suffix: str, read: Callable[[Path, ReadOptions], RawFile]) -> None:
    """Let files that end in `suffix` be read by `read`, in indexes and by `load_recording`.

    An installed package does the same without a call by an entry point of the group
    ``swashtwin.formats``, whose name is the suffix without its point.

    Parameters
    ----------
    suffix : such as ``".acq"``, in any case of letters.
    read : called with the path of a file and the `ReadOptions` of its index entry; returns its content.
        It may raise
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


def open_raw(path: Path, options: ReadOptions) -> RawFile:
    """Content of a file; its columns stay in the file until they are sliced, where the format
    allows it.

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
            warnings.simplefilter(
                "ignore"
            )  # readers warn about parts of a file that are not used here
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
        left_out = (
            f"; left out: {raw.attributes['left_out']}" if "left_out" in raw.attributes else ""
        )
        raise DataError(f"{path} holds no vector of numbers{left_out}.")
    require_plausible_rates(path, raw)
    return raw


def _reader(path: Path) -> Callable[[Path, ReadOptions], RawFile]:
    """What reads a file: our own formats in another process, registered ones in this."""
    suffix = suffix_of(path)
    if suffix in _FORMATS:
        return lambda path, options: read_in_subprocess(_FORMATS[suffix], path, options)[""]
    if suffix not in _registered:
        for point in entry_points(group=_ENTRY_POINTS, name=suffix[1:]):
            register_format(suffix, point.load())
    if suffix not in _registered:
        raise DataError(
            f"{path}: {suffix or 'no suffix'!r} cannot be read; supported are {', '.join(suffixes())}."
        )
    return _registered[suffix]


def write_recording(recording: Recording, path: str | Path) -> Path:
    """Path of the file that now holds the recording.

    ``.h5`` holds the whole recording; the others lack label, condition and specimen and ``.wav``
    also the unit, which `write_index` adds. The speed at each sample is lost by all but ``.h5``: a
    column of another unit beside the channels would be read back as one of them. The old file stays
    as it is until the new one is complete.

    Raises
    ------
    InputError
        The suffix cannot be written, or the recording does not fit the format.
    """
    path = Path(path)
    suffix = _require_suffix(path, WRITABLE_SUFFIXES, "written")
    with atomic_write(path) as partial_file:
        _writer(suffix).write(recording, partial_file)
    return path


def write_blocks(blocks: Iterable[Recording], path: str | Path) -> Recording:
    """The recording that `path` now holds, written block by block.

    It is that of `join_blocks`, but only one block is in memory at a time: for recordings that are
    longer than memory allows. The old file stays as it is until the new one is complete.

    Parameters
    ----------
    blocks : parts of one recording that follow each other without a gap, all with the facts of the
        first.
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
    with atomic_write(path) as partial_file:
        writer.write_stream(iter(blocks), partial_file)
    return read_header(path)


def _require_suffix(path: Path, allowed: tuple[str, ...], verb: str) -> str:
    suffix = suffix_of(path)
    if suffix not in allowed:
        raise InputError(
            f"{path}: {suffix or 'no suffix'!r} cannot be {verb}; supported are {', '.join(allowed)}."
        )
    return suffix


def _writer(suffix: str) -> Any:
    return import_module(f"swashtwin.recordings.formats.{_FORMATS[suffix]}")


_SUFFIXES = (".h5", ".hdf5")
_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_MANIFEST = "series.json"


def write_store(
    recordings: Iterable[Recording],
    path: str | Path,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Path of the store that now holds the recordings, in their order.

    Samples are copied block by block in the number type of their file, with the factor that makes
    them the recording's unit beside them, so nothing is rounded and no recording is ever whole in
    memory. The old file stays as it is until the new one is complete.

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
    require_unique_ids((recording.recording_id for recording in recordings), "a store")
    size = sum(
        recording.samples.dtype.itemsize * recording.n_channels * recording.n_samples
        for recording in recordings
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    require_disk_space(path.parent, 1, size)
    done = 0

    def written(count: int) -> None:
        nonlocal done
        done += count
        if progress:
            progress(done // 1_000_000, size // 1_000_000)

    with atomic_write(path) as partial_file:
        write_many(list(recordings), partial_file, written)
    return path


def load_store(path: Path) -> list[Recording]:
    """Every recording of a store."""
    try:
        contents = read_in_subprocess("hdf5", path, ReadOptions(), "read_store")
        return [_recording(path, raw) for raw in contents.values()]
    except ArtifactError:
        raise
    except (DataError, InputError) as cause:
        raise ArtifactError(
            f"{path} is damaged: {cause}" if isinstance(cause, InputError) else str(cause)
        ) from cause


def read_header(path: Path) -> Recording:
    """Recording of a file of its own; its samples are read when they are asked for."""
    return _recording(path, read_in_subprocess("hdf5", path, ReadOptions())[""])


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
    """Index of a folder of recordings, and the ids of those made now; what an earlier run left
    whole is kept.

    The files are ``NAME-0000.h5``, ``NAME-0001.h5``, ..., where NAME is the folder's, and each
    recording has the id of its file, which appears when it is whole.

    Parameters
    ----------
    folder : new or empty folder, or one that an earlier run with equal `settings` left; `count` may
        have grown; a smaller one leaves all that are there.
    blocks_of : the blocks of recording i, from 0. They must depend on i and `settings` only: then a
        run that was interrupted and taken up again gives the same files as one that was not.
    settings : whatever the recordings depend on, as JSON can hold it; kept in ``series.json``
        beside the version.
    bytes_each : size of one recording; the folder's disk must have room for those still to be made.
    progress : called with recordings done and in all.

    Raises
    ------
    InputError
        The folder holds something else, or was made with other settings or by another version; or
        it has no room.
    """
    from swashtwin.recordings.index import INDEX_NAME, write_index

    folder = Path(folder).resolve()
    resume_folder(folder, _MANIFEST, settings)
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
    index = write_index(
        [read_header(file) for file in files], [file.name for file in files], folder / INDEX_NAME
    )
    return index, [files[number].stem for number in missing]


def _recording(path: Path, raw: RawFile) -> Recording:
    facts = raw.facts
    if "recording_id" not in facts or raw.sample_rate is None:
        raise DataError(f"{path} is no recording of swashtwin.")
    require_plausible_rates(path, raw)
    columns = Columns(
        tuple(raw.columns.values()), tuple(facts["factors"]), raw.speeds, tuple(facts["hashes"])
    )
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
